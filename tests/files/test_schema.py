"""Tables of files: strict, with units in the keys, and one line for a fault."""

from __future__ import annotations

import math
import string
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import FileFormatError
from counterflex.files.cell.tables import CellTables, ToolTable
from counterflex.files.schema import (
    SOFTEST_UM_PER_KN,
    SOFTEST_URAD_PER_KNM,
    STIFFEST,
    ComplianceTable,
    PoseTable,
    check_header,
    parse,
    read_toml,
    write_toml,
)

TOOL: dict[str, Any] = {"number": 1, "diameter_mm": 16, "flutes": 3, "flute_length_mm": 35}
KEYS = [f"t{axis}_um_per_kn" for axis in "xyz"] + [f"r{axis}_urad_per_knm" for axis in "xyz"]
compliances = st.lists(
    st.one_of(st.none(), st.just(0.0), st.floats(STIFFEST, SOFTEST_UM_PER_KN)), min_size=6, max_size=6
)


@given(compliances)
def test_compliance_in_shop_units(values: list[float | None]) -> None:
    """A um/kN and a urad/kNm are both 1e-9 of the SI unit; what is not given keeps its value."""
    base = np.arange(1.0, 7.0) * 1e-7
    table = parse(ComplianceTable, {k: v for k, v in zip(KEYS, values, strict=True) if v is not None}, where="t")
    for value, si, kept in zip(values, table.over(base), base, strict=True):
        assert si == pytest.approx(kept if value is None else value * 1e-9, rel=1e-12)
    again = ComplianceTable(**ComplianceTable.of(table.over(np.zeros(6))))
    assert again.over(np.zeros(6)) == pytest.approx(table.over(np.zeros(6)), rel=1e-5)


@given(st.floats(1.01e-3, 1e6), st.sampled_from(KEYS[3:]))
def test_stiffness_is_recognised_and_converted(urad_per_knm: float, key: str) -> None:
    stiffness = 1e12 / urad_per_knm  # N mm/rad
    with pytest.raises(FileFormatError) as fault:
        parse(ComplianceTable, {"stiffness_" + key[:2]: stiffness}, where="cell.toml")
    assert f"{stiffness:g} N mm/rad is {urad_per_knm:.4g} urad/kNm" in str(fault.value)


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("factor", [1.001, 1e6])
def test_softest_and_stiffest(key: str, factor: float) -> None:
    softest = SOFTEST_UM_PER_KN if key[0] == "t" else SOFTEST_URAD_PER_KNM
    for value in (0.0, STIFFEST, softest):
        assert getattr(ComplianceTable(**{key: value}), key) == value
    for value, what in ((softest * factor, "large"), (STIFFEST / factor, "small"), (-1.0, "negative")):
        with pytest.raises(FileFormatError, match=f"t: {key} is .*{what}"):
            parse(ComplianceTable, {key: value}, where="t")


angles = st.floats(-180.0, 180.0)


@given(st.tuples(*[st.floats(-5e3, 5e3)] * 3), st.tuples(angles, angles, angles))
def test_pose_in_mm_and_kuka_angles(xyz: tuple[float, float, float], abc: tuple[float, float, float]) -> None:
    """A turns about z, then B about the new y, then C about the new x: columns of the product of the three."""
    keys = ("x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg")
    T = PoseTable(**dict(zip(keys, (*xyz, *abc), strict=True))).matrix()
    assert T[:3, 3] == pytest.approx(np.array(xyz) * 1e-3, abs=1e-12)
    a, b, c = (math.radians(angle) for angle in abc)
    x_axis = [math.cos(a) * math.cos(b), math.sin(a) * math.cos(b), -math.sin(b)]
    assert T[:3, 0] == pytest.approx(np.array(x_axis), abs=1e-12)
    assert T[2, 1:3] == pytest.approx(np.array([math.cos(b) * math.sin(c), math.cos(b) * math.cos(c)]), abs=1e-12)
    assert T[:3, :3] @ T[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)


names = st.text(string.ascii_lowercase + "_", min_size=1, max_size=8)
values = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False), st.integers(-(2**60), 2**60), st.text(max_size=20), st.booleans()
)


