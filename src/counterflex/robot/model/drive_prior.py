"""Drives, dry friction and play of robots of which none was measured, from published robots: median and spread.

Far fewer are published than stiffnesses, so the spreads are wide and part of each median is a rule of commissioning.
With ``s = payload * reach`` over that of the KR 300 R2500 ultra, to which the published figures belong:

- **Speed loop** ``K = J_total w s``. Behind its gear a rotor of axes 1 to 3 has ``J_motor u^2`` (:data:`ROTOR_KG_M2`),
  arm and rotor together :data:`TOTAL_OVER_ROTOR` of that. Its bandwidth w lies between four times the gain of the
  position loop, below which the cascade overshoots, and the frequency ``sqrt(k / J_rotor)`` at which the rotor swings
  on its gear, beyond which a loop cannot be closed: 40 and 111 1/s with the published gains and gears, their mean 67.
  The wrist has the published share (:data:`WRIST_SHARE`) of the mean gain of axes 1 to 3.
- **Position loop** ``Kv``: 0.2 to 0.3 of the lowest mode (Weck and Brecher, Werkzeugmaschinen 3), for modes of milling
  robots of 5.5 to 15 Hz; 10 1/s is the one published gain.
- **Integral time**: three times the time of the speed loop, ``3 / w``.
- **Friction**: the torque that an axis needs at low speed, published for motor and gear together; half of it is taken
  to act on the motor's side, half behind the gear, since no source tells them apart.
- **Play**: half of the 30 urad that the published controller compensates; encoders before and behind the gears show 6
  to 61 urad at a reversal, which holds play and the twist that friction leaves. The angle over which friction turns
  round is of that size too.

Sources: Weigand et al., IROS 2021, github JonasWeigand/Robot_Identification 9e403c07 (MIT): ``J_mr``, gear ratios
``u``, ``K_vel``, ``K_pos``, ``q_back`` and friction; recording A for the reversals. Moberg, Oehr and Gunnarsson 2009, A
benchmark problem for robust feedback control of a flexible manipulator: arm over rotor. Haehn and Weigold 2020, table
1: gear stiffness. Angles do not scale with the size of a robot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MS, URAD
from counterflex.robot.model.description import Play, Servo

FRICTION_NM: Final = (318.6, 420.7, 291.5, 93.6, 124.9, 87.7)
"""Dry friction of the axes of a KR 300 R2500 ultra SE: identified level of github JonasWeigand/Robot_Identification
(data_ref.mat; the larger of the two Coulomb terms for axes 1 to 3, their sum for the wrist)."""
REFERENCE_KG_M: Final = 300.0 * 2.496
"""Payload times reach of that robot."""
ROTOR_KG_M2: Final = (609.0, 844.0, 751.0)
"""``J_mr u^2`` of its axes 1 to 3; for the wrist the source repeats one figure, which is none."""
TOTAL_OVER_ROTOR: Final = 4.8
"""Geometric mean of 2.5 (payload and arm of the KR 300 half stretched) and 9.4 (Moberg: 0.042 and 0.005 kg m2)."""
BANDWIDTH_PER_S: Final = 67.0
"""w; see the module."""
WRIST_SHARE: Final = (0.066, 0.077, 0.032)
"""``K_vel u^2`` of axes 4 to 6 over the mean of axes 1 to 3."""
POSITION_GAIN_PER_S: Final = 14.0
INTEGRAL_TIME_S: Final = 45.0 * MS
HALF_BAND_RAD: Final = 15.0 * URAD
SLIP_RAD: Final = 40.0 * URAD
_AT_MOTOR: Final = 0.5

# Nine of ten robots lie between median / factor and median * factor.
SPEED_GAIN_FACTOR: Final = 4.0
"""The range of w and of the total inertia; the gain that the source states is 6 times the median."""
POSITION_GAIN_FACTOR: Final = 2.0
FRICTION_FACTOR: Final = 2.0
PLAY_FACTOR: Final = 3.0
_NORMAL: Final = NormalDist().inv_cdf(0.95)


@dataclass(frozen=True)
class DrivePrior:
    """Prior of drives, friction and play of a robot of a class."""

    payload_kg: float  # rated payload
    reach_m: float

    @property
    def size(self) -> float:
        """Payload times reach over that of the robot which the published figures belong to."""
        return self.payload_kg * self.reach_m / REFERENCE_KG_M

    @property
    def friction_nm(self) -> Float:
        """(6,) N m, median of the dry friction of motor and gear together, behind the gear."""
        return np.array(FRICTION_NM) * self.size

    @property
    def speed_gain_nm_s(self) -> Float:
        """(6,) N m s/rad, median of the gains of the speed loops, behind the gear."""
        arm = np.array(ROTOR_KG_M2) * TOTAL_OVER_ROTOR * BANDWIDTH_PER_S
        return np.concatenate([arm, np.mean(arm) * np.array(WRIST_SHARE)]) * self.size

    @property
    def yield_log_sigma(self) -> float:
        """Standard deviation of the logarithm of how far a motor yields, that of ``1 / (K Kv)``."""
        return math.hypot(math.log(SPEED_GAIN_FACTOR), math.log(POSITION_GAIN_FACTOR)) / _NORMAL

    @property
    def play_log_sigma(self) -> float:
        """Standard deviation of the logarithm of what play and friction make the axes lose."""
        return math.log(PLAY_FACTOR) / _NORMAL

    def servo(self, axis: int) -> Servo:
        """Return the median loop gains and friction on the motor's side of an axis 0..5."""
        return Servo(
            speed_gain_nm_s=float(self.speed_gain_nm_s[axis]),
            position_gain_per_s=POSITION_GAIN_PER_S,
            integral_time_s=INTEGRAL_TIME_S,
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
