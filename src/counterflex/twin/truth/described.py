"""A truth written as a cell description: what a planner would have to be told to know everything.

Used to tell the error of the method from the error of the model. Inertia and runout have no place in a
description and stay unknown.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.geometry import pose
from counterflex.robot.model.description import EndEffector, Play, Robot, Segment, Servo
from counterflex.twin.truth.truth import Body, Truth


def described(truth: Truth, robot: Robot, end_effector: EndEffector) -> tuple[Robot, EndEffector]:
    """Geometry, compliances, bearings, masses, play, friction and loop gains of a truth as robot and end effector.

    An elastic element that turns about a bearing away from the drive's frame becomes a segment of its own,
    ``Rz(theta) Tr(e) E Tr(-e)``.

    ``truth``: Made from ``robot`` and ``end_effector``, perhaps perturbed. ``robot``: Its nominal description; limits,
    closed-form geometry and counterbalance are kept.

    Raises:
        InputError: The truth has other bodies.
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
    """Whether the elastic element turns about another point than the drive."""
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
