"""Recipe ``timing``: dead time, lag and clock of each channel of a record against the one it follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, cast

import numpy as np

from counterflex.core.arrays import Float, as_positive
from counterflex.core.errors import InputError, ReachError
from counterflex.core.progress import in_parts
from counterflex.core.units import DEG, MM, MS, UM, URAD
from counterflex.geometry import pose, rotation
from counterflex.identify.data.model import CellModel
from counterflex.identify.recipe import Curve, Figure, Identification, Inputs, Picture, Proposal, Recipe
from counterflex.identify.solver.holdout import HeldOut, score_separate
from counterflex.identify.timing import TITLE
from counterflex.identify.timing.checks import PPM, changes, check_delay, delay_names, delay_sigmas, delays, lag_of
from counterflex.identify.timing.delay import Delay, Pair, build, find_delay
from counterflex.identify.timing.pairs import pairs
from counterflex.identify.timing.stamped import Stamped
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.kinematics.inverse import Solution, inverse, inverse_path

_ABOVE_M = 150.0 * MM
_AXIS_TURNS = 24


def over_part(cell: CellModel) -> Float:
    """Joint angles with the tool over the part's zero, in the cell's posture.

    Of the turns about the tool the one with the largest distance from singularities within the joint limits. Returns
    (6,) rad. Raises ReachError: no turn about the tool is reachable.
    """
    chain = cell.nominal_chain
    down = cell.T_base_part @ pose.make(rotation.about_x(np.pi), np.array([0.0, 0.0, _ABOVE_M]))
    limits = chain.joint_limits_rad + cell.joint_margin_rad * np.array([1.0, -1.0])
    best: Solution | None = None
    for k in range(_AXIS_TURNS):
        target = down @ pose.make(rotation.about_z(k * 360.0 / _AXIS_TURNS * DEG))
        try:
            solution = inverse(chain, target, cell.branch)
        except ReachError:
            continue
        inside = bool(np.all((solution.q > limits[:, 0]) & (solution.q < limits[:, 1])))
        if inside and (best is None or solution.sigma_min > best.sigma_min):
            best = solution
    if best is None:
        raise ReachError(
            "no pose over the part is reachable in the cell's posture",
            value=cell.branch,
            hint="Move the part, or choose another posture",
        )
    out: Float = best.q
    return out


CYCLE_S: Final = 4.0 * MS
FREQUENCY_HZ: Final = {"program": (0.15, 1.2), "correction": (0.15, 4.0)}
"""A lag of a sensor interface shows by its phase, near its bandwidth; all else is sought where the arm follows."""
SPEED_M_S: Final = 0.05
ACCELERATION_M_S2: Final = 0.3
_MOST_M = 20.0 * MM
_TRACKER_M = 15.0 * UM
_TURNS = (1.0, 1.13, 0.87)


def propose(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """A chirp of the commanded tool tip for a record of ``count`` seconds.

    The amplitude falls with the frequency so that speed and acceleration stay bounded; the three axes have slightly
    different frequencies so that they can be told apart.

    ``count``: Length of the record, s; 5 to 120. ``settings``: ``through``: ``program`` (default) or ``correction``
    (sensor interface); ``seed`` is not used.

    Returns:
        Columns ``time_s``, ``x_m y_m z_m`` (commanded tip in the base), ``q1_rad`` ... ``q6_rad``; expected standard
        deviations of delay and lag of a tracker with 15 um.

    Raises:
        InputError: ``count`` or ``through`` out of range.
        ReachError: The joints do not allow the motion where the part lies.
    """
    if not 5 <= count <= 120:
        raise InputError("length of the record", value=f"{count} s", limit="5 .. 120 s")
    through = str(settings.get("through", "program"))
    if through not in ("program", "correction"):
        raise InputError("through", value=through, limit="program, correction")
    chain = cell.nominal_chain
    q0 = over_part(cell)
    t: Float = CYCLE_S * np.arange(round(count / CYCLE_S) + 1, dtype=np.float64)
    T = forward(chain, q0)
    tip: Float = T[:3, 3] + chirp(t, FREQUENCY_HZ[through])
    q = inverse_path(chain, pose.make(np.broadcast_to(T[:3, :3], (len(t), 3, 3)), tip), q0).q
    columns = {"time_s": t, **{f"{a}_m": tip[:, i] for i, a in enumerate("xyz")}}
    columns |= {f"q{i + 1}_rad": q[:, i] for i in range(6)}
    return Proposal(
        recipe="timing",
        kind="record",
        columns=columns,
        expected=_expected(t, tip),
        remarks=(
            f"{count} s; record command, position reported by the controller, tracker and force over the whole "
            f"time, each with the time stamps of its own clock",
        ),
        settings={"through": through},
        units={"tracker.delay": "s", "tracker.lag": "s"},
    )


def chirp(time_s: Float, band_hz: tuple[float, float]) -> Float:
    """Displacement (n, 3) m: sines of frequency rising through a band, bounded in speed and acceleration."""
    span = as_positive("length of the chirp", float(time_s[-1]))
    low, high = band_hz
    out: Float = np.empty((len(time_s), 3))
    fade = np.clip(np.minimum(time_s, span - time_s) / 1.0, 0.0, 1.0)
    fade = fade * fade * (3.0 - 2.0 * fade)
    for axis, turn in enumerate(_TURNS):
        f = turn * (low + (high - low) * time_s / span)
        phase = 2.0 * np.pi * turn * (low * time_s + 0.5 * (high - low) * time_s**2 / span)
        w = 2.0 * np.pi * f
        size = np.minimum(np.minimum(SPEED_M_S / w, ACCELERATION_M_S2 / w**2), _MOST_M)
        out[:, axis] = fade * size * np.sin(phase)
    return out


def _expected(t: Float, tip: Float) -> dict[str, float]:
    """Standard deviations of a tracker's delay and lag behind the command, white noise."""
    command = Stamped("p_base_command", t, tip, np.full(tip.shape, _TRACKER_M), "controller", (), "")
    answer = Stamped("p_tracker_target", t, tip, np.full(tip.shape, _TRACKER_M), "controller", (), "")
    pair = Pair("tracker", command, answer, tuple("xyz"), ("x m", "y m", "z m"), mixing="matrix")
    parameters, block, start, _ = build(pair, "first", 0.0)
    J = block.jacobian(start).reshape(-1, len(parameters))
    scale = np.linalg.norm(J, axis=0)
    covariance = np.linalg.inv((J / scale).T @ (J / scale)) / np.outer(scale, scale)
    sigma = np.sqrt(np.diag(covariance))
    return {name: float(sigma[parameters.index(name)]) for name in ("tracker.delay", "tracker.lag")}


