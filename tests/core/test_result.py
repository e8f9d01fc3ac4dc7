"""Results: what their texts and tables show of their values, and what they refuse."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

import pytest
from hypothesis import given, strategies as st

from counterflex.core.result import Lines, Part, PlainLine, ShownTable, Summary, fill
from counterflex.core.units import DEG, MM, MM_PER_MIN, UM, plain


class Found(Summary):
    """Faces and how far off they are."""

    def _shown(self) -> Iterator[Part]:
        yield self.rows("faces", "Faces of {part}", "face | off um:.1f | held %=held!p:.0f~not known | ={why:why: %s}")
        yield from self.each("faces", "{face} in line {place[line]}")
        yield self.line("all of {part}: {all_mm[0]:.2f} to {all_mm[1]:.2f} mm")


VALUES: dict[str, Any] = {
    "part": "a {brace}",
    "all_mm": [0.1, 0.25],
    "faces": [
        {"face": "top", "off_um": 12.34, "held": 0.905, "why": "", "place": {"line": 3}},
        {"face": "side", "off_um": None, "held": None, "why": "no scan", "place": None},
    ],
}


def test_a_result_is_its_values_and_shows_them() -> None:
    found = Found(VALUES)
    assert found == VALUES == found.summary
    table, first, second, last = found.parts()
    assert isinstance(table, ShownTable)
    assert (table.title, table.columns) == ("Faces of a {brace}", ["face", "off um", "held %", ""])
    assert table.rows == [["top", "12.3", "90", ""], ["side", "", "not known", "why: no scan"]]
    assert (first, second, last) == ("top in line 3", "", "all of a {brace}: 0.10 to 0.25 mm")
    assert found.table["off_um"].to_list() == [12.34, None]
    assert repr(found).splitlines() == ["Faces of a {brace}", first, second, last]
    assert "<table" in found._repr_html_()


def test_a_value_that_is_not_there_is_an_error_unless_it_may_be_missing() -> None:
    with pytest.raises(KeyError):
        fill("{of}", {})
    assert fill("{of?:.1f}", {}, "none") == "none"
    with pytest.raises(TypeError):
        fill("{of[x]}", {"of": 3})


@given(st.lists(st.floats(-1e6, 1e6), min_size=1))
def test_a_list_is_written_number_by_number(values: list[float]) -> None:
    assert fill("{of:+.2f}", {"of": values}) == ", ".join(f"{value:+.2f}" for value in values)


@given(st.integers(-(10**12), 10**12))
def test_a_count_is_written_whole(value: int) -> None:
    assert fill("{of:g}", {"of": value}) == str(value)


def test_conversions() -> None:
    row = {"name": "no_force", "length": 1234.5678}
    assert fill("{name!w}, {length:D3}", row) == "no force, 1230"
    assert fill("{0}: {1}", ("a", 2)) == "a: 2"


def test_lines_are_templates_and_what_is_said_is_not() -> None:
    parts = list(Lines({"n": 2}, "{n} rows", PlainLine("{n} braces")).parts())
    assert parts == ["2 rows", "{n} braces"]


class Kind(Enum):
    """A kind."""

    NO_FORCE = 1


@dataclass
class Record:
    """Values in SI."""

    width_m: float = 0.0123456
    off_m: float = 0.0123456
    turn_rad: float = 0.5
    feed_m_s: float = 0.025
    share: float = 0.1234
    already_mm: float = 3.0
    kind: Kind = Kind.NO_FORCE
    nothing: None = None
    unknown_m: float = float("nan")
    ends_m: tuple[float, ...] = (0.001, 0.002)


def test_values_by_their_shop_names() -> None:
    """Each equals the conversion written out, bit by bit; what is in shop units already stays."""
    one = Record()
    names = (
        "width_mm:3 wide_um=off_m:1 turn_deg:2 feed_mm_min share_percent=share:1 already_mm kind nothing unknown_mm:1"
    )
    assert plain(one, f"{names} from=share ends_mm:4") == {
        "width_mm": round(one.width_m / MM, 3), "wide_um": round(one.off_m / UM, 1),
        "turn_deg": round(one.turn_rad / DEG, 2), "feed_mm_min": one.feed_m_s / MM_PER_MIN,
        "share_percent": round(100.0 * one.share, 1), "already_mm": 3.0, "kind": "no_force", "nothing": None,
        "unknown_mm": None, "from": 0.1234, "ends_mm": [1.0, 2.0],
    }  # fmt: skip
    with pytest.raises(AttributeError):
        plain(one, "height_mm")
