"""Programs that never end: a state that comes back is found at once, whatever its period; loops that end are read."""

from __future__ import annotations

import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import ProgramError
from counterflex.programs import endless
from counterflex.programs.endless import LoopWatch, frozen
from counterflex.programs.gcode.read.reader import read_gcode


@given(st.integers(0, 300), st.integers(1, 300))
@settings(max_examples=60)
def test_every_cycle_is_found_within_three_times_its_length(before: int, period: int) -> None:
    steps = 0
    watch = LoopWatch(lambda: steps if steps < before else before + (steps - before) % period)
    while not (why := watch.jumped_back("line 5", 1, steps)):
        steps += 1
        assert steps <= 3 * (before + period) + 3
    assert "never ends" in why


def test_long_cycles_are_found_too() -> None:
    """After a thousand comparisons in vain only some jumps are compared, and the cycle is found all the same."""
    steps, period = 0, 777
    watch = LoopWatch(lambda: steps % period)
    while not (why := watch.jumped_back("line 5", 1, steps)):
        steps += 1
    assert "never ends" in why


def test_what_changes_for_ever_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(endless, "MOST_REPEATED", 1000)
    monkeypatch.setattr(endless, "MOST_WITHOUT_MOTION", 100)
    for moves, most in ((True, 1000), (False, 100)):
        steps = 0
        watch = LoopWatch(lambda: steps)  # noqa: B023
        while not (why := watch.jumped_back("line 5", 2, steps if moves else 0)):
            steps += 1
        assert 2 * steps == pytest.approx(most, abs=2)
        assert f"more than {most}" in why


def test_a_copy_compares_by_value() -> None:
    one = {"a": [1.0, (2, None)], "b": {"c": "d"}}
    kept = frozen(one)
    assert kept == frozen({"a": (1.0, [2, None]), "b": {"c": "d"}})
    one["a"][0] = 2.0  # type: ignore[index]
    assert kept != frozen(one)


@pytest.mark.parametrize(
    "body",
    [
        "#1=0\no1 while [#1 LT 40]\n#1=[#1+1]\n#2=0\no2 while [#2 LT 40]\n#2=[#2+1]\nG1 X[#2] Y[#1] F900\no2 endwhile\n"
        "o1 endwhile",
        "o1 repeat [2000]\nG91 G1 X1 F900\nG1 X-1\no1 endrepeat\nG90",  # nothing changes but the count
        "#1=5\no1 do\n#1=[#1-1]\nG0 X1\nG0 X0\no1 while [#1 GT 0]",
        "o7 sub\nG1 X1 F900\nG1 X0\no7 endsub\no1 repeat [500]\no7 call\no1 endrepeat",
    ],
)
def test_loops_that_end_are_read(body: str) -> None:
    assert len(read_gcode(f"G21 G90\n{body}\nM2\n", name="a.ngc").motions) >= 10


def test_subprograms_that_are_repeated_end() -> None:
    text = "G21 G90\nM98 P2 L400\nM30\nO2\nG91 G1 X0.1 F100\nG1 X-0.1\nM99\n"
    assert len(read_gcode(text, name="a.ngc").motions) == 800


def test_the_line_of_the_loop_is_named() -> None:
    with pytest.raises(ProgramError, match=r"a\.ngc:2:1: the program never ends"):
        read_gcode("G21 G90\no1 while [1]\nG0 X1\no1 endwhile\nM2\n", name="a.ngc")
