"""The kept set of defects fits the source; operators change one thing each; the nearest tests come first."""

from __future__ import annotations

import ast
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    sys.path.insert(0, str(ROOT / "tools"))
    try:
        import plant_defects
    finally:
        sys.path.remove(str(ROOT / "tools"))
    return plant_defects


def test_the_kept_set_fits_the_source(tool: ModuleType) -> None:
    """150 defects or more, over every room; each exchanges a text that stands once, and compiles."""
    defects, stale = tool.read_set()
    assert stale == []
    assert len(defects) >= 150
    rooms = {path.name for path in (ROOT / "src" / "counterflex").iterdir() if (path / "__init__.py").is_file()}
    assert {one.room for one in defects if one.file.startswith("src/")} == rooms


def test_an_entry_that_no_longer_fits_is_named(tool: ModuleType, tmp_path: Path) -> None:
    source = tmp_path / "src" / "counterflex" / "core" / "one.py"
    source.parent.mkdir(parents=True)
    source.write_text("A = 1\nB = 1\n")
    entry = '[[defect]]\nname = "n"\nkind = "unit"\nfile = "src/counterflex/core/one.py"\nold = "= 1"\nnew = "= 2"\n'
    (tmp_path / "core.toml").write_text(entry)
    defects, stale = tool.read_set(tmp_path, tmp_path)
    assert defects == []
    assert stale == ["core.toml: 'n': old text occurs 2 times in src/counterflex/core/one.py"]


TEXT = '''
def f(a: int | None, b: float) -> float:
    """Return a - b."""
    if a is None or b < 0.0:
        raise ValueError(f"{a + 1} is wrong")
    return max(a, -b) * b + a[0]
'''


def test_an_operator_changes_one_thing_and_no_annotation_or_message(tool: ModuleType) -> None:
    changes = tool.mutation_operators.changes(TEXT)
    made = {TEXT[: one.start] + one.new + TEXT[one.end :] for one in changes}
    assert len(made) == len(changes) == 7
    for text in made:
        ast.parse(text)
        assert "int | None" in text
        assert "a + 1} is wrong" in text
    assert [one.line for one in changes] == [4, 4, 6, 6, 6, 6, 6]


def test_changes_stay_in_their_lines(tool: ModuleType) -> None:
    assert {one.line for one in tool.mutation_operators.changes(TEXT, {4})} == {4}


def test_the_nearest_test_names_the_function_and_lies_in_the_own_room(tool: ModuleType) -> None:
    own, above = tool.nearest_tests(ROOT, "src/counterflex/evaluate/figures.py", "reduction")
    assert own[0].startswith("tests/evaluate/")
    assert "reduction" in (ROOT / own[0]).read_text(encoding="utf-8")
    assert not any(path.startswith("tests/evaluate/") for path in above)


def test_each_room_has_tests_for_its_defects(tool: ModuleType) -> None:
    """Those of the laboratory too, which lies beside the package."""
    defects = {one.room: one for one in tool.read_set()[0]}
    assert "lab" in defects
    for one in defects.values():
        assert one.nearest(3, 0)[0], one.name


def test_some_of_each_room_are_drawn_the_rooms_in_turn(tool: ModuleType) -> None:
    def defect(room: str, number: int) -> object:
        return tool.Defect(f"{room}{number}", f"src/counterflex/{room}/a.py", "unit", "", "", "")

    defects = [defect(room, number) for room, count in (("a", 9), ("b", 2), ("c", 5)) for number in range(count)]
    drawn = tool.drawn_per_room(defects, 3, 7)
    assert [one.room for one in drawn] == ["a", "b", "c", "a", "b", "c", "a", "c"]
    assert len({one.name for one in drawn}) == 8
    assert drawn == tool.drawn_per_room(defects, 3, 7) != tool.drawn_per_room(defects, 3, 8)


def test_the_test_that_caught_a_defect_is_run_first_the_next_time(
    tool: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is written for the defects of a run alone; what the set no longer holds goes."""
    (one, two, *_), _ = tool.read_set()
    monkeypatch.setattr(tool, "CAUGHT", tmp_path / "caught_by.json")
    tool.CAUGHT.write_text('{"gone": "tests/a.py::t", "%s": "tests/b.py::t"}' % two.name)  # noqa: UP031
    row = {"digest": one.digest, "outcome": "own", "by": "tests/c.py::t[µ]"}
    tool.remember([one, two], {one.name: row, two.name: row | {"outcome": "survived", "digest": two.digest}})
    assert tool.read_caught() == {one.name: "tests/c.py::t[µ]", two.name: "tests/b.py::t"}


def test_what_is_remembered_is_of_the_set_and_still_there(tool: ModuleType) -> None:
    """A test that has gone would cost a collection in vain."""
    caught = tool.read_caught()
    assert set(caught) <= {one.name for one in tool.read_set()[0]}
    gone = [
        by
        for by in caught.values()
        if by.partition("[")[0].rpartition("::")[2] not in (ROOT / by.split("::")[0]).read_text()
    ]
    assert gone == []
