"""Short form of ``identify play`` (12 motions, two of each axis): what may be written into a cell file after it.

Each seed is a truth whose axes differ from the cell file, measured by the simulated laboratory. *plain* has noise,
delay and error of scale of the motor's torque; *errors* also has what gears and trackers do beside the model
(:mod:`coverage_cases.turns`). Per axis: how many half dead bands are called determined, how many of these have a 95 %
interval without the truth, how many axes are not written, and, of those whose friction on the side of the link came out
more than 15 % above all that link and motor truly have, how many were written all the same.

Run ``OPENBLAS_NUM_THREADS=1 python benchmarks/play_quick_form.py``; ``--seeds`` how many, ``--first`` from which,
``--quick`` a smoke run, ``--json`` prints one JSON object.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict, dataclass

from coverage_cases.turns import QuickAxis, quick_form

SEEDS = 18
AXES = range(1, 7)
BEYOND = 1.15


@dataclass(frozen=True)
class Row:
    """One axis, or all (0), over all seeds."""

    data: str
    axis: int
    truths: int
    determined: int
    outside: int
    not_written: int
    beyond: int
    beyond_written: int


def row(data: str, axis: int, results: list[QuickAxis]) -> Row:
    """Count what became of one axis; 0 counts all."""
    mine = [r for r in results if axis in (0, r.axis)]
    determined = [r for r in mine if r.seen == "determined"]
    beyond = [r for r in mine if r.link_nm > BEYOND * r.true_all_nm]
    return Row(
        data,
        axis,
        len(mine),
        len(determined),
        sum(not r.inside for r in determined),
        sum(not r.written for r in mine),
        len(beyond),
        sum(r.written for r in beyond),
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=SEEDS, help="truths")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--quick", action="store_true", help="one seed and two axes, for a smoke run")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    axes = (2, 6) if options.quick else tuple(AXES)
    seeds = range(options.first, options.first + (1 if options.quick else options.seeds))
    rows = []
    for errors in (False, True):
        results = [one for seed in seeds for one in quick_form(seed, errors=errors, axes=axes)]
        rows += [row("errors" if errors else "plain", axis, results) for axis in (*axes, 0)]
    if options.json:
        print(json.dumps([asdict(r) for r in rows]))
        return 0
    head = ("truths", "determined", "outside", "not written", "beyond", "written")
    print("data    axis" + "".join(f"{word:>12}" for word in head))
    for r in rows:
        counts = (r.truths, r.determined, r.outside, r.not_written, r.beyond, r.beyond_written)
        print(f"{r.data:8}{r.axis or 'all':>4}" + "".join(f"{count:12d}" for count in counts))
    return 0


if __name__ == "__main__":
    sys.exit(main())
