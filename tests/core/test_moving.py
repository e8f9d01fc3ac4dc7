"""Files of a folder appear together: whenever a command is killed or the power fails, old and new never stand together.

A process is killed before each of its renames, links and removals in turn. A power failure is one on a disk that keeps
the content of files that were put there, and of names a beginning of what was changed: a journaling file system.
"""

from __future__ import annotations

import os
import random
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final
from unittest import mock

import pytest

from counterflex.core import atomic, file_content, moving
from counterflex.core.errors import CounterflexError, FileFormatError, OutputError
from counterflex.core.moving import JOURNAL, settle
from counterflex.core.output_place import SUFFIX
from killed_process import CHANGES, counted, each_kill, killed

NAMES: Final = ("a.ngc", "plan.parquet", "parts/b.json", "summary.json")


def write(folder: Path, word: str, *more: str) -> None:
    """Write a folder of four files, as jobs do."""
    with atomic.atomic_folder(folder) as staging:
        (staging / "parts").mkdir()
        for name in (*NAMES, *more):
            (staging / name).write_text(f"{word} {name}", encoding="utf-8")


def words(folder: Path) -> list[str]:
    """Who wrote each file that is there: first words, without looking by way of the program."""
    return [(folder / name).read_text(encoding="utf-8").split(" ")[0] for name in NAMES if (folder / name).is_file()]


@pytest.mark.parametrize("there", [True, False], ids=["replaced", "new"])
def test_a_kill_at_any_moment_leaves_all_or_nothing(tmp_path: Path, there: bool) -> None:
    out, before = tmp_path / "nested" / "out", ["old"] * 4 if there else []
    if there:
        write(out, "old")
    found = set()
    for number in each_kill(lambda: write(out, "new")):
        assert len(set(words(out))) <= 1, "an old file beside a new one"
        settle(out / NAMES[0])
        seen = words(out)
        assert seen in (before, ["new"] * 4), number
        found.add(tuple(seen))
        assert not (out / JOURNAL).exists()
        write(out, "third", "more.txt")  # the next command clears what is left
        assert words(out) == ["third"] * 4
        assert [item for item in tmp_path.rglob("*") if item.name.endswith(SUFFIX) or item.name == JOURNAL] == []
        shutil.rmtree(tmp_path / "nested")
        if there:
            write(out, "old")
    assert len(found) == (2 if there else 1)  # a folder that was not there appears by its last change


def test_the_first_kill_is_of_the_old_state(tmp_path: Path) -> None:
    write(tmp_path / "out", "old")
    assert killed(1, lambda: write(tmp_path / "out", "new"))
    assert words(tmp_path / "out") == ["old"] * 4


@pytest.mark.long
def test_who_completes_may_be_killed_as_well(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write(out, "old")
    for first in each_kill(lambda: write(out, "new")):
        if (out / JOURNAL).exists():
            for _ in each_kill(lambda: settle(out)):
                assert len(set(words(out))) <= 1
            settle(out)
            assert words(out) == ["new"] * 4, first
        shutil.rmtree(out)
        write(out, "old")


@pytest.mark.parametrize("number", range(1, 40))
def test_a_fault_at_any_moment_leaves_everything_as_it_was(tmp_path: Path, number: int) -> None:
    out = tmp_path / "out"
    write(out, "old")

    def full() -> None:
        raise OSError(28, "No space left on device")

    try:
        with counted(number, full):
            write(out, "new")
    except OutputError:
        expected = ["old"] * 4
    else:
        expected = ["new"] * 4
    assert words(out) == expected
    settle(out)
    assert words(out) == expected
    assert sorted(item.name for item in out.iterdir()) == ["a.ngc", "parts", "plan.parquet", "summary.json"]


def test_a_folder_in_folders_that_were_not_there_goes_with_them_after_a_failure(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), atomic.atomic_folder(tmp_path / "a" / "b" / "c") as staging:
        with atomic.atomic_folder(staging / "inner" / "deep") as inner:
            (inner / "x").write_text("x", encoding="utf-8")
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def left(tmp_path: Path) -> Path:
    """Return a folder that a command was killed in, new files not yet in place."""
    out = tmp_path / "out"
    write(out, "old")
    number = 1
    while not (out / JOURNAL).exists():
        assert killed(number, lambda: write(out, "new"))
        number += 1
    return out


def test_a_reader_of_a_subfolder_completes(tmp_path: Path) -> None:
    out = left(tmp_path)
    assert file_content.text(out / "parts" / "b.json") == "new parts/b.json"
    assert words(out) == ["new"] * 4


def test_one_file_that_is_written_later_is_not_overwritten_by_what_was_left(tmp_path: Path) -> None:
    out = left(tmp_path)
    atomic.write_text(out / "a.ngc", "latest a.ngc")
    assert words(out) == ["latest", "new", "new", "new"]


def test_a_reader_that_may_not_complete_refuses_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out, mine = left(tmp_path), os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: mine + 1)
    with pytest.raises(FileFormatError, match="killed while it wrote this folder") as told:
        file_content.text(out / "a.ngc")
    assert "\n" not in str(told.value)
    assert str(out) in str(told.value)
    tmp_path.chmod(0o1777)
    shutil.move(out / JOURNAL, tmp_path / JOURNAL)  # laid by another user into a folder for everybody's files
    assert file_content.text(out / "a.ngc") == "old a.ngc"


