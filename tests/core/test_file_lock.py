"""Files that are edited: one process at a time, no entry is lost, and nobody waits for ever."""

from __future__ import annotations

import multiprocessing
import os
from pathlib import Path
from typing import Any

import pytest

from counterflex.core import held
from counterflex.core.errors import OutputError
from counterflex.core.held import PATIENCE_S, alone
from counterflex.files.panel_users import PanelUsers, set_user

SPAWN = multiprocessing.get_context("spawn")


def _count(path: str, times: int, begin: Any) -> None:
    begin.wait()
    for _ in range(times):
        with alone(path):
            number = int(Path(path).read_text())
            part = Path(f"{path}.{os.getpid()}")
            part.write_text(str(number + 1))
            part.replace(path)


def _add(path: str, name: str, begin: Any) -> None:
    begin.wait()
    set_user(Path(path), name, "viewer", "a long password")


def _all_at_once(work: Any, arguments: list[tuple[Any, ...]]) -> None:
    begin = SPAWN.Barrier(len(arguments))
    processes = [SPAWN.Process(target=work, args=(*one, begin)) for one in arguments]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert [process.exitcode for process in processes] == [0] * len(arguments)


@pytest.mark.long
def test_six_processes_that_edit_a_file_lose_nothing(tmp_path: Path) -> None:
    (tmp_path / "count").write_text("0")
    _all_at_once(_count, [(str(tmp_path / "count"), 50)] * 6)
    assert (tmp_path / "count").read_text() == "300"
    assert [one.name for one in tmp_path.iterdir()] == ["count"]


@pytest.mark.long
def test_six_users_added_at_once_are_all_there(tmp_path: Path) -> None:
    _all_at_once(_add, [(str(tmp_path / "users.toml"), f"user{k}") for k in range(6)])
    assert set(PanelUsers(tmp_path / "users.toml").users) == {f"user{k}" for k in range(6)}


def test_who_holds_a_file_for_too_long_is_told(tmp_path: Path) -> None:
    """As another process would: a lock belongs to an open file."""
    handle = os.open(tmp_path, os.O_RDONLY)
    assert held.own(handle)
    now = [100.0]

    def wait(seconds: float) -> None:
        now[0] += seconds

    try:
        with (
            pytest.raises(OutputError, match="another process edits a file in this folder") as fault,
            alone(tmp_path / "users.toml", clock_s=lambda: now[0], wait=wait),
        ):
            pytest.fail("it was held by another one")
    finally:
        os.close(handle)
    assert now[0] == pytest.approx(100.0 + PATIENCE_S, abs=0.1)
    assert str(tmp_path) in str(fault.value)
    with alone(tmp_path / "users.toml"):
        pass


def test_blocks_of_one_thread_lie_in_each_other_and_links_lead_to_the_file(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link.toml").symlink_to(tmp_path / "real" / "users.toml")
    with alone(tmp_path / "link.toml"), alone(tmp_path / "real" / "users.toml"):
        handle = os.open(tmp_path / "real", os.O_RDONLY)
        assert held.own(handle) is False
        os.close(handle)
    with pytest.raises(ZeroDivisionError), alone(tmp_path / "link.toml"):
        raise ZeroDivisionError
    handle = os.open(tmp_path / "real", os.O_RDONLY)
    assert held.own(handle)
    os.close(handle)


def test_a_folder_that_is_not_there_yet_is_held_by_the_one_above(tmp_path: Path) -> None:
    with alone(tmp_path / "none" / "deep" / "users.toml"):
        assert not (tmp_path / "none").exists()
        handle = os.open(tmp_path, os.O_RDONLY)
        assert held.own(handle) is False
        os.close(handle)
