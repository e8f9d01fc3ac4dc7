"""Values as people read them: the shop unit of an SI unit."""

from __future__ import annotations

from typing import Final

from counterflex.core import units as u

SHOP: Final[dict[str, tuple[str, float]]] = {
    "m": ("mm", u.MM),
    "rad": ("mrad", u.MRAD),
    "m/N": ("um/kN", u.UM_PER_KN),
    "rad/(N m)": ("urad/kNm", u.URAD_PER_KNM),
    "rad/N": ("urad/kN", u.MICRO / u.KN),
    "Pa": ("N/mm2", u.N_PER_MM2),
    "N/m": ("N/mm", u.N_PER_MM),
    "s": ("ms", u.MS),
    "m/s": ("mm/s", u.MM_PER_S),
    "rad/s": ("deg/s", u.DEG_PER_S),
}
"""Shop unit and its SI value, by SI unit; other units are shown as they are."""


def shop(unit: str) -> tuple[str, float]:
    """Shop unit of an SI unit and the SI value of one of it."""
    return SHOP.get(unit, (unit, 1.0))


_OF_NAMES: Final[dict[str, str]] = {
    "_mm": "mm",
    "_um": "um",
    "_urad": "urad",
    "_mrad": "mrad",
    "_deg": "deg",
    "_n": "N",
    "_nm": "N m",
    "_percent": "%",
    "_s": "s",
    "_ms": "ms",
    "_us": "us",
    "_hz": "Hz",
    "_kg": "kg",
    "_g": "g",
    "_n_mm2": "N/mm2",
    "_um_per_kn": "um/kN",
    "_urad_per_knm": "urad/kNm",
    "_per_s": "1/s",
    "_mm_s": "mm/s",
    "_um_m": "um/m",
    "_degc": "degC",
    "_c": "degC",
}


def unit_of_name(name: str) -> str:
    """Unit that the name of a figure ends with: ``holdout_mean_mm`` is in mm; empty for counts and ratios."""
    for suffix in sorted(_OF_NAMES, key=len, reverse=True):
        if name.endswith(suffix):
            return _OF_NAMES[suffix]
    return ""
