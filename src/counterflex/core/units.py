"""The only conversion factors of the project: multiply a shop value by its factor to get SI.

Inside counterflex every quantity is SI (m, rad, s, N, N m, kg). Shop units live at the edge: files, programs,
command line, reports. ``x_m = x_mm * MM``, ``x_mm = x_m / MM``.
"""

from __future__ import annotations

import math
from typing import Final

MM: Final = 1e-3  # m
UM: Final = 1e-6  # m
INCH: Final = 25.4e-3  # m
DEG: Final = math.pi / 180.0  # rad
GON: Final = math.pi / 200.0  # rad
URAD: Final = 1e-6  # rad
MRAD: Final = 1e-3  # rad
MINUTE: Final = 60.0  # s
MS: Final = 1e-3  # s
RPM: Final = 2.0 * math.pi / 60.0  # rad/s
MM_PER_MIN: Final = MM / MINUTE  # m/s
MM_PER_S: Final = MM  # m/s
N_PER_MM2: Final = 1e6  # Pa
GPA: Final = 1e9  # Pa
N_PER_MM: Final = 1e3  # N/m
URAD_PER_KNM: Final = 1e-9  # rad/(N m)
UM_PER_KN: Final = 1e-9  # m/N
KN: Final = 1e3  # N
DECA: Final = 10.0
LBF: Final = 4.4482216152605  # N, 0.45359237 kg at standard gravity
OZF: Final = LBF / 16.0  # N
KGF: Final = 9.80665  # N
FOOT: Final = 0.3048  # m
N_MM: Final = 1e-3  # N m
US: Final = 1e-6  # s
NS: Final = 1e-9  # s
GRAM: Final = 1e-3  # kg
MV: Final = 1e-3  # V
PERCENT: Final = 1e-2
MICRO: Final = 1e-6
DEG_PER_S: Final = DEG  # rad/s
STANDARD_GRAVITY: Final = 9.80665  # m/s2
