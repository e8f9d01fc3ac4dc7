"""``counterflex compensate`` on the first 10 000, 30 000 and 90 000 moves of one program: how does its time grow?

A program finishes a curved surface of 200 x 200 mm with a ball end mill D10, as a CAM system writes it: straight moves
of 0.5 mm, back and forth (``--program`` takes a real one instead). Every length runs in a process of its own, start-up
included, with compiled kernels at hand. Printed are processor seconds (user and system) and wall seconds, peak memory,
and the exponent of processor time over moves from one length to the next: 1 is proportional, 2 a program that
compares every point with every other.

Run ``python benchmarks/compensate_growth.py``; ``--quick`` takes a hundred moves, ``--json`` prints one JSON
object. Goals: the longest within 60 s of processor time, exponents of at most 1.1.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from compensate import GOAL_S, cell_for
from counterflex.files.cell.cell import read_cell
from counterflex.robot.elasticity import compliance

LENGTHS = (10_000, 30_000, 90_000)
QUICK = (100, 200)
GOAL_EXPONENT = 1.1
SIDE_MM, STEP_MM, LINE_MM = 200.0, 0.5, 0.8
_END = ("G0 Z60", "M5", "M2")


def surface(moves: int) -> list[str]:
    """A finishing program of so many feed moves over a wavy surface."""
    lines = ["(ball end mill D10)", "G17 G21 G40 G49 G80 G90", "T1 M6", "M3 S13000", "G0 Z60", "G0 X5 Y5"]
    places = np.arange(5.0, SIDE_MM - 5.0 + 1e-9, STEP_MM)
    count, row = 0, 0
    while count < moves:
        y = 5.0 + row * LINE_MM
        for x in places if row % 2 == 0 else places[::-1]:
            z = 25.0 + 6.0 * math.sin(x / 23.0) * math.cos(y / 31.0) + 2.0 * math.sin((x + y) / 17.0)
            lines.append(f"G1 X{x:.4f} Y{y:.4f} Z{z:.4f} F1500")
            count += 1
            if count == moves:
                break
        row += 1
    return [*lines, *_END]


def first_moves(lines: list[str], moves: int) -> list[str]:
    """A program up to its so-many-th feed move, the tool then lifted."""
    feeds = [number for number, line in enumerate(lines) if line.startswith("G1 ")]
    return lines if len(feeds) <= moves else [*lines[: feeds[moves - 1] + 1], *_END]


def measured(program: Path, cell: Path, out: Path) -> dict[str, float]:
    """Run the command in a process of its own: processor and wall seconds, peak memory."""
    command = [sys.executable, "-c", "from counterflex.cli.start import run; run()", "compensate", str(program)]
    begin = time.perf_counter()
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen([*command, "--cell", str(cell), "--out", str(out)], stdout=said, stderr=said)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        wall = time.perf_counter() - begin
        if process.returncode != 0:
            said.seek(0)
            raise RuntimeError(f"{program.name}: {said.read().decode(errors='replace').strip()}")
    return {
        "cpu_s": round(used.ru_utime + used.ru_stime, 2),
        "wall_s": round(wall, 2),
        "peak_mb": round(used.ru_maxrss / 1024.0, 1),
    }


def compile_kernels(cell: Path) -> None:
    """Those that only long paths use; the others are compiled by a first run."""
    chain, rows = read_cell(cell).chain, compliance.LANES_FROM
    compliance.deflection(chain, np.tile([0.0, -1.5, 2.0, 0.0, 0.6, 0.0], (rows, 1)), np.zeros((rows, 6)))


def run(lines: list[str], lengths: tuple[int, ...], *, quick: bool = False) -> dict[str, Any]:
    """All lengths of a program: figures, exponents, goals; ``quick`` does not care whether kernels are compiled."""
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        whole = folder / "whole.ngc"
        whole.write_text("\n".join(lines) + "\n", encoding="utf-8")
        cell = cell_for(whole, folder)
        if not quick:
            compile_kernels(cell)
        for number, moves in enumerate(lengths):
            program = folder / f"first-{moves}.ngc"
            program.write_text("\n".join(first_moves(lines, moves)) + "\n", encoding="utf-8")
            if number == 0 and not quick:
                measured(program, cell, folder / "warm")
            row: dict[str, Any] = {"moves": moves, **measured(program, cell, folder / f"out-{moves}")}
            if rows:
                grown = math.log(row["cpu_s"] / rows[-1]["cpu_s"]) / math.log(moves / rows[-1]["moves"])
                row["exponent"] = round(grown, 3)
            rows.append(row)
    worst = max(row.get("exponent", 0.0) for row in rows)
    return {
        "rows": rows,
        "time": {"value_s": rows[-1]["cpu_s"], "goal_s": GOAL_S, "met": rows[-1]["cpu_s"] <= GOAL_S},
        "exponent": {"value": worst, "goal": GOAL_EXPONENT, "met": worst <= GOAL_EXPONENT},
        "load": os.getloadavg()[0],
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--program", type=Path, help="G-code of a ball end mill D10 on a surface, instead of the made one"
    )
    parser.add_argument("--quick", action="store_true", help="100 and 200 moves, for a smoke run")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    lengths = QUICK if options.quick else LENGTHS
    if options.program is None:
        lines = surface(lengths[-1])
    else:
        lines = options.program.read_text(encoding="utf-8", errors="replace").splitlines()
    result = run(lines, lengths, quick=options.quick)
    if options.json:
        print(json.dumps(result))
        return 0
    print(f"{'moves':>8} {'CPU s':>8} {'wall s':>8} {'MB':>8} {'exponent':>9}")
    for row in result["rows"]:
        figures = f"{row['moves']:8d} {row['cpu_s']:8.2f} {row['wall_s']:8.2f} {row['peak_mb']:8.0f}"
        print(f"{figures} {row.get('exponent', '')!s:>9}")
    for name, unit in (("time", " s of processor time"), ("exponent", "")):
        found = result[name]
        value, goal = (found[key + ("_s" if unit else "")] for key in ("value", "goal"))
        print(f"{name}: {value:g}{unit}, goal {goal:g}: {'met' if found['met'] else 'missed'}")
    print(f"load average {result['load']:.1f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
