"""The instrumented holder: strains of its frame of beams, and hysteresis, warming, bending and misplaced loads."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from counterflex.app.identification.cell_model import model_of
from counterflex.app.proof.truth import truth_of
from counterflex.core.progress import silent
from counterflex.core.units import MM
from counterflex.files.cell.cell import read_cell
from counterflex.identify.data.dataset import of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.identify.holder.recipe import RECIPE, fitted, prepared
from counterflex.identify.recipe import Proposal
from counterflex.sensing.holder_beam import Gauge, HolderBeam
from counterflex.sensing.strain_holder import StrainHolder
from counterflex.twin.laboratory.holder_loads import measure
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.plant.strain_holder import FORCE_N, NOISE, PAPER_TCP_M, HolderShape, instrumented_holder
from counterflex.twin.truth.truth import Truth
from coverage_cases.counted import Counted, counted

CELL = Path(__file__).resolve().parents[2] / "examples" / "cells" / "kr300_d16_small.toml"
AXES = ("fx", "fy", "fz", "mx", "my", "mz")
LOADS = 24
STEP_S = 0.5
BEAM = HolderBeam(0.18, 0.16, 0.015, 0.118)
GAUGES = tuple((side * 0.0875, side * y * MM, 0.09, 0.0, 2.0) for side in (-1.0, 1.0) for y in (10.0, -10.0, 7.5))
POINT_M = 0.5 * MM
"""Where the dummy is pressed beside the point that is stated, the same for all loads there."""
BEND = 0.005
"""Share of a bridge's strain at 5 um/m, about its range, that grows with its square, one standard deviation."""
WARM = 0.05e-6
"""Strain that warming leaves over a session where the thermometer does not see it, one standard deviation."""


OTHER_SHAPE = HolderShape(
    length_m=0.24, distance_m=0.13, thickness_m=(0.0185, 0.0195), width_m=(0.09, 0.1), notch_z_m=(0.06, 0.14),
    notch_share=0.85, notch_m=0.01, base_m=0.045, ring_m=0.04, e_pa=200e9,
)  # fmt: skip
"""A holder that nothing of the recipe was chosen on: longer, narrower, with thicker cheeks and softer ends."""
OTHER_BEAM = HolderBeam(0.24, 0.13, 0.019, 0.095)
OTHER_TCP_M = (0.04, 0.015, 0.5)
OTHER_GAUGES = (
    (-0.0745, 20.0 * MM, 0.05, 0.0, 1.5), (-0.0745, -15.0 * MM, 0.17, 0.0, 1.5), (0.0745, 0.0, 0.11, np.pi / 4, 1.5),
    (0.0745, 25.0 * MM, 0.08, 0.0, 1.5), (0.0745, -20.0 * MM, 0.19, 0.0, 1.5), (-0.0745, 0.0, 0.12, np.pi / 4, 1.5),
    (-0.065, 47.5 * MM, 0.09, 0.0, 1.0), (0.065, -47.5 * MM, 0.15, np.pi / 4, 1.0),
)  # fmt: skip
"""Eight bridges on faces and edges, along the cheeks and at 45 deg."""


@cache
def cell(*, other: bool = False) -> CellModel:
    gauges, beam, tip = (OTHER_GAUGES, OTHER_BEAM, OTHER_TCP_M) if other else (GAUGES, BEAM, PAPER_TCP_M)
    items = tuple(Gauge((r[0], r[1], r[2]), r[3], r[4]) for r in gauges)
    drawn = StrainHolder.designed(beam, items, np.array(tip), NOISE)
    return replace(model_of(read_cell(CELL)), tables={"holder": drawn})


@cache
def truth() -> Truth:
    return truth_of(read_cell(CELL), 1)


@cache
def proposal(*, other: bool = False) -> Proposal:
    return RECIPE.propose(cell(other=other), LOADS, {})


def holder_of_loads(seed: int, *, errors: bool, other: bool = False) -> list[Counted]:
    """One session of loads, identified.

    Args:
        seed: Of the holder and the session.
        errors: With what the model lacks.
        other: A holder of another shape with other bridges, pressed at other points.
    """
    lab, gauges = laboratory(seed), OTHER_GAUGES if other else GAUGES
    m = measure(truth(), lab, proposal(other=other).columns, {"gauges": gauges}, silent)
    true = instrumented_holder(np.array(gauges), seed, OTHER_SHAPE if other else None)
    rng = np.random.default_rng([41, seed])
    channels = dict(m.channels)
    place, force = channels["p_holder_load"], channels["f_tcp_holder"]
    if errors:
        points, which = np.unique(np.round(place, 4), axis=0, return_inverse=True)
        aside = (POINT_M * rng.standard_normal(points.shape))[which.reshape(-1)]
        s = channels["strain"]
        if other:
            s = true.record(force, place, channels["temperature_c"][:, 0], rng, STEP_S)
        s = s + true.still(force, aside) - true.still(force, 0.0 * aside)
        s = s + BEND * rng.standard_normal(len(gauges)) * true.still(force, place) ** 2 / 5e-6
        s = s + WARM * rng.standard_normal(len(gauges)) * np.linspace(0.0, 1.0, len(s))[:, None] ** 2
        channels["strain"] = s
    else:
        clean = force - FORCE_N * rng.standard_normal(force.shape)  # what was pressed, not what was read
        warm = channels["temperature_c"] - 22.0
        s = true.still(clean, place) + true.zero + warm * true.per_kelvin
        channels["strain"] = s + np.asarray(m.sigma["strain"]) * rng.standard_normal(s.shape)
    data = of_arrays("loads", "holder_loads", channels, m.sigma, group=m.group, settings=m.settings)
    drawn, blocks = prepared(cell(other=other), [data])
    _, fit = fitted(drawn, blocks, {})
    known = {
        f"bridge{i + 1}.{a}": float(true.sensitivity[i, k]) for i in range(len(gauges)) for k, a in enumerate(AXES)
    }
    return counted(fit, known)
