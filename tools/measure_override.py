"""Mill a groove on the simulated cell over sockets: feed override off and on, and cuts that are not as planned.

The loop and the cell run in processes of their own in lockstep, joined by RSI and Net F/T. The first two runs have the
same truth, program and seed; the others give the loop a plan for a blank that is not the one on the table. With
``--out`` every run is kept there and a second call goes on where the first one ended.

    python tools/measure_override.py --out override
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import counterflex
from counterflex.app.compensation.compensate import run as compensate
from counterflex.app.long_jobs import step_cache
from counterflex.app.proof import evaluate
from counterflex.app.proof.truth import make_truth
from counterflex.app.run import log as run_log, session as online_session
from counterflex.app.simulated_cell import cell as live
from counterflex.files.cell.cell import read_cell
from counterflex.twin.plant.force_sensor import force_sensor
from counterflex_lab.reproduce import closed_loop

ROOT = Path(__file__).resolve().parents[1]
CELL = ROOT / "examples" / "cells" / "kr300_d16_small.toml"
PROGRAM = ROOT / "examples" / "programs" / "groove.ngc"
RSI = Path(counterflex.__file__).parent / "app" / "demo" / "rsi.xml"
ONLINE = '\n[online]\nforce = "scale"\ncorrection_mm = 3\nspeed_mm_s = 40\nacceleration_mm_s2 = 2500\n'
MONITOR = '\n[monitor]\nforce_limit_n = 1200\nmargin_n = 60\noverload = "warn"\nbreakage = "warn"\n'
OVERRIDE = "\n[override]\ntolerance_um = {tolerance:g}\nleast = {least:g}\n"
CASES = ("full speed", "override", "blank ends early", "blank too high")


def main() -> None:
    """Print what the part and the log say."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder that keeps the runs; else they are thrown away")
    parser.add_argument("--seed", type=int, default=1, help="of the truth")
    parser.add_argument("--tolerance-um", type=float, default=60.0)
    parser.add_argument("--least", type=float, default=0.3, help="lowest share of the programmed speed")
    parser.add_argument("--only", nargs="*", default=CASES, choices=CASES, metavar="CASE", help=", ".join(CASES))
    chosen = parser.parse_args()
    if chosen.out is not None:
        measure(chosen.out, chosen)
        return
    with tempfile.TemporaryDirectory() as folder:
        measure(Path(folder), chosen)


def measure(folder: Path, chosen: argparse.Namespace) -> None:
    """The chosen cases, one line each, and the events of each."""
    folder.mkdir(parents=True, exist_ok=True)
    bare, truth_file = folder / "bare.toml", folder / f"truth-{chosen.seed}.toml"
    text = CELL.read_text(encoding="utf-8")
    bare.write_text(text, encoding="utf-8")
    truth = make_truth(read_cell(bare), chosen.seed, truth_file)
    bias = force_sensor(truth, 0, "sensor", hose_share=0.0).w_bias
    weights = {body.name: body.mass_kg for body in truth.bodies}
    text = text.replace("mass_kg = 75", f"mass_kg = {weights['spindle']:.4f}")
    text += f'\n[sensor]\nsegment = "sensor"\nbias_n = {bias[:3].tolist()}\nbias_nm = {bias[3:].tolist()}\n'
    text += ONLINE + MONITOR
    override = OVERRIDE.format(tolerance=chosen.tolerance_um, least=chosen.least)
    early = text.replace("box_max_mm = [60, 60, 40]", "box_max_mm = [40, 60, 40]")
    high = text.replace("box_max_mm = [60, 60, 40]", "box_max_mm = [60, 60, 44]")
    cells = {
        "full speed": (text, text),
        "override": (text, text + override),
        "blank ends early": (early, text),
        "blank too high": (high, text),
    }
    plan = planned(folder / "plan", text)
    print(f"{'':18s} entry mm  plateau mm  exit mm  time s  slowed  least speed")
    for name in chosen.only:
        there, believed = cells[name]
        found = milled(folder / name.replace(" ", "-"), there, believed, plan, truth_file)
        print(
            f"{name:18s}  {found['entry']:7.3f}  {found['plateau']:10.3f}  {found['exit']:7.3f}  {found['time_s']:6.2f}"
            f"  {100.0 * found['slowed']:4.0f} %  {100.0 * found['least']:9.0f} %"
        )
        for event in found["events"]:
            print(
                f"  {event['event'].replace('_', ' ')} at {event['path_mm']:.1f} mm of the path:"
                f" {event['value']:g} {event['unit']}, limit {event['limit']:g}"
            )


def planned(folder: Path, text: str) -> Path:
    """The plan of the groove, made once."""
    mark = step_cache.fingerprint(PROGRAM, cell=text)
    if step_cache.finished(folder, mark) is None:
        step_cache.begin(folder)
        (folder / "cell.toml").write_text(text, encoding="utf-8")
        compensate(PROGRAM, folder / "cell.toml", folder / "made", report=False, predict=False, programmed_feed=True)
        step_cache.finish(folder, mark, {})
    return folder / "made" / "plan.parquet"


def milled(folder: Path, of_cell: str, of_loop: str, plan: Path, truth: Path) -> dict[str, Any]:
    """One run: what is on the table, what the loop believes; largest errors in mm, time, what the monitor said."""
    mark = step_cache.fingerprint(PROGRAM, truth, plan, cell=of_cell, loop=of_loop)
    found = step_cache.finished(folder, mark)
    if found is not None:
        return found
    step_cache.begin(folder)
    there, believed = folder / "cell.toml", folder / "loop.toml"
    there.write_text(of_cell, encoding="utf-8")
    believed.write_text(of_loop, encoding="utf-8")
    said = closed_loop.run(
        live.LiveSettings(PROGRAM, there, truth, ("rsi", RSI), hose_share=0.0),
        folder / "part",
        online_session.RunSettings(believed, ("rsi", RSI), plan, compensated=False, arm=True),
        folder / "log",
        sensors=closed_loop.Sensors(force=True),
    )
    run = run_log.show(folder / "log")["runs"][-1]
    part = evaluate.run([folder / "part"], None)["variants"]["nominal"]
    found = {
        **{place: part[place]["max_mm"] for place in ("entry", "plateau", "exit")},
        "time_s": sum(state["cycles"] for state in run["states"].values()) * 4e-3,
        "slowed": said["slowed_share"],
        "least": said["least_speed"],
        "events": run["events"],
    }
    step_cache.finish(folder, mark, found)
    return found


if __name__ == "__main__":
    main()
