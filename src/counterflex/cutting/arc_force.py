"""Mean force of cuts over one arc as a linear map of the force constants, with its exact derivatives.

For a power term ``k h^p`` of a force law the mean force over a revolution is ``B(p) (k_c, k_r, k_a)``: linear in the
constants, with a 3 x 3 map B that depends on the exponent, the arc and the depth. In the feed frame (x along the
horizontal feed, y to its left, z up along the tool axis, force on the tool), level by level of the cutter,

    J1 = int sin^p dphi,   Jc = int sin^p cos dphi,   Js = int sin^p sin dphi   over the arc
    Fx = N/2pi sum_l g_l [-k_c Jc - k_n Js],   Fy = N/2pi sum_l g_l [k_c Js - k_n Jc],   Fz = N/2pi sum_l g_l k_z J1
    g_l = height_l (f_z s_l)^p / sin kappa_l,  k_n = k_r sin kappa + k_a cos kappa,  k_z = k_r cos kappa - k_a sin kappa

where s_l is the effective ``sin kappa`` of the level. It is what :mod:`counterflex.cutting.mean_force` computes for
booked engagement, here without bins and with derivatives by exponent, depth and ends of the arc, which identification
needs. A descending flat mill adds the thrust ``N R k_r f_d^p`` of its end face over the share of the disc that stands
in the stock.

Sources: Berger2013 section 5; Altintas and Lee 1998 (directions at an inclined edge).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError, ModelError
from counterflex.cutting.arc_integrals import runout_table
from counterflex.cutting.cutter import Cutter

_LEVEL_NODES, _LEVEL_WEIGHTS = np.polynomial.legendre.leggauss(24)


def _graded(count: int) -> tuple[Float, Float]:
    """Nodes and weights on (0, 1) of Gauss's rule after a step of seventh order, which crowds them at both ends."""
    t, w = np.polynomial.legendre.leggauss(count)
    t, w = 0.5 * (t + 1.0), 0.5 * w
    return t**4 * (35.0 - 84.0 * t + 70.0 * t**2 - 20.0 * t**3), 140.0 * t**3 * (1.0 - t) ** 3 * w


# The slope of sin^p has no bound at 0 and pi for p below 1 (1 - m of common materials is 0.6 to 0.9): evenly spread
# Gauss nodes lose their digits there.
_ARC_NODES, _ARC_WEIGHTS = _graded(40)
_RUNOUT_NODES = 64


@dataclass(frozen=True, eq=False)
class ArcCuts:
    """Cuts of constant depth over one arc of engagement with one cutter.

    Raises:
        InputError: A number is out of range.
        ModelError: A mill with a rounded corner descends or climbs: its chip then varies over the corner.
    """

    cutter: Cutter
    depth_m: Float  # (n,) axial depth above the tip, m, >= 0
    entry_rad: Float  # (n,) immersion angle at which an edge enters, rad, 0 at the left normal of the feed
    exit_rad: Float  # (n,) angle at which it leaves, up to pi
    feed_tooth_m: Float  # (n,) horizontal feed per tooth, m, > 0
    drop_tooth_m: Float  # (n,) descent per tooth, m, negative when climbing

    def __post_init__(self) -> None:
        """Check ranges."""
        n = len(self.depth_m)
        for name in ("depth_m", "entry_rad", "exit_rad", "feed_tooth_m", "drop_tooth_m"):
            object.__setattr__(self, name, as_float(name, getattr(self, name), (n,)))
        if n and float(np.min(self.depth_m)) < 0.0:
            raise InputError("depth of cut is negative", value=float(np.min(self.depth_m)), limit=">= 0 m")
        if n and float(np.min(self.feed_tooth_m)) <= 0.0:
            raise InputError("feed per tooth is out of range", value=float(np.min(self.feed_tooth_m)), limit="> 0 m")
        wrong = (self.entry_rad < 0.0) | (self.exit_rad > math.pi * (1.0 + 1e-12)) | (self.entry_rad > self.exit_rad)
        if np.any(wrong):
            i = int(np.argmax(wrong))
            raise InputError(
                "arc of engagement is out of range",
                value=(float(self.entry_rad[i]), float(self.exit_rad[i])),
                limit="0 <= entry <= exit <= pi",
            )
        if not self.cutter.is_flat and np.any(self.drop_tooth_m != 0.0):
            raise ModelError(
                "a ramp with a rounded cutter has no closed form over one arc",
                value=f"corner radius {self.cutter.corner_radius_m:g} m",
                hint="Cut level slots, or use a flat end mill",
            )

    def __len__(self) -> int:
        """Number of cuts."""
        return len(self.depth_m)


