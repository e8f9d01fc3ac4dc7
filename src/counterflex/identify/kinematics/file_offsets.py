"""Find a file whose tracker or target stands elsewhere than the others': one constant pose that its errors share.

A tracker that was moved between two sessions, a target put back a little differently, an adapter of another length:
every row of that file is off by one and the same pose, which a fit would spread over the arm and the other files. Each
file that shares a tracker or a target with another is tried with six numbers of its own, of the tracker, of the target,
or both; where that explains it far better, it is named, with what to write into its manifest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM, MRAD
from counterflex.geometry import pose, rotation
from counterflex.identify.geometry.hand_eye import error_of, open_offsets
from counterflex.identify.geometry.hand_eye_robust import HandEye, robust_of_poses, robust_target, robust_tracker
from counterflex.identify.geometry.pose_residuals import TrackerResiduals

RATIO: Final = 1.5
"""How many times smaller a frame of its own must make the median error of a file."""
CHANCE: Final = 1e-6
"""Largest probability that it does so by chance, all that was tried taken together."""
FEWEST: Final = 4
_TRIALS = 25
_OTHER = 2.0  # a simpler explanation is preferred unless another leaves this many times less
_USUAL = 0.4  # share of what an arm may be off by that most are
_NUMBERS = {"tracker": 6, "target": 6, "tracker and target": 12}


@dataclass(frozen=True)
class FileOffset:
    """A file that one constant pose sets apart."""

    place: int  # of its residuals in what was given
    name: str  # of its residuals
    frame: str  # `tracker`, `target` or `tracker and target`
    shift_m: float  # how far the frame is displaced (the target, where both are)
    turn_rad: float  # how far it is turned
    shared_m: float  # median error of the file with the frame that it shares
    own_m: float  # the same with a frame of its own

    def sentence(self) -> str:
        """The finding in words."""
        return (
            f"{self.name} differs from the other data by one constant pose of the {self.frame} "
            f"({self.shift_m / MM:.3g} mm, {self.turn_rad / MRAD:.3g} mrad): the median error of its rows is "
            f"{self.shared_m / MM:.3g} mm with a common frame and {self.own_m / MM:.3g} mm with a separate one"
        )

    def remedy(self) -> str:
        """Text for its manifest."""
        names = " and ".join(f'{frame} = "a name of its own"' for frame in self.frame.split(" and "))
        return f"write {names} under [settings] of its manifest"


def file_offsets(
    blocks: Sequence[TrackerResiduals], x: Float, *, fitted: int | None = None, least_m: float = 0.0
) -> tuple[FileOffset, ...]:
    """Files that do not share the frames that they are said to share.

    What most rows agree on is the reference; of two files that differ, the smaller or the later is named. A file that
    is held out never is the reference of one that is fitted.

    Args:
        blocks: Residuals of all files, those held out last.
        x: (p,) SI values of the arm and the frames.
        fitted: How many of them are fitted; None is all.
        least_m: Median error below which no file is suspected, as the arm itself may be off by that much.

    Returns:
        One entry for each file that a constant pose explains at least :data:`RATIO` times better (F test of the squared
        ratio), largest gain first.
    """
    seen = [_Seen.of(b, x) for b in blocks]
    first = len(seen) if fitted is None else fitted
    tracker = _agreements(seen, first, [tuple(s.block.tracker.index[:3]) for s in seen], _tracker_of)
    target = _agreements(seen, first, [tuple(s.block.target.index[:3]) for s in seen], _target_of)
    largest = max(range(first), key=lambda i: len(seen[i].Ts), default=-1)
    offsets = []
    for i, mine in enumerate(seen):
        offset = _offset(mine, tracker[i], target[i], least_m, may_have_both=i != largest)
        if offset is not None:
            offsets.append(replace(offset, place=i))
    return tuple(sorted(offsets, key=lambda o: o.own_m / o.shared_m))


def refuse(offsets: Sequence[FileOffset], where: Sequence[str], *, as_stated: bool) -> tuple[str, ...]:
    """Name them: as an error, or as remarks where the user insists on the data as they are.

    Raises InputError: there are some and the user does not insist.
    """
    if not offsets or as_stated:
        return tuple(f"{o.sentence()}; used as stated, as requested." for o in offsets)
    first = offsets[0]
    others = ", ".join(sorted({o.name for o in offsets[1:]} - {first.name}))
    raise InputError(
        first.sentence(),
        where=where[first.place],
        hint=f"{first.remedy()}, so that it is found by itself"
        + (f"; likewise: {others}" if others else "")
        + ". If the data are right, add --set as_stated=true",
        offsets=tuple(offsets),
    )


@dataclass(frozen=True, eq=False)
class _Seen:
    """A block with the arm's poses (m, 4, 4), its frames (4, 4), and what was measured (m, 4, 4) or (m, 3)."""

    block: TrackerResiduals
    Ts: Float
    Z: Float
    X: Float
    measured: Float

    def error(self, frame: Callable[[Sequence[_Seen]], tuple[Float, HandEye]], T: Float) -> float:
        """Median error with another tracker (``frame`` is that of the tracker) or target."""
        Z, X = (T, self.X) if frame is _tracker_of else (self.Z, T)
        return float(np.median(error_of(self.Ts, self.measured, Z, X)))

    @classmethod
    def of(cls, b: TrackerResiduals, x: Float) -> _Seen:
        return cls(b, b.arm.poses(x), b.tracker.at(x), b.target.at(x), b.p if b.R is None else pose.make(b.R, b.p))


