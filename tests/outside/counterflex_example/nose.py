"""A recipe: compliance of the tool against the spindle nose, from pushes with a dial gauge between the two."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import UM, UM_PER_KN
from counterflex.identify.data.changes import ElementCompliance
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.model import CellModel
from counterflex.identify.recipe import Curve, Figure, Identification, Inputs, Picture, Proposal, Recipe
from counterflex.identify.solver.holdout import cross_validate, score_separate
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.identify.solver.solve import solve


@dataclass(frozen=True, eq=False)
class Pushes:
    """``d = c f`` in every direction: (n, 3) displacement m, (n, 3) force N, (n, 3) standard deviation m."""

    f: Float
    d: Float
    sigma: Float
    group: Int
    name: str = "pushes"
    components: tuple[str, ...] = ("x m", "y m", "z m")

    def evaluate(self, x: Float) -> Float:
        """(n, 3) weighted residuals for the compliance x[0] in m/N."""
        out: Float = (self.d - x[0] * self.f) / self.sigma
        return out

    def jacobian(self, x: Float) -> Float:
        """(n, 3, 1) their derivative."""
        out: Float = (-self.f / self.sigma)[:, :, None] * np.ones(len(x))
        return out

    def subset(self, rows: Bool) -> Pushes:
        """The marked rows only."""
        return replace(self, f=self.f[rows], d=self.d[rows], sigma=self.sigma[rows], group=self.group[rows])


def pushes(data: Sequence[Dataset]) -> Pushes:
    """The rows of all datasets."""
    return Pushes(
        np.concatenate([d.values("f_tcp_base") for d in data]),
        np.concatenate([d.values("d_tcp_base") for d in data]),
        np.concatenate([d.channel("d_tcp_base").need_sigma() for d in data]),
        np.concatenate([d.group for d in data]),
    )


def find(given: Inputs) -> Identification:
    """Fit the compliance, judge it on pushes not used, and book it on the last body before the tool."""
    body = given.cell.end_effector.segments[-1]
    before = float(np.mean(body.compliance[:3]))
    compliance = Parameter("nose.c", "m/N", before, np.inf, lower=0.0, scale=UM_PER_KN, label="tool against nose")
    parameters, block = Parameters.of([compliance]), pushes(given.data)
    fit = solve(parameters, [block], progress=given.progress)
    if given.holdout:
        judged = score_separate(parameters, [block], [pushes(given.holdout)])
    else:
        judged = cross_validate(parameters, [block])
    (found, nominal), changed = judged.mean(), body.compliance.copy()
    changed[:3] = fit.values[0]
    size = np.linalg.norm(block.f, axis=1)
    moved = Curve("pushes", size, np.linalg.norm(block.d, axis=1) / UM)
    return Identification(
        recipe="nose",
        fits={"nose": fit},
        headline=(Figure("holdout_mean_um", "mean error of pushes not used", found / UM, nominal / UM),),
        figures=(),
        changes=(ElementCompliance(body.name, changed),),
        pictures=(Picture("Pushes", "force, N", "displacement, um", (moved,)),),
    )


def propose(_cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Pushes of one size in directions drawn at random."""
    f = np.random.default_rng(settings["seed"]).standard_normal((count, 3))
    f *= settings["force_n"] / np.linalg.norm(f, axis=1, keepdims=True)
    sigma = settings["gauge_m"] / (settings["force_n"] * np.sqrt(count))
    return Proposal(
        "nose", "nose_pushes", dict(zip(("fx_n", "fy_n", "fz_n"), f.T, strict=True)), {"nose.c": sigma},
        units={"nose.c": "m/N"},
    )  # fmt: skip


RECIPE = Recipe(
    "nose",
    "compliance of the tool against the spindle nose, from pushes",
    ("nose_pushes",),
    {"force_n": 200.0, "gauge_m": 1e-6},
    find,
    propose,
)
