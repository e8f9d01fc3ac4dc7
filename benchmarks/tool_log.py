"""The measured path of the tool against what ``evaluate`` has of the same simulated part.

The tool's path on the simulated cell is logged with noise by a tracker in the part frame, while it cuts; ``inspect
--tool-log`` judges it. Each figure stands beside that of ``evaluate``, which knows the path exactly.

    python benchmarks/tool_log.py
    python benchmarks/tool_log.py --seeds 1001-1010 --noise-um 50
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from counterflex.app.inputs import read_job
from counterflex.app.inspection.judging import inspect
from counterflex.app.inspection.tool_log import LogHow
from counterflex.app.inspection.tool_path import InspectedPath
from counterflex.app.proof import judge, simulate
from counterflex.app.proof.truth import truth_of
from counterflex.core.units import MM, UM
from counterflex.files.cell.cell import read_cell
from counterflex.twin.truth.family import family_of
from seeds_option import seeds_of

ROOT = Path(__file__).resolve().parents[1]
GOAL_UM = 10.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=Path, default=ROOT / "examples/programs/groove.ngc")
    parser.add_argument("--cell", type=Path, default=ROOT / "examples/cells/kr300_d16_small.toml")
    parser.add_argument("--seeds", type=seeds_of, default="1001-1003")
    parser.add_argument("--noise-um", type=float, default=15.0, help="of a reading, per axis")
    parser.add_argument("--quick", action="store_true", help="one seed: does it work at all?")
    given = parser.parse_args()
    cell = read_cell(given.cell)
    job = read_job(given.program, cell)
    reference = judge.reference_of(job, cell)
    largest: dict[str, float] = {}
    print("seed   figure                       evaluate mm   off um   U um")
    for seed in given.seeds[: 1 if given.quick else None]:
        record = simulate.machine(job, cell, truth_of(cell, seed, family_of("mild")))
        judged = judge.judge(reference, record, record.stock)
        noise = np.random.default_rng(seed).normal(scale=given.noise_um * UM, size=record.p_part_tcp.shape)
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "tracker.csv"
            rows = np.column_stack([record.time_s, (record.p_part_tcp + noise) / MM])
            lines = [",".join(f"{v:.6f}" for v in row) for row in rows]
            log.write_text("\n".join(["time_s,x_mm,y_mm,z_mm", *lines]) + "\n")
            measured = inspect(given.program, given.cell, log, how=LogHow(frame="as-measured", cut=True))
        part = measured.parts["part"]
        assert isinstance(part, InspectedPath)
        rows_of = [("path.p997", judged.variant.path.path.p997_m, part.figures.path.p997_m, 0.0)]
        rows_of.append(("path.max", judged.variant.path.path.max_m, part.figures.path.max_m, 0.0))
        if judged.surface is not None:
            surface = part.part.surface_deviation()
            rows_of.append(("surface.p997", judged.surface.surface.p997_m, surface.surface.p997_m, 0.0))
        by_name = {(row.feature, row.quantity): row for row in measured.features}
        for row in judge.features(reference, {"nominal": judged}):
            other = by_name[row.feature, row.quantity]
            sigma = other.standard_deviation_m["part"]
            for kind in ("mean", "worst"):
                values = [getattr(one, f"{kind}_m")[name] for one, name in ((row, "nominal"), (other, "part"))]
                rows_of.append((f"{row.feature} {row.quantity}, {kind}", *values, 2.0 * sigma))
        for name, true, value, spread in rows_of:
            off = (value - true) / UM
            print(f"{seed}   {name:28} {true / MM:11.4f} {off:+8.1f} {spread / UM:6.1f}")
            kind = "mean" if name.endswith("mean") else "worst" if name.endswith("worst") else "path and surface"
            kind = "flatness" if "flatness" in name else kind
            largest[kind] = max(largest.get(kind, 0.0), abs(off))
    for kind, value in largest.items():
        print(f"largest difference, {kind}: {value:.1f} um ({'met' if value <= GOAL_UM else 'MISSED'}: {GOAL_UM:g} um)")


if __name__ == "__main__":
    main()
