"""Coverage: how often the 95 % interval of each recipe holds the truth, with and without what its model lacks.

Every recipe identifies seeded truths from measurements made elsewhere than in its own model where there is an
independent one (the simulated cell, the frame of beams of the holder, single teeth). *plain*: noise as stated.
*errors*: what the recipe's own model lacks, see :mod:`coverage_cases`. Per parameter that the data see, the share of
seeds whose interval holds the truth; printed are their median, the worst, all together, and the error over the stated
standard deviation (root mean square, median over the parameters): 1 is honest, 0.5 is twice too wide.

Run ``OPENBLAS_NUM_THREADS=1 python benchmarks/interval_coverage.py``; ``--recipe`` picks some, ``--seeds`` how many,
``--first`` from which, ``--quick`` a smoke run, ``--json`` prints one JSON object, ``--each`` every parameter.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np

from coverage_cases import cubes, frames, holder, poses, pulls, slots, steps, turns
from coverage_cases.counted import Counted

Case = Callable[..., list[Counted]]
CASES: dict[str, Case] = {
    "stiffness": pulls.stiffness_of_pulls,
    "kinematics": poses.kinematics_of_poses,
    "cutting": slots.constants_of_slots,
    "holder": holder.holder_of_loads,
    "holder, another": partial(holder.holder_of_loads, other=True),
    "cubes": cubes.stiffness_of_cubes,
    "tracker-frame by poses": frames.frame_of_poses,
    "tracker-frame": frames.frame_of_fiducials,
    "play": turns.play_of_reversals,
    "servo": steps.gains_of_steps,
    "servo, gains known": partial(steps.gains_of_steps, known=True),
}
SEEDS = 100
QUICK = 1
_OFTEN = 0.5  # share of seeds in which a parameter is seen, below which it is not counted


@dataclass(frozen=True)
class Row:
    """Coverage of one recipe."""

    recipe: str
    errors: bool
    seeds: int
    parameters: int
    together: float
    median: float
    worst: float
    worst_name: str
    by_sigma: float
    seconds: float
    each: dict[str, tuple[float, float]]


def row(recipe: str, errors: bool, seeds: int, first: int = 0) -> Row:
    """Run one case over seeds first..first+seeds-1."""
    start = time.perf_counter()
    every: dict[str, list[Counted]] = {}
    for seed in range(first, first + seeds):
        for one in CASES[recipe](seed, errors=errors):
            every.setdefault(one.name, []).append(one)
    kept = {name: them for name, them in every.items() if len(them) >= _OFTEN * seeds}
    each = {
        name: (
            float(np.mean([c.inside for c in them])),
            float(np.sqrt(np.mean([((c.value - c.truth) / c.sigma) ** 2 for c in them]))),
        )
        for name, them in kept.items()
    }
    rates = np.array([rate for rate, _ in each.values()])
    worst = min(each, key=lambda name: each[name][0])
    return Row(
        recipe,
        errors,
        seeds,
        len(each),
        float(np.mean([c.inside for them in kept.values() for c in them])),
        float(np.median(rates)),
        each[worst][0],
        worst,
        float(np.median([size for _, size in each.values()])),
        time.perf_counter() - start,
        each,
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recipe", action="append", choices=sorted(CASES), help="only these")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="truths per case")
    parser.add_argument("--first", type=int, default=0, help="first seed: others than a setting was chosen on")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} seed, for a smoke run")
    parser.add_argument("--each", action="store_true", help="every parameter")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    seeds = QUICK if options.quick else options.seeds
    rows = []
    if not options.json:
        print(f"{'recipe':24}{'data':>8}{'seeds':>6}{'par.':>6}{'all %':>8}{'median %':>10}{'worst %':>9}"
              f"{'error/sigma':>13}{'s':>7}  worst parameter")  # fmt: skip
    for recipe in options.recipe or CASES:
        for errors in (True,) if options.quick else (False, True):
            r = row(recipe, errors, seeds, options.first)
            rows.append(r)
            if options.json:
                continue
            print(
                f"{r.recipe:24}{'errors' if r.errors else 'plain':>8}{r.seeds:6d}{r.parameters:6d}"
                f"{100 * r.together:8.1f}{100 * r.median:10.1f}{100 * r.worst:9.1f}{r.by_sigma:13.2f}{r.seconds:7.1f}"
                f"  {r.worst_name}",
                flush=True,
            )
            if options.each:
                for name, (rate, size) in r.each.items():
                    print(f"    {name:28}{100 * rate:8.1f}{size:8.2f}")
    if options.json:
        print(json.dumps([asdict(r) for r in rows]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
