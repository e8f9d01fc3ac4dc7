"""Diameters in the comments of programs, in the forms of post-processors."""

from __future__ import annotations

from pathlib import Path

import pytest

from counterflex.core.units import MM
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.stated.remarks import diameters_of

BODY = "{unit} G90\nM6 T3\n{inside}\nM3 S9000\nG0 X0 Y0 Z5\nG1 X1 F100\nM30\n"
FORMS = {
    "(T3 D=16. CR=0. - ZMIN=-5. - flat end mill)": 16.0,
    "(T3  D=6.35 CR=0.5 TAPER=118deg - drill)": 6.35,
    "(T3 D=.5 CR=0. - ball)": 0.5,
    "(Compensated Tool Path. Diameter: 16.0 mm)": 16.0,
    "(TOOL - 3 DIA. OFF. - 3 LEN. - 3 DIA. - 12.)": 12.0,
    "( T3 | 10. FLAT ENDMILL | H3 | D3 | DIAMETER = 10. )": 10.0,
    "(T3: end mill D16, 3 flutes; 13000 rpm)": 16.0,
    "; T3: ball end mill D10": 10.0,
    "(T3 Dia 0.25 in)": 6.35,
}
SILENT = (
    "(T3 H3 D3)",
    "(tool 3)",
    "(D16 pocket)",
    "(DIA. OFF. - 3)",
    "(groove of diameter 1, 3 deep, T4)",
    "(mill D30)",
    "(T3 pocket DIA 30)",
    "(diameter 40)",
)


def diameter(unit: str, inside: str) -> dict[int, tuple[float, int]]:
    return dict(diameters_of(read_gcode(BODY.format(unit=unit, inside=inside), name="a.ngc")))


@pytest.mark.parametrize("text", FORMS)
def test_a_comment_names_a_diameter(text: str) -> None:
    ((tool, (value, line)),) = diameter("G21", text).items()
    assert (tool, line) == (3, 3)
    assert value == pytest.approx(FORMS[text] * MM)


def test_a_length_without_a_unit_is_in_that_of_the_program() -> None:
    assert diameter("G20", "(T3 D=0.5 CR=0.)")[3][0] == pytest.approx(12.7 * MM)
    assert diameter("G20", "(Compensated Tool Path. Diameter: 16.0 mm)")[3][0] == pytest.approx(16.0 * MM)


@pytest.mark.parametrize("text", SILENT)
def test_other_comments_name_none_of_this_tool(text: str) -> None:
    assert 3 not in diameter("G21", text)


def test_a_table_of_tools_before_the_first_block() -> None:
    table = "(T3 D=16.)\n(T4 D=8.)\n" + BODY.format(unit="G21", inside="")
    found = diameters_of(read_gcode(table, name="a.ngc"))
    assert {tool: value for tool, (value, _) in found.items()} == pytest.approx({3: 16.0 * MM, 4: 8.0 * MM})


def test_examples_name_the_tools_of_their_cells() -> None:
    folder = Path(__file__).resolve().parents[2] / "examples" / "programs"
    for name in ("two_tools.ngc", "pocket_grooves.ngc"):
        found = diameters_of(read_gcode((folder / name).read_text(), name=name))
        assert {tool: round(value / MM) for tool, (value, _) in found.items()} == {1: 16, 2: 10}
