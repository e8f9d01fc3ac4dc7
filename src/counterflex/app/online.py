"""Correct while milling: the loop in a process of its own, beside it the recorder and what the operator asks for."""

from __future__ import annotations

import contextlib
import hashlib
import multiprocessing
import time
from collections.abc import Callable
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from counterflex import __version__
from counterflex.app.made_on import made_on
from counterflex.app.online_process import END_S, loop_process
from counterflex.app.online_session import RunSettings, one_protocol
from counterflex.app.recorder import Recorder, Status
from counterflex.core.errors import OutputError
from counterflex.files.run_log import RunLog
from counterflex.files.summary_file import write_summary
from counterflex.links.control_array import CONTROL, Request
from counterflex.links.operator_port import OperatorPort
from counterflex.runtime.record_ring import RecordRing

SUMMARY = "summary.json"
AS_ASKED = "as asked"
"""How a loop ended that ended by itself."""


def run(
    settings: RunSettings,
    out: str | Path,
    *,
    watch: Callable[[Status], None] = lambda _: None,
    most_s: float | None = None,
    started: Callable[[tuple[str, int]], None] = lambda _: None,
    ended: Callable[[], bool] = lambda: False,
    told: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Run the loop in a process of its own and record it from this one.

    Args:
        settings: See :class:`RunSettings`.
        out: Folder of the run log.
        watch: Told the status twice a second.
        most_s: End after so long; None goes on until the telegrams stop.
        started: Told the address at which telegrams are expected, once.
        ended: Whether the robot is known to be gone; asked now and then.
        told: Told of what is unusual in the cell file, a line each.

    Returns:
        Summary: cycles, times, states, losses, what process monitoring found; also written as ``summary.json``.

    Raises:
        CounterflexError: As :func:`open_session`, and when the log cannot be begun.
    """
    one_protocol(settings)
    context = multiprocessing.get_context("spawn")
    control = context.Array("q", CONTROL, lock=False)
    parent, child = context.Pipe()
    ring = RecordRing()
    log: RunLog | None = None
    operator: OperatorPort | None = None
    process: BaseProcess | None = None
    try:
        process = context.Process(target=loop_process, args=(settings, ring.name, control, child), daemon=True)
        process.start()
        child.close()
        try:
            said = parent.recv()
        except EOFError:
            raise OutputError("the loop's process died before it began", value=process.exitcode) from None
        if isinstance(said, BaseException):
            raise said
        where, loop_sha256, unusual = said
        for line in unusual:
            told(line)
        log = RunLog(out, _about(settings, loop_sha256))
        started(where)
        operator = OperatorPort(Path(out))
        recorder = Recorder(ring.name, log, control, operator, watch, arm=settings.arm)
        begin = time.monotonic()
        try:
            while process.is_alive():
                with contextlib.suppress(EOFError):
                    while parent.poll():
                        recorder.hear(parent.recv())
                over = most_s is not None and time.monotonic() - begin > most_s
                recorder.work(end=over or ended())
            recorder.last()
            with contextlib.suppress(EOFError):
                while parent.poll():
                    recorder.hear(parent.recv())
        finally:
            recorder.close()
        summary = {
            **recorder.summary(),
            "seconds": round(time.monotonic() - begin, 2),
            "loop_ended": AS_ASKED if process.exitcode == 0 else f"died ({process.exitcode})",
        }
        write_summary(Path(out) / SUMMARY, {"job": "run", "cell": settings.cell.name, **summary})
        return summary
    finally:
        control[Request.END] = 1
        if operator is not None:
            operator.close()
        if log is not None:
            log.close()
        if process is not None:
            process.join(END_S)
        ring.close()


def _about(settings: RunSettings, loop_sha256: str) -> dict[str, Any]:
    files = {"cell": settings.cell, "rsi": settings.rsi, "plan": settings.plan, "program": settings.program}
    hashes = {
        name: hashlib.sha256(Path(p).read_bytes()).hexdigest() for name, p in files.items() if p and Path(p).is_file()
    }
    return {
        "counterflex": __version__,
        "files": {name: str(p) for name, p in files.items() if p},
        "sha256": hashes,
        "loop_sha256": loop_sha256,
        "machine": made_on(),
        "compensated": settings.compensated,
        "wall_minus_monotonic_ns": time.time_ns() - time.monotonic_ns(),
    }
