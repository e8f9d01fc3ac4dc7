"""Ledger: predictions that were committed before their truth was opened, and what came (docs/ledger.md).

Stages, so that a commit can stand between them::

    OPENBLAS_NUM_THREADS=1 python benchmarks/ledger.py --predict    # plans, predictions
    git add benchmarks/results/ledger; git commit
    OPENBLAS_NUM_THREADS=1 python benchmarks/ledger.py --reveal     # machines, measures, compares
    python benchmarks/ledger.py --store                             # writes the table into docs/ledger.md

Predicted are the path errors of programs on cells of which the cell file alone is known, revealed by simulated cells of
each family at :data:`SEEDS`; the surface of the next part of ``correct``; and the deflections of real pulls, by a cell
that was fitted to others of the same data set. Nothing is made twice: a prediction or a pair that is there stays, a
miss with it. Without an option the tables are printed. ``--quick`` does one program on one seed in a temporary folder.
About ten minutes on one core.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from counterflex.app import ledger as job
from counterflex.app.compensation.compensate import run as compensate
from counterflex.app.correction.correct import run as correct
from counterflex.app.identification.identify import run as identify
from counterflex.app.proof import prove, simulate
from counterflex.app.proof.truth import make_truth
from counterflex.core import atomic
from counterflex.files.cell.cell import read_cell
from counterflex.twin.truth.family import FAMILIES, family_of
from seeds_option import seeds_of

HERE: Final = Path(__file__).parent
RESULTS: Final = HERE / "results" / "ledger"
PAGE: Final = HERE.parent / "docs" / "ledger.md"
EXAMPLES: Final = HERE.parent / "examples"
SMALL: Final = "kr300_d16_small.toml"
PLANS: Final = {
    "groove": ("groove.ngc", SMALL, False),
    "corner": ("corner.ngc", SMALL, False),
    "helix": ("helix_ramp_return.ngc", SMALL, False),
    "groove-class": ("groove.ngc", "irb6640_d16.toml", True),
}
"""Program, cell file, and whether the stiffness is the median of the robot's class."""
SEEDS: Final = "2011-2012"
"""Truths of each family that nothing was planned or tuned on."""
PARTS: Final = {
    "groove-next-mild": ("mild", 2013),
    "groove-next-wide": ("wide", 2013),
    "groove-next-other": ("other", 2013),
}
"""Family and seed of the cells whose second part is predicted from the first."""
PULLS: Final = {"pulls-last": ("first_29", "last_14"), "pulls-first": ("last_14", "first_29")}
"""Manifest that the cell is fitted to, and manifest that is predicted."""
_DATA: Final = EXAMPLES / "data" / "fanuc_r2000ic_stiffness"
_FANUC: Final = EXAMPLES / "cells" / "fanuc_r2000ic.toml"
_TILTING: Final = {"wide": "all", "free": "tilting", "regions": "false"}
_BLOCK: Final = re.compile(r"(<!-- ledger: begin[^\n]*-->\n).*?(<!-- ledger: end -->)", re.DOTALL)


def predict(out: Path, results: Path, names: Iterable[str]) -> None:
    """Make what predicts, and write the predictions that are not there yet."""
    for name in names:
        target = results / f"{name}.json"
        if target.is_file():
            continue
        if name in PLANS:
            program, cell, assumed = PLANS[name]
            compensate(
                EXAMPLES / "programs" / program,
                EXAMPLES / "cells" / cell,
                out / name,
                assume_class=assumed,
                report=False,
            )
            job.predict(out / name, None, target)
        elif name in PARTS:
            first_part(name, out / name)
            job.predict(out / name / "plan-2", None, target)
        else:
            fitted, predicted = PULLS[name]
            identify("stiffness", [_DATA / f"{fitted}.toml"], _FANUC, out / name, settings=_TILTING)
            job.predict(_DATA / f"{predicted}.toml", out / name / "cell.toml", target)
        print(f"{name}: predicted", flush=True)


def first_part(name: str, folder: Path) -> None:
    """Plan, machine the first part on a simulated cell, and correct by its scan."""
    family, seed = PARTS[name]
    program, cell = EXAMPLES / "programs" / "groove.ngc", EXAMPLES / "cells" / SMALL
    folder.mkdir(parents=True, exist_ok=True)
    make_truth(read_cell(cell), seed, folder / "truth.toml", family_of(family))
    compensate(program, cell, folder / "plan-1", report=False)
    part(folder, 1)


