"""The instrumented holder: strains of its frame of beams, and hysteresis, warming, bending and misplaced loads."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from counterflex.app.cell_model import model_of
from counterflex.app.truth import truth_of
from counterflex.core.progress import silent
from counterflex.core.units import MM
from counterflex.files.cell import read_cell
from counterflex.identify.dataset import of_arrays
from counterflex.identify.holder import RECIPE, fitted, prepared
from counterflex.identify.model import CellModel
from counterflex.identify.recipe import Proposal
from counterflex.sensing.holder_beam import Gauge, HolderBeam
from counterflex.sensing.strain_holder import StrainHolder
from counterflex.twin.laboratory import laboratory
from counterflex.twin.measure_holder_loads import measure
from counterflex.twin.strain_holder import FORCE_N, NOISE, PAPER_TCP_M, instrumented_holder
from counterflex.twin.truth import Truth
from coverage_cases.counted import Counted, counted

CELL = Path(__file__).resolve().parents[2] / "examples" / "cells" / "kr300_d16_small.toml"
AXES = ("fx", "fy", "fz", "mx", "my", "mz")
LOADS = 24
GAUGES = tuple((side * 0.0875, side * y * MM, 0.09, 0.0, 2.0) for side in (-1.0, 1.0) for y in (10.0, -10.0, 7.5))
POINT_M = 0.5 * MM
"""Where the dummy is pressed beside the point that is stated, the same for all loads there."""
BEND = 0.005
"""Share of a bridge's strain at 5 um/m, about its range, that grows with its square, one standard deviation."""
WARM = 0.05e-6
"""Strain that warming leaves over a session where the thermometer does not see it, one standard deviation."""


@cache
def cell() -> CellModel:
    items = tuple(Gauge((r[0], r[1], r[2]), r[3], r[4]) for r in GAUGES)
    drawn = StrainHolder.designed(HolderBeam(0.18, 0.16, 0.015, 0.118), items, np.array(PAPER_TCP_M), NOISE)
    return replace(model_of(read_cell(CELL)), tables={"holder": drawn})


@cache
def truth() -> Truth:
    return truth_of(read_cell(CELL), 1)


@cache
def proposal() -> Proposal:
    return RECIPE.propose(cell(), LOADS, {})


def holder_of_loads(seed: int, *, errors: bool) -> list[Counted]:
    """One session of loads, identified."""
    lab = laboratory(seed)
    m = measure(truth(), lab, proposal().columns, {"gauges": GAUGES}, silent)
    true = instrumented_holder(np.array(GAUGES), seed)
    rng = np.random.default_rng([41, seed])
    channels = dict(m.channels)
    place, force = channels["p_holder_load"], channels["f_tcp_holder"]
    if errors:
        points, which = np.unique(np.round(place, 4), axis=0, return_inverse=True)
        aside = (POINT_M * rng.standard_normal(points.shape))[which.reshape(-1)]
        s = channels["strain"] + true.still(force, aside) - true.still(force, 0.0 * aside)
        s = s + BEND * rng.standard_normal(6) * true.still(force, place) ** 2 / 5e-6
        s = s + WARM * rng.standard_normal(6) * np.linspace(0.0, 1.0, len(s))[:, None] ** 2
        channels["strain"] = s
    else:
        clean = force - FORCE_N * rng.standard_normal(force.shape)  # what was pressed, not what was read
        warm = channels["temperature_c"] - 22.0
        s = true.still(clean, place) + true.zero + warm * true.per_kelvin
        channels["strain"] = s + np.asarray(m.sigma["strain"]) * rng.standard_normal(s.shape)
    data = of_arrays("loads", "holder_loads", channels, m.sigma, group=m.group, settings=m.settings)
    drawn, blocks = prepared(cell(), [data])
    _, fit = fitted(drawn, blocks, {})
    known = {f"bridge{i + 1}.{a}": float(true.sensitivity[i, k]) for i in range(6) for k, a in enumerate(AXES)}
    return counted(fit, known)
