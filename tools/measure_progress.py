"""Processor time of the parts of a command, as its progress names them: what the weights of the parts are set from.

Runs one command in this process and notes every report of progress. Of each part (reports one behind the other that
say the same but for numbers) the table says the share of the processor time and of the bar that it took. Where both
columns are alike, the weights are right.

Run: ``python tools/measure_progress.py [--wall] COMMAND ...``, for example with ``identify stiffness pulls.toml
--cell cell.toml --out found``. ``--wall`` counts elapsed time, for commands that work in other processes.
"""

from __future__ import annotations

import re
import sys
import time
from dataclasses import dataclass


@dataclass
class Part:
    """A part of the work."""

    what: str  # its name, numbers left out
    seconds: float  # it took
    begin: float  # fraction of the bar at its begin
    end: float  # at its end


def gathered(reports: list[tuple[float, float, str]], begin_s: float, end_s: float) -> list[Part]:
    """Parts of reports (time, fraction, what): what passes before a report belongs to the part that it names."""
    parts: list[Part] = []
    before, at = begin_s, 0.0
    for time_s, fraction, what in reports:
        name = re.sub(r"\d+ of \d+|round \d+", "#", what)
        if not parts or parts[-1].what != name:
            parts.append(Part(name, 0.0, at, at))
        parts[-1].seconds += time_s - before
        before, at = time_s, max(at, fraction)
        parts[-1].end = at
    parts.append(Part("after the last report", end_s - before, at, 1.0))
    return parts


def main() -> int:
    """Run the command, print the table."""
    words = sys.argv[1:]
    clock = time.perf_counter if words[:1] == ["--wall"] else time.process_time
    words = words[1:] if words[:1] == ["--wall"] else words
    if not words or words[0] in ("--help", "-h"):
        print(__doc__)
        return 0
    from counterflex.cli.start import run as command
    from counterflex.core.meter import Meter

    reports: list[tuple[float, float, str]] = []
    began: list[float] = []

    class Noting(Meter):
        def __init__(self, what: str) -> None:
            super().__init__(what)
            began.append(clock())

        def report(self, fraction: float, what: str = "") -> None:
            super().report(fraction, what)
            reports.append((clock(), fraction, what))

    sys.modules["counterflex.core.meter"].Meter = Noting  # type: ignore[attr-defined]
    sys.argv = ["counterflex", *words]
    status = 0
    try:
        command()
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
    if not began:
        print("this command tells no progress")
        return status
    parts = gathered(reports, began[0], clock())
    total = sum(part.seconds for part in parts)
    print(f"{'part':50s} {'s':>8s} {'time':>7s} {'bar':>7s}")
    for part in parts:
        shares = (100.0 * part.seconds / total, 100.0 * (part.end - part.begin))
        print(f"{part.what:50.50s} {part.seconds:8.2f} {shares[0]:5.1f} % {shares[1]:5.1f} %")
    return status


if __name__ == "__main__":
    sys.exit(main())
