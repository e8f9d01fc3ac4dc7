"""Plans that are wrong as plans are wrong: what has changed on the simulated cell since the plan was made.

The plan, and the cell file that the loop works with, stay as they are; the truth changes. Only a tool of another length
is known to the controller and to the loop, because a shop measures the length of every tool.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.cutting import material
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose, rotation
from counterflex.twin.truth.truth import CuttingTruth, Truth

WORN: Final = 1.3
"""Force of a worn tool, in forces of a sharp one."""
ALLOY: Final = "en-aw-6082-carbide-189"
"""Row of the table of materials that is cut instead of the planned EN AW-2017."""
HIGHER_M: Final = 0.5 * MM
STIFFNESS: Final = 0.8
"""Stiffness of every elastic element, in identified ones."""
DRIFT_BASE_M: Final = np.array([0.0, 0.1, 0.1]) * MM / np.sqrt(2.0)
"""(3,) how the whole arm has moved since the part was touched: 0.1 mm across the feed, half of it in depth."""
LONGER_M: Final = 40.0 * MM
"""How much farther the tool reaches out of the spindle."""


@dataclass(frozen=True)
class Wrong:
    """One way in which a plan is wrong."""

    title: str  # for people
    # the truth as it is now, from the cell of the catalogue and the truth that the plan was made for
    truth: Callable[[Cell, Truth], Truth] = lambda _cell, truth: truth
    since_touched: bool = False  # it changed after the part was touched; else the part was touched as the cell is now
    longer_m: float = 0.0  # how much longer the tool is, as controller and loop know
    seen_by_force: bool = True  # a force sensor shows it. A wrong stiffness and a drift are seen by a tracker only


def _forces(truth: Truth, factor: float) -> Truth:
    c = truth.cutting
    k, edge = np.array(c.k_pa) * factor, np.array(c.edge_n_m) * factor
    return replace(truth, cutting=replace(c, k_pa=tuple(k.tolist()), edge_n_m=tuple(edge.tolist())))


def _alloy(cell: Cell, truth: Truth) -> Truth:
    """Published constants of the other alloy, each as far off as this truth's are from those of the catalogue."""
    planned, other = cell.force_law, material.load(ALLOY).law()
    if not isinstance(planned, KienzleLaw) or not isinstance(other, KienzleLaw):
        raise TypeError("both materials follow Kienzle's law")
    off = np.array(truth.cutting.k_pa) / np.array(planned.k11_pa())
    k = tuple((np.array(other.k11_pa()) * off).tolist())
    cutting: CuttingTruth = replace(truth.cutting, k_pa=k, exponent=(other.mc, other.mr, other.ma))
    return replace(truth, cutting=cutting)


def _softer(_: Cell, truth: Truth) -> Truth:
    return replace(truth, bodies=tuple(replace(b, compliance=b.compliance / STIFFNESS) for b in truth.bodies))


def _drifted(_: Cell, truth: Truth) -> Truth:
    first, *others = truth.bodies
    T = pose.make(p=DRIFT_BASE_M) @ first.T_prev_seg
    return replace(truth, bodies=(replace(first, T_prev_seg=T), *others))


def _longer(_: Cell, truth: Truth) -> Truth:
    return replace(truth, T_last_tcp=longer(truth.T_last_tcp))


def longer(T_last_tcp: Float) -> Float:
    """Pose (4, 4) of the tip of the longer tool in the last body, from that of the planned one."""
    out: Float = T_last_tcp @ pose.make(p=np.array([0.0, 0.0, LONGER_M]))
    return out


def cell_table(base: dict[str, Any], wrong: Wrong) -> dict[str, Any]:
    """Tables of the cell file that controller and loop work with: those of the plan, with the tool as it is measured.

    Args:
        base: Of the cell file that the plan was made from.
        wrong: What is wrong.
    """
    if wrong.longer_m == 0.0:
        return base
    tcp = base["tcp"]
    angles = np.deg2rad([float(tcp.get(f"{k}_deg", 0.0)) for k in "abc"])
    along = rotation.from_zyx(angles)[:, 2] * wrong.longer_m / MM
    moved = {f"{k}_mm": float(tcp.get(f"{k}_mm", 0.0)) + float(along[i]) for i, k in enumerate("xyz")}
    return {**base, "tcp": {**tcp, **moved}}


WRONG: Final[dict[str, Wrong]] = {
    "as planned": Wrong("as planned"),
    "worn tool": Wrong("worn tool: force x1.3", lambda _, truth: _forces(truth, WORN)),
    "other alloy": Wrong("EN AW-6082 instead of EN AW-2017", _alloy),
    "higher stock": Wrong(
        "blank 0.5 mm higher", lambda _, t: replace(t, stock_top_offset_m=t.stock_top_offset_m + HIGHER_M)
    ),
    "soft robot": Wrong("stiffness 20 % below the identified one", _softer, seen_by_force=False),
    "drift": Wrong("arm drifted by 0.1 mm since the part was touched", _drifted, True, seen_by_force=False),
    "longer tool": Wrong("tool 40 mm longer than planned", _longer, longer_m=LONGER_M),
}
"""Rows of the table, the first of a right plan: what the others lose is counted from there."""
