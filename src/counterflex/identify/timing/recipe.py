"""Recipe ``timing``: dead time, lag and clock of each channel of a record against the one it follows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, cast

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import in_parts
from counterflex.core.units import MS, UM, URAD
from counterflex.identify.delays.cell_table import PPM, changes, delay_names, delay_sigmas, delays, lag_of
from counterflex.identify.delays.checks import check_delay
from counterflex.identify.delays.delay import Delay, Pair, build, find_delay
from counterflex.identify.delays.pairs import pairs
from counterflex.identify.recipe import Curve, Figure, Identification, Inputs, Picture, Recipe
from counterflex.identify.solver.holdout import HeldOut, score_separate
from counterflex.identify.timing import TITLE
from counterflex.identify.timing.proposal import propose

_ORDERS: Final = ("auto", "none", "first", "second")
_SHOWN = 1500


def identify(inputs: Inputs) -> Identification:
    """Find delays in records; see :mod:`counterflex.identify.delays.delay` for the model.

    Args:
        inputs: What is known before; datasets of the kind ``record``, held out by stretches.

    Returns:
        Fits by pair, changes to ``[timing]``.

    Raises:
        FileFormatError: Damaged stamps or values, no standard deviations.
        InputError: Nothing moves, or a unit, a sign or which channel is which looks wrong.
    """
    cell, data, holdout, settings, progress = inputs
    order = str(settings["lag"])
    if order not in _ORDERS:
        raise InputError("order of the lag", value=order, limit=", ".join(_ORDERS))
    requested = str(settings["pairs"])
    as_stated = bool(settings["as_stated"])
    estimates: list[tuple[Delay, HeldOut]] = []
    remarks: list[str] = []
    every = [(pair, dataset) for dataset in data for pair in pairs(cell, dataset, requested)]
    names = [f"{pair.name} of {dataset.name}" for pair, dataset in every]
    work = {f"{i + 1}: {name}": float(len(every[i][1])) for i, name in enumerate(names)}
    parts = list(in_parts(progress, work).values()) if work else []
    for pair_progress, name, (pair, _) in zip(parts, names, every, strict=True):
        remarks += [*pair.reference.remarks, *pair.answer.remarks]
        delay = find_delay(pair, cast(Any, order))
        remarks += check_delay(delay, as_stated=as_stated)
        unseen = [p for other in holdout for p in pairs(cell, other, pair.name)] if holdout else []
        estimates.append((delay, _separate(delay, unseen) if unseen else delay.held_out))
        pair_progress(1.0, name)
    return Identification(
        recipe="timing",
        fits={_name(d, i, estimates): d.fit for i, (d, _) in enumerate(estimates)},
        headline=tuple(_headline(d, h) for d, h in estimates),
        figures=tuple(f for d, _ in estimates for f in _figures(d)),
        changes=tuple(changes([d for d, _ in estimates])),
        remarks=tuple(dict.fromkeys([*remarks, *(r for d, _ in estimates for r in _remarks(d))])),
        pictures=tuple(p for d, _ in estimates for p in _pictures(d)),
    )


def _separate(estimate: Delay, unseen: Sequence[Pair]) -> HeldOut:
    parameters, block, start, needed = build(estimate.pair, estimate.order, float(np.mean(delays(estimate))))
    blocks = []
    for pair in unseen:
        others, other, _, _ = build(pair, estimate.order, float(np.mean(delays(estimate))))
        if others.names != parameters.names:
            raise InputError(
                "the record held out has other axes or directions in motion", where=pair.answer.where, value=pair.name
            )
        blocks.append(other)
    local = [name for name in needed if ".offset" in name]
    return score_separate(parameters, [block], blocks, needed=needed, local=local, start=start)


def _unit(estimate: Delay) -> tuple[str, float]:
    unit = estimate.pair.components[0].rsplit(" ", 1)[1]
    return {"rad": ("urad", URAD), "m": ("um", UM), "N": ("N", 1.0)}[unit]


def _name(estimate: Delay, place: int, estimates: Sequence[tuple[Delay, HeldOut]]) -> str:
    name = estimate.pair.name
    return name if sum(d.pair.name == name for d, _ in estimates) == 1 else f"{name} {place + 1}"


def _headline(estimate: Delay, held_out: HeldOut) -> Figure:
    unit, size = _unit(estimate)
    identified, nominal = held_out.rms()
    before = "the delay known before" if estimate.pair.same_clock else "the peak of the cross-correlation"
    return Figure(
        f"holdout_{estimate.pair.name}_rms_{unit.lower()}",
        f"{estimate.pair.answer.name} predicted from {estimate.pair.reference.name}, root mean square error on "
        f"stretches not used; nominal with {before}, {unit}",
        identified / size,
        nominal / size,
    )


def _figures(estimate: Delay) -> list[Figure]:
    name, pair = estimate.pair.name, estimate.pair
    out = []
    word = "dead time" if pair.same_clock else "dead time and offset of the clock together"
    for key, value, sigma in zip(delay_names(estimate), delays(estimate), delay_sigmas(estimate), strict=True):
        tail = key.removeprefix("delay")
        axis = f", axis {tail}" if tail else ""
        out.append(Figure(f"{name}_delay{tail}_ms", f"{word} of {pair.answer.name}{axis}, ms", value / MS))
        out.append(Figure(f"{name}_delay{tail}_sigma_ms", "its standard deviation, ms", sigma / MS))
    if not pair.same_clock:
        out.append(Figure(f"{name}_drift_ppm", "drift of the clock, 1e-6", estimate.value("drift") / PPM))
        out.append(Figure(f"{name}_drift_sigma_ppm", "its standard deviation, 1e-6", estimate.sigma("drift") / PPM))
    if estimate.order != "none":
        out.append(
            Figure(
                f"{name}_lag_ms", f"time constant of the lag ({estimate.order} order), ms", estimate.value("lag") / MS
            )
        )
        out.append(Figure(f"{name}_lag_sigma_ms", "its standard deviation, ms", estimate.sigma("lag") / MS))
        out.append(Figure(f"{name}_bandwidth_hz", "bandwidth (-3 dB) of the lag, Hz", lag_of(estimate).bandwidth_hz))
    for parameter in estimate.parameters.names if name == "link_encoder" else ():
        key = parameter.removeprefix(f"{name}.")
        if key.startswith("compliance"):
            value, sigma = estimate.value(key), estimate.sigma(key)
            out.append(
                Figure(
                    f"{name}_{key}_urad_per_knm",
                    f"torsion of the gear of axis {key[-1]} under the motor's torque, delay taken out, urad/(kN m)",
                    value * 1e9,
                )
            )
            out.append(Figure(f"{name}_{key}_sigma_urad_per_knm", "its standard deviation, urad/(kN m)", sigma * 1e9))
        elif key.startswith("dry"):
            out.append(
                Figure(
                    f"{name}_{key}_urad",
                    f"part of axis {key[-1]} that turns round with the direction of motion, urad, half its width",
                    estimate.value(key) / URAD,
                )
            )
            out.append(Figure(f"{name}_{key}_sigma_urad", "its standard deviation, urad", estimate.sigma(key) / URAD))
    return out


def _remarks(estimate: Delay) -> list[str]:
    pair, out = estimate.pair, list(estimate.fit.hidden)
    if not pair.same_clock:
        out.append(
            f"{pair.answer.name} and {pair.reference.name} carry stamps of two clocks: the difference of the clocks "
            "and the dead time of the channel are found as one sum, which is what bringing them together needs"
        )
    if any("compliance" in n for n in estimate.parameters.names):
        out.append(
            "link_encoder: what rises with the speed is a delay between the encoders, not torsion: viscous friction of "
            "the gears, had it all passed through the torsion, would be within the delay; dry friction at the motors "
            "is not part of what the gears pass on and makes the part that turns round with the motion smaller"
        )
    return out


def _pictures(estimate: Delay) -> list[Picture]:
    unit, size = _unit(estimate)
    block, x = estimate.block, estimate.fit.values
    c = int(np.argmax(np.std(block.measured, axis=0)))
    n = min(_SHOWN, len(block.time_s))
    window = slice(0, n)
    t = block.time_s[window] - block.time_s[0]
    late = x.copy()
    for place in set(block.places.delay):
        late[place] = estimate.pair.delay_s if estimate.pair.same_clock else x[place]
    before = (block.measured - block.predict(late))[window, c] / size
    after = (block.measured - block.predict(x))[window, c] / size
    label = f"{estimate.pair.answer.name} {estimate.pair.labels[c]}"
    first = "with the delay known before" if estimate.pair.same_clock else "fitted"
    curves = [Curve(first, t, before, True)] if estimate.pair.same_clock else []
    out = [
        Picture(
            f"{label}: measured minus predicted",
            "time, s",
            unit,
            (*curves, Curve("with the delay found", t, after, True)),
        )
    ]
    loops = [n for n in estimate.parameters.names if ".compliance" in n]
    if loops:
        out += [_loop(estimate, c, label) for c, label in enumerate(estimate.pair.labels)]
    return out


def _loop(estimate: Delay, c: int, label: str) -> Picture:
    """Torsion over torque of one axis, as recorded and with the delay taken out."""
    block, x = estimate.block, estimate.fit.values
    torque_place = [
        b for b, i in enumerate(block.places.gain[c]) if i >= 0 and ".compliance" in estimate.parameters.names[i]
    ]
    grid = block.basis.start_s + block.basis.step_s * np.arange(len(block.basis.values))

    def torque(at: Float) -> Float:
        out: Float = -np.interp(at, grid, block.basis.values[:, torque_place[0]])
        return out

    rest = x.copy()
    for key in ("compliance", "dry"):
        rest[estimate.parameters.index(f"{estimate.pair.name}.{key}{label}")] = 0.0
    aligned = (block.measured - block.predict(rest))[:, c] / URAD
    at = block.time_s - x[block.places.delay[c]]
    as_is = rest.copy()
    as_is[block.places.delay[c]] = 0.0
    raw = (block.measured - block.predict(as_is))[:, c] / URAD
    every = slice(None, None, max(1, len(at) // _SHOWN))
    span = np.array([torque(at).min(), torque(at).max()])
    soft = estimate.value(f"compliance{label}")
    return Picture(
        f"Axis {label}: link minus motor over torque",
        "torque of the motor on the link side, N m",
        "urad",
        (
            Curve("as recorded", torque(at)[every], raw[every]),
            Curve("delay taken out", torque(at)[every], aligned[every]),
            Curve("torsion found", span, -soft * span / URAD, True),
        ),
        note="What opens the loop as recorded is the delay between the encoders.",
    )


RECIPE: Final = Recipe(
    name="timing",
    title=TITLE,
    kinds=("record",),
    settings={"pairs": "auto", "lag": "auto", "through": "program", "as_stated": False},
    find=identify,
    propose=propose,
)
