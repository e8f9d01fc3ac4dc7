"""Every option that names a file to write, on links, pipes, devices and folders: what is there stays what it is."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

WRITERS = {
    "path": ("path", "part.ngc", "--csv"),
    "truth": ("truth", "cell.toml", "--seed", "1", "--out"),
    "log": ("twin", "proxy", "--listen", "127.0.0.1:0", "--to", "127.0.0.1:9", "--seconds", "0.01", "--log"),
}


@pytest.mark.parametrize("words", WRITERS.values(), ids=WRITERS.keys())
def test_links_and_pipes_stay(folder: Path, counterflex: Any, words: tuple[str, ...]) -> None:
    (folder / "target").write_text("old")
    (folder / "link").symlink_to("target")
    counterflex(*words, "link")
    assert (folder / "link").is_symlink()
    written = (folder / "target").read_bytes()
    assert written != b"old"
    os.mkfifo(folder / "pipe")
    came: list[bytes] = []
    reader = threading.Thread(target=lambda: came.append((folder / "pipe").read_bytes()), daemon=True)
    reader.start()
    counterflex(*words, "pipe")
    reader.join(30.0)
    assert (folder / "pipe").is_fifo()
    assert len(came) == 1
    assert came[0].splitlines()[0] == written.splitlines()[0]


@pytest.mark.parametrize("words", WRITERS.values(), ids=WRITERS.keys())
def test_a_folder_and_a_full_device_are_one_line(
    folder: Path, refused: Any, counterflex: Any, words: tuple[str, ...]
) -> None:
    (folder / "sub").mkdir()
    assert "sub" in refused(*words, "sub")
    full = os.open("/dev/full", os.O_WRONLY)  # by its descriptor: nothing here can replace the device itself
    try:
        ended = counterflex(*words, f"/dev/fd/{full}")
        assert ended.status == 2
        assert "No space left on device" in ended.err.splitlines()[-1]
        assert stat.S_ISCHR(os.fstat(full).st_mode)
    finally:
        os.close(full)


def _command(folder: Path, *words: str, stdout: Any) -> subprocess.CompletedProcess[bytes]:
    program = [sys.executable, "-c", "from counterflex.cli.start import run; run()", *words]
    return subprocess.run(program, cwd=folder, stdout=stdout, stderr=subprocess.PIPE, check=False)


@pytest.mark.long
def test_standard_output_holds_the_table_and_nothing_else(folder: Path) -> None:
    _command(folder, "path", "part.ngc", "--csv", "table.csv", stdout=subprocess.DEVNULL)
    printed = _command(folder, "path", "part.ngc", "--csv", "/dev/stdout", stdout=subprocess.PIPE)
    assert printed.returncode == 0
    assert printed.stdout == (folder / "table.csv").read_bytes()
    assert b"wrote /dev/stdout: 6 motions" in printed.stderr
    with (folder / "shell.csv").open("wb") as stream:
        _command(folder, "path", "part.ngc", "--csv", "/dev/stdout", stdout=stream)
    assert (folder / "shell.csv").read_bytes() == printed.stdout


def test_a_full_disk_behind_the_shell_is_one_line(folder: Path) -> None:
    full = os.open("/dev/full", os.O_WRONLY)
    try:
        ended = _command(folder, "robots", "--json", stdout=full)
    finally:
        os.close(full)
    assert ended.returncode == 2
    assert ended.stderr.decode().startswith("error: ")
    assert ended.stderr.count(b"\n") == 1
    assert b"No space left on device" in ended.stderr


def test_where_nothing_may_be_written_the_option_that_said_so_is_named(
    folder: Path, counterflex: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anything is read; the tests may run as root, for whom rights say nothing."""
    (folder / "kept").mkdir()
    allowed = os.access
    closed = (folder / "kept").resolve()

    def access(path: Any, mode: int, **options: Any) -> bool:
        return allowed(path, mode, **options) and not (mode & os.W_OK and Path(path).resolve() == closed)

    monkeypatch.setattr("counterflex.cli.arguments.os.access", access)
    for words in (
        ("path", "part.ngc", "--csv", "kept/path.csv"),
        ("path", "part.ngc", "--csv", "kept/below/path.csv"),
        ("compensate", "part.ngc", "--cell", "cell.toml", "--out", "kept"),
        ("compensate", "part.ngc", "--cell", "cell.toml", "--out", "kept/out"),
    ):
        ended = counterflex(*words)
        assert ended.status == 2
        assert f"{words[-2]} {words[-1]}: cannot write: nothing may be written in " in ended.err
        assert f"Choose another {words[-2]}" in ended.err


def test_a_place_that_does_not_take_it_is_not_blamed_on_another_option(counterflex: Any, folder: Path) -> None:
    if not Path("/proc/self").is_dir():  # only there a folder says yes and takes nothing
        return
    ended = counterflex("path", str(folder / "part.ngc"), "--csv", "/proc/self/path.csv")
    assert ended.status == 2
    assert "cannot write" in ended.err
    assert "--out" not in ended.err


def test_a_folder_that_is_a_link_to_nowhere_is_named_before_anything_starts(folder: Path, refused: Any) -> None:
    (folder / "out").symlink_to("nowhere")
    line = refused("simulate", "part.ngc", "--cell", "cell.toml", "--truth", "cell.toml", "--out", "out")
    assert "--out out: cannot write: a link that leads nowhere; got nowhere" in line
