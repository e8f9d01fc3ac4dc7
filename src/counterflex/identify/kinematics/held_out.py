"""How a geometric calibration is judged: separate data, folds of the postures, whole regions, whole files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, cast

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.progress import Progress, in_parts, share_of, silent
from counterflex.core.units import MM
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.same_postures import regions
from counterflex.identify.geometry.arm_geometry import ArmGeometry
from counterflex.identify.geometry.pose_residuals import TrackerResiduals
from counterflex.identify.kinematics.setup import Setup, used_places
from counterflex.identify.recipe import Figure
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import Folds, HeldOut, Local, cross_validate, position_error, score_separate
from counterflex.identify.solver.residuals import Residuals
from counterflex.identify.solver.solve import Stop

_NO_WEIGHT = 1e-10
_ENOUGH: Final = 8
"""Fewest poses of a part whose frames are found from itself."""
_SPREAD_M: Final = 20.0 * MM
"""Root mean square distance of positions from a line from which they place a tracker."""
_REGIONS: Final = 5
"""Regions of the joint space that are held out one after the other."""


def _weighted(setup: Setup, fit: Fit) -> list[Any]:
    """The blocks with the weights that the fit gave their rows: gross errors count as little in every fold."""
    return [
        replace(cast(Any, b), sigma=b.sigma / np.sqrt(np.maximum(w, _NO_WEIGHT))[:, None])
        for b, w in zip(setup.blocks, fit.weights, strict=True)
    ]


def placed(setup: Setup, unseen: Sequence[Residuals], names: Sequence[str]) -> Local:
    """Frames that only held-out data have, with the residuals that place them.

    A tracker is placed by the positions of its target where these span a plane: it is positions that are judged, and a
    tracker turned after orientations moves them by the error of the arm's orientation times the distance.
    """
    places = {setup.parameters.index(name) for name in names}
    blocks: list[Residuals] = []
    for block in unseen:
        if isinstance(block, TrackerResiduals) and block.R is not None and _spans_a_plane(block.p):
            tracker = {int(i) for i in block.tracker.index if i >= 0}
            target = {int(i) for i in block.target.index if i >= 0}
            if tracker <= places and not target & places:
                block = replace(block, R=None, sigma=block.sigma[:, :3])
        blocks.append(block)
    return Local(tuple(names), tuple(blocks))


def _spans_a_plane(p: Float) -> bool:
    if len(p) < _ENOUGH:
        return False
    s = np.linalg.svd(p - p.mean(axis=0), compute_uv=False) / np.sqrt(len(p))
    return bool(s[1] > _SPREAD_M)


def held_out(setup: Setup, holdout: Sequence[Dataset], folds: int, fit: Fit, progress: Progress = silent) -> HeldOut:
    """Errors of held-out rows: of separate data, or of folds of the postures.

    ``holdout``: Separate data; empty is folds.
    """
    if holdout:
        return score_separate(
            setup.parameters, setup.blocks, setup.unseen, needed=setup.needed,
            local=placed(setup, setup.unseen, setup.local), error=position_error, start=fit.values, progress=progress,
        )  # fmt: skip
    scored = [i for i, b in enumerate(setup.blocks) if isinstance(b, TrackerResiduals)]
    judged = scored or [i for i, b in enumerate(setup.blocks) if b.components[0] in ("distance m", "height m")]
    # What is a gross error has been decided with all rows; the folds only have to stay clear of it.
    weighted = _weighted(setup, fit)
    return cross_validate(
        setup.parameters, weighted, needed=setup.needed, error=position_error, scored=judged, folds=Folds(folds),
        start=fit.values, robust=False, stop=Stop(tolerance=1e-7), progress=progress,
    )  # fmt: skip


def region_errors(setup: Setup, fit: Fit, progress: Progress = silent) -> tuple[tuple[Figure, ...], tuple[str, ...]]:
    """Error of whole regions of the joint space, and of whole files, that their fit had not seen.

    Returns:
        Figures, and what is said of a way of holding out that these data do not allow.
    """
    poses = {
        i: b.arm.q
        for i, b in enumerate(setup.blocks)
        if isinstance(b, TrackerResiduals) and isinstance(b.arm, ArmGeometry)
    }
    if not poses:
        return (), ()
    weighted = _weighted(setup, fit)
    sizes = [len(q) for q in poses.values()]
    every, group = np.concatenate(list(poses.values())), np.concatenate([setup.blocks[i].group for i in poses])
    region = np.split(regions(every, group, _REGIONS), np.cumsum(sizes)[:-1])
    ways = [("region", "whole regions of the joint space", dict(zip(poses, region, strict=True)))]
    if len(poses) > 1 and not setup.local and len({setup.blocks[i].name for i in poses}) > 1:
        ways.append(
            ("file", "whole files", {i: np.full(n, k) for k, (i, n) in enumerate(zip(poses, sizes, strict=True))})
        )
    out: list[Figure] = []
    remarks: list[str] = []
    shares = in_parts(progress, {f"{what} held out": 1.0 for _, what, _ in ways})
    for name, what, parts in ways:
        part_progress = shares[f"{what} held out"]
        part_progress(0.0)
        if len(np.unique(np.concatenate(list(parts.values())))) < 2:
            remarks.append(f"No {what} were held out: there are not two of them.")
            continue
        own = _own_frames(setup, weighted, parts)
        try:
            errors = (
                _refitted_errors(setup, fit, weighted, parts, own, part_progress)
                if any(own)
                else cross_validate(
                    setup.parameters, weighted, needed=setup.needed, error=position_error, scored=list(poses),
                    folds=Folds(parts=parts), start=fit.values, robust=False, stop=Stop(tolerance=1e-6),
                    progress=part_progress,
                )
            )  # fmt: skip
        except CounterflexError as fault:
            remarks.append(f"No error is given for {what} held out: the other data are not sufficient ({fault.what}).")
            continue
        if any(own):
            remarks.append(
                f"Frames that only one of the {what} fixes were identified again from it, to evaluate the arm "
                f"identified from the others."
            )
        (mean, before), (worst, worst_before) = errors.mean(), errors.largest()
        out.append(Figure(f"{name}_mean_mm", f"mean position error, {what} held out", mean / MM, before / MM))
        out.append(
            Figure(f"{name}_largest_mm", f"largest position error, {what} held out", worst / MM, worst_before / MM)
        )
    return tuple(out), tuple(remarks)


def _own_frames(setup: Setup, blocks: Sequence[Any], parts: Mapping[int, Int]) -> list[tuple[str, ...]]:
    """Per part the frames that no other data fix."""
    names, out = setup.parameters.names, []
    for part in range(1 + max(int(np.max(p)) for p in parts.values())):
        rest = used_places([b for i, b in enumerate(blocks) if i not in parts or np.any(parts[i] != part)])
        out.append(tuple(n for n in setup.needed if names.index(n) not in rest))
    return out


def _refitted_errors(
    setup: Setup,
    fit: Fit,
    blocks: Sequence[Any],
    parts: Mapping[int, Int],
    own: Sequence[Sequence[str]],
    progress: Progress,
) -> HeldOut:
    """Errors of parts by an arm that has not seen them, in frames of their own where nobody else has these.

    Raises:
        InputError: A part is too small to find its frames from and to be judged as well.
    """
    scores = []
    for part, local in enumerate(own):
        rest = [b.subset(parts[i] != part) if i in parts else b for i, b in enumerate(blocks)]
        unseen = [blocks[i].subset(p == part) for i, p in parts.items() if np.any(p == part)]
        count = sum(len(b.group) for b in unseen)
        if local and count < _ENOUGH:
            raise InputError("too few poses to identify separate frames and evaluate them", value=count, limit=_ENOUGH)
        one = score_separate(
            setup.parameters, [b for b in rest if len(b.group)], unseen, local=placed(setup, unseen, local),
            error=position_error,
            needed=[n for n in setup.needed if n not in local], start=fit.values, robust=False,
            stop=Stop(tolerance=1e-6),
            progress=share_of(progress, part / len(own), (part + 1) / len(own), f"held out {part + 1} of {len(own)}"),
        )  # fmt: skip
        scores.append(one)
    joined = {
        name: np.concatenate([getattr(h, name) for h in scores])
        for name in ("block", "row", "fold", "nominal", "identified", "gross")
    }
    return HeldOut(**joined, fits=tuple(f for h in scores for f in h.fits))
