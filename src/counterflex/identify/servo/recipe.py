"""Recipe ``servo``: gains of the drives from load steps, lowest mode from ringing, lags from records."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.progress import Progress, share_of
from counterflex.core.units import MS, URAD
from counterflex.identify.data.changes import AxisServo, Change, TableValues
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.model import CellModel
from counterflex.identify.play.data import motions, motor_friction
from counterflex.identify.recipe import Curve, Figure, Identification, Inputs, Picture, Recipe
from counterflex.identify.servo import TITLE
from counterflex.identify.servo.data import FORCE_N, LoadStep, RingingMode, load_steps, lowest_mode, propose
from counterflex.identify.servo.residuals import ServoResiduals, together, with_exchange
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import Folds, HeldOut, cross_validate, row_error, score_separate
from counterflex.identify.solver.jackknife import with_correlation
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.identify.solver.solve import Stop, solve
from counterflex.identify.timing.checks import changes as timing_changes, check_delay, lag_of
from counterflex.identify.timing.delay import Delay, find_delay
from counterflex.identify.timing.pairs import FOLLOWING, pairs
from counterflex.robot.model.description import Servo

GUESS: Final = Servo(1e5, 1.0 / 0.06, 40.0 * MS)
"""Where the cell file has no gains: Kv of 1 m/min for each mm of following error, the customary value of machine tools,
and an integral time of that order. K is scaled to the data, the others are free within a factor of e or more."""
KNOWN: Final = (0.15, 0.1, 0.1)
GUESSED: Final = (2.0, 1.0, 1.0)
"""Prior sigma (log) of K, Kv and Ti with and without gains in the cell file."""
_STOP: Final = Stop(tolerance=1e-9, evaluations=60)
_MOVES: Final = 4.0
"""Standard deviations by which an axis must yield to be fitted."""
_RINGS_S = 0.02


def identify(inputs: Inputs) -> Identification:
    """Find loop gains, the lowest mode, and lags of drives and corrections.

    ``inputs``: Gains, play and friction known before; ``servo_steps`` (see
    :func:`counterflex.identify.servo.data.load_steps`), ``reversals`` with ``tau_motor`` for the friction of the
    motors, ``record`` for lags.

    Returns:
        Fits by axis and pair; ``[[robot.servo]]``, ``[dynamics]`` mode and damping, ``[timing]``.

    Raises:
        FileFormatError: Damaged rows, missing channels or standard deviations.
        InputError: No load step moves any motor, or torque and motion contradict each other.
    """
    cell, data, holdout, settings, progress = inputs
    steps = load_steps([d for d in data if d.kind == "servo_steps"])
    unseen = load_steps([d for d in holdout if d.kind == "servo_steps"], len(steps))
    records = [d for d in data if d.kind == "record"]
    if not steps and not records:
        raise InputError("servo needs load steps or records", value=", ".join(d.kind for d in data))
    results = _Results()
    friction, results.remarks = _friction(cell, [d for d in data if d.kind == "reversals"])
    results.remarks += _not_held_out(holdout)
    if steps:
        of_steps = 1.0 if not records else 0.6  # a record takes about as long as two axes
        _find_gains(results, inputs, steps, unseen, friction, share_of(progress, 0.0, of_steps))
    _take_lags(results, *_lags(cell, records, bool(settings["as_stated"])))
    return results.identification()


def _not_held_out(holdout: Sequence[Dataset]) -> list[str]:
    reason = "only load steps are held out here; a lag is judged on stretches of its own record"
    return [f"{d.name}: {reason}" for d in holdout if d.kind != "servo_steps"]


@dataclass
class _Results:
    """Parts of an identification as they are results."""

    fits: dict[str, Fit] = dataclasses.field(default_factory=dict)
    headline: list[Figure] = dataclasses.field(default_factory=list)
    figures: list[Figure] = dataclasses.field(default_factory=list)
    changes: list[Change] = dataclasses.field(default_factory=list)
    remarks: list[str] = dataclasses.field(default_factory=list)
    pictures: list[Picture] = dataclasses.field(default_factory=list)

    def identification(self) -> Identification:
        return Identification(
            "servo",
            self.fits,
            tuple(self.headline),
            tuple(self.figures),
            tuple(self.changes),
            tuple(self.remarks),
            tuple(self.pictures),
        )


def _take_lags(results: _Results, lags: Sequence[Delay], notes: Sequence[str]) -> None:
    """Take lags and what was found about their records."""
    results.remarks += notes
    results.changes += timing_changes(lags)  # all at once: of several records the one that knows its lag best
    names = [estimate.pair.name for estimate in lags]
    for i, estimate in enumerate(lags):
        results.fits[names[i] if names.count(names[i]) == 1 else f"{names[i]} {i + 1}"] = estimate.fit
        lag_figures, first = _lag_figures(estimate)
        results.figures += lag_figures
        results.headline.append(first)


def _find_gains(
    results: _Results,
    inputs: Inputs,
    steps: Sequence[LoadStep],
    unseen: Sequence[LoadStep],
    friction: Mapping[int, float],
    progress: Progress,
) -> None:
    """Gains of every axis that a load step moves, and the lowest mode."""
    cell, settings = inputs.cell, inputs.settings
    share = float(settings["torque_share"])
    errors: list[HeldOut] = []
    for axis in range(6):
        part = share_of(progress, axis / 6, (axis + 1) / 6, f"axis {axis + 1}")
        block = ServoResiduals(axis, tuple(s.of_axis(axis) for s in steps))
        swing = max(float(np.max(np.abs(r.error))) / float(np.median(r.sigma)) for r in block.releases)
        if swing < _MOVES:
            results.remarks.append(f"axis {axis + 1}: no load step moved its motor; its gains stay as they were")
            continue
        results.remarks += _signs(block, steps[0].where, bool(settings["as_stated"]))
        fit, held_out = _gains(cell, axis, block, unseen, part)
        fit = _with_torque(fit, axis, share)
        results.fits[f"axis {axis + 1}"] = fit
        errors.append(held_out)
        servo = _servo(cell, axis, fit, friction.get(axis))
        results.changes.append(AxisServo(axis, servo))
        results.figures += _figures(cell, axis, fit, servo)
        results.pictures += _pictures(block, fit)[:1]
        part(1.0)
    if not errors:
        raise InputError("no load step moved any motor noticeably", value=f"{len(steps)} steps")
    results.remarks += [
        f"K is a torque over a speed and shares the error of the motors' torque: {100 * share:.3g} % are added to "
        "its standard deviation",
        "Kv and 1/Ti are interchangeable: a load step determines their sum and product, and only the priors "
        "tell which is which. The planner depends on sum and product only: use their intervals",
    ]
    changed, of_mode, missing = _mode(steps)
    results.changes += changed
    results.figures += of_mode
    results.remarks += missing
    results.headline += _headline(errors)


def gain_parameters(cell: CellModel, axis: int, guess_gain: float) -> tuple[Parameters, bool]:
    """K, Kv and Ti of an axis, and whether the cell file has them."""
    known = (cell.robot.servo or (None,) * 6)[axis]
    base = known if known is not None else replace(GUESS, speed_gain_nm_s=guess_gain)
    sigma = KNOWN if known is not None else GUESSED
    name = f"axis{axis + 1}"
    items = (
        Parameter(f"{name}.speed_gain", "N m s/rad", base.speed_gain_nm_s, sigma[0], log=True),
        Parameter(f"{name}.position_gain", "1/s", base.position_gain_per_s, sigma[1], log=True),
        Parameter(f"{name}.integral_time", "s", base.integral_time_s, sigma[2], log=True),
    )
    return Parameters(items), known is not None


def _gains(
    cell: CellModel, axis: int, block: ServoResiduals, unseen: Sequence[LoadStep], progress: Progress
) -> tuple[Fit, HeldOut]:
    unit = block.predict(np.array([1.0, GUESS.position_gain_per_s, GUESS.integral_time_s]))
    measured = np.concatenate([r.error for r in block.releases])
    inverse = float(unit @ measured) / max(float(unit @ unit), 1e-300)
    p, known = gain_parameters(cell, axis, 1.0 / max(inverse, 1e-12))
    fit = with_correlation(solve(p, [block], robust=False, stop=_STOP, progress=share_of(progress, 0.0, 0.2)), [block])
    if unseen:
        other = ServoResiduals(axis, tuple(s.of_axis(axis) for s in unseen))
        held_out = score_separate(p, [block], [other], error=row_error, robust=False, stop=_STOP)
        seen = np.concatenate([r.error for r in other.releases])
    else:
        folds, fold_progress = min(5, len(block.releases)), share_of(progress, 0.2, 1.0)
        held_out = cross_validate(
            p, [block], error=row_error, robust=False, stop=_STOP, folds=Folds(folds), progress=fold_progress
        )
        seen = measured
    if not known:
        held_out = replace(held_out, nominal=np.abs(seen))
    return with_exchange(fit, axis), held_out


def _with_torque(fit: Fit, axis: int, share: float) -> Fit:
    """K is a torque over a speed: the scale of the torque that the drives show is the same in all steps."""
    place = fit.parameters.index(f"axis{axis + 1}.speed_gain")
    sigma = fit.sigma.copy()
    sigma[place] = float(np.hypot(sigma[place], share * fit.values[place]))
    return replace(fit, sigma=sigma)


def _signs(block: ServoResiduals, where: str, as_stated: bool) -> list[str]:
    """Refuse torques whose sign is turned round: the loop would push away from its command."""
    unit = block.predict(np.array([1.0, GUESS.position_gain_per_s, GUESS.integral_time_s]))
    measured = np.concatenate([r.error for r in block.releases])
    match = float(unit @ measured) / max(float(np.linalg.norm(unit) * np.linalg.norm(measured)), 1e-300)
    if match > -0.5:
        return []
    text = (
        f"the motor of axis {block.axis + 1} pushes away from its command (correlation {match:.2f}): "
        "the sign of 'tau_motor' looks turned round, or q_motor and q_command are exchanged"
    )
    if as_stated:
        return [f"{text}; used as stated, as requested"]
    raise InputError(
        text,
        where=where,
        hint="Write signs = [...] under [channels.tau_motor], or exchange the columns. If the data are right, add "
        "--set as_stated=true",
    )


def _servo(cell: CellModel, axis: int, fit: Fit, friction: float | None) -> Servo:
    known = (cell.robot.servo or (None,) * 6)[axis] or GUESS
    name = f"axis{axis + 1}"
    return Servo(
        fit.value(f"{name}.speed_gain"),
        fit.value(f"{name}.position_gain"),
        fit.value(f"{name}.integral_time"),
        known.friction_nm if friction is None else friction,
        known.slip_rad,
    )


def _friction(cell: CellModel, data: Sequence[Dataset]) -> tuple[dict[int, float], list[str]]:
    """Dry friction of the motors, N m, half the loop of their torque less that of the links; and what was not told."""
    records = motions(cell, data)
    out, remarks = {}, []
    for axis in sorted({m.axis for m in records}):
        whole = motor_friction([m for m in records if m.axis == axis])
        play = (cell.robot.play or (None,) * 6)[axis]
        stays = f"axis {axis + 1}: the friction of its motor stays as it was:"
        if whole is None:
            remarks.append(f"{stays} its reversals hold no 'tau_motor' over 'time_s' in both directions")
        elif play is None:
            remarks.append(
                f"{stays} of {whole:.3g} N m in its torque the cell file does not say how much is the link's; "
                "identify play first"
            )
        else:
            out[axis] = max(whole - sum(play.friction_nm), 0.0)
    return out, remarks


def _headline(errors: Sequence[HeldOut]) -> tuple[Figure, ...]:
    identified = np.concatenate([e.identified for e in errors]) / URAD
    nominal = np.concatenate([e.nominal for e in errors]) / URAD
    return (
        Figure(
            "holdout_rms_urad",
            "motor angle predicted for load steps not used, root mean square error over all axes, urad",
            float(np.sqrt(np.mean(identified**2))),
            float(np.sqrt(np.mean(nominal**2))),
        ),
    )


def _figures(cell: CellModel, axis: int, fit: Fit, servo: Servo) -> list[Figure]:
    before = (cell.robot.servo or (None,) * 6)[axis]
    name = f"axis{axis + 1}"
    rows = (
        ("speed_gain", "speed_gain_nm_s", "gain of the speed loop K, N m s/rad", 1.0),
        ("position_gain", "position_gain_per_s", "gain of the position loop Kv, 1/s", 1.0),
        ("integral_time", "integral_time_s", "integral time of the speed loop Ti, ms", MS),
    )
    out = []
    for key, field, text, size in rows:
        value = getattr(servo, field)
        sigma = fit.sigma_of(f"{name}.{key}")
        unit = {"speed_gain": "nm_s", "position_gain": "per_s", "integral_time": "ms"}[key]
        old = None if before is None else getattr(before, field) / size
        out.append(Figure(f"{name}_{key}_{unit}", f"axis {axis + 1}: {text}", value / size, old))
        out.append(Figure(f"{name}_{key}_sigma_{unit}", "its standard deviation", sigma / size))
    both = together(fit, axis)
    for i, (key, text) in enumerate((("sum_per_s", "Kv + 1/Ti, 1/s"), ("product_per_s2", "Kv / Ti, 1/s2"))):
        out.append(Figure(f"{name}_rate_{key}", f"axis {axis + 1}: {text}", float(both.value[i])))
        out.append(
            Figure(f"{name}_rate_{key.replace('_', '_sigma_', 1)}", "its standard deviation", float(both.sigma[i]))
        )
    if servo.friction_nm > 0.0:
        out.append(
            Figure(f"{name}_motor_friction_nm", f"axis {axis + 1}: dry friction of the motor, N m", servo.friction_nm)
        )
    return out


def modes(steps: Sequence[LoadStep]) -> list[RingingMode]:
    """Lowest mode of each load step that rings: of the tool where a tracker saw it, else of the motors."""
    out = []
    for step in steps:
        seen = step.tip if step.tip is not None else step.error
        start = int(np.argmax(step.released)) + round(_RINGS_S / step.step_s)
        every = max(1, round(0.008 / step.step_s))
        try:
            out.append(lowest_mode(seen[start::every], step.step_s * every))
        except CounterflexError:
            continue
    return out


def _mode(steps: Sequence[LoadStep]) -> tuple[list[Change], list[Figure], list[str]]:
    found_modes = modes(steps)
    if len(found_modes) < 2:
        return [], [], ["fewer than two load steps rang clearly, so mode and damping stay as they were"]
    hz, zeta = (np.array([getattr(m, key) for m in found_modes]) for key in ("frequency_hz", "damping"))
    middle, damping = float(np.median(hz)), float(np.clip(np.median(zeta), 1e-3, 1.9))
    spread = [1.2533 * 1.4826 * float(np.median(np.abs(v - np.median(v)))) / np.sqrt(len(v)) for v in (hz, zeta)]
    return (
        [TableValues("dynamics", {"mode_hz": middle, "damping_ratio": damping})],
        [
            Figure("mode_hz", f"lowest mode, median of {len(found_modes)} load steps, Hz", middle),
            Figure("mode_sigma_hz", "its standard deviation, from their scatter, Hz", float(spread[0])),
            Figure("damping_ratio", "its damping ratio", damping),
            Figure("damping_sigma", "its standard deviation, from their scatter", float(spread[1])),
        ],
        [],
    )


def _lags(cell: CellModel, records: Sequence[Dataset], as_stated: bool) -> tuple[list[Delay], list[str]]:
    """Lags of drives and corrections, and remarks. Raises InputError: a record that tells neither."""
    out: list[Delay] = []
    remarks: list[str] = []
    for record in records:
        required = [
            f.name
            for f in FOLLOWING
            if f.name in ("drive", "correction") and record.has(f.answer) and record.has(f.reference[0])
        ]
        if not required:
            raise InputError(
                "the record tells no lag of a drive or a correction",
                where=record.where or record.name,
                value=", ".join(record.channels),
                limit="q_command with q_motor, or d_correction with p_base_tcp or p_tracker_target",
            )
        for pair in pairs(cell, record, ",".join(dict.fromkeys(required))):
            estimate = find_delay(replace(pair, lag=True))
            remarks += check_delay(estimate, as_stated=as_stated)
            out.append(estimate)
    return out, remarks


def _lag_figures(estimate: Delay) -> tuple[list[Figure], Figure]:
    name = estimate.pair.name
    size, unit = (URAD, "urad") if estimate.pair.components[0].endswith("rad") else (1e-6, "um")
    identified, nominal = estimate.held_out.rms()
    out = [Figure(f"{name}_dead_time_ms", f"dead time of the {name}, ms", estimate.value("delay") / MS)]
    if estimate.order != "none":
        lag = lag_of(estimate)
        out.append(Figure(f"{name}_lag_ms", f"lag of the {name}, ms", lag.time_s / MS))
        out.append(Figure(f"{name}_bandwidth_hz", f"bandwidth of the {name} (-3 dB), Hz", lag.bandwidth_hz))
        if name == "drive":
            out.append(
                Figure("drive_following_gain_per_s", "following error is speed over this Kv, 1/s", 1.0 / lag.time_s)
            )
    text = f"{estimate.pair.answer.name} predicted from {estimate.pair.reference.name} on stretches not used, {unit}"
    return out, Figure(f"holdout_{name}_rms_{unit}", text, identified / size, nominal / size)


def _pictures(block: ServoResiduals, fit: Fit) -> list[Picture]:
    largest = max(block.releases, key=lambda r: float(np.max(np.abs(r.error))))
    alone = ServoResiduals(block.axis, (largest,))
    t: Float = np.arange(len(largest.error), dtype=np.float64) * largest.step_s
    return [
        Picture(
            f"Axis {block.axis + 1}: motor after the load was cut",
            "time, s",
            "motor minus command, urad",
            (
                Curve("measured", t, largest.error / URAD),
                Curve("loop found", t, alone.predict(fit.values) / URAD, True),
            ),
        )
    ]


RECIPE: Final = Recipe(
    name="servo",
    title=TITLE,
    kinds=("servo_steps", "reversals", "record"),
    settings={"torque_share": 0.03, "force_n": FORCE_N, "as_stated": False},
    find=identify,
    propose=propose,
)
