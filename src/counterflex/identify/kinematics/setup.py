"""All measurements of one geometric calibration put together: frames, anchors and planes first, then residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float, Int, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import MM, MRAD
from counterflex.identify.data.data_checks import SAME_POSE_RAD
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.model import CellModel
from counterflex.identify.design.choice import candidates_of, choose, expected_sigma, prior_information
from counterflex.identify.design.order import order_of_poses, wrong_sides
from counterflex.identify.design.pose_candidates import in_order, measurable
from counterflex.identify.geometry import tracker_data
from counterflex.identify.geometry.arm_parameters import ArmModel, ArmPriors, arm_model
from counterflex.identify.geometry.compliances import foreseen
from counterflex.identify.geometry.fiducials import FiducialResiduals, fiducial_sigma, robust_register
from counterflex.identify.geometry.known_frames import KnownFrames, known_drive_errors, known_frames
from counterflex.identify.geometry.off_rows import FitSession
from counterflex.identify.geometry.pose_residuals import PlacedFrame, TrackerResiduals, frame_parameters
from counterflex.identify.kinematics import distance_residuals
from counterflex.identify.kinematics.approach_sense import senses
from counterflex.identify.recipe import Proposal
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.identify.solver.residuals import Residuals

FEWEST: Final = 8
CANDIDATES: Final = 6
"""Candidates per pose that is chosen, but 400 at most."""


def propose(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Poses of a six-axis tracker target that determine geometry, masses and frames best (D-optimal).

    ``cell``: The cell; with a ``[tracker]`` table only poses that the tracker sees are proposed. ``settings``:
    ``seed``, ``sag`` as in the recipe. Raises InputError: too few. Raises ReachError: hardly any pose can be measured.
    """
    if count < FEWEST:
        raise InputError("too few poses", value=count, limit=f"{FEWEST} or more, better 40")
    rng = np.random.default_rng(int(settings.get("seed", 0)))
    known = known_frames(cell)
    q = measurable(
        cell,
        max(count, min(CANDIDATES * count, 400)),
        rng,
        tracker=None if known is None else known.T_base_tracker[:3, 3],
        p_tcp_target=None if known is None else known.T_tcp_target[:3, 3],
    )
    model = arm_model(cell, ArmPriors(), sag=str(settings.get("sag", "auto")))
    parameters, block = foreseen(model, q, known)
    candidates = candidates_of(parameters, [block])
    choice = choose(candidates.jacobian, count, prior_information(parameters))
    speeds = model.chain.joint_speeds_rad_s
    chosen = in_order(cell.nominal_chain, q[choice.indices])
    chosen = chosen[order_of_poses(chosen, np.ones(6) if speeds is None else speeds)]
    return Proposal(
        recipe="kinematics",
        kind="tracker_poses",
        columns={f"q{i + 1}_rad": chosen[:, i] for i in range(6)},
        expected=expected_sigma(parameters, choice.covariance),
        units=parameters.units,
        remarks=(
            f"{count} of {len(q)} poses within limits, above the floor and clear of the column"
            + (", seen by the tracker." if known is not None else "; line of sight is not checked without [tracker]."),
            f"{int(np.sum(wrong_sides(chosen)))} of {6 * count} times an axis arrives with falling angle; "
            "to take up its play, approach such poses from 2 deg below.",
            "Let the robot rest for a second before each measurement.",
        ),
    )


TRACKER = "T_base_tracker"
TARGET = "T_tcp_target"
POSE_KINDS = ("tracker_poses", "tracker_points")
KINDS = (*POSE_KINDS, "fiducials", "distances", "planes")