@given(st.dictionaries(names, st.one_of(values, st.lists(values, max_size=3), st.dictionaries(names, values))))
def test_toml_round_trip(tmp_path_factory: pytest.TempPathFactory, data: dict[str, Any]) -> None:
    path = tmp_path_factory.mktemp("toml") / "file.toml"
    write_toml(path, {"some": 1, **data}, comment="two\nlines")
    assert path.read_text(encoding="utf-8").startswith("# two\n# lines\n")
    assert read_toml(path) == {"some": 1, **data}


def test_toml_is_read_with_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "file.toml"
    path.write_bytes(b"\xef\xbb\xbfname = 'x'\r\n")
    assert read_toml(path) == {"name": "x"}


@pytest.mark.parametrize(
    ("data", "match"),
    [
        ({"version": 1}, "'format' is missing"),
        ({"format": "other", "version": 1}, "not a kind file; got 'other'"),
        ({"format": "kind"}, "'version' is missing"),
        ({"format": "kind", "version": 3}, "newer .* version 3; expected at most 2"),
        ({"format": "kind", "version": 0}, "not a whole number; got 0"),
        ({"format": "kind", "version": True}, "not a whole number; got True"),
        ({"format": "kind", "version": 1.0}, "not a whole number; got 1.0"),
    ],
)
def test_header(data: dict[str, Any], match: str) -> None:
    with pytest.raises(FileFormatError, match=f"^f.toml: .*{match}"):
        check_header(data, kind="kind", version=2, where="f.toml")


@pytest.mark.parametrize("version", [1, 2])
def test_header_of_this_and_of_older_versions(version: int) -> None:
    check_header({"format": "kind", "version": version}, kind="kind", version=2, where="f.toml")


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"diameter_mm": "16"}, "'diameter_mm' cannot be used; got '16'; expected a number$"),
        ({"diameter_mm": True}, "got True; expected a number$"),
        ({"diameter_mm": math.nan}, "got nan; expected a finite number$"),
        ({"diameter_mm": -math.inf}, "expected a"),
        ({"diameter_mm": [16]}, "expected a number$"),
        ({"flutes": 3.5}, "got 3.5; expected a whole number$"),
        ({"flutes": 65}, "got 65; expected a number of 64 at most$"),
        ({"helix_deg": 80}, "got 80; expected a number below 80$"),
        ({"name": 5}, "got 5; expected a text in quotes$"),
        ({"helix": 30}, "unknown key 'helix'. Write the unit into the key: helix_deg$"),
        ({"runout_mm": 0.01}, "unknown key 'runout_mm'. Its unit is another: runout_um$"),
        ({"fluets": 3}, "unknown key 'fluets'. Did you mean 'flutes'\\?$"),
        (
            {"colour": "red"},
            "unknown key 'colour'. The keys of this table: centre_cutting, coolant, corner_radius_mm, ",
        ),
        ({"stiffness": 1e9}, "unknown key 'stiffness'. The keys of this table"),
        ({"corner_radius_mm": 8.001}, "corner_radius_mm = 8.001 does not fit diameter_mm = 16; expected at most 8$"),
    ],
)
def test_one_fault_one_line(change: dict[str, Any], match: str) -> None:
    assert parse(ToolTable, TOOL, where="t").diameter_mm == 16.0
    with pytest.raises(FileFormatError, match=match) as fault:
        parse(ToolTable, {**TOOL, **change}, where="cell.toml")
    assert str(fault.value).startswith("cell.toml")
    assert "\n" not in str(fault.value)


def test_the_fault_that_explains_most_comes_first() -> None:
    bad = {key: value for key, value in TOOL.items() if key != "diameter_mm"} | {"flutes": 0, "diametre_mm": 16}
    with pytest.raises(FileFormatError, match="'diametre_mm' .2 more faults in this file.. Did you mean 'diameter_mm'"):
        parse(ToolTable, bad, where="t")


def test_unknown_keys_are_explained_by_their_own_table() -> None:
    with pytest.raises(FileFormatError) as fault:
        parse(CellTables, {"part": {"stock": {"cell": 0.1}}}, where="t")
    assert "part.stock.cell: unknown key 'cell'" in str(fault.value)
    assert "Write the unit into the key: cell_mm" in str(fault.value)
