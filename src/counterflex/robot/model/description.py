"""Description of a robot and its end effector as a serial chain of segments.

One segment is one rigid body with, in front of it, a driven joint (or none) and an elastic element (or none)::

    T_prev_next = T_prev_seg @ Rz(sign q + offset) @ E(delta)

``E`` is the elastic displacement of the segment: translation (tx, ty, tz), then z-y'-x'' rotations
``Rz(rz) Ry(ry) Rx(rx)``, all in the segment's own axes after the drive (Haehn2020 eq. 2-9; Denkena2015 eq. 1-7 is the
linear form). An elastic element that does not sit in the drive's frame is a segment of its own with ``joint=None``.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from counterflex.core.arrays import Float
from counterflex.robot.model.controller_axes import AS_MODEL, ControllerAxes

RIGID: Float = np.zeros(6)
RIGID.flags.writeable = False


@dataclass(frozen=True)
class Segment:
    """A rigid body of the chain, with its drive and its elastic element.

    Attributes:
        name: For messages and cell files, for example ``axis1``, ``link_arm``, ``sensor``, ``spindle``.
        T_prev_seg: (4, 4) fixed pose of this segment's frame in the previous segment's frame (base for the first).
        joint: Driven axis 0..5 that turns this frame about its z, or None.
        sign: +1 or -1; ``theta = sign q + offset_rad`` with q the angle of the model.
        offset_rad: See ``sign``.
        compliance: (6,) ``tx ty tz rx ry rz`` in m/N and rad/(N m), in this frame; 0 is rigid.
        mass_kg: Mass of the body.
        p_seg_com: (3,) m, its centre of gravity in this frame.
    """

    name: str
    T_prev_seg: Float
    joint: int | None = None
    sign: float = 1.0
    offset_rad: float = 0.0
    compliance: Float = field(default_factory=lambda: RIGID)
    mass_kg: float = 0.0
    p_seg_com: Float = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Counterbalance:
    """Gas cylinder between column and link arm that carries part of the weight on axis 2.

    With ``d = q - q_min_force``, ``dl = sqrt(D^2 + k^2 - 2 D k cos d) - (D - k)``, ``h = D k sin d / (dl + D - k)``,
    gas pressure ``p = Z R T m / (V_max - dl A)`` and piston area ``A``: torque magnitude ``h p A``, pulling the link
    arm back towards ``q_min_force`` (it counters gravity, which pulls the arm down on both sides).

    Attributes:
        joint: Driven axis it acts on (1 for axis 2).
        anchor_column_m: D, distance of the column anchor from the axis.
        anchor_arm_m: k, distance of the arm anchor from the axis.
        q_min_force_rad: Joint angle at which the lever vanishes.
        piston_area_m2: A (annulus: piston minus rod).
        gas_constant_j: Z R T m in J.
        gas_volume_max_m3: V_max.
    """

    joint: int
    anchor_column_m: float
    anchor_arm_m: float
    q_min_force_rad: float
    piston_area_m2: float
    gas_constant_j: float
    gas_volume_max_m3: float


@dataclass(frozen=True)
class Play:
    """Gear play and dry friction of one driven axis, as slow reversals show them; see :mod:`.elasticity.play`.

    Attributes:
        half_band_rad: Half width of the dead band in series with the torsion of the axis.
        friction_nm: Dry friction on the link side, one entry per Maxwell slip element; the sum is what an axis in
            motion feels.
        slip_rad: Angle at which each element yields after it was relaxed; as many as in ``friction_nm``.
    """

    half_band_rad: float = 0.0
    friction_nm: tuple[float, ...] = ()
    slip_rad: tuple[float, ...] = ()


@dataclass(frozen=True)
class Servo:
    """Position loop P around a speed loop PI of one axis, on the link side; see :mod:`.elasticity.servo`.

    Attributes:
        speed_gain_nm_s: K, torque per speed error, N m s/rad.
        position_gain_per_s: Kv.
        integral_time_s: Ti of the speed loop.
        friction_nm: Dry friction on the motor's side.
        slip_rad: Angle within which it turns round.
    """

    speed_gain_nm_s: float
    position_gain_per_s: float
    integral_time_s: float
    friction_nm: float = 0.0
    slip_rad: float = 1e-5


@dataclass(frozen=True)
class ElasticRegion:
    """A compliance that differs by region of the joint space; see :mod:`counterflex.robot.model.elastic_region`.

    Attributes:
        segment: Its name, of the robot or of the end effector.
        direction: 0..5 of ``tx ty tz rx ry rz``.
        axis: 0..5, the axis over whose angle the compliance changes.
        angles_rad: (k,) rad, rising.
        factors: (k,) on the compliance at these angles.
    """

    segment: str
    direction: int
    axis: int
    angles_rad: tuple[float, ...]
    factors: tuple[float, ...]


@dataclass(frozen=True)
class Opw:
    """Geometry of a six-axis robot with parallel base and spherical wrist (Brandstoetter et al. 2014).

    Lengths in m; ``theta_i = sign_i q_i - offset_i``; all theta zero is the arm straight up.
    """

    a1_m: float
    a2_m: float
    b_m: float
    c1_m: float
    c2_m: float
    c3_m: float
    c4_m: float
    offsets_rad: tuple[float, ...]
    signs: tuple[int, ...]


@dataclass(frozen=True)
class Robot:
    """A robot without its end effector.

    Attributes:
        name: Catalogue name or the user's own.
        segments: From the base outward; every joint 0..5 appears once, in order.
        T_last_flange: (4, 4) flange in the frame of the last segment.
        joint_limits_rad: (6, 2) lower, upper of the model's angles.
        joint_speeds_rad_s: (6,) or None.
        opw: Closed-form geometry where it fits, for the seeds of the inverse kinematics.
        counterbalance: Or None.
        play: Play and friction of the six driven axes, None for an axis where they are not known; or None.
        servo: Loop gains of the six driven axes, None for an axis where they are not known; or None.
        regions: Compliances that differ by region of the joint space, of the robot and of what it carries.
        joint_accelerations_rad_s2: (6,) largest, or None.
        axes: How its controller counts the axes, see :mod:`.controller_axes`.
    """

    name: str
    segments: tuple[Segment, ...]
    T_last_flange: Float
    joint_limits_rad: Float
    joint_speeds_rad_s: Float | None = None
    opw: Opw | None = None
    counterbalance: Counterbalance | None = None
    play: tuple[Play | None, ...] | None = None
    servo: tuple[Servo | None, ...] | None = None
    regions: tuple[ElasticRegion, ...] = ()
    joint_accelerations_rad_s2: Float | None = None
    axes: ControllerAxes = AS_MODEL


@dataclass(frozen=True)
class EndEffector:
    """What hangs on the flange: sensor, holder, spindle, tool.

    Attributes:
        segments: From the flange outward; the first ``T_prev_seg`` is given in the flange frame.
        T_last_tcp: (4, 4) tool centre point in the last segment's frame (in the flange where there is no segment).
    """

    segments: tuple[Segment, ...]
    T_last_tcp: Float
