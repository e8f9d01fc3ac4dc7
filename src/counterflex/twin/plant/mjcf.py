"""The truth as a MuJoCo model: one body per segment, one hinge or slide per coordinate, no meshes.

A driven body carries the motor hinge and then its elastic joints, which MuJoCo applies in that order; so
``Rz(sign q + offset) E(delta)`` is reproduced exactly. Linear springs and dampers are MuJoCo's own; play, friction,
drives and the counterbalance act through applied forces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.geometry import pose, rotation
from counterflex.twin.truth.truth import Body, Truth

MOTOR = -1  # kind of the motor hinge in Coordinates.kind; 0..5 are tx ty tz rx ry rz
_ORDER = (0, 1, 2, 5, 4, 3)  # translation, then z, y', x''
_AXES = ("1 0 0", "0 1 0", "0 0 1")


@dataclass(frozen=True)
class Coordinates:
    """Meaning of each coordinate of the model."""

    body: Int  # (n,) index of the body
    kind: Int  # (n,) MOTOR or 0..5 for ``tx ty tz rx ry rz``
    axis: Int  # (n,) driven axis 0..5 for a motor and for the torsion ``rz`` of a driven body, else -1
    stiffness: Float  # (n,) N/m or N m/rad, 0 for motors
    motor: Int  # (6,) coordinate of each motor
    torsion: Int  # (6,) coordinate of each driven body's ``rz``, -1 where that is rigid


def coordinates(truth: Truth) -> Coordinates:
    """List the coordinates of a truth in the order of the model."""
    rows: list[tuple[int, int, int, float]] = []
    motor, torsion = np.full(6, -1, dtype=np.int64), np.full(6, -1, dtype=np.int64)
    for index, body in enumerate(truth.bodies):
        if body.joint is not None:
            motor[body.joint] = len(rows)
            rows.append((index, MOTOR, body.joint, 0.0))
        for kind in _ORDER:
            if body.compliance[kind] > 0.0:
                driven = body.joint is not None and kind == 5
                if driven and body.joint is not None:
                    torsion[body.joint] = len(rows)
                rows.append(
                    (
                        index,
                        kind,
                        body.joint if driven and body.joint is not None else -1,
                        1.0 / float(body.compliance[kind]),
                    )
                )
    return Coordinates(
        body=np.array([r[0] for r in rows], dtype=np.int64),
        kind=np.array([r[1] for r in rows], dtype=np.int64),
        axis=np.array([r[2] for r in rows], dtype=np.int64),
        stiffness=np.array([r[3] for r in rows]),
        motor=motor,
        torsion=torsion,
    )


def _numbers(values: Float | tuple[float, ...] | list[float]) -> str:
    return " ".join(repr(float(v)) for v in values)


_BODY_JOINTS = 6  # MuJoCo allows no more joints in one body
_CARRIER = '<inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/>'


def _motor(truth: Truth, body: Body) -> list[str]:
    if body.joint is None:
        return []
    rotor = truth.drives[body.joint].rotor_inertia_kg_m2
    return [f'<joint name="motor{body.joint + 1}" type="hinge" axis="0 0 {body.sign:g}" armature="{rotor!r}"/>']


def _elastic(body: Body) -> list[str]:
    lines = []
    for kind in _ORDER:
        if body.compliance[kind] == 0.0:
            continue
        stiffness = 1.0 / float(body.compliance[kind])
        spring = 0.0 if body.joint is not None and kind == 5 else stiffness  # driven torsion has play: applied force
        lines.append(
            f'<joint type="{"slide" if kind < 3 else "hinge"}" axis="{_AXES[kind % 3]}" '
            f'pos="{_numbers(body.p_seg_bearing)}" stiffness="{spring!r}" damping="{body.damping_s * stiffness!r}"/>'
        )
    return lines


def model_xml(truth: Truth, step_s: float) -> str:
    """MJCF text of the truth.

    ``step_s``: Integration step, s. Returns MJCF: ``implicitfast`` integration, no contacts, no automatic reset, site
    ``tcp`` at the tool tip.
    """
    head = (
        f'<mujoco model="counterflex"><compiler angle="radian" autolimits="true" balanceinertia="false" '
        f'boundmass="0" boundinertia="0" inertiafromgeom="false"/>'
        f'<option timestep="{step_s!r}" integrator="implicitfast" gravity="{_numbers(truth.gravity_base)}">'
        f'<flag contact="disable" autoreset="disable" constraint="disable"/></option><worldbody>'
    )
    text = [head]
    ends = 0
    for index, body in enumerate(truth.bodies):
        T = body.T_prev_seg @ pose.make(rotation.about_z(body.offset_rad))
        text.append(
            f'<body name="b{index}" pos="{_numbers(T[:3, 3])}" quat="{_numbers(rotation.quat_wxyz(T[:3, :3]))}">'
        )
        motor, elastic = _motor(truth, body), _elastic(body)
        text.extend(motor)
        if len(motor) + len(elastic) > _BODY_JOINTS:  # the rotor gets a carrier of its own
            text.append(f'{_CARRIER}<body name="b{index}e">')
            ends += 1
        text.extend(elastic)
        if body.mass_kg > 0.0:
            text.append(
                f'<inertial pos="{_numbers(body.p_seg_com)}" mass="{body.mass_kg!r}" '
                f'fullinertia="{_numbers(body.inertia_kg_m2)}"/>'
            )
    T = truth.T_last_tcp
    text.append(f'<site name="tcp" pos="{_numbers(T[:3, 3])}" quat="{_numbers(rotation.quat_wxyz(T[:3, :3]))}"/>')
    text.append("</body>" * (len(truth.bodies) + ends))
    text.append("</worldbody></mujoco>")
    return "".join(text)
