"""Recipe ``kinematics``: geometric calibration of the arm from tracker poses, points, distances and planes, mixed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, cast

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.progress import Progress
from counterflex.core.units import MM, MRAD, URAD
from counterflex.identify.arm_geometry import ArmGeometry
from counterflex.identify.arm_parameters import ArmModel, ArmPriors, arm_model, sag_as_known, sag_of
from counterflex.identify.changes import BodyMass, Calibration, Change, ElementCompliance
from counterflex.identify.compliances import bearing_of
from counterflex.identify.data_checks import check_enough, check_finite
from counterflex.identify.dataset import Dataset
from counterflex.identify.file_offsets import file_offsets, refuse
from counterflex.identify.fit import Fit
from counterflex.identify.geometry_setup import (
    KINDS,
    POSE_KINDS,
    TARGET,
    TRACKER,
    Setup,
    by_channel,
    set_up,
    tool_of,
)
from counterflex.identify.holdout import HeldOut, cross_validate, position_error, score_separate
from counterflex.identify.kinematics_proposal import propose
from counterflex.identify.kinematics_report import figures, headline, pictures, remarks
from counterflex.identify.known_drives import axis_sag_table, drive_error_table, known_drive_errors
from counterflex.identify.known_frames import KnownFrames, known_frames, tracker_table
from counterflex.identify.model import CellModel
from counterflex.identify.periodic_choice import GAIN, Harmonics, choose_harmonics
from counterflex.identify.pose_residuals import TrackerResiduals
from counterflex.identify.recipe import Figure, Identification, Recipe
from counterflex.identify.sag_considered import with_honest_sigma
from counterflex.identify.same_postures import regions
from counterflex.identify.solve import Stop, solve
from counterflex.identify.suspicion import thinned
from counterflex.identify.tracker_data import ROBOT_M, check_tracker_data, fixes_target, start_frames
from counterflex.robot.drive_error import DriveError

SOURCE: Final = "counterflex identify kinematics"
_NO_WEIGHT = 1e-10
_REGIONS: Final = 5
"""Regions of the joint space that are held out one after the other."""


def identify(
    cell: CellModel,
    data: Sequence[Dataset],
    holdout: Sequence[Dataset],
    settings: Mapping[str, Any],
    progress: Progress,
) -> Identification:
    """Find the displacements behind the segments, what the sag needs, and periodic errors of the drives.

    Args:
        cell: The cell; earlier calibrations are where the displacements start.
        data: Datasets of the kinds :data:`counterflex.identify.geometry_setup.KINDS`, mixed.
        holdout: Of the same kinds, or empty for folds.
        settings: See :data:`RECIPE`.
        progress: Told about steps.

    Raises:
        InputError: Unusable data (see :func:`counterflex.identify.tracker_data.check_tracker_data`) or settings.
        FileFormatError: A channel is missing.
    """
    options = {**RECIPE.settings, **settings}
    if options["frames"] not in ("free", "known"):
        raise InputError("unknown setting", where="frames", value=options["frames"], limit="free or known")
    known = known_frames(cell) if options["frames"] == "known" else None
    told = _check(cell, [*data, *holdout], as_stated=bool(options["as_stated"]), known=known)
    if known_drive_errors(cell).sag is not None:
        told += ("The cell file's [axis_sag] holds for all poses; what is found here is what it leaves.",)
    progress(0.1, "checked")
    priors = priors_of(options)
    sag = sag_as_known(cell.nominal_chain) if _tries_axes(cell, options) else str(options["sag"])
    model = model_of_data(cell, [*data, *holdout], priors, sag, tied=known is not None)
    setup = set_up(cell, model, data, holdout, known=known)
    check_enough(setup.parameters, setup.blocks)
    everything = [*data, *holdout]
    told += _check_offsets(setup, everything, setup.parameters.nominal, options, least_m=ROBOT_M)
    fit = solve(setup.parameters.held(setup.local), setup.blocks)
    progress(0.3, "geometry found")
    if _tries_axes(cell, options):
        setup, fit, said = _with_turns(cell, setup, fit, data, holdout, options, known)
        model, told = setup.model, told + said
    progress(0.4, "sag found")
    orders = _harmonics(str(options["periodic"]), setup, fit, priors)
    held: HeldOut | None = None
    if orders:
        first = len(setup.model.parameters)
        for axis, k in orders.items():
            model = model.with_periodic(k, [axis], priors.periodic_rad)
        start = np.concatenate([fit.values[:first], np.zeros(len(model.parameters) - first), fit.values[first:]])
        wider = set_up(cell, model, data, holdout, known=known)
        more = solve(wider.parameters.held(wider.local), wider.blocks, start=start)
        if holdout and options["periodic"] == "auto":
            without = _held(setup, holdout, int(options["folds"]), fit)
            held = _held(wider, holdout, int(options["folds"]), more)
            if held.mean()[0] > (1.0 - GAIN) * without.mean()[0]:
                told += (_not_kept(orders, held, without),)
                orders, held = {}, without
        if orders:
            setup, fit = wider, more
    told += _check_offsets(setup, everything, fit.values, options)
    fit = with_honest_sigma(fit, setup.blocks, float(options["compliance_sigma"]), bearing_of(options))
    progress(0.6, "fitted")
    held = _held(setup, holdout, int(options["folds"]), fit) if held is None else held
    apart = () if holdout else _held_apart(setup, fit)
    return Identification(
        recipe="kinematics",
        fits={"kinematics": fit},
        headline=headline(setup, held, separate=bool(holdout)),
        figures=(*apart, *figures(setup, fit, orders)),
        changes=_changes(cell, setup, fit),
        remarks=(*told, *remarks(setup, fit, held, orders)),
        pictures=pictures(setup, fit, held),
    )


def _tries_axes(cell: CellModel, options: Mapping[str, Any]) -> bool:
    """Whether what own weight turns axes 2 and 3 by is looked for, and kept where held-out poses bear it out."""
    return options["sag"] == "auto" and sag_of(cell.nominal_chain, "auto") == "axes"


def _with_turns(
    cell: CellModel,
    setup: Setup,
    fit: Fit,
    data: Sequence[Dataset],
    holdout: Sequence[Dataset],
    options: Mapping[str, Any],
    known: KnownFrames | None,
) -> tuple[Setup, Fit, tuple[str, ...]]:
    """The fit with turns of axes 2 and 3 by own weight where folds of the data are predicted better, else as given."""
    model = model_of_data(cell, [*data, *holdout], priors_of(options), "axes", tied=known is not None)
    wider = set_up(cell, model, data, holdout, known=known)
    try:
        check_enough(wider.parameters, wider.blocks)
    except InputError:
        return setup, fit, ("Too few poses to find what own weight turns axes 2 and 3 by; measure more of them.",)
    first = len(setup.model.parameters)
    start = np.concatenate([fit.values[:first], np.zeros(len(model.parameters) - first), fit.values[first:]])
    more = solve(wider.parameters.held(wider.local), wider.blocks, start=start)
    folds = int(options["folds"])
    without, held = _held(setup, (), folds, fit).mean()[0], _held(wider, (), folds, more).mean()[0]
    compared = f"the mean error of poses held out is {held / MM:.3g} mm with and {without / MM:.3g} mm without"
    if held > (1.0 - GAIN) * without:
        return setup, fit, (f"What own weight turns axes 2 and 3 by is not seen: {compared}.",)
    return wider, more, (f"Own weight turns axes 2 and 3: {compared}.",)


def _check(
    cell: CellModel, data: Sequence[Dataset], *, as_stated: bool, known: KnownFrames | None = None
) -> tuple[str, ...]:
    told: tuple[str, ...] = ()
    parts = []
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
    # Poses that do not turn enough need others, of the same target, that do.
    targets = {} if known is None else {"": known.T_tcp_target}
    fixing = [len(part) == 0 or fixes_target(cell, part) for _, part in parts]
    for (tool, part), fixed in sorted(zip(parts, fixing, strict=True), key=lambda item: not item[1]):
        target = None if fixed else targets.get(tool)
        told = (*told, *check_tracker_data(cell, part, as_stated=as_stated, partly=True, target=target))
        if fixed and tool not in targets:
            targets[tool] = start_frames(cell, thinned(part)).T_tcp_target
        elif not fixed:
            told = (*told, _not_turning(part, tool, target is not None))
    return told


def _check_offsets(
    setup: Setup, data: Sequence[Dataset], x: Float, options: Mapping[str, Any], *, least_m: float = 0.0
) -> tuple[str, ...]:
    """Name files whose tracker or target stands elsewhere than that of the others."""
    blocks = [b for b in (*setup.blocks, *setup.unseen) if isinstance(b, TrackerResiduals)]
    owners = [d for d in data if d.kind in POSE_KINDS for _ in by_channel(d, "target")]
    fitted = sum(isinstance(b, TrackerResiduals) for b in setup.blocks)
    found = file_offsets(blocks, x, fitted=fitted, least_m=least_m)
    # A few tenths of a millimetre on data not used may be the arm's own error where these are: told, not refused.
    told = [o for o in found if o.place >= fitted and least_m == 0.0]
    remarks = tuple(f"{o.sentence()}. If it was moved, {o.remedy()}." for o in told)
    rest = [o for o in found if o not in told]
    where = [d.where or d.name for d in owners]
    return (*refuse(rest, where, as_stated=bool(options["as_stated"])), *remarks)


def _not_turning(d: Dataset, tool: str, known: bool) -> str:
    whose = f"target '{tool}'" if tool else "target"
    if known:
        return (
            f"{d.name} hardly turns the tool: its {whose} is that of the other data, its tracker was found by itself."
        )
    return (
        f"{d.name} turns the tool about one axis only: the offset of the {whose} along it is not told from the place "
        "of the tracker and was left at zero."
    )


def priors_of(options: Mapping[str, Any]) -> ArmPriors:
    """Standard deviations from the recipe's settings."""
    return ArmPriors(
        length_m=float(options["length_sigma_mm"]) * MM,
        angle_rad=float(options["angle_sigma_mrad"]) * MRAD,
        mass=float(options["mass_sigma"]),
        periodic_rad=float(options["periodic_sigma_urad"]) * URAD,
        sag_rad=float(options["sag_sigma_mrad"]) * MRAD,
    )


