"""A program with places of external axes that were chosen: its cell, and whether all of it can be run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from counterflex.app.inputs import Reading, faults_in, read_job, setting_of
from counterflex.app.placement.region import Stand
from counterflex.app.posture import robot_of, surroundings_of
from counterflex.core.arrays import Int
from counterflex.core.errors import ReachError
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import Cell, resolve
from counterflex.files.cell.set_up import AxisMove
from counterflex.path.external_axes import moving
from counterflex.plan.inputs import solve_joints
from counterflex.plan.posture.clearance import kept
from counterflex.plan.preflight.external_moves import standing_along


@dataclass(frozen=True, eq=False)
class Divided:
    """Places chosen for a program."""

    stand: Stand  # Pose of the part, and values of the axes in the first operation
    branch: str
    rotation_rad: float  # About the tool axis
    moves: dict[str, list[AxisMove]]  # Of the axes along the program, by name
    summary: dict[str, Any]  # In shop units: the operations, and the error of all of them

    def placed_cell(self, cell: Cell) -> Cell:
        """The cell with the chosen places, as its cell file will be read."""
        axes = []
        for axis in cell.tables.external_axes:
            unit, moves = "mm" if axis.kind == "linear" else "deg", self.moves.get(axis.name, [])
            axes.append(axis.model_copy(update={
                f"at_{unit}": self.stand.axes[axis.name],
                f"moves_{unit}": tuple((round(one.from_mm, 3), round(one.to_mm, 3), one.value) for one in moves),
                "moves_at_mm": tuple((one.point_mm[0], one.point_mm[1], one.point_mm[2]) for one in moves),
            }))  # fmt: skip
        shoulder, elbow, wrist = self.branch.split()
        posture = cell.tables.posture.model_copy(update={
            "shoulder": shoulder, "elbow": elbow, "wrist": wrist, "turning_mm_deg": (), "turning_at_mm": (),
            "rotation_about_tool_deg": self.rotation_rad / DEG,
        })  # fmt: skip
        part = cell.part.model_copy(update=dict(self.stand.part))
        tables = cell.tables.model_copy(update={"external_axes": tuple(axes), "posture": posture, "part": part})
        made = resolve(tables, cell.path, assume_class=cell.class_stiffness is not None)
        return replace(made, R_part_plane=cell.R_part_plane, tool_turns=cell.tool_turns)


class PlacesFault(Exception):
    """A program cannot be run with its places.

    Attributes:
        place: Number of the place, between two where the axes move; of the begin where it is not known.
    """

    def __init__(self, place: float, reason: ReachError) -> None:
        super().__init__(reason.what)
        self.place, self.reason = place, reason


def require_runs(program: str | Path, cell: Cell, divided: Divided, reading: Reading) -> None:
    """Refuse places with which the whole program cannot be run: reach, limits, singularities, bodies, moves included.

    Raises:
        Fault: It cannot; says where.
    """
    there = divided.placed_cell(cell)
    job = read_job(program, there, reading=reading, may_move=True)
    setting, path = setting_of(there, job), job.machined
    line: Int = job.line_of_motion[path.motion]
    with faults_in(job):
        try:
            q = solve_joints(path, line, setting).q
        except ReachError as fault:
            point = fault.data.get("point")
            raise PlacesFault(0.0 if point is None else float(path.place[int(point)]), fault) from fault
    around = surroundings_of(job, there)
    close, _ = kept(q, robot_of(there, setting), around, standing_along(path, setting))
    if close is not None:
        names = " and ".join(around.bodies[k].name for k in (close.first, close.second))
        moves = " while an external axis moves" if moving(path)[close.point] else ""
        reason = ReachError(
            f"bodies come too close{moves}: {names}", where=f"line {int(line[close.point])}",
            value=f"{close.distance_m / MM:.1f} mm", hint="Raise the retract between the operations",
        )  # fmt: skip
        raise PlacesFault(float(path.place[close.point]), reason)
