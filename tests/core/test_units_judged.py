"""Conversion factors against those of another library, which takes them from CODATA and NIST."""

from __future__ import annotations

import math

import pytest
from scipy import constants

from counterflex.core import units

KNOWN = {
    "MM": constants.milli,
    "UM": constants.micron,
    "INCH": constants.inch,
    "DEG": constants.degree,
    "URAD": constants.micro,
    "MRAD": constants.milli,
    "MINUTE": constants.minute,
    "MS": constants.milli,
    "RPM": 360.0 * constants.degree / constants.minute,
    "MM_PER_MIN": constants.milli / constants.minute,
    "MM_PER_S": constants.milli,
    "N_PER_MM2": constants.mega,
    "N_PER_MM": 1.0 / constants.milli,
    "URAD_PER_KNM": constants.micro / constants.kilo,
    "UM_PER_KN": constants.micron / constants.kilo,
    "KN": constants.kilo,
    "DECA": constants.deka,
    "LBF": constants.lbf,
    "OZF": constants.ounce * constants.g,
    "KGF": constants.kgf,
    "FOOT": constants.foot,
    "GPA": constants.giga,
    "N_MM": constants.milli,
    "US": constants.micro,
    "NS": constants.nano,
    "GRAM": constants.gram,
    "MV": constants.milli,
    "PERCENT": constants.centi,
    "MICRO": constants.micro,
    "DEG_PER_S": constants.degree,
    "GON": math.pi / 200.0,
    "STANDARD_GRAVITY": constants.g,
}


def test_every_factor_is_judged() -> None:
    assert {name for name, value in vars(units).items() if isinstance(value, float)} == set(KNOWN)


@pytest.mark.parametrize("name", sorted(KNOWN))
def test_factor(name: str) -> None:
    assert math.isclose(getattr(units, name), KNOWN[name], rel_tol=1e-15)