def model_of_data(cell: CellModel, data: Sequence[Dataset], priors: ArmPriors, sag: str, *, tied: bool) -> ArmModel:
    """The arm with the displacements that the kinds of data can tell from their own frames.

    Args:
        cell: The cell.
        data: All datasets.
        priors: Standard deviations.
        sag: See :func:`counterflex.identify.arm_parameters.sag_of`.
        tied: Tracker and target are known beforehand.
    """
    kinds = {d.kind for d in data}
    touching = bool(kinds & {"distances", "planes"})
    return arm_model(
        cell,
        priors,
        sag=sag,
        base=tied or "fiducials" in kinds,
        flange=tied or touching,
        tool=tied or touching,
    )


def _harmonics(asked: str, setup: Setup, fit: Fit, priors: ArmPriors) -> Harmonics:
    if asked == "off":
        return {}
    if asked == "auto":
        return choose_harmonics(setup, fit, priors.periodic_rad)
    try:
        order = int(asked)
    except ValueError as fault:
        raise InputError("unknown setting", where="periodic", value=asked, limit="auto, off or an order") from fault
    return dict.fromkeys(range(6), tuple(range(1, order + 1))) if order > 0 else {}


def _not_kept(orders: Harmonics, held: HeldOut, without: HeldOut) -> str:
    count = sum(len(k) for k in orders.values())
    return (
        f"{count} periodic errors of the drives that folds of the fitted data bear out were not kept: the mean "
        f"error of the data held out is {held.mean()[0] / MM:.3g} mm with and {without.mean()[0] / MM:.3g} mm without."
    )


