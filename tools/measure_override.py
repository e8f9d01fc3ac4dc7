"""Mill a groove on the simulated cell over sockets: feed override off and on, and cuts that are not as planned.

The loop and the cell run in processes of their own in lockstep, joined by RSI and Net F/T. The first two runs have the
same truth, program and seed; the others give the loop a plan for a blank that is not the one on the table.

    python tools/measure_override.py
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import counterflex
from counterflex.app import evaluate, live, online, over_sockets, run_log
from counterflex.app.compensate import run as compensate
from counterflex.app.truth import make_truth
from counterflex.files.cell import read_cell
from counterflex.twin.force_sensor import force_sensor

ROOT = Path(__file__).resolve().parents[1]
CELL = ROOT / "examples" / "cells" / "kr300_d16_small.toml"
PROGRAM = ROOT / "examples" / "programs" / "groove.ngc"
RSI = Path(counterflex.__file__).parent / "app" / "demo" / "rsi.xml"
ONLINE = '\n[online]\nforce = "scale"\ncorrection_mm = 3\nspeed_mm_s = 40\nacceleration_mm_s2 = 2500\n'
MONITOR = "\n[monitor]\nforce_limit_n = 1200\nmargin_n = 60\n"
OVERRIDE = "\n[override]\ntolerance_um = {tolerance:g}\nleast = {least:g}\n"


def main() -> None:
    """Print what the part and the log say."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1, help="of the truth")
    parser.add_argument("--tolerance-um", type=float, default=60.0)
    parser.add_argument("--least", type=float, default=0.3)
    parser.add_argument("--only", nargs="*", default=["full speed", "override", "blank ends early", "blank too high"])
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as kept:
        folder = Path(kept)
        text = CELL.read_text(encoding="utf-8")
        (folder / "bare.toml").write_text(text, encoding="utf-8")
        truth = make_truth(read_cell(folder / "bare.toml"), chosen.seed, folder / "truth.toml")
        bias = force_sensor(truth, 0, "sensor", hose_share=0.0).w_bias
        weights = {body.name: body.mass_kg for body in truth.bodies}
        text = text.replace("mass_kg = 75", f"mass_kg = {weights['spindle']:.4f}")
        text += f'\n[sensor]\nsegment = "sensor"\nbias_n = {bias[:3].tolist()}\nbias_nm = {bias[3:].tolist()}\n'
        text += ONLINE + MONITOR
        override = OVERRIDE.format(tolerance=chosen.tolerance_um, least=chosen.least)
        early = text.replace("box_max_mm = [60, 60, 40]", "box_max_mm = [40, 60, 40]")
        high = text.replace("box_max_mm = [60, 60, 40]", "box_max_mm = [60, 60, 44]")
        cases = {
            "full speed": (text, text),
            "override": (text, text + override),
            "blank ends early": (early, text),
            "blank too high": (high, text),
        }
        for name in chosen.only:
            mill(folder / name.replace(" ", "-"), name, *cases[name], folder / "truth.toml")


def mill(folder: Path, name: str, of_cell: str, of_loop: str, truth: Path) -> None:
    """One run: what is on the table, what the loop believes."""
    folder.mkdir()
    there, believed = folder / "cell.toml", folder / "loop.toml"
    there.write_text(of_cell, encoding="utf-8")
    believed.write_text(of_loop, encoding="utf-8")
    compensate(PROGRAM, believed, folder / "plan", report=False)
    summary = over_sockets.run(
        live.LiveSettings(PROGRAM, there, truth, RSI, hose_share=0.0),
        folder / "part",
        online.RunSettings(believed, RSI, folder / "plan" / "plan.parquet", compensated=False, arm=True),
        folder / "log",
        sensors=over_sockets.Sensors(force=True),
    )
    run = run_log.show(folder / "log")["runs"][0]
    found = evaluate.run([folder / "part"], None)["variants"]["nominal"]
    time_s = sum(state["cycles"] for state in run["states"].values()) * 4e-3
    print(
        f"{name}: entry {found['entry']['max_mm']:.3f}, plateau {found['plateau']['max_mm']:.3f},"
        f" exit {found['exit']['max_mm']:.3f} mm at most; {time_s:.2f} s, slowed in"
        f" {100.0 * summary['slowed_share']:.0f} % of the cycles down to {100.0 * summary['least_speed']:.0f} %"
    )
    for event in run["events"]:
        print(
            f"  {event['event'].replace('_', ' ')} at {event['path_mm']:.1f} mm of the path:"
            f" {event['value']:g} {event['unit']}, limit {event['limit']:g}"
        )


if __name__ == "__main__":
    main()
