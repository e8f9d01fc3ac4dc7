"""The doctor command and what depends on it; the machine's speed plays no part: samples are given, or not judged."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app import doctor as job
from counterflex.core.errors import InputError, OutputError
from counterflex.evaluate.loop_timing import LoopSamples
from counterflex.files.machine_file import StoredVerdict, read_verdict, write_verdict
from counterflex.protocols.system.machine import Machine, look, processor_times, read_stat
from counterflex.protocols.system.realtime import Granted
from counterflex.runtime.state.supervisor import State

Give = Callable[..., None]


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of the kept verdict, for this test."""
    file = tmp_path / "kept" / "machine.json"
    monkeypatch.setattr("counterflex.app.doctor.machine_file", lambda: file)
    return file


@pytest.fixture
def give(monkeypatch: pytest.MonkeyPatch, kept: Path) -> Give:
    """Let the next measurement be this: so many replies as late as said."""

    def chosen(late: int, *, cycles: int = 2500, fifo: bool = True) -> None:
        series = np.full(cycles, 40e-6)
        series[:late] = 9e-3
        samples = LoopSamples(
            4e-3, series, np.full(cycles, 12e-6), np.full(cycles, 50e-6), np.ones(9) * 1e-5, np.ones(2) * 1e-3, fifo
        )
        granted = Granted(fifo, True, True, () if fifo else ("real-time priority: Operation not permitted",))
        answer = samples, granted, Machine(4, ("performance",), "tsc", False, None)
        monkeypatch.setattr("counterflex.app.doctor.probe", lambda *_: answer)

    return chosen


def test_a_fit_machine(folder: Path, counterflex: Any, give: Give, kept: Path) -> None:
    give(0)
    ended = counterflex("doctor")
    assert (ended.status, ended.err) == (0, "")
    assert "fits: 100.00% of the replies within 3000 us" in ended.out
    verdict = read_verdict(kept)
    assert verdict is not None
    assert (verdict.fits, verdict.host, verdict.kernel) == (True, platform.node(), platform.release())
    job.require_fit()
    with pytest.raises(InputError, match="8 days ago"):
        job.require_fit(datetime.now(UTC) + timedelta(days=8, minutes=1))


def test_an_unfit_machine_is_not_armed(folder: Path, counterflex: Any, refused: Any, give: Give, kept: Path) -> None:
    give(3)
    ended = counterflex("doctor")
    assert ended.status == 1
    assert "does not fit" in ended.out
    assert "wake-up latency" in ended.out
    (folder / "rsi.xml").write_text("<ROOT/>", encoding="utf-8")
    words = ("run", "--cell", "cell.toml", "--rsi", "rsi.xml", "--out", "log")
    said = refused(*words, "--arm")
    assert "does not keep time" in said
    assert "--trust-machine" in said
    for more in (("--arm", "--trust-machine"), ("--arm", "-s", "run.lockstep=true"), ()):
        assert "does not keep time" not in refused(*words, *more)


def test_without_a_verdict_nothing_is_armed(kept: Path) -> None:
    with pytest.raises(InputError, match="counterflex doctor first"):
        job.require_fit()
    stale = StoredVerdict("elsewhere", platform.release(), datetime.now(UTC), "fits", True, 1e-3, 3e-3, ())
    write_verdict(kept, stale)
    with pytest.raises(InputError, match="elsewhere"):
        job.require_fit()


def test_what_was_measured_too_briefly_is_not_kept(folder: Path, counterflex: Any, give: Give, kept: Path) -> None:
    give(0, cycles=500)
    ended = counterflex("doctor", "--json")
    found = json.loads(ended.out)
    assert (ended.status, found["fits"], found["cycles"]) == (1, False, 500)
    assert "measure for 4 s" in found["reasons"][0]
    assert not kept.exists()


def test_a_machine_without_real_time_priority_is_told_how(folder: Path, counterflex: Any, give: Give) -> None:
    give(0, fifo=False)
    ended = counterflex("doctor")
    assert ended.status == 0
    assert "tight" in ended.out
    assert "rtprio" in ended.out


@pytest.mark.long
def test_the_real_measurement_has_all_its_parts(tmp_path: Path) -> None:
    """Processes, sockets and disk for a tenth of a second; what comes out is not judged."""
    samples, granted, machine = job.probe(0.1, tmp_path / "not" / "there")
    assert samples.late_s.shape == samples.compute_s.shape == samples.echo_s.shape == (25,)
    assert np.all(samples.late_s >= 0.0)
    assert np.all(samples.compute_s > 0.0)
    assert np.all((samples.echo_s > 0.0) | np.isnan(samples.echo_s))
    assert granted.collector
    assert machine.cores >= 1
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError):
        job.probe(0.0, tmp_path)


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(**_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("counterflex.app.doctor.tempfile.TemporaryFile", refuse)
    with pytest.raises(OutputError, match="Permission denied"):
        job.probe(0.1, tmp_path)


def test_the_loop_that_is_timed_corrects() -> None:
    """Else its step would be timed where it has little to do."""
    loop = job.demo_loop()
    for k in range(600):
        job.feed(loop, k)
    assert loop.state == State.ACTIVE
    assert np.linalg.norm(loop.correction[:3]) > 1e-6


def test_stolen_time_of_the_kernel_s_line() -> None:
    assert read_stat("cpu  10 1 5 100 2 0 3 7 0 0\ncpu0 1 2 3") == (128, 7)
    assert read_stat("") == read_stat("cpu0 1 2 3 4 5 6 7 8") == read_stat("cpu a b c d e f g h i") == (0, 0)
    assert look().cores >= 1
    total, stolen = processor_times()
    assert total >= stolen >= 0