_ORDERS: Final = ("auto", "none", "first", "second")
_SHOWN = 1500


def identify(inputs: Inputs) -> Identification:
    """Find delays in records; see :mod:`counterflex.identify.timing.delay` for the model.

    ``inputs``: What is known before; datasets of the kind ``record``, held out by stretches. Returns fits by pair,
    changes to ``[timing]``. Raises FileFormatError: damaged stamps or values, no standard deviations. Raises
    InputError: nothing moves, or a unit, a sign or which channel is which looks wrong.
    """
    order = str(inputs.settings["lag"])
    if order not in _ORDERS:
        raise InputError("order of the lag", value=order, limit=", ".join(_ORDERS))
    estimates, remarks = _estimates(inputs, order)
    measured = [d for d, _ in estimates]
    return Identification(
        recipe="timing",
        fits={_name(d, i, estimates): d.fit for i, d in enumerate(measured)},
        headline=tuple(_headline(d, h) for d, h in estimates),
        figures=tuple(f for d in measured for f in _figures(d)),
        changes=tuple(changes(measured)),
        remarks=tuple(dict.fromkeys([*remarks, *(r for d in measured for r in _remarks(d))])),
        pictures=tuple(p for d in measured for p in _pictures(d)),
    )


def _estimates(inputs: Inputs, order: str) -> tuple[list[tuple[Delay, HeldOut]], list[str]]:
    """Delays of all pairs of all records with their errors on unseen stretches, and remarks."""
    cell, data, holdout, settings, progress = inputs
    as_stated = bool(settings["as_stated"])
    estimates: list[tuple[Delay, HeldOut]] = []
    remarks: list[str] = []
    every = [(pair, dataset) for dataset in data for pair in pairs(cell, dataset, str(settings["pairs"]))]
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
    return estimates, remarks


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

    rest = x.copy()
    for key in ("compliance", "dry"):
        rest[estimate.parameters.index(f"{estimate.pair.name}.{key}{label}")] = 0.0
    aligned = (block.measured - block.predict(rest))[:, c] / URAD
    at = block.time_s - x[block.places.delay[c]]
    as_is = rest.copy()
    as_is[block.places.delay[c]] = 0.0
    raw = (block.measured - block.predict(as_is))[:, c] / URAD
    every = slice(None, None, max(1, len(at) // _SHOWN))
    torque = -np.interp(at, grid, block.basis.values[:, torque_place[0]])
    span = np.array([torque.min(), torque.max()])
    soft = estimate.value(f"compliance{label}")
    return Picture(
        f"Axis {label}: link minus motor over torque",
        "torque of the motor on the link side, N m",
        "urad",
        (
            Curve("as recorded", torque[every], raw[every]),
            Curve("delay taken out", torque[every], aligned[every]),
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
