"""Reliability of quoted probabilities: how often features keep tolerances that were quoted before the cut.

Programs are planned with the cell file of the catalogue, and their features are quoted at several tolerances, as they
are and compensated. Each is then machined on simulated cells (truths) and measured. Printed are the Brier score (mean
square of probability less outcome), that of the climatology (at each tolerance the share that was held), and by stated
probability how many were held. Of truths that differ in one robot rows are not independent: the 90 % range of each bin
is over resampled truths.

Run ``OPENBLAS_NUM_THREADS=1 python benchmarks/quote_reliability.py --seeds 2001-2010 --out out/quote``; it goes on
where it was. ``--family``, ``--programs`` and ``--variants`` choose; ``--show`` prints the stored rows; ``--store``
adds those of ``--out``; ``--quick`` is a smoke run.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.compensation.languages import write
from counterflex.app.inputs import Job, read_job, setting_of
from counterflex.app.proof import simulate
from counterflex.app.proof.judge import ProofReference, judge, outline_of, reference_of
from counterflex.app.proof.truth import truth_of
from counterflex.app.quote.path_errors import path_errors, points_of
from counterflex.app.quote.probability import Quoted, QuotedPart
from counterflex.core import atomic
from counterflex.core.units import MM
from counterflex.evaluate.features import FeatureRow, Machined, measure_features
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.plan.compensate import plan as make_plan
from counterflex.plan.plan import Plan
from counterflex.twin.truth.family import FAMILIES, REPORTING_SEEDS
from counterflex.twin.truth.truth import Truth
from seeds_option import seeds_of

HERE: Final = Path(__file__).resolve().parent
SHIPPED: Final = HERE.parent / "examples"
STORED: Final = HERE / "results" / "quote.json"
PROGRAMS: Final = {
    "groove": "kr300_d16_small.toml",
    "corner": "kr300_d16_small.toml",
    "fc_profile": "kr300_d16_flat.toml",
    "pocket_grooves": "kr300_d16_small.toml",
}
"""Cell file of each program."""
VARIANTS: Final = ("as it is", "compensated")
TOLERANCES_MM: Final = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0)
BINS: Final = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
_RESAMPLED: Final = 400


@dataclass(frozen=True)
class Case:
    """A program with what was quoted of it."""

    name: str
    cell: Cell
    job: Job
    plan: Plan
    reference: ProofReference
    drawing: QuotedPart
    quoted: dict[str, Quoted]  # By variant


def case_of(name: str) -> Case:
    """Plan and quote a program."""
    cell = read_cell(SHIPPED / "cells" / PROGRAMS[name])
    job = read_job(SHIPPED / "programs" / f"{name}.ngc", cell)
    plan = make_plan(job.path, job.line_of_motion, cell.stock(), setting_of(cell), feeds=job.feeds)
    reference = reference_of(job, cell)
    assert reference.surface is not None
    drawing = QuotedPart(job, cell, reference.surface)
    points = points_of(plan, cell, name)
    quoted = {
        variant: drawing.quoted(path_errors(plan, cell, points, compensated=variant == "compensated"))
        for variant in VARIANTS
    }
    return Case(name, cell, job, plan, reference, drawing, quoted)


def measured(case: Case, truth: Truth, variant: str) -> tuple[FeatureRow, ...]:
    """Features of the program machined on a truth."""
    job = case.job
    if variant == "compensated":
        with tempfile.TemporaryDirectory() as scratch:
            for file, text in write(case.job, case.plan, case.cell, "gcode")[0].items():
                atomic.write_bytes(Path(scratch) / file, text.encode(job.program.encoding, errors="replace"))
            job = read_job(Path(scratch) / Path(case.job.program.name).name, case.cell)
    record = simulate.machine(job, case.cell, truth)
    one = judge(case.reference, record, record.stock)
    motion = case.reference.outline_at(one.deviation.motion)
    machined = Machined(one.actual, one.deviation.p_part_actual, one.joined, motion)
    p, outline, surface = case.job.path.p_part_tcp, outline_of(case.job.path, case.cell), case.drawing.surface
    return measure_features(surface, p, case.drawing.features, {"part": machined}, outline=outline)


def made(case: Case, family: str, seed: int, variant: str) -> list[dict[str, Any]]:
    """Deviation of each quoted feature on one truth; None where the evaluator does not find it on the part."""
    rows = measured(case, truth_of(case.cell, seed, FAMILIES[family]), variant)
    off = {(r.feature, r.quantity): abs(r.worst_m["part"] - r.nominal_m) / MM for r in rows if "part" in r.worst_m}
    about = {"program": case.name, "family": family, "seed": seed, "variant": variant}
    return [
        about
        | {
            "feature": one.feature,
            "quantity": one.quantity,
            "off_mm": None if (value := off.get((one.feature, one.quantity))) is None else round(value, 5),
        }
        for one in case.quoted[variant].features
    ]


def with_quoted(row: dict[str, Any], case: Case) -> dict[str, Any]:
    """A measured feature with the probabilities that were quoted of it, by tolerance."""
    features = case.quoted[row["variant"]].features
    one = next(one for one in features if (one.feature, one.quantity) == (row["feature"], row["quantity"]))
    return row | {"quoted": [round(one.held(t * MM).probability, 4) for t in TOLERANCES_MM]}


def scores(rows: list[dict[str, Any]]) -> tuple[float, float]:
    """Brier score and that of the climatology by tolerance."""
    p, held = np.array([r["quoted"] for r in rows]), _held(rows)
    return float(np.mean((p - held) ** 2)), float(np.mean((held.mean(axis=0) - held) ** 2))


def _held(rows: list[dict[str, Any]]) -> np.ndarray:
    off = np.array([np.inf if r["off_mm"] is None else r["off_mm"] for r in rows])
    return (off[:, None] <= np.array(TOLERANCES_MM)).astype(np.float64)


def reliability(rows: list[dict[str, Any]]) -> list[str]:
    """Lines of the table by stated probability, Markdown."""
    p, held = np.array([r["quoted"] for r in rows]), _held(rows)
    seed = np.array([r["seed"] for r in rows])
    seeds, rng = np.unique(seed), np.random.default_rng(0)
    chosen = [np.concatenate([np.flatnonzero(seed == s) for s in rng.choice(seeds, len(seeds))])
              for _ in range(_RESAMPLED)]  # fmt: skip
    lines = ["| stated | quotations | mean stated | held | 90 % over truths |", "|---|---|---|---|---|"]
    for low, high in itertools.pairwise(BINS):
        inside = (p >= low) & (p < high)
        if not inside.any():
            continue
        shares = [held[own][inside[own]].mean() for own in chosen if inside[own].any()]
        ends = np.quantile(shares, [0.05, 0.95])
        lines.append(
            f"| {100 * low:.0f} to {100 * high:.0f} % | {inside.sum()} | {100 * p[inside].mean():.0f} % "
            f"| {100 * held[inside].mean():.0f} % | {100 * ends[0]:.0f} to {100 * ends[1]:.0f} % |"
        )
    return lines


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Lines of the result, Markdown."""
    lines = [
        "| program | variant | truths | features | Brier score | climatology | skill |",
        "|---|---|---|---|---|---|---|",
    ]
    for program in (*PROGRAMS, "all"):
        for variant in VARIANTS:
            mine = [r for r in rows if r["variant"] == variant and program in ("all", r["program"])]
            if mine:
                brier, reference = scores(mine)
                features = len({(r["program"], r["feature"], r["quantity"]) for r in mine})
                lines.append(
                    f"| {program} | {variant} | {len({r['seed'] for r in mine})} | {features} | {brier:.3f} "
                    f"| {reference:.3f} | {1.0 - brier / reference if reference else float('nan'):.2f} |"
                )
    for variant in VARIANTS:
        mine = [r for r in rows if r["variant"] == variant]
        if mine:
            lines += ["", f"{variant}:", "", *reliability(mine)]
    return lines


