"""Constants and wear from run logs of ordinary cuts, on simulated cells: what is recovered, and whether intervals hold.

For every seed a program of two slots and two side cuts is compensated with the cell file of the catalogue and milled
twice on the simulated cell over sockets, the loop only watching: by a new tool, and by one whose forces are 20 %
larger. Noise, drift, delay and teeth of the simulated force sensor are in the log; weight and bias are taken off as
identified. From both logs come the constants at the reference chip thickness, from the first alone, and the growth. The
truth has ploughing and exponents that the law of the cell has not; compared is the specific force at that thickness.

Run ``OPENBLAS_NUM_THREADS=1 python benchmarks/production.py --seeds 1001-1005 --family wide --out out/production``; it
goes on where it was. ``--show`` prints the rows of ``--out``; ``--drawn`` counts intervals over ``--seeds`` on runs in
memory in which all that the standard deviations stand for is drawn; ``--series`` shows growth and events of drawn
series of ten runs; ``--quick`` is one seed of a short program.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

import counterflex
from counterflex.app.compensation.compensate import run as compensate
from counterflex.app.identification.cell_model import model_of
from counterflex.app.production.production import run as identify
from counterflex.app.production.runs import planned_cut
from counterflex.app.proof.truth import make_truth
from counterflex.app.run import session as online_session
from counterflex.app.simulated_cell import cell as live
from counterflex.core import atomic
from counterflex.core.units import N_PER_MM2, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.plan_file import read_plan
from counterflex.identify.cutting.considered import ALIGNMENT_RAD, CROSS_TALK, SCALE
from counterflex.identify.production.alignment import AlignedRunRecord, PlannedCut, force_of
from counterflex.identify.production.constants import find, reference_m
from counterflex.identify.production.drift import RunFactor, drift
from counterflex.identify.production.residuals import TOP_SIGMA_M, ProductionResiduals, geometry_of
from counterflex.identify.production.stretches import stretches_of
from counterflex.twin.plant.force_sensor import force_sensor
from counterflex.twin.truth.family import FAMILIES
from counterflex.twin.truth.file import read_truth, write_truth
from counterflex_lab.reproduce import closed_loop
from seeds_option import seeds_of

ROOT: Final = Path(__file__).resolve().parents[1]
CELL: Final = ROOT / "examples" / "cells" / "kr300_d16_small.toml"
RSI: Final = Path(counterflex.__file__).parent / "app" / "demo" / "rsi.xml"
WORN: Final = 1.2
"""Force of the second run over that of the first."""
LOST: Final = (2.0 - 2.0**0.75) / 3.0
"""Share of the force that is lost with one tooth of three."""
INSIDE: Final = 1.645
"""Standard deviations of a 90 % interval."""
HEAD: Final = "G17 G54 G40 G49 G80 G90\nG21\nM6 T1\nG43 H1\nM3 S13000\nG0 Z60\n"
PART: Final = (
    f"{HEAD}G0 X-14 Y15\nG0 Z42\nG1 Z37 F3000\nG1 X74 F1500\nG0 Z45\nG0 X-14\nG1 Z33 F3000\nG1 X74 F2400\nG0 Z45\n"
    "G0 X-14 Y64\nG1 Z36 F3000\nG1 X74 F3000\nG0 Z45\nG0 X-14 Y54\nG1 Z36 F3000\nG1 X74 F900\nG0 Z60\nM5\nM30\n"
)
SHORT: Final = (
    f"{HEAD}G0 X-14 Y15\nG0 Z42\nG1 Z37 F6000\nG1 X74 F2400\nG0 Z42\n"
    "G0 X-14 Y60\nG1 Z36 F6000\nG1 X74 F3000\nG0 Z60\nM5\nM30\n"
)
RIGID: Final = ROOT / "tests" / "data" / "cells" / "rigid.toml"
DRAWN: Final = (
    "G21 G17 G90\nM6 T1\nM3 S13000\nG0 Z60\nG0 X-20 Y8\nG1 Z37 F3000\nG1 X62 F1500\nG0 Z60\n"
    "G0 X-20 Y26\nG1 Z36 F3000\nG1 X62 F900\nG0 Z60\nG0 X-20 Y20\nG1 Z36 F3000\nG1 X62 F2400\nG0 Z60\nM5\nM2\n"
)
ONLINE: Final = '\n[online]\nforce = "scale"\ncorrection_mm = 3\nspeed_mm_s = 40\nacceleration_mm_s2 = 2500\n'


def prepared(folder: Path, seed: int, family: str, program: str = PART) -> None:
    """Cell file, truth, program and plan of a seed: weight behind the sensor as identified, all else catalogue."""
    folder.mkdir(parents=True, exist_ok=True)
    text = CELL.read_text(encoding="utf-8")
    bare = folder / "bare.toml"
    bare.write_text(text, encoding="utf-8")
    truth = make_truth(read_cell(bare), seed, folder / "truth.toml", FAMILIES[family])
    bias = force_sensor(truth, 0, "sensor", hose_share=0.0).w_bias
    weights = {body.name: body.mass_kg for body in truth.bodies}
    weighed = text.replace("mass_kg = 75", f"mass_kg = {weights['spindle']:.4f}")
    sensor = f'\n[sensor]\nsegment = "sensor"\nbias_n = {bias[:3].tolist()}\nbias_nm = {bias[3:].tolist()}\n'
    (folder / "cell.toml").write_text(weighed + sensor + ONLINE, encoding="utf-8")
    (folder / "part.ngc").write_text(program, encoding="ascii", newline="")
    compensate(folder / "part.ngc", folder / "cell.toml", folder / "plan", report=False, predict=False)


def _three(values: tuple[float, ...]) -> tuple[float, float, float]:
    return values[0], values[1], values[2]


def milled(folder: Path, name: str, worn: float) -> Path:
    """Mill the program over sockets with a tool whose forces are ``worn`` times those of the truth: its run log."""
    truth = read_truth(folder / "truth.toml")
    cutting = truth.cutting
    k_pa, edge_n_m = (tuple(worn * v for v in values) for values in (cutting.k_pa, cutting.edge_n_m))
    file = folder / f"truth-{name}.toml"
    write_truth(file, replace(truth, cutting=replace(cutting, k_pa=_three(k_pa), edge_n_m=_three(edge_n_m))))
    plan, cell = folder / "plan", folder / "cell.toml"
    twin = live.LiveSettings(plan / "part.ngc", cell, file, ("rsi", RSI), original=folder / "part.ngc", hose_share=0.0)
    loop = online_session.RunSettings(cell, ("rsi", RSI), plan / "plan.parquet", compensated=True, arm=False)
    closed_loop.run(twin, folder / f"part-{name}", loop, folder / name, sensors=closed_loop.Sensors())
    return folder / name


def true_forces(folder: Path, h_m: float) -> np.ndarray:
    """(3,) Pa: specific force c, r, a of the truth at a chip thickness, ploughing included."""
    c = read_truth(folder / "truth.toml").cutting
    edge = np.array(c.edge_n_m) * (1.0 - math.exp(-h_m / c.edge_onset_m)) / h_m
    out: np.ndarray = np.array(c.k_pa) * (h_m / c.h_ref_m) ** -np.array(c.exponent) + edge
    return out


def row_of(folder: Path, result: dict[str, Any], one: dict[str, Any]) -> dict[str, Any]:
    """Row of the results of two runs (``result``) and of the first alone (``one``), beside the truth."""
    row: dict[str, Any] = {}
    h = next(f["value"] for f in one["figures"] if f["name"] == "h_ref_um") * UM
    true = true_forces(folder, h) / N_PER_MM2
    table = {p["name"]: p for p in one["fits"]["production"]["parameters"]}
    for i, name in enumerate(("kc", "kr", "ka")):
        p = table[name]
        row[f"{name}_percent"] = round(100.0 * (p["value"] / true[i] - 1.0), 2)
        row[f"{name}_before_percent"] = round(100.0 * (p["nominal"] / true[i] - 1.0), 2)
        row[f"{name}_sigma_percent"] = round(100.0 * p["sigma"] / true[i], 2)
        row[f"{name}_inside"] = bool(abs(p["value"] - true[i]) <= INSIDE * p["sigma"])
    row["holdout_percent"], row["holdout_before_percent"] = (
        round(one["headline"][0][k], 2) for k in ("value", "nominal")
    )
    first, second = result["runs"]
    ratio = second["factor"] / first["factor"]
    spread = ratio * math.hypot(first["factor_sigma"] / first["factor"], second["factor_sigma"] / second["factor"])
    row |= {"growth_percent": round(100.0 * (ratio - 1.0), 2), "growth_sigma_percent": round(100.0 * spread, 2)}
    row["growth_inside"] = bool(abs(ratio - WORN) <= INSIDE * spread)
    row |= {"constants": one["constants"], "proposed": one["proposed"], "delay_ms": first["delay_ms"]}
    return row


def one(seed: int, family: str, folder: Path, program: str = PART) -> dict[str, Any]:
    """A seed: two runs, constants from the first, growth from both."""
    prepared(folder, seed, family, program)
    runs = [milled(folder, "new", 1.0), milled(folder, "worn", WORN)]
    cell, plan = folder / "cell.toml", folder / "plan" / "plan.parquet"
    first = identify(runs[:1], cell, [plan], folder / "first")
    both = identify(runs, cell, [plan], folder / "both")
    return {"family": family, "seed": seed, **row_of(folder, both, first)}


def drawn(seed: int, plan: Path, cut: PlannedCut, cell: Cell) -> dict[str, Any]:
    """A run in memory, drawn what standard deviations stand for: constants, height, sensor, delay, noise."""
    rng, model = np.random.default_rng(seed), model_of(cell)
    terms = cell.force_law.terms()
    terms[:, 1:] *= np.exp(rng.normal(0.0, 0.15, 3))
    read, _ = read_plan(plan)
    time = np.arange(0.0, read.path.time_s[-1] + 0.4, 0.004)
    planned = read.path.time_s + 1e-9 * np.arange(len(read.path))
    force, higher = force_of(cut.maps_m, terms), rng.normal(0.0, TOP_SIGMA_M)
    for motion in np.unique(read.path.motion[cut.cutting]):
        on = read.path.motion == motion
        depth = float(np.median(cut.depth_m[on & cut.cutting]))
        force[on] *= 1.0 + higher / depth
    turn = rng.normal(0.0, ALIGNMENT_RAD, 3)
    E = np.where(np.eye(3) > 0, rng.normal(0.0, SCALE, (3, 3)), rng.normal(0.0, CROSS_TALK, (3, 3)))
    E += np.array([[0.0, -turn[2], turn[1]], [turn[2], 0.0, -turn[0]], [-turn[1], turn[0], 0.0]])
    late = np.searchsorted(planned, time - rng.uniform(0.01, 0.1)).clip(0, len(force) - 1)
    w = np.zeros((len(time), 6))
    w[:, :3] = (force @ (np.eye(3) + E).T)[late] + rng.normal(0.0, 8.0, 3) + rng.normal(0.0, 3.0, (len(time), 3))
    p, q = (np.stack([np.interp(time, planned, c) for c in a.T], axis=1) for a in (cut.p_part, read.q))
    good, none = np.ones(len(time), dtype=np.bool_), np.zeros(len(time), dtype=np.bool_)
    run = AlignedRunRecord(f"draw {seed}", time, p, w, q, np.zeros((len(time), 3)), good, none, 0.004)
    stretches = stretches_of(model, run, cut, run.aligned(cut), 1).stretches
    geometry = geometry_of(stretches, np.zeros(len(stretches), dtype=np.int64))
    block = ProductionResiduals(stretches, geometry, model.cutter_of(1), UM, stretches.cut)
    block.h_ref_m = reference_m(block)[0]
    result = find(block, model.force_law, {}, run=np.zeros(len(stretches), dtype=np.int64))
    true = terms[0, 1:] * block.h_ref_m ** (terms[0, 0] - 1.0)
    return {
        name: (float(result.fit.values[i] - true[i]) / float(result.fit.sigma[i]), float(result.fit.sigma[i] / true[i]))
        for i, name in enumerate(("kc", "kr", "ka"))
    }


def show_drawn(seeds: list[int]) -> None:
    """Show the coverage of 90 % intervals where everything that they stand for is drawn; a robot that does not bend."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "part.ngc").write_text(DRAWN, encoding="ascii", newline="")
        compensate(folder / "part.ngc", RIGID, folder / "plan", report=False, predict=False)
        plan, cell = folder / "plan" / "plan.parquet", read_cell(RIGID)
        read, about = read_plan(plan)
        cut = planned_cut(read, about, cell, plan, compensated=True)
        rows = [drawn(seed, plan, cut, cell) for seed in seeds]
    for name in ("kc", "kr", "ka"):
        off, sigma = np.array([row[name] for row in rows]).T
        print(
            f"{name}: 90 % interval holds {int(np.sum(np.abs(off) <= INSIDE))} of {len(rows)}, worst "
            f"{np.max(np.abs(off)):.1f} standard deviations; standard deviation {100.0 * np.median(sigma):.1f} %"
        )


