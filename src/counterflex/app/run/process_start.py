"""The start of a process of a run: signals wait until it can deal with them, and it is waited for with a limit."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from types import FrameType
from typing import Any, Final

from counterflex.app.run.process import END_S
from counterflex.core.errors import OutputError
from counterflex.core.units import NS
from counterflex.protocols.system.signals import SIGNALS

SILENT_S: Final = 60.0
"""A process that has not said for so long that it lives does not come up; importing all it needs takes 2 to 10 s."""
READY_S: Final = 600.0
"""How long one that lives may take: the first start compiles, for a minute or two."""
_POLL_S: Final = 0.1
_HINT: Final = (
    "Nothing was sent to the robot. Look whether the machine stands still (a full memory, a disk or network drive that"
    " does not answer, a stopped process), then start again; counterflex doctor compiles without a robot"
)


@contextlib.contextmanager
def signals_wait() -> Iterator[None]:
    """Within, a signal that asks to end waits, and processes that are started are started with it blocked.

    So a process is never interrupted half started, where it could only show a traceback. It hears what waits when it
    calls :func:`counterflex.protocols.system.signals.hear_signals`; this one hears it at the end of the block.
    """
    pending: list[int] = []
    later: Callable[[int, FrameType | None], None] = lambda number, _: pending.append(number)  # noqa: E731
    main = threading.current_thread() is threading.main_thread()
    handled = [number for number in SIGNALS if signal.getsignal(number) not in (signal.SIG_IGN, None)] if main else []
    before = {number: signal.signal(number, later) for number in handled}
    masked = hasattr(signal, "pthread_sigmask")
    if masked:
        resource_tracker.ensure_running()  # its start would let the signals through again
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        if masked:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in pending[:1]:
            signal.raise_signal(number)


def first_word(
    process: BaseProcess,
    pipe: Any,
    who: str,
    lived_ns: Callable[[], int],
    waiting: Callable[[float], None] = lambda _: None,
) -> Any:
    """Wait for what a process says when it is ready.

    Args:
        process: Started.
        pipe: On which it says it.
        who: What it is called in a message.
        lived_ns: When it last said that it lives, monotonic; 0: never.
        waiting: Told again and again for how many seconds it has been waited for.

    Returns:
        What it said.

    Raises:
        CounterflexError: What it could not do, if it says so.
        OutputError: It died, has not said that it lives for :data:`SILENT_S`, or is not ready after :data:`READY_S`.
    """
    begin_ns = time.monotonic_ns()
    try:
        while not pipe.poll(_POLL_S):
            now_ns = time.monotonic_ns()
            silent_s, waited_s = ((now_ns - then) * NS for then in (max(lived_ns(), begin_ns), begin_ns))
            waiting(waited_s)
            if silent_s > SILENT_S:
                raise OutputError(f"{who} does not come up", value=f"silent for {silent_s:.0f} s", hint=_HINT)
            if waited_s > READY_S:
                raise OutputError(f"{who} does not get ready", value=f"waited for {waited_s:.0f} s", hint=_HINT)
        message = pipe.recv()
    except (EOFError, ConnectionError):
        process.join(END_S)
        raise OutputError(f"{who} died before it began", value=process.exitcode) from None
    if isinstance(message, BaseException):
        raise message
    return message
