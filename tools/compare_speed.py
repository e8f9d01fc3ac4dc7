"""Speed of two trees in the same run: online step, reply, elastic step, compensate, identify, twin, material removal.

    git worktree add ../before edd1e91 && python tools/compare_speed.py --before ../before --rounds 3

Each round runs each benchmark of both trees, one after the other, each with its own sources; who begins changes from
round to round. The best round of each counts, so that other work on the machine disturbs both alike. Printed are times
(smaller is better) and the ratio after over before: above 1.05 is slower than asked. A first round compiles and does
not count.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ALLOWED = 1.05
ROOT = Path(__file__).resolve().parents[1]
Figures = dict[str, float]


@dataclass(frozen=True)
class Benchmark:
    """A script in benchmarks/, its options, whether --json takes a file, and which times to take from its figures."""

    options: tuple[str, ...]
    to_file: bool
    times: Callable[[dict[str, Any]], Figures]


def _online(found: dict[str, Any]) -> Figures:
    steps = {f"{name}, us": row["p50"] for name, row in found["step_us"].items() if "empty" not in name}
    return steps | {"reply over echo, p50": found["ratio_p50"], "reply, p50, us": found["reply_us"]["p50"]}


def _elastic(found: dict[str, Any]) -> Figures:
    ours = {"one call, us": found["single"]["counterflex"]["p50_us"]}
    return ours | {f"{name}, us": row["least"] for name, row in found["batch_us_per_point"].items() if "lanes" in name}


def _compensate(found: dict[str, Any]) -> Figures:
    return {f"{row['program']}, CPU s": row["cpu_s"] for row in found["programs"]}


def _identify(found: dict[str, Any]) -> Figures:
    return {f"{row['case']}, CPU s": row["cpu_s"] for row in found["cases"]}


def _twin(found: dict[str, Any]) -> Figures:
    factors = {name: 1.0 / found[f"real_time_factor_{name}"] for name in ("air", "cutting")}
    return {"plant step, us": found["plant_step_us"]} | {f"{n}, CPU s per s": value for n, value in factors.items()}


def _removal(found: dict[str, Any]) -> Figures:
    names = ("case", "engagement", "threads")
    return {" ".join(f"{name} {row[name]}" for name in names) + ", CPU s": row["cpu_s"] for row in found["rows"]}


BENCHMARKS = {
    "online_reply": Benchmark(("--seconds", "8"), True, _online),
    "elastic_step": Benchmark((), True, _elastic),
    "compensate": Benchmark(("--quick",), False, _compensate),
    "identify": Benchmark(("--quick",), False, _identify),
    "twin_speed": Benchmark((), False, _twin),
    "removal": Benchmark((), True, _removal),
}


def measured(tree: Path, name: str) -> Figures:
    """Times of one benchmark of one tree."""
    benchmark = BENCHMARKS[name]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "figures.json"
        command = [sys.executable, f"benchmarks/{name}.py", *benchmark.options, "--json"]
        command += [str(file)] if benchmark.to_file else []
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join((str(tree / "src"), str(tree / "lab"))),
            "OPENBLAS_NUM_THREADS": "1",
        }
        done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise SystemExit(
                f"error: {' '.join(command)} in {tree} ended with {done.returncode}:\n{done.stderr[-2000:]}"
            )
        text = file.read_text(encoding="utf-8") if benchmark.to_file else done.stdout.strip().splitlines()[-1]
    return benchmark.times(json.loads(text))


def rounds(trees: tuple[Path, Path], name: str, count: int) -> Iterator[tuple[int, Figures]]:
    """Times by tree (0 before, 1 after) of all rounds that count."""
    for number in range(count + 1):
        for which in (0, 1) if number % 2 == 0 else (1, 0):
            times = measured(trees[which], name)
            if number > 0:
                yield which, times


def main() -> None:
    """Run, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", type=Path, required=True, help="the other tree, for example a git worktree")
    parser.add_argument("--rounds", type=int, default=3, help="rounds that count (default 3)")
    parser.add_argument("--only", action="append", choices=sorted(BENCHMARKS), help="one benchmark; may be repeated")
    asked = parser.parse_args()
    print("| benchmark | time | before | after | after over before |\n|---|---|---|---|---|", flush=True)
    slower = 0
    for name in asked.only or BENCHMARKS:
        best: tuple[Figures, Figures] = ({}, {})
        for which, times in rounds((asked.before.resolve(), ROOT), name, asked.rounds):
            for label, value in times.items():
                best[which][label] = min(value, best[which].get(label, value))
        for label in (label for label in best[0] if label in best[1]):
            ratio = best[1][label] / best[0][label]
            slower += ratio > ALLOWED
            print(f"| {name} | {label} | {best[0][label]:.4g} | {best[1][label]:.4g} | {ratio:.3f} |", flush=True)
    print(f"\n{slower} slower than {ALLOWED:g}")


if __name__ == "__main__":
    main()
