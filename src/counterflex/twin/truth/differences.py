"""How a truth differs from the nominal one, value by value."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.errors import InputError
from counterflex.core.units import MM, MRAD, MS, N_PER_MM2, UM, URAD
from counterflex.twin.truth.other import OtherPhysics
from counterflex.twin.truth.truth import Truth


@dataclass(frozen=True)
class Difference:
    """One row of the table of differences.

    Attributes:
        group: ``stiffness``, ``geometry``, ``bearings``, ``masses``, ``drives``, ``cutting``, ``stock`` or
            ``other kinds``.
        known: Value in the nominal truth, in ``unit``.
        true: Value in the truth.
    """

    group: str
    name: str
    known: float
    true: float
    unit: str


def differences(known: Truth, true: Truth) -> tuple[Difference, ...]:
    """How a truth differs from the nominal one, for reports.

    Returns:
        Rows in shop units; positions as the distance between known and true.

    Raises:
        InputError: The two do not have the same bodies.
    """
    if [b.name for b in known.bodies] != [b.name for b in true.bodies]:
        raise InputError("the truths are not of the same cell", value=[b.name for b in true.bodies])
    rows: list[Difference] = []
    for a, b in zip(known.bodies, true.bodies, strict=True):
        if a.compliance.any():
            ratio = float(np.max(a.compliance) / np.max(b.compliance))
            rows.append(Difference("stiffness", a.name, 100.0, 100.0 * ratio, "%"))
            gap = float(np.linalg.norm(b.p_seg_bearing - a.p_seg_bearing)) / MM
            rows.append(Difference("bearings", a.name, 0.0, gap, "mm off"))
        moved = float(np.linalg.norm(b.T_prev_seg[:3, 3] - a.T_prev_seg[:3, 3])) / MM
        rows.append(Difference("geometry", a.name, 0.0, moved, "mm off"))
        if a.joint is not None:
            rows.append(Difference("geometry", f"{a.name} zero", 0.0, (b.offset_rad - a.offset_rad) / MRAD, "mrad"))
        if a.mass_kg > 0.0:
            rows.append(Difference("masses", a.name, a.mass_kg, b.mass_kg, "kg"))
    for axis, (d, e) in enumerate(zip(known.drives, true.drives, strict=True), start=1):
        rows.append(
            Difference("drives", f"axis {axis} dry friction", sum(d.link_friction_nm), sum(e.link_friction_nm), "N m")
        )
        rows.append(
            Difference(
                "drives", f"axis {axis} play", 2.0 * d.dead_band_rad / URAD, 2.0 * e.dead_band_rad / URAD, "urad"
            )
        )
        rows.append(
            Difference("drives", f"axis {axis} speed loop", d.speed_bandwidth_per_s, e.speed_bandwidth_per_s, "1/s")
        )
        for what, gain in (("position_gain_per_s", "position loop"), ("integral_time_s", "integral time")):
            unit = "1/s" if what == "position_gain_per_s" else "ms"
            scale = 1.0 if unit == "1/s" else MS
            rows.append(
                Difference("drives", f"axis {axis} {gain}", getattr(d, what) / scale, getattr(e, what) / scale, unit)
            )
        if d.following_gain_per_s is not None and e.following_gain_per_s is not None:
            rows.append(
                Difference("drives", f"axis {axis} following", d.following_gain_per_s, e.following_gain_per_s, "1/s")
            )
        rows.append(
            Difference(
                "drives", f"axis {axis} slip angle", sum(d.link_slip_rad) / URAD, sum(e.link_slip_rad) / URAD, "urad"
            )
        )
    for i, name in enumerate(("cutting", "radial", "axial")):
        x, y = known.cutting, true.cutting
        rows.append(Difference("cutting", f"{name} k1.1", x.k_pa[i] / N_PER_MM2, y.k_pa[i] / N_PER_MM2, "N/mm2"))
        rows.append(Difference("cutting", f"{name} exponent", x.exponent[i], y.exponent[i], "-"))
        rows.append(Difference("cutting", f"{name} ploughing", x.edge_n_m[i] * MM, y.edge_n_m[i] * MM, "N/mm"))
    rows.append(Difference("cutting", "runout", known.cutting.runout_m / UM, true.cutting.runout_m / UM, "um"))
    rows.append(
        Difference("stock", "top of the blank", known.stock_top_offset_m / MM, true.stock_top_offset_m / MM, "mm")
    )
    return (*rows, *_other(true.other))


def _other(other: OtherPhysics) -> list[Difference]:
    """The kinds that no planner here has a model of; none of them is known."""
    rows: list[Difference] = []

    def row(name: str, known: float, true: float, unit: str) -> None:
        rows.append(Difference("other kinds", name, known, true, unit))

    for gear in other.gears:
        row(f"axis {gear.axis + 1} stiffness without load", 100.0, 100.0 * gear.share[0], "%")
        row(f"axis {gear.axis + 1} hysteresis of the gear", 0.0, gear.hysteresis_nm, "N m")
    for friction in other.frictions:
        row(f"axis {friction.axis + 1} friction at standstill", 100.0, 100.0 * friction.stiction_share, "%")
        row(f"axis {friction.axis + 1} friction when cold", 100.0, 100.0 * (1.0 + friction.cold_share), "%")
    if other.couplings:
        row("springs between coordinates", 0.0, float(len(other.couplings)), "springs")
    if other.controller is not None:
        row("smoothing of the references", 0.0, other.controller.smoothing_s / MS, "ms")
        row("rounding of corners", 100.0, 100.0 * other.controller.blending_share, "%")
    if other.thermal is not None:
        row("growth of the spindle", 0.0, other.thermal.spindle_m / UM, "um in the end")
        row("drift of the arm", 0.0, float(np.linalg.norm(other.thermal.arm_m)) / UM, "um in the end")
    if other.hose is not None:
        row("hose pack", 0.0, other.hose.pull_n_m, "N/m")
    for tool in other.tools:
        row(f"tool {tool.number} diameter", 0.0, tool.diameter_m / UM, "um")
    return rows