@dataclass(frozen=True, eq=False)
class TermForce:
    """Mean force on the tool per unit constant of one power term, and its derivatives."""

    value: Float  # (n, 3, 3) m^(1 + p): force x, y, z by the constants c, r, a
    by_exponent: Float  # (n, 3, 3) derivative by p
    by_depth: Float  # (n, 3, 3) by the depth, 1/m
    by_entry: Float  # (n, 3, 3) by the entry angle, 1/rad
    by_exit: Float  # (n, 3, 3) by the exit angle, 1/rad

    @classmethod
    def of(cls, cuts: ArcCuts, exponent: float) -> TermForce:
        """Mean force of a power term ``k h^p`` over a revolution, per unit constant.

        Args:
            exponent: p, >= 0 (1 - m of Kienzle's law; 0 for an edge force).

        Raises:
            InputError: The exponent is negative.
        """
        p = float(exponent)
        if not p >= 0.0:
            raise InputError("exponent of a power term is out of range", value=exponent, limit=">= 0")
        cutter = cuts.cutter
        unit = cutter.flutes / (2.0 * math.pi)
        feed = cuts.feed_tooth_m
        uneven = _Uneven.of(cuts, p)
        J, dJ = _arc_integrals(p, cuts.entry_rad, cuts.exit_rad, uneven)
        ends = [_integrand(p, angle, uneven) for angle in (cuts.entry_rad, cuts.exit_rad)]
        levels = _Levels.of(cutter, p)
        height = np.clip(np.minimum(levels.upper, cuts.depth_m[:, None]) - levels.lower, 0.0, None)
        # More depth lengthens only the level in which the cut ends; on a boundary that is the level above it.
        growing = ((cuts.depth_m[:, None] >= levels.lower) & (cuts.depth_m[:, None] < levels.upper)).astype(np.float64)
        scale = unit * feed[:, None] ** p * levels.sine_p / levels.sine
        by_p = np.log(feed)[:, None] + levels.sine_p_slope / levels.sine_p
        mapped = partial(_mapped, levels)
        value = mapped(scale * height, J)
        by_exponent = mapped(scale * height, dJ) + mapped(scale * height * by_p, J)
        by_depth = mapped(scale * growing, J)
        by_entry, by_exit = -mapped(scale * height, ends[0]), mapped(scale * height, ends[1])
        _add_end_face(cuts, p, value, by_exponent, by_entry, by_exit)
        return cls(value, by_exponent, by_depth, by_entry, by_exit)


def _mapped(levels: _Levels, weight: Float, integrals: Float) -> Float:
    """Sum over the levels of ``weight`` (n, levels) times the directions; ``integrals`` (n, 3): J1, Jc, Js."""
    whole = weight.sum(axis=1)
    sine, cosine = weight @ levels.sine, weight @ levels.cosine
    j1, jc, js = integrals.T
    out = np.zeros((len(weight), 3, 3))
    out[:, 0, 0], out[:, 0, 1], out[:, 0, 2] = -whole * jc, -sine * js, -cosine * js
    out[:, 1, 0], out[:, 1, 1], out[:, 1, 2] = whole * js, -sine * jc, -cosine * jc
    out[:, 2, 1], out[:, 2, 2] = cosine * j1, -sine * j1
    return out


def mean_thickness(cuts: ArcCuts) -> Float:
    """Mean chip thickness over the arc on the cylinder, ``f_z (cos entry - cos exit) / (exit - entry)``, (n,) m.

    Source: Berger2013 eq. 3.
    """
    span = cuts.exit_rad - cuts.entry_rad
    out: Float = cuts.feed_tooth_m * (np.cos(cuts.entry_rad) - np.cos(cuts.exit_rad)) / np.where(span > 0.0, span, 1.0)
    return out


def force_thickness(cuts: ArcCuts) -> Float:
    """Chip thickness where the force arises, (n,) m: the geometric mean over the arc weighted with ``sin^2 phi``.

    At this thickness the cutting force of a cut fixes the specific force with least regard to the exponent; for a slot
    it is ``f_z exp(1/2) / 2 = 0.824 f_z``, where the mean thickness is 0.637 f_z.
    """
    J, slope = _arc_integrals(1.0, cuts.entry_rad, cuts.exit_rad)
    out: Float = cuts.feed_tooth_m * np.exp(slope[:, 2] / np.where(J[:, 2] > 0.0, J[:, 2], 1.0))
    return out