def _weighted(setup: Setup, fit: Fit) -> list[Any]:
    """The blocks with the weights that the fit gave their rows: gross errors count as little in every fold."""
    return [
        replace(cast(Any, b), sigma=b.sigma / np.sqrt(np.maximum(w, _NO_WEIGHT))[:, None])
        for b, w in zip(setup.blocks, fit.weights, strict=True)
    ]


def _held(setup: Setup, holdout: Sequence[Dataset], folds: int, fit: Fit) -> HeldOut:
    if holdout:
        return score_separate(
            setup.parameters, setup.blocks, setup.unseen, needed=setup.needed, local=setup.local,
            error=position_error, start=fit.values,
        )  # fmt: skip
    scored = [i for i, b in enumerate(setup.blocks) if isinstance(b, TrackerResiduals)]
    judged = scored or [i for i, b in enumerate(setup.blocks) if b.components[0] in ("distance m", "height m")]
    # What is a gross error has been decided with all rows; the folds only have to stay clear of it.
    weighted = _weighted(setup, fit)
    return cross_validate(
        setup.parameters, weighted, needed=setup.needed, error=position_error, scored=judged, folds=folds,
        start=fit.values, robust=False, stop=Stop(tolerance=1e-7),
    )  # fmt: skip


def _held_apart(setup: Setup, fit: Fit) -> tuple[Figure, ...]:
    """Error of whole regions of the joint space, and of whole files, that their fit had not seen."""
    poses = {
        i: b.arm.q
        for i, b in enumerate(setup.blocks)
        if isinstance(b, TrackerResiduals) and isinstance(b.arm, ArmGeometry)
    }
    if not poses:
        return ()
    weighted = _weighted(setup, fit)
    sizes = [len(q) for q in poses.values()]
    every, group = np.concatenate(list(poses.values())), np.concatenate([setup.blocks[i].group for i in poses])
    found = np.split(regions(every, group, _REGIONS), np.cumsum(sizes)[:-1])
    ways = [("region", "whole regions of the joint space", dict(zip(poses, found, strict=True)))]
    if len(poses) > 1 and not setup.local and len({setup.blocks[i].name for i in poses}) > 1:
        ways.append(
            ("file", "whole files", {i: np.full(n, k) for k, (i, n) in enumerate(zip(poses, sizes, strict=True))})
        )
    out = []
    for name, what, parts in ways:
        if len(np.unique(np.concatenate(list(parts.values())))) < 2:
            continue
        try:
            held = cross_validate(
                setup.parameters, weighted, needed=setup.needed, error=position_error, scored=list(poses), parts=parts,
                start=fit.values, robust=False, stop=Stop(tolerance=1e-6),
            )  # fmt: skip
        except CounterflexError:
            continue  # what is left without that part does not fix the frames
        (mean, before), (worst, worst_before) = held.mean(), held.largest()
        out.append(Figure(f"{name}_mean_mm", f"mean position error, {what} held out", mean / MM, before / MM))
        out.append(
            Figure(f"{name}_largest_mm", f"largest position error, {what} held out", worst / MM, worst_before / MM)
        )
    return tuple(out)


