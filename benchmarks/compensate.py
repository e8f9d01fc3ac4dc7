"""``counterflex compensate`` on programs that a CAM system wrote: time, size, and whether the output can be trusted.

Every program runs in a process of its own, start-up included, with compiled kernels at hand. Measured are the processor
seconds (user and system) and the wall time; checked are that LinuxCNC's interpreter accepts the output (where
``tools/fetch_rs274.sh`` has fetched it), that it ends where ours says, and that everything that no force touches is as
it was: motions without correction end where they did, and their lines are in the output as they were.

Flat end mills cut the blank of the example cell. Programs of ball end mills finish a blank that was roughed to 0.5 mm
above their surface, as a roughing operation leaves it.

Run ``python benchmarks/compensate.py``; ``--folder DIR`` takes the programs of a folder, ``--quick`` only the smallest
of those that come with the package, ``--json`` prints one JSON object. Goal: 60 s on two cores for each.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import deque
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from counterflex.app.inputs import Job, read_job
from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.cutting.removal import remove_tool_path
from counterflex.cutting.stock import HeightMap
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.plan_file import read_plan
from counterflex.files.schema import read_toml, write_toml
from counterflex.path.toolpath import FEED
from counterflex.plan.plan import Plan
from counterflex.programs.gcode.read.reader import read_gcode_file
from counterflex.programs.program import Program

ROOT = Path(__file__).resolve().parents[1]
CELLS = ROOT / "examples" / "cells"
RS274 = ROOT / ".tools" / "rs274"
GOAL_S = 60.0
ALLOWANCE_M = 0.5 * MM
QUICK = ("corner.ngc",)
SAME_M = 1e-7


def upright_programs(folder: Path) -> list[Path]:
    """Programs of a folder that turn no rotary axis and have one tool.

    The judge below compares ends of motions in one frame, and the reference interpreter knows one tool length.
    """
    return [
        file
        for file in sorted(folder.glob("*.ngc"))
        if not re.search(r"^[^(;]*\b([ABC]-?\d|T2\b)", file.read_text(encoding="utf-8", errors="replace"), re.MULTILINE)
    ]


def cell_for(program: Path, folder: Path) -> Path:
    """A cell file for a program: tool by the program's comments, part frame and blank of the right size."""
    text = program.read_text(encoding="utf-8", errors="replace")[:4000].lower()
    ball = "ball" in text
    data = read_toml(CELLS / ("kr300_d10_ball.toml" if ball else "kr300_d16_flat.toml"))
    out = folder / f"{program.stem}.toml"
    write_toml(out, data)
    if not ball:
        return out
    cell = read_cell(out)
    job = read_job(program, cell)
    feed = job.path.p_part_tcp[job.path.kind == FEED] / MM
    low, high = feed.min(axis=0), feed.max(axis=0)
    radius = 0.5 * float(data["tools"][0]["diameter_mm"])
    size = [float(v) for v in np.ceil(high[:2] + radius)]
    data["part"]["y_mm"] = -0.5 * size[1]
    corners = [[0.0, 0.0], [size[0], 0.0], size, [0.0, size[1]]]
    data["part"]["datum_points_mm"] = [[*corner, float(np.ceil(high[2]))] for corner in corners]
    stock = HeightMap.from_box((0.0, 0.0, 0.0), (size[0] * MM, size[1] * MM, (high[2] + 2.0) * MM), 0.1 * MM)
    surface = stock.copy()
    remove_tool_path(surface, job.path, cell.cutter(1), engagement=False)
    touched = surface.z < stock.z
    rough = np.where(touched, np.minimum(surface.z + np.float32(ALLOWANCE_M), stock.z), np.float32(low[2] * MM))
    HeightMap(stock.x0_m, stock.y0_m, stock.cell_m, rough, stock.bottom_m).save(folder / f"{program.stem}.npz")
    data["part"]["stock"] = {"result": f"{program.stem}.npz"}
    write_toml(out, data)
    return out


def measured(program: Path, cell: Path, out: Path) -> dict[str, float]:
    """Run the command in a process of its own; processor and wall seconds."""
    command = [sys.executable, "-c", "from counterflex.cli.start import run; run()"]
    before = os.times()
    begin = time.perf_counter()
    done = subprocess.run(
        [*command, "compensate", str(program), "--cell", str(cell), "--out", str(out)],
        capture_output=True,
        text=True,
        check=False,
    )
    wall = time.perf_counter() - begin
    after = os.times()
    if done.returncode != 0:
        raise RuntimeError(f"{program.name}: {done.stderr.strip()}")
    cpu = after.children_user - before.children_user + after.children_system - before.children_system
    return {"cpu_s": round(cpu, 2), "wall_s": round(wall, 2)}


def ends_of(program: Program) -> Float:
    """(n, 3) m, ends of the motions that move."""
    out: Float = np.array([m.p_end for m in program.motions if m.kind != "dwell"]).reshape(-1, 3)
    return out


