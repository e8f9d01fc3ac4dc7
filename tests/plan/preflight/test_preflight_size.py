"""Size of a program: motions per file, files, names, lines; each limit with a program on either side of it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from counterflex.plan.preflight.size import ProgramSize, size_rows

OWN = ProgramSize("KRL", "made-up manual", 100, 100, ("part",), 24, written=False, line=80, line_limit=80, line_point=7)
WRITTEN = replace(OWN, written=True, points=250, names=("part", "part_001", "part_002", "part_003"), line=None)


def test_a_program_at_its_limits_is_fine() -> None:
    assert [(row.check, row.verdict) for row in size_rows(OWN)] == [
        ("program size", "ok"), ("program name", "ok"), ("line length", "ok"),
        ("language of the controller", "ok"),
    ]  # fmt: skip


def test_beyond_each_limit_there_is_a_warning_with_its_source() -> None:
    points, name, line, _ = size_rows(replace(OWN, points=101, names=("p" * 25,), line=81))
    assert [row.verdict for row in (points, name, line)] == ["warning"] * 3
    assert "made-up manual" in points.what
    assert (points.value, points.limit) == (101.0, 100.0)
    assert (name.value, name.limit) == (25.0, 24.0)
    assert (line.point, line.value, line.limit) == (7, 81.0, 80.0)


def test_what_is_written_is_divided_and_says_how() -> None:
    rows = size_rows(WRITTEN)
    assert [row.verdict for row in rows] == ["ok"] * 4
    assert "part calls 3 files, part_001 to part_003" in rows[0].what
    assert rows[1].value == 8.0
    assert "one file, part" in size_rows(replace(WRITTEN, names=("part",)))[0].what


@pytest.mark.parametrize("written", [True, False])
def test_the_language_is_named(written: bool) -> None:
    assert "in KRL" in size_rows(replace(OWN, written=written))[0].what


def test_a_language_of_another_maker_is_a_warning_with_the_reason() -> None:
    row = size_rows(replace(OWN, foreign="the program is for a controller of FANUC, the robot is of KUKA"))[-1]
    assert row.verdict == "warning"
    assert "FANUC" in row.what
    assert row.advice