@dataclass(frozen=True, eq=False)
class _Levels:
    """Axial levels: bounds, mean sine and cosine of kappa, mean of ``sin^p kappa`` and its derivative by p."""

    lower: Float
    upper: Float
    sine: Float
    cosine: Float
    sine_p: Float
    sine_p_slope: Float

    @classmethod
    def of(cls, cutter: Cutter, p: float) -> _Levels:
        """Heights that divide the flutes, and what is engaged between them."""
        bounds = cutter.levels()
        n = len(bounds) - 1
        sine, cosine, sine_p, slope = np.ones(n), np.zeros(n), np.ones(n), np.zeros(n)
        # The cylinder ends with the flutes. A corner higher than them keeps its levels, so that bounds still rise.
        upper = np.minimum(bounds[1:], max(cutter.flute_length_m, float(bounds[-2])))
        t, w = _LEVEL_NODES, _LEVEL_WEIGHTS
        for i, (z0, z1) in enumerate(itertools.pairwise(bounds)):
            if z0 >= cutter.corner_radius_m * (1.0 - 1e-12):
                continue
            k0 = math.acos(1.0 - z0 / cutter.corner_radius_m)
            k1 = math.acos(max(1.0 - z1 / cutter.corner_radius_m, 0.0))
            span = k1 - k0
            sine[i] = (math.cos(k0) - math.cos(k1)) / span
            cosine[i] = (math.sin(k1) - math.sin(k0)) / span
            step = 0.25 * (2.0 + 3.0 * t - t**3)  # graded towards both ends
            kappa = np.sin(k0 + span * step)
            weight = 0.75 * (1.0 - t * t) * w
            power = kappa**p
            sine_p[i], slope[i] = float(weight @ power), float(weight @ (power * np.log(kappa)))
        return cls(bounds[:-1], upper, sine, cosine, sine_p, slope)


@dataclass(frozen=True, eq=False)
class _Uneven:
    """Factors of runout on a power of the chip, see :func:`counterflex.cutting.arc_integrals.runout_table`."""

    runout_m: float
    feed_tooth_m: Float  # (n,)
    table: Float  # (2, nodes)

    @classmethod
    def of(cls, cuts: ArcCuts, p: float) -> _Uneven | None:
        """The factors for some cuts; None where all teeth cut alike."""
        cutter = cuts.cutter
        if cutter.runout_m == 0.0 or cutter.flutes < 2:
            return None
        return cls(cutter.runout_m, cuts.feed_tooth_m, runout_table(np.array([p]), cutter.flutes, _RUNOUT_NODES)[0])

    def at(self, sine: Float) -> Float:
        """(2, ...) factor and its derivative by p, at sines of the immersion angle, cuts first."""
        feed = self.feed_tooth_m.reshape(-1, *(1,) * (sine.ndim - 1))
        share = self.runout_m / (self.runout_m + feed * sine)
        nodes = np.linspace(0.0, 1.0, self.table.shape[1])
        return np.stack([np.interp(share, nodes, values) for values in self.table])


def _integrand(p: float, phi: Float, uneven: _Uneven | None = None) -> Float:
    """(n, 3): sin^p, sin^p cos, sin^p sin."""
    sine, cosine = np.clip(np.sin(phi), 0.0, None), np.cos(phi)
    power = sine**p if uneven is None else sine**p * uneven.at(sine)[0]
    out: Float = np.stack([power, power * cosine, power * sine], axis=-1)
    return out


def _arc_integrals(p: float, entry: Float, leave: Float, uneven: _Uneven | None = None) -> tuple[Float, Float]:
    """J1, Jc, Js over each arc, (n, 3), and their derivatives by p; Gauss nodes crowd where sin vanishes."""
    span = (leave - entry)[:, None]
    phi = entry[:, None] + span * _ARC_NODES
    shapes = _integrand(p, phi, uneven) * (span * _ARC_WEIGHTS)[..., None]
    # sin^p log(sin) goes to 0 at both ends. Without the clip it is 0 times minus infinity.
    sine = np.clip(np.sin(phi), 1e-300, None)
    logarithm = np.log(sine)
    if uneven is not None:
        factor, by_p = uneven.at(sine)
        logarithm = logarithm + by_p / factor
    return shapes.sum(axis=1), (shapes * logarithm[..., None]).sum(axis=1)


def _left_of(phi: Float) -> Float:
    """Share of a disc to the left of the chord through an angle, from 0 to 1."""
    out: Float = (phi - np.sin(phi) * np.cos(phi)) / math.pi
    return out


def _add_end_face(cuts: ArcCuts, p: float, value: Float, by_exponent: Float, by_entry: Float, by_exit: Float) -> None:
    """Add the thrust of a descending end face over the strip of the disc between entry and exit."""
    down = cuts.drop_tooth_m > 0.0
    if not np.any(down):
        return
    # 1 where the mill does not descend: its logarithm is 0, and the thrust beside it is 0 as well.
    drop = np.where(down, cuts.drop_tooth_m, 1.0)
    thrust = np.where(down, cuts.cutter.flutes * cuts.cutter.radius_m * drop**p, 0.0)
    share = _left_of(cuts.exit_rad) - _left_of(cuts.entry_rad)
    value[:, 2, 1] += thrust * share
    by_exponent[:, 2, 1] += thrust * share * np.log(drop)
    by_entry[:, 2, 1] -= thrust * 2.0 * np.sin(cuts.entry_rad) ** 2 / math.pi
    by_exit[:, 2, 1] += thrust * 2.0 * np.sin(cuts.exit_rad) ** 2 / math.pi
