"""Compiled kernels, locks and the verdict on the computer lie in a folder that nobody else can write into."""

from __future__ import annotations

import os
import pickle
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from counterflex.core import jit
from counterflex.core.user_folder import SharedFolderError, made_own, user_folder
from counterflex.files.machine_file import machine_file, read_verdict
from counterflex.protocols.processes.instance_lock import InstanceLock, holders

PLANTED = """
import pathlib
class Planted:
    def __reduce__(self):
        return pathlib.Path.touch, (pathlib.Path({mark!r}),)
"""


@pytest.fixture(autouse=True)
def no_memory() -> Iterator[None]:
    """Ask for the folder anew in every test."""
    jit._cache_root.cache_clear()
    yield
    jit._cache_root.cache_clear()


def _link(folder: Path) -> None:
    (folder.parent / "elsewhere").mkdir(mode=0o700)
    folder.symlink_to("elsewhere")


def _by_mode(mode: int) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        folder.mkdir()
        (folder / "robot-1.lock").write_text('{"pid": 1}', encoding="utf-8")
        (folder / "machine.json").write_text("{}", encoding="utf-8")
        folder.chmod(mode)

    return make


def _exchangeable(folder: Path) -> None:
    folder.parent.mkdir()
    folder.mkdir(mode=0o700)
    folder.parent.chmod(0o777)


DOORS = {
    "a link to elsewhere": ("cache", _link, "is a link"),
    "others write": ("cache", _by_mode(0o777), "mode 0777; expected mode 0700"),
    "the group writes": ("cache", _by_mode(0o770), "mode 0770; expected mode 0700"),
    "a folder above is everybody's": ("open/cache", _exchangeable, "can exchange"),
    "a file": ("cache", lambda folder: folder.write_text("", encoding="utf-8"), "is no folder"),
}


@pytest.mark.parametrize("door", DOORS)
def test_a_folder_that_others_can_write_is_refused_by_every_reader(
    door: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name, make, said = DOORS[door]
    folder = tmp_path / name
    make(folder)
    monkeypatch.setenv("COUNTERFLEX_CACHE", str(folder))
    for ask in (jit._cache_root, lambda: made_own(folder), lambda: InstanceLock(folder, 49152)):
        with pytest.raises(SharedFolderError, match=said) as told:
            ask()
        assert "\n" not in str(told.value)
        assert "COUNTERFLEX_CACHE" in str(told.value)
    if (folder / "machine.json").exists():
        with pytest.raises(SharedFolderError, match=said):
            read_verdict(machine_file())
    assert holders(folder) == []


def test_another_user_s_folder_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "cache"
    folder.mkdir(mode=0o700)
    mine = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: mine + 1)
    with pytest.raises(SharedFolderError, match=f"another user; got user {mine}; expected user {mine + 1}"):
        made_own(folder)


@pytest.mark.parametrize("mode", [0o755, 0o700, 0o777])
def test_the_folder_is_closed_where_its_content_is_certainly_the_user_s(mode: int, tmp_path: Path) -> None:
    """Readable by others, or empty."""
    folder = tmp_path / "cache"
    folder.mkdir()
    folder.chmod(mode)
    if mode == 0o755:
        (folder / "kept").write_text("", encoding="utf-8")
    assert stat.S_IMODE(made_own(folder).stat().st_mode) == 0o700


def test_a_new_folder_has_mode_0700_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        folder = made_own(tmp_path / "cache")
    finally:
        os.umask(before)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_variables_that_say_nothing_lead_to_the_home_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """An empty or relative one would be a folder of the place where the command is called."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("COUNTERFLEX_CACHE", "")
    for base in ("", "relative"):
        monkeypatch.setenv("XDG_CACHE_HOME", base)
        assert user_folder() == tmp_path / ".cache" / "counterflex"
    monkeypatch.setenv("COUNTERFLEX_CACHE", "here")
    assert user_folder() == Path.cwd() / "here"


def test_without_a_place_of_the_user_kernels_lie_where_nobody_can_foresee(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """What another user laid into the temporary folder under the name of before is not read."""
    (tmp_path / "file").write_text("", encoding="utf-8")
    (tmp_path / "tmp" / "counterflex").mkdir(parents=True)
    monkeypatch.setenv("COUNTERFLEX_CACHE", str(tmp_path / "file" / "cache"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    root = jit._cache_root()
    assert root.parent == tmp_path / "tmp"
    assert root.name.startswith("counterflex-kernels-")
    assert stat.S_IMODE(root.stat().st_mode) == 0o700


def _deflected(cache: Path, temporary: Path) -> subprocess.CompletedProcess[str]:
    text = """
import sys
from counterflex.core.errors import CounterflexError
try:
    from counterflex.plan.bending_kernels import oscillator
    print(oscillator(0.0, 1.0, 0.1))
except CounterflexError as fault:
    sys.exit(f"error: {fault}")
"""
    given = os.environ | {"COUNTERFLEX_CACHE": str(cache), "TMPDIR": str(temporary)}
    return subprocess.run([sys.executable, "-c", text], env=given, capture_output=True, text=True, check=False)


def test_a_planted_object_is_never_unpickled_and_a_cut_off_one_is_compiled_anew(tmp_path: Path) -> None:
    cache, temporary = tmp_path / "cache", tmp_path / "tmp"
    temporary.mkdir()
    first = _deflected(cache, temporary)
    assert first.returncode == 0, first.stderr
    indices, mark = sorted(cache.rglob("*.nbi")), tmp_path / "planted"
    assert indices
    for file in indices:  # a power failure keeps a name and loses the content
        file.write_bytes(file.read_bytes()[:40])
    again = _deflected(cache, temporary)
    assert (again.returncode, again.stdout) == (0, first.stdout)
    space: dict[str, type] = {}
    exec(PLANTED.format(mark=str(mark)), space)
    for file in indices:
        file.write_bytes(pickle.dumps(space["Planted"]()))
    cache.chmod(0o777)
    refused = _deflected(cache, temporary)
    assert refused.returncode == 1
    assert refused.stderr.count("\n") == 1
    assert "other users can write" in refused.stderr
    assert not mark.exists()
    cache.chmod(0o700)
    _deflected(cache, temporary)
    assert mark.exists(), "the planted object is one that is executed where it is read"
