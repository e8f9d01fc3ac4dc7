"""Drives, dry friction and play of robots of which none was measured, from published robots: values and spread.

Far fewer are published than stiffnesses, so the spreads are wide. Loop gains are ratios to the lowest mode of the robot
with drives that stand still (omega), so that they hold for robots of each size; torques of friction are in proportion
to payload times reach of the KR 300 R2500 ultra, to which the published figures belong; angles do not scale.

- **Speed loop** ``K``: yields as much as the drives' part of the damping ratio of the lowest mode says, which is
  ``sum_a s_a k_a / (2 omega K_a)`` with ``s_a`` the share of the spring of axis a in the strain energy. Its median is
  :data:`DAMPING_RATIO`; the gains of the axes have the published ratios (:data:`SPEED_GAIN_SHARE`).
- **Position loop** ``Kv``: 0.2 to 0.3 of omega (Weck and Brecher, Werkzeugmaschinen 3); the one published gain, 10 1/s,
  is 0.2 of the 8 Hz of its robot.
- **Integral time**: ``2 / omega``, at which the integral part turns the phase of the mode by 27 deg; a judgement.
- **Friction**: the torque that an axis needs at low speed, published for motor and gear together; half of it is taken
  to act on the motor's side, half behind the gear, since no source tells them apart.
- **Play**: half of the 30 urad that the published controller compensates; encoders before and behind the gears show 6
  to 61 urad at a reversal, which holds play and the twist that friction leaves. The angle over which friction turns
  round is of that size too.

What drives yield is one of many errors of a part, which add in squares, so correcting by its mean over the class leaves
least: the gains that a plan takes are the median over ``exp(sigma^2 / 2)``. Of friction and play the mean is 9 and 25 %
above the median, less than one robot's figures are good for: their medians are taken.

Sources: Weigand et al., IROS 2021, github JonasWeigand/Robot_Identification 9e403c07 (MIT): ``J_mr``, gear ratios
``u``, ``K_vel``, ``K_pos``, ``q_back`` and friction; recording A for the reversals. Modal tests on milling robots:
:mod:`counterflex.plan.lowest_mode`. Check: a KR 300 whose drives were not known left 0.255 instead of 0.114 mm of
1.65 mm (Haehn and Weigold 2020), so they made 14 % of the deflection; a step of force on the planned drives makes 14 %.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import URAD
from counterflex.robot.model.description import Play, Servo

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
PLAY_FACTOR: Final = 3.0
_NORMAL: Final = NormalDist().inv_cdf(0.95)


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

    @property
    def play_log_sigma(self) -> float:
        """Standard deviation of the logarithm of what play and friction make the axes lose."""
        return math.log(PLAY_FACTOR) / _NORMAL

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
            axis: Number.
            share: Of the compliance of the axis that is the gear's, in which friction holds a twist; less than 1 for a
                spring that stands for the whole arm.
        """
        dry = (1.0 - _AT_MOTOR) * share * float(self.friction_nm[axis])
        return Play(HALF_BAND_RAD, (dry,), (SLIP_RAD,))
