"""The other kinds of physics as tables of a truth file: all optional, a kind is off without its table."""

from __future__ import annotations

from typing import Any

from counterflex.core.units import MS, URAD
from counterflex.twin.truth.other import ControllerKind, GearCurve, OtherPhysics
from counterflex.twin.truth.table import Table, closed


def other_to_dict(other: OtherPhysics) -> dict[str, Any]:
    """Tables of the kinds that are there; empty where there is none."""
    out: dict[str, Any] = {}
    if other.gears:
        out["gears"] = [
            {
                "axis": g.axis + 1,
                "torque_nm": list(g.torque_nm),
                "stiffness_share": list(g.share),
                "hysteresis_nm": g.hysteresis_nm,
                "hysteresis_share": g.hysteresis_share,
                "hysteresis_slip_urad": g.hysteresis_rad / URAD,
            }
            for g in other.gears
        ]
    if other.controller is not None:
        c = other.controller
        out["controller"] = {
            "blending_share": c.blending_share,
            "smoothing_ms": c.smoothing_s / MS,
            "dead_cycles": c.dead_cycles,
        }
    return out


def other_from(top: Table) -> OtherPhysics:
    """Take the tables of :func:`other_to_dict` out of a truth file's.

    Raises:
        FileFormatError: A key is missing, unknown or of the wrong kind.
        ModelError: A value is out of range.
    """
    return OtherPhysics(
        gears=tuple(closed(row, _gear) for row in top.rows("gears")) if "gears" in top else (),
        controller=closed(Table(top.raw("controller"), f"{top.where}: controller"), _controller)
        if "controller" in top
        else None,
    )


def _gear(t: Table) -> GearCurve:
    torque, share = t.numbers("torque_nm", 2), t.numbers("stiffness_share", 3)
    return GearCurve(
        axis=t.axis(),
        torque_nm=(torque[0], torque[1]),
        share=(share[0], share[1], share[2]),
        hysteresis_nm=t.number("hysteresis_nm"),
        hysteresis_share=t.number("hysteresis_share"),
        hysteresis_rad=t.number("hysteresis_slip_urad", URAD),
    )


def _controller(t: Table) -> ControllerKind:
    return ControllerKind(
        blending_share=t.number("blending_share"),
        smoothing_s=t.number("smoothing_ms", MS),
        dead_cycles=t.integer("dead_cycles"),
    )
