"""The nominal truth of a cell: its description, plus what a description does not hold.

What is filled in, and from where. Reference values are those of a KR 300 R2500 ultra (rotor inertia, servo inertia,
friction and play per axis, chosen so that static lost motion and the first modes are those reported for that robot);
for another robot they scale with its size: inertia with mass times reach squared, friction with mass times reach,
play as an angle stays. Play, friction and loop gains that the description has are taken from there. The inertia of a
body is that of a cylinder towards the next frame; the last body, the spindle, is one along the tool axis with the
density and slenderness of a motor spindle (75 kg: 0.65 m long, 0.15 m thick). What is filled in is not known to a
planner.
"""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ModelError
from counterflex.core.units import URAD
from counterflex.robot.model.description import EndEffector, Play, Robot, Segment, Servo
from counterflex.twin.truth.truth import SLIP_ELEMENTS, Body, CuttingTruth, Drive, Truth

DAMPING_S = 1.0e-3
SPEED_BANDWIDTH_PER_S = 150.0
POSITION_GAIN_PER_S = 20.0
INTEGRAL_TIME_S = 60.0e-3
_ROTOR_KG_M2 = (620.0, 620.0, 420.0, 60.0, 55.0, 30.0)
_SERVO_KG_M2 = (1037.0, 1240.0, 689.0, 67.0, 73.0, 32.0)
_LINK_FRICTION_NM = (300.0, 300.0, 300.0, 50.0, 50.0, 50.0)
_MOTOR_FRICTION_NM = (60.0, 60.0, 60.0, 12.0, 12.0, 12.0)
_HALF_PLAY_RAD = (20.0 * URAD, 20.0 * URAD, 20.0 * URAD, 50.0 * URAD, 50.0 * URAD, 50.0 * URAD)
_SHARES = (0.25, 0.35, 0.40)
_SLIP_RAD = (10.0 * URAD, 25.0 * URAD, 60.0 * URAD)
_REACH_M = 0.35 + 1.15 + math.hypot(0.041, 1.0)  # of the reference robot, to the wrist
_MASS_KG = 820.0  # of its moving bodies up to the flange
_LINK_MASS_KG = (320.0, 200.0, 190.0, 60.0, 36.0, 14.0)  # where a description gives no mass at all
_THICKNESS_M_PER_KG13 = 0.04  # radius of an arm's equivalent cylinder per cube root of mass
_SPINDLE_M_PER_KG13 = 0.155  # length of a motor spindle per cube root of mass
_SPINDLE_KG_M3 = 6500.0


def nominal_truth(
    robot: Robot, end_effector: EndEffector, cutting: CuttingTruth, *, name: str = "nominal", friction: float = 1.0
) -> Truth:
    """Turn a cell's description into a truth with exactly its geometry, compliances and masses.

    ``friction``: Factor on all dry friction and play; 0 leaves both out. Returns the truth: every compliance entry
    above zero is an elastic coordinate, damped with beta = 1 ms. Raises ModelError: the friction factor is negative, or
    the description has more slip elements than the truth.
    """
    if not 0.0 <= friction < 10.0:
        raise ModelError("friction factor", value=friction, limit="0..10")
    segments = list(_joined(robot, end_effector))
    tip = end_effector.T_last_tcp if end_effector.segments else robot.T_last_flange @ end_effector.T_last_tcp
    reach = _reach(robot)
    described = sum(s.mass_kg for s in robot.segments)
    mass = described if described > 0.0 else _MASS_KG * (reach / _REACH_M) ** 2.5
    bodies = []
    for index, segment in enumerate(segments):
        last = index + 1 == len(segments)
        following = tip if last else segments[index + 1].T_prev_seg
        fill = mass if described == 0.0 else 0.0
        bodies.append(_body(segment, following[:3, 3], fill, tip[:3, 2] if last else None))
    inertia_scale = mass * reach**2 / (_MASS_KG * _REACH_M**2)
    torque_scale = friction * mass * reach / (_MASS_KG * _REACH_M)
    reference = math.isclose(
        torque_scale, friction, rel_tol=1e-12
    )  # the robot whose values these are: nothing to scale
    link_scale = friction if reference else torque_scale
    known, loops = robot.play or (None,) * 6, robot.servo or (None,) * 6
    drives = tuple(_drive(i, inertia_scale, torque_scale, link_scale, friction, known[i], loops[i]) for i in range(6))
    return Truth(
        name=name,
        bodies=tuple(bodies),
        T_last_tcp=tip,
        drives=drives,
        cutting=cutting,
        counterbalance=robot.counterbalance,
        regions=robot.regions,
    )


