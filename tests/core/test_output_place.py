"""Outputs through links, into devices, pipes and descriptors: what is there stays what it is."""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from counterflex.core import atomic
from counterflex.core.errors import OutputError
from counterflex.core.output_place import is_printed

NULL, FULL = (1, 3), (1, 7)


@contextlib.contextmanager
def full_device(folder: Path) -> Iterator[Path]:
    """Name of a device that takes nothing: a node of our own, else a descriptor; never the system's own name."""
    node = folder / "full"
    try:
        os.mknod(node, 0o666 | stat.S_IFCHR, os.makedev(*FULL))
        os.close(os.open(node, os.O_WRONLY))
    except PermissionError:
        node.unlink(missing_ok=True)
        opened = os.open("/dev/full", os.O_WRONLY)
        try:
            yield Path(f"/dev/fd/{opened}")
        finally:
            os.close(opened)
    else:
        yield node


class Reader:
    """Reads a pipe to its end in the background."""

    def __init__(self, pipe: Path) -> None:
        self.found = b""
        self._thread = threading.Thread(target=self._read, args=(pipe,), daemon=True)
        self._thread.start()

    def _read(self, pipe: Path) -> None:
        self.found = pipe.read_bytes()

    def all(self) -> bytes:
        """What came."""
        self._thread.join(20.0)
        return self.found


def test_a_device_takes_the_data_or_says_that_it_is_full_and_stays_a_device(tmp_path: Path) -> None:
    with full_device(tmp_path) as full:
        before = full.stat()
        with pytest.raises(OutputError, match="No space left on device") as told:
            atomic.write_text(full, "x" * 100)
        assert str(full) in str(told.value)
        after = full.stat()
        assert stat.S_ISCHR(after.st_mode)
        assert (after.st_rdev, after.st_ino) == (before.st_rdev, before.st_ino)
        assert [item.name for item in tmp_path.iterdir() if item != full] == []


