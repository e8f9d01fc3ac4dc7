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
from counterflex.core.units import DEG, MM, MS, N_PER_MM, N_PER_MM2, UM, UM_PER_KN, URAD, URAD_PER_KNM
from counterflex.robot.model.description import Counterbalance, ElasticRegion
from counterflex.twin.truth.family import MILD, family_of
from counterflex.twin.truth.other_file import other_from, other_to_dict
from counterflex.twin.truth.table import DIRECTIONS, Table, closed, in_unit, pose_to
from counterflex.twin.truth.truth import Body, CuttingTruth, Drive, SensorPlace, Truth

FORMAT: Final = "counterflex-truth"
VERSION: Final = 1

_HINT: Final = "counterflex truth writes one"


def to_dict(truth: Truth) -> dict[str, Any]:
    """The truth as plain numbers, strings, lists and tables, in shop units named by the keys."""
    out: dict[str, Any] = {"format": FORMAT, "version": VERSION, "name": truth.name}
    if truth.seed is not None:
        out |= {"seed": truth.seed, "family": truth.family}
    out["stock_top_offset_mm"] = truth.stock_top_offset_m / MM
    out["gravity_base_m_s2"] = in_unit(truth.gravity_base, 1.0)
    out["tcp"] = pose_to(truth.T_last_tcp)
    c = truth.cutting
    out["cutting"] = {
        "k11_n_mm2": in_unit(c.k_pa, N_PER_MM2),
        "h_ref_mm": c.h_ref_m / MM,
        "exponent": list(c.exponent),
        "edge_n_mm": in_unit(c.edge_n_m, N_PER_MM),
        "edge_onset_um": c.edge_onset_m / UM,
        "runout_um": c.runout_m / UM,
    }
    if truth.counterbalance is not None:
        b = truth.counterbalance
        out["counterbalance"] = {
            "axis": b.joint + 1,
            "anchor_column_mm": b.anchor_column_m / MM,
            "anchor_arm_mm": b.anchor_arm_m / MM,
            "angle_of_least_force_deg": b.q_min_force_rad / DEG,
            "piston_area_mm2": b.piston_area_m2 / MM**2,
            "gas_constant_j": b.gas_constant_j,
            "gas_volume_max_mm3": b.gas_volume_max_m3 / MM**3,
        }
    if truth.sensor is not None:
        out["sensor"] = {"segment": truth.sensor.segment, **pose_to(truth.sensor.T_seg_sensor)}
    if truth.regions:
        out["elastic_regions"] = [
            {
                "body": r.segment,
                "direction": DIRECTIONS[r.direction],
                "axis": r.axis + 1,
                "angles_deg": [a / DEG for a in r.angles_rad],
                "factors": list(r.factors),
            }
            for r in truth.regions
        ]
    out["drives"] = [
        {
            "rotor_inertia_kg_m2": d.rotor_inertia_kg_m2,
            "servo_inertia_kg_m2": d.servo_inertia_kg_m2,
            "speed_bandwidth_per_s": d.speed_bandwidth_per_s,
            "position_gain_per_s": d.position_gain_per_s,
            "integral_time_ms": d.integral_time_s / MS,
            "dead_band_half_urad": d.dead_band_rad / URAD,
            "motor_friction_nm": d.motor_friction_nm,
            "motor_slip_urad": d.motor_slip_rad / URAD,
            "link_friction_nm": list(d.link_friction_nm),
            "link_slip_urad": in_unit(d.link_slip_rad, URAD),
            **({} if d.following_gain_per_s is None else {"following_gain_per_s": d.following_gain_per_s}),
        }
        for d in truth.drives
    ]
    out |= other_to_dict(truth.other)
    out["bodies"] = [_body_to(body) for body in truth.bodies]
    return out


def _body_to(body: Body) -> dict[str, Any]:
    row: dict[str, Any] = {"name": body.name}
    if body.joint is not None:
        row |= {"axis": body.joint + 1, "sign": body.sign}
    return row | {
        "offset_deg": body.offset_rad / DEG,
        **pose_to(body.T_prev_seg),
        "translation_um_per_kn": in_unit(body.compliance[:3], UM_PER_KN),
        "rotation_urad_per_knm": in_unit(body.compliance[3:], URAD_PER_KNM),
        "damping_ms": body.damping_s / MS,
        "bearing_mm": in_unit(body.p_seg_bearing, MM),
        "mass_kg": body.mass_kg,
        "com_mm": in_unit(body.p_seg_com, MM),
        "inertia_kg_m2": in_unit(body.inertia_kg_m2, 1.0),
    }


def _family_of(table: Table, seed: int | None) -> str:
    """Files of before the families are of the first one."""
    if "family" not in table:
        return "" if seed is None else MILD.name
    return family_of(table.text("family")).name


