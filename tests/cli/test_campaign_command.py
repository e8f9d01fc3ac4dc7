"""The commands of the simulated laboratory: what they print, refuse, and leave when they are interrupted."""

from __future__ import annotations

import contextlib
import shutil
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from counterflex.cli.output import resumable_progress
from counterflex.core.progress import Progress


@contextlib.contextmanager
def _stopped_half_way(what: str, out: Path | None, kept: str = "") -> Iterator[Progress]:
    """The progress of a job whose reader presses Ctrl-C in the middle of it."""
    with resumable_progress(what, out, kept) as progress:

        def report(fraction: float, what: str = "") -> None:
            progress(fraction, what)
            if fraction >= 0.5:
                raise KeyboardInterrupt

        yield report


@pytest.mark.long
def test_an_interrupted_campaign_keeps_what_it_has(
    folder: Path, counterflex: Any, machined: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copy(machined.folder / "truth.toml", folder)
    command = ("campaign", "--cell", "cell.toml", "--twin", "truth.toml", "--recipe", "tracker-frame", "--out", "out")
    with monkeypatch.context() as patched:
        patched.setattr("counterflex.cli.commands.campaign.resumable_progress", _stopped_half_way)
        stopped = counterflex(*command, "--workers", "1")
    assert stopped.status == 130
    assert "finished steps are stored" in stopped.err
    assert "The same command continues" in stopped.err
    assert not (folder / "out" / "summary.json").exists()
    ended = counterflex(*command, "--workers", "1")
    assert ended.status == 0, ended.err
    assert "tracker-frame" in ended.out
    assert (folder / "out" / "report.html").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "--twin or --seeds"),
        (("--seeds", "1", "--twin", "cell.toml"), "--twin or --seeds"),
        (("--seeds", "1", "--recipe", "weather"), "weather"),
        (("--twin", "nowhere.toml"), "nowhere.toml"),
        (("--seeds", "1", "--no-identify", "--recipe", "play"), "--recipe or --no-identify"),
        (("--seeds", "1", "--no-identify", "--placements", "cell.toml"), "the columns are not those of placements"),
        (("part.ngc", "--seeds", "1", "--posture", "upright"), "no posture"),
        (("--seeds", "1", "--posture", "present"), "those of a program"),
        (("--seeds", "1", "--scheduler", "host"), "no address of a scheduler"),
        (("--seeds", "1", "--scheduler", "h:1", "--workers", "2"), "--scheduler or --workers"),
    ],
)
def test_refused(folder: Path, refused: Any, words: tuple[str, ...], said: str) -> None:
    assert said in refused("campaign", "--cell", "cell.toml", "--out", "out", *words)


def test_a_cluster_that_is_not_there(folder: Path, refused: Any) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    message = refused("campaign", "--seeds", "1", "--scheduler", f"127.0.0.1:{port}", "--out", "out")
    assert f"--scheduler tcp://127.0.0.1:{port}: no scheduler answers there" in message
    assert not (folder / "out").exists()


def test_twin_measure_prints_what_it_measured(folder: Path, counterflex: Any, refused: Any, machined: Any) -> None:
    shutil.copy(machined.folder / "truth.toml", folder)
    propose = ("identify", "tracker-frame", "--propose", "12", "--cell", "cell.toml", "--out", "proposal")
    assert counterflex(*propose).status == 0
    measure = ("twin", "measure", "proposal/proposal.toml", "--cell", "cell.toml", "--truth", "truth.toml")
    ended = counterflex(*measure, "--out", "data", "--seed", "3")
    assert ended.status == 0, ended.err
    assert "tracker-frame.toml" in ended.out
    assert "tracker_poses" in ended.out
    assert "could be replaced" in refused(*measure, "--out", "proposal")
    assert "no such file" in refused(*measure[:2], "none.toml", *measure[3:], "--out", "data")
