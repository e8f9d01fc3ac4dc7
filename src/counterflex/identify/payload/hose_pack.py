"""Which functions of which rotation stand for the hose pack: chosen by the error on orientations not used.

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
from counterflex.core.progress import Progress, in_parts, saying
from counterflex.identify.payload.holdout import held_out_forces
from counterflex.identify.payload.parameters import Effects, Knowledge, parameters
from counterflex.identify.payload.residuals import SensorReadings
from counterflex.identify.solver.holdout import HeldOut
from counterflex.sensing.flange_sensor import FlangeSensor
from counterflex.sensing.orientation_basis import COUNTS

GAIN: Final = 0.95
"""A rest is kept where it lowers the held-out error below this share of that of a simpler one."""
ROWS_PER_FUNCTION: Final = 2
"""Readings for each function of the rest, below which a degree is not tried: fewer are met exactly and say nothing."""
MOST_COST: Final = 20.0
"""How many times larger a rest may make the standard deviation of the mass. A rest of degree 1 in the base holds the
weight itself, so that only priors tell the two apart; where weight leaves only noise, it is not worth that."""
BASE: Final = "base"
_DEGREES: Final = {"auto": (1, 2), "none": (), "0": (), "1": (1,), "2": (2,)}
_ARM: Final = slice(2, 4)
"""Of the bodies that axes drive, those that hose packs come from: forearm, before and behind axis 4."""


@dataclass(frozen=True, eq=False)
class Rest:
    """What was chosen.

    Attributes:
        degree: Of the functions, 0 is none.
        hose_from: Body in which the sensor's rotation is taken; empty is the base.
        candidates: Held-out forces by body (``base`` for the base) and degree, where that was tried.
        dear: Those that would have helped and were not taken, with the factor of the mass' standard deviation.
    """

    degree: int = 0
    hose_from: str = ""
    candidates: Mapping[tuple[str, int], HeldOut] = field(default_factory=dict)
    dear: Mapping[tuple[str, int], float] = field(default_factory=dict)

    @property
    def key(self) -> tuple[str, int]:
        """Place of the chosen one in ``tried``."""
        return (self.hose_from if self.degree and self.hose_from else BASE, self.degree)


def degrees_of(settings: Mapping[str, Any]) -> tuple[int, ...]:
    """Degrees that the setting ``hose`` allows.

    Raises:
        InputError: An unknown value.
    """
    hose = str(settings.get("hose", "auto"))
    if hose not in _DEGREES:
        raise InputError("setting hose", value=hose, limit="auto, none, 1 or 2")
    return _DEGREES[hose]


def frames_of(settings: Mapping[str, Any], bodies: Sequence[str], *, with_joints: bool) -> tuple[str, ...]:
    """Bodies that the setting ``hose_from`` allows, ``""`` for the base.

    ``with_joints``: The data say where the axes stand; without, only the base can be tried.

    Raises:
        InputError: A body that no hose pack can come from.
    """
    setting = str(settings.get("hose_from", "auto"))
    if setting == "auto":
        return ("", *bodies[_ARM]) if with_joints else ("",)
    if setting != BASE and setting not in bodies:
        raise InputError("setting hose_from", value=setting, limit=", ".join(("auto", BASE, *bodies)))
    return ("",) if setting == BASE else (setting,)


def trials_of(
    blocks: Sequence[SensorReadings], degrees: Sequence[int], frames: Sequence[str], *, forced: bool
) -> dict[str, float]:
    """What :func:`choose_rest` tries on these readings, by name, with what it costs against a fit without a rest.

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
    blocks_in: Callable[[str], Sequence[SensorReadings]],
    sensor: FlangeSensor,
    known: Knowledge,
    effects: Effects,
    degrees: Sequence[int],
    frames: Sequence[str],
    progress: Progress,
    *,
    forced: bool,
) -> Rest:
    """Degree and body of the rest with the least error on orientations not used.

    ``forced``: A rest is wanted whether it helps or not: only the body is chosen.
    """
    if not degrees or (forced and len(degrees) == len(frames) == 1):
        return Rest(*((degrees[0], frames[0]) if degrees else (0, "")))
    blocks = blocks_in("")
    parts = in_parts(progress, trials_of(blocks, degrees, frames, forced=forced))
    candidates: dict[tuple[str, int], HeldOut] = {}
    dear: dict[tuple[str, int], float] = {}
    best = Rest()
    if not forced:
        plain = saying(parts[_trial(0)], _trial(0))
        candidates[BASE, 0] = held_out_forces(parameters(sensor, known, replace(effects, degree=0)), blocks, plain)
    for degree in degrees:
        if _trial(degree, frames[0]) not in parts:
            break
        chosen = parameters(sensor, known, replace(effects, degree=degree))
        for body in frames:
            name = _trial(degree, body)
            candidates[body or BASE, degree] = held_out_forces(chosen, blocks_in(body), saying(parts[name], name))
        error = {body: float(candidates[body or BASE, degree].mean()[0]) for body in frames}
        for body in sorted(frames, key=lambda b: error[b]):
            if best.key in candidates and error[body] >= GAIN * candidates[best.key].mean()[0]:
                break
            cost = 0.0 if forced else _mass_sigma(candidates[body or BASE, degree]) / _mass_sigma(candidates[BASE, 0])
            if cost > MOST_COST:
                dear[body or BASE, degree] = cost
                continue
            best = Rest(degree, body)
            break
    return replace(best, candidates=candidates, dear=dear)


def _mass_sigma(held_out: HeldOut) -> float:
    return float(np.median([fit.sigma_of("mass") for fit in held_out.fits]))