def lives() -> dict[str, tuple[np.ndarray, str]]:
    """Force of ten runs by what happens to the tool, and the kind of event that there is."""
    run = np.arange(10.0)
    out = {
        f"jump of {100 * v:.0f} % at the sixth run": (1.0 + v * (run >= 5), "chipped edge") for v in (0.15, 0.25, 0.35)
    }
    out |= {
        "no change": (np.ones(10), ""),
        "2 % a run": (1.0 + 0.02 * run, ""),
        "break-in, 15 %": (1.0 + 0.15 * (1.0 - np.exp(-run / 1.5)) + 0.005 * run, ""),
        "accelerating, 35 %": (1.0 + 0.35 * (run / 9.0) ** 3, ""),
        "accelerating from the seventh run": (1.0 + 0.01 * run + 0.1 * np.maximum(0.0, run - 6.0), ""),
        "new edge after 18 %": (np.where(run < 6, 1.0 + 0.03 * run, 1.0 + 0.03 * (run - 6.0)), "new edge"),
        "one tooth of three lost": (np.where(run < 5, 1.0, 1.0 - LOST), "lost tooth"),
        "softer material, 18 %": (np.where(run < 5, 1.0, 0.82), "other material"),
        "harder blanks, 20 %, three runs": (1.0 + 0.2 * ((run >= 3) & (run < 6)), "passing change"),
    }
    return out


