"""The other kinds of physics as tables of a truth file: all optional, a kind is off without its table."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from counterflex.core.errors import FileFormatError
from counterflex.core.units import DEG, MM, MRAD, MS, UM, URAD
from counterflex.twin.truth.other import (
    BristleFriction,
    ControllerKind,
    Coupling,
    GearCurve,
    HosePack,
    OtherPhysics,
    Thermal,
    ToolOff,
)
from counterflex.twin.truth.table import DIRECTIONS, Table, closed, in_unit

T = TypeVar("T")


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
    if other.frictions:
        out["frictions"] = [
            {
                "axis": f.axis + 1,
                "coulomb_nm": f.coulomb_nm,
                "stiction_share": f.stiction_share,
                "stribeck_mrad_s": f.stribeck_rad_s / MRAD,
                "bristle_urad": f.bristle_rad / URAD,
                "viscous_nm_s_rad": f.viscous_nm_s,
                "doubling_load_nm": f.load_nm,
                "cold_share": f.cold_share,
                "warming_s": f.warming_s,
            }
            for f in other.frictions
        ]
    if other.couplings:
        out["couplings"] = [
            {
                "bodies": list(c.bodies),
                "directions": [DIRECTIONS[d] for d in c.directions],
                "share": c.share,
                **({} if c.axis is None else {"axis": c.axis + 1, "strongest_deg": c.phase_rad / DEG}),
            }
            for c in other.couplings
        ]
    if other.thermal is not None:
        h = other.thermal
        out["thermal"] = {
            "before_s": h.before_s,
            "spindle_um": h.spindle_m / UM,
            "spindle_s": h.spindle_s,
            "arm_um": in_unit(h.arm_m, UM),
            "arm_s": h.arm_s,
        }
    if other.hose is not None:
        p = other.hose
        out["hose"] = {
            "body": p.arm_body,
            "arm_clamp_mm": in_unit(p.p_arm_clamp, MM),
            "tool_clamp_mm": in_unit(p.p_tool_clamp, MM),
            "mass_kg": p.mass_kg,
            "slack_mm": p.slack_m / MM,
            "pull_n_m": p.pull_n_m,
            "bending_nm": p.bending_nm,
        }
    if other.tools:
        out["tools"] = [
            {"number": t.number, "length_um": t.length_m / UM, "diameter_um": t.diameter_m / UM} for t in other.tools
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

    Raises FileFormatError: a key is missing, unknown or of the wrong kind. Raises ModelError: a value is out of range.
    """
    return OtherPhysics(
        gears=tuple(closed(row, _gear) for row in top.rows("gears")) if "gears" in top else (),
        frictions=tuple(closed(row, _friction) for row in top.rows("frictions")) if "frictions" in top else (),
        couplings=tuple(closed(row, _coupling) for row in top.rows("couplings")) if "couplings" in top else (),
        controller=_one(top, "controller", _controller),
        thermal=_one(top, "thermal", _thermal),
        hose=_one(top, "hose", _hose),
        tools=tuple(closed(row, _tool) for row in top.rows("tools")) if "tools" in top else (),
    )


def _one(top: Table, key: str, read: Callable[[Table], T]) -> T | None:
    return closed(Table(top.raw(key), f"{top.where}: {key}"), read) if key in top else None


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


def _friction(t: Table) -> BristleFriction:
    return BristleFriction(
        axis=t.axis(),
        coulomb_nm=t.number("coulomb_nm"),
        stiction_share=t.number("stiction_share"),
        stribeck_rad_s=t.number("stribeck_mrad_s", MRAD),
        bristle_rad=t.number("bristle_urad", URAD),
        viscous_nm_s=t.number("viscous_nm_s_rad"),
        load_nm=t.number("doubling_load_nm"),
        cold_share=t.number("cold_share"),
        warming_s=t.number("warming_s"),
    )


def _coupling(t: Table) -> Coupling:
    bodies, directions = t.texts("bodies", 2), t.texts("directions", 2)
    for direction in directions:
        if direction not in DIRECTIONS:
            raise FileFormatError(
                "no such direction", where=f"{t.where}: directions", value=direction, limit=" ".join(DIRECTIONS)
            )
    changing = "axis" in t
    return Coupling(
        bodies=(bodies[0], bodies[1]),
        directions=(DIRECTIONS.index(directions[0]), DIRECTIONS.index(directions[1])),
        share=t.number("share"),
        axis=t.axis() if changing else None,
        phase_rad=t.number("strongest_deg", DEG) if changing else 0.0,
    )


def _thermal(t: Table) -> Thermal:
    x, y, z = t.numbers("arm_um", 3, UM)
    return Thermal(
        before_s=t.number("before_s"),
        spindle_m=t.number("spindle_um", UM),
        spindle_s=t.number("spindle_s"),
        arm_m=(x, y, z),
        arm_s=t.number("arm_s"),
    )


def _hose(t: Table) -> HosePack:
    arm, tool = t.numbers("arm_clamp_mm", 3, MM), t.numbers("tool_clamp_mm", 3, MM)
    return HosePack(
        arm_body=t.text("body"),
        p_arm_clamp=(arm[0], arm[1], arm[2]),
        p_tool_clamp=(tool[0], tool[1], tool[2]),
        mass_kg=t.number("mass_kg"),
        slack_m=t.number("slack_mm", MM),
        pull_n_m=t.number("pull_n_m"),
        bending_nm=t.number("bending_nm"),
    )


def _tool(t: Table) -> ToolOff:
    return ToolOff(
        number=t.integer("number"), length_m=t.number("length_um", UM), diameter_m=t.number("diameter_um", UM)
    )


def _controller(t: Table) -> ControllerKind:
    return ControllerKind(
        blending_share=t.number("blending_share"),
        smoothing_s=t.number("smoothing_ms", MS),
        dead_cycles=t.integer("dead_cycles"),
    )