def main() -> int:
    """Measure and print, or print what is stored."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/quote"))
    parser.add_argument("--programs", nargs="+", choices=list(PROGRAMS), default=["groove", "corner"])
    parser.add_argument("--family", nargs="+", choices=list(FAMILIES), default=["wide"])
    parser.add_argument("--seeds", type=seeds_of, default=f"{REPORTING_SEEDS[0]}-{REPORTING_SEEDS[0] + 9}")
    parser.add_argument("--variants", nargs="+", choices=VARIANTS, default=list(VARIANTS))
    parser.add_argument("--show", action="store_true")
    parser.add_argument("--store", action="store_true")
    parser.add_argument("--quick", action="store_true")
    chosen = parser.parse_args()
    if chosen.show:
        print("\n".join(table(json.loads(STORED.read_text())["rows"])))
        return 0
    programs, families, seeds = chosen.programs, chosen.family, chosen.seeds
    if chosen.quick:
        programs, families, seeds = ["groove"], ["wide"], [1]
    with tempfile.TemporaryDirectory() as scratch:
        rows = _run(Path(scratch) if chosen.quick else chosen.out, programs, families, seeds, chosen.variants)
    if chosen.store:
        kept = json.loads(STORED.read_text())["rows"] if STORED.is_file() else []
        names = ("program", "family", "seed", "variant", "feature", "quantity")
        merged = {tuple(r[k] for k in names): r for r in [*kept, *rows]}
        lines = ",\n".join(json.dumps(merged[k], sort_keys=True) for k in sorted(merged))
        atomic.write_text(STORED, f'{{"rows": [\n{lines}\n]}}\n')
    print("\n".join(table(rows)))
    return 0


def _run(
    out: Path, programs: list[str], families: list[str], seeds: list[int], variants: list[str]
) -> list[dict[str, Any]]:
    """Machine what is not in ``rows.jsonl`` yet, truth by truth, and quote all of it."""
    out.mkdir(parents=True, exist_ok=True)
    log = out / "rows.jsonl"
    rows = [json.loads(line) for line in log.read_text().splitlines()] if log.is_file() else []
    have = {(r["program"], r["family"], r["seed"], r["variant"]) for r in rows}
    cases = {name: case_of(name) for name in programs}
    with log.open("a") as file:
        for family, seed, name, variant in itertools.product(families, seeds, programs, variants):
            if (name, family, seed, variant) in have:
                continue
            found = made(cases[name], family, seed, variant)
            rows += found
            file.writelines(json.dumps(row) + "\n" for row in found)
            file.flush()
            print(f"{name}, {variant}, {family}, seed {seed}", file=sys.stderr, flush=True)
    chosen = [r for r in rows if r["program"] in programs and r["family"] in families and r["seed"] in seeds]
    return [with_quoted(row, cases[row["program"]]) for row in chosen if row["variant"] in variants]


if __name__ == "__main__":
    raise SystemExit(main())
