"""Differences of the true cell from what a planner knows: seeded amounts, the same on every machine.

How the numbers are drawn: :mod:`counterflex.twin.truth.draw_other`; what other kinds of physics a family may have:
:mod:`counterflex.twin.truth.draw_other`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM, MRAD, MS, N_PER_MM2, UM, URAD
from counterflex.geometry import pose
from counterflex.robot.model.description import ElasticRegion, EndEffector, Play, Robot, Segment, Servo
from counterflex.twin.truth.draw_other import draw, factor, other_cell, other_cutting, vector
from counterflex.twin.truth.family import MILD, Family
from counterflex.twin.truth.other import OtherPhysics
from counterflex.twin.truth.truth import Body, CuttingTruth, Drive, Truth


@dataclass(frozen=True)
class TruthDifference:
    """One row of the table of differences."""

    # ``stiffness``, ``geometry``, ``bearings``, ``masses``, ``drives``, ``cutting``, ``stock`` or ``other kinds``
    group: str
    name: str
    known: float  # value in the nominal truth, in ``unit``
    true: float  # value in the truth
    unit: str


def differences(known: Truth, true: Truth) -> tuple[TruthDifference, ...]:
    """Differences of a truth from the nominal one, for reports.

    Returns rows in shop units; positions as the distance between known and true. Raises InputError: the two do not have
    the same bodies.
    """
    if [b.name for b in known.bodies] != [b.name for b in true.bodies]:
        raise InputError("the truths are not of the same cell", value=[b.name for b in true.bodies])
    pairs = (
        *(pair for a, b in zip(known.bodies, true.bodies, strict=True) for pair in _of_body(a, b)),
        *(
            pair
            for axis, (d, e) in enumerate(zip(known.drives, true.drives, strict=True), start=1)
            for pair in _of_drive(f"axis {axis}", d, e)
        ),
        *_of_cutting(known.cutting, true.cutting),
        ("stock", "top of the blank", known.stock_top_offset_m / MM, true.stock_top_offset_m / MM, "mm"),
        *(("other kinds", *row) for row in _other(true.other)),
    )
    return tuple(TruthDifference(*pair) for pair in pairs)


_Row = tuple[str, str, float, float, str]


def _of_body(a: Body, b: Body) -> Iterator[_Row]:
    if a.compliance.any():
        ratio = float(np.max(a.compliance) / np.max(b.compliance))
        yield "stiffness", a.name, 100.0, 100.0 * ratio, "%"
        yield "bearings", a.name, 0.0, float(np.linalg.norm(b.p_seg_bearing - a.p_seg_bearing)) / MM, "mm off"
    moved = float(np.linalg.norm(b.T_prev_seg[:3, 3] - a.T_prev_seg[:3, 3])) / MM
    yield "geometry", a.name, 0.0, moved, "mm off"
    if a.joint is not None:
        yield "geometry", f"{a.name} zero", 0.0, (b.offset_rad - a.offset_rad) / MRAD, "mrad"
    if a.mass_kg > 0.0:
        yield "masses", a.name, a.mass_kg, b.mass_kg, "kg"


def _of_drive(axis: str, d: Drive, e: Drive) -> Iterator[_Row]:
    rows = (
        ("dry friction", sum(d.link_friction_nm), sum(e.link_friction_nm), "N m"),
        ("play", 2.0 * d.dead_band_rad / URAD, 2.0 * e.dead_band_rad / URAD, "urad"),
        ("speed loop", d.speed_bandwidth_per_s, e.speed_bandwidth_per_s, "1/s"),
        ("position loop", d.position_gain_per_s, e.position_gain_per_s, "1/s"),
        ("integral time", d.integral_time_s / MS, e.integral_time_s / MS, "ms"),
        ("following", d.following_gain_per_s, e.following_gain_per_s, "1/s"),
        ("slip angle", sum(d.link_slip_rad) / URAD, sum(e.link_slip_rad) / URAD, "urad"),
    )
    for what, known, true, unit in rows:
        if known is not None and true is not None:
            yield "drives", f"{axis} {what}", known, true, unit


def _of_cutting(x: CuttingTruth, y: CuttingTruth) -> Iterator[_Row]:
    for i, name in enumerate(("cutting", "radial", "axial")):
        yield "cutting", f"{name} k1.1", x.k_pa[i] / N_PER_MM2, y.k_pa[i] / N_PER_MM2, "N/mm2"
        yield "cutting", f"{name} exponent", x.exponent[i], y.exponent[i], "-"
        yield "cutting", f"{name} ploughing", x.edge_n_m[i] * MM, y.edge_n_m[i] * MM, "N/mm"
    yield "cutting", "runout", x.runout_m / UM, y.runout_m / UM, "um"


def _other(other: OtherPhysics) -> Iterator[tuple[str, float, float, str]]:
    """The kinds that no planner here has a model of; none of them is known."""
    for gear in other.gears:
        yield f"axis {gear.axis + 1} stiffness without load", 100.0, 100.0 * gear.share[0], "%"
        yield f"axis {gear.axis + 1} hysteresis of the gear", 0.0, gear.hysteresis_nm, "N m"
    for friction in other.frictions:
        yield f"axis {friction.axis + 1} friction at standstill", 100.0, 100.0 * friction.stiction_share, "%"
        yield f"axis {friction.axis + 1} friction when cold", 100.0, 100.0 * (1.0 + friction.cold_share), "%"
    if other.couplings:
        yield "springs between coordinates", 0.0, float(len(other.couplings)), "springs"
    if other.controller is not None:
        yield "smoothing of the references", 0.0, other.controller.smoothing_s / MS, "ms"
        yield "rounding of corners", 100.0, 100.0 * other.controller.blending_share, "%"
    if other.thermal is not None:
        yield "growth of the spindle", 0.0, other.thermal.spindle_m / UM, "um in the end"
        yield "drift of the arm", 0.0, float(np.linalg.norm(other.thermal.arm_m)) / UM, "um in the end"
    if other.hose is not None:
        yield "hose pack", 0.0, other.hose.pull_n_m, "N/m"
    for tool in other.tools:
        yield f"tool {tool.number} diameter", 0.0, tool.diameter_m / UM, "um"


# A truth written as a cell description: what a planner would have to be told to know everything.
# Used to tell the error of the method from the error of the model. Inertia and runout have no place in a
# description and stay unknown.


def described(truth: Truth, robot: Robot, end_effector: EndEffector) -> tuple[Robot, EndEffector]:
    """Geometry, compliances, bearings, masses, play, friction and loop gains of a truth as robot and end effector.

    An elastic element that turns about a bearing away from the drive's frame becomes a segment of its own,
    ``Rz(theta) Tr(e) E Tr(-e)``.

    ``truth``: Made from ``robot`` and ``end_effector``, perhaps perturbed. ``robot``: Its nominal description; limits,
    closed-form geometry and counterbalance are kept. Raises InputError: the truth has other bodies.
    """
    names = [s.name for s in (*robot.segments, *end_effector.segments)]
    if [b.name for b in truth.bodies] != names:
        raise InputError("the truth is not one of this cell", value=[b.name for b in truth.bodies], limit=names)
    count = len(robot.segments)
    arm, back = _segments(truth.bodies[:count], np.eye(4))
    if end_effector.segments:
        first = truth.bodies[count]
        hand, tip = _segments(
            (
                replace(first, T_prev_seg=pose.inverse(robot.T_last_flange) @ first.T_prev_seg),
                *truth.bodies[count + 1 :],
            ),
            np.eye(4),
        )
        true_hand = EndEffector(segments=hand, T_last_tcp=tip @ truth.T_last_tcp)
        flange: Float = back @ robot.T_last_flange
    else:
        flange = back @ robot.T_last_flange
        true_hand = EndEffector(segments=(), T_last_tcp=pose.inverse(robot.T_last_flange) @ truth.T_last_tcp)
    play = tuple(Play(d.dead_band_rad, tuple(d.link_friction_nm), tuple(d.link_slip_rad)) for d in truth.drives)
    servo = tuple(
        Servo(
            speed_gain_nm_s=d.speed_bandwidth_per_s * d.servo_inertia_kg_m2,
            position_gain_per_s=d.position_gain_per_s,
            integral_time_s=d.integral_time_s,
            friction_nm=d.motor_friction_nm,
            slip_rad=d.motor_slip_rad,
        )
        for d in truth.drives
    )
    own = {body.name: f"{body.name}_bearing" if _away(body) else body.name for body in truth.bodies}
    regions = tuple(replace(region, segment=own[region.segment]) for region in truth.regions)
    true_robot = replace(robot, segments=arm, T_last_flange=flange, play=play, servo=servo, regions=regions)
    return true_robot, true_hand


def _away(body: Body) -> bool:
    """Return whether the elastic element turns about another point than the drive."""
    return bool(np.any(body.p_seg_bearing != 0.0)) and bool(np.any(body.compliance > 0.0))


def _segments(bodies: tuple[Body, ...], T_last_here: Float) -> tuple[tuple[Segment, ...], Float]:
    """Segments of a run of bodies, and the pose of the last body's frame in the last segment's."""
    out: list[Segment] = []
    for body in bodies:
        T_prev = T_last_here @ body.T_prev_seg
        whole = Segment(
            name=body.name,
            T_prev_seg=T_prev,
            joint=body.joint,
            sign=body.sign,
            offset_rad=body.offset_rad,
            compliance=body.compliance,
            mass_kg=body.mass_kg,
            p_seg_com=body.p_seg_com,
        )
        if not _away(body):
            out.append(whole)
            T_last_here = np.eye(4)
            continue
        e = body.p_seg_bearing
        out.append(replace(whole, compliance=np.zeros(6), mass_kg=0.0, p_seg_com=np.zeros(3)))
        out.append(
            Segment(
                name=f"{body.name}_bearing",
                T_prev_seg=pose.make(p=e),
                compliance=body.compliance,
                mass_kg=body.mass_kg,
                p_seg_com=body.p_seg_com - e,
            )
        )
        T_last_here = pose.make(p=-e)
    return tuple(out), T_last_here


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

    ``seed``: 0, 1, 2, ... Returns the same truth for the same seed and family on every machine. Raises InputError: the
    seed is negative.
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
