"""What a fitted delay says in the cell file's ``[timing]`` table."""

from __future__ import annotations

from collections.abc import Sequence

from counterflex.core.errors import InputError
from counterflex.core.units import MS
from counterflex.identify.data.changes import TableValues
from counterflex.identify.delays.delay import Delay
from counterflex.signals.lag import Lag

PPM = 1e-6


def changes(estimates: Sequence[Delay]) -> list[TableValues]:
    """What goes into ``[timing]``: of several fits of one pair the one with the smallest standard deviation."""
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
    """The fitted lag.

    Raises:
        InputError: None was fitted.
    """
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
