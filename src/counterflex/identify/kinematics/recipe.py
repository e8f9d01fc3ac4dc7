"""Recipe ``kinematics``: geometric calibration of the arm from tracker poses, points, distances and planes, mixed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, share_of
from counterflex.core.units import MM
from counterflex.identify.data.changes import AxisPlay, BodyMass, Calibration, Change, ElementCompliance
from counterflex.identify.data.data_checks import check_enough, check_finite
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.manifest_checks import thinned
from counterflex.identify.data.model import CellModel
from counterflex.identify.geometry import known_frames as frames
from counterflex.identify.geometry.arm_geometry import ArmGeometry
from counterflex.identify.geometry.arm_parameters import ArmPriors, sag_as_known, sag_of
from counterflex.identify.geometry.compliances import bearing_of
from counterflex.identify.geometry.considered_sag import with_honest_sigma
from counterflex.identify.geometry.off_rows import off_rows, off_rows_of_unseen, without
from counterflex.identify.geometry.pose_residuals import TrackerResiduals
from counterflex.identify.geometry.tracker_data import ROBOT_M, check_tracker_data, fixes_target, start_frames
from counterflex.identify.kinematics import TITLE
from counterflex.identify.kinematics.approach_sense import CHANNEL, as_play, play_remarks, with_approach
from counterflex.identify.kinematics.file_offsets import file_offsets, refuse
from counterflex.identify.kinematics.held_out import approach_remarks, held_out, region_errors
from counterflex.identify.kinematics.periodic_errors import GAIN, Harmonics, choose_harmonics
from counterflex.identify.kinematics.report import figures, headline, pictures, remarks
from counterflex.identify.kinematics.setup import (
    KINDS,
    POSE_KINDS,
    TARGET,
    TRACKER,
    CalibrationSetup,
    by_channel,
    propose,
    sessions,
    set_up,
    tool_of,
)
from counterflex.identify.kinematics.stages import (
    OPTIONS as PRIORS,
    model_of_data,
    priors_of,
    refitted,
    widened,
    with_lost,
    with_turns,
)
from counterflex.identify.recipe import Identification, Inputs, Recipe
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import HeldOut
from counterflex.identify.solver.solve import solve
from counterflex.robot.elasticity.drive_error import DriveError

SOURCE: Final = "counterflex identify kinematics"
CHECKING, GEOMETRY, SAG, PERIODIC, HELD_OUT, BY_REGION = (
    "checking the data",
    "geometry",
    "sag and play",
    "periodic errors",
    "held out",
    "sessions and regions held out",
)
WORK: Final = {CHECKING: 1.0, GEOMETRY: 2.0, SAG: 0.3, PERIODIC: 4.5, HELD_OUT: 8.0, BY_REGION: 8.5}
"""Parts of the work with what they cost: between those of a published UR10 and of 400 poses of the simulated cell."""
_DONE: Final = dict(zip(WORK, np.cumsum(list(WORK.values())) / sum(WORK.values()), strict=True))
"""Share of the work that is done behind each part."""


def identify(inputs: Inputs) -> Identification:
    """Find the displacements behind the segments, what the sag needs, and periodic errors of the drives.

    ``inputs``: The cell, whose earlier calibrations are where the displacements start; datasets of the kinds
    :data:`counterflex.identify.kinematics.setup.KINDS`, mixed.

    Raises:
        InputError: Unusable data (see :func:`counterflex.identify.geometry.tracker_data.check_tracker_data`) or
            settings.
        FileFormatError: A channel is missing.
    """
    cell, data, holdout, options, progress = inputs
    parts = in_parts(progress, WORK)
    everything = with_approach([*data, *holdout], str(options["play"]))
    data, holdout = everything[: len(data)], everything[len(data) :]
    inputs = inputs._replace(data=data, holdout=holdout)
    known = frames.known_frames(cell) if _option(options, "frames", ("free", "known")) == "known" else None
    notes = _check(cell, everything, as_stated=bool(options["as_stated"]), known=known)
    if frames.known_drive_errors(cell).sag is not None:
        notes += (
            "The [axis_sag] of the cell file is applied to all poses; the identified values are in addition to it.",
        )
    parts[CHECKING](1.0)
    priors = priors_of(options)
    sag = sag_as_known(cell.nominal_chain) if _tries_axes(cell, options) else str(options["sag"])
    make = partial(_setup_of, cell, data, holdout, sag, known)
    setup = make(priors)
    check_enough(setup.parameters, setup.blocks)
    notes += _check_offsets(setup, everything, setup.parameters.nominal, options, least_m=ROBOT_M)
    fit = solve(setup.parameters.with_fixed(setup.local), setup.blocks, progress=parts[GEOMETRY])
    chosen = widened(priors, setup, fit, make, _option(options, "priors", PRIORS))
    priors, setup, fit = chosen.priors, chosen.setup, chosen.fit
    notes += chosen.remarks
    parts[GEOMETRY](1.0)
    notes, kept = _without_off_rows(setup, fit, inputs, notes)
    if kept is not None:
        return _again(kept, notes, share_of(progress, _DONE[GEOMETRY], 1.0))
    folds = int(options["folds"])
    if _tries_axes(cell, options):
        setup, fit, more_notes = with_turns(cell, setup, fit, data, holdout, priors, folds, known)
        notes += more_notes
    fits_play = options["play"] != "off" and any(d.has(CHANNEL) for d in data)
    if fits_play:
        setup, fit, more_notes = with_lost(cell, setup, fit, data, holdout, folds, known)
        notes += more_notes
    parts[SAG](1.0)
    setup, fit, orders, errors, more_notes = _with_periodic(cell, setup, fit, inputs, priors, known, parts[PERIODIC])
    notes += more_notes
    if not options["as_stated"]:  # what the sag or periodic errors had hidden
        notes, kept = _without_off_rows(setup, fit, inputs, notes)
        if kept is not None:
            done = 1.0 - (WORK[HELD_OUT] + WORK[BY_REGION]) / sum(WORK.values())
            return _again(kept, notes, share_of(progress, done, 1.0))
    notes += _check_offsets(setup, everything, fit.values, options)
    if not fits_play:
        notes += approach_remarks(setup, fit, data)
    fit = with_honest_sigma(fit, setup.blocks, float(options["compliance_sigma"]), bearing_of(options))
    parts[PERIODIC](1.0)
    errors = held_out(setup, holdout, folds, fit, parts[HELD_OUT]) if errors is None else errors
    parts[HELD_OUT](1.0)
    by_region, not_by_region = ((), ()) if holdout else region_errors(setup, fit, parts[BY_REGION])
    plays = _plays(setup, fit)
    return Identification(
        recipe="kinematics",
        fits={"kinematics": fit},
        headline=headline(setup, errors, separate=bool(holdout)),
        figures=(*by_region, *figures(setup, fit, orders)),
        changes=_changes(cell, setup, fit, plays),
        remarks=(*notes, *play_remarks(plays), *not_by_region, *remarks(setup, fit, errors, orders)),
        pictures=pictures(setup, fit, errors),
    )


def _setup_of(
    cell: CellModel,
    data: Sequence[Dataset],
    holdout: Sequence[Dataset],
    sag: str,
    known: frames.KnownFrames | None,
    priors: ArmPriors,
) -> CalibrationSetup:
    model = model_of_data(cell, [*data, *holdout], priors, sag, tied=known is not None)
    return set_up(cell, model, data, holdout, known=known)


def _without_off_rows(
    setup: CalibrationSetup, fit: Fit, inputs: Inputs, notes: tuple[str, ...]
) -> tuple[tuple[str, ...], Inputs | None]:
    """Remarks, and the inputs without consecutive rows that are all off; None where nothing is left out."""
    off = [
        *off_rows(setup.parameters.with_fixed(setup.local), setup.blocks, fit, sessions(inputs.data, setup.blocks)),
        *off_rows_of_unseen(setup.unseen, fit, sessions(inputs.holdout, setup.unseen)),
    ]
    as_stated = bool(inputs.settings["as_stated"])
    data, remarks = without([*inputs.data, *inputs.holdout], off, as_stated=as_stated)
    if not off or as_stated:
        return (*remarks, *notes), None
    n = len(inputs.data)
    return remarks, inputs._replace(data=data[:n], holdout=data[n:])


def _again(inputs: Inputs, remarks: tuple[str, ...], progress: Progress) -> Identification:
    """The identification of fewer rows, with what was said about those that were left out."""
    fewer = identify(inputs._replace(progress=progress))
    return replace(fewer, remarks=(*remarks, *fewer.remarks))


def _option(options: Mapping[str, Any], key: str, allowed: Sequence[str]) -> str:
    if options[key] not in allowed:
        raise InputError("unknown setting", where=key, value=options[key], limit=" or ".join(allowed))
    return str(options[key])


def _tries_axes(cell: CellModel, options: Mapping[str, Any]) -> bool:
    """Return whether what own weight turns axes 2 and 3 by is looked for, and kept where held-out poses bear it out."""
    return options["sag"] == "auto" and sag_of(cell.nominal_chain, "auto") == "axes"


def _check(
    cell: CellModel, data: Sequence[Dataset], *, as_stated: bool, known: frames.KnownFrames | None = None
) -> tuple[str, ...]:
    notes: tuple[str, ...] = ()
    parts = _poses_of(data)
    # Poses that do not turn enough need others, of the same target, that do.
    targets = {} if known is None else {"": known.T_tcp_target}
    fixing = [len(part) == 0 or fixes_target(cell, part) for _, part in parts]
    for (tool, part), fixed in sorted(zip(parts, fixing, strict=True), key=lambda item: not item[1]):
        target = None if fixed else targets.get(tool)
        notes = (*notes, *check_tracker_data(cell, part, as_stated=as_stated, partly=True, target=target))
        if fixed and tool not in targets:
            targets[tool] = start_frames(cell, thinned(part)).T_tcp_target
        elif not fixed:
            notes = (*notes, _not_turning(part, tool, target is not None))
    return notes


def _poses_of(data: Sequence[Dataset]) -> list[tuple[str, Dataset]]:
    """Poses of each target with the name of its tool, after a check that the recipe can use all datasets."""
    parts: list[tuple[str, Dataset]] = []
    for d in data:
        if d.kind not in KINDS:
            raise InputError(
                "the kinematics recipe cannot use this dataset", where=d.where or d.name, value=d.kind,
                limit=", ".join(KINDS),
            )  # fmt: skip
        if d.kind in POSE_KINDS:
            parts += [(tool_of(d, number), part) for number, part in by_channel(d, "target")]
        elif d.kind == "fiducials":
            check_finite(d, ["p_base_fiducial", "p_tracker_fiducial"])
        else:
            check_finite(d, ["q", *(["distance"] if d.kind == "distances" else [])])
    if not any(d.kind != "fiducials" for d in data):
        raise InputError("the geometry of the arm needs poses, points, distances or planes", value="only fiducials")
    return parts


def _check_offsets(
    setup: CalibrationSetup, data: Sequence[Dataset], x: Float, options: Mapping[str, Any], *, least_m: float = 0.0
) -> tuple[str, ...]:
    """Name files whose tracker or target stands elsewhere than that of the others."""
    blocks = [b for b in (*setup.blocks, *setup.unseen) if isinstance(b, TrackerResiduals)]
    owners = [d for d in data if d.kind in POSE_KINDS for _ in by_channel(d, "target")]
    fitted = sum(isinstance(b, TrackerResiduals) for b in setup.blocks)
    offsets = file_offsets(blocks, x, fitted=fitted, least_m=least_m)
    # A few tenths of a millimetre on data not used may be the arm's own error where these are: told, not refused.
    reported = [o for o in offsets if o.place >= fitted and least_m == 0.0]
    remarks = tuple(f"{o.sentence()}. If it was moved, {o.remedy()}." for o in reported)
    rest = [o for o in offsets if o not in reported]
    where = [d.where or d.name for d in owners]
    return (*refuse(rest, where, as_stated=bool(options["as_stated"])), *remarks)


def _not_turning(d: Dataset, tool: str, known: bool) -> str:
    whose = f"target '{tool}'" if tool else "target"
    if known:
        return (
            f"{d.name} hardly turns the tool: its {whose} is that of the other data, its tracker was found by itself."
        )
    return (
        f"{d.name} turns the tool about one axis only: the offset of the {whose} along it cannot be separated from "
        f"the position of the tracker and was set to zero."
    )


def _with_periodic(
    cell: CellModel,
    setup: CalibrationSetup,
    fit: Fit,
    inputs: Inputs,
    priors: ArmPriors,
    known: frames.KnownFrames | None,
    progress: Progress,
) -> tuple[CalibrationSetup, Fit, Harmonics, HeldOut | None, tuple[str, ...]]:
    """The fit with periodic errors of the drives that lower the error of held-out poses, else as given."""
    options, holdout = inputs.settings, inputs.holdout
    orders = _harmonics(str(options["periodic"]), setup, fit, priors, share_of(progress, 0.0, 0.7))
    if not orders:
        return setup, fit, {}, None, ()
    model = setup.model
    for axis, k in orders.items():
        model = model.with_periodic(k, [axis], priors.periodic_rad)
    wider = set_up(cell, model, inputs.data, holdout, known=known)
    more = refitted(setup, fit, wider)
    if not (holdout and options["periodic"] == "auto"):
        return wider, more, orders, None, ()
    without = held_out(setup, holdout, int(options["folds"]), fit)
    errors = held_out(wider, holdout, int(options["folds"]), more)
    if errors.mean()[0] > (1.0 - GAIN) * without.mean()[0]:
        return setup, fit, {}, without, (_rejected(orders, errors, without),)
    return wider, more, orders, errors, ()


def _harmonics(requested: str, setup: CalibrationSetup, fit: Fit, priors: ArmPriors, progress: Progress) -> Harmonics:
    if requested == "off":
        return {}
    if requested == "auto":
        return choose_harmonics(setup, fit, priors.periodic_rad, progress)
    try:
        order = int(requested)
    except ValueError as fault:
        raise InputError("unknown setting", where="periodic", value=requested, limit="auto, off or an order") from fault
    return dict.fromkeys(range(6), tuple(range(1, order + 1))) if order > 0 else {}


def _rejected(orders: Harmonics, with_orders: HeldOut, without: HeldOut) -> str:
    count = sum(len(k) for k in orders.values())
    return (
        f"{count} periodic errors of the drives that the folds of the fitted data confirm were not kept: "
        f"the mean error of the held-out data is {with_orders.mean()[0] / MM:.3g} mm with and "
        f"{without.mean()[0] / MM:.3g} mm without."
    )


def _plays(setup: CalibrationSetup, fit: Fit) -> dict[int, AxisPlay | None]:
    """Entries of the cell file for the lost motion of each axis that has some."""
    lay, x, chain = setup.model.layout, fit.values, setup.model.chain
    out = {}
    for axis, place in sorted(lay.lost.items()):
        at = int(chain.torsion[axis])
        soft = x[lay.soft[(at, 5)]] if (at, 5) in lay.soft else chain.compliance[at, 5]
        out[axis] = as_play(chain, axis, float(x[place]), float(soft), _angles(setup))
    return out


def _angles(setup: CalibrationSetup) -> Float:
    return np.concatenate([arm.q for b in setup.blocks if isinstance(arm := getattr(b, "arm", None), ArmGeometry)])


def _changes(
    cell: CellModel, setup: CalibrationSetup, fit: Fit, plays: Mapping[int, AxisPlay | None]
) -> tuple[Change, ...]:
    lay, x = setup.model.layout, fit.values
    out: list[Change] = [
        Calibration(name, d) for name in lay.displaced if (d := lay.displacement_at(name, x)) is not None
    ]
    segments = {s.name: s for s in (*cell.nominal_robot.segments, *cell.nominal_end_effector.segments)}
    names = setup.model.chain.names
    for i, place in lay.mass.items():
        out.append(BodyMass(names[i], float(x[place]), segments[names[i]].p_seg_com))
    for (i, direction), place in lay.soft.items():
        compliance = np.array(setup.model.chain.compliance[i])
        compliance[direction] = x[place]
        out.append(ElementCompliance(names[i], compliance))
    out += [play for play in plays.values() if play is not None]
    if lay.turns is not None:
        out.append(frames.axis_sag_table(frames.known_drive_errors(cell), x[lay.turns], SOURCE))
    if lay.periodic:
        errors = [DriveError(t.axis, t.order, float(x[t.sine]), float(x[t.cosine])) for t in lay.periodic]
        out.append(frames.drive_error_table(frames.known_drive_errors(cell), errors, _angles(setup), SOURCE))
    tracker, target = setup.frames.get(TRACKER), setup.frames.get(TARGET)
    if tracker is not None:
        whole = target is not None and bool(np.all(target.index >= 0))
        T_target, sigma = (target.at(x), fit.sigma[target.index]) if target is not None and whole else (None, None)
        out.append(frames.tracker_table(tracker.at(x), fit.sigma[tracker.index], T_target, sigma, SOURCE))
    return tuple(out)


RECIPE: Final = Recipe(
    name="kinematics",
    title=TITLE,
    kinds=KINDS,
    settings={
        "sag": "auto",
        "periodic": "auto",
        "play": "auto",
        "frames": "free",
        "priors": "evidence",
        "length_sigma_mm": 0.5,
        "angle_sigma_mrad": 0.5,
        "mass_sigma": 0.1,
        "compliance_sigma": 0.1,
        "bearing_mm": 10.0,
        "periodic_sigma_urad": 60.0,
        "sag_sigma_mrad": 1.0,
        "folds": 5,
        "as_stated": False,
        "seed": 0,
    },
    find=identify,
    propose=propose,
)
