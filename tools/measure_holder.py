"""Measure the force error of an instrumented holder: printed layout and method, better places, observer.

Each laboratory (seed) calibrates the simulated holder and cuts aluminium with it as Denkena2015 section 4 does
(12000 rpm, 3000 mm/min, 1 mm wide, 10 mm deep, D 12 mm, 3 flutes). Printed are the half widths that hold 95 % of the
error of the
mean force of a revolution over the whole record, air, entry and exit included, as a mean over the seeds.

    python tools/measure_holder.py [SEEDS]
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.progress import silent
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.holder.proposal import choose_gauges
from counterflex.identify.holder.residuals import DRAWING_SHARE, parameters, readings, sensitivity_of
from counterflex.identify.solver.solve import solve
from counterflex.sensing.force_filter import kalman_observer
from counterflex.sensing.strain_holder import Gauge, HolderBeam, StrainHolder, regressed_matrix, tool_matrix
from counterflex.twin.laboratory.holder_loads import COLUMNS, cut_record, measure
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.plant.strain_holder import (
    NOISE,
    PAPER_GAUGES,
    PAPER_TCP_M,
    SAMPLE_S,
    WANDER,
    instrumented_holder,
)
from counterflex.twin.truth.truth import Truth

BEAM = HolderBeam(0.18, 0.16, 0.015, 0.118)
TCP: Float = np.array(PAPER_TCP_M)
SLEW_N: Float = np.array([1000.0, 1000.0, 30.0])
LARGEST_N = 300.0


def calibration(truth: Truth, gauges: Float, seed: int) -> Dataset:
    """Loads along each axis, both ways in the plane and towards the spindle along it, in three steps, three times."""
    directions = np.array([(1.0, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, -1)])
    rows = np.array(
        [[*(share * LARGEST_N * d), *TCP] for _ in range(3) for d in directions for share in (0.33, 0.67, 1.0)]
    )
    request = {name: rows[:, i] for i, name in enumerate(COLUMNS)}
    found = measure(truth, laboratory(seed), request, {"gauges": gauges}, silent)
    return of_arrays("loads", "holder_loads", found.channels, found.sigma, group=found.group)


def half_widths(shown: Float, force: Float) -> Float:
    """(3,) N that hold 95 % of the error of the mean of five samples: one revolution."""
    turn = np.ones(5) / 5.0
    error = np.stack([np.convolve(shown[:, i] - force[:, i], turn, "valid") for i in range(3)], axis=1)
    out: Float = np.quantile(np.abs(error), 0.95, axis=0)
    return out


def one(truth: Truth, gauges: Float, seed: int) -> dict[str, Float]:
    """Half widths by method for one laboratory, and the observer's delay."""
    data = calibration(truth, gauges, seed)
    items = tuple(Gauge((g[0], g[1], g[2]), g[3], g[4]) for g in gauges)
    holder = StrainHolder.designed(BEAM, items, TCP, NOISE)
    fit = solve(
        parameters(holder, DRAWING_SHARE, temperature=False, drift=False),
        [readings(data, holder, reference_c=holder.reference_c)],
    )
    found = replace(holder, sensitivity=sensitivity_of(fit.values, len(items)))
    time_s, force, strain, _ = cut_record(instrumented_holder(gauges, seed), TCP, np.random.default_rng(seed))
    strain = strain - strain[time_s < 0.2 * time_s[-1]].mean(axis=0)
    M, _ = regressed_matrix(data.values("strain"), data.values("f_tcp_holder"))
    observer = kalman_observer(
        tool_matrix(found.sensitivity, TCP),
        np.diag(found.noise**2),
        step_s=SAMPLE_S,
        slew_n=SLEW_N,
        wander=np.full(len(items), WANDER),
    )
    return {
        "regression f = M s": half_widths(strain @ M.T, force),
        "generalised": half_widths(strain @ found.matrix().T, force),
        "Kalman observer": half_widths(observer.run(strain), force),
        "its delay, ms": observer.delay_s * 1e3,
    }


def main(seeds: int) -> int:
    """Print the table."""
    truth: Truth = None  # type: ignore[assignment]  # the holder is loaded on its own, without an arm
    chosen = np.array([(*g.p_holder_gauge, g.angle_rad, g.factor) for g in choose_gauges(BEAM, TCP)])
    print(f"{seeds} laboratories; half width of 95 % of errors, N")
    print(f"{'places of the bridges':24}{'method':24}{'feed':>8}{'radial':>8}{'axial':>8}")
    for name, gauges in (("middle of the cheeks", np.array(PAPER_GAUGES)), ("chosen", chosen)):
        runs = [one(truth, gauges, seed) for seed in range(seeds)]
        for method in runs[0]:
            x, y, z = np.mean([run[method] for run in runs], axis=0)
            print(f"{name:24}{method:24}{x:8.1f}{y:8.1f}{z:8.1f}")
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 6))
