"""Where an operator finds a run: by the file in its folder, or by the loop's lock where the folder has gone."""

from __future__ import annotations

import json
import os
import shutil
import stat
from pathlib import Path

import pytest

from counterflex.core.errors import FileFormatError, InputError
from counterflex.protocols.processes.control_array import CONTROL
from counterflex.protocols.processes.instance_lock import InstanceLock
from counterflex.protocols.processes.operator_words import FILE, OperatorFile, find
from counterflex.protocols.processes.shared_words import SharedWords


def test_only_the_user_can_read_the_file_and_it_goes_with_the_run(tmp_path: Path) -> None:
    left = tmp_path / FILE
    left.write_text("left by a run that was killed", encoding="utf-8")
    with SharedWords(CONTROL) as words:
        made = OperatorFile(tmp_path, words.path)
        assert stat.S_IMODE(left.stat().st_mode) == 0o600
        with find(tmp_path, tmp_path) as found:
            found.words[1] = 1
        assert words.words[1] == 1
        made.close()
        words.remove()
    assert not left.exists()


def test_a_run_whose_folder_was_removed_is_found_by_its_lock(tmp_path: Path) -> None:
    log, locks = tmp_path / "log", tmp_path / "locks"
    log.mkdir()
    with SharedWords(CONTROL) as words:
        made = OperatorFile(log, words.path)
        with InstanceLock(locks, 49152, run=str(log), words=str(words.path)):
            shutil.rmtree(log)
            with find(log, locks) as found:
                found.words[1] = 1
            with pytest.raises(FileFormatError, match="no run goes on there"):
                find(tmp_path / "other", locks)
        assert words.words[1] == 1
        with pytest.raises(FileFormatError, match="no run goes on there"):
            find(log, locks)
        made.close()
        words.remove()


def test_without_a_run_there_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="no run goes on there"):
        find(tmp_path, tmp_path)
    for rubbish in ("[]", "{", "7", '{"words": 3}'):
        (tmp_path / FILE).write_text(rubbish, encoding="utf-8")
        with pytest.raises(FileFormatError, match="is not the file of a run"):
            find(tmp_path, tmp_path)
    (tmp_path / FILE).write_text('{"words": "/nowhere/counterflex-words-x", "pid": 1}', encoding="utf-8")
    with pytest.raises(FileFormatError, match="has ended without removing it"):
        find(tmp_path, tmp_path)


def test_a_file_that_points_elsewhere_is_refused_and_nothing_is_written_there(tmp_path: Path) -> None:
    """The folder of a run may be another user's, or come out of an archive."""
    run, target = tmp_path / "run", tmp_path / "target"
    run.mkdir()
    target.write_bytes(bytes(8 * CONTROL))  # as large as the shared numbers
    target.chmod(0o600)
    said = json.dumps({"words": str(target), "pid": 1})
    linked = tmp_path / "counterflex-words-linked"
    linked.symlink_to(target)
    second = tmp_path / "counterflex-words-second"
    second.hardlink_to(target)
    for content in (said, *(json.dumps({"words": str(one), "pid": 1}) for one in (linked, second)), "[" * 100_000):
        (run / FILE).write_text(content, encoding="utf-8")
        with pytest.raises(FileFormatError, match="no run goes on there|is not the file of a run") as told:
            find(run, tmp_path)
        assert "\n" not in str(told.value)
    (run / FILE).unlink()
    (tmp_path / "file").write_text(said, encoding="utf-8")
    for other in (tmp_path / "file", Path("/dev/zero")):
        (run / FILE).symlink_to(other)
        with pytest.raises(FileFormatError, match="cannot be read"):
            find(run, tmp_path)
        (run / FILE).unlink()
    os.mkfifo(run / FILE)  # nobody writes into it: it is not waited for
    with pytest.raises(FileFormatError, match="is not the file of a run"):
        find(run, tmp_path)
    assert target.read_bytes() == bytes(8 * CONTROL)


def test_shared_numbers_that_others_can_read_are_none(tmp_path: Path) -> None:
    with SharedWords(CONTROL) as words:
        words.path.chmod(0o644)
        with pytest.raises(InputError, match="not the shared memory of a run of yours"):
            SharedWords(CONTROL, words.path)
        words.remove()
