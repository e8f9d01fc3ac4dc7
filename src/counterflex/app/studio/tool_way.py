"""The way of the tool as the studio draws it: points, lines, times, values to colour it by, poses of the robot."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.inputs import read_in_plane, setting_of
from counterflex.app.panel.cell_scene import CellScene
from counterflex.core import file_content
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import ReachError
from counterflex.core.units import DEG, MM, MM_PER_MIN
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.path.toolpath import FEED
from counterflex.plan.inputs import joint_angles
from counterflex.programs.language import LANGUAGES

POINTS: Final = 100_000
"""Most points that are drawn; of longer programs each k-th."""
FRAMES: Final = 600
"""Postures of the robot along the program."""

_SIZES: Final = (("force", "f{}_n"), ("deflection", "deflection_{}_um"), ("correction", "correction_{}_um"))
_ERRORS: Final = (("before", "nominal_deviation_{}_um"), ("after", "compensated_deviation_{}_um"))
"""Channels, and the columns of a plan that they are the sizes of."""


@dataclass(frozen=True, eq=False)
class ToolWay:
    """n points of a program on a cell."""

    p_part: Float  # (n, 3) mm
    line: Int  # (n,) line of the source
    time_s: Float  # (n,)
    cutting: Float  # (n,) 1 at feed, 0 in a rapid
    tool: Int  # (n,) number
    values: dict[str, Float]  # By channel: (n,) in its unit
    q: Float | None  # (n, 6) rad, controller angles; None where the robot does not reach
    why: str = ""  # Why there are no angles
    about: dict[str, Any] = field(default_factory=dict)
    cell: Cell | None = None  # As the program is read on it

    @classmethod
    def of_program(cls, program: Path, cell_file: Path) -> ToolWay:
        """Read a program on a cell. Raises CounterflexError: it cannot be read."""
        cell, job = read_in_plane(program, read_cell(cell_file), may_move=True)
        path, q, why = job.path, None, ""
        try:
            setting = setting_of(cell, job, chain=cell.chain, part_may_be_held=True)
            q = joint_angles(path, setting, enforce_limits=False).q
        except ReachError as fault:
            why = str(fault)
        R = np.eye(3) if cell.R_part_plane is None else cell.R_part_plane
        line = job.line_of_motion[path.motion]
        p = path.p_part_tcp @ R.T / MM
        values = {"height": p[:, 2], "feed": path.feed_m_s / MM_PER_MIN}
        about = {
            "language": LANGUAGES[job.program.dialect].short,
            "lines": len(job.program.lines),
            "length": float(np.linalg.norm(np.diff(p, axis=0), axis=1).sum()),
            "seconds": float(path.time_s[-1]),
            "tools": ", ".join(f"T{number}" for number in np.unique(path.tool)),
        }
        cutting = (path.kind == FEED).astype(np.float64)
        return cls(p, line, path.time_s, cutting, path.tool, values, q, why, about, cell)

    def with_plan(self, plan: Path, cell_file: Path) -> ToolWay:
        """The way as a plan has it: with forces, deflections, corrections and predicted errors."""
        table = file_content.parquet(plan, file_content.content(plan))
        p = table.select("x_mm", "y_mm", "z_mm").to_numpy()
        shown = table.select(f"q{k}_deg" for k in range(1, 7)).to_numpy() * DEG
        chain = read_cell(cell_file).controller_chain
        values = {"height": p[:, 2], "feed": table["feed_mm_min"].to_numpy()}
        for channel, columns in _SIZES:
            values[channel] = np.linalg.norm(table.select(columns.format(axis) for axis in "xyz").to_numpy(), axis=1)
        along = _directions(p)
        for channel, columns in _ERRORS:
            names = [columns.format(axis) for axis in "xyz"]
            if set(names) <= set(table.columns):
                off = table.select(names).to_numpy().astype(np.float64)
                across = off - np.sum(off * along, axis=1, keepdims=True) * along
                values[channel] = np.linalg.norm(across, axis=1)
        cutting = (table["kind"].to_numpy() == FEED).astype(np.float64)
        return ToolWay(
            p, table["line"].to_numpy(), table["time_s"].to_numpy(), cutting, table["tool"].to_numpy(), values,
            np.array([chain.axes.model(row) for row in shown]), about=self.about, cell=self.cell,
        )  # fmt: skip

    @property
    def drawn_rows(self) -> Int:
        """Rows of the points that are drawn."""
        step = -(-len(self.p_part) // POINTS)
        return np.unique(np.r_[np.arange(0, len(self.p_part), step), len(self.p_part) - 1])

    def drawn(self, scene: CellScene) -> dict[str, Any]:
        """Plain values for the browser."""
        rows = self.drawn_rows
        posed = np.arange(0, len(rows), max(1, -(-len(rows) // FRAMES)))
        poses = [] if self.q is None else [scene.frames(q) for q in self.q[rows[posed]]]
        return {
            "p": np.round(self.p_part[rows], 3).reshape(-1).tolist(),
            "line": self.line[rows].tolist(),
            "time": np.round(self.time_s[rows], 3).tolist(),
            "cutting": self.cutting[rows].tolist(),
            "tool": self.tool[rows].tolist(),
            "values": {name: _plain(value[rows]) for name, value in self.values.items()},
            "poses": poses,
            "posed": posed.tolist() if poses else [],
            "points": len(self.p_part),
        }


def _directions(p: Float) -> Float:
    """(n, 3) unit vectors of the feed; zeros where nothing moves."""
    step = np.gradient(p, axis=0) if len(p) > 1 else np.zeros_like(p)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    out: Float = np.divide(step, length, out=np.zeros_like(step), where=length > 0.0)
    return out


def _plain(values: Float) -> list[float | None]:
    return [round(float(v), 2) if np.isfinite(v) else None for v in values]


def pushed(cell: Cell, q_deg: list[float], force_n: float = 100.0) -> dict[str, Any]:
    """Deflection of the tool tip of a cell under a force along each axis of the base, and along the softest direction.

    Raises:
        CounterflexError: An axis is outside its limits, or a stiffness is not known.
    """
    from counterflex.app.questions import deflection

    answer = deflection(cell.chain, q_deg, [force_n, 0.0, 0.0], [0.0, 0.0, 0.0])
    C_um_per_n = np.array(answer["compliance"]["translation_um_per_kn"]) / 1000.0
    softest = np.linalg.svd(C_um_per_n)
    direction = softest.U[:, 0]
    worst = deflection(cell.chain, q_deg, (force_n * softest.Vh[0]).tolist(), [0.0, 0.0, 0.0])
    return {
        "along_um": (np.linalg.norm(C_um_per_n, axis=0) * force_n).tolist(),
        "softest_um": float(softest.S[0] * force_n),
        "direction": direction.tolist(),
        "share": worst["shares"][0] if worst["shares"] else None,
        "warnings": answer["warnings"],
        "ellipsoid": C_um_per_n.reshape(-1).tolist(),
    }
