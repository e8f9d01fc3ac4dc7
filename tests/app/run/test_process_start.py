"""The start and the end of a run's processes: waited for with a limit, and no signal comes at a wrong moment."""

from __future__ import annotations

import multiprocessing
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path
from typing import Any, cast

import pytest

from counterflex.app.run import process as process_start, run as online
from counterflex.app.run.process import first_word, loop_process, signals_wait
from counterflex.app.run.recorder import recorder_process
from counterflex.app.run.run import Supervised
from counterflex.core.errors import InputError, OutputError
from counterflex.protocols.processes.control_array import CONTROL, Request
from counterflex.protocols.processes.shared_words import SharedWords
from counterflex.protocols.system.signals import SIGNALS

READY: tuple[object, ...] = (("127.0.0.1", 49152), "0" * 64, {}, [], [], "")


class Process:
    """A process that is played: says what it is given when it is started."""

    exitcode = -9

    def __init__(self, theirs: Any, says: object = None) -> None:
        self._theirs, self._says = theirs, says
        self.pid: int | None = None
        self.killed = False
        self.during_join: signal.Signals | None = None

    def start(self) -> None:
        self.pid = 1
        if self._says is not None:
            self._theirs.send(self._says)

    def is_alive(self) -> bool:
        return not self.killed

    def kill(self) -> None:
        self.killed = True

    def join(self, _: float) -> None:
        if self.during_join is not None:
            signal.raise_signal(self.during_join)


@pytest.fixture
def supervised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Supervised:
    def process(made: Supervised, name: str, *_: object) -> tuple[Process, Any]:
        ours, theirs = multiprocessing.Pipe()
        made._pipes += [ours, theirs]
        return Process(theirs, READY if name == "loop" else None), ours

    monkeypatch.setattr(Supervised, "_process", process)
    monkeypatch.setattr(online, "_about", lambda *_: {})
    return Supervised(cast(Any, None), tmp_path / "log")


def played(process: Any) -> Process:
    return cast(Process, process)


def test_who_does_not_come_up_is_not_waited_for_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, _theirs = multiprocessing.Pipe()
    monkeypatch.setattr(process_start, "_POLL_S", 0.001)
    monkeypatch.setattr(process_start, "SILENT_S", 0.01)
    monkeypatch.setattr(process_start, "READY_S", 0.03)
    with pytest.raises(OutputError, match="the loop's process does not come up.*silent") as told:
        first_word(cast(Any, None), ours, "the loop's process", lambda: 0)
    assert "Nothing was sent to the robot" in str(told.value)
    asked: list[int] = []

    def alive_ns() -> int:
        asked.append(time.monotonic_ns())
        assert len(asked) < 1000, "waited for without end"
        return asked[-1]

    with pytest.raises(OutputError, match="does not get ready"):  # it lives, and lives, and is never ready
        first_word(cast(Any, None), ours, "the loop's process", alive_ns)


def test_what_it_could_not_do_and_its_death_are_told() -> None:
    ours, theirs = multiprocessing.Pipe()
    theirs.send(InputError("no such cell"))
    with pytest.raises(InputError, match="no such cell"):
        first_word(cast(Any, None), ours, "the loop's process", lambda: 0)
    theirs.close()
    with pytest.raises(OutputError, match="died before it began.*-9"):
        first_word(cast(Any, Process(None)), ours, "the loop's process", lambda: 0)


def test_a_recorder_that_dies_while_the_loop_gets_ready_is_told(supervised: Supervised) -> None:
    """It was a broken pipe like that of a closed terminal: exit status 0 or 1 silently."""
    with pytest.raises(OutputError, match="the recorder's process died before it began"):
        supervised.begin()
    supervised.close()
    assert not played(supervised.loop).killed  # it was up: it ends by itself


