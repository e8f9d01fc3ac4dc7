"""Stiffness, drives, friction and play of a robot of which none is published, from robots of its class.

**Stiffness.** A handful of robot types have published ones (``stiffness_data/published.toml``, each row with source),
all of them arms of 210 to 500 kg payload. For axis i of a robot with the rated moment ``S = payload * reach``

    ln k_i = m_i + b ln(S / S_0) + e_i,    e_i = s_i (sqrt(rho) u + sqrt(1 - rho) v_i),    u, v_i standard normal

``m_i`` is the mean over the robot types (rows of one type count as one), ``s_i`` the standard deviation of a new type:
that between types, with the variances of the six axes drawn towards their mean (limma's moderated variance, Smyth
2004), times ``sqrt(1 + 1/n)`` for the mean of n types, and as wide as Student's t makes the 90 % interval for so few.
``rho`` is what the axes of one robot have in common. The exponent b is not measured: the rated torque of an axis rises
with S where a robot is all payload and with less where it carries mostly itself, and gears and bearings are as stiff as
their rated torque is high; ``b = 0.8 +- 0.2`` is a judgement, and its doubt widens s_i away from S_0. Age and wear are
in no source. The stiffness is that of springs about the axes alone, which stand for all that yields: tilting of
bearings and bending of links leave about 15 % of the compliance unexplained in such a model.

**Drives, dry friction and play.** Fewer are published, so the spreads are wider. Loop gains are ratios to the lowest
mode of the robot with drives that stand still (omega), so that they hold for robots of each size; torques of friction
are in proportion to payload times reach of the KR 300 R2500 ultra, to which the published figures belong; angles do
not scale.

- **Speed loop** ``K``: yields as much as the drives' part of the damping ratio of the lowest mode says, which is
  ``sum_a s_a k_a / (2 omega K_a)`` with ``s_a`` the share of the spring of axis a in the strain energy. Its median is
  :data:`DAMPING_RATIO`; the gains of the axes have the published ratios (:data:`SPEED_GAIN_SHARE`).
- **Position loop** ``Kv``: 0.2 to 0.3 of omega (Weck and Brecher, Werkzeugmaschinen 3); the one published gain, 10 1/s,
  is 0.2 of the 8 Hz of its robot.
- **Integral time**: ``2 / omega``, at which the integral part turns the phase of the mode by 27 deg; a judgement.
- **Friction**: the torque that an axis needs at low speed, published for motor and gear together; half of it is taken
  to act on the motor's side, half behind the gear, since no source tells them apart: each share is as likely.
- **Play**: half of the 30 urad that the published controller compensates; encoders before and behind the gears show 6
  to 61 urad at a reversal, which holds play and the twist that friction leaves. The angle over which friction turns
  round is of that size too. One gear in a hundred has the 1 arcmin of lost motion that catalogues allow, or more.

What drives yield is one of many errors of a part, which add in squares, so correcting by its mean over the class leaves
least: the gains that a plan takes are the median over ``exp(sigma^2 / 2)``. Of friction and play the mean is 9 and 25 %
above the median, less than one robot's figures are good for: their medians are taken.

Sources: Weigand et al., IROS 2021, github JonasWeigand/Robot_Identification 9e403c07 (MIT): ``J_mr``, gear ratios
``u``, ``K_vel``, ``K_pos``, ``q_back`` and friction; recording A for the reversals. Modal tests on milling robots:
:mod:`counterflex.plan.lowest_mode`. Check: a KR 300 whose drives were not known left 0.255 instead of 0.114 mm of
1.65 mm (Haehn and Weigold 2020), so they made 14 % of the deflection; a step of force on the planned drives makes 14 %.

Stiffness of an end effector (spindle, bracket, holder) of which none is stated, from published ones.

Two are published: the spindle with its holder of Haehn and Weigold 2020 (KR 300 R2500 ultra), and the spindle holder of
Denkena and Lepper 2015. The prior is one spring, equal about three axes, at the first body that states nothing.
"""

from __future__ import annotations

import functools
import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from statistics import NormalDist
from typing import Any, Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, frozen
from counterflex.core.errors import InputError
from counterflex.core.units import MM, URAD
from counterflex.robot.model.description import Play, Servo

