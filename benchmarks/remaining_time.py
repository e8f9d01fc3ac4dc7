"""Compare the remaining time that long commands report with the time that was left.

Runs commands with a line of progress every half second on a pipe, and says of each: how long it took, at which share
of that time the bar stood at 25, 50 and 75 %, and the time left that was told over the true one: at a quarter of the
work, when the bar stands at 25 %, and at a quarter of the time, which for a short command is that of starting. The goal
is a factor of 2 either way at a quarter of the work. Starting Python and loading the job counts as time, compiling
kernels does not: each command is run once before, unless ``--cold``.

Run: ``python benchmarks/remaining_time.py [--quick] [--only NAME ...] [--out FILE]``
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

GOAL = 2.0
"""Factor within which the time left has to be."""
SHORTEST_S = 2.0
"""Where less time is left, whole seconds cannot say it within the goal: too short."""
_LINE = re.compile(r"(?P<what>.*): (?P<percent>\d+) %(?:, about (?P<left>.+) left)?$")
_COMMAND = (sys.executable, "-m", "counterflex")
_PREPARE = (
    ("cell", "example", "--out", "cell.toml"),
    ("truth", "cell-small.toml", "--seed", "1", "--out", "truth.toml"),
)
_TRACKER: tuple[tuple[str, ...], ...] = (
    ("identify", "tracker-frame", "--propose", "12", "--cell", "cell-small.toml", "--out", "proposal-frame"),
    ("twin", "measure", "proposal-frame/proposal.toml", "--cell", "cell-small.toml", "--truth", "truth.toml",
     "--out", "measured-frame"),
    ("identify", "tracker-frame", "measured-frame/tracker-frame.toml", "--cell", "cell-small.toml",
     "--out", "found-frame"),
)  # fmt: skip
_MEASURED = ("tracker-frame", "kinematics", "stiffness", "cubes", "play", "timing", "servo", "payload", "cutting")
_COUNT = {
    "tracker-frame": 100,
    "kinematics": 200,
    "stiffness": 160,
    "cubes": 120,
    "play": 36,
    "timing": 20,
    "servo": 24,
    "payload": 60,
    "cutting": 16,
}
_TRACKED = "found-frame/cell.toml"
"""The small cell with its tracker, in whose axes pulls are measured."""
_LONG: dict[str, tuple[str, ...]] = {
    "compensate": ("compensate", "part.ngc", "--cell", "cell.toml", "--out", "compensated"),
    "simulate": ("simulate", "groove.ngc", "--cell", "cell-small.toml", "--truth", "truth.toml", "--out", "run"),
    "prove": ("prove", "groove.ngc", "--cell", "cell-small.toml", "--out", "proof"),
    "demo": ("demo", "--out", "demo"),
    "faults": ("faults", "--quick", "--no-realtime", "--out", "faults"),
    "campaign": ("campaign", "groove.ngc", "--cell", "cell-small.toml", "--twin", "truth.toml",
                 "--recipe", "tracker-frame", "--out", "campaign"),
    "reproduce groove": ("reproduce", "groove", "--quick", "--out", "groove"),
    "reproduce paths": ("reproduce", "paths", "--quick", "--out", "paths"),
}  # fmt: skip
_QUICK = ("simulate",)
_RESUMED = ("campaign", "reproduce groove", "reproduce paths")
"""They go on where they were: run once only, for a second run would find everything done."""


@dataclass(frozen=True)
class Told:
    """A line of progress."""

    time_s: float  # when it came, since the command was started
    fraction: float  # done, 0..1
    left_s: float | None  # time left that it says, or None


@dataclass(frozen=True)
class Watched:
    """A command that was watched."""

    duration_s: float  # how long it took
    told: tuple[Told, ...]  # its lines of progress, in order
    status: int  # exit status

    def time_share(self, fraction: float) -> float | None:
        """Share of the time at which the bar first stood at a fraction; None where it never did before the end."""
        return next((item.time_s / self.duration_s for item in self.told if item.fraction >= fraction), None)

    def ratio_at_work(self, share: float = 0.25) -> float | None:
        """Time left as told over the true one, at the first line behind a share of the work; None where none was."""
        return self._ratio([item for item in self.told if item.fraction >= share])

    def ratio_at_time(self, share: float = 0.25) -> float | None:
        """The same at the first line behind a share of the time."""
        return self._ratio([item for item in self.told if item.time_s >= share * self.duration_s])

    def within(self) -> bool:
        """Return whether the reported time is within the goal; its rounding to whole seconds counts as error."""
        ratio = self.ratio_at_work()
        return ratio is None or 1.0 / GOAL <= ratio <= GOAL

    def _ratio(self, items: list[Told]) -> float | None:
        for item in items:
            left_s = self.duration_s - item.time_s
            if item.left_s is not None:
                return item.left_s / left_s if left_s >= SHORTEST_S else None
        return None


def seconds_of(text: str) -> float:
    """Seconds of what a meter says: ``40 s``, ``3 min``, ``1 h 20 min``."""
    units = {"s": 1.0, "min": 60.0, "h": 3600.0}
    return sum(float(number) * units[unit] for number, unit in re.findall(r"([\d.]+) (h|min|s)\b", text))


def watch(words: tuple[str, ...], folder: Path, period_s: float) -> Watched:
    """Run a command and note its lines of progress."""
    environment = {**os.environ, "COUNTERFLEX_PROGRESS_S": f"{period_s:g}", "PYTHONUNBUFFERED": "1"}
    begin = time.perf_counter()
    told = []
    with subprocess.Popen(
        (*_COMMAND, *words), cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        for line in process.stderr or ():
            found = _LINE.fullmatch(line.strip())
            if found:
                left = None if found["left"] is None else seconds_of(found["left"])
                told.append(Told(time.perf_counter() - begin, float(found["percent"]) / 100.0, left))
    return Watched(time.perf_counter() - begin, tuple(told), process.returncode)


def commands(folder: Path, wanted: list[str], *, quick: bool) -> dict[str, tuple[str, ...]]:
    """Commands by name; what they need is made in the folder."""
    for words in _PREPARE:
        subprocess.run((*_COMMAND, *words), cwd=folder, check=True, stdout=subprocess.DEVNULL)
    found = {
        name: words for name, words in _LONG.items() if (not quick or name in _QUICK) and (not wanted or name in wanted)
    }
    for recipe in _MEASURED:
        names = (f"twin measure {recipe}", f"identify {recipe}")
        if quick or (wanted and not set(names) & set(wanted)):
            continue
        if recipe == "stiffness":
            for step in _TRACKER:
                subprocess.run((*_COMMAND, *step), cwd=folder, check=True, stdout=subprocess.DEVNULL)
        proposal, measured = f"proposal-{recipe}", f"measured-{recipe}"
        many = ("--propose", str(_COUNT[recipe]))
        made = subprocess.run(
            (*_COMMAND, "identify", recipe, *many, "--cell", "cell-small.toml", "--out", proposal),
            cwd=folder,
            stdout=subprocess.DEVNULL,
            check=False,
        )
        if made.returncode:
            print(f"{recipe}: nothing to propose", file=sys.stderr)
            continue
        measure = ("twin", "measure", f"{proposal}/proposal.toml", "--cell", "cell-small.toml", "--truth", "truth.toml")
        found[names[0]] = (*measure, "--out", measured)
        found[names[1]] = (
            "identify",
            recipe,
            f"{measured}/{recipe}.toml",
            "--cell",
            _TRACKED if recipe == "stiffness" else "cell-small.toml",
            "--out",
            f"found-{recipe}",
        )
    return found


def main() -> int:
    """Run, print a table, write the figures; 1 where a command told a time left beyond the goal."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one command, only that it runs")
    parser.add_argument("--only", nargs="*", default=[], help="names of the table")
    parser.add_argument("--cold", action="store_true", help="do not run each command once before")
    parser.add_argument("--period", type=float, default=0.5, help="seconds between two lines of progress")
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    given = parser.parse_args()
    rows, late = [], 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; time left told over the true one")
        print(
            f"{'command':28s} {'s':>7s} {'bar at 25':>10s} {'50':>6s} {'75 %':>6s} {'1/4 of work':>12s} {'of time':>8s}"
        )
        for what, words in commands(folder, given.only, quick=given.quick).items():
            if not given.cold and not given.quick and what not in _RESUMED:
                watch(words, folder, 0.0)
            seen = watch(words, folder, given.period)
            shares = [seen.time_share(fraction) for fraction in (0.25, 0.5, 0.75)]
            ratio, early = seen.ratio_at_work(), seen.ratio_at_time()
            good = seen.status == 0 and seen.within()
            late += seen.status != 0 if given.quick else not good
            texts = [f"{100.0 * share:.0f} %" if share is not None else "-" for share in shares]
            said, said_early = ("too short" if value is None else f"{value:.2f}" for value in (ratio, early))
            trouble = "" if good else "  NOT WITHIN" if seen.status == 0 else f"  EXIT {seen.status}"
            columns = f"{texts[0]:>10s} {texts[1]:>6s} {texts[2]:>6s} {said:>12s} {said_early:>8s}"
            print(f"{what:28s} {seen.duration_s:7.1f} {columns}{trouble}", flush=True)
            rows.append(
                {
                    "command": what,
                    "seconds": seen.duration_s,
                    "time_share": shares,
                    "ratio_at_work": ratio,
                    "ratio_at_time": early,
                    "status": seen.status,
                }
            )
    if given.out:
        given.out.write_text(json.dumps(rows, indent=2), encoding="utf-8")
    return int(late > 0)


if __name__ == "__main__":
    sys.exit(main())