def test_a_pipe_is_written_into(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = Reader(pipe)
    atomic.write_text(pipe, "a,b\n1,2\n")
    assert reader.all() == b"a,b\n1,2\n"
    assert pipe.is_fifo()


def test_a_job_that_fails_writes_nothing_into_a_pipe(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    held = os.open(pipe, os.O_RDWR | os.O_NONBLOCK)
    try:
        with pytest.raises(RuntimeError), atomic.atomic_path(pipe) as part:
            part.write_text("half")
            raise RuntimeError
        with pytest.raises(BlockingIOError):
            os.read(held, 1)
    finally:
        os.close(held)


@pytest.mark.parametrize("there", [True, False], ids=["to a file", "to nothing yet"])
def test_a_link_stays_and_its_target_is_written(tmp_path: Path, there: bool) -> None:
    (tmp_path / "store").mkdir()
    (tmp_path / "here").mkdir()
    target = tmp_path / "store" / "result.csv"
    if there:
        target.write_text("old")
    second, first = tmp_path / "second", tmp_path / "here" / "first"
    second.symlink_to("store/result.csv")
    first.symlink_to(Path("..") / "second")
    atomic.write_text(first, "new")
    assert first.is_symlink()
    assert second.is_symlink()
    assert target.read_text() == "new"
    assert [item.name for item in (tmp_path / "store").iterdir()] == ["result.csv"]


def test_links_in_a_circle_are_one_error(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(OutputError, match="symbolic links"):
        atomic.write_text(tmp_path / "a", "x")
    assert (tmp_path / "a").is_symlink()


def test_mode_is_kept_and_a_new_file_has_the_usual_one(tmp_path: Path) -> None:
    target = tmp_path / "result.csv"
    target.write_text("old")
    target.chmod(0o640)
    atomic.write_text(target, "new")
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    plain = tmp_path / "plain"
    plain.write_text("")
    atomic.write_text(tmp_path / "made", "")
    assert (tmp_path / "made").stat().st_mode == plain.stat().st_mode


@contextlib.contextmanager
def nobody() -> Iterator[Path]:
    """A folder of a user who is not root, as that user; as whoever runs the test where that is not root."""
    with tempfile.TemporaryDirectory() as name:
        folder, root = Path(name), os.geteuid() == 0
        if root:
            os.chown(folder, 65534, 65534)
            os.seteuid(65534)
        try:
            yield folder
        finally:
            if root:
                os.seteuid(0)


def test_a_file_that_may_not_be_written_is_kept() -> None:
    with nobody() as folder:
        target = folder / "kept.csv"
        target.write_text("old")
        target.chmod(0o444)
        with pytest.raises(OutputError, match=r"kept.csv: cannot write: Permission denied"):
            atomic.write_text(target, "new")
        assert target.read_text() == "old"
        with (
            pytest.raises(OutputError, match="Permission denied"),
            atomic.atomic_folder(folder) as staging,
        ):
            (staging / "kept.csv").write_text("new")
        assert target.read_text() == "old"


def test_a_descriptor_is_written_where_it_stands(tmp_path: Path) -> None:
    opened = os.open(tmp_path / "log", os.O_RDWR | os.O_CREAT)
    try:
        os.write(opened, b"before\n")
        atomic.write_text(f"/dev/fd/{opened}", "data\n")
        os.write(opened, b"after\n")
    finally:
        os.close(opened)
    assert (tmp_path / "log").read_text() == "before\ndata\nafter\n"


def test_what_goes_to_standard_output_is_known(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    try:
        assert not is_printed(f"/dev/fd/{writing}")
        assert not is_printed(tmp_path / "file")
        assert not is_printed(tmp_path)
    finally:
        os.close(reading)
        os.close(writing)


def test_a_record_that_grows_goes_through_links_and_into_pipes(tmp_path: Path) -> None:
    target = tmp_path / "target"
    target.write_text("old and longer than what comes")
    (tmp_path / "link").symlink_to("target")
    with atomic.open_record(tmp_path / "link") as stream:
        stream.write("new\n")
    assert (tmp_path / "link").is_symlink()
    assert target.read_text() == "new\n"
    with pytest.raises(OutputError, match="a folder has this name"), atomic.open_record(tmp_path):
        pass
    with (
        full_device(tmp_path) as full,
        pytest.raises(OutputError, match="No space left"),
        atomic.open_record(full) as stream,
    ):
        stream.write("x" * 100_000)


def test_a_folder_of_results_follows_links_and_fills_pipes(tmp_path: Path) -> None:
    out, store = tmp_path / "out", tmp_path / "store"
    out.mkdir()
    store.mkdir()
    (store / "kept.json").write_text("old")
    (out / "summary.json").symlink_to(store / "kept.json")
    os.mkfifo(out / "report.html")
    reader = Reader(out / "report.html")
    with atomic.atomic_folder(out) as staging:
        for name in ("summary.json", "report.html", "plan.parquet"):
            (staging / name).write_text(f"new {name}")
    assert (out / "summary.json").is_symlink()
    assert (store / "kept.json").read_text() == "new summary.json"
    assert (out / "report.html").is_fifo()
    assert reader.all() == b"new report.html"
    assert {item.name for item in out.iterdir()} == {"summary.json", "report.html", "plan.parquet"}
    assert [item.name for item in store.iterdir()] == ["kept.json"]


def test_a_folder_of_results_is_as_before_when_a_device_in_it_is_full(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "a.txt").write_text("old")
    with full_device(tmp_path) as full:
        (out / "b.txt").symlink_to(full)
        with pytest.raises(OutputError, match="No space left"), atomic.atomic_folder(out) as staging:
            for name in ("a.txt", "b.txt", "c.txt"):
                (staging / name).write_text("new")
        assert (out / "a.txt").read_text() == "old"
        assert (out / "b.txt").is_symlink()
        assert {item.name for item in out.iterdir()} == {"a.txt", "b.txt"}


def test_a_folder_behind_a_link_that_is_not_there_yet_is_made(tmp_path: Path) -> None:
    (tmp_path / "out").symlink_to("store/results")
    with atomic.atomic_folder(tmp_path / "out") as staging:
        (staging / "a.txt").write_text("new")
    assert (tmp_path / "out").is_symlink()
    assert (tmp_path / "store" / "results" / "a.txt").read_text() == "new"
