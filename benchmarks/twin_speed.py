"""Speed of the simulated cell on one core: real-time factors without and with cutting.

Usage: ``python benchmarks/twin_speed.py [--quick] [--json]``. Factors are simulated seconds per CPU-second of this
process, after the kernels are compiled. Goals: 10 without cutting, 3 with.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from dataclasses import replace

import numpy as np

from counterflex.core.arrays import Float
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.geometry import pose
from counterflex.path.toolpath import FEED, RAPID, ToolPath
from counterflex.robot.model import catalog
from counterflex.robot.model.description import EndEffector
from counterflex.twin.plant.controller import controller_of
from counterflex.twin.plant.plant import Plant
from counterflex.twin.plant.simulate import simulate
from counterflex.twin.truth.nominal import nominal_truth
from counterflex.twin.truth.truth import CuttingTruth


def grooving(rows: int, length: float, depth: float) -> ToolPath:
    points: list[list[float]] = [[-0.02, 0.0, 0.005]]
    kinds = [RAPID]
    for row in range(rows):
        y = 0.02 * row
        points += [[-0.02, y, 0.005], [-0.02, y, -depth], [length + 0.02, y, -depth], [length + 0.02, y, 0.005]]
        kinds += [RAPID, FEED, FEED, RAPID]
    p: Float = np.array(points)
    kind = np.array(kinds)
    feed = np.where(kind == FEED, 0.025, 0.25)
    spent = np.cumsum(np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1) / feed)
    n = len(p)
    return ToolPath(
        p, np.tile([0.0, 0, 1], (n, 1)), kind, feed, np.full(n, 13000 * 2 * math.pi / 60), spent, np.arange(n),
        np.ones(n, dtype=np.int64),
    )  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="short runs, for a smoke test")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    robot = catalog.load("kuka_kr300_r2500_ultra")
    elements = catalog.end_effector_elements()
    sensor, holder = elements["haehn2020_sensor"].segment, elements["haehn2020_spindle_holder"].segment
    T_flange_tcp = np.array([[0.0, 0, 1, 0.3], [0, 1, 0, 0], [-1, 0, 0, 0.15], [0, 0, 0, 1]])
    hand = EndEffector(
        (sensor, replace(holder, T_prev_seg=pose.inverse(sensor.T_prev_seg) @ holder.T_prev_seg)),
        pose.inverse(holder.T_prev_seg) @ T_flange_tcp,
    )
    truth = nominal_truth(robot, hand, CuttingTruth((800e6, 280e6, 120e6), (0.25, 0.25, 0.25)))
    controller = controller_of(robot, hand, pose.make(p=np.array([1.6, 0, 1.1])), rotation_about_tool_rad=math.pi)

    plant, rest = Plant(truth), np.zeros(6)
    q = np.radians([0.0, -92, 115, 180, 23, -180])
    plant.reset(q)
    plant.step(q, rest, rest)
    steps = 2_000 if options.quick else 20_000
    begin = time.process_time()
    for _ in range(steps):
        plant.step(q, rest, rest)
    air_s = (time.process_time() - begin) / steps

    length = 0.02 if options.quick else 0.1
    stock = HeightMap.from_box((0.0, -0.02, -0.02), (length, 0.06, 0.0), 1e-4)

    def run(depth: float) -> tuple[float, float]:
        path = grooving(1 if options.quick else 2, length, depth)
        started = time.process_time()
        record = simulate(
            path, truth=truth, controller=controller, stock=stock, cutter=Cutter(16e-3, flutes=3), skip_air=False
        )
        return float(record.time_s[-1]), time.process_time() - started

    run(3e-3)  # compiles
    flown, flying = run(-20e-3)
    simulated, spent = run(3e-3)
    result = {
        "plant_step_us": air_s * 1e6,
        "real_time_factor_plant": plant.step_s / air_s,
        "real_time_factor_air": flown / flying,
        "real_time_factor_cutting": simulated / spent,
        "simulated_s": simulated,
        "cpu_s": spent,
    }
    if options.json:
        print(json.dumps(result))
        return
    for name, value in result.items():
        print(f"{name:28} {value:8.2f}")


if __name__ == "__main__":
    main()
