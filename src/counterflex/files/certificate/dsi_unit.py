r"""Units of D-SI, the machine-readable SI of calibration certificates: ``\milli\metre``, ``\newton\metre\tothe{-1}``.

Grammar: SmartCom D-SI 1.3, doi:10.5281/zenodo.3816686, sections 3 and 4: prefix, unit and exponent as words behind
backslashes; ``\per`` divides by the one unit behind it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from counterflex.core import units as u
from counterflex.core.errors import FileFormatError

BASE: Final = ("m", "kg", "s", "A", "K", "rad")
"""Base units of a :class:`Unit`; the angle counts, so that N m is not N m/rad."""
_PREFIXES: Final = {
    "quecto": -30, "ronto": -27, "yocto": -24, "zepto": -21, "atto": -18, "femto": -15, "pico": -12, "nano": -9,
    "micro": -6, "milli": -3, "centi": -2, "deci": -1, "deca": 1, "hecto": 2, "kilo": 3, "mega": 6, "giga": 9,
    "tera": 12, "peta": 15, "exa": 18, "zetta": 21, "yotta": 24, "ronna": 27, "quetta": 30,
}  # fmt: skip
"""Power of ten of a prefix."""
_UNITS: Final[dict[str, tuple[float, tuple[int, ...]]]] = {
    "one": (1.0, (0, 0, 0, 0, 0, 0)),
    "percent": (u.PERCENT, (0, 0, 0, 0, 0, 0)),
    "ppm": (u.MICRO, (0, 0, 0, 0, 0, 0)),
    "metre": (1.0, (1, 0, 0, 0, 0, 0)),
    "kilogram": (1.0, (0, 1, 0, 0, 0, 0)),
    "gram": (u.GRAM, (0, 1, 0, 0, 0, 0)),
    "second": (1.0, (0, 0, 1, 0, 0, 0)),
    "minute": (u.MINUTE, (0, 0, 1, 0, 0, 0)),
    "hour": (60.0 * u.MINUTE, (0, 0, 1, 0, 0, 0)),
    "hertz": (1.0, (0, 0, -1, 0, 0, 0)),
    "ampere": (1.0, (0, 0, 0, 1, 0, 0)),
    "kelvin": (1.0, (0, 0, 0, 0, 1, 0)),
    "radian": (1.0, (0, 0, 0, 0, 0, 1)),
    "degree": (u.DEG, (0, 0, 0, 0, 0, 1)),
    "arcminute": (u.DEG / 60.0, (0, 0, 0, 0, 0, 1)),
    "arcsecond": (u.DEG / 3600.0, (0, 0, 0, 0, 0, 1)),
    "newton": (1.0, (1, 1, -2, 0, 0, 0)),
    "pascal": (1.0, (-1, 1, -2, 0, 0, 0)),
    "joule": (1.0, (2, 1, -2, 0, 0, 0)),
    "watt": (1.0, (2, 1, -3, 0, 0, 0)),
    "volt": (1.0, (2, 1, -3, -1, 0, 0)),
    "ohm": (1.0, (2, 1, -3, -2, 0, 0)),
    "coulomb": (1.0, (0, 0, 1, 1, 0, 0)),
}
"""SI value and exponents of :data:`BASE`. Degree Celsius is left out: it has a zero of its own."""
_TERM: Final = re.compile(
    rf"(?P<per>\\per(?=\\))?(?:\\(?P<prefix>{'|'.join(_PREFIXES)})(?=\\))?\\(?P<unit>[a-z]+)"
    r"(?:\\tothe\{(?P<power>-?\d+(?:\.\d+)?)\})?"
)


@dataclass(frozen=True)
class Unit:
    """A unit."""

    factor: float  # SI value of one of it
    exponents: tuple[int, ...]  # Of :data:`BASE`

    @property
    def si(self) -> str:
        """The unit in base units, for messages: ``m kg s^-2``."""
        parts = [f"{name}{'' if n == 1 else f'^{n}'}" for name, n in zip(BASE, self.exponents, strict=True) if n]
        return " ".join(parts) or "1"


def parse_unit(text: str, where: str) -> Unit:
    r"""A unit as D-SI writes it.

    Args:
        text: Such as ``\milli\newton\metre``.

    Raises:
        FileFormatError: Not D-SI, or a unit that is not known here.
    """
    factor, exponents, end = 1.0, [0] * len(BASE), 0
    for term in _TERM.finditer(text):
        power = float(term["power"] or 1.0)
        if term.start() != end or term["unit"] not in _UNITS or not power.is_integer():
            raise _fault(text, where)
        size, dims = _UNITS[term["unit"]]
        size *= 10.0 ** _PREFIXES.get(term["prefix"], 0)
        whole = -int(power) if term["per"] else int(power)
        factor *= size**whole
        exponents = [n + whole * d for n, d in zip(exponents, dims, strict=True)]
        end = term.end()
    if not text or end != len(text):
        raise _fault(text, where)
    return Unit(factor, tuple(exponents))


def _fault(text: str, where: str) -> FileFormatError:
    return FileFormatError(
        "the unit is not understood", where=where, value=text[:60] or "none",
        limit=r"D-SI, such as \newton or \milli\metre", hint=r"Units of other systems and \degreecelsius are not read",
    )  # fmt: skip


DSI_OF: Final[dict[str, str]] = {
    "1": r"\one",
    "%": r"\percent",
    "m": r"\metre",
    "mm": r"\milli\metre",
    "um": r"\micro\metre",
    "rad": r"\radian",
    "mrad": r"\milli\radian",
    "deg": r"\degree",
    "s": r"\second",
    "ms": r"\milli\second",
    "1/s": r"\second\tothe{-1}",
    "Hz": r"\hertz",
    "1/K": r"\kelvin\tothe{-1}",
    "kg": r"\kilogram",
    "kg m2": r"\kilogram\metre\tothe{2}",
    "N": r"\newton",
    "N/s": r"\newton\second\tothe{-1}",
    "N/K": r"\newton\kelvin\tothe{-1}",
    "N m": r"\newton\metre",
    "N m/s": r"\newton\metre\second\tothe{-1}",
    "N m/K": r"\newton\metre\kelvin\tothe{-1}",
    "N m s/rad": r"\newton\metre\second\radian\tothe{-1}",
    "N/mm": r"\newton\milli\metre\tothe{-1}",
    "N/mm2": r"\newton\milli\metre\tothe{-2}",
    "Pa": r"\pascal",
    "1/N": r"\newton\tothe{-1}",
    "1/(N m)": r"\newton\tothe{-1}\metre\tothe{-1}",
    "um/kN": r"\micro\metre\kilo\newton\tothe{-1}",
    "urad/kN": r"\micro\radian\kilo\newton\tothe{-1}",
    "urad/kNm": r"\micro\radian\kilo\newton\tothe{-1}\metre\tothe{-1}",
    "m/s": r"\metre\second\tothe{-1}",
    "mm/s": r"\milli\metre\second\tothe{-1}",
    "deg/s": r"\degree\second\tothe{-1}",
    "rad/s": r"\radian\second\tothe{-1}",
}
"""D-SI of a unit as results of an identification name it."""


def dsi_of(unit: str, where: str) -> str:
    """D-SI of a unit of a result.

    Args:
        unit: As ``result.json`` has it.

    Raises:
        FileFormatError: A unit without an entry in :data:`DSI_OF`.
    """
    if unit not in DSI_OF:
        raise FileFormatError(
            "no D-SI form of this unit is known", where=where, value=unit or "none", limit="; ".join(DSI_OF)
        )
    return DSI_OF[unit]
