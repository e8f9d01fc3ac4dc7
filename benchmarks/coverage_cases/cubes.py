"""Springs from measuring cubes: the simulated structure, and cubes, sensors and frames that move of themselves."""

from __future__ import annotations

from functools import cache

import numpy as np

from counterflex.core.units import UM, URAD
from counterflex.identify.cubes import recipe as cubes
from counterflex.identify.data.dataset import of_arrays
from counterflex.identify.recipe import Proposal
from counterflex.twin.laboratory.cubes import measure
from counterflex.twin.laboratory.laboratory import laboratory
from coverage_cases.counted import Counted, counted
from coverage_cases.pulls import CABLE_RAD, cell, compliances_of, truth_of

LOADS = 24
STAND_M, STAND_RAD = 1.0 * UM, 2.0 * URAD
"""How far the stands of the sensors yield or drift from reading to reading, one standard deviation."""
SCALE = 0.005
"""Scale of each cube's sensors, which are not set up square to its faces."""


@cache
def proposal() -> Proposal:
    return cubes.propose(cell(), LOADS, {"seed": 1})


def stiffness_of_cubes(seed: int, *, errors: bool) -> list[Counted]:
    """One campaign of cubes, identified."""
    truth = truth_of(seed)
    m = measure(truth, laboratory(seed), proposal().columns, {**proposal().settings, "history": "relaxed"})
    channels = dict(m.channels)
    if errors:
        rng = np.random.default_rng([31, seed])
        n, pairs = len(channels["q"]), int(channels["pair"].max())
        scale = 1.0 + SCALE * rng.standard_normal((pairs + 1, 6))
        which = channels["pair"][:, 0].astype(int)
        stand = np.repeat([STAND_M, STAND_RAD], 3)
        for name, place in (("d_before_base", which - 1), ("d_after_base", which)):
            channels[name] = channels[name] * scale[place] + stand * rng.standard_normal((n, 6))
        force = channels["w_tcp_base"][:, :3]
        turned = (CABLE_RAD * rng.standard_normal((len(np.unique(m.group)), 3)))[
            np.unique(m.group, return_inverse=True)[1]
        ]
        channels["w_tcp_base"] = channels["w_tcp_base"] + np.hstack([np.cross(turned, force), 0.0 * force])
    data = of_arrays("cubes", "cubes", channels, m.sigma, group=m.group, settings=m.settings)
    found = cubes.RECIPE.identify(cell(), [data], [], {"folds": 2, "as_stated": True})
    return counted(found.fits["cubes"], compliances_of(truth))
