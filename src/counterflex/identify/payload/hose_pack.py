"""Choose functions and rotation that model the hose pack, by the error on orientations not used.

A hose between two bodies acts on the outer one by how the two stand to each other; its weight, which acts by how they
stand in the hall, is part of the weight. So beside functions of the sensor's rotation in the base, which take any rest
that goes by gravity, functions of its rotation in a body of the arm are tried.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, saying, silent
from counterflex.identify.payload import residuals
from counterflex.identify.solver.holdout import HeldOut, cross_validate, score_separate
from counterflex.identify.solver.parameters import Parameters
from counterflex.identify.solver.solve import solve
from counterflex.sensing.flange_sensor import COUNTS, FlangeSensor


def held_out_forces(
    chosen: Parameters, blocks: Sequence[residuals.SensorReadings], progress: Progress = silent
) -> HeldOut:
    """Force errors by folds; the nominal ones with the zero found on the training part."""
    return cross_validate(chosen, blocks, needed=residuals.needed(), error=residuals.force_error, progress=progress)


def forces_of(
    rest: HoseTerms,
    chosen: Parameters,
    blocks: Sequence[residuals.SensorReadings],
    unseen: Sequence[residuals.SensorReadings],
    progress: Progress,
) -> HeldOut:
    """Force errors of a separate file, else of the folds, which the choice of the rest may have computed already."""
    if unseen:
        return score_separate(
            chosen, blocks, unseen, needed=residuals.needed(), error=residuals.force_error, progress=progress
        )
    return rest.candidates[rest.key] if rest.key in rest.candidates else held_out_forces(chosen, blocks)


def held_out_moments(
    force: HeldOut,
    chosen: Parameters,
    blocks: Sequence[residuals.SensorReadings],
    unseen: Sequence[residuals.SensorReadings],
    progress: Progress = silent,
) -> HeldOut:
    """Moment errors of the same rows by the same fits.

    ``unseen``: Readings of a separate file, or empty for folds of ``blocks``.
    """
    zero_only = chosen.with_fixed([name for name in chosen.names if name not in residuals.needed()])
    nominal, identified = np.empty(len(force.row)), np.empty(len(force.row))
    for fold, fit in enumerate(force.fits):
        mine = [(force.block == i) & (force.fold == fold) for i in range(len(unseen or blocks))]
        training = list(blocks)
        if not unseen:
            training = [
                b.subset(~np.isin(np.arange(len(b.group)), force.row[m])) for b, m in zip(blocks, mine, strict=True)
            ]
        before = solve(zero_only, training).values
        for block, m in zip(unseen or blocks, mine, strict=True):
            if np.any(m):
                rows = block.subset(np.isin(np.arange(len(block.group)), force.row[m]))
                identified[m], nominal[m] = (
                    residuals.moment_error(rows, fit.values),
                    residuals.moment_error(rows, before),
                )
        progress((fold + 1) / len(force.fits))
    return replace(force, nominal=nominal, identified=identified)


GAIN: Final = 0.95
"""A rest is kept where it lowers the held-out error below this share of that of a simpler one."""
ROWS_PER_FUNCTION: Final = 2
"""Readings for each function of the rest, below which a degree is not tried: fewer are met exactly and say nothing."""
MOST_COST: Final = 20.0
"""How many times larger a rest may make the standard deviation of the mass. A rest of degree 1 in the base holds the
weight itself, so that only priors tell the two apart; where weight leaves only noise, it is not worth that."""
BASE: Final = "base"
_DEGREES: Final = {"auto": (1, 2), "none": (), "0": (), "once": (1,), "1": (1,), "2": (2,)}
_ARM: Final = slice(2, 4)
"""Of the bodies that axes drive, those that hose packs come from: forearm, before and behind axis 4."""


@dataclass(frozen=True, eq=False)
class HoseTerms:
    """Chosen model of the rest."""

    degree: int = 0  # of the functions, 0 is none
    hose_from: str = ""  # body in which the sensor's rotation is taken; empty is the base
    # held-out forces by body (`base` for the base) and degree, where that was tried
    candidates: Mapping[tuple[str, int], HeldOut] = field(default_factory=dict)
    # those that would have helped and were not taken, with the factor of the mass' standard deviation
    dear: Mapping[tuple[str, int], float] = field(default_factory=dict)

    @property
    def key(self) -> tuple[str, int]:
        """Place of the chosen one in ``tried``."""
        return (self.hose_from if self.degree and self.hose_from else BASE, self.degree)


def degrees_of(settings: Mapping[str, Any], count: int) -> tuple[int, ...]:
    """Degrees that the setting ``hose`` allows with a number of orientations. Raises InputError: an unknown value."""
    hose = str(settings.get("hose", "auto"))
    if hose not in _DEGREES:
        raise InputError("setting hose", value=hose, limit="auto, none, once, 1 or 2")
    return () if hose == "once" and count < ROWS_PER_FUNCTION * COUNTS[1] else _DEGREES[hose]


def frames_of(settings: Mapping[str, Any], bodies: Sequence[str], *, with_joints: bool) -> tuple[str, ...]:
    """Bodies that the setting ``hose_from`` allows, ``""`` for the base.

    ``with_joints``: The data say where the axes stand; without, only the base can be tried. Raises InputError: a body
    that no hose pack can come from.
    """
    setting = BASE if settings.get("hose") == "once" else str(settings.get("hose_from", "auto"))
    if setting == "auto":
        return ("", *bodies[_ARM]) if with_joints else ("",)
    if setting != BASE and setting not in bodies:
        raise InputError("setting hose_from", value=setting, limit=", ".join(("auto", BASE, *bodies)))
    return ("",) if setting == BASE else (setting,)


def trials_of(
    blocks: Sequence[residuals.SensorReadings], degrees: Sequence[int], frames: Sequence[str], *, forced: bool
) -> dict[str, float]:
    """Trials of :func:`choose_rest` on these readings, by name, with their cost relative to a fit without a rest.

    ``forced``: A rest is wanted whether it helps or not.
    """
    rows = len(np.unique(np.concatenate([b.group for b in blocks])))
    trials = {} if forced else {_trial(0): _cost(0)}
    for degree in degrees:
        if not forced and rows < ROWS_PER_FUNCTION * COUNTS[degree]:
            break
        trials |= {_trial(degree, body): _cost(degree) for body in frames}
    return trials or {_trial(0): _cost(0)}


def _trial(degree: int, body: str = "") -> str:
    return f"hose pack from {body or BASE}, degree {degree}" if degree else "without hose pack"


def _cost(degree: int) -> float:
    """Of a trial against one without a rest: with 0, 9, 34 functions 1, 3.7 and 30 (150 readings)."""
    return 1.0 + (COUNTS[degree] / 6.0) ** 2


def choose_rest(
    blocks_in: Callable[[str], Sequence[residuals.SensorReadings]],
    sensor: FlangeSensor,
    known: residuals.Knowledge,
    effects: residuals.SensorEffects,
    degrees: Sequence[int],
    frames: Sequence[str],
    progress: Progress,
    *,
    forced: bool,
) -> HoseTerms:
    """Degree and body of the rest with the least error on orientations not used.

    ``forced``: A rest is wanted whether it helps or not: only the body is chosen.
    """
    if not degrees or (forced and len(degrees) == len(frames) == 1):
        return HoseTerms(*((degrees[0], frames[0]) if degrees else (0, "")))
    blocks = blocks_in("")
    parts = in_parts(progress, trials_of(blocks, degrees, frames, forced=forced))
    candidates: dict[tuple[str, int], HeldOut] = {}
    dear: dict[tuple[str, int], float] = {}
    best = HoseTerms()
    if not forced:
        plain = saying(parts[_trial(0)], _trial(0))
        candidates[BASE, 0] = held_out_forces(
            residuals.parameters(sensor, known, replace(effects, degree=0)), blocks, plain
        )
    for degree in degrees:
        if _trial(degree, frames[0]) not in parts:
            break
        chosen = residuals.parameters(sensor, known, replace(effects, degree=degree))
        for body in frames:
            name = _trial(degree, body)
            candidates[body or BASE, degree] = held_out_forces(chosen, blocks_in(body), saying(parts[name], name))
        best, refused = _better_of(candidates, best, degree, frames, forced=forced)
        dear |= refused
    return replace(best, candidates=candidates, dear=dear)


def _better_of(
    candidates: Mapping[tuple[str, int], HeldOut], best: HoseTerms, degree: int, frames: Sequence[str], *, forced: bool
) -> tuple[HoseTerms, dict[tuple[str, int], float]]:
    """The best rest with those of one degree added, and those refused because the mass would be uncertain."""
    dear: dict[tuple[str, int], float] = {}
    error = {body: float(candidates[body or BASE, degree].mean()[0]) for body in frames}
    for body in sorted(frames, key=lambda b: error[b]):
        # Sorted by error: where the best body gains too little, no other gains more.
        if best.key in candidates and error[body] >= GAIN * candidates[best.key].mean()[0]:
            break
        cost = 0.0 if forced else _mass_sigma(candidates[body or BASE, degree]) / _mass_sigma(candidates[BASE, 0])
        if not cost > MOST_COST:
            return HoseTerms(degree, body), dear
        dear[body or BASE, degree] = cost
    return best, dear


def _mass_sigma(held_out: HeldOut) -> float:
    return float(np.median([fit.sigma_of("mass") for fit in held_out.fits]))