_HAEHN_NM_PER_RAD: Final = (1.9e5, 6.7e4, 9.1e4)  # About x, y, z: Haehn2020 table 1, spindle and holder
_DENKENA_M_PER_N: Final = (0.125e-6, 0.137e-6)
"""Across the tool, at its tip: Denkena2015 table 1, without strain gauges."""
_DENKENA_LEVER_M: Final = 0.25
"""From the flange to the tip: not published; as such spindles are. A third more or less is 30 % of the median."""
_FACTOR_90: Final = 6.0
"""Nine of ten lie between median / 6 and median * 6: a judgement, the two published ones lie a factor of 4.4 apart."""
_INSIDE_SIGMA: Final = 1.645


def median_nm_per_rad() -> float:
    """Return the median stiffness: the geometric mean of the published end effectors, N m/rad."""
    haehn = float(np.exp(np.mean(np.log(_HAEHN_NM_PER_RAD))))
    denkena = _DENKENA_LEVER_M**2 / float(np.mean(_DENKENA_M_PER_N))
    return float(np.sqrt(haehn * denkena))


def drawn(count: int, seed: int) -> Float:
    """Return stiffnesses (count,) N m/rad of end effectors that nothing is known of."""
    z = np.random.default_rng(seed).standard_normal(count)
    out: Float = median_nm_per_rad() * np.exp(np.log(_FACTOR_90) / _INSIDE_SIGMA * z)
    return out


AXES: Final = 6
EXPONENT: Final = (0.8, 0.2)
"""b and its standard deviation."""
PAYLOAD_KG: Final = (20.0, 1000.0)
"""Range in which a prior is given at all; published are 210 to 500 kg."""
_INSIDE: Final = 0.9
_WEIGHT_OF_MEAN: Final = 4.0  # Degrees of freedom that the mean variance of the axes counts beside that of one axis
_NORMAL: Final = NormalDist().inv_cdf(0.5 + 0.5 * _INSIDE)

FRICTION_NM: Final = (318.6, 420.7, 291.5, 93.6, 124.9, 87.7)
"""Dry friction of the axes of a KR 300 R2500 ultra SE: identified level of github JonasWeigand/Robot_Identification
(data_ref.mat; the larger of the two Coulomb terms for axes 1 to 3, their sum for the wrist)."""
REFERENCE_KG_M: Final = 300.0 * 2.496
"""Payload times reach of that robot."""
SPEED_GAIN_SHARE: Final = (0.83, 1.15, 1.02, 0.066, 0.077, 0.032)
"""Gains of the speed loops behind the gears over the mean of axes 1 to 3: by ``J_motor u^2`` (609, 844 and 751 kg m2)
for these, by ``K_vel u^2`` for the wrist, for which the source repeats one inertia, which is none."""
DAMPING_RATIO: Final = 0.045
"""Drives' part of the damping ratio of the lowest mode: geometric mean of the 0.02 to 0.1 that modal tests find."""
POSITION_GAIN_RATIO: Final = 0.25
"""Kv over omega."""
INTEGRAL_RATIO: Final = 2.0
"""Ti times omega."""
HALF_BAND_RAD: Final = 15.0 * URAD
SLIP_RAD: Final = 40.0 * URAD
_AT_MOTOR: Final = 0.5

# Nine of ten robots lie between median / factor and median * factor.
SPEED_GAIN_FACTOR: Final = 4.0
"""The published K_vel is 3 times the median; 4 Kv times rotor and arm, the least that a cascade bears, a sixth."""
POSITION_GAIN_FACTOR: Final = 2.0
FRICTION_FACTOR: Final = 2.0
PLAY_FACTOR: Final = 5.0


@dataclass(frozen=True)
class PublishedStiffness:
    """A published set of axis stiffnesses."""

    robot: str  # type
    payload_kg: float  # rated payload
    reach_m: float  # data-sheet reach
    stiffness_nm_per_rad: Float  # (6,) of springs about the axes that stand for the whole arm; nan where none is given
    source: str  # where it was published
    used: bool  # it is in the prior