def untouched_faults(job: Job, plan: Plan, written: Program) -> list[str]:
    """Differences between a program and its compensated form where no force acts.

    Args:
        job: The original.
        plan: Its plan.
        written: The compensated program, read back.

    Returns:
        One line per fault, 5 at most; empty when all is as it must be.
    """
    corrected = np.zeros(len(job.program.motions), dtype=np.bool_)
    corrected[plan.path.motion[np.any(plan.correction_part != 0.0, axis=1)]] = True
    faults: list[str] = []
    ends, at = ends_of(written), 0
    for index, motion in enumerate(job.program.motions):
        if corrected[index] or motion.kind == "dwell":
            continue
        while at < len(ends) and np.abs(ends[at] - motion.p_end).max() > SAME_M:
            at += 1
        if at == len(ends):
            faults.append(f"motion {index} (line {job.line_of_motion[index]}) without correction ends elsewhere")
            break
    if job.program.straight:
        lines = deque(written.lines)
        for block in job.program.blocks:
            own = slice(block.first_motion, block.first_motion + block.motion_count)
            previous = corrected[block.first_motion - 1] if block.first_motion else False
            # Behind a corrected motion a modal word may have to be written out: such a line is judged by its end only.
            if corrected[own].any() or (block.motion_count and previous):
                continue
            while lines and lines[0] != block.text:
                lines.popleft()
            if not lines:
                faults.append(f"line {block.line} without correction was changed: {block.text}")
                break
            lines.popleft()
    return faults[:5]


def judge() -> ModuleType:
    """The tool that runs LinuxCNC's interpreter."""
    spec = importlib.util.spec_from_file_location("make_rs274_golden", ROOT / "tools" / "make_rs274_golden.py")
    if spec is None or spec.loader is None:
        raise RuntimeError("tools/make_rs274_golden.py is missing")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def linuxcnc_fault(file: Path) -> str | None:
    """Reason of LinuxCNC's interpreter for refusing a program, or another end than ours; None when all is well."""
    try:
        calls = judge().canonical_calls(file)
    except RuntimeError as fault:
        return str(fault)
    moves = [call for call in calls if call.startswith(("STRAIGHT_FEED(", "STRAIGHT_TRAVERSE(", "ARC_FEED("))]
    expected = [m for m in read_gcode_file(file).motions if m.kind != "dwell"]
    straight = [call for call in moves if not call.startswith("ARC")]
    ours = np.array([m.p_end for m in expected if m.kind != "arc"]).reshape(-1, 3) / MM
    theirs = np.array([[float(v) for v in call.split("(")[1].split(",")[:3]] for call in straight]).reshape(-1, 3)
    if "USE_LENGTH_UNITS(CANON_UNITS_INCHES)" in calls:
        theirs = theirs * 25.4
    # Motions that stand still are not in our list, or theirs.
    ours, theirs = _moving(ours), _moving(theirs)
    if ours.shape != theirs.shape or (len(ours) and np.abs(ours - theirs).max() > 3e-3):
        return f"LinuxCNC makes {len(theirs)} straight moves where we read {len(ours)}, or ends elsewhere"
    return None


def _moving(points: Float) -> Float:
    if len(points) == 0:
        return points
    step = np.concatenate([[True], np.any(np.abs(np.diff(points, axis=0)) > 1e-3, axis=1)])
    out: Float = points[step]
    return out


def checked(program: Path, cell: Cell, out: Path) -> list[str]:
    """Faults of one result."""
    plan, _ = read_plan(out / "plan.parquet")
    result = out / program.name
    faults = untouched_faults(read_job(program, cell), plan, read_gcode_file(result))
    if RS274.exists():
        refused = linuxcnc_fault(result)
        if refused is not None:
            faults.append(refused)
    return faults


def run(programs: list[Path]) -> dict[str, Any]:
    """All programs: figures and faults."""
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for number, program in enumerate(programs):
            cell_file = cell_for(program, folder)
            if number == 0:
                measured(program, cell_file, folder / "warm")
            out = folder / f"out-{program.stem}"
            row: dict[str, Any] = {"program": program.name, **measured(program, cell_file, out)}
            summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
            found = summary["prediction"]
            row |= {
                "lines": program.read_text(encoding="utf-8", errors="replace").count("\n"),
                "points": found["points"],
                "cutting_points": found["cutting_points"],
                "peak_force_n": found["peak_force_n"]["value"],
                "before_p997_mm": found["predicted_nominal"]["p997_mm"],
                "after_p997_mm": found["predicted_compensated"]["p997_mm"],
                "report_mb": round((out / "report.html").stat().st_size / 1e6, 2),
                "plan_mb": round((out / "plan.parquet").stat().st_size / 1e6, 2),
                "faults": checked(program, read_cell(cell_file), out),
            }
            row["within_goal"] = bool(row["cpu_s"] <= GOAL_S)
            rows.append(row)
    return {"goal_s": GOAL_S, "linuxcnc": RS274.exists(), "programs": rows}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=ROOT / "examples" / "programs", help="programs (*.ngc)")
    parser.add_argument("--quick", action="store_true", help="only the smallest program, for a smoke run")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    programs = upright_programs(options.folder)
    if options.quick:
        programs = [program for program in programs if program.name in QUICK] or programs[:2]
    if not programs:
        parser.error(f"no programs in {options.folder}")
    result = run(programs)
    if options.json:
        print(json.dumps(result))
    else:
        head = ("lines", "points", "CPU s", "wall s", "N", "before", "after mm")
        print("{:24} {:>7} {:>8} {:>7} {:>7} {:>6} {:>7} {:>8}".format("program", *head))
        for row in result["programs"]:
            print(
                f"{row['program']:24} {row['lines']:7d} {row['points']:8d} {row['cpu_s']:7.2f} {row['wall_s']:7.2f}"
                f" {row['peak_force_n']:6.0f} {row['before_p997_mm']:7.3f} {row['after_p997_mm']:8.3f}"
            )
            for fault in row["faults"]:
                print(f"  fault: {fault}")
        said = "checked by LinuxCNC" if result["linuxcnc"] else "LinuxCNC's interpreter is not here"
        print(f"goal {GOAL_S:g} s of processor time each; output {said}")
    return 1 if any(row["faults"] for row in result["programs"]) else 0


if __name__ == "__main__":
    sys.exit(main())
