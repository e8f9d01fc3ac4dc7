"""Recipe ``tracker-frame``: where the tracker stands in the robot base, where its target sits, and whether it moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.progress import in_parts, share_of
from counterflex.core.units import MM, UM, URAD
from counterflex.identify.data.data_checks import check_finite, check_spread
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.model import CellModel
from counterflex.identify.geometry.arm_geometry import ArmGeometry
from counterflex.identify.geometry.arm_parameters import ArmModel, ArmPriors, arm_model, sag_as_known
from counterflex.identify.geometry.compliances import bearing_of
from counterflex.identify.geometry.fiducials import (
    FiducialResiduals,
    check_sense,
    displacement_between,
    fiducial_sigma,
    robust_register,
)
from counterflex.identify.geometry.known_frames import KnownFrames, known_drive_errors, known_frames, tracker_table
from counterflex.identify.geometry.off_rows import FitSession, off_rows, without
from counterflex.identify.geometry.pose_residuals import COMPONENTS, PlacedFrame, TrackerResiduals, frame_parameters
from counterflex.identify.geometry.tracker_data import arm_of, check_tracker_data, start_frames, tracker_residuals
from counterflex.identify.recipe import Curve, Figure, Identification, Inputs, Picture, Recipe
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import HeldOut, cross_validate, position_error, score_separate
from counterflex.identify.solver.parameters import Parameters
from counterflex.identify.solver.residuals import Residuals
from counterflex.identify.solver.solve import solve
from counterflex.identify.tracker_frame import TITLE, considered
from counterflex.identify.tracker_frame.proposal import propose

FEWEST_FIDUCIALS: Final = 4
"""Three fix a frame; with a fourth each can be predicted from the others."""
TRACKER: Final = "T_base_tracker"
TARGET: Final = "T_tcp_target"
_WORK: Final = {"registering": 2.0, "fitting": 1.0, "held out": 5.0}
_FITTED: Final = 3.0 / 8.0
"""Share of the work that is done when the fit is there."""


def identify(inputs: Inputs) -> Identification:
    """Find T_base_tracker from fiducials, poses or both, and T_tcp_target from poses.

    ``inputs``: The cell, whose robot predicts the poses, sag under own weight included; ``fiducials`` and
    ``tracker_poses``. Raises InputError: too few or collinear fiducials, a mirrored frame, units mixed up, poses that
    do not turn.
    """
    cell, data, holdout, options, progress = inputs
    notes = _check(cell, [*data, *holdout], as_stated=bool(options["as_stated"]))
    known = known_frames(cell)
    model, parameters, tracker, target, start = _unknowns(cell, data, known)
    watch = _drift(data)
    blocks = _blocks(cell, data, model, tracker, target, last=any(d.significant for d in watch))
    parts = in_parts(progress, _WORK)
    parts["registering"](1.0)
    fit = solve(parameters, blocks, start=start, progress=parts["fitting"])
    off = off_rows(parameters, blocks, fit, _sessions(data))
    kept, more = without(data, off, as_stated=bool(options["as_stated"]))
    notes = (*more, *notes)
    if off and not options["as_stated"]:
        fewer = identify(inputs._replace(data=kept, progress=share_of(progress, _FITTED, 1.0)))
        return replace(fewer, remarks=(*more, *fewer.remarks))
    fit = considered.with_frame_sigma(
        fit,
        blocks,
        [_unrest(d, b, fit.values) for d, b in zip(data, blocks, strict=True)],
        compliance=_share(options, "compliance_sigma"),
        bearing_m=bearing_of(options),
        scale=_share(options, "scale_sigma"),
    )
    if holdout:
        unseen = _blocks(cell, holdout, model, tracker, target, last=False)
        held_out = score_separate(parameters, blocks, unseen, error=position_error, start=start)
    else:
        scored = [i for i, b in enumerate(blocks) if isinstance(b, FiducialResiduals)] or list(range(len(blocks)))
        held_out = cross_validate(
            parameters, blocks, error=position_error, scored=scored, start=start, progress=parts["held out"]
        )
    T_base_tracker = tracker.at(fit.values)
    T_tcp_target = None if target is None else target.at(fit.values)
    change = tracker_table(
        T_base_tracker,
        fit.sigma[tracker.index],
        T_tcp_target,
        None if target is None else fit.sigma[target.index],
        "counterflex identify tracker-frame",
    )
    return Identification(
        recipe="tracker-frame",
        fits={"tracker-frame": fit},
        headline=_headline(held_out, known),
        figures=(
            *_figures(fit, blocks, watch),
            *_frame_figures(fit, tracker, target),
            *_part_figures(cell, fit, tracker),
        ),
        changes=(change,),
        remarks=(*notes, *_remarks(fit, blocks, watch, target is not None)),
        pictures=_pictures(fit, blocks),
    )


def _unknowns(
    cell: CellModel, data: Sequence[Dataset], known: KnownFrames | None
) -> tuple[ArmModel | None, Parameters, PlacedFrame, PlacedFrame | None, Float]:
    """The arm, all parameters, tracker and target among them, and start values."""
    start_tracker, start_target = _start(cell, data)
    T0 = start_tracker if known is None else known.T_base_tracker
    X0 = start_target if known is None or start_target is None else known.T_tcp_target
    # The robot's own errors are free within their priors, so that they do not pass for accuracy of the frames.
    model = _arm(cell, data) if X0 is not None else None
    first = 0 if model is None else len(model.parameters)
    items = frame_parameters(TRACKER, "tracker in the base")
    if X0 is not None:
        items += frame_parameters(TARGET, "target on the tool")
    parameters = Parameters.of([*(() if model is None else model.parameters), *items])
    tracker = PlacedFrame(T0, np.arange(first, first + 6, dtype=np.int64))
    target = None if X0 is None else PlacedFrame(X0, np.arange(first + 6, first + 12, dtype=np.int64))
    start = [parameters.nominal[:first], displacement_between(T0, start_tracker)]
    if X0 is not None and start_target is not None:
        start.append(displacement_between(X0, start_target))
    return model, parameters, tracker, target, np.concatenate(start)


def _check(cell: CellModel, data: Sequence[Dataset], *, as_stated: bool) -> tuple[str, ...]:
    """Refuse what a fit would hide; remarks."""
    notes: tuple[str, ...] = ()
    poses = [d for d in data if d.kind == "tracker_poses"]
    fiducials = [d for d in data if d.kind == "fiducials"]
    if not poses and not fiducials:
        raise InputError("the tracker's frame needs fiducials or tracker poses", value=[d.kind for d in data])
    for d in poses:
        notes = (*notes, *check_tracker_data(cell, d, as_stated=as_stated))
    for d in fiducials:
        _check_fiducials(d, 0 if poses else FEWEST_FIDUCIALS)
    return notes


def _check_fiducials(d: Dataset, fewest: int) -> None:
    check_finite(d, ["p_base_fiducial", "p_tracker_fiducial"])
    different, where = len(np.unique(d.group)), d.where or d.name
    if different < fewest:
        raise InputError(
            "too few fiducials",
            where=where,
            value=different,
            limit=f"{fewest} or more: with three none can be predicted from the others",
            hint="Measure more fiducials, spread around the robot",
        )
    p_base, p_tracker = d.values("p_base_fiducial"), d.values("p_tracker_fiducial")
    check_spread(p_base, "fiducials", where=where)
    check_spread(p_tracker, "fiducials as measured", where=where)
    check_sense(p_base, p_tracker, float(np.median(fiducial_sigma(d))), where)


def _sessions(data: Sequence[Dataset]) -> list[FitSession]:
    """Datasets of poses; each has a block of residuals in its place."""
    return [
        FitSession(d, np.full(len(d), i, dtype=np.int64), np.arange(len(d), dtype=np.int64))
        for i, d in enumerate(data)
        if d.kind == "tracker_poses"
    ]


def _start(cell: CellModel, data: Sequence[Dataset]) -> tuple[Float, Float | None]:
    """Robust first estimates of tracker and, where poses were measured, target."""
    placed = None
    for d in data:
        if d.kind == "fiducials" and placed is None:
            placed = robust_register(d.values("p_base_fiducial"), d.values("p_tracker_fiducial"))
    for d in data:
        if d.kind == "tracker_poses":
            frames = start_frames(cell, d)
            return (frames.T_base_tracker if placed is None else placed), frames.T_tcp_target
    return (np.eye(4) if placed is None else placed), None


def _blocks(
    cell: CellModel,
    data: Sequence[Dataset],
    model: ArmModel | None,
    tracker: PlacedFrame,
    target: PlacedFrame | None,
    *,
    last: bool,
) -> list[Residuals]:
    out: list[Residuals] = []
    for d in data:
        if d.kind == "fiducials":
            rows = np.ones(len(d), dtype=np.bool_)
            if last:  # the tracker has moved: where it stands now is what counts
                rounds = considered.rounds_of(d.group, _time(d))
                latest = {int(g): int(rounds[d.group == g].max()) for g in np.unique(d.group)}
                rows = np.array([rounds[i] == latest[int(g)] for i, g in enumerate(d.group)])
            part = d.rows(rows)
            out.append(
                FiducialResiduals(
                    name=d.name,
                    group=part.group,
                    sigma=fiducial_sigma(part),
                    tracker=tracker,
                    p_base=part.values("p_base_fiducial"),
                    p_tracker=part.values("p_tracker_fiducial"),
                )
            )
        elif target is not None:
            stated_arm = arm_of(cell, d)
            angles = known_drive_errors(cell).link_angles
            free = isinstance(stated_arm, ArmGeometry) and model is not None
            arm = model.at(angles(d.values("q"))) if free and model is not None else stated_arm
            out.append(tracker_residuals(d, arm, tracker, target))
    return out


def _share(options: Mapping[str, Any], name: str) -> float:
    value = options[name]
    if not (isinstance(value, int | float) and 0.0 <= float(value) <= 1.0):
        raise InputError(f"setting {name}", value=str(value), limit="a relative standard deviation, 0 .. 1")
    return float(value)


def _unrest(d: Dataset, block: Residuals, x: Float) -> Float:
    """Result of :func:`.considered.unrest` for a dataset whose rounds are all in its block."""
    if not isinstance(block, FiducialResiduals) or len(block.group) < len(d):
        return np.zeros((len(block.group), len(block.components), 0))
    p = d.channel("p_tracker_fiducial")
    return considered.unrest(block, p.values, p.need_sigma(), _time(d), x)


def _part_figures(cell: CellModel, fit: Fit, tracker: PlacedFrame) -> tuple[Figure, ...]:
    try:
        zero = cell.T_base_part[:3, 3]
    except FileFormatError:
        return ()
    size = _length(considered.sigma_at(fit, tracker, zero))
    return (Figure("part_sigma_um", "standard deviation of the part zero measured by the tracker", size / UM),)


def _time(d: Dataset) -> Float | None:
    return d.values("time_s")[:, 0] if d.has("time_s") else None


def _arm(cell: CellModel, data: Sequence[Dataset]) -> ArmModel | None:
    """The arm with its errors as parameters, where poses are given by joint angles."""
    if not any(d.kind == "tracker_poses" and d.has("q") for d in data):
        return None
    fiducials = any(d.kind == "fiducials" for d in data)  # known in the base: the arm may stand off in it
    return arm_model(cell, ArmPriors(), sag=sag_as_known(cell.nominal_chain), base=fiducials)


def _drift(data: Sequence[Dataset]) -> tuple[considered.Drift, ...]:
    out: tuple[considered.Drift, ...] = ()
    for d in data:
        if d.kind == "fiducials":
            p = d.channel("p_tracker_fiducial")
            out = (*out, *considered.drifts(d.group, p.values, p.need_sigma(), _time(d)))
    return out


def _headline(held_out: HeldOut, known: KnownFrames | None) -> tuple[Figure, ...]:
    mean, largest = held_out.mean(), held_out.largest()
    return (
        Figure(
            "holdout_mean_mm",
            "mean position error of held-out points",
            mean[0] / MM,
            None if known is None else mean[1] / MM,
        ),
        Figure(
            "holdout_largest_mm",
            "largest position error of held-out points",
            largest[0] / MM,
            None if known is None else largest[1] / MM,
        ),
        Figure("holdout_count", "points predicted", float(held_out.count)),
        Figure("gross_count", "excluded outliers", float(np.sum(held_out.gross))),
    )


def _frame_figures(fit: Fit, tracker: PlacedFrame, target: PlacedFrame | None) -> tuple[Figure, ...]:
    s = fit.sigma[tracker.index]
    out = [
        Figure("tracker_sigma_um", "standard deviation of the tracker's place", _length(s[:3]) / UM),
        Figure("tracker_sigma_urad", "standard deviation of its rotation", _length(s[3:]) / URAD),
    ]
    if target is not None:
        t = fit.sigma[target.index]
        out += [
            Figure("target_sigma_um", "standard deviation of the target's place on the tool", _length(t[:3]) / UM),
            Figure("target_sigma_urad", "standard deviation of its rotation", _length(t[3:]) / URAD),
        ]
    return tuple(out)


def _length(v: Float) -> float:
    return float(np.linalg.norm(v))


def _figures(fit: Fit, blocks: Sequence[Residuals], watch: Sequence[considered.Drift]) -> tuple[Figure, ...]:
    out = []
    for block, residuals, factor in zip(blocks, fit.residuals, fit.sigma_factors, strict=True):
        if isinstance(block, FiducialResiduals):
            off = np.linalg.norm(residuals * block.sigma, axis=1)
            for g in np.unique(block.group):
                size = float(np.sqrt(np.mean(off[block.group == g] ** 2)))
                out.append(Figure(f"fiducial_{g}_um", f"residual of fiducial {g}", size / UM))
        elif isinstance(block, TrackerResiduals):
            off = np.linalg.norm((residuals * block.sigma)[:, :3], axis=1)
            out.append(Figure("poses_median_mm", "median residual of the poses", float(np.median(off)) / MM))
        out.append(
            Figure("sigma_factor", f"residuals of {block.name} by their stated standard deviation", float(factor))
        )
    for d in watch:
        out += [
            Figure(f"drift_{d.round}_um", f"shift of the tracker in round {d.round}", _length(d.shift_m) / UM),
            Figure(f"drift_{d.round}_urad", f"its rotation in round {d.round}", _length(d.rotation_rad) / URAD),
            Figure(f"drift_{d.round}_probability", "probability of as much by noise alone", d.probability),
        ]
    return tuple(out)


def _remarks(fit: Fit, blocks: Sequence[Residuals], watch: Sequence[considered.Drift], target: bool) -> tuple[str, ...]:
    out = []
    for o in fit.outliers:
        block = next(b for b in blocks if b.name == o.block)
        row = int(block.group[o.row])
        size = _length((fit.residuals[blocks.index(block)][o.row] * block.sigma[o.row])[:3])
        what = f"fiducial {row}" if isinstance(block, FiducialResiduals) else f"pose {row}"
        out.append(f"{what} of {o.block} is off by {size / MM:.3g} mm and was given the weight {o.weight:.2g}.")
    if any(isinstance(b, TrackerResiduals) for b in blocks):
        out.append(
            "Poses given by the controller carry the robot's own errors of geometry; residuals show how large they are."
            if not any(isinstance(b, TrackerResiduals) and isinstance(b.arm, ArmGeometry) for b in blocks)
            else "Poses carry the robot's own errors of geometry, which were free within their priors here; the "
            "kinematics recipe finds them from more poses."
        )
    for d in watch:
        notes = (
            f"round {d.round}: the tracker shifted by {_length(d.shift_m) / UM:.3g} um "
            f"({_length(d.shift_sigma_m) / UM:.2g} um standard deviation) and turned by "
            f"{_length(d.rotation_rad) / URAD:.3g} urad ({_length(d.rotation_sigma_rad) / URAD:.2g} urad)"
        )
        if d.significant:
            out.append(f"Drift, {notes}; noise alone would do that with probability {d.probability:.1g}. "
                       "The frame is that of the last round; earlier measurements refer to another one.")  # fmt: skip
        else:
            out.append(f"No drift beyond noise, {notes}.")
    if not target:
        out.append("The target's offset on the tool was not measured: add tracker poses of the robot.")
    return tuple(out)


def _pictures(fit: Fit, blocks: Sequence[Residuals]) -> tuple[Picture, ...]:
    out = []
    for block, residuals in zip(blocks, fit.residuals, strict=True):
        x: Float | Int = np.asarray(block.group, dtype=np.float64)
        off = (residuals * block.sigma)[:, :3] / MM
        curves = tuple(Curve(c, np.asarray(x, dtype=np.float64), off[:, i]) for i, c in enumerate(COMPONENTS[:3]))
        number = "fiducial" if isinstance(block, FiducialResiduals) else "pose"
        out.append(Picture(f"Residual of {block.name}", number, "measured minus predicted, mm", curves))
    return tuple(out)


RECIPE: Final = Recipe(
    name="tracker-frame",
    title=TITLE,
    kinds=("fiducials", "tracker_poses"),
    settings={
        "measure": "poses",
        "compliance_sigma": 0.1,
        "bearing_mm": 10.0,
        "scale_sigma": considered.SCALE,
        "as_stated": False,
        "seed": 0,
    },
    find=identify,
    propose=propose,
)