def show_series(seeds: list[int]) -> None:
    """Growth and events of series of ten runs, by scatter of the runs beside 1 % of their own."""
    print(f"{'ten runs':34}scatter %  growth off by % (median, worst)  in 90 %  event found  another, or false")
    for name, (expected, kind) in lives().items():
        for scatter in (0.005, 0.01, 0.02):
            off, inside, right, false = [], 0, 0, 0
            for seed in seeds:
                s = expected + np.random.default_rng(seed).normal(0.0, scatter, len(expected))
                found = drift([RunFactor(float(v), 0.01) for v in s], np.ones(10), np.zeros(10, dtype=np.bool_), LOST)
                edge = int(np.argmax(found.edge == found.edge[-1])) if kind == "new edge" else 0
                rises = expected[-1] >= expected[edge] or kind == ""
                true = expected[-1] / expected[edge] - 1.0 if rises else 0.0
                off.append(100.0 * abs(found.grown - true))
                inside += found.grown_low <= true <= found.grown_high
                kinds = [e.kind.value for e in found.events]
                right += kinds == [kind]
                false += bool(kinds) and kinds != [kind]
            n = len(off)
            print(
                f"{name:34}{100.0 * scatter:9.1f}  {np.median(off):16.1f}, {max(off):5.1f}"
                f"{f'{inside} of {n}':>19}{f'{right} of {n}' if kind else '-':>13}{f'{false} of {n}':>19}"
            )


