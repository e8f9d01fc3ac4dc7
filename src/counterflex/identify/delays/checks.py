"""Records that say something else than their manifest: exchanged encoders, wrong units, signs turned round."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MS
from counterflex.identify.delays.delay import Delay

CLEAR: Final = 4.0
"""Standard deviations by which something must be on the wrong side."""
_UNITS: Final = ((1.0 / DEG, "deg stated as rad", "deg"), (DEG, "rad stated as deg", "rad"))
_WITHIN = 0.1


def check_delay(estimate: Delay, *, as_stated: bool = False) -> tuple[str, ...]:
    """Refuse a pair of channels that cannot be what the manifest says.

    ``as_stated``: The user insists: what was found is returned as remarks.

    Returns:
        Remarks; empty where nothing is suspected.

    Raises:
        InputError: A unit, a sign, or which channel is which looks wrong.
    """
    remarks = []
    for what, hint in _suspicions(estimate):
        if not as_stated:
            raise InputError(
                what,
                where=estimate.pair.answer.where,
                hint=f"{hint}. If the data are right, add --set as_stated=true",
            )
        remarks.append(f"{what}; used as stated, as requested")
    return tuple(remarks)


def _suspicions(estimate: Delay) -> Iterator[tuple[str, str]]:
    pair = estimate.pair
    lead, answer = pair.reference.name, pair.answer.name
    if pair.mixing == "own" and pair.derivative == 0:
        gains = np.array([estimate.value(f"gain{label}") for label in pair.labels])
        middle = float(np.median(gains))
        for factor, text, unit in _UNITS:
            if abs(middle / factor - 1.0) < _WITHIN:
                other = lead if factor < 1.0 else answer
                yield (
                    f"'{answer}' moves {middle:.3g} times as far as '{lead}': one of them is in {text}",
                    f'Look at unit under [channels.{other}]; perhaps unit = "{unit}"',
                )
        turned = [label for label, gain in zip(pair.labels, gains, strict=True) if gain < -0.5]
        if turned:
            yield (
                f"'{answer}' moves against '{lead}' on axis {', '.join(turned)}: a sign is turned round",
                f"Write signs = [...] under [channels.{answer}]",
            )
    names = [f"delay{label}" for label in pair.labels] if pair.each else ["delay"]
    early = pair.same_clock and all(
        estimate.value(n) < -CLEAR * estimate.sigma(n) and estimate.value(n) < -0.2 * MS for n in names
    )
    springs = [n for n in estimate.parameters.names if n.startswith(f"{pair.name}.compliance")]
    negative = bool(springs) and _negative(estimate, springs)
    if early and negative:
        yield (
            f"'{answer}' leads '{lead}' by {-estimate.value(names[0]) / MS:.3g} ms and yields against the torque: "
            "the two encoders look exchanged",
            f"Exchange the columns of {lead} and {answer}",
        )
    elif early:
        yield (
            f"'{answer}' leads '{lead}' by {-estimate.value(names[0]) / MS:.3g} ms although it should follow",
            f"Exchange the columns of {lead} and {answer}, or state another clock for one of them",
        )
    elif negative:
        yield (
            "the gears yield against the torque: the sign of 'tau_motor' looks turned round "
            f"(or {lead} and {answer} are exchanged)",
            "Write signs = [...] under [channels.tau_motor]",
        )


def _negative(estimate: Delay, names: list[str]) -> bool:
    """Whether the springs together are negative beyond doubt."""
    values = np.array([estimate.fit.value(n) for n in names])
    sigma = np.array([estimate.fit.sigma_of(n) for n in names])
    weight = 1.0 / np.maximum(sigma, 1e-300) ** 2
    mean = float(np.sum(weight * values) / np.sum(weight))
    return mean < -CLEAR / math.sqrt(float(np.sum(weight)))
