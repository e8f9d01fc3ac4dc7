"""Ctrl-C that always arrives, only where Python can bear it, and is told in the exit status; the line of an error."""

from __future__ import annotations

import _thread
import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any, Final, NoReturn

_AGAIN_S: Final = 0.05
_SIGNALS: Final = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
_STARTER: Final = "COUNTERFLEX_ENDS_WITH_STDIN"
_PATIENCE_S: Final = 10.0
"""Time that an interrupted command has to keep what it can after its starter has died."""
_received: list[int] = []
_written: list[str] = []
_worse: list[int] = []


def status() -> int | None:
    """Exit status of a command that a signal has asked to end: 128 and its number (130 Ctrl-C); None: none has.

    What went wrong before comes first, see :func:`went_wrong`.
    """
    if _received and _worse:
        return _worse[0]
    return 128 + _received[0] if _received else None


def went_wrong(status: int) -> None:
    """Say that something went wrong that a script must learn also where a signal ended the command.

    Args:
        status: The command's own exit status for it.
    """
    _worse[:] = [status]


def keeps(what: str) -> None:
    """Say what stays when this command is interrupted, because it writes while it goes on.

    Args:
        what: A clause, for example ``"the log is in out"``.
    """
    _written[:] = [what]


def result_text() -> str:
    """Return what an interrupted command has left, for its last line."""
    return _written[0] if _written else "nothing was written"


def _later() -> None:
    """Interrupt the main thread again in a moment."""
    timer = threading.Timer(_AGAIN_S, _thread.interrupt_main)
    timer.daemon = True
    timer.start()


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, but not within an import: compiled modules do not survive it half-initialised."""
    _received.append(number)
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            _later()
            return
        frame = frame.f_back
    raise KeyboardInterrupt


def _again(report: Callable[[Any], object], lost: Any) -> None:
    if issubclass(lost.exc_type, KeyboardInterrupt):
        _later()
    else:
        report(lost)


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Let Ctrl-C, a request to terminate and a terminal that is closed raise KeyboardInterrupt; none is ever lost.

    An exception raised while foreign code calls back (the compiler of the kernels does) is not passed on by Python, so
    an interrupt lost there is sent again a moment later. A signal that is ignored from outside (``nohup``) stays so.
    Outside the main thread nothing is changed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    report = sys.unraisablehook
    _received.clear()
    _written.clear()
    _worse.clear()

    handled = [number for number in _SIGNALS if number == signal.SIGINT or signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, _interrupt) for number in handled}
    sys.unraisablehook = lambda lost: _again(report, lost)
    try:
        yield
    finally:
        sys.unraisablehook = report
        for number, handler in before.items():
            signal.signal(number, handler)


def end_with_starter() -> None:
    """Interrupt this command when standard input ends: its starter closes the pipe, or has died, however it did.

    Only where the starter asks for it (``COUNTERFLEX_ENDS_WITH_STDIN=1``). The command itself reads an empty input.
    """
    if os.environ.pop(_STARTER, "") != "1":  # not for what this process starts
        return
    pipe = os.dup(0)
    empty, other = os.pipe()
    os.close(other)
    os.dup2(empty, 0)
    os.close(empty)
    threading.Thread(target=_follow, args=(pipe,), name="starter", daemon=True).start()


def _follow(pipe: int) -> None:
    with contextlib.suppress(OSError):
        while os.read(pipe, 4096):
            pass
    if sys.platform == "win32":
        _thread.interrupt_main(signal.SIGTERM)
    else:  # ends a wait of the main thread, too
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)
    threading.Event().wait(_PATIENCE_S)
    os._exit(128 + signal.SIGTERM)


def end(line: str, status: int = 2) -> NoReturn:
    """End the command with a line on standard error."""
    print(f"error: {' '.join(line.split())}", file=sys.stderr)
    sys.exit(status)
