"""Records that say something else than their manifest: exchanged encoders, wrong units, signs turned round."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MS
from counterflex.identify.data.changes import TableValues
from counterflex.identify.timing.delay import Delay
from counterflex.signals.lag import Lag

PPM = 1e-6


def changes(estimates: Sequence[Delay]) -> list[TableValues]:
    """Values of ``[timing]``: of several fits of one pair the one with the smallest standard deviation."""
    best: dict[str, Delay] = {}
    for delay in estimates:
        name = delay.pair.name
        if name not in best or max(delay_sigmas(delay)) < max(delay_sigmas(best[name])):
            best[name] = delay
    return [TableValues(f"timing.{name}", _table(delay)) for name, delay in best.items()]


def _table(estimate: Delay) -> dict[str, float | str | bool | list[float] | list[list[float]]]:
    pair = estimate.pair
    times, sigmas = [d / MS for d in delays(estimate)], [s / MS for s in delay_sigmas(estimate)]
    out: dict[str, float | str | bool | list[float] | list[list[float]]] = {"against": pair.reference.name}
    if pair.same_clock:
        out |= {"dead_time_ms": times, "dead_time_sigma_ms": sigmas}
    else:
        out |= {
            "clock_offset_ms": times[0],
            "clock_offset_sigma_ms": sigmas[0],
            "clock_drift_ppm": estimate.value("drift") / PPM,
            "clock_drift_sigma_ppm": estimate.sigma("drift") / PPM,
        }
    if estimate.order != "none":
        out |= {"lag_ms": estimate.value("lag") / MS, "lag_sigma_ms": estimate.sigma("lag") / MS}
        out["bandwidth_hz"] = lag_of(estimate).bandwidth_hz
    if estimate.order == "second":
        out["lag_damping"] = estimate.value("damping")
    return out


def lag_of(estimate: Delay) -> Lag:
    """The fitted lag. Raises InputError: none was fitted."""
    if estimate.order == "none":
        raise InputError("no lag was fitted", where=estimate.pair.name)
    return Lag(estimate.value("lag"), estimate.value("damping") if estimate.order == "second" else None)


def delay_names(estimate: Delay) -> tuple[str, ...]:
    """Names of the delays among the parameters of the fit."""
    pair = estimate.pair
    return tuple(f"delay{label}" for label in pair.labels) if pair.each else ("delay",)


def delays(estimate: Delay) -> list[float]:
    """Delays of a pair, by direction or axis where they were fitted so; s."""
    return [estimate.value(name) for name in delay_names(estimate)]


def delay_sigmas(estimate: Delay) -> list[float]:
    """Their standard deviations; s."""
    return [estimate.sigma(name) for name in delay_names(estimate)]


CLEAR: Final = 4.0
"""Standard deviations by which something must be on the wrong side."""
_UNITS: Final = ((1.0 / DEG, "deg stated as rad", "deg"), (DEG, "rad stated as deg", "rad"))
_WITHIN = 0.1


def check_delay(estimate: Delay, *, as_stated: bool = False) -> tuple[str, ...]:
    """Refuse a pair of channels that cannot be what the manifest says.

    ``as_stated``: The user insists: what was found is returned as remarks. Returns remarks; empty where nothing is
    suspected. Raises InputError: a unit, a sign, or which channel is which looks wrong.
    """
    remarks = []
    for what, hint in _suspicions(estimate):
        if not as_stated:
            raise InputError(
                what, where=estimate.pair.answer.where, hint=f"{hint}. If the data are right, add --set as_stated=true"
            )
        remarks.append(f"{what}; used as stated, as requested")
    return tuple(remarks)


def _suspicions(estimate: Delay) -> Iterator[tuple[str, str]]:
    if estimate.pair.mixing == "own" and estimate.pair.derivative == 0:
        yield from _of_gains(estimate)
    yield from _of_order(estimate)


def _of_gains(estimate: Delay) -> Iterator[tuple[str, str]]:
    """Units and signs: a channel that follows another one moves as far, and the same way."""
    pair = estimate.pair
    lead, answer = pair.reference.name, pair.answer.name
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


def _of_order(estimate: Delay) -> Iterator[tuple[str, str]]:
    """Exchanged channels: the answer comes later, and gears yield with the torque."""
    pair = estimate.pair
    lead, answer = pair.reference.name, pair.answer.name
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
    """Return whether the springs together are negative beyond doubt."""
    values = np.array([estimate.fit.value(n) for n in names])
    sigma = np.array([estimate.fit.sigma_of(n) for n in names])
    weight = 1.0 / np.maximum(sigma, 1e-300) ** 2
    mean = float(np.sum(weight * values) / np.sum(weight))
    return mean < -CLEAR / math.sqrt(float(np.sum(weight)))
