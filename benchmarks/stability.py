"""Stability: reference values of the benchmark and time per diagram.

Prints the multipliers and limits of the published milling benchmark (922 Hz, damping 0.011, 0.03993 kg, two teeth)
beside their reference and beside Chebyshev collocation, which converges spectrally; the low-frequency criterion beside
semi-discretisation on random robots; and the processor time of a lobe diagram by the zeroth-order solution (400 speeds)
and by semi-discretisation (40 speeds).

Run ``OPENBLAS_NUM_THREADS=1 python benchmarks/stability.py``; ``--quick`` is a smoke run.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.units import MM
from counterflex.cutting.stability import lobes, low_frequency, semi_discretisation
from counterflex.cutting.stability.modes import TipModes, modes_along
from counterflex.cutting.stability.process import Process, process_of_arc

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "references"))
import milling_collocation  # what the tests judge by

STIFFNESS: Final = 0.03993 * (2.0 * np.pi * 922.0) ** 2
ONE: Final = modes_along(np.array([922.0]), np.array([0.011]), np.array([STIFFNESS]), np.eye(3)[:1])
ROUND: Final = modes_along(np.full(2, 922.0), np.full(2, 0.011), np.full(2, STIFFNESS), np.eye(3)[:2])
SPEEDS: Final = (6000, 9000, 12000, 15000, 18000, 22000)
CUTS: Final = {
    "slot": (process_of_arc(0.0, np.pi, 6e8, 2e8, 2), (0.0498, 0.345, 0.0852, 0.1145, 0.0480, 0.1202)),
    "half immersion": (
        process_of_arc(0.0, 0.5 * np.pi, 6e8, 2e8, 2),
        (0.1314, 0.948, 0.2423, 0.2821, 0.1307, 0.3565),
    ),
    "5 % down": (
        process_of_arc(np.pi - np.arccos(0.9), np.pi, 6e8, 2e8, 2),
        (1.654, 11.88, 8.06, 1.668, 3.706, 10.59),
    ),
}
"""Engagement, and reference limits in mm at 50 intervals of a tooth period."""
MULTIPLIERS: Final = {0.2: 0.8197, 0.5: 1.0740, 0.7: 1.2216, 1.0: 1.4065}


def multipliers() -> None:
    """Slot at 5000 rpm, one direction."""
    print("depth, mm   |mu| extrapolated   reference   default intervals")
    slot = CUTS["slot"][0]
    for depth, reference in MULTIPLIERS.items():
        coarse, fine = (semi_discretisation.largest_multiplier(ONE, slot, 0.006, depth * MM, k) for k in (200, 400))
        default = semi_discretisation.largest_multiplier(ONE, slot, 0.006, depth * MM)
        print(f"{depth:9.1f} {fine + (fine - coarse) / 3.0:19.4f} {reference:11.4f} {default:19.4f}")


def limits(speeds: tuple[int, ...]) -> None:
    """Two directions: zeroth order, 50 equal intervals, default intervals, reference, collocation."""
    print("\ncut              rpm   zeroth order   50 intervals   reference, mm   by default   collocation, mm")
    grid = lobes.frequencies_for(ROUND)
    for name, (process, references) in CUTS.items():
        entry, leave = process.arcs[0, :2]
        cut = milling_collocation.Cut(2.0 * np.pi * 922.0, 0.011, STIFFNESS, entry, leave, (6e8, 2e8), 2)
        for rpm in speeds:
            period, reference = 30.0 / rpm, references[SPEEDS.index(rpm)]
            zeroth, _ = lobes.limits(process.mean, ROUND.response(grid), grid, np.array([period]))
            equal, chosen = (
                semi_discretisation.limit(
                    ROUND, process, period, most=1.3 * MM * reference, least=0.8 * MM * reference, intervals=k,
                    tolerance=2e-4,
                )
                for k in (50, None)
            )  # fmt: skip
            true = milling_collocation.limit(cut, period, (0.7 * MM * reference, 1.2 * MM * reference))
            print(
                f"{name:15s} {rpm:5d} {zeroth[0] / MM:12.4f} {equal / MM:14.4f} {reference:15.4f}"
                f" ({100.0 * (equal / MM / reference - 1.0):5.2f} %) {chosen / MM:10.4f} {true / MM:12.4f}"
                f" ({100.0 * (chosen / true - 1.0):5.2f} %)"
            )


def criterion(count: int) -> None:
    """Low-frequency criterion against semi-discretisation: robots of two modes, any engagement."""
    random = np.random.default_rng(1)
    for low, high in ((0.02, 0.1), (0.1, 0.3)):
        errors: list[float] = []
        while len(errors) < count:
            f, ratio = random.uniform(5.0, 36.0), random.uniform(0.01, 0.08)
            T = random.uniform(low, high) / (2.0 * np.pi * f)
            phi = float(np.arccos(1.0 - 2.0 * random.uniform(0.1, 0.9)))
            entry, leave = (0.0, phi) if random.random() < 0.5 else (np.pi - phi, np.pi)
            process = process_of_arc(entry, leave, 8e8, random.uniform(0.2, 0.6) * 8e8, int(random.integers(1, 5)))
            u = random.normal(size=(2, 3)) * np.array([1.0, 1.0, 0.0])
            frequencies = np.array([f, f * random.uniform(0.4, 1.0)])
            modes = modes_along(frequencies, np.full(2, ratio), np.array([3.9e5, 6e5]), u)
            factor, _ = low_frequency.limit(modes, process.mean, T)
            if np.isfinite(factor):
                other = semi_discretisation.limit(
                    modes, process, T, most=1.3 * factor, least=0.9 * factor, tolerance=2e-4
                )
                errors.append(100.0 * (factor / other - 1.0))
        size = np.abs(errors)
        figures = f"error median {np.median(size):.2f} %, worst {size.max():.2f} %"
        print(f"omega T {low:g} to {high:g}: {count} robots, {figures}")


def _timed(what: str, job: Callable[[], object]) -> None:
    job()
    begin = time.process_time()
    job()
    print(f"{what}: {time.process_time() - begin:.3f} s")


def _by_semi_discretisation(modes: TipModes, process: Process, count: int) -> None:
    periods = 30.0 / np.linspace(5000.0, 25000.0, count)
    grid = lobes.frequencies_for(modes)
    zeroth, _ = lobes.limits(process.mean, modes.response(grid), grid, periods)
    for period, guess in zip(periods, zeroth, strict=True):
        semi_discretisation.limit(modes, process, period, most=1.5 * guess, least=0.5 * guess, tolerance=5e-3)


def diagrams(quick: bool) -> None:
    """Processor time per diagram."""
    print()
    process = CUTS["half immersion"][0]
    grid = lobes.frequencies_for(ROUND)
    periods = 30.0 / np.linspace(5000.0, 25000.0, 400)
    _timed(
        "lobe diagram, zeroth order, two modes, 400 speeds, processor time",
        lambda: lobes.limits(process.mean, ROUND.response(grid), grid, periods),
    )
    count = 5 if quick else 40
    _timed(
        f"lobe diagram, semi-discretisation, two modes, {count} speeds, processor time",
        lambda: _by_semi_discretisation(ROUND, process, count),
    )
    robot = modes_along(np.linspace(8.0, 130.0, 12), np.full(12, 0.05), np.full(12, 2e6), np.tile(np.eye(3), (4, 1)))
    _timed("limit of one path point, zeroth order, twelve modes, processor time",
           lambda: lobes.limits(process.mean, robot.response(lobes.frequencies_for(robot)),
                                lobes.frequencies_for(robot), np.array([1.5e-3])))  # fmt: skip
    _timed("limit of one path point, low-frequency criterion, twelve modes, processor time",
           lambda: low_frequency.limit(robot, process.mean, 1e-4))  # fmt: skip


def main() -> None:
    """Print all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="Smoke run: fewer speeds and robots.")
    quick = parser.parse_args().quick
    multipliers()
    limits(SPEEDS[2:4] if quick else SPEEDS)
    print()
    criterion(5 if quick else 200)
    diagrams(quick)


if __name__ == "__main__":
    main()