def from_dict(data: Mapping[str, Any], where: str = "truth") -> Truth:
    """The inverse of :func:`to_dict`, strict about missing, unknown and impossible values.

    Raises:
        FileFormatError: The data is not a truth of version 1, or a value is impossible.
    """
    top = Table(data, where)
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
        cutting = Table(top.raw("cutting"), f"{where}: cutting")
        drives = top.rows("drives")
        bodies = top.rows("bodies")
        tcp = Table(top.raw("tcp"), f"{where}: tcp")
        seed = top.integer("seed") if "seed" in top else None
        truth = Truth(
            name=top.text("name"),
            seed=seed,
            family=_family_of(top, seed),
            stock_top_offset_m=top.number("stock_top_offset_mm", MM),
            gravity_base=np.array(top.numbers("gravity_base_m_s2", 3)),
            T_last_tcp=closed(tcp, Table.pose),
            cutting=closed(cutting, _cutting_from),
            counterbalance=closed(Table(top.raw("counterbalance"), f"{where}: counterbalance"), _balance_from)
            if "counterbalance" in top
            else None,
            sensor=closed(Table(top.raw("sensor"), f"{where}: sensor"), _sensor_from) if "sensor" in top else None,
            drives=tuple(closed(row, _drive_from) for row in drives),
            regions=tuple(closed(row, _region_from) for row in top.rows("elastic_regions"))
            if "elastic_regions" in top
            else (),
            other=other_from(top),
            bodies=tuple(closed(row, _body_from) for row in bodies),
        )
    except FileFormatError:
        raise
    except CounterflexError as fault:
        raise FileFormatError(str(fault), where=where) from fault
    top.close()
    return truth


def _three(values: tuple[float, ...]) -> tuple[float, float, float]:
    return values[0], values[1], values[2]


def _cutting_from(t: Table) -> CuttingTruth:
    return CuttingTruth(
        k_pa=_three(t.numbers("k11_n_mm2", 3, N_PER_MM2)),
        exponent=_three(t.numbers("exponent", 3)),
        edge_n_m=_three(t.numbers("edge_n_mm", 3, N_PER_MM)),
        edge_onset_m=t.number("edge_onset_um", UM),
        runout_m=t.number("runout_um", UM),
        h_ref_m=t.number("h_ref_mm", MM),
    )


def _balance_from(t: Table) -> Counterbalance:
    return Counterbalance(
        joint=t.integer("axis") - 1,
        anchor_column_m=t.number("anchor_column_mm", MM),
        anchor_arm_m=t.number("anchor_arm_mm", MM),
        q_min_force_rad=t.number("angle_of_least_force_deg", DEG),
        piston_area_m2=t.number("piston_area_mm2", MM**2),
        gas_constant_j=t.number("gas_constant_j"),
        gas_volume_max_m3=t.number("gas_volume_max_mm3", MM**3),
    )


def _sensor_from(t: Table) -> SensorPlace:
    return SensorPlace(segment=t.text("segment"), T_seg_sensor=t.pose())


def _region_from(t: Table) -> ElasticRegion:
    direction = t.text("direction")
    if direction not in DIRECTIONS:
        raise FileFormatError(
            "no such direction", where=f"{t.where}: direction", value=direction, limit=" ".join(DIRECTIONS)
        )
    angles = t.raw("angles_deg")
    count = len(angles) if isinstance(angles, list) else 0
    return ElasticRegion(
        segment=t.text("body"),
        direction=DIRECTIONS.index(direction),
        axis=t.axis(),
        angles_rad=Table({"angles_deg": angles}, t.where).numbers("angles_deg", count, DEG),
        factors=t.numbers("factors", count),
    )


def _drive_from(t: Table) -> Drive:
    return Drive(
        rotor_inertia_kg_m2=t.number("rotor_inertia_kg_m2"),
        servo_inertia_kg_m2=t.number("servo_inertia_kg_m2"),
        speed_bandwidth_per_s=t.number("speed_bandwidth_per_s"),
        position_gain_per_s=t.number("position_gain_per_s"),
        integral_time_s=t.number("integral_time_ms", MS),
        dead_band_rad=t.number("dead_band_half_urad", URAD),
        motor_friction_nm=t.number("motor_friction_nm"),
        motor_slip_rad=t.number("motor_slip_urad", URAD),
        link_friction_nm=t.numbers("link_friction_nm", 3),
        link_slip_rad=t.numbers("link_slip_urad", 3, URAD),
        following_gain_per_s=t.number("following_gain_per_s") if "following_gain_per_s" in t else None,
    )


def _body_from(t: Table) -> Body:
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
    """Write a truth file, whole or not at all.

    Raises:
        OutputError: The folder cannot be written.
    """
    write_text(path, tomli_w.dumps(to_dict(truth)))


def read_truth(path: str | os.PathLike[str]) -> Truth:
    """Read a truth file.

    Raises:
        FileFormatError: The file is missing, is no TOML, or is not a truth of version 1.
    """
    text = file_content.text(path, _HINT)
    with file_content.readable(path, "TOML", _HINT):
        data = tomllib.loads(text)
    if not data:
        raise FileFormatError("the file is empty", where=str(path), hint=_HINT)
    return from_dict(data, str(path))
