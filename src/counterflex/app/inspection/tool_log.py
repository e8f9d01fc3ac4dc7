"""Logs of the tool's path read for an inspection: a tracker's, or run logs of counterflex."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.tracker_readings import FIT, CommandFrame, read_measured
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.similar import missing_file
from counterflex.core.units import MS
from counterflex.evaluate.tool_path.readings import ToolReadings
from counterflex.files.cell.cell import Cell
from counterflex.files.logs.segments import LogSegment, read_segment, segments
from counterflex.files.logs.tracker_exports.formats import OWN
from counterflex.geometry import pose
from counterflex.path.toolpath import ToolPath, tool_orientation
from counterflex.runtime.record_ring import column

POSITIONS: Final[dict[str, str]] = {
    "measured": "measured by the tracker of the run",
    "reported": "reported by the robot controller from its axes: the arm's deflection is not in it",
    "commanded": "commanded: nothing was measured",
}
_CUTS: Final = 3.0  # A run has cut where its force within the planned cut is so many times that outside of it


@dataclass(frozen=True)
class LogHow:
    """Settings by which a log of the tool's path is read and laid on the program's."""

    # Where the tracker stood: ``as-measured``, ``fit``, a cell file, or X,Y,Z,A,B,C; None: as the cell says
    frame: str | None = None
    form: str = OWN  # Format of a tracker's export
    position: str | None = None  # Which position of a run log is judged; None: the tracker's, else the controller's
    run: int | None = None  # Number of the run in a folder of several
    cut: bool = False  # The part was cut while the tracker logged


@dataclass(frozen=True, eq=False)
class ToolLog:
    """A log as read."""

    file: str
    kind: str  # ``tracker log`` or ``run log``
    position: str
    readings: ToolReadings  # In the part frame, or in the frame of the tracker where that is to be fitted
    frame: str
    fitted: bool  # The frame is to be fitted to the program's path
    cut: bool | None  # Whether the tool cut while it was logged: True, or None: not known
    stated_sigma_m: float  # Standard deviation of a position as the log states it, 0 where it does not
    facts: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def read(cls, source: Path, how: LogHow, cell: Cell, path: ToolPath) -> ToolLog:
        """Read a log: a folder or file (.mcap) of run logs, else a tracker log, export or dataset.

        Args:
            cell: Of the program: where the tracker stood, and how it is aimed at the tool.

        Raises:
            InputError: It does not hold what is requested for.
        """
        if source.is_dir() or source.suffix.lower() == ".mcap":
            return _run_log(source, how)
        return _tracker_log(source, how, cell, path)


def _tracker_log(source: Path, how: LogHow, cell: Cell, path: ToolPath) -> ToolLog:
    for given, name in ((how.position, "--position"), (how.run, "--run")):
        if given is not None:
            raise InputError("a tracker log has no such choice; run logs have", where=name, value=given)
    frame = how.frame
    if frame is None:
        if cell.tables.tracker is None:
            raise InputError(
                "it is not said in which frame the tracker logged",
                where=str(source),
                limit="as-measured (the part frame), a cell file with [tracker], X,Y,Z,A,B,C, or fit",
                hint="Give --frame",
            )
        frame = str(cell.path)
    placed = CommandFrame.of(frame)
    if cell.R_part_plane is not None:  # the program's path lies along the axes of its working plane
        placed = replace(placed, T_command_log=pose.make(cell.R_part_plane.T) @ placed.T_command_log)
    measured = read_measured(source, how.form)
    if measured.oriented:
        p = measured.moved(placed.T_command_log, placed.T_target_tcp).p
    else:
        # a reflector has no orientation: the offset of the target turns with the tool, which one program holds
        R = tool_orientation(path.axis_part[:1], cell.tables.posture.rotation_about_tool_rad)[0]
        p = pose.transform(placed.T_command_log, measured.p) - R @ pose.inverse(placed.T_target_tcp)[:3, 3]
    readings = ToolReadings(np.ascontiguousarray(p), measured.time_s)
    return ToolLog(
        source.name,
        "tracker log",
        "measured by the tracker",
        readings,
        placed.text,
        frame == FIT,
        True if how.cut else None,
        measured.sigma_m,
    )


def _run_log(source: Path, how: LogHow) -> ToolLog:
    if how.frame is not None:
        raise InputError("positions of a run log are in the part frame", where="--frame", hint="Leave --frame out")
    rows, number = _rows(source, how.run)
    rows = rows[rows[:, column("elapsed")] > 0]
    time = np.cumsum(np.concatenate([[0.0], np.diff(rows[:, column("counter_ms")])])) * MS
    if len(rows) == 0 or np.any(np.diff(time) <= 0.0):
        raise InputError(
            "the controller's clock does not go on within the run",
            where=str(source),
            value=f"{len(rows)} answered cycles",
            hint="The controller was started again, or was never heard: give the log of one whole run",
        )
    command = _three(rows, "nominal")
    position, chosen, p, at = _positions(rows, time, how.position, source)
    finite = np.isfinite(p).all(axis=1) & np.isfinite(at)
    order = np.concatenate([[True], np.diff(at[finite]) > 0.0])
    p, at = p[finite][order], at[finite][order]
    if len(p) == 0:
        raise InputError("the run log holds no such position", where=str(source), value=position)
    planned = np.column_stack([np.interp(at, time, command[:, k]) for k in range(3)])
    cut = how.cut or _has_cut(rows)
    sigma = rows[chosen, column("tracker_sigma")] if position == "measured" else np.zeros(1)
    return ToolLog(
        source.name if number == 0 else f"{source.name}, run {number}",
        "run log",
        POSITIONS[position],
        ToolReadings(np.ascontiguousarray(p), at, planned),
        "part frame of the run",
        False,
        True if cut else None,
        float(np.median(sigma)),
        {"run": number, "cycles": len(rows)},
    )


def _positions(rows: Float, time: Float, requested: str | None, source: Path) -> tuple[str, Int, Float, Float]:
    """Return which positions are judged, their rows, places (n, 3) m and times (n,) s."""
    tracked = np.flatnonzero(rows[:, column("flag_tracker_new")] == 1)
    reported = np.flatnonzero(rows[:, column("flag_reported")] == 1)
    have: dict[str, Int] = {"measured": tracked, "reported": reported, "commanded": np.arange(len(rows))}
    position = requested or ("measured" if len(tracked) else "reported")
    chosen = have[position]
    if len(chosen) == 0:
        raise InputError(
            "the run log has no such positions of the tool",
            where=str(source),
            value=f"no position {POSITIONS[position]}",
            hint="--position commanded judges what was commanded; a run with a tracker logs where the tool was"
            if position != "measured"
            else "The run had no tracker: --position reported or commanded",
        )
    some = rows[chosen]
    if position == "measured":
        late = some[:, column("tracker_late")]
        return position, chosen, _three(some, "actual"), time[chosen] - np.where(late > 0.0, late, 0.0)
    if position == "reported":
        return position, chosen, _three(some, "reported"), time[chosen]
    return position, chosen, _three(some, "nominal") + _three(some, "correction"), time[chosen]


def _three(rows: Float, name: str) -> Float:
    return np.ascontiguousarray(rows[:, [column(f"{name}_{axis}") for axis in "xyz"]])


def _has_cut(rows: Float) -> bool:
    """Return whether the force says that material was there: larger where the plan cuts than elsewhere."""
    force = np.linalg.norm(rows[:, [column(f"filtered_{axis}") for axis in ("fx", "fy", "fz")]], axis=1)
    planned = rows[:, column("cutting")] > 0.5
    if np.count_nonzero(planned) < 10 or np.count_nonzero(~planned) < 10:
        return False
    inside, outside = float(np.median(force[planned])), float(np.median(force[~planned]))
    return bool(np.isfinite(inside) and np.isfinite(outside) and inside > max(_CUTS * outside, 1.0))


def _rows(source: Path, requested: int | None) -> tuple[Float, int]:
    """Records of one run of a folder or file, and its number."""
    if source.is_dir():
        pieces: list[LogSegment] = list(segments(source))
    elif source.is_file():
        pieces = [read_segment(source)]
    else:
        raise FileFormatError("no such file", where=str(source), hint=missing_file(source))
    runs = sorted({piece.run for piece in pieces if len(piece.rows)})
    if not runs:
        raise InputError("the run log holds no records", where=str(source))
    if requested is None and len(runs) > 1:
        raise InputError(
            "the folder holds several runs",
            where=str(source),
            value=", ".join(str(number) for number in runs[:8]),
            hint="Give --run with the number of one",
        )
    number = runs[0] if requested is None else requested
    if number not in runs:
        raise InputError("there is no such run in the log", where=str(source), value=number, limit=f"{runs[:8]}")
    return np.concatenate([piece.rows for piece in pieces if piece.run == number]), number