def show(rows: list[dict[str, Any]]) -> None:
    """Every row, then median and worst, and how often 90 % intervals hold."""
    print("family seed   kc (before)  kr (before)  ka (before) %  held out (before) %  growth +- sigma %  inside")
    for r in rows:
        shown = "  ".join(f"{r[f'{k}_percent']:+6.1f} ({r[f'{k}_before_percent']:+.0f})" for k in ("kc", "kr", "ka"))
        inside = "".join("x" if r[f"{k}_inside"] else "." for k in ("kc", "kr", "ka", "growth"))
        print(
            f"{r['family']:6} {r['seed']:5d} {shown}  {r['holdout_percent']:5.1f} ({r['holdout_before_percent']:.1f})  "
            f"{r['growth_percent']:+5.1f} +- {r['growth_sigma_percent']:.1f}  {inside}  {r['constants']}"
        )
    for k in ("kc", "kr", "ka"):
        off, before = (np.abs([r[f"{k}{w}_percent"] for r in rows]) for w in ("", "_before"))
        print(
            f"{k}: off {np.median(off):.1f} % median, {np.max(off):.1f} % worst; cell file {np.median(before):.1f} %, "
            f"{np.max(before):.1f} %; 90 % interval holds {sum(r[f'{k}_inside'] for r in rows)} of {len(rows)}"
        )
    off = np.abs([r["growth_percent"] - 100.0 * (WORN - 1.0) for r in rows])
    held = sum(r["growth_inside"] for r in rows)
    print(
        f"growth of 20 %: off {np.median(off):.1f} % median, {np.max(off):.1f} % worst; interval {held} of {len(rows)}"
    )
    held_out = np.array([[r["holdout_percent"], r["holdout_before_percent"]] for r in rows])
    print(
        f"held out: {np.median(held_out[:, 0]):.1f} % median, {np.max(held_out[:, 0]):.1f} % worst; before "
        f"{np.median(held_out[:, 1]):.1f} %, {np.max(held_out[:, 1]):.1f} %"
    )


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seeds_of, default="1001-1005")
    parser.add_argument("--family", choices=sorted(FAMILIES), default="wide")
    parser.add_argument("--out", type=Path, default=Path("out/production"))
    parser.add_argument("--show", action="store_true")
    parser.add_argument("--drawn", action="store_true", help="intervals on drawn runs in memory, without the twin")
    parser.add_argument("--series", action="store_true", help="growth and events of drawn series of ten runs")
    parser.add_argument("--short", action="store_true", help="seed 1 of mild, one slot and one side cut")
    parser.add_argument("--quick", action="store_true", help="a smoke run: intervals on two drawn runs")
    options = parser.parse_args()
    if options.quick:
        show_drawn([1, 2])
        show_series([1])
        return
    if options.series:
        show_series(options.seeds)
        return
    if options.short:
        with tempfile.TemporaryDirectory() as scratch:
            show([one(1, "mild", Path(scratch) / "cell", SHORT)])
        return
    if options.drawn:
        show_drawn(options.seeds)
        return
    if not options.show:
        for seed in options.seeds:
            file = options.out / f"{options.family}-{seed}.json"
            if file.is_file():
                continue
            row = one(seed, options.family, options.out / f"{options.family}-{seed}")
            atomic.write_text(file, json.dumps(row, indent=1) + "\n")
            print(f"{options.family} {seed}: done", flush=True)
    rows = [json.loads(file.read_text(encoding="utf-8")) for file in sorted(options.out.glob("*.json"))]
    if rows:
        show(rows)


if __name__ == "__main__":
    main()
