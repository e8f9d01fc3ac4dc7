"""Content of a run for other viewers: curves, frames, bodies of the cell, the part as it was cut, events."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.panel.cell_scene import CellScene
from counterflex.app.run_history.logged_run import RunOfHistory, file_of_run
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import CounterflexError
from counterflex.core.units import MM, NS, UM
from counterflex.evaluate.run_curves import deviations
from counterflex.files.logs.segments import segments
from counterflex.geometry import pose
from counterflex.runtime.record_ring import column
from counterflex.runtime.state.supervisor import Cause, State

EVERY: Final = 5
"""Frames are shown of every fifth cycle; curves of each."""
_SPACING_M: Final = 0.5 * MM
_MOST_POINTS: Final = 20_000
_SIX: Final = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class Happened:
    """Something that happened in a run."""

    time_ns: int  # Since 1970
    text: str
    serious: bool  # A hold, a fault, or a stop of an operator


@dataclass(frozen=True, eq=False)
class Content:
    """A run as other viewers show it. Frames: ``base`` of the robot, ``part``, ``commanded``, ``corrected``, ..."""

    name: str
    time_ns: Int  # (n,) since 1970, when the telegram of each cycle came; rising
    curves: dict[str, dict[str, Float]]  # (n,) by group and name with its unit; not a number: not known
    q: Float  # (n, 6) rad
    commanded: Float  # (n, 12) pose without correction, part frame: rotation by rows, position m
    correction: Float  # (n, 6) sent, m and rotation vector, part axes
    cut: Float  # (k, 3) m, places of the tool tip in the cut, part frame
    cut_rest_m: Float  # (k,) size of the deviation that remained there
    cut_ns: Int  # (k,) since 1970, when
    happened: tuple[Happened, ...]  # In order
    scene: CellScene | None  # The cell, or None where its file is not there any more

    def poses(self) -> Iterator[tuple[int, dict[str, tuple[str, Float]]]]:
        """Poses of the frames of every :data:`EVERY` cycle: time, and by frame its parent and (4, 4) its pose there."""
        for k in range(0, len(self.time_ns), EVERY):
            nominal = pose.make(self.commanded[k, :9].reshape(3, 3), self.commanded[k, 9:])
            corrected = pose.displaced(nominal, self.correction[k])
            out = {"commanded": ("part", nominal), "corrected": ("part", corrected)}
            if self.scene is not None:
                for name, flat in self.scene.frames(self.q[k]).items():
                    if name != "base":
                        out[name] = ("base", pose.make(np.array(flat[:9]).reshape(3, 3), np.array(flat[9:])))
            yield int(self.time_ns[k]), out


def content_of(folder: Path, number: int | None = None) -> Content:
    """Read a run for other viewers.

    Args:
        number: Of the run; None is the last.
    """
    run = RunOfHistory.of(folder, number)
    rows = _columns(folder, run.row["run"])
    offset = int(run.about.get("wall_minus_monotonic_ns", 0))
    time = np.maximum.accumulate(rows["received_ns"].astype(np.int64) + offset)
    pairs = deviations(run.curves, run.contained_m)
    curves = {
        f"deviation_{name}": {"across_um": values[:, 0] / UM, "along_tool_um": values[:, 1] / UM}
        for name, values in pairs.items()
        if np.isfinite(values).any()
    }
    size = np.linalg.norm(rows["correction"][:, :3], axis=1) / UM
    curves["correction"] = {"size_um": size, "across_um": run.curves.sent_m[:, 0] / UM}
    force = {"measured_n": run.curves.force_n, "planned_n": run.curves.planned_n, "ratio": run.curves.ratio}
    curves["force"] = {name: values for name, values in force.items() if np.isfinite(values).any()}
    curves["loop"] = {
        "state": rows["state"],
        "cause": rows["cause"],
        "answer_us": (rows["sent_ns"] - rows["received_ns"]) * NS / UM,
        "place_mm": run.curves.length_m / MM,
        "speed_percent": 100.0 * rows["speed"],
    }
    places, rest, when = _cut(run, rows["nominal"][:, 9:], pairs["remaining"], time)
    cell = file_of_run(run.about, "cell", folder)
    return Content(
        f"{folder.resolve().name} run {run.row['run']}",
        time,
        {name: group for name, group in curves.items() if group},
        rows["q"],
        rows["nominal"],
        rows["correction"],
        places,
        rest,
        when,
        tuple(sorted(_happened(run, rows, time), key=lambda one: one.time_ns)),
        None if cell is None else _scene(cell),
    )


def _scene(cell: Path) -> CellScene | None:
    try:
        return CellScene(cell)
    except CounterflexError:
        return None


def _columns(folder: Path, number: int) -> dict[str, Float]:
    """Return what is shown of the records of a run."""
    first = column("nominal_R00")
    places: dict[str, int | slice] = {
        "received_ns": column("received_ns"),
        "sent_ns": column("sent_ns"),
        "state": column("out_state"),
        "cause": column("out_cause"),
        "speed": column("speed_asked"),
        "nominal": slice(first, first + 12),
        "q": slice(column("q1"), column("q1") + 6),
        "correction": slice(column("correction_x"), column("correction_x") + len(_SIX)),
    }
    parts = [
        {name: segment.rows[:, place].copy() for name, place in places.items()}
        for segment in segments(folder)
        if segment.about and segment.run == number and len(segment.rows)
    ]
    return {name: np.concatenate([part[name] for part in parts]) for name in places}


def _cut(run: RunOfHistory, p: Float, rest: Float, time: Int) -> tuple[Float, Float, Int]:
    """Places of the cut, at least half a millimetre apart; fewer of a long one."""
    at = np.flatnonzero(run.curves.cut & np.isfinite(p).all(axis=1))
    if len(at) == 0:
        return np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=np.int64)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p[at], axis=0), axis=1))])
    spacing = max(_SPACING_M, way[-1] / _MOST_POINTS)
    at = at[np.unique(np.floor(way / spacing).astype(np.int64), return_index=True)[1]]
    return p[at], np.nan_to_num(np.linalg.norm(rest[at], axis=1)), time[at]


def _happened(run: RunOfHistory, rows: dict[str, Float], time: Int) -> Iterator[Happened]:
    begin = int(time[0])
    state, cause = rows["state"].astype(np.int64), rows["cause"].astype(np.int64)
    yield Happened(begin, f"state {State(int(state[0])).name}", False)
    for k in np.flatnonzero(np.diff(state)) + 1:
        why = "" if cause[k] == 0 else f": {Cause(int(cause[k])).name.lower().replace('_', ' ')}"
        serious = State(int(state[k])) in (State.HOLD, State.FAULT)
        yield Happened(int(time[k]), f"state {State(int(state[k])).name}{why}", serious)
    for one in run.actions:
        outcome = "done" if one.get("done") else str(one.get("refused", "refused"))
        text = f"{one.get('who', '')}: {one.get('action', one.get('text', ''))}: {outcome}"
        yield Happened(begin + round(one["time_s"] / NS), text, one.get("action") == "stop")


def plain(content: Content) -> dict[str, Any]:
    """Return what was written, for people and programs."""
    return {
        "run": content.name,
        "cycles": len(content.time_ns),
        "curves": sorted(f"{group}/{name}" for group, values in content.curves.items() for name in values),
        "cut_points": len(content.cut),
        "cell": content.scene is not None,
        "events": len(content.happened),
    }
