"""Force constants from test cuts on the simulated cell, judged on cuts that were never used to find them.

For every seed of the truth: propose test cuts, mill them on the simulated cell, identify; then mill other cuts (slots
and side cuts, up and down, of another proposal: other depths, feeds, directions and widths) and compare the force
along the path with what the planner's model predicts, the robot yielding, with the identified constants and with
those of the cell file. Both are averaged over 2 mm of path. Entry and exit are the first and the last tool diameter
of every contact, the plateau is the rest. Printed is ``sum |measured - predicted| / sum |measured|`` in %.

    python benchmarks/cutting_force.py --seeds 0 1 2
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from counterflex.app.identification.cell_model import model_of
from counterflex.app.inputs import setting_of
from counterflex.app.proof.simulate import controller
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float, Int
from counterflex.core.progress import silent
from counterflex.core.units import MM
from counterflex.cutting.coefficients import ForceLaw
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.identify.cutting.recipe import RECIPE
from counterflex.identify.data.changes import CuttingLaw
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.recipe import Identification
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.cut import cut
from counterflex.plan.inputs import part_compliance, solve_joints
from counterflex.plan.lowest_mode import mode_of
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.laboratory.slot_path import slot_path, straight_cuts
from counterflex.twin.laboratory.slots import measure
from counterflex.twin.plant.simulate import simulate
from counterflex.twin.truth.truth import Truth

ROOT = Path(__file__).resolve().parents[1]
CELL = ROOT / "examples" / "cells" / "kr300_d16_flat.toml"
WINDOW_M = 2.0 * MM
PHASES = ("entry", "plateau", "exit")


def identified(cell: Cell, truth: Truth, count: int) -> Identification:
    """Propose, measure and identify; validation by cuts of another proposal."""
    model, seed = model_of(cell), truth.seed or 0
    data: list[Dataset] = []
    for number, offset in ((count, 0), (count // 2, 1000)):
        proposal = RECIPE.propose(model, number, {"seed": seed + offset})
        taken = measure(truth, laboratory(seed), proposal.columns, proposal.settings)
        data.append(of_arrays(f"cuts {offset}", "slots", dict(taken.channels), dict(taken.sigma), group=taken.group))
    return RECIPE.identify(model, data[:1], data[1:], {}, silent)


def machined_force(path: ToolPath, cell: Cell, truth: Truth) -> Float:
    """(n, 3) N mean force in the part frame on every row of the path, as the twin had it; NaN where it was skipped."""
    record = simulate(
        path, truth=truth, controller=controller(cell), stock=cell.stock(), cutter=cell.cutter(1),
        datum_points_part=cell.datum_points_part,
    )  # fmt: skip
    out: Float = np.full((len(path), 3), np.nan)
    for row in np.unique(record.row):
        out[row] = record.force_part[record.row == row].mean(axis=0)
    known = np.flatnonzero(~np.isnan(out[:, 0]))
    for i in np.flatnonzero(np.isnan(out[:, 0])):  # a row that is run within one cycle: as its neighbours
        near = int(np.searchsorted(known, i))
        if 0 < near < len(known) and known[near] - known[near - 1] < 4:
            out[i] = 0.5 * (out[known[near - 1]] + out[known[near]])
    return out


def predicted_force(path: ToolPath, cell: Cell, law: ForceLaw) -> Float:
    """(n, 3) N mean force of the planner's model on every row, the robot yielding."""
    setting = setting_of(cell, law=law)
    q = solve_joints(path, np.zeros(int(path.motion.max()) + 1, dtype=np.int64), setting).q
    in_contact = q[len(q) // 2]  # one mode for the whole path: that of its middle
    C = part_compliance(setting, setting.relative_motion(path), q)
    bent = cut(
        path, path.p_part_tcp, cell.stock(), cell.cutter, law, compliance_part=C,
        mode=mode_of(setting.chain, in_contact, setting.mode),
    )  # fmt: skip
    return bent.w_tcp_part[:, :3]


def along(path: ToolPath) -> Float:
    """(n,) m, distance run."""
    out: Float = np.cumsum(np.linalg.norm(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]), axis=1))
    return out


def windows(path: ToolPath, force: Float, diameter_m: float) -> list[tuple[str, Int]]:
    """Phase and rows of every window of every contact."""
    contact = (np.nan_to_num(np.linalg.norm(force, axis=1)) > 1.0) & (path.kind == FEED)
    run, out = along(path), []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], contact, [False]]).astype(np.int8)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        rows = np.arange(first, last)
        for number in np.unique(((run[rows] - run[first]) / WINDOW_M).astype(np.int64)):
            mine = rows[((run[rows] - run[first]) / WINDOW_M).astype(np.int64) == number]
            middle = float(run[mine].mean())
            phase = "plateau"
            if middle - run[first] < diameter_m:
                phase = "entry"
            elif run[last - 1] - middle < diameter_m:
                phase = "exit"
            out.append((phase, mine))
    return out


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--count", type=int, default=12, help="pieces of test cuts")
    parser.add_argument("--quick", action="store_true", help="one seed, half the cuts: a smoke run")
    chosen = parser.parse_args()
    if chosen.quick:
        chosen.seeds, chosen.count = chosen.seeds[:1], chosen.count // 2
    cell = read_cell(CELL)
    cutter = cell.cutter(1)
    print(f"{'seed':>4} {'settled, not used':>20} " + " ".join(f"{phase:>18}" for phase in PHASES))
    total = {phase: np.zeros(3) for phase in PHASES}
    for seed in chosen.seeds:
        truth = truth_of(cell, seed)
        found = identified(cell, truth, chosen.count)
        change = found.changes[0]
        if not isinstance(change, CuttingLaw):
            return 1
        other = RECIPE.propose(model_of(cell), 4 if chosen.quick else 8, {"seed": seed + 2000})
        cuts = straight_cuts(other.columns)
        path, _ = slot_path(cuts.subset(cuts.blank == 0), 1)
        true = machined_force(path, cell, truth)
        guesses = [predicted_force(path, cell, law) for law in (change.law, cell.force_law)]
        sums = {phase: np.zeros(3) for phase in PHASES}
        for phase, rows in windows(path, true, cutter.diameter_m):
            mean = true[rows].mean(axis=0)
            errors = [float(np.linalg.norm(guess[rows].mean(axis=0) - mean)) for guess in guesses]
            sums[phase] += np.array([*errors, float(np.linalg.norm(mean))])
        head = found.headline[0]
        print(f"{seed:>4} {head.value:11.1f} ({head.nominal or 0.0:5.1f})   " + _row(sums), flush=True)
        for phase in PHASES:
            total[phase] += sums[phase]
    print(f"{'all':>4} {'':>20} " + _row(total))
    print("identified (cell file), error of the mean force, %")
    return 0


def _row(sums: dict[str, Float]) -> str:
    return " ".join(f"{100.0 * a / c:10.1f} ({100.0 * b / c:5.1f})" for a, b, c in sums.values())


if __name__ == "__main__":
    sys.exit(main())
