"""Units that a dataset may be written in, and their SI values; spellings as laboratories write them."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any, Final

from counterflex.core import units as u
from counterflex.core.errors import FileFormatError

UNITS: Final[dict[str, dict[str, float]]] = {
    "m": {"m": 1.0, "mm": u.MM, "um": u.UM, "inch": u.INCH},
    "rad": {"rad": 1.0, "deg": u.DEG, "gon": u.GON, "mrad": u.MRAD, "urad": u.URAD},
    "N": {"N": 1.0, "kN": u.KN, "daN": u.DECA, "lbf": u.LBF, "ozf": u.OZF, "kgf": u.KGF},
    "N m": {"N m": 1.0, "N mm": u.N_MM, "kN m": u.KN, "lbf in": u.LBF * u.INCH, "lbf ft": u.LBF * u.FOOT},
    "s": {"s": 1.0, "ms": u.MS, "us": u.US, "ns": u.NS, "min": u.MINUTE},
    "1": {"1": 1.0, "%": u.PERCENT, "um/m": u.MICRO},
    "kg": {"kg": 1.0, "g": u.GRAM},
    "degC": {"degC": 1.0},
    "V": {"V": 1.0, "mV": u.MV},
    "V/V": {"V/V": 1.0, "mV/V": u.MV},
    "A": {"A": 1.0},
    "Hz": {"Hz": 1.0},
    "m/s": {"m/s": 1.0, "mm/s": u.MM_PER_S, "mm/min": u.MM_PER_MIN},
    "m/s2": {"m/s2": 1.0, "mm/s2": u.MM, "g": u.STANDARD_GRAVITY},
    "rad/s": {"rad/s": 1.0, "deg/s": u.DEG_PER_S, "rpm": u.RPM},
    "Pa": {"Pa": 1.0, "N/mm2": u.N_PER_MM2, "MPa": u.N_PER_MM2},
    "m/N": {"m/N": 1.0, "um/kN": u.UM_PER_KN, "um/N": u.UM},
}
"""SI value of one unit, by SI unit and name."""

RAW: Final = frozenset({"V", "mV", "V/V", "mV/V", "counts", "digits", "LSB", "A", "mA"})
"""Units of what an amplifier or converter gives: strain gauges are in them, all else needs a factor."""
_SPELLINGS: Final = {
    **dict.fromkeys(("lb", "lbs", "lb-f", "pound", "pounds", "pound-force"), "lbf"),
    **dict.fromkeys(("oz", "ozs"), "ozf"),
    **dict.fromkeys(("kp", "kg-f"), "kgf"),
    **dict.fromkeys(("lbf-in", "lbf*in", "lbf·in", "in-lbf", "in lbf", "in-lb", "lb-in", "lb in", "lbin"), "lbf in"),
    **dict.fromkeys(("lbf-ft", "lbf*ft", "lbf·ft", "ft-lbf", "ft lbf", "ft-lb", "lb-ft", "lb ft"), "lbf ft"),
    **dict.fromkeys(("count", "counts", "cnt", "cnts", "adc", "adc counts", "increments", "ticks"), "counts"),
    **dict.fromkeys(("volt", "volts"), "V"),
    **dict.fromkeys(("digit", "digits"), "digits"),
    "lsb": "LSB",
    "dan": "daN",
    "nm": "N m",
    "n*m": "N m",
    "n·m": "N m",
    "n.m": "N m",
    "n m": "N m",
    "nmm": "N mm",
    "knm": "kN m",
}
_BRACKETS: Final = re.compile(r"[\[(]\s*([^\[\]()]*?)\s*[\])]\s*$")
_SUFFIX: Final = re.compile(r"_(mm|um|deg|mrad|urad|rad|kn|nm|ms|us|rpm|counts)$")
_KNOWN: Final = RAW.union(*UNITS.values())
SHOP_SUFFIX: Final[Mapping[str, tuple[str, float]]] = {
    "_mm": ("_m", u.MM),
    "_um": ("_m", u.UM),
    "_deg": ("_rad", u.DEG),
    "_mrad": ("_rad", u.MRAD),
    "_urad": ("_rad", u.URAD),
    "_ms": ("_s", u.MS),
    "_rpm": ("_rad_s", u.RPM),
    "_mm_s": ("_m_s", u.MM_PER_S),
    "_mm_min": ("_m_s", u.MM_PER_MIN),
    "_mm_s2": ("_m_s2", u.MM),
    "_deg_s": ("_rad_s", u.DEG_PER_S),
    "_n_mm2": ("_pa", u.N_PER_MM2),
}
"""SI suffix and factor of shop suffixes in names of settings."""
WRITTEN_SUFFIX: Final[Mapping[str, tuple[str, float]]] = {
    "_m": ("_mm", u.MM),
    "_rad": ("_deg", u.DEG),
    "_rad_s": ("_deg_s", u.DEG_PER_S),
    "_m_s": ("_mm_s", u.MM_PER_S),
    "_m_s2": ("_mm_s2", u.MM),
    "_pa": ("_n_mm2", u.N_PER_MM2),
}
"""Shop suffix that is written for an SI suffix, and its factor."""


def plain(unit: str) -> str:
    """A unit as :data:`UNITS` spells it, from what people write: ``Nm``, ``µm``, ``°``, ``°C``, ``mm/s²``."""
    text = " ".join(unit.split()).replace("µ", "u").replace("μ", "u").replace("²", "2").replace("^2", "2")
    if text in ("°", "degree", "degrees", "Grad"):
        return "deg"
    if text in ("°C", "C", "deg C"):
        return "degC"
    if text in ("-", ""):
        return "1"
    return _SPELLINGS.get(text.lower(), text)


def factor(unit: str, si: str, where: str) -> float:
    """SI value of one unit.

    Args:
        si: SI unit of the quantity.

    Raises:
        FileFormatError: Not a unit of this quantity.
    """
    known = UNITS.get(si, {si: 1.0})
    result = known.get(plain(unit))
    if result is None:
        raise FileFormatError(
            "the unit is not one of this quantity", where=where, value=repr(unit), limit=", ".join(known),
            hint=f'Say how much one of them is: unit = "{si}" and factor = {si} by {plain(unit)}'
            if plain(unit) in RAW else None,
        )  # fmt: skip
    return result


def in_header(header: str) -> str | None:
    """Unit that a column's header states in brackets (``Fx [N]``, ``x (mm)``) or as a suffix (``x_mm``), or None."""
    match = _BRACKETS.search(header)
    if match:
        unit = plain(match[1])
        return unit if unit in _KNOWN and match[1] else None
    suffix = _SUFFIX.search(header.lower())
    if suffix is None:
        return None
    return {"kn": "kN", "nm": "N m"}.get(suffix[1], suffix[1])


