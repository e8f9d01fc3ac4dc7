"""Force constants from test cuts: forces of single teeth, and runout, wear, widths and a sensor beside the model."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float
from counterflex.core.progress import silent
from counterflex.core.units import MM, N_PER_MM2, RPM, UM
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import engagement_of_arc
from counterflex.cutting.tooth_force import tooth_forces
from counterflex.files.cell.cell import read_cell
from counterflex.identify.cutting.recipe import RECIPE
from counterflex.identify.data.dataset import of_arrays
from counterflex.identify.data.model import CellModel
from coverage_cases.counted import Counted, counted

CELL = Path(__file__).resolve().parents[2] / "tests" / "data" / "cells" / "small.toml"
SPEED = 13000.0 * RPM
CUTTER = Cutter(16.0 * MM, flutes=3, flute_length_m=35.0 * MM)
CUTS = [(f, d, 0.0) for f, d in zip((16, 24, 36, 54, 80) * 2, (2, 3, 4, 2.5, 3.5) * 2, strict=True)]
CUTS += [(f, 3.0, w) for f, w in zip((16, 24, 36, 54, 80), (8.0, -8.0, 4.0, -12.0, 12.0), strict=True)]
NOISE = 0.01
RUNOUT_M = 5.0 * UM
WEAR = 0.003
"""Growth of the force from cut to cut."""
ACROSS = 0.02
"""Share of the force along each axis that the sensor shows along the others, one standard deviation."""
SCALE = 0.01
"""Scale of each axis of the sensor, one standard deviation."""
AGAIN = 0.02
"""How well the force of a cut repeats, beside the noise."""


def law(seed: int, *, known: bool = False) -> KienzleLaw:
    """True law of the material, off the known one by a tenth; exponents by 0.03."""
    rng = np.random.default_rng([61, seed])
    k = np.array([780.0, 273.0, 117.0]) * (1.0 if known else np.exp(0.1 * rng.standard_normal(3)))
    m = 0.25 + (0.0 if known else 0.03) * rng.standard_normal(3)
    return KienzleLaw.from_k11(
        k[0] * N_PER_MM2, m[0], kr11_pa=k[1] * N_PER_MM2, mr=m[1], ka11_pa=k[2] * N_PER_MM2, ma=m[2],
        h_min_m=UM, h_max_m=MM, source="drawn", status="drawn",
    )  # fmt: skip


@cache
def cell() -> CellModel:
    blank = np.array([[0.0, 0.0, 0.0], [120.0, 100.0, 40.0]]) * MM
    known = law(0, known=True)
    return replace(model_of(read_cell(CELL)), cutter_of=lambda _: CUTTER, law_of=lambda: known, blank_part=blank)


def force(cutter: Cutter, true: KienzleLaw, feed: float, depth: float, width: float) -> Float:
    """(3,) N in the feed frame, mean of the single teeth."""
    R = cutter.radius_m
    leave = math.acos((R - width * MM) / R) if width > 0.0 else math.pi
    entry = math.acos((-R - width * MM) / R) if width < 0.0 else 0.0
    engaged = engagement_of_arc(cutter, depth * MM, entry, leave, n_bins=128)
    return tooth_forces(cutter, true, engaged, feed * UM, trochoid=False).mean[:3]


def constants_of_slots(seed: int, *, errors: bool, worse: float = 1.0, stated: bool = False) -> list[Counted]:
    """One set of cuts, identified with an exponent for each direction.

    Args:
        seed: Of the truth.
        errors: With what the model lacks. Without, the data sheet says that there is none.
        worse: How many times worse the sensor is than :data:`SCALE` and :data:`ACROSS`.
        stated: Whether the manifest says how good the sensor is; else the recipe's usual values count.
    """
    rng, true = np.random.default_rng([62, seed]), law(seed)
    eccentric = replace(CUTTER, runout_m=RUNOUT_M, runout_angle_rad=rng.uniform(0.0, 2.0)) if errors else CUTTER
    clean = np.array([force(eccentric, true, *cut) for cut in CUTS])
    sigma = np.maximum(NOISE * np.linalg.norm(clean, axis=1), 0.3)[:, None] * np.ones(3)
    felt = clean
    if errors:
        felt = felt * (1.0 + WEAR * np.arange(len(CUTS))[:, None]) * np.exp(AGAIN * rng.standard_normal((len(CUTS), 1)))
        felt = felt @ (np.eye(3) + worse * ACROSS * rng.standard_normal((3, 3)) * (1.0 - np.eye(3)))
        felt = felt * (1.0 + worse * SCALE * np.random.default_rng([63, seed]).standard_normal(3))
    felt = felt + sigma * rng.standard_normal(felt.shape)
    n = len(CUTS)
    feed, depth, width = np.array(CUTS, dtype=np.float64).T
    arrays = {
        "f_tcp_base": np.stack([felt[:, 0], felt[:, 1], felt[:, 2]], axis=1),
        "feed_direction": np.tile([1.0, 0.0, 0.0], (n, 1)),
        "feed_rate": feed * UM * SPEED / (2.0 * math.pi) * CUTTER.flutes,
        "spindle_speed": np.full(n, SPEED),
        "depth": depth * MM,
        "width": np.where(width == 0.0, 99.0, width) * MM,
    }
    sheet = {"force_scale_sigma": worse * SCALE, "force_cross_talk_sigma": worse * ACROSS, "force_alignment_rad": 0.0}
    settings = sheet if errors and stated else {} if errors else dict.fromkeys(sheet, 0.0)
    data = of_arrays("cuts", "slots", arrays, {"f_tcp_base": sigma}, settings=settings)
    beside = {} if errors else {"wear_sigma": 0.0, "runout_sigma_m": 0.0}
    found = RECIPE.identify(cell(), [data], [], {"form": "kienzle-3", "folds": 2, "as_stated": True, **beside}, silent)
    fit = found.fits["cutting"]
    h = next(f.value for f in found.figures if f.name == "h_ref_um") * UM
    k, m = np.array(true.k11_pa()), np.array([true.mc, true.mr, true.ma])
    truth = dict(zip(("kc", "kr", "ka"), (float(v) for v in k * (h / MM) ** -m), strict=True))
    truth |= dict(zip(("mc", "mr", "ma"), (float(v) for v in m), strict=True))
    return counted(fit, truth)
