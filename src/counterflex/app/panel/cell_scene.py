"""The cell as a panel draws it: coarse bodies of robot, spindle, tools, blank and table, and where the frames stand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError
from counterflex.core.printable import all_printable
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.plan.preflight.bodies import CollisionBody, carried, links, part_bodies, with_given
from counterflex.robot.elasticity.chain import ElasticChain, frames


class CellScene:
    """A cell to be drawn.

    Raises:
        FileFormatError: It is no cell file.
    """

    def __init__(self, path: Path) -> None:
        cell = read_cell(path)
        self._chain: ElasticChain = cell.controller_chain
        self._T_base_part: Float = np.eye(4) if cell.holds_part else cell.T_base_part
        # Plain values: name, frame, shape, pose in that frame, size in m, number of the tool or None
        self.bodies = [all_printable(_plain(body)) for body in _bodies(cell)]

    def frames(self, q: Float) -> dict[str, list[float]]:
        """Poses of the frames that bodies are fixed to, in the robot's base: rotation by rows, position in m.

        Args:
            q: (6,) rad controller angles.
        """
        chain = self._chain
        Ts = frames(chain, q)
        out = {"base": _flat(np.eye(4)), "part": _flat(self._T_base_part)}
        for segment in np.flatnonzero(chain.joint >= 0):
            out[f"joint{int(chain.joint[segment]) + 1}"] = _flat(Ts[segment])
        T_base_flange = Ts[chain.flange_segment] @ chain.T_segment_flange
        return out | {"flange": _flat(T_base_flange), "tcp": _flat(T_base_flange @ chain.T_flange_tcp)}


def _bodies(cell: Cell) -> list[CollisionBody]:
    chain = cell.controller_chain
    given, removed = cell.tables.cell.bodies(cell.path.parent)
    assumed = list(links(chain))
    cutters, overhang = {}, {}
    for tool in cell.tables.tools:
        try:
            cutters[tool.number] = cell.cutter(tool.number)
        except CounterflexError:
            continue
        if tool.overhang_m is not None:
            overhang[tool.number] = tool.overhang_m
    if not cell.holds_part:
        assumed += carried(chain, cutters, overhang)
        try:
            assumed += part_bodies(cell.stock())
        except CounterflexError:  # a cell without a blank
            return with_given(assumed, given, removed)
    return with_given(assumed, given, removed)


def _plain(body: CollisionBody) -> dict[str, Any]:
    return {
        "name": body.name,
        "frame": body.frame,
        "shape": body.shape,
        "pose": _flat(body.T_frame_body),
        "size": [round(float(v), 5) for v in body.size_m],
        "tool": body.tool,
    }


def _flat(T: Float) -> list[float]:
    return [round(float(v), 5) for v in (*T[:3, :3].reshape(-1), *T[:3, 3])]