def _changes(cell: CellModel, setup: Setup, fit: Fit) -> tuple[Change, ...]:
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
    if lay.turns is not None:
        out.append(axis_sag_table(known_drive_errors(cell), x[lay.turns], SOURCE))
    if lay.periodic:
        found = [DriveError(t.axis, t.order, float(x[t.sine]), float(x[t.cosine])) for t in lay.periodic]
        q = np.concatenate([arm.q for b in setup.blocks if isinstance(arm := getattr(b, "arm", None), ArmGeometry)])
        out.append(drive_error_table(known_drive_errors(cell), found, q, SOURCE))
    tracker, target = setup.frames.get(TRACKER), setup.frames.get(TARGET)
    if tracker is not None:
        whole = target if target is not None and np.all(target.index >= 0) else None
        out.append(
            tracker_table(
                tracker.at(x),
                fit.sigma[tracker.index],
                None if whole is None else whole.at(x),
                None if whole is None else fit.sigma[whole.index],
                SOURCE,
            )
        )
    return tuple(out)


RECIPE: Final = Recipe(
    name="kinematics",
    title="Geometric calibration of the arm, with its sag and its drives",
    kinds=KINDS,
    settings={
        "sag": "auto",
        "periodic": "auto",
        "frames": "free",
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
    identify=identify,
    propose=propose,
)