def part(folder: Path, number: int) -> None:
    """Machine a part by its plan, and correct the next plan by its scan."""
    program, cell = EXAMPLES / "programs" / "groove.ngc", EXAMPLES / "cells" / SMALL
    plan, made = folder / f"plan-{number}", folder / f"part-{number}"
    simulate.run(plan / program.name, cell, folder / "truth.toml", made, original=program)
    correct(program, cell, plan, [made], folder / f"plan-{number + 1}", report=False)


def reveal(out: Path, results: Path, names: Iterable[str], seeds: list[int]) -> None:
    """Machine or measure, and write the pairs that are not there yet."""
    for name in names:
        for family in FAMILIES if name in PLANS else ("",):
            target = results / f"{name}{family and '-'}{family}-pair.json"
            if target.is_file():
                continue
            if name in PLANS:
                program, cell, assumed = PLANS[name]
                measured = out / f"{name}-{family}"
                prove.run(
                    EXAMPLES / "programs" / program, EXAMPLES / "cells" / cell, measured, seeds=seeds,
                    family=FAMILIES[family], exact=False, assume_class=assumed, workers=1,
                )  # fmt: skip
            elif name in PARTS:
                part(out / name, 2)
                measured = out / name / "plan-3"
            else:
                measured = _DATA / f"{PULLS[name][1]}.toml"
            job.reveal(results / f"{name}.json", measured, target)
            print(f"{target.stem}: revealed", flush=True)


def tables(results: Path) -> list[str]:
    """Lines of both tables, Markdown."""
    found = job.ledger(results)
    lines = ["| figure | against | inside 90 % | missed above | how independent |", "|---|---|---|---|---|"]
    for one in found["credibility"]:
        count = f"{one['inside']} of {one['of']}"
        lines.append(f"| `{one['figure']}` | {one['against']} | {count} | {one['above']} | {one['independence']} |")
    judged = [row for row in found["rows"] if row["inside"] is not None]
    lines += ["", f"Every pair ({len(judged)}, {sum(not row['inside'] for row in judged)} missed):", ""]
    lines += ["| prediction | program | cell | against | figure | predicted | 90 % interval | came | |"]
    lines += ["|---|---|---|---|---|---|---|---|---|"]
    for row in judged:
        truth = f"{row['against']}, {row['truth']}".removesuffix(", ")
        ends, met = f"{row['low']:.3f} to {row['high']:.3f}", "inside" if row["inside"] else "**missed**"
        lines.append(
            f"| {row['sha256'][:8]} | {row['program']} | {row['cell']} | {truth} | `{row['figure']}` | "
            f"{row['predicted']:.3f} | {ends} | {row['came']:.3f} | {met} |"
        )
    return lines + [f"\nNot revealed: {name}" for name in found["not_revealed"]]


def main() -> int:
    """Do the stages that are chosen, or print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/ledger"), help="plans, parts, proofs")
    parser.add_argument("--predict", action="store_true")
    parser.add_argument("--reveal", action="store_true")
    parser.add_argument("--seeds", type=seeds_of, default=SEEDS)
    parser.add_argument("--store", action="store_true", help="write the tables into docs/ledger.md")
    parser.add_argument("--quick", action="store_true", help="a smoke run")
    chosen = parser.parse_args()
    names = [*PLANS, *PARTS, *PULLS]
    if chosen.quick:
        with tempfile.TemporaryDirectory() as scratch:
            results = Path(scratch) / "results"
            results.mkdir()
            predict(Path(scratch), results, names[:1])
            reveal(Path(scratch), results, names[:1], [1])
            print("\n".join(tables(results)))
        return 0
    RESULTS.mkdir(parents=True, exist_ok=True)
    if chosen.predict:
        predict(chosen.out, RESULTS, names)
    if chosen.reveal:
        reveal(chosen.out, RESULTS, names, chosen.seeds)
    lines = tables(RESULTS)
    if chosen.store:
        text = PAGE.read_text(encoding="utf-8")
        atomic.write_text(PAGE, _BLOCK.sub(lambda match: match[1] + "\n" + "\n".join(lines) + "\n\n" + match[2], text))
    print("\n".join(lines))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
