"""The truth as a MuJoCo model: one body per segment, one hinge or slide per coordinate, no meshes.

A driven body carries the motor hinge and then its elastic joints, which MuJoCo applies in that order; so
``Rz(sign q + offset) E(delta)`` is reproduced exactly. Linear springs and dampers are MuJoCo's own; play, friction,
drives and the counterbalance act through applied forces.

Division of a step of the plant for its stiffest spring: elastic joints, stuck friction, drives.

A step of length h takes springs and drives at its start and the dampers of the elastic joints at its end,
``(M + h D) v' = (M - h D_e) v - h K q``, ``q' = q + h v'``. No motion of it grows if ``4 M + 2 h (D - D_e) - h^2 K``
has no negative eigenvalue: for every eigenvector the scalar polynomial
``z^2 (m + h d) + z (h^2 k - 2 m - h d + h d_e) + m - h d_e`` then has its roots in the unit circle (Jury's conditions).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import SimulationError
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

    def on_axes(self, sign: Float, on_link: Float, on_motor: Float) -> Float:
        """Matrix (n, n) of springs or dampers on the link angle ``q + sign rz`` and on the motor angle of each axis.

        ``sign``: (6,) of each axis. ``on_link``: (6,) N m/rad, or N m s/rad. ``on_motor``: (6,), the same.
        """
        out: Float = np.zeros((len(self.kind), len(self.kind)))
        for axis, (m, t) in enumerate(zip(self.motor, self.torsion, strict=True)):
            link = np.zeros(len(out))
            link[m] = 1.0
            if t >= 0:
                link[t] = sign[axis]
            out += on_link[axis] * np.outer(link, link)
            out[m, m] += on_motor[axis]
        return out


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


PARTS: Final = (1, 2, 4, 8, 16, 32)
"""Divisions of a step that are tried."""
_RESERVE: Final = 1.2
"""A part of a step is stable if one longer by this is: postures between those looked at have a little less inertia."""
_POSTURES: Final = 24


def step_is_stable(M: Float, K: Float, implicit: Float, explicit: Float, step_s: float) -> bool:
    """Return whether no small motion grows from step to step.

    Args:
        M: (n, n) inertia.
        K: (n, n) stiffness of all springs, drives and stuck friction elements.
        implicit: (n, n) damping that acts on the speed at the end of a step.
        explicit: (n, n) damping that acts on the speed at its start.
        step_s: h, s.
    """
    least = 4.0 * M + 2.0 * step_s * (implicit - explicit) - step_s**2 * K
    try:
        np.linalg.cholesky(least)
    except np.linalg.LinAlgError:
        return False
    return True


def parts_of_step(
    mass_matrix: Callable[[Float], Float], K: Float, implicit: Float, explicit: Float, step_s: float
) -> int:
    """Smallest division of a step that is stable in every posture of a fixed random choice.

    Args:
        mass_matrix: (n, n) inertia at motor angles (6,) rad.
        K: (n, n), see :func:`step_is_stable`.
        implicit: (n, n), see there.
        explicit: (n, n), see there.
        step_s: Step to be divided, s.

    Raises:
        SimulationError: A 32nd of the step is too long still.
    """
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSTURES, 6))
    inertia = [mass_matrix(q) for q in angles]
    for parts in PARTS:
        if all(step_is_stable(M, K, implicit, explicit, _RESERVE * step_s / parts) for M in inertia):
            return parts
    raise SimulationError(
        "a spring of the truth is too stiff for its inertia to be simulated",
        value=f"steps of {step_s / PARTS[-1] * 1e6:.1f} us",
        hint="Check slip angles of the friction, masses and inertias of the truth",
    )
