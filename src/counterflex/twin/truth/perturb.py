"""How the true cell differs from what a planner knows: seeded amounts, the same on every machine.

How the numbers are drawn: :mod:`counterflex.twin.truth.draws`; what other kinds of physics a family may have:
:mod:`counterflex.twin.truth.draw_other`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from counterflex.core.errors import InputError
from counterflex.robot.model.description import ElasticRegion
from counterflex.twin.truth.draw_other import other_cell, other_cutting
from counterflex.twin.truth.draws import draw, factor, vector
from counterflex.twin.truth.family import MILD, Family
from counterflex.twin.truth.truth import Body, CuttingTruth, Drive, Truth

EDGE_N_M = (2000.0, 2000.0, 0.0)  # ploughing force that the planner's law has no term for
EDGE_SIGMA = 0.30
LINK_M = 0.15e-3  # per axis of each fixed pose
JOINT_OFFSET_RAD = 0.05e-3
BEARING_M = 10.0e-3  # per axis of the point each elastic element turns about
DAMPING_SIGMA = 0.15
RUNOUT_M = 5.0e-6
RUNOUT_SIGMA = 0.30
STOCK_TOP_M = 0.05e-3


def perturbed(truth: Truth, seed: int, family: Family = MILD) -> Truth:
    """The truth a user gets: everything off by documented, seeded amounts (one sigma, cut at three).

    The family says how far compliances, force constants, drives, friction, play and masses are off. All families have a
    ploughing force of 2 N/mm, 5 um runout, geometry off by 0.15 mm per link and axis, joint offsets by 0.05 mrad,
    bearing positions by 10 mm, damping by 15 %, the height of the blank by 0.05 mm.

    ``seed``: 0, 1, 2, ...

    Returns:
        The same truth for the same seed and family on every machine.

    Raises:
        InputError: The seed is negative.
    """
    if seed < 0:
        raise InputError("seed of the truth", value=seed, limit=">= 0")
    moved_tip = np.array(truth.T_last_tcp)
    moved_tip[:3, 3] += vector(seed, "tcp", LINK_M)
    off = replace(
        truth,
        name=f"seed {seed}" if family is MILD else f"{family.name}, seed {seed}",
        seed=seed,
        family=family.name,
        bodies=tuple(_body(body, seed, family) for body in truth.bodies),
        T_last_tcp=moved_tip,
        drives=tuple(_drive(drive, seed, axis, family) for axis, drive in enumerate(truth.drives)),
        cutting=other_cutting(_cutting(truth.cutting, seed, family), seed, family),
        stock_top_offset_m=truth.stock_top_offset_m + STOCK_TOP_M * draw(seed, "stock.top"),
        regions=tuple(_region(region, seed, family) for region in truth.regions),
    )
    return other_cell(off, seed, family)


def _region(region: ElasticRegion, seed: int, family: Family) -> ElasticRegion:
    """By how much the factors differ from 1 is off, in proportion."""
    off = factor(seed, f"{region.segment}.{region.direction}.region{region.axis + 1}", family.region_sigma)
    return replace(region, factors=tuple(max(1.0 + off * (f - 1.0), 0.5 * f) for f in region.factors))


def _body(body: Body, seed: int, family: Family) -> Body:
    T = np.array(body.T_prev_seg)
    T[:3, 3] += vector(seed, f"{body.name}.link", LINK_M)
    softer = factor(seed, f"{body.name}.compliance", family.compliance_sigma)
    softer *= factor(seed, "compliance.common", family.compliance_common_sigma)
    mass = factor(seed, f"{body.name}.mass", family.mass_sigma)
    return replace(
        body,
        T_prev_seg=T,
        offset_rad=body.offset_rad
        + (JOINT_OFFSET_RAD * draw(seed, f"{body.name}.offset") if body.joint is not None else 0.0),
        compliance=body.compliance * softer,
        damping_s=body.damping_s * factor(seed, f"{body.name}.damping", DAMPING_SIGMA),
        p_seg_bearing=body.p_seg_bearing + vector(seed, f"{body.name}.bearing", BEARING_M),
        mass_kg=body.mass_kg * mass,
        inertia_kg_m2=body.inertia_kg_m2 * mass,
    )


def _drive(drive: Drive, seed: int, axis: int, family: Family) -> Drive:
    dry = factor(seed, f"axis{axis + 1}.friction", family.friction_sigma)
    slip = factor(seed, f"axis{axis + 1}.slip", family.slip_sigma)
    trailing = drive.following_gain_per_s
    if trailing is not None:
        trailing *= factor(seed, f"axis{axis + 1}.following", family.loop_sigma)
    return replace(
        drive,
        speed_bandwidth_per_s=drive.speed_bandwidth_per_s * factor(seed, f"axis{axis + 1}.servo", family.servo_sigma),
        position_gain_per_s=drive.position_gain_per_s * factor(seed, f"axis{axis + 1}.kv", family.loop_sigma),
        integral_time_s=drive.integral_time_s * factor(seed, f"axis{axis + 1}.ti", family.loop_sigma),
        motor_slip_rad=drive.motor_slip_rad * slip,
        link_slip_rad=tuple(angle * slip for angle in drive.link_slip_rad),
        dead_band_rad=drive.dead_band_rad * factor(seed, f"axis{axis + 1}.play", family.play_sigma),
        motor_friction_nm=drive.motor_friction_nm * dry,
        link_friction_nm=tuple(f * dry for f in drive.link_friction_nm),
        following_gain_per_s=trailing,
    )


def _cutting(cutting: CuttingTruth, seed: int, family: Family) -> CuttingTruth:
    common = factor(seed, "cutting.common", family.force_common_sigma)
    edge = factor(seed, "cutting.edge", EDGE_SIGMA)
    c, r, a = (
        k * common * factor(seed, f"cutting.{name}", family.force_each_sigma)
        for name, k in zip("cra", cutting.k_pa, strict=True)
    )
    return replace(
        cutting,
        k_pa=(c, r, a),
        edge_n_m=(
            cutting.edge_n_m[0] + EDGE_N_M[0] * edge,
            cutting.edge_n_m[1] + EDGE_N_M[1] * edge,
            cutting.edge_n_m[2] + EDGE_N_M[2] * edge,
        ),
        runout_m=cutting.runout_m + RUNOUT_M * factor(seed, "cutting.runout", RUNOUT_SIGMA),
    )