@dataclass(frozen=True)
class ClassPrior:
    """Prior of the stiffness of a robot of a class."""

    payload_kg: float  # rated payload
    reach_m: float
    median_nm_per_rad: Float  # (6,) stiffness about the axes, N m/rad
    log_sigma: Float  # (6,) standard deviation of its natural logarithm
    common: float  # share of the variance that the axes of one robot have in common, 0 to 1
    types: tuple[str, ...]  # robot types that it comes from

    @property
    def factor(self) -> Float:
        """(6,) of the 90 % interval: nine robots of ten have between median / factor and median * factor."""
        out: Float = np.exp(_NORMAL * self.log_sigma)
        return out

    def drawn(self, count: int, seed: int) -> Float:
        """Stiffnesses of robots of the class.

        Args:
            count: How many robots.

        Returns:
            (count, 6) N m/rad.
        """
        rng = np.random.default_rng(seed)
        shared, own = rng.standard_normal((count, 1)), rng.standard_normal((count, AXES))
        e = np.sqrt(self.common) * shared + np.sqrt(1.0 - self.common) * own
        out: Float = self.median_nm_per_rad * np.exp(self.log_sigma * e)
        return out


@dataclass(frozen=True)
class DrivePrior:
    """Prior of drives, friction and play of a robot of a class."""

    payload_kg: float  # rated payload
    reach_m: float
    mode_rad_s: float = math.nan  # omega; nan where nothing swings, so that there are no loop gains
    yields_nm: float = math.nan  # sum_a s_a k_a / SPEED_GAIN_SHARE of that mode, N m/rad

    @property
    def friction_nm(self) -> Float:
        """(6,) N m, median of the dry friction of motor and gear together, behind the gear."""
        return np.array(FRICTION_NM) * (self.payload_kg * self.reach_m / REFERENCE_KG_M)

    @property
    def speed_gain_nm_s(self) -> Float:
        """(6,) N m s/rad, gains of the speed loops, behind the gear, with which motors yield as in the mean."""
        ratio = DAMPING_RATIO * math.exp(0.5 * self.yield_log_sigma**2)
        return np.array(SPEED_GAIN_SHARE) * (self.yields_nm / (2.0 * ratio * self.mode_rad_s))

    @property
    def position_gain_per_s(self) -> float:
        """Median of the gains of the position loops, 1/s."""
        return POSITION_GAIN_RATIO * self.mode_rad_s

    @property
    def integral_time_s(self) -> float:
        """Median of the integral times, s."""
        return INTEGRAL_RATIO / self.mode_rad_s

    @property
    def yield_log_sigma(self) -> float:
        """Standard deviation of the logarithm of how far a motor yields, that of ``1 / (K Kv)``."""
        return math.hypot(math.log(SPEED_GAIN_FACTOR), math.log(POSITION_GAIN_FACTOR)) / _NORMAL

    def servo(self, axis: int) -> Servo:
        """Return the loop gains to plan with, and the median friction, on the motor's side of an axis 0..5."""
        return Servo(
            speed_gain_nm_s=float(self.speed_gain_nm_s[axis]),
            position_gain_per_s=self.position_gain_per_s,
            integral_time_s=self.integral_time_s,
            friction_nm=_AT_MOTOR * float(self.friction_nm[axis]),
            slip_rad=SLIP_RAD,
        )

    def play(self, axis: int, share: float = 1.0) -> Play:
        """Return the median play and friction behind the gear of an axis 0..5.

        Args:
            share: Of the compliance of the axis that is the gear's, in which friction holds a twist; less than 1 for a
                spring that stands for the whole arm.
        """
        dry = (1.0 - _AT_MOTOR) * share * float(self.friction_nm[axis])
        return Play(HALF_BAND_RAD, (dry,), (SLIP_RAD,))


def drawn_play(count: int, seed: int) -> tuple[Float, Float]:
    """Play and friction behind the gears of robots of a class.

    Returns:
        (count, 6) half bands, rad, and (count, 6) friction over that of :meth:`DrivePrior.play`.
    """
    rng = np.random.default_rng(seed)
    band, dry = (f ** (rng.standard_normal((count, AXES)) / _NORMAL) for f in (PLAY_FACTOR, FRICTION_FACTOR))
    return HALF_BAND_RAD * band, dry * rng.uniform(0.0, 1.0, (count, AXES)) / (1.0 - _AT_MOTOR)


@functools.cache
def _data() -> dict[str, Any]:
    file = resources.files("counterflex.robot.model") / "stiffness_data" / "published.toml"
    return tomllib.loads(file.read_text(encoding="utf-8"))


