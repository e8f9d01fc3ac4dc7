"""Description of a robot and its end effector as a serial chain of segments.

One segment is one rigid body with, in front of it, a driven joint (or none) and an elastic element (or none)::

    T_prev_next = T_prev_seg @ Rz(sign q + offset) @ E(delta)

``E`` is the elastic displacement of the segment: translation (tx, ty, tz), then z-y'-x'' rotations
``Rz(rz) Ry(ry) Rx(rx)``, all in the segment's own axes after the drive (Haehn2020 eq. 2-9; Denkena2015 eq. 1-7 is the
linear form). An elastic element that does not sit in the drive's frame is a segment of its own with ``joint=None``.

Compliances that change with the load of their spring: gears are soft about zero torque and stiffen with it.

``c(x) = c f(x)`` is the slope of the displacement over the whole load x of the spring, own weight included; f is linear
between the loads that it is given at and constant beyond them. Data sheets of strain wave gears give such a curve as
three slopes (K1 up to T1, K2 up to T2, K3 beyond), those of cycloidal gears as lost motion and stiffness.

From Denavit-Hartenberg rows to the segment chain: any six-axis arm, with or without a spherical wrist.

Per axis, with ``theta_i = sign_i q_i + offset_i``::

    standard    Rz(theta_i) Tz(d_i) Tx(a_i) Rx(alpha_i)      (Denavit and Hartenberg 1955)
    modified    Rx(alpha_i) Tx(a_i) Rz(theta_i) Tz(d_i)      (Craig)

Segment ``axisN`` has its z along axis N: in the modified form its origin is that of the row's frame before ``d``, in
the standard form the one of the row before. What remains behind axis 6 leads to the flange.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from counterflex.core.arrays import Float, frozen
from counterflex.core.errors import ModelError
from counterflex.geometry import pose, rotation
from counterflex.robot.model.controller_axes import AS_MODEL, ControllerAxes

LOADS: Final = (2, 8)
"""Fewest and most loads of one curve."""
_SMALL: Final = 1e-6  # Share of the largest load of a curve below which a load is too small to divide by


@dataclass(frozen=True)
class ComplianceCurve:
    """Factor on one compliance over the load of its spring."""

    segment: str  # its name, of the robot or of the end effector
    direction: int  # 0..5 of `tx ty tz rx ry rz`
    loads: tuple[float, ...]  # (k,) N or N m, rising; the sign is that of the load in the frame of the segment
    factors: tuple[float, ...]  # (k,) on the compliance at these loads

    def integral(self, load: Float) -> Float:
        """Displacement over the compliance, from the lowest load of the curve: the integral of f.

        Args:
            load: (...) N or N m.

        Returns:
            (...) N or N m.
        """
        x, f = np.array(self.loads), np.array(self.factors)
        area = np.concatenate([[0.0], np.cumsum(0.5 * (f[1:] + f[:-1]) * np.diff(x))])
        k = np.clip(np.searchsorted(x, load, side="right") - 1, 0, len(x) - 2)
        inside = np.clip(load, x[0], x[-1])
        slope = (f[k + 1] - f[k]) / (x[k + 1] - x[k])
        step = inside - x[k]
        beyond = f[0] * np.minimum(load - x[0], 0.0) + f[-1] * np.maximum(load - x[-1], 0.0)
        out: Float = area[k] + f[k] * step + 0.5 * slope * step**2 + beyond
        return out

    def secant(self, weight: Float, load: Float) -> Float:
        """Mean factor while a load is put on a spring that carries another: what the load moves is c times this.

        Args:
            weight: (...) N or N m, carried before and after.
            load: (...) N or N m, put on.

        Returns:
            (...) mean of f from ``weight`` to ``weight + load``; f itself where the load is zero.
        """
        small = _SMALL * max(abs(self.loads[0]), abs(self.loads[-1]))
        tiny = np.abs(load) < small
        put = np.where(tiny, 1.0, load)
        mean = (self.integral(weight + put) - self.integral(weight)) / put
        out: Float = np.where(tiny, np.interp(weight + 0.5 * load, self.loads, self.factors), mean)
        return out

    def times(self, other: ComplianceCurve) -> ComplianceCurve:
        """The product with another curve of the same spring, at the loads of both (the most that a curve may have)."""
        x = np.unique(np.concatenate([self.loads, other.loads]))
        if len(x) > LOADS[1]:
            # Too many loads for one curve: thinned by their number, so that they stay dense where they were.
            x = np.interp(np.linspace(0.0, 1.0, LOADS[1]), np.linspace(0.0, 1.0, len(x)), x)
        factors = np.interp(x, self.loads, self.factors) * np.interp(x, other.loads, other.factors)
        return ComplianceCurve(self.segment, self.direction, tuple(x.tolist()), tuple(factors.tolist()))


def secants(curves: Sequence[ComplianceCurve], names: Sequence[str], weight: Float, load: Float) -> Float:
    """Mean factors on all compliances of a chain while a load is put on.

    Args:
        curves: Any number, one for a spring.
        names: n segments of the chain.
        weight: (..., n, 6) N, N m of each segment, carried before and after.
        load: (..., n, 6) N, N m put on.

    Returns:
        (..., n, 6): 1 where no curve acts.
    """
    out = np.ones(load.shape)
    for curve in curves:
        at = (..., list(names).index(curve.segment), curve.direction)
        out[at] = curve.secant(weight[at], load[at])
    return out


RIGID: Float = np.zeros(6)
RIGID.flags.writeable = False


@dataclass(frozen=True)
class Segment:
    """A rigid body of the chain, with its drive and its elastic element."""

    name: str  # for messages and cell files, for example `axis1`, `link_arm`, `sensor`, `spindle`
    T_prev_seg: Float  # (4, 4) fixed pose of this segment's frame in the previous segment's frame (base for the first)
    joint: int | None = None  # driven axis 0..5 that turns this frame about its z, or None
    sign: float = 1.0  # +1 or -1; `theta = sign q + offset_rad` with q the angle of the model
    offset_rad: float = 0.0  # see `sign`
    # (6,) `tx ty tz rx ry rz` in m/N and rad/(N m), in this frame; 0 is rigid
    compliance: Float = field(default_factory=lambda: RIGID)
    mass_kg: float = 0.0  # mass of the body
    p_seg_com: Float = field(default_factory=lambda: np.zeros(3))  # (3,) m, its centre of gravity in this frame


@dataclass(frozen=True)
class Counterbalance:
    """Gas cylinder between column and link arm that carries part of the weight on axis 2.

    With ``d = q - q_min_force``, ``dl = sqrt(D^2 + k^2 - 2 D k cos d) - (D - k)``, ``h = D k sin d / (dl + D - k)``,
    gas pressure ``p = Z R T m / (V_max - dl A)`` and piston area ``A``: torque magnitude ``h p A``, pulling the link
    arm back towards ``q_min_force`` (it counters gravity, which pulls the arm down on both sides).
    """

    joint: int  # driven axis it acts on (1 for axis 2)
    anchor_column_m: float  # D, distance of the column anchor from the axis
    anchor_arm_m: float  # k, distance of the arm anchor from the axis
    q_min_force_rad: float  # joint angle at which the lever vanishes
    piston_area_m2: float  # A (annulus: piston minus rod)
    gas_constant_j: float  # Z R T m in J
    gas_volume_max_m3: float  # v_max

    def torque(self, q_joint: Float | float) -> Float:
        """Torque of the gas cylinder on its axis, positive in the positive direction of the controller angle.

        With ``d = q - q_min_force``: ``dl = sqrt(D^2 + k^2 - 2 D k cos d) - (D - k)``, lever ``h = D k sin d / (dl + D
        - k)``, gas pressure ``p = Z R T m / (V_max - dl A)``, torque ``-h p A``: it pulls back towards ``q_min_force``.

        Args:
            q_joint: (...) rad, controller angle of the axis it acts on.

        Returns:
            (...) N m.

        Source: gas cylinder between column and link arm of KUKA KR QUANTEC robots, J. Weigand, Robot_Identification
        (2021).
        """
        d = np.asarray(q_joint, dtype=np.float64) - self.q_min_force_rad
        long, short = self.anchor_column_m, self.anchor_arm_m
        length = np.sqrt(long**2 + short**2 - 2.0 * long * short * np.cos(d))
        lever = long * short * np.sin(d) / length
        stroke = length - (long - short)
        pressure = self.gas_constant_j / (self.gas_volume_max_m3 - stroke * self.piston_area_m2)
        out: Float = -lever * pressure * self.piston_area_m2
        return out


@dataclass(frozen=True)
class Play:
    """Gear play and dry friction of one driven axis, as slow reversals show them; see :mod:`.elasticity.play`."""

    half_band_rad: float = 0.0  # half width of the dead band in series with the torsion of the axis
    # dry friction on the link side, one entry per Maxwell slip element; the sum is what an axis in motion feels
    friction_nm: tuple[float, ...] = ()
    # angle at which each element yields after it was relaxed; as many as in `friction_nm`
    slip_rad: tuple[float, ...] = ()


@dataclass(frozen=True)
class Servo:
    """Position loop P around a speed loop PI of one axis, on the link side; see :mod:`.elasticity.servo`."""

    speed_gain_nm_s: float  # K, torque per speed error, N m s/rad
    position_gain_per_s: float  # kv
    integral_time_s: float  # ti of the speed loop
    friction_nm: float = 0.0  # dry friction on the motor's side
    slip_rad: float = 1e-5  # angle within which it turns round


@dataclass(frozen=True)
class ElasticRegion:
    """A compliance that differs by region of the joint space; see :mod:`counterflex.robot.model.elastic_region`."""

    segment: str  # its name, of the robot or of the end effector
    direction: int  # 0..5 of `tx ty tz rx ry rz`
    axis: int  # 0..5, the axis over whose angle the compliance changes
    angles_rad: tuple[float, ...]  # (k,) rad, rising
    factors: tuple[float, ...]  # (k,) on the compliance at these angles


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

    def reach_m(self) -> float:
        """Largest distance of the wrist from axis 2, m: upper arm and forearm in one line."""
        return float(self.c2_m + np.hypot(self.c3_m, self.a2_m))


@dataclass(frozen=True)
class Robot:
    """A robot without its end effector."""

    name: str  # catalogue name or the user's own
    segments: tuple[Segment, ...]  # from the base outward; every joint 0..5 appears once, in order
    T_last_flange: Float  # (4, 4) flange in the frame of the last segment
    joint_limits_rad: Float  # (6, 2) lower, upper of the model's angles
    joint_speeds_rad_s: Float | None = None  # (6,) or None
    opw: Opw | None = None  # closed-form geometry where it fits, for the seeds of the inverse kinematics
    counterbalance: Counterbalance | None = None  # or None
    # play and friction of the six driven axes, None for an axis where they are not known; or None
    play: tuple[Play | None, ...] | None = None
    # loop gains of the six driven axes, None for an axis where they are not known; or None
    servo: tuple[Servo | None, ...] | None = None
    # compliances that differ by region of the joint space, of the robot and of what it carries
    regions: tuple[ElasticRegion, ...] = ()
    curves: tuple[ComplianceCurve, ...] = ()  # compliances that change with the load of their spring
    joint_accelerations_rad_s2: Float | None = None  # (6,) largest, or None
    axes: ControllerAxes = AS_MODEL  # how its controller counts the axes, see controller_axes

    @classmethod
    def from_dh(cls, name: str, rows: Sequence[DhRow], convention: Convention = "standard") -> Robot:
        """Build a robot from its DH rows.

        ``rows``: six, from the base outward; ``convention``: of the rows, see the module.

        Returns:
            The robot; rigid, without closed-form inverse kinematics.

        Raises:
            ModelError: Not six rows, or a convention that does not exist.
        """
        if len(rows) != AXES:
            raise ModelError("a robot has six axes", where=name, value=f"{len(rows)} DH rows", limit=AXES)
        if convention not in ("standard", "modified"):
            raise ModelError("unknown DH convention", where=name, value=convention, limit="standard or modified")
        segments = []
        before = np.eye(4)
        for i, row in enumerate(rows):
            normal = pose.make(p=np.array([row.a_m, 0.0, 0.0])) @ pose.make(_about_x(row.alpha_rad))
            along = pose.make(p=np.array([0.0, 0.0, row.d_m]))
            if convention == "modified":
                before = before @ pose.make(_about_x(row.alpha_rad)) @ pose.make(p=np.array([row.a_m, 0.0, 0.0]))
            segments.append(
                Segment(
                    name=f"axis{i + 1}",
                    T_prev_seg=frozen(before),
                    joint=i,
                    sign=row.sign,
                    offset_rad=row.offset_rad,
                    mass_kg=row.mass_kg,
                    p_seg_com=np.array(row.p_axis_com, dtype=np.float64),
                )
            )
            before = along @ normal if convention == "standard" else along
        return cls(
            name=name,
            segments=tuple(segments),
            T_last_flange=frozen(before),
            joint_limits_rad=np.array([row.limits_rad for row in rows], dtype=np.float64),
        )


@dataclass(frozen=True)
class EndEffector:
    """Chain behind the flange: sensor, holder, spindle, tool."""

    segments: tuple[Segment, ...]  # from the flange outward; the first `T_prev_seg` is given in the flange frame
    T_last_tcp: Float  # (4, 4) tool centre point in the last segment's frame (in the flange where there is no segment)


AXES: Final = 6
Convention = Literal["standard", "modified"]


@dataclass(frozen=True)
class DhRow:
    """One axis."""

    a_m: float  # length of the common normal
    d_m: float  # offset along the axis
    alpha_rad: float  # twist about the common normal
    offset_rad: float = 0.0  # see `sign`
    sign: float = 1.0  # +1 or -1; `theta = sign q + offset_rad`
    limits_rad: tuple[float, float] = (-np.pi, np.pi)  # lower and upper limit of the angle that the controller shows
    mass_kg: float = 0.0  # mass of the body that the axis carries
    # (3,) m, its centre of gravity in the frame `axisN` (z along the axis, turning with it)
    p_axis_com: tuple[float, float, float] = (0.0, 0.0, 0.0)


def _about_x(angle: float) -> Float:
    """Turn about x; exact where it is a multiple of a quarter turn."""
    R = rotation.about_x(angle)
    quarter = angle / (0.5 * np.pi)
    return np.rint(R) + 0.0 if abs(quarter - round(quarter)) < 1e-12 else R