def _joined(robot: Robot, end_effector: EndEffector) -> tuple[Segment, ...]:
    if not end_effector.segments:
        return robot.segments
    first, *rest = end_effector.segments
    moved = Segment(
        name=first.name,
        T_prev_seg=robot.T_last_flange @ first.T_prev_seg,
        joint=first.joint,
        sign=first.sign,
        offset_rad=first.offset_rad,
        compliance=first.compliance,
        mass_kg=first.mass_kg,
        p_seg_com=first.p_seg_com,
    )
    return (*robot.segments, moved, *rest)


def _reach(robot: Robot) -> float:
    if robot.opw is not None:
        o = robot.opw
        return float(o.a1_m + o.c2_m + np.hypot(o.a2_m, o.c3_m))
    return float(sum(np.linalg.norm(s.T_prev_seg[:3, 3]) for s in robot.segments[1:]))


def _body(segment: Segment, p_seg_next: Float, fill_kg: float, spindle_axis: Float | None) -> Body:
    """A body with inertia; ``fill_kg`` > 0 is the robot's total mass to share out where no segment has any."""
    moving = segment.joint is not None or bool(np.any(segment.compliance > 0.0))
    mass, com = segment.mass_kg, segment.p_seg_com
    if mass == 0.0 and moving:
        if fill_kg > 0.0 and segment.joint is not None:
            mass = fill_kg * _LINK_MASS_KG[segment.joint] / sum(_LINK_MASS_KG)
            com = 0.5 * p_seg_next
        else:
            mass = max(0.01 * fill_kg, 5.0)  # an elastic element without a mass of its own: a light adapter
    if spindle_axis is None:
        length = max(float(np.linalg.norm(p_seg_next)), 0.15)
        far = np.linalg.norm(p_seg_next) > 1e-6
        along = p_seg_next / np.linalg.norm(p_seg_next) if far else np.array([0.0, 0.0, 1.0])
        radius = max(_THICKNESS_M_PER_KG13 * mass ** (1.0 / 3.0), 0.03)
    else:
        length = _SPINDLE_M_PER_KG13 * mass ** (1.0 / 3.0)
        along = spindle_axis
        radius = float(np.sqrt(mass / (np.pi * length * _SPINDLE_KG_M3)))
    axial = 0.5 * mass * radius**2
    across = mass * (0.25 * radius**2 + length**2 / 12.0)
    i = across * np.eye(3) + (axial - across) * np.outer(along, along)
    return Body(
        name=segment.name,
        T_prev_seg=segment.T_prev_seg,
        joint=segment.joint,
        sign=segment.sign,
        offset_rad=segment.offset_rad,
        compliance=segment.compliance,
        damping_s=DAMPING_S,
        p_seg_bearing=np.zeros(3),
        mass_kg=mass,
        p_seg_com=com,
        inertia_kg_m2=np.array([i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]),
    )


def _drive(
    axis: int,
    inertia_scale: float,
    torque_scale: float,
    link_scale: float,
    factor: float,
    known: Play | None,
    loop: Servo | None,
) -> Drive:
    slip: tuple[float, ...] = _SLIP_RAD
    if known is None:
        half_band = _HALF_PLAY_RAD[axis]
        dry = tuple(share * _LINK_FRICTION_NM[axis] * link_scale for share in _SHARES)
    else:
        half_band = known.half_band_rad
        missing = SLIP_ELEMENTS - len(known.friction_nm)
        if missing < 0:
            raise ModelError("slip elements of an axis", value=len(known.friction_nm), limit=f"<= {SLIP_ELEMENTS}")
        dry = (*(factor * torque for torque in known.friction_nm), *(0.0,) * missing)
        slip = (*known.slip_rad, *_SLIP_RAD[len(known.slip_rad) :])
    inertia, motor, motor_slip = (
        _SERVO_KG_M2[axis] * inertia_scale,
        _MOTOR_FRICTION_NM[axis] * torque_scale,
        _SLIP_RAD[1],
    )
    if loop is not None:
        inertia = loop.speed_gain_nm_s / SPEED_BANDWIDTH_PER_S
        motor, motor_slip = factor * loop.friction_nm, loop.slip_rad
    return Drive(
        rotor_inertia_kg_m2=_ROTOR_KG_M2[axis] * inertia_scale,
        servo_inertia_kg_m2=inertia,
        speed_bandwidth_per_s=SPEED_BANDWIDTH_PER_S,
        position_gain_per_s=POSITION_GAIN_PER_S if loop is None else loop.position_gain_per_s,
        integral_time_s=INTEGRAL_TIME_S if loop is None else loop.integral_time_s,
        dead_band_rad=half_band * factor,
        motor_friction_nm=motor,
        motor_slip_rad=motor_slip,
        link_friction_nm=dry,
        link_slip_rad=slip,
    )
