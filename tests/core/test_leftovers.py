"""What a killed process left is cleared by the next run of the same output, and nothing else."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from counterflex.core import atomic
from counterflex.core.errors import OutputError
from counterflex.core.output_place import SUFFIX, part_prefix

HOLD = """
import sys, time
from pathlib import Path
from counterflex.core import atomic
from counterflex.core.errors import OutputError
with getattr(atomic, sys.argv[1])(sys.argv[2]) as part:
    if part.is_dir():
        (part / "half.txt").write_text("half")
    else:
        part.write_text("half")
    print("holding", flush=True)
    sys.stdin.read()
"""


def holding(kind: str, target: Path) -> subprocess.Popen[str]:
    """A process in the middle of writing."""
    child = subprocess.Popen(
        [sys.executable, "-c", HOLD, kind, str(target)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "holding\n"
    return child


def parts(folder: Path) -> list[str]:
    return sorted(item.name for item in folder.iterdir() if item.name.endswith(SUFFIX))


def write(kind: str, target: Path) -> None:
    if kind == "atomic_path":
        atomic.write_text(target, "whole")
    else:
        with atomic.atomic_folder(target) as staging:
            (staging / "whole.txt").write_text("whole", encoding="utf-8")


@pytest.mark.parametrize("there", [False, True])
@pytest.mark.parametrize("kind", ["atomic_path", "atomic_folder"])
def test_the_next_run_clears_what_a_killed_one_left(tmp_path: Path, kind: str, there: bool) -> None:
    target = tmp_path / "out"
    inside = tmp_path
    if there:
        write(kind, target)
        inside = target if target.is_dir() else tmp_path
    with holding(kind, target) as child:
        child.send_signal(signal.SIGKILL)
    assert len(parts(inside)) == 1
    write(kind, target)
    assert parts(inside) == []
    assert parts(tmp_path) == []
    if kind == "atomic_path":
        assert target.read_text(encoding="utf-8") == "whole"
    else:
        assert [item.name for item in target.iterdir()] == ["whole.txt"]


def test_a_process_that_only_waits_to_be_buried_is_gone(tmp_path: Path) -> None:
    with holding("atomic_path", tmp_path / "out") as child:
        child.send_signal(signal.SIGKILL)
        os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)  # ended, and not reaped
        atomic.write_text(tmp_path / "out", "whole")
        assert parts(tmp_path) == []


@pytest.mark.parametrize("kind", ["atomic_path", "atomic_folder"])
def test_a_living_process_keeps_its_own(tmp_path: Path, kind: str) -> None:
    target = tmp_path / "out"
    child = holding(kind, target)
    try:
        write(kind, target)
        assert len(parts(tmp_path)) == 1
    finally:
        child.communicate("")
    assert child.returncode == 0
    assert parts(tmp_path) == []
    assert (target.read_text(encoding="utf-8") if target.is_file() else sorted(p.name for p in target.iterdir())) in (
        "half",
        ["half.txt", "whole.txt"],
    )


def test_what_others_named_stays(tmp_path: Path) -> None:
    """Another output, another computer, a user's own file, one of this process."""
    gone = part_prefix("x").removeprefix(".x.").replace(str(os.getpid()), "4194304")  # above every process number
    kept = [
        f".other.{gone}abc{SUFFIX}",
        f".out.elsewhere-4194304-abc{SUFFIX}",
        f".out.abc{SUFFIX}",
        f".out{SUFFIX}",
        f"{part_prefix('out')}abc{SUFFIX}",
        f".out.{gone}abc{SUFFIX}.txt",
    ]
    for name in kept:
        (tmp_path / name).write_text("mine", encoding="utf-8")
    (tmp_path / f".out.{gone}abc{SUFFIX}").write_text("left", encoding="utf-8")
    atomic.write_text(tmp_path / "out", "whole")
    assert sorted(item.name for item in tmp_path.iterdir()) == sorted([*kept, "out"])


def test_a_name_is_no_pattern(tmp_path: Path) -> None:
    gone = part_prefix("x").removeprefix(".x.").replace(str(os.getpid()), "4194304")
    (tmp_path / f".aXb.{gone}abc{SUFFIX}").write_text("mine", encoding="utf-8")
    atomic.write_text(tmp_path / "a.b", "whole")
    assert len(parts(tmp_path)) == 1


@pytest.mark.parametrize("name", ["a" * 255, "\u00e4" * 127, os.fsdecode(b"caf\xe9" * 60), os.fsdecode(b"caf\xe9.ngc")])
@pytest.mark.parametrize("kind", ["atomic_path", "atomic_folder"])
def test_names_as_long_as_the_file_system_takes_and_names_that_are_not_utf_8(
    tmp_path: Path, name: str, kind: str
) -> None:
    target = tmp_path / name
    for _ in range(2):  # made, and replaced
        write(kind, target)
        assert [item.name for item in tmp_path.iterdir()] == [name]
    with holding(kind, target) as child:
        child.send_signal(signal.SIGKILL)
    assert parts(target if target.is_dir() else tmp_path) != []
    write(kind, target)
    assert parts(tmp_path) == parts(target if target.is_dir() else tmp_path) == []


def test_a_name_that_is_not_utf_8_within_a_text_is_one_error(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="a name in the text is not UTF-8") as told:
        atomic.write_text(tmp_path / "cell.toml", 'stl = "' + os.fsdecode(b"caf\xe9.stl") + '"')
    assert "caf" in str(told.value)
    assert list(tmp_path.iterdir()) == []