@pytest.mark.parametrize("trap", ["a link to a file", "a link to a folder", "a link among the new files", "no lock"])
def test_a_journal_of_elsewhere_moves_nothing_through_links(tmp_path: Path, trap: str) -> None:
    """A folder that was unpacked from an archive may hold one."""
    out, target = tmp_path / "out", tmp_path / "target"
    (out / JOURNAL / "new" / "sub").mkdir(parents=True)
    target.mkdir()
    (target / "x").write_text("mine", encoding="utf-8")
    (out / JOURNAL / "new" / "sub" / "x").write_text("theirs", encoding="utf-8")
    if trap != "no lock":
        (out / JOURNAL / "lock").write_text("1", encoding="ascii")
    if trap == "a link to a folder":
        (out / "sub").symlink_to(target)
    elif trap == "a link to a file":
        (out / "sub").mkdir()
        (out / "sub" / "x").symlink_to(target / "x")
    elif trap == "a link among the new files":
        (out / JOURNAL / "new" / "y").symlink_to(target / "x")
    asks: tuple[Callable[[], None], ...] = (lambda: settle(out / "anything"), lambda: write(out, "new"))
    for ask in asks:
        with pytest.raises(CounterflexError, match=f"remove {JOURNAL} in it"):
            ask()
    assert (target / "x").read_text(encoding="utf-8") == "mine"


def test_a_living_command_is_waited_for_and_not_disturbed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    write(out, "old")
    clock = iter(float(second) for second in range(1000))
    monkeypatch.setattr("counterflex.core.moving.time.monotonic", lambda: next(clock))
    monkeypatch.setattr("counterflex.core.moving.time.sleep", lambda _: None)
    asked: list[str] = []

    def ask() -> None:
        with pytest.raises(FileFormatError, match="another command is writing into this folder"):
            file_content.text(out / "a.ngc")
        asked.append("refused")

    before = moving._Move.put

    def put(self: moving._Move) -> None:
        ask()
        before(self)

    monkeypatch.setattr(moving._Move, "put", put)
    write(out, "new")
    assert len(asked) == len(NAMES)
    assert words(out) == ["new"] * 4


