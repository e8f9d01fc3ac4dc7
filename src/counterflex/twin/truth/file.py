"""Truth files: ``counterflex-truth`` version 1, TOML, a unit in every key, unknown keys refused."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import tomli_w

from counterflex.core import file_content
from counterflex.core.atomic import write_text
from counterflex.core.errors import CounterflexError, FileFormatError
from counterflex.core.units import DEG, MM, MRAD, MS, N_PER_MM, N_PER_MM2, UM, UM_PER_KN, URAD, URAD_PER_KNM
from counterflex.robot.model.description import Counterbalance, ElasticRegion
from counterflex.twin.truth import other as kinds, table as tables
from counterflex.twin.truth.family import MILD, family_of
from counterflex.twin.truth.table import DIRECTIONS, TableKey, TruthTable, closed, from_table, optional, to_table
from counterflex.twin.truth.truth import Body, CuttingTruth, Drive, SensorPlace, Truth

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


def other_from(top: TruthTable) -> kinds.OtherPhysics:
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
    return {"bodies": list(c.bodies), "directions": [DIRECTIONS[d] for d in c.directions], "share": c.share, **changing}


def _coupling(t: TruthTable) -> kinds.Coupling:
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


FORMAT: Final = "counterflex-truth"
VERSION: Final = 1
_CUTTING: Final = (
    tables.TableKey("k11_n_mm2", "k_pa", N_PER_MM2, numbers=3),
    tables.TableKey("h_ref_mm", "h_ref_m", MM),
    tables.TableKey("exponent", "exponent", numbers=3),
    tables.TableKey("edge_n_mm", "edge_n_m", N_PER_MM, numbers=3),
    tables.TableKey("edge_onset_um", "edge_onset_m", UM),
    tables.TableKey("runout_um", "runout_m", UM),
)
_BALANCE: Final = (
    tables.TableKey("axis", "joint", "joint"),
    tables.TableKey("anchor_column_mm", "anchor_column_m", MM),
    tables.TableKey("anchor_arm_mm", "anchor_arm_m", MM),
    tables.TableKey("angle_of_least_force_deg", "q_min_force_rad", DEG),
    tables.TableKey("piston_area_mm2", "piston_area_m2", MM**2),
    tables.TableKey("gas_constant_j", "gas_constant_j"),
    tables.TableKey("gas_volume_max_mm3", "gas_volume_max_m3", MM**3),
)
_DRIVE: Final = (
    tables.TableKey("rotor_inertia_kg_m2", "rotor_inertia_kg_m2"),
    tables.TableKey("servo_inertia_kg_m2", "servo_inertia_kg_m2"),
    tables.TableKey("speed_bandwidth_per_s", "speed_bandwidth_per_s"),
    tables.TableKey("position_gain_per_s", "position_gain_per_s"),
    tables.TableKey("integral_time_ms", "integral_time_s", MS),
    tables.TableKey("dead_band_half_urad", "dead_band_rad", URAD),
    tables.TableKey("motor_friction_nm", "motor_friction_nm"),
    tables.TableKey("motor_slip_urad", "motor_slip_rad", URAD),
    tables.TableKey("link_friction_nm", "link_friction_nm", numbers=3),
    tables.TableKey("link_slip_urad", "link_slip_rad", URAD, numbers=3),
    tables.TableKey("following_gain_per_s", "following_gain_per_s", optional=True),
)

_HINT: Final = "counterflex truth writes one"


def to_dict(truth: Truth) -> dict[str, Any]:
    """The truth as plain numbers, strings, lists and tables, in shop units named by the keys."""
    out: dict[str, Any] = {"format": FORMAT, "version": VERSION, "name": truth.name}
    if truth.seed is not None:
        out |= {"seed": truth.seed, "family": truth.family}
    out["stock_top_offset_mm"] = truth.stock_top_offset_m / MM
    out["gravity_base_m_s2"] = tables.in_unit(truth.gravity_base, 1.0)
    out["tcp"] = tables.pose_to(truth.T_last_tcp)
    out["cutting"] = tables.to_table(truth.cutting, _CUTTING)
    if truth.counterbalance is not None:
        out["counterbalance"] = tables.to_table(truth.counterbalance, _BALANCE)
    if truth.sensor is not None:
        out["sensor"] = {"segment": truth.sensor.segment, **tables.pose_to(truth.sensor.T_seg_sensor)}
    if truth.regions:
        out["elastic_regions"] = [
            {
                "body": r.segment,
                "direction": tables.DIRECTIONS[r.direction],
                "axis": r.axis + 1,
                "angles_deg": [a / DEG for a in r.angles_rad],
                "factors": list(r.factors),
            }
            for r in truth.regions
        ]
    out["drives"] = [tables.to_table(drive, _DRIVE) for drive in truth.drives]
    out |= other_to_dict(truth.other)
    out["bodies"] = [_body_to(body) for body in truth.bodies]
    return out


def _body_to(body: Body) -> dict[str, Any]:
    row: dict[str, Any] = {"name": body.name}
    if body.joint is not None:
        row |= {"axis": body.joint + 1, "sign": body.sign}
    return row | {
        "offset_deg": body.offset_rad / DEG,
        **tables.pose_to(body.T_prev_seg),
        "translation_um_per_kn": tables.in_unit(body.compliance[:3], UM_PER_KN),
        "rotation_urad_per_knm": tables.in_unit(body.compliance[3:], URAD_PER_KNM),
        "damping_ms": body.damping_s / MS,
        "bearing_mm": tables.in_unit(body.p_seg_bearing, MM),
        "mass_kg": body.mass_kg,
        "com_mm": tables.in_unit(body.p_seg_com, MM),
        "inertia_kg_m2": tables.in_unit(body.inertia_kg_m2, 1.0),
    }


def _family_of(table: tables.TruthTable, seed: int | None) -> str:
    """Files of before the families are of the first one."""
    if "family" not in table:
        return "" if seed is None else MILD.name
    return family_of(table.text("family")).name


def from_dict(data: Mapping[str, Any], where: str = "truth") -> Truth:
    """The inverse of :func:`to_dict`, strict about missing, unknown and impossible values.

    Raises FileFormatError: the data is not a truth of version 1, or a value is impossible.
    """
    top = tables.TruthTable(data, where)
    if top.text("format") != FORMAT:
        raise FileFormatError("not a truth file", where=where, value=repr(data["format"]), limit=FORMAT)
    version = top.integer("version")
    if version > VERSION:
        raise FileFormatError(
            "the file is newer than this counterflex reads",
            where=where,
            value=f"version {version}",
            limit=f"at most {VERSION}",
            hint="Update counterflex",
        )
    if version != VERSION:
        raise FileFormatError("no such version of the truth file", where=where, value=version, limit=VERSION)
    try:
        cutting = tables.TruthTable(top.raw("cutting"), f"{where}: cutting")
        drives = top.rows("drives")
        bodies = top.rows("bodies")
        tcp = tables.TruthTable(top.raw("tcp"), f"{where}: tcp")
        seed = top.integer("seed") if "seed" in top else None
        truth = Truth(
            name=top.text("name"),
            seed=seed,
            family=_family_of(top, seed),
            stock_top_offset_m=top.number("stock_top_offset_mm", MM),
            gravity_base=np.array(top.numbers("gravity_base_m_s2", 3)),
            T_last_tcp=tables.closed(tcp, tables.TruthTable.pose),
            cutting=tables.from_table(cutting, CuttingTruth, _CUTTING),
            counterbalance=tables.optional(top, "counterbalance", Counterbalance, _BALANCE),
            sensor=tables.closed(tables.TruthTable(top.raw("sensor"), f"{where}: sensor"), _sensor_from)
            if "sensor" in top
            else None,
            drives=tuple(tables.from_table(row, Drive, _DRIVE) for row in drives),
            regions=tuple(tables.closed(row, _region_from) for row in top.rows("elastic_regions", ())),
            other=other_from(top),
            bodies=tuple(tables.closed(row, _body_from) for row in bodies),
        )
    except FileFormatError:
        raise
    except CounterflexError as fault:
        raise FileFormatError(str(fault), where=where) from fault
    top.close()
    return truth


def _sensor_from(t: tables.TruthTable) -> SensorPlace:
    return SensorPlace(segment=t.text("segment"), T_seg_sensor=t.pose())


def _region_from(t: tables.TruthTable) -> ElasticRegion:
    direction = t.text("direction")
    if direction not in tables.DIRECTIONS:
        raise FileFormatError(
            "no such direction", where=f"{t.where}: direction", value=direction, limit=" ".join(tables.DIRECTIONS)
        )
    angles = t.raw("angles_deg")
    count = len(angles) if isinstance(angles, list) else 0
    return ElasticRegion(
        segment=t.text("body"),
        direction=tables.DIRECTIONS.index(direction),
        axis=t.axis(),
        angles_rad=tables.TruthTable({"angles_deg": angles}, t.where).numbers("angles_deg", count, DEG),
        factors=t.numbers("factors", count),
    )


def _body_from(t: tables.TruthTable) -> Body:
    driven = "axis" in t
    return Body(
        name=t.text("name"),
        joint=t.integer("axis") - 1 if driven else None,
        sign=t.number("sign") if driven else 1.0,
        offset_rad=t.number("offset_deg", DEG),
        T_prev_seg=t.pose(),
        compliance=np.array(
            [*t.numbers("translation_um_per_kn", 3, UM_PER_KN), *t.numbers("rotation_urad_per_knm", 3, URAD_PER_KNM)]
        ),
        damping_s=t.number("damping_ms", MS),
        p_seg_bearing=np.array(t.numbers("bearing_mm", 3, MM)),
        mass_kg=t.number("mass_kg"),
        p_seg_com=np.array(t.numbers("com_mm", 3, MM)),
        inertia_kg_m2=np.array(t.numbers("inertia_kg_m2", 6)),
    )


def write_truth(path: str | os.PathLike[str], truth: Truth) -> None:
    """Write a truth file, whole or not at all. Raises OutputError: the folder cannot be written."""
    write_text(path, tomli_w.dumps(to_dict(truth)))


def read_truth(path: str | os.PathLike[str]) -> Truth:
    """Read a truth file. Raises FileFormatError: the file is missing, is no TOML, or is not a truth of version 1."""
    text = file_content.text(path, _HINT)
    with file_content.readable(path, "TOML", _HINT):
        data = tomllib.loads(text)
    if not data:
        raise FileFormatError("the file is empty", where=str(path), hint=_HINT)
    return from_dict(data, str(path))