@dataclass
class MeasuringFrames:
    """Frames by name with their first estimates, anchors and planes likewise; parameters in the order they were met."""

    first: int
    items: list[Parameter] = field(default_factory=list)
    placed: dict[str, PlacedFrame] = field(default_factory=dict)
    anchors: dict[str, tuple[Float, Int]] = field(default_factory=dict)
    planes: dict[str, tuple[Float, Float, Int]] = field(default_factory=dict)

    def add(self, parameters: Sequence[Parameter]) -> Int:
        """Append parameters; their places."""
        start = self.first + len(self.items)
        self.items += parameters
        return np.arange(start, start + len(parameters), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class CalibrationSetup:
    """One geometric calibration."""

    parameters: Parameters  # those of the arm, then those of frames, anchors and planes
    blocks: tuple[Residuals, ...]  # residuals of the data that are fitted
    unseen: tuple[Residuals, ...]  # residuals of the separate file, if any
    needed: tuple[str, ...]  # names of the parameters that any use finds first (all but the arm's)
    local: tuple[str, ...]  # names of those that only the separate file has
    frames: dict[str, PlacedFrame]  # frames by name
    model: ArmModel

    @property
    def groups(self) -> tuple[Int, Int, Int]:
        """Places of the displacements: lengths, tilts, zeros."""
        at = list(self.model.layout.displaced.values())
        if not at:
            none = np.zeros(0, dtype=np.int64)
            return none, none, none
        places = np.stack(at)
        return places[:, :3].ravel(), places[:, 3:5].ravel(), places[:, 5]


def set_up(
    cell: CellModel,
    model: ArmModel,
    data: Sequence[Dataset],
    holdout: Sequence[Dataset] = (),
    *,
    known: KnownFrames | None = None,
) -> CalibrationSetup:
    """Find frames, anchors and planes robustly, then build the residuals of all datasets.

    ``data``: Datasets of the kinds :data:`KINDS`. ``known``: Tracker and target of the cell file with their standard
    deviations as priors; None leaves them free. Raises InputError: a dataset that fixes no frame, anchor or plane.
    Raises FileFormatError: a channel is missing.
    """
    frames = MeasuringFrames(first=len(model.parameters))
    everything = [*data, *holdout]
    # Poses fix tracker and target at once; what has only points or fiducials then finds its tracker placed already, and
    # poses that do not turn find their target.
    fixing = [d.kind in POSE_KINDS and tracker_data.fixes_target(cell, d) for d in everything]
    order = sorted(
        range(len(everything)),
        key=lambda i: (not fixing[i], KINDS.index(everything[i].kind), i >= len(data), -len(everything[i])),
    )
    built: dict[int, list[Residuals]] = {}
    for i in order:
        built[i] = _residuals(cell, model, everything[i], frames, known)
    # Back in the order of the data: hold-out, weights and messages count their blocks by it.
    blocks = [b for i in range(len(data)) for b in built[i]]
    unseen = [b for i in range(len(data), len(everything)) for b in built[i]]
    names = tuple(p.name for p in frames.items)
    used = used_places(blocks)
    local = tuple(n for k, n in enumerate(names) if frames.first + k not in used)
    return CalibrationSetup(
        parameters=model.parameters + Parameters.of(frames.items),
        blocks=tuple(blocks),
        unseen=tuple(unseen),
        needed=tuple(n for n in names if n not in local),
        local=local,
        frames=dict(frames.placed),
        model=model,
    )


def used_places(blocks: Sequence[Residuals]) -> set[int]:
    """Places of the parameters of frames, anchors and planes that blocks depend on."""
    out: set[int] = set()
    for b in blocks:
        for name in ("tracker", "target"):
            frame = getattr(b, name, None)
            if isinstance(frame, PlacedFrame):
                out |= {int(i) for i in frame.index if i >= 0}
        for name in ("anchor", "place"):
            index = getattr(b, name, None)
            if index is not None:
                out |= {int(i) for i in np.unique(index)}
    return out


def _residuals(
    cell: CellModel, model: ArmModel, d: Dataset, frames: MeasuringFrames, known: KnownFrames | None
) -> list[Residuals]:
    if d.kind in POSE_KINDS:
        return [_tracker(cell, model, part, frames, known, target) for target, part in by_channel(d, "target")]
    if d.kind == "fiducials":
        return [_fiducials(d, frames, known)]
    if d.kind == "distances":
        return _distances(cell, model, d, frames)
    return _planes(cell, model, d, frames)


def by_channel(d: Dataset, channel: str) -> list[tuple[str, Dataset]]:
    """The dataset split by a channel of numbers; whole where it has none."""
    if not d.has(channel):
        return [("", d)]
    number = np.rint(d.values(channel)[:, 0]).astype(np.int64)
    return [(str(k), replace(d.rows(number == k), name=f"{d.name}, {channel} {k}")) for k in np.unique(number)]


def sessions(data: Sequence[Dataset], blocks: Sequence[Residuals]) -> list[FitSession]:
    """Datasets of poses and points in the order of their rows."""
    places = iter([i for i, b in enumerate(blocks) if isinstance(b, TrackerResiduals)])
    out = []
    for d in data:
        if d.kind not in POSE_KINDS:
            continue
        number = np.rint(d.values("target")[:, 0]) if d.has("target") else np.zeros(len(d))
        block, row = np.zeros((2, len(d)), dtype=np.int64)
        for k in np.unique(number):
            mine = np.flatnonzero(number == k)
            block[mine], row[mine] = next(places), np.arange(len(mine))
        out.append(FitSession(d, block, row))
    return out


def station_of(d: Dataset) -> str:
    """Name that the data give the place of their tracker; empty is that of the cell."""
    return str(d.settings.get("tracker", ""))


def tool_of(d: Dataset, number: str = "") -> str:
    """Name that the data give their target, or its number; empty is that of the cell."""
    return str(d.settings.get("target", number))


def _named(name: str, key: str) -> str:
    return f"{name}[{key}]" if key else name


def _placed(
    frames: MeasuringFrames, name: str, T0: Float, label: str, sigma: Float | None, *, point: bool = False
) -> PlacedFrame:
    if name not in frames.placed:
        index = np.full(6, -1, dtype=np.int64)
        places = frames.add(frame_parameters(name, label, sigma, point=point))
        index[: len(places)] = places
        frames.placed[name] = PlacedFrame(T0, index)
    return frames.placed[name]


def _tracker(
    cell: CellModel, model: ArmModel, d: Dataset, frames: MeasuringFrames, known: KnownFrames | None, number: str
) -> Residuals:
    station, tool = station_of(d), tool_of(d, number)
    tracker, target = _named(TRACKER, station), _named(TARGET, tool)
    main = known if not station else None
    mine = known if not tool else None
    Z0 = frames.placed[tracker].T0 if tracker in frames.placed else None if main is None else main.T_base_tracker
    X0 = frames.placed[target].T0 if target in frames.placed else None if mine is None else mine.T_tcp_target
    if Z0 is None or X0 is None:
        start = tracker_data.start_frames(cell, d, partly=True, target=X0, tracker=Z0)
        Z0, X0 = start.T_base_tracker, start.T_tcp_target
    arm = model.at(known_drive_errors(cell).link_angles(d.values("q")), senses(d))
    return tracker_data.tracker_residuals(
        d,
        arm,
        _placed(
            frames,
            tracker,
            Z0,
            f"tracker {station} in the base".replace("  ", " "),
            None if main is None else main.sigma,
        ),
        _placed(
            frames,
            target,
            X0,
            f"target {tool} on the tool".replace("  ", " "),
            None if mine is None else mine.target_sigma,
            point=not tracker_data.has_orientation(d),
        ),
    )


def _fiducials(d: Dataset, frames: MeasuringFrames, known: KnownFrames | None) -> Residuals:
    name = _named(TRACKER, str(d.settings.get("tracker", "")))
    p_base, p_tracker = d.values("p_base_fiducial"), d.values("p_tracker_fiducial")
    T0 = robust_register(p_base, p_tracker)
    if name == TRACKER and known is not None:
        T0 = known.T_base_tracker
    tracker = _placed(
        frames, name, T0, "tracker in the base", known.sigma if known is not None and name == TRACKER else None
    )
    return FiducialResiduals(d.name, d.group, fiducial_sigma(d), tracker, p_base, p_tracker)


def _distances(cell: CellModel, model: ArmModel, d: Dataset, frames: MeasuringFrames) -> list[Residuals]:
    out: list[Residuals] = []
    angles = known_drive_errors(cell).link_angles
    for number, part in by_channel(d, "anchor"):
        length = part.values("distance")[:, 0]
        n = len(part)
        if part.has("q_second"):
            second = model.at(angles(part.values("q_second")))
            same = np.all(np.abs(part.values("q") - part.values("q_second")) < SAME_POSE_RAD, axis=1)
            if np.any(same):
                raise InputError(
                    "a distance between a pose and itself", where=part.place(int(np.flatnonzero(same)[0])), value=0
                )
            anchor0, index = np.zeros((n, 3)), np.zeros((n, 3), dtype=np.int64)
        else:
            second, name = None, _named(f"anchor of {d.name}", number)
            if name not in frames.anchors:
                p = tracker_data.arm_as_known(cell, part.values("q")).poses(np.zeros(0))[:, :3, 3]
                a0 = distance_residuals.find_anchor(p, length, part.where)
                items = [
                    Parameter(f"{name}.{c}", "m", 0.0, np.inf, scale=MM, label=f"fixed end of the bar, {c}")
                    for c in "xyz"
                ]
                frames.anchors[name] = (a0, frames.add(items))
            a0, places = frames.anchors[name]
            anchor0, index = np.tile(a0, (n, 1)), np.tile(places, (n, 1))
        sigma = part.channel("distance").need_sigma()
        arm = model.at(angles(part.values("q")))
        out.append(
            distance_residuals.DistanceResiduals(part.name, part.group, sigma, arm, length, second, anchor0, index)
        )
    return out


def _planes(cell: CellModel, model: ArmModel, d: Dataset, frames: MeasuringFrames) -> list[Residuals]:
    out: list[Residuals] = []
    for number, part in by_channel(d, "plane"):
        name = _named(f"plane of {d.name}", number)
        q = part.values("q")
        if name not in frames.planes:
            centre, axes = distance_residuals.find_plane(
                tracker_data.arm_as_known(cell, q).poses(np.zeros(0))[:, :3, 3], part.where
            )
            items = [
                Parameter(f"{name}.height", "m", 0.0, np.inf, scale=MM, label="height of the plane"),
                Parameter(f"{name}.tilt_u", "rad", 0.0, np.inf, scale=MRAD, label="tilt of the plane"),
                Parameter(f"{name}.tilt_v", "rad", 0.0, np.inf, scale=MRAD, label="tilt of the plane"),
            ]
            frames.planes[name] = (centre, axes, frames.add(items))
        centre, axes, places = frames.planes[name]
        n = len(part)
        if "probe_sigma_m" not in part.settings:
            raise InputError(
                "how well the probe touches is not stated",
                where=part.where,
                hint="Write its standard deviation into the manifest under [settings]: probe_sigma_mm = ...",
            )
        out.append(
            distance_residuals.PlaneResiduals(
                part.name,
                part.group,
                np.full((n, 1), as_positive("probe_sigma_m", float(part.settings["probe_sigma_m"]))),
                model.at(known_drive_errors(cell).link_angles(q)),
                np.tile(centre, (n, 1)),
                np.tile(axes, (n, 1, 1)),
                np.tile(places, (n, 1)),
            )
        )
    return out
