"""Files of one folder belong together: a file of another cell, an edited one, a command killed between two renames."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from counterflex.core import atomic
from counterflex.core.errors import FileFormatError
from counterflex.files.summary_file import SUMMARY, not_compared, require_whole, write_folder_summary, write_summary

KILLED = """
import os, pathlib, signal, sys
sys.path.insert(0, sys.argv[3])
from test_whole_folder import write
replace, count = pathlib.Path.replace, [0]

def counted(self, target):
    count[0] += 1
    if count[0] == int(sys.argv[1]):
        os.kill(os.getpid(), signal.SIGKILL)
    return replace(self, target)

pathlib.Path.replace = counted
write(pathlib.Path(sys.argv[2]), "second")
"""


def write(folder: Path, content: str) -> None:
    """Write a folder of four files and its summary, as jobs do."""
    with atomic.atomic_folder(folder) as staging:
        for name in ("a.ngc", "plan.parquet", "truth.toml"):
            (staging / name).write_text(f"{content} {name}", encoding="utf-8")
        (staging / "parts").mkdir()
        (staging / "parts" / "b.json").write_text(content, encoding="utf-8")
        write_folder_summary(staging, {"job": "test"})


def states(folder: Path) -> set[str]:
    """First words of the files: which of the commands wrote them."""
    files = [folder / name for name in ("a.ngc", "plan.parquet", "truth.toml", "parts/b.json")]
    return {file.read_text(encoding="utf-8").split()[0] for file in files}


def test_a_folder_as_it_was_written_is_whole(tmp_path: Path) -> None:
    write(tmp_path / "out", "first")
    assert require_whole(tmp_path / "out")
    assert not_compared(tmp_path / "out") is None
    (tmp_path / "out" / "truth.toml").unlink()  # a person may delete files
    (tmp_path / "out" / "note.txt").write_text("mine", encoding="utf-8")
    assert require_whole(tmp_path / "out")


@pytest.mark.parametrize("name", ["a.ngc", "plan.parquet", "parts/b.json"])
def test_a_file_of_another_folder_is_named(tmp_path: Path, name: str) -> None:
    write(tmp_path / "out", "first")
    write(tmp_path / "other", "second")
    shutil.copyfile(tmp_path / "other" / name, tmp_path / "out" / name)
    with pytest.raises(FileFormatError, match="do not belong together") as fault:
        require_whole(tmp_path / "out")
    assert str(fault.value.where) == str(tmp_path / "out" / name)
    assert "Write the folder again" in str(fault.value)


def test_line_ends_are_no_difference(tmp_path: Path) -> None:
    """A copy by FTP in text mode or a checkout of git changes them; one changed character is a difference."""
    with atomic.atomic_folder(tmp_path / "out") as staging:
        (staging / "a.ngc").write_bytes(b"G0 X1\nG1 X2\nM2\n")
        (staging / "b.mod").write_bytes(b"MODULE b\r\nENDMODULE\r\n")
        (staging / "c.bin").write_bytes(b"\0\n\1")
        write_folder_summary(staging, {"job": "test"})
    out = tmp_path / "out"
    (out / "a.ngc").write_bytes(b"G0 X1\r\nG1 X2\r\nM2\r\n")
    (out / "b.mod").write_bytes(b"MODULE b\nENDMODULE\n")
    assert require_whole(out)
    for name, content in (("a.ngc", b"G0 X1\r\nG1 X3\r\nM2\r\n"), ("c.bin", b"\0\r\n\1")):
        before = (out / name).read_bytes()
        (out / name).write_bytes(content)
        with pytest.raises(FileFormatError, match="do not belong together") as fault:
            require_whole(out)
        assert "an edited file belongs into a folder of its own" in str(fault.value)
        (out / name).write_bytes(before)


def test_a_folder_that_says_nothing_is_not_looked_at(tmp_path: Path) -> None:
    assert "not looked at" in str(not_compared(tmp_path))
    write_summary(tmp_path / SUMMARY, {"job": "test"})
    assert "not looked at" in str(not_compared(tmp_path))


@pytest.mark.parametrize("number", [1, 2, 4, 6])
def test_killed_between_two_renames(tmp_path: Path, number: int) -> None:
    """At each of them in `tests/core/test_moving.py`; here a process that is killed by the system."""
    out = tmp_path / "out"
    write(out, "first")
    here = str(Path(__file__).parent)
    ended = subprocess.run([sys.executable, "-c", KILLED, str(number), str(out), here], check=False)
    assert ended.returncode == -9
    assert require_whole(out)
    assert len(states(out)) == 1
    write(out, "third")
    assert require_whole(out)
    assert states(out) == {"third"}
