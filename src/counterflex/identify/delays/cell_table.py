"""What a fitted delay says in the cell file's ``[timing]`` table."""

from __future__ import annotations

from collections.abc import Sequence

from counterflex.core.errors import InputError
from counterflex.core.units import MS
from counterflex.identify.data.changes import TableValues
from counterflex.identify.delays.delay import Delay
from counterflex.signals.lag import Lag

PPM = 1e-6


def changes(found: Sequence[Delay]) -> list[TableValues]:
    """What goes into ``[timing]``: of several fits of one pair the one with the smallest standard deviation."""
    best: dict[str, Delay] = {}
    for delay in found:
        name = delay.pair.name
        if name not in best or max(delay_sigmas(delay)) < max(delay_sigmas(best[name])):
            best[name] = delay
    return [TableValues(f"timing.{name}", _table(delay)) for name, delay in best.items()]


def _table(found: Delay) -> dict[str, float | str | bool | list[float] | list[list[float]]]:
    pair = found.pair
    times, sigmas = [d / MS for d in delays(found)], [s / MS for s in delay_sigmas(found)]
    out: dict[str, float | str | bool | list[float] | list[list[float]]] = {"against": pair.reference.name}
    if pair.same_clock:
        out |= {"dead_time_ms": times, "dead_time_sigma_ms": sigmas}
    else:
        out |= {
            "clock_offset_ms": times[0],
            "clock_offset_sigma_ms": sigmas[0],
            "clock_drift_ppm": found.value("drift") / PPM,
            "clock_drift_sigma_ppm": found.sigma("drift") / PPM,
        }
    if found.order != "none":
        out |= {"lag_ms": found.value("lag") / MS, "lag_sigma_ms": found.sigma("lag") / MS}
        out["bandwidth_hz"] = lag_of(found).bandwidth_hz
    if found.order == "second":
        out["lag_damping"] = found.value("damping")
    return out


def lag_of(found: Delay) -> Lag:
    """The fitted lag.

    Raises:
        InputError: None was fitted.
    """
    if found.order == "none":
        raise InputError("no lag was fitted", where=found.pair.name)
    return Lag(found.value("lag"), found.value("damping") if found.order == "second" else None)


def delay_names(found: Delay) -> tuple[str, ...]:
    """Names of the delays among the parameters of the fit."""
    pair = found.pair
    return tuple(f"delay{label}" for label in pair.labels) if pair.each else ("delay",)


def delays(found: Delay) -> list[float]:
    """Delays of a pair, by direction or axis where they were fitted so; s."""
    return [found.value(name) for name in delay_names(found)]


def delay_sigmas(found: Delay) -> list[float]:
    """Their standard deviations; s."""
    return [found.sigma(name) for name in delay_names(found)]
