"""Judge a geometric calibration: by separate data, folds of the postures, whole regions, whole files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, cast

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.progress import Progress, in_parts, share_of, silent
from counterflex.core.units import MM, URAD
from counterflex.identify.data.data_checks import regions
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.geometry.arm_geometry import ArmGeometry
from counterflex.identify.geometry.pose_residuals import TrackerResiduals
from counterflex.identify.kinematics.approach_sense import CHANNEL, PRIOR_RAD, SEEN, in_order, senses
from counterflex.identify.kinematics.setup import POSE_KINDS, CalibrationSetup, by_channel, used_places
from counterflex.identify.recipe import Figure
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import Folds, HeldOut, Local, cross_validate, position_error, score_separate
from counterflex.identify.solver.residuals import Residuals
from counterflex.identify.solver.solve import Stop

# Residuals that depend on the side from which the axes came, where lost motion is not fitted. Half of the lost motion h
# of each axis moves a row by ``G_a s_a h_a``, s the sense of approach and G the derivative by the angle of the axis.
# All parameters of the fit move with it, to first order (covariance C, Jacobian J, residuals r)::
#
# S = K^T K - K^T J C J^T K + 1 / prior^2,   g = K^T r,   h = S^-1 g,   K_a = G_a s_a
#
# ``g^T S^-1 g`` is how much h lowers the sum of squares. Residuals of a real arm are no white noise, so chance is
# counted, not computed: the same with the senses dealt to the rows anew, :data:`DEALS` times.

DEALS: Final = 499
"""Times that the senses are dealt anew."""
CHANCE: Final = 0.005
"""Share of the deals that may lower the residuals as much."""
FEWEST: Final = 20
"""Rows below which nothing is looked for."""
_STEP_RAD: Final = 1e-5


def approach_remarks(setup: CalibrationSetup, fit: Fit, data: Sequence[Dataset]) -> tuple[str, ...]:
    """Say by how much the residuals depend on the direction of approach, by the order of the rows."""
    sense = _senses(data)
    blocks = list(_postures(setup))
    if len(blocks) != len(sense) or not blocks or len(np.concatenate(sense)) < FEWEST:
        return ()
    rows, s = _rows_of(setup, fit, blocks), np.concatenate(sense)
    h, sigma, gain = rows.lost(s)
    rng = np.random.default_rng(0)
    others = np.array([rows.lost(s[rng.permutation(len(s))])[2] for _ in range(DEALS)])
    chance = (1.0 + float(np.sum(others >= gain))) / (1.0 + DEALS)
    axes = [a for a in range(len(h)) if h[a] > SEEN * sigma[a]]
    if chance > CHANCE or not axes:
        return ()
    size = _moved(setup, fit, blocks, sense, np.where(np.isin(np.arange(len(h)), axes), h, 0.0))
    named = ", ".join(f"axis {a + 1} +-{h[a] / URAD:.0f} urad" for a in axes)
    known = all(d.has(CHANNEL) for d in data if d.kind in POSE_KINDS)
    how = "" if known else " (if the rows stand in the order in which they were measured)"
    return (
        f"The residuals depend on the direction of approach{how}: {named}, {np.mean(size) / MM:.2g} mm at the target "
        f"in the mean and {np.max(size) / MM:.2g} mm at most (chance {chance:.2g}). Lost motion was not fitted: "
        f"--set play={'known' if known else 'order'} fits it and keeps it if poses held out are predicted better.",
    )


def _senses(data: Sequence[Dataset]) -> list[Float]:
    """(m, 6) senses of each part of each dataset of poses, in the order of its residuals."""
    out = []
    for d in data:
        if d.kind in POSE_KINDS:
            stated = d if d.has(CHANNEL) else replace(d, channels={**d.channels, CHANNEL: in_order(d)})
            out += [s for _, part in by_channel(stated, "target") if (s := senses(part)) is not None]
    return out


def _by_angle(b: TrackerResiduals, x: Float) -> Float:
    """(n, c, 6) derivative of weighted residuals by minus the angle of each axis."""
    before = b.evaluate(x)
    out = np.zeros((*before.shape, 6))
    for axis in range(6):
        out[:, :, axis] = (_turned(b, _STEP_RAD * np.eye(6)[axis]).evaluate(x) - before) / _STEP_RAD
    return out


def _turned(b: TrackerResiduals, back: Float) -> TrackerResiduals:
    """The residuals of an arm whose links stay behind by (6,) or (n, 6) rad."""
    return replace(b, arm=replace(cast(ArmGeometry, b.arm), q=cast(ArmGeometry, b.arm).q - back))


@dataclass(frozen=True, eq=False)
class _Rows:
    """Weighted numbers of all rows: residuals, derivatives by parameters and by angles, row of each; covariance."""

    r: Float
    J: Float
    G: Float
    row: Int
    C: Float

    def lost(self, s: Float) -> tuple[Float, Float, float]:
        """Half of the lost motion (6,) rad, its standard deviation, and by how much it lowers the sum of squares."""
        K = -self.G * s[self.row]
        A = self.J.T @ K
        S = K.T @ K - A.T @ self.C @ A + np.eye(6) / PRIOR_RAD**2
        g = K.T @ self.r
        h = np.asarray(np.linalg.solve(S, g), dtype=np.float64)
        sigma = np.asarray(np.sqrt(np.diag(np.linalg.inv(S))), dtype=np.float64)
        return h, sigma, float(g @ h)


def _moved(setup: CalibrationSetup, fit: Fit, blocks: Sequence[int], sense: Sequence[Float], h: Float) -> Float:
    """(n,) m by which lost motion moves the target."""
    out = []
    for i, s in zip(blocks, sense, strict=True):
        b = cast(TrackerResiduals, setup.blocks[i])
        moved = _turned(b, s * h).evaluate(fit.values) - b.evaluate(fit.values)
        out.append(np.linalg.norm((moved * b.sigma)[:, :3], axis=1))
    return np.concatenate(out)


_NO_WEIGHT = 1e-10
_ENOUGH: Final = 8
"""Fewest poses of a part whose frames are found from itself."""
_SPREAD_M: Final = 20.0 * MM
"""Root mean square distance of positions from a line from which they place a tracker."""
_REGIONS: Final = 5
"""Regions of the joint space that are held out one after the other."""


def _weighted(setup: CalibrationSetup, fit: Fit) -> list[Any]:
    """The blocks with the weights that the fit gave their rows: gross errors count as little in every fold."""
    return [
        replace(cast(Any, b), sigma=b.sigma / np.sqrt(np.maximum(w, _NO_WEIGHT))[:, None])
        for b, w in zip(setup.blocks, fit.weights, strict=True)
    ]


def placed(setup: CalibrationSetup, unseen: Sequence[Residuals], names: Sequence[str]) -> Local:
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


def held_out(
    setup: CalibrationSetup, holdout: Sequence[Dataset], folds: int, fit: Fit, progress: Progress = silent
) -> HeldOut:
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


def _postures(setup: CalibrationSetup) -> dict[int, Float]:
    """(m, 6) rad of each block in which the tracker sees the arm, by the place of the block."""
    return {
        i: b.arm.q
        for i, b in enumerate(setup.blocks)
        if isinstance(b, TrackerResiduals) and isinstance(b.arm, ArmGeometry)
    }


def _rows_of(setup: CalibrationSetup, fit: Fit, blocks: Sequence[int]) -> _Rows:
    """Weighted residuals of blocks, with their derivatives by the fitted parameters and by the angles."""
    free, x = fit.free_index, fit.values
    slope = fit.parameters.slope(x)[free]
    r, J, G, row = [], [], [], []
    first = 0
    for i in blocks:
        b, scale = cast(TrackerResiduals, setup.blocks[i]), np.sqrt(fit.weights[i])[:, None] / fit.sigma_factors[i]
        r.append((b.evaluate(x) * scale).ravel())
        J.append((b.jacobian(x)[:, :, free] * slope * scale[:, :, None]).reshape(-1, len(free)))
        G.append((_by_angle(b, x) * scale[:, :, None]).reshape(-1, 6))
        row.append(np.repeat(np.arange(first, first + len(b.group)), len(b.components)))
        first += len(b.group)
    return _Rows(np.concatenate(r), np.concatenate(J), np.concatenate(G), np.concatenate(row), fit.covariance)


def region_errors(
    setup: CalibrationSetup, fit: Fit, progress: Progress = silent
) -> tuple[tuple[Figure, ...], tuple[str, ...]]:
    """Error of whole regions of the joint space, and of whole files, that their fit had not seen.

    Returns figures, and what is said of a way of holding out that these data do not allow.
    """
    poses = _postures(setup)
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


def _own_frames(setup: CalibrationSetup, blocks: Sequence[Any], parts: Mapping[int, Int]) -> list[tuple[str, ...]]:
    """Per part the frames that no other data fix."""
    names, out = setup.parameters.names, []
    for part in range(1 + max(int(np.max(p)) for p in parts.values())):
        rest = used_places([b for i, b in enumerate(blocks) if i not in parts or np.any(parts[i] != part)])
        out.append(tuple(n for n in setup.needed if names.index(n) not in rest))
    return out


def _refitted_errors(
    setup: CalibrationSetup,
    fit: Fit,
    blocks: Sequence[Any],
    parts: Mapping[int, Int],
    own: Sequence[Sequence[str]],
    progress: Progress,
) -> HeldOut:
    """Errors of parts by an arm that has not seen them, in frames of their own where nobody else has these."""
    # A part has to be large enough to find its frames from and to be judged as well.
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
    return _joined(scores)


def _joined(scores: Sequence[HeldOut]) -> HeldOut:
    names = ("block", "row", "fold", "nominal", "identified", "gross")
    joined = {name: np.concatenate([getattr(h, name) for h in scores]) for name in names}
    return HeldOut(**joined, fits=tuple(f for h in scores for f in h.fits))
