"""Places of external axes along a program: those that it states, or those that the cell file chooses for it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError, ProgramError
from counterflex.core.next_command import next_command
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.path.external_axes import AxisChange, ExternalPlaces, moving, places_of, with_places
from counterflex.path.tool_rotation import APART_M, NEAR_M
from counterflex.path.toolpath import ToolPath
from counterflex.path.turning import TurnedPath
from counterflex.plan.inputs import Setting
from counterflex.plan.preflight.external_moves import external_row
from counterflex.plan.preflight.process.cut_rows import cutter_or_none
from counterflex.programs.language import LANGUAGES, is_robot
from counterflex.programs.program import Program
from counterflex.programs.robot_text.program import RobotProgram

_CUT_M3: Final = 1e-12  # Less is the grain of the stock
_SAME: Final = 0.01  # mm or deg by which a program and the cell file may state the same place


def changes_along(program: Program, path: ToolPath, cell: Cell) -> tuple[AxisChange, ...]:
    """Changes of place of a program.

    Raises:
        FileFormatError: The places of the cell file belong to another program.
        ProgramError: A program for a robot moves its axes otherwise than the cell file says.
        InputError: The robot holds the part.
    """
    chosen = _chosen(program, path, cell)
    out = chosen
    if isinstance(program, RobotProgram):
        out = tuple(AxisChange(motion, False, values) for motion, values in sorted(program.external.items()))
        if chosen or any(axis.moves for axis in cell.tables.external_axes):
            _require_same(program, out, cell)
        require_frames(places_along(out, cell), cell, program.dialect)
    if out and cell.holds_part:
        raise InputError(
            "external axes that move during a program of a robot that holds the part are not planned",
            where=str(cell.path), value=f"{len(out)} moves", limit="axes that stand",
            hint="Write a program for each operation",
        )  # fmt: skip
    return out


def places_along(changes: tuple[AxisChange, ...], cell: Cell) -> ExternalPlaces | None:
    """Places that changes lead to; None where there are none."""
    if not changes:
        return None
    axes = cell.tables.external_axes
    at = {int(axis.name[1:]): axis.shown for axis in axes}
    plane = pose.make() if cell.R_part_plane is None else pose.make(cell.R_part_plane)
    return places_of(tuple(axis.axis() for axis in axes), at, changes, cell.part.matrix() @ plane)


def _chosen(program: Program, path: ToolPath, cell: Cell) -> tuple[AxisChange, ...]:
    """Changes that the cell file states, at ends of motions of a program that names no external axis."""
    if isinstance(program, RobotProgram):
        return ()
    values: dict[tuple[int, bool], dict[int, float]] = {}
    for axis in cell.tables.external_axes:
        for (from_mm, to_mm, value), point in zip(axis.moves, axis.moves_at_mm, strict=True):
            motion = _motion_at(program, path, (from_mm * MM, to_mm * MM), np.array(point) * MM)
            if motion is None:
                begins = "" if to_mm == from_mm else f" begins after {from_mm:.0f} mm and"
                raise FileFormatError(
                    f"{axis.name} moves along another program than this one", where=f"{cell.path}: external_axes",
                    value=f"no rapid of {Path(program.name).name}{begins} ends at {list(point)} mm "
                    f"after {to_mm:.0f} mm",
                    limit=f"within {APART_M / MM:g} mm",
                    hint="Choose places for this program: "
                    + next_command("plan placement", program.name, cell=cell.path, per_operation=True, out="DIR"),
                )  # fmt: skip
            values.setdefault((motion, to_mm == from_mm), {})[int(axis.name[1:])] = value
    return tuple(AxisChange(motion, stands, moved) for (motion, stands), moved in sorted(values.items()))


def _motion_at(program: Program, path: ToolPath, span_m: tuple[float, float], point: Float) -> int | None:
    """Rapid of a program that goes from a length of its path to another, and ends at a point; None where none does.

    Where both lengths are the same the axes move behind the rapid, which may begin anywhere.
    """
    ends = np.flatnonzero(np.append(path.motion[1:] != path.motion[:-1], True))
    along = np.cumsum(np.linalg.norm(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]), axis=1))[ends]
    begins = np.append(0.0, along[:-1])
    rapid = np.array([program.motions[motion].kind == "rapid" for motion in path.motion[ends]], dtype=np.bool_)
    away = np.linalg.norm(path.p_part_tcp[ends] - point, axis=1)
    fitting = rapid & (np.abs(along - span_m[1]) <= NEAR_M) & (away <= APART_M)
    if span_m[0] != span_m[1]:
        fitting &= np.abs(begins - span_m[0]) <= NEAR_M
    fits = np.flatnonzero(fitting)
    off = away + np.abs(along - span_m[1])
    return None if len(fits) == 0 else int(path.motion[ends[fits[int(np.argmin(off[fits]))]]])


def _require_same(program: RobotProgram, changes: tuple[AxisChange, ...], cell: Cell) -> None:
    """Refuse a program for a robot whose axes take other places, or another number of them, than the cell file says."""
    for axis in cell.tables.external_axes:
        number = int(axis.name[1:])
        states = [change.values[number] for change in changes if number in change.values]
        chosen = [value for *_, value in axis.moves]
        if len(states) != len(chosen) or any(abs(a - b) > _SAME for a, b in zip(states, chosen, strict=True)):
            raise ProgramError(
                f"the program moves {axis.name} otherwise than the cell file says", where=program.name,
                value=", ".join(f"{value:g}" for value in states) or "it stands",
                limit=", ".join(f"{value:g}" for value in chosen) or "it stands",
                hint=f"Take the moves out of {cell.path}: those of the program count then",
            )  # fmt: skip


def written_places(places: ExternalPlaces | None, cell: Cell, language: str) -> list[dict[int, float]]:
    """Values of the external axes at each place, as a language for robots writes them; empty where they stand."""
    require_frames(places, cell, language)
    return [] if places is None else [places.shown(place) for place in range(len(places.values))]


def require_frames(places: ExternalPlaces | None, cell: Cell, language: str) -> None:
    """Refuse axes that move where the frame of the targets does not go with them, or nothing says whether it does.

    Raises:
        InputError: It does not.
    """
    if places is None:
        return
    moves = np.ptp(places.values, axis=0) > 0.0
    for axis, moved in zip(cell.tables.external_axes, moves, strict=True):
        if not moved:
            continue
        one = f"a program for each operation, with {axis.name} at rest, needs no such frame"
        if not axis.coupled:
            raise InputError(
                f"{axis.name} moves between operations, and nothing says that the controller counts it in",
                where=f"{cell.path}: external_axes.coupled", value="missing" if axis.coupled is None else "false",
                limit="true", hint="Say coupled = true where the frame of the part stays right when the axis moves: it "
                f"is part of the robot's kinematics on the controller; {one}",
            )  # fmt: skip
        named = cell.tables.controller.work_object and LANGUAGES[language].work_object
        if axis.carries == "part" and not named:
            naming = ", ".join(kind.short for _, kind in LANGUAGES.items() if kind.work_object)
            raise InputError(
                f"{axis.name} carries the part, and the frame of the targets that this program names stands",
                where=str(cell.path), value=language, limit=f'{naming} with "controller.work_object", a work object '
                "that goes with the axis (ufmec)", hint=f"Give its name for {naming}; {one}",
            )  # fmt: skip


def unsaid_moves(places: ExternalPlaces | None, cell: Cell, language: str) -> list[str]:
    """Return a sentence where the language of a program has no word for the moves that it was planned with."""
    if places is None or is_robot(language):
        return []
    moves = np.ptp(places.values, axis=0) > 0.0
    names = ", ".join(axis.name for axis, moved in zip(cell.tables.external_axes, moves, strict=True) if moved)
    return [
        f"the program was planned with {names} at {len(places.values)} places ({cell.path.name}: external_axes) and "
        "does not move them: run it only where the machine goes to each place between the operations; --as krl, rapid "
        "or fanuc writes the moves"
    ]


def require_clear(path: ToolPath, volume_m3: Float, program: Program) -> None:
    """Refuse external axes that move while material is removed.

    Args:
        path: n rows.
        volume_m3: (n,) removed on the way to each row.

    Raises:
        InputError: One does.
    """
    rows = np.flatnonzero(moving(path) & (volume_m3 > _CUT_M3))
    if len(rows):
        block = program.blocks[program.motions[int(path.motion[rows[0]])].block]
        raise InputError(
            "an external axis moves while the tool cuts", where=block.where(Path(program.name).name),
            value=f"{volume_m3[rows].sum() / MM**3:.3g} mm3 removed", limit="external axes that stand in the cut",
            hint="Retract above the blank before it moves",
        )  # fmt: skip


def require_allowed(path: ToolPath, setting: Setting, cell: Cell, program: Program) -> None:
    """Refuse external axes that leave their travel, or move while the tool is in the blank.

    Args:
        path: n rows.

    Raises:
        InputError: One does.
    """
    row = external_row(path, setting, cell.stock(), cutter_or_none(setting.cutter_of))
    if row.verdict == "fail" and row.point is not None:
        block = program.blocks[program.motions[int(path.motion[row.point])].block]
        raise InputError(row.what, where=block.where(Path(program.name).name), hint=row.advice)


def refuse_moves(places: ExternalPlaces | None, where: str) -> None:
    """Refuse a program whose external axes move, for a command that looks at one place.

    Raises:
        InputError: They move.
    """
    refuse_places(1 if places is None else len(places.values), where)


def refuse_places(count: int, where: str | Path) -> None:
    """Refuse more than one place of the external axes, see :func:`refuse_moves`.

    Args:
        count: Places along a program, a plan or the moves of a cell file.

    Raises:
        InputError: There are several.
    """
    if count > 1:
        raise InputError(
            "external axes move between the operations of the program, and this command takes them at rest",
            where=str(where), value=f"{count} places", limit="one place",
            hint="compensate, preflight, plan stability and plan placement take them; for this one write a "
            "program for each operation, and a cell file with the place of each",
        )  # fmt: skip


def turned_with_places(
    turned: TurnedPath, changes: tuple[AxisChange, ...], places: ExternalPlaces, rapid_m_s: float
) -> TurnedPath:
    """A turned path with the places of the external axes, see :func:`~counterflex.path.external_axes.with_places`."""
    angles = with_places(replace(turned.path, p_part_tcp=turned.angle_rad), changes, places, rapid_m_s)
    return TurnedPath(
        with_places(turned.path, changes, places, rapid_m_s),
        with_places(turned.programmed, changes, places, rapid_m_s), angles.p_part_tcp,
    )  # fmt: skip
