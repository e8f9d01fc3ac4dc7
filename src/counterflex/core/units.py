"""The only conversion factors of the project: multiply a shop value by its factor to get SI.

Inside counterflex every quantity is SI (m, rad, s, N, N m, kg). Shop units live at the edge: files, programs,
command line, reports. ``x_m = x_mm * MM``, ``x_mm = x_m / MM``.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import Any, Final

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

_SHOP: Final = {
    "mm_min": ("m_s", MM_PER_MIN), "mm2": ("m2", MM**2), "mm": ("m", MM), "um": ("m", UM), "deg": ("rad", DEG),
    "urad": ("rad", URAD), "ms": ("s", MS), "rpm": ("rad_s", RPM),
}  # fmt: skip
"""End of the SI name and SI value of one, by the end of a shop name."""


def plain(of: object, names: str) -> dict[str, Any]:
    """Values of an object as a summary holds them, by their shop names.

    Args:
        names: Of the values, with blanks between. ``width_mm:4`` is the attribute ``width_m`` in mm with four decimals,
            ``from=before`` the attribute ``before``, ``feed_percent=share:1`` a share in percent. Enumerations become
            their lower-case names, nan becomes None.
    """
    out = {}
    for declared in names.split():
        name, _, digits = declared.partition(":")
        name, _, attribute = name.partition("=")
        end = next((end for end in _SHOP if name.endswith(f"_{end}")), "")
        si, size = _SHOP.get(end, ("", 1.0))
        if not attribute:
            attribute = name if not end or hasattr(of, name) else name.removesuffix(end) + si
        factor = 100.0 if name.endswith("_percent") and not attribute.endswith("_percent") else 1.0
        out[name] = _plain(getattr(of, attribute), digits, size if attribute.endswith(f"_{si}") else 1.0, factor)
    return out


def _plain(value: Any, digits: str, size: float, factor: float) -> Any:
    if isinstance(value, Enum) and not isinstance(value, str):
        return value.name.lower()
    if isinstance(value, list | tuple) or getattr(value, "ndim", 0) == 1:
        return [_plain(one, digits, size, factor) for one in value]
    if value is None or (not digits and size == factor == 1.0):
        return value
    number = factor * float(value) / size
    return None if math.isnan(number) else round(number, int(digits)) if digits else number