def of_another_quantity(header: str, si: str) -> bool:
    """Return whether a header states in brackets a unit that the quantity cannot have; ``(1)`` is a number."""
    unit = in_header(header)
    return bool(_BRACKETS.search(header)) and unit not in (None, "1", *UNITS.get(si, {}))


def settings_si(key: str, value: Any) -> tuple[str, Any]:
    """SI name and value of a setting: ``length_mm = 5`` is ``length_m = 0.005``."""
    for suffix in sorted(SHOP_SUFFIX, key=len, reverse=True):
        if key.endswith(suffix):
            to, unit = SHOP_SUFFIX[suffix]
            return key.removesuffix(suffix) + to, _scaled(value, unit)
    return key, value


def settings_shop(key: str, value: Any) -> tuple[str, Any]:
    """Name and value of a setting as it is written: ``length_m = 0.005`` is ``length_mm = 5``."""
    for suffix in sorted(WRITTEN_SUFFIX, key=len, reverse=True):
        if key.endswith(suffix):
            to, unit = WRITTEN_SUFFIX[suffix]
            return key.removesuffix(suffix) + to, _divided(value, unit)
    return key, _divided(value, 1.0)


def _scaled(value: Any, unit: float) -> Any:
    if isinstance(value, list | tuple):
        return [_scaled(item, unit) for item in value]
    return value * unit if isinstance(value, int | float) and not isinstance(value, bool) else value


def _divided(value: Any, unit: float) -> Any:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_divided(item, unit) for item in value]
    if isinstance(value, bool | str) or (isinstance(value, int) and unit == 1.0):
        return value
    return float(f"{value / unit:.12g}")


def toml_line(value: Any) -> str:
    """A plain value as TOML in one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_line(item) for item in value) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return repr(value)
