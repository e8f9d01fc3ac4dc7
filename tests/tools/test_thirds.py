"""Three turns run every long test and every benchmark, each once; what is not long, in each turn."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

import run_benchmarks
import thirds

ROOT = Path(__file__).parents[2]
TURNS = [thirds.Turn(number) for number in range(thirds.COUNT)]


@given(st.text())
def test_every_file_has_one_turn(path: str) -> None:
    assert sum(now.takes(path) for now in TURNS) == 1


def test_each_turn_has_its_share_of_the_benchmarks_and_all_have_all() -> None:
    shares = [run_benchmarks.of_turn(now) for now in TURNS]
    assert sorted(file for share in shares for file in share) == run_benchmarks.every()
    assert min(map(len, shares)) > len(run_benchmarks.every()) / 6


def git(folder: Path, *words: str) -> str:
    name = ("-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "commit.gpgsign=false")
    return subprocess.run(["git", *name, *words], cwd=folder, check=True, capture_output=True, text=True).stdout


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A repository of four commits; the last one changes `tests/changed.py`."""
    folder = tmp_path / "tree"
    (folder / "tests").mkdir(parents=True)
    git(folder, "init", "--quiet")
    for k in range(4):
        (folder / "tests" / ("changed.py" if k == 3 else f"file{k}.py")).write_text(str(k), encoding="utf-8")
        git(folder, "add", ".")
        git(folder, "commit", "--quiet", "--message", str(k))
    return folder


def test_thirds_take_turns_with_the_commits(tree: Path) -> None:
    numbers = []
    for k in range(4):
        git(tree, "checkout", "--quiet", f"HEAD~{bool(k):d}")
        numbers.append(thirds.turn(tree).number)
    assert numbers == [1, 0, 2, 1]


def test_what_the_commit_changes_has_its_turn_too_and_what_is_changed_since(tree: Path) -> None:
    (tree / "tests" / "file0.py").write_text("else", encoding="utf-8")
    now = thirds.turn(tree)
    assert now.changed == {"tests/changed.py", "tests/file0.py"}
    assert all(now.takes(path) for path in now.changed)


def test_a_commit_that_changes_everything_adds_nothing(tree: Path) -> None:
    for k in range(thirds.MOST_CHANGED):
        (tree / "tests" / f"new{k}.py").write_text("", encoding="utf-8")
    git(tree, "add", ".")
    now = thirds.turn(tree)
    assert not now.changed
    assert f"its {thirds.MOST_CHANGED + 1} changed files, too many" in thirds.said(now)


def test_a_clone_without_history_draws_and_a_folder_without_git_has_the_first(tree: Path, tmp_path: Path) -> None:
    clone, bare = tmp_path / "clone", tmp_path / "bare"
    git(tmp_path, "clone", "--quiet", "--depth", "1", tree.as_uri(), str(clone))
    now = thirds.turn(clone)
    assert now.number == int(git(clone, "rev-parse", "HEAD"), 16) % thirds.COUNT
    assert "without history" in thirds.said(now)
    assert not now.changed
    shutil.copytree(tree, bare, ignore=shutil.ignore_patterns(".git"))
    assert "Git is not at hand" in thirds.said(thirds.turn(bare))


def test_turns_leave_out_long_tests_alone_and_together_nothing(tmp_path: Path) -> None:
    """The suite's own rules in a small tree of twelve files, one long and one short test each."""
    (tmp_path / "tools").mkdir()
    (tmp_path / "tests").mkdir()
    shutil.copy(ROOT / "tests" / "conftest.py", tmp_path / "tests")
    shutil.copy(ROOT / "tools" / "thirds.py", tmp_path / "tools")
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n  long\n  by_turn\n", encoding="utf-8")
    text = "import pytest\n\ndef test_short(): ...\n\n@pytest.mark.long\ndef test_long(): ...\n"
    for count in (2, 7):
        text += f"@pytest.mark.by_turn\n@pytest.mark.parametrize('k', range({count}))\ndef test_{count}(k): ...\n"
    names = [f"tests/test_{k}.py" for k in range(12)]
    for name in names:
        (tmp_path / name).write_text(text, encoding="utf-8")
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "add", "pytest.ini")
    seen: list[str] = []
    sampled: list[set[int]] = []  # numbers of cases of the law of seven, by turn
    for k in range(thirds.COUNT):
        git(tmp_path, "commit", "--quiet", "--allow-empty", "--message", str(k))
        asked = [sys.executable, "-m", "pytest", "--collect-only", "-q", "--turn", "-p", "no:cacheprovider"]
        said = subprocess.run(asked, cwd=tmp_path, check=True, capture_output=True, text=True).stdout
        found = [line for line in said.splitlines() if "::" in line]
        assert [one for one in found if one.endswith("short")] == sorted(f"{name}::test_short" for name in names)
        seen += [one for one in found if one.endswith("long")]
        for name in names:
            few, many = (
                {int(one[-2]) for one in found if one.startswith(f"{name}::test_{count}[")} for count in (2, 7)
            )
            if f"{name}::test_long" in found:
                assert (few, many) == ({0, 1}, set(range(7)))
            else:
                assert len(few) == 1
                sampled.append(many)
    assert sorted(seen) == sorted(f"{name}::test_long" for name in names)
    assert {frozenset(one) for one in sampled} == {frozenset(range(k, 7, thirds.COUNT)) for k in range(thirds.COUNT)}