def _pooled(parts: Sequence[Float]) -> Float:
    """Poses together; points, where some have only these."""
    if any(p.ndim == 2 for p in parts):
        parts = [p if p.ndim == 2 else p[:, :3, 3] for p in parts]
    return np.concatenate(parts)


def _tracker_of(seen: Sequence[_Seen]) -> tuple[Float, HandEye]:
    Ts = np.concatenate([s.Ts @ s.X for s in seen])
    estimate = robust_tracker(Ts, _pooled([s.measured for s in seen]), np.eye(4), trials=_TRIALS)
    return estimate.T_base_tracker, estimate


def _target_of(seen: Sequence[_Seen]) -> tuple[Float, HandEye]:
    in_base = [pose.transform(s.Z, s.measured) if s.measured.ndim == 2 else s.Z @ s.measured for s in seen]
    estimate = robust_target(np.concatenate([s.Ts for s in seen]), _pooled(in_base), np.eye(4), trials=_TRIALS)
    return estimate.T_tcp_target, estimate


@dataclass(frozen=True, eq=False)
class _Agreement:
    """Judgement of the other files on one of a file's two frames."""

    of_others: Float | None  # (4, 4) the frame that they agree on; None where nobody shares it
    own: HandEye  # the frame that the file itself would have
    agrees: bool  # the file is one of those that agree


_Frame = Callable[[Sequence[_Seen]], tuple[Float, HandEye]]


def _agreements(
    seen: Sequence[_Seen], fitted: int, names: Sequence[tuple[int, ...]], frame: _Frame
) -> list[_Agreement]:
    """For each file, the frame that most rows of the files that share it agree on."""
    own = [frame([s]) for s in seen]
    out: dict[int, _Agreement] = {}
    for name in dict.fromkeys(names):
        members = [i for i, other in enumerate(names) if other == name and other[0] >= 0]
        best = _largest_group(seen, own, [i for i in members if i < fitted] or members, frame)
        together = frame([seen[i] for i in best])[0] if best else np.eye(4)
        for i in members:
            shared = len(members) > 1
            out[i] = _Agreement(together if shared else None, own[i][1], not shared or i in best)
    return [out.get(i, _Agreement(None, own[i][1], True)) for i in range(len(seen))]


def _largest_group(
    seen: Sequence[_Seen], own: Sequence[tuple[Float, HandEye]], judges: Sequence[int], frame: _Frame
) -> list[int]:
    """The files with the most rows together that agree on the frame of one of them."""
    best: list[int] = []
    for j in sorted(judges, key=lambda i: -len(seen[i].Ts)):
        agreeing = [i for i in judges if seen[i].error(frame, own[j][0]) <= RATIO * own[i][1].median_m]
        group = sorted({j, *agreeing})
        if sum(len(seen[i].Ts) for i in group) > sum(len(seen[i].Ts) for i in best):
            best = group
    return best


def _candidates(
    mine: _Seen, tracker: _Agreement, target: _Agreement, *, may_have_both: bool
) -> list[tuple[str, float, Float, Float, HandEye]]:
    """Frames that a file may have for itself: which, error with the shared one, shared and own pose, own fit."""
    out: list[tuple[str, float, Float, Float, HandEye]] = []
    if tracker.of_others is not None and not tracker.agrees:
        T = tracker.of_others
        out.append(("tracker", mine.error(_tracker_of, T), T, tracker.own.T_base_tracker, tracker.own))
    if target.of_others is not None and not target.agrees:
        T = target.of_others
        out.append(("target", mine.error(_target_of, T), T, target.own.T_tcp_target, target.own))
    shares_both = tracker.of_others is not None and target.of_others is not None
    if may_have_both and shares_both and mine.block.R is not None and len(open_offsets(mine.Ts)) <= 1:
        both = robust_of_poses(mine.Ts, mine.measured, trials=_TRIALS, partly=True)
        now = float(np.median(error_of(mine.Ts, mine.measured, mine.Z, mine.X)))
        out.append(("tracker and target", now, mine.X, both.T_tcp_target, both))
    return out


def _offset(
    mine: _Seen, tracker: _Agreement, target: _Agreement, least_m: float, *, may_have_both: bool
) -> FileOffset | None:
    """The frame of its own that explains a file far better than that of the others, if any."""
    numbers = mine.block.sigma.size
    if len(mine.Ts) < FEWEST:
        return None
    candidates = _candidates(mine, tracker, target, may_have_both=may_have_both)
    best: FileOffset | None = None
    for frame, shared, of_others, of_own, hand_eye in candidates:
        count = _NUMBERS[frame]
        residual_m = float(hand_eye.median_m * np.sqrt(numbers / max(numbers - count, 1)))
        more = best is not None and count > _NUMBERS[best.frame]
        # Twelve numbers nearly always beat six: the wider explanation must leave half of what the simpler one does.
        enough = max(residual_m * _OTHER, _USUAL * least_m) if more else residual_m
        simpler = best is not None and best.own_m < enough
        if simpler or shared < least_m or numbers <= count or residual_m * RATIO > shared:
            continue
        chance = len(candidates) * float(
            scipy.stats.f.sf((shared / max(residual_m, 1e-9)) ** 2, numbers, numbers - count)
        )
        if chance > CHANCE:
            continue
        step = pose.inverse(of_others) @ of_own
        unknown = mine.measured.ndim == 2 and frame == "target"  # points of a target say nothing of its rotation
        turn = 0.0 if unknown else float(np.linalg.norm(rotation.log(step[:3, :3])))
        best = FileOffset(-1, mine.block.name, frame, float(np.linalg.norm(step[:3, 3])), turn, shared, residual_m)
    return best
