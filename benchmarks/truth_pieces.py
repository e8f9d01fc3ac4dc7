"""Pieces of a simulated cell replaced by what the planner takes, one at a time: which of them an error comes from.

``catalogue``: one plan with the cell file. Each piece of the truth is replaced by the value of the plan; a piece whose
replacement removes much of the error is what the plan does not know. ``exact``: each piece is taken out of the truth,
and the plan knows the rest exactly; a piece that removes much is what the method does not compensate. Beside the error
of the simulated cell stands what the plan itself predicts.

Run ``OPENBLAS_NUM_THREADS=1 python benchmarks/truth_pieces.py --programs groove --seeds 2,5,6 --levels exact``;
``--out`` keeps the cell file of the demonstration, ``--quick`` is a smoke run. Without a seed (0) the truth has the
stiffness and forces of the cell file. Use tuning seeds: what is looked at here is tuned on.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

import accuracy
from counterflex.app.compensation.languages import write
from counterflex.app.inputs import Job, read_job, setting_of
from counterflex.app.proof.truth import exact_setting, truth_of
from counterflex.core import atomic
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.plan.compensate import plan as make_plan
from counterflex.plan.inputs import Setting
from counterflex.plan.plan import across
from counterflex.twin.truth.family import FAMILIES
from counterflex.twin.truth.truth import SLIP_ELEMENTS, Body, Truth
from seeds_option import seeds_of

Piece = Callable[[Truth], Truth]
LEVELS: Final = ("catalogue", "exact")


def planned_pieces(cell: Cell) -> Iterator[tuple[str, Piece]]:
    """Replacements by what a plan with the cell file takes."""
    nominal, chain = truth_of(cell, None), cell.planning_chain
    servo = [row for row in chain.servo or () if row is not None]
    play = [row for row in chain.play or () if row is not None]
    yield "stiffness", lambda t: replace(t, bodies=_bodies(t, nominal, "compliance"), regions=nominal.regions)
    yield "force", lambda t: replace(t, cutting=replace(t.cutting, k_pa=nominal.cutting.k_pa))
    yield "ploughing", lambda t: replace(t, cutting=replace(t.cutting, edge_n_m=nominal.cutting.edge_n_m))
    yield (
        "loop gains",
        lambda t: replace(t, drives=tuple(
            replace(
                d, servo_inertia_kg_m2=s.speed_gain_nm_s / d.speed_bandwidth_per_s,
                position_gain_per_s=s.position_gain_per_s, integral_time_s=s.integral_time_s,
            )
            for d, s in zip(t.drives, servo, strict=True)
        )),
    )  # fmt: skip
    yield (
        "friction of motors",
        lambda t: replace(t, drives=tuple(
            replace(d, motor_friction_nm=s.friction_nm, motor_slip_rad=s.slip_rad)
            for d, s in zip(t.drives, servo, strict=True)
        )),
    )  # fmt: skip
    yield (
        "play and friction of links",
        lambda t: replace(t, drives=tuple(
            replace(
                d, dead_band_rad=p.half_band_rad,
                link_friction_nm=(*p.friction_nm, *(0.0,) * (SLIP_ELEMENTS - len(p.friction_nm))),
                link_slip_rad=(*p.slip_rad, *d.link_slip_rad[len(p.slip_rad) :]),
            )
            for d, p in zip(t.drives, play, strict=True)
        )),
    )  # fmt: skip
    yield "geometry", lambda t: replace(t, T_last_tcp=nominal.T_last_tcp, bodies=_bodies(t, nominal, "T_prev_seg"))


def removed_pieces(_: Cell) -> Iterator[tuple[str, Piece]]:
    """Truths without a piece, which the plan then knows to be absent."""
    still = (0.0,) * SLIP_ELEMENTS
    yield (
        "play and friction",
        lambda t: replace(
            t,
            drives=tuple(
                replace(d, motor_friction_nm=0.0, link_friction_nm=still, dead_band_rad=0.0) for d in t.drives
            ),
        ),
    )
    yield "runout", lambda t: replace(t, cutting=replace(t.cutting, runout_m=0.0))
    yield "ploughing", lambda t: replace(t, cutting=replace(t.cutting, edge_n_m=(0.0, 0.0, 0.0)))
    yield (
        "inertia of motors, a tenth",
        lambda t: replace(
            t, drives=tuple(replace(d, rotor_inertia_kg_m2=0.1 * d.rotor_inertia_kg_m2) for d in t.drives)
        ),
    )
    yield (
        "yield of motors, a quarter",
        lambda t: replace(
            t, drives=tuple(replace(d, servo_inertia_kg_m2=4.0 * d.servo_inertia_kg_m2) for d in t.drives)
        ),
    )


def _bodies(truth: Truth, other: Truth, name: str) -> tuple[Body, ...]:
    pairs = zip(truth.bodies, other.bodies, strict=True)
    return tuple(replace(body, **{name: getattr(of, name)}) for body, of in pairs)


def compensated(job: Job, cell: Cell, setting: Setting, place: Path) -> tuple[Job, list[float]]:
    """The compensated program, and the path error before and after that its plan predicts, mm."""
    plan = make_plan(job.path, job.line_of_motion, cell.stock(), setting, feeds=job.feeds)
    for file, text in write(job, plan, cell, "gcode")[0].items():
        atomic.write_bytes(place / file, text.encode(job.program.encoding, errors="replace"))
    predicted = []
    for deviation in (plan.deviation_nominal_part, plan.deviation_compensated_part):
        size = np.linalg.norm(across(deviation, plan.path.p_part_tcp), axis=1)[plan.judged]
        predicted.append(float(np.quantile(size, 0.997)) / MM)
    return read_job(place / Path(job.program.name).name, cell), predicted


def rows(name: str, level: str, seed: int, folder: Path, few: bool) -> Iterator[tuple[str, list[float], list[float]]]:
    """Piece, what the plan predicts, and what the simulated cell does, before and after, mm."""
    base = accuracy.demonstration(folder)
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        program, file = accuracy.files_of(name, base, base, place)
        cell = read_cell(file)
        job = read_job(program, cell)
        truth = truth_of(read_cell(base), seed or None, FAMILIES["wide"])
        exact = level == "exact"
        pieces = list((removed_pieces if exact else planned_pieces)(cell))
        known = None if exact else compensated(job, cell, setting_of(cell), place / "known")
        for piece, change in [("none", None), *pieces[: 1 if few else None]]:
            true = truth if change is None else change(truth)
            after, predicted = known or compensated(job, cell, exact_setting(job, cell, true), place / "exact")
            variants = (accuracy.machined(job, cell, true), accuracy.machined(after, cell, true, job))
            yield piece, predicted, [variant.path.path.p997_m / MM for variant in variants]


def main() -> int:
    """Print a table for each program, level and seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/pieces"))
    parser.add_argument("--programs", nargs="+", choices=list(accuracy.PROGRAMS), default=["groove"])
    parser.add_argument("--levels", nargs="+", choices=LEVELS, default=list(LEVELS))
    parser.add_argument("--seeds", type=lambda text: [0] if text == "0" else seeds_of(text), default="1")
    parser.add_argument("--quick", action="store_true")
    chosen = parser.parse_args()
    print("program   level      seed  piece                       predicted before, after  simulated before, after, mm")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) if chosen.quick else chosen.out
        for name in chosen.programs:
            for level in chosen.levels[: 1 if chosen.quick else None]:
                for seed in chosen.seeds:
                    for piece, predicted, simulated in rows(name, level, seed, folder, chosen.quick):
                        figures = "".join(f"{value:8.3f}" for value in (*predicted, *simulated))
                        print(f"{name:9} {level:10} {seed:4d}  {piece:26}{figures}", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