class Disk:
    """A disk that drops what was not put on it: content of files, and names from some change on.

    Attributes:
        states: Trees after each change of a name: path to the number of its file.
        safe: Number of changes that are certainly kept.
        kept: Content of files, by their number, when they were last put on the disk.
    """

    def __init__(self, root: Path) -> None:
        self.root, self.kept = root, {}
        self.states: list[dict[str, int | None]] = [self._tree()]
        self.kept = {path.stat().st_ino: path.read_bytes() for path in root.rglob("*") if path.is_file()}
        self.safe = 0
        self.crashes: list[tuple[list[dict[str, int | None]], dict[int, bytes]]] = []

    def _tree(self) -> dict[str, int | None]:
        return {
            path.relative_to(self.root).as_posix(): None if path.is_dir() else path.stat().st_ino
            for path in sorted(self.root.rglob("*"))
        }

    def look(self) -> None:
        """Note names that have changed, and what a power failure could leave now."""
        tree = self._tree()
        if tree != self.states[-1]:
            self.states.append(tree)
        self.crashes.append((self.states[self.safe :], dict(self.kept)))

    def synced(self, handle: int) -> None:
        """Keep the content of a file; of a folder the names, and so everything changed before in its file system."""
        self.look()
        place = Path(f"/proc/self/fd/{handle}").readlink()
        if place.is_dir():
            self.safe = len(self.states) - 1
        else:
            self.kept[os.fstat(handle).st_ino] = place.read_bytes()

    def restore(self, target: Path, tree: dict[str, int | None], kept: dict[int, bytes]) -> None:
        """Make what is found after the failure: a file that was not put on the disk has its name and no content."""
        shutil.rmtree(target, ignore_errors=True)
        target.mkdir()
        for name, number in tree.items():
            if number is None:
                (target / name).mkdir(exist_ok=True)
            else:
                (target / name).write_bytes(kept.get(number, b""))


@contextmanager
def watched(disk: Disk) -> Iterator[None]:
    before, fsync = {name: getattr(Path, name) for name in CHANGES}, os.fsync

    def watching(name: str) -> Callable[..., Any]:
        def change(self: Path, *args: Any, **options: Any) -> Any:
            result = before[name](self, *args, **options)
            disk.look()
            return result

        return change

    def synced(handle: Any) -> None:
        disk.synced(handle)
        fsync(handle)

    for name in CHANGES:
        setattr(Path, name, watching(name))
    try:
        with mock.patch.object(os, "fsync", synced):
            yield
    finally:
        for name in CHANGES:
            setattr(Path, name, before[name])


def after_power_failures(disk: Disk, place: Path) -> Iterator[Path]:
    """Folders as they may be found, one after the other at the same place."""
    for states, kept in disk.crashes:
        for tree in states:
            disk.restore(place, tree, kept)
            yield place


@pytest.mark.parametrize("there", [True, False], ids=["replaced", "new"])
def test_a_power_failure_leaves_all_or_nothing(tmp_path: Path, there: bool) -> None:
    root = tmp_path / "disk"
    root.mkdir()
    if there:
        write(root / "out", "old")
    disk = Disk(root)
    with watched(disk):
        write(root / "out", "new")
    count = 0
    for found in after_power_failures(disk, tmp_path / "found"):
        settle(found / "out")
        seen = words(found / "out")
        assert seen in (([["old"] * 4, ["new"] * 4]) if there else [[], ["new"] * 4])
        count += 1
    assert count > 20
    assert seen == ["new"] * 4, "when the command has ended, nothing is lost"


@pytest.mark.parametrize("there", [True, False], ids=["replaced", "new"])
def test_a_power_failure_leaves_the_former_file_or_the_new_one(tmp_path: Path, there: bool) -> None:
    root = tmp_path / "disk"
    root.mkdir()
    if there:
        (root / "cell.toml").write_text("old", encoding="utf-8")
    disk = Disk(root)
    with watched(disk):
        atomic.write_text(root / "cell.toml", "new")
    for found in after_power_failures(disk, tmp_path / "found"):
        file = found / "cell.toml"
        seen = file.read_text(encoding="utf-8") if file.is_file() else ""
        assert seen in ("old" if there else "", "new")
    assert seen == "new"


def test_the_disk_of_these_tests_loses_what_is_not_synced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = tmp_path / "disk"
    root.mkdir()
    disk = Disk(root)
    monkeypatch.setattr(atomic, "sync_file", lambda _: None)
    with watched(disk):
        atomic.write_text(root / "cell.toml", "new")
    found = [(place / "cell.toml").read_text() for place in after_power_failures(disk, tmp_path / "found")
             if (place / "cell.toml").is_file()]  # fmt: skip
    assert "" in found


def test_chance_of_order_between_two_commands(tmp_path: Path) -> None:
    """Killed and whole commands of other files into one folder, one after the other: each is there whole or not."""
    out, draw = tmp_path / "out", random.Random(1)
    for turn in range(30):
        if draw.random() < 0.7:
            killed(draw.randrange(1, 30), partial(write, out, f"{turn}"))
        else:
            write(out, f"{turn}")
        settle(out)
        assert len(set(words(out))) <= 1
