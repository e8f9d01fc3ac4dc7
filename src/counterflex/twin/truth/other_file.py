"""The other kinds of physics as tables of a truth file: all optional, a kind is off without its table."""

from __future__ import annotations

from typing import Any, Final

from counterflex.core.errors import FileFormatError
from counterflex.core.units import DEG, MM, MRAD, MS, UM, URAD
from counterflex.twin.truth import other as kinds
from counterflex.twin.truth.table import DIRECTIONS, Table, TableKey, closed, from_table, optional, to_table

_GEAR: Final = (
    TableKey("axis", "axis", "axis"),
    TableKey("torque_nm", "torque_nm", numbers=2),
    TableKey("stiffness_share", "share", numbers=3),
    TableKey("hysteresis_nm", "hysteresis_nm"),
    TableKey("hysteresis_share", "hysteresis_share"),
    TableKey("hysteresis_slip_urad", "hysteresis_rad", URAD),
)
_FRICTION: Final = (
    TableKey("axis", "axis", "axis"),
    TableKey("coulomb_nm", "coulomb_nm"),
    TableKey("stiction_share", "stiction_share"),
    TableKey("stribeck_mrad_s", "stribeck_rad_s", MRAD),
    TableKey("bristle_urad", "bristle_rad", URAD),
    TableKey("viscous_nm_s_rad", "viscous_nm_s"),
    TableKey("doubling_load_nm", "load_nm"),
    TableKey("cold_share", "cold_share"),
    TableKey("warming_s", "warming_s"),
)
_THERMAL: Final = (
    TableKey("before_s", "before_s"),
    TableKey("spindle_um", "spindle_m", UM),
    TableKey("spindle_s", "spindle_s"),
    TableKey("arm_um", "arm_m", UM, numbers=3),
    TableKey("arm_s", "arm_s"),
)
_HOSE: Final = (
    TableKey("body", "arm_body", "text"),
    TableKey("arm_clamp_mm", "p_arm_clamp", MM, numbers=3),
    TableKey("tool_clamp_mm", "p_tool_clamp", MM, numbers=3),
    TableKey("mass_kg", "mass_kg"),
    TableKey("slack_mm", "slack_m", MM),
    TableKey("pull_n_m", "pull_n_m"),
    TableKey("bending_nm", "bending_nm"),
)
_TOOL: Final = (
    TableKey("number", "number", "whole"),
    TableKey("length_um", "length_m", UM),
    TableKey("diameter_um", "diameter_m", UM),
)
_CONTROLLER: Final = (
    TableKey("blending_share", "blending_share"),
    TableKey("smoothing_ms", "smoothing_s", MS),
    TableKey("dead_cycles", "dead_cycles", "whole"),
)


def other_to_dict(other: kinds.OtherPhysics) -> dict[str, Any]:
    """Tables of the kinds that are there; empty where there is none."""
    one = {"thermal": (other.thermal, _THERMAL), "hose": (other.hose, _HOSE)}
    tables: dict[str, Any] = {
        "gears": [to_table(gear, _GEAR) for gear in other.gears],
        "frictions": [to_table(friction, _FRICTION) for friction in other.frictions],
        "couplings": [_coupling_to(coupling) for coupling in other.couplings],
        **{name: to_table(kind, keys) if kind is not None else None for name, (kind, keys) in one.items()},
        "tools": [to_table(tool, _TOOL) for tool in other.tools],
        "controller": to_table(other.controller, _CONTROLLER) if other.controller is not None else None,
    }
    return {name: table for name, table in tables.items() if table}


def other_from(top: Table) -> kinds.OtherPhysics:
    """Take the tables of :func:`other_to_dict` out of a truth file's.

    Raises FileFormatError: a key is missing, unknown or of the wrong kind. Raises ModelError: a value is out of range.
    """
    return kinds.OtherPhysics(
        gears=tuple(from_table(row, kinds.GearCurve, _GEAR) for row in top.rows("gears", ())),
        frictions=tuple(from_table(row, kinds.BristleFriction, _FRICTION) for row in top.rows("frictions", ())),
        couplings=tuple(closed(row, _coupling) for row in top.rows("couplings", ())),
        controller=optional(top, "controller", kinds.ControllerKind, _CONTROLLER),
        thermal=optional(top, "thermal", kinds.Thermal, _THERMAL),
        hose=optional(top, "hose", kinds.HosePack, _HOSE),
        tools=tuple(from_table(row, kinds.ToolOff, _TOOL) for row in top.rows("tools", ())),
    )


def _coupling_to(c: kinds.Coupling) -> dict[str, Any]:
    changing = {} if c.axis is None else {"axis": c.axis + 1, "strongest_deg": c.phase_rad / DEG}
    return {
        "bodies": list(c.bodies),
        "directions": [DIRECTIONS[d] for d in c.directions],
        "share": c.share,
        **changing,
    }


def _coupling(t: Table) -> kinds.Coupling:
    bodies, directions = t.texts("bodies", 2), t.texts("directions", 2)
    for direction in directions:
        if direction not in DIRECTIONS:
            raise FileFormatError(
                "no such direction", where=f"{t.where}: directions", value=direction, limit=" ".join(DIRECTIONS)
            )
    changing = "axis" in t
    return kinds.Coupling(
        bodies=(bodies[0], bodies[1]),
        directions=(DIRECTIONS.index(directions[0]), DIRECTIONS.index(directions[1])),
        share=t.number("share"),
        axis=t.axis() if changing else None,
        phase_rad=t.number("strongest_deg", DEG) if changing else 0.0,
    )