def test_a_loop_that_is_not_up_is_ended_at_once(supervised: Supervised) -> None:
    played(supervised.loop).pid = 1
    supervised.close()
    assert played(supervised.loop).killed


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_further_signal_while_it_clears_up_leaves_nothing_behind(
    supervised: Supervised, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, number: signal.Signals
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(number, interrupt)
    try:
        monkeypatch.setattr(online, "Supervised", lambda *_: supervised)
        monkeypatch.setattr(online, "one_protocol", lambda given: given)
        played(supervised.loop).during_join = number
        words, ring = supervised._words.path, supervised._ring.name
        assert words.exists()
        with pytest.raises(KeyboardInterrupt):
            online.run(cast(Any, None), tmp_path / "log")
    finally:
        signal.signal(number, before)
    assert not words.exists()
    assert not list(tmp_path.rglob(".run.lock"))
    with pytest.raises(FileNotFoundError):
        SharedMemory(ring)


def test_an_interrupt_while_the_summary_is_waited_for_does_not_lose_it(supervised: Supervised) -> None:
    said: Iterator[Any] = iter([KeyboardInterrupt(), {"cycles": 3}, KeyboardInterrupt()])

    def summary() -> dict[str, Any]:
        one = next(said)
        if isinstance(one, BaseException):
            raise one
        return cast(dict[str, Any], one)

    supervised.summary = summary  # type: ignore[method-assign]
    assert supervised.loop_report() == {"cycles": 3}
    with pytest.raises(KeyboardInterrupt):
        supervised.loop_report()
    supervised.close()


def test_a_signal_waits_until_all_is_started() -> None:
    came = []
    before = signal.signal(signal.SIGTERM, lambda *_: came.append(1))
    try:
        with signals_wait():
            signal.raise_signal(signal.SIGTERM)
            assert came == []
        assert came == [1]
    finally:
        signal.signal(signal.SIGTERM, before)


BORN = """
import os, signal
os.kill(os.getpid(), signal.SIGTERM)
os.kill(os.getpid(), signal.SIGINT)
from counterflex.protocols.system.signals import hear_signals
came = []
for number in (signal.SIGTERM, signal.SIGINT):
    signal.signal(number, lambda n, _: came.append(n))
hear_signals()
print(sorted(came))
"""


def test_a_process_is_started_with_signals_waiting_and_hears_them_when_it_can() -> None:
    """Ctrl-C in a terminal goes to every process of the run, also to one that has only begun to import."""
    with signals_wait():
        started = subprocess.Popen([sys.executable, "-c", BORN], stdout=subprocess.PIPE, text=True)
    out, _ = started.communicate()
    assert (started.returncode, out.strip()) == (0, "[2, 15]")


@pytest.mark.parametrize("which", ["loop", "recorder"])
def test_both_processes_let_through_what_they_were_started_with_waiting(tmp_path: Path, which: str) -> None:
    """A loop that never heard SIGTERM could not be asked to end by the system."""
    ours, theirs = multiprocessing.Pipe()
    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGTSTP")
    before = {number: signal.getsignal(number) for number in (getattr(signal, name) for name in names)}
    with SharedWords(CONTROL) as shared, signals_wait():
        if which == "loop":
            loop_process(cast(Any, None), "no such ring", shared.path, tmp_path, theirs)
        else:
            ours.close()
            recorder_process("no such ring", shared.path, tmp_path, theirs)
        waiting = signal.pthread_sigmask(signal.SIG_BLOCK, [])
        for number, handler in before.items():
            signal.signal(number, handler)
        shared.remove()
    assert not waiting & set(SIGNALS)


def test_an_interrupt_as_it_is_let_arm_ends_it_as_any_other(
    supervised: Supervised, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The loop may correct already: it was left alone, and "nothing was written" said of its log."""

    def interrupted(_: object) -> None:
        raise KeyboardInterrupt

    def once(*_: object) -> None:
        played(supervised.loop).killed = True

    monkeypatch.setattr(Supervised, "_permit", interrupted)
    monkeypatch.setattr(Supervised, "_watch", once)
    supervised.watch(lambda _: None, lambda: False, None)
    assert supervised.control[Request.END] == 1
    supervised.close()
