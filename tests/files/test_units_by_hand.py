"""Every unit, suffix and prefix against a value written out by hand in SI, none by the table that is judged."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, strategies as st

from counterflex.files.certificate.dsi_unit import DSI_OF, parse_unit
from counterflex.files.dataset import units
from counterflex.files.logs.tracker_exports.point_table import stamp_ns
from counterflex.files.shop_unit import SHOP, shop, unit_of_name

POUND_N = 0.45359237 * 9.80665
BY_HAND: dict[str, dict[str, float]] = {
    "m": {"m": 1.0, "mm": 0.001, "um": 0.000001, "inch": 0.0254},
    "rad": {"rad": 1.0, "deg": math.pi / 180, "gon": math.pi / 200, "mrad": 0.001, "urad": 0.000001},
    "N": {"N": 1.0, "kN": 1000.0, "daN": 10.0, "lbf": POUND_N, "ozf": POUND_N / 16, "kgf": 9.80665},
    "N m": {"N m": 1.0, "N mm": 0.001, "kN m": 1000.0, "lbf in": POUND_N * 0.0254, "lbf ft": POUND_N * 0.3048},
    "s": {"s": 1.0, "ms": 0.001, "us": 0.000001, "ns": 0.000000001, "min": 60.0},
    "1": {"1": 1.0, "%": 0.01, "um/m": 0.000001},
    "kg": {"kg": 1.0, "g": 0.001},
    "degC": {"degC": 1.0},
    "V": {"V": 1.0, "mV": 0.001},
    "V/V": {"V/V": 1.0, "mV/V": 0.001},
    "A": {"A": 1.0},
    "Hz": {"Hz": 1.0},
    "m/s": {"m/s": 1.0, "mm/s": 0.001, "mm/min": 0.001 / 60},
    "m/s2": {"m/s2": 1.0, "mm/s2": 0.001, "g": 9.80665},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": 2 * math.pi / 60},
    "Pa": {"Pa": 1.0, "N/mm2": 1e6, "MPa": 1e6},
    "m/N": {"m/N": 1.0, "um/kN": 1e-9, "um/N": 1e-6},
}
SETTINGS = {
    "x_mm": ("x_m", 0.001),
    "x_um": ("x_m", 0.000001),
    "x_deg": ("x_rad", math.pi / 180),
    "x_mrad": ("x_rad", 0.001),
    "x_urad": ("x_rad", 0.000001),
    "x_ms": ("x_s", 0.001),
    "x_rpm": ("x_rad_s", 2 * math.pi / 60),
    "x_mm_s": ("x_m_s", 0.001),
    "x_mm_min": ("x_m_s", 0.001 / 60),
    "x_mm_s2": ("x_m_s2", 0.001),
    "x_deg_s": ("x_rad_s", math.pi / 180),
    "x_n_mm2": ("x_pa", 1e6),
}
WRITTEN = {
    "x_m": ("x_mm", 1000.0),
    "x_rad": ("x_deg", 180 / math.pi),
    "x_rad_s": ("x_deg_s", 180 / math.pi),
    "x_m_s": ("x_mm_s", 1000.0),
    "x_m_s2": ("x_mm_s2", 1000.0),
    "x_pa": ("x_n_mm2", 1e-6),
}
SHOWN = {
    "m": ("mm", 0.001),
    "rad": ("mrad", 0.001),
    "m/N": ("um/kN", 1e-9),
    "rad/(N m)": ("urad/kNm", 1e-9),
    "rad/N": ("urad/kN", 1e-9),
    "Pa": ("N/mm2", 1e6),
    "N/m": ("N/mm", 1000.0),
    "s": ("ms", 0.001),
    "m/s": ("mm/s", 0.001),
    "rad/s": ("deg/s", math.pi / 180),
}
NAMES = {
    "a_mm": "mm", "a_um": "um", "a_urad": "urad", "a_mrad": "mrad", "a_deg": "deg", "a_n": "N", "a_nm": "N m",
    "a_percent": "%", "a_s": "s", "a_ms": "ms", "a_us": "us", "a_hz": "Hz", "a_kg": "kg", "a_g": "g",
    "a_n_mm2": "N/mm2", "a_um_per_kn": "um/kN", "a_urad_per_knm": "urad/kNm", "a_per_s": "1/s", "a_mm_s": "mm/s",
    "a_um_m": "um/m", "a_degc": "degC", "a_c": "degC", "plain": "",
}  # fmt: skip


def test_every_unit_of_data_is_written_out_here() -> None:
    assert {si: set(known) for si, known in units.UNITS.items()} == {si: set(known) for si, known in BY_HAND.items()}
    assert set(units.SHOP_SUFFIX) == {key.removeprefix("x") for key in SETTINGS}
    assert set(units.WRITTEN_SUFFIX) == {key.removeprefix("x") for key in WRITTEN}
    assert SHOP.keys() == SHOWN.keys()


@pytest.mark.parametrize(("si", "unit"), [(si, unit) for si, known in BY_HAND.items() for unit in known])
def test_a_unit_of_data(si: str, unit: str) -> None:
    assert units.factor(unit, si, "") == pytest.approx(BY_HAND[si][unit], rel=1e-12)


@pytest.mark.parametrize("key", SETTINGS)
def test_a_setting_in_shop_units_comes_back_as_it_was(key: str) -> None:
    name, scale = SETTINGS[key]
    si, value = units.settings_si(key, [2.0, -3])
    assert (si, value) == (name, pytest.approx([2.0 * scale, -3 * scale], rel=1e-12))
    assert units.settings_si(key, True) == (name, True)


@pytest.mark.parametrize("key", WRITTEN)
def test_a_setting_in_si_is_written_in_shop_units(key: str) -> None:
    name, scale = WRITTEN[key]
    assert units.settings_shop(key, 2.5) == (name, pytest.approx(2.5 * scale, rel=1e-11))
    assert units.settings_si(name, units.settings_shop(key, 2.5)[1])[1] == pytest.approx(2.5, rel=1e-11)


@pytest.mark.parametrize("unit", SHOWN)
def test_a_unit_of_reports(unit: str) -> None:
    name, scale = shop(unit)
    assert name == SHOWN[unit][0]
    assert scale == pytest.approx(SHOWN[unit][1], rel=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_the_unit_of_a_name_is_that_of_its_longest_suffix(name: str) -> None:
    assert unit_of_name(name) == NAMES[name]


DSI = {
    r"\one": 1.0, r"\percent": 0.01, r"\ppm": 1e-6, r"\metre": 1.0, r"\kilogram": 1.0, r"\gram": 1e-3,
    r"\second": 1.0, r"\minute": 60.0, r"\hour": 3600.0, r"\hertz": 1.0, r"\ampere": 1.0, r"\kelvin": 1.0,
    r"\radian": 1.0, r"\degree": math.pi / 180, r"\arcminute": math.pi / 10800, r"\arcsecond": math.pi / 648000,
    r"\newton": 1.0, r"\pascal": 1.0, r"\joule": 1.0, r"\watt": 1.0, r"\volt": 1.0, r"\ohm": 1.0, r"\coulomb": 1.0,
}  # fmt: skip
PREFIX = {
    "quecto": -30, "ronto": -27, "yocto": -24, "zepto": -21, "atto": -18, "femto": -15, "pico": -12, "nano": -9,
    "micro": -6, "milli": -3, "centi": -2, "deci": -1, "deca": 1, "hecto": 2, "kilo": 3, "mega": 6, "giga": 9,
    "tera": 12, "peta": 15, "exa": 18, "zetta": 21, "yotta": 24, "ronna": 27, "quetta": 30,
}  # fmt: skip


@pytest.mark.parametrize("unit", DSI)
def test_a_unit_of_certificates(unit: str) -> None:
    assert parse_unit(unit, "").factor == pytest.approx(DSI[unit], rel=1e-12)


@pytest.mark.parametrize("prefix", PREFIX)
def test_a_prefix_of_certificates(prefix: str) -> None:
    assert parse_unit(rf"\{prefix}\metre", "").factor == pytest.approx(10.0 ** PREFIX[prefix], rel=1e-12)


factor_of = st.sampled_from([r"\metre", r"\newton", r"\degree", r"\minute", r"\hertz", r"\pascal", r"\milli\metre"])


@given(st.lists(st.tuples(factor_of, st.integers(-3, 3).filter(bool), st.booleans()), min_size=1, max_size=5))
def test_a_product_of_units_is_the_product_of_each(parts: list[tuple[str, int, bool]]) -> None:
    """``per`` divides by the unit behind it and by no other."""
    text, factor, exponents = "", 1.0, [0] * 6
    for unit, power, below in parts:
        one = parse_unit(unit, "")
        text += (r"\per" if below else "") + unit + (rf"\tothe{{{power}}}" if power != 1 else "")
        signed = -power if below else power
        factor *= one.factor**signed
        exponents = [n + signed * d for n, d in zip(exponents, one.exponents, strict=True)]
    found = parse_unit(text, "")
    assert found.factor == pytest.approx(factor, rel=1e-12)
    assert found.exponents == tuple(exponents)


@pytest.mark.parametrize("unit", DSI_OF)
def test_a_written_unit_is_read_as_what_reports_show(unit: str) -> None:
    """The D-SI form of a shop unit has the size that the shop unit has by hand."""
    by_hand = {
        "urad/kN": 1e-9, "urad/kNm": 1e-9, "N/mm": 1e3, "N/mm2": 1e6, "um/kN": 1e-9, "mm": 1e-3, "um": 1e-6,
        "mrad": 1e-3, "deg": math.pi / 180, "ms": 1e-3, "mm/s": 1e-3, "deg/s": math.pi / 180, "%": 0.01,
    }  # fmt: skip
    assert parse_unit(DSI_OF[unit], "").factor == pytest.approx(by_hand.get(unit, 1.0), rel=1e-12)


@given(st.integers(0, 23), st.integers(0, 59), st.integers(0, 59), st.integers(0, 999_999_999), st.integers(1, 9))
def test_a_stamp_counts_every_digit_at_its_place(hour: int, minute: int, second: int, ns: int, digits: int) -> None:
    shown = f"{ns:09d}"[:digits]
    found = stamp_ns(f"{hour}:{minute:02d}:{second:02d}.{shown}", "")
    assert found == (3600 * hour + 60 * minute + second) * 10**9 + int(shown) * 10 ** (9 - digits)


@pytest.mark.parametrize("date", ["2026-05-12", "2026/05/12", "12.05.2026", "05/12/2026", "5/12/26"])
def test_a_date_is_the_same_day_in_every_form(date: str) -> None:
    """12 May 2026 is 20 585 days after 1970-01-01: 56 years of 365, 14 leap days, 31 + 28 + 31 + 30 + 11 days."""
    days = 56 * 365 + 14 + 31 + 28 + 31 + 30 + 11
    assert stamp_ns(f"{date} 00:00:01", "") == (days * 86_400 + 1) * 10**9