def arm_over_axis() -> Float:
    """(6,) stiffness of the spring that stands for the whole arm over that of gear and shaft alone.

    So much of the compliance is that of the gear, in which play and friction of the axis hold a twist; the rest is
    tilting and bending beyond, which follows the load.
    """
    return np.array(_data()["arm_over_axis"], dtype=np.float64)


@functools.cache
def published() -> tuple[PublishedStiffness, ...]:
    """All published sets, those that see the axis alone brought to the whole arm by ``arm_over_axis``."""
    data, ratio = _data(), arm_over_axis()
    out = []
    for row in data["rows"]:
        k = np.array(row["stiffness_nm_per_rad"], dtype=np.float64)
        k = np.where(k > 0.0, k, np.nan) * (ratio if row["covers"] == "axis" else 1.0)
        used = bool(row.get("use", True))
        out.append(
            PublishedStiffness(
                row["robot"], float(row["payload_kg"]), float(row["reach_mm"]) * MM, frozen(k), row["source"], used
            )
        )
    return tuple(out)


def class_prior(
    payload_kg: float | None, reach_m: float, rows: Sequence[PublishedStiffness] | None = None
) -> ClassPrior:
    """The prior of a robot.

    Args:
        payload_kg: Rated payload, or None where it is not known.
        reach_m: Reach: distance of the wrist centre from axis 1 with the arm stretched out.
        rows: What to make it from; None is everything published that is used.

    Raises:
        InputError: The payload is not known or outside the range in which the class says anything.
    """
    low, high = PAYLOAD_KG
    if payload_kg is None or not low <= payload_kg <= high:
        raise InputError(
            "the payload of the robot is not known: there is no class to compare it with"
            if payload_kg is None
            else "no robot of its class has a published stiffness",
            value=None if payload_kg is None else f"payload {payload_kg:g} kg",
            limit=f"{low:g} to {high:g} kg (published: 210 to 500 kg)",
        )
    used = [row for row in (published() if rows is None else rows) if row.used]
    types = tuple(dict.fromkeys(row.robot for row in used))
    sizes = {row.robot: row.payload_kg * row.reach_m for row in used}
    size = np.log([sizes[name] for name in types])
    exponent, doubt = EXPONENT
    k = np.array([_mean([np.log(row.stiffness_nm_per_rad) for row in used if row.robot == name]) for name in types])
    off = k - exponent * size[:, None]
    known = np.isfinite(off)
    count = known.sum(axis=0)
    mean = np.nanmean(off, axis=0)
    residual = np.where(known, off - mean, 0.0)
    freedom = count - 1.0
    variance = np.sum(residual**2, axis=0) / freedom
    typical = np.sum(freedom * variance) / np.sum(freedom)
    moderated = (freedom * variance + _WEIGHT_OF_MEAN * typical) / (freedom + _WEIGHT_OF_MEAN)
    wide = scipy.special.stdtrit(freedom + _WEIGHT_OF_MEAN, 0.5 + 0.5 * _INSIDE) / _NORMAL
    here = float(np.log(payload_kg * reach_m))
    log_sigma = np.sqrt(moderated * (1.0 + 1.0 / count) * wide**2 + (doubt * (here - size.mean())) ** 2)
    return ClassPrior(
        payload_kg=payload_kg,
        reach_m=reach_m,
        median_nm_per_rad=frozen(np.exp(mean + exponent * here)),
        log_sigma=frozen(log_sigma),
        common=_common(residual / np.sqrt(moderated), known),
        types=types,
    )


def _mean(rows: Sequence[Float]) -> Float:
    """Mean of the rows, nan where no row is known."""
    stack = np.array(rows)
    known = np.isfinite(stack)
    count = known.sum(axis=0)
    out: Float = np.where(count > 0, np.where(known, stack, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)
    return out


def _common(z: Float, known: Bool) -> float:
    """Mean correlation of two axes of one robot, at least 0."""
    pairs = [(i, j) for i in range(AXES) for j in range(i)]
    products = sum(float(z[:, i] @ z[:, j]) for i, j in pairs)
    # Residuals about the mean of n types have lost 1/n of each product.
    count = sum(float(np.sum(known[:, i] & known[:, j])) for i, j in pairs) * (1.0 - 1.0 / len(z))
    return min(max(products / count, 0.0), 0.9)
