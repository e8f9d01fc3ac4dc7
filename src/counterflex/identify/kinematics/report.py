"""Figures, remarks and pictures of a geometric calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM, MRAD
from counterflex.identify.geometry.arm_geometry import ArmGeometry
from counterflex.identify.geometry.pose_residuals import TrackerResiduals
from counterflex.identify.kinematics.setup import CalibrationSetup
from counterflex.identify.recipe import Curve, Figure, Picture
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import HeldOut

_MOST_NAMED = 10


def headline(setup: CalibrationSetup, held_out: HeldOut, *, separate: bool = False) -> tuple[Figure, ...]:
    """Errors of held-out rows, with the nominal arm in frames of its own beside them, and which rows these are.

    ``separate``: They come from data given for that, else from folds of the postures.
    """
    poses = any(isinstance(b, TrackerResiduals) for b in setup.blocks)
    which = "separate data" if separate else f"{len(held_out.fits)} folds of the postures"
    what = f"position error of held-out poses ({which})" if poses else "error of held-out distances or planes"
    rows = (
        ("holdout_mean_mm", f"mean {what}", held_out.mean()),
        ("holdout_median_mm", f"median {what}", held_out.quantile(0.5)),
        ("holdout_p95_mm", f"{what}, 95 %", held_out.quantile(0.95)),
        ("holdout_largest_mm", f"largest {what}", held_out.largest()),
    )
    return (
        *(Figure(name, text, identified / MM, before / MM) for name, text, (identified, before) in rows),
        Figure("holdout_count", "rows predicted", float(held_out.count)),
        Figure("gross_count", "excluded outliers of the measurement", float(np.sum(held_out.gross))),
    )


def figures(setup: CalibrationSetup, fit: Fit, orders: Mapping[int, Sequence[int]]) -> tuple[Figure, ...]:
    """Residuals of the fit, factors of the stated standard deviations, sizes of what was found."""
    out = []
    for k, (block, residuals, factor) in enumerate(zip(setup.blocks, fit.residuals, fit.sigma_factors, strict=True)):
        off = residuals * block.sigma
        name = f"block{k + 1}"
        length = np.linalg.norm(off[:, :3], axis=1)
        out.append(Figure(f"{name}_median_mm", f"{block.name}: median residual", float(np.median(length)) / MM))
        if off.shape[1] == 6:
            turn = np.linalg.norm(off[:, 3:], axis=1)
            out.append(
                Figure(f"{name}_median_mrad", f"{block.name}: median residual, rotation", float(np.median(turn)) / MRAD)
            )
        out.append(Figure(f"{name}_factor", f"{block.name}: residuals by stated standard deviation", float(factor)))
    out += [
        Figure(f"drive{axis + 1}_order", f"highest order of the periodic error of drive {axis + 1}", float(max(k)))
        for axis, k in sorted(orders.items())
    ]
    out.append(Figure("outliers", "rows with less than half their weight", float(len(fit.outliers))))
    return tuple(out)


def remarks(
    setup: CalibrationSetup, fit: Fit, held_out: HeldOut, orders: Mapping[int, Sequence[int]]
) -> tuple[str, ...]:
    """Sentences for the report."""
    out = []
    for o in fit.outliers[:_MOST_NAMED]:
        index = next(i for i, b in enumerate(setup.blocks) if b.name == o.block)
        block = setup.blocks[index]
        size = float(np.linalg.norm((fit.residuals[index][o.row] * block.sigma[o.row])[:3]))
        group = int(block.group[o.row])
        out.append(f"{o.block}, row {o.row + 1} (group {group}) is off by {size / MM:.3g} mm; weight {o.weight:.2g}.")
    if len(fit.outliers) > _MOST_NAMED:
        out.append(f"{len(fit.outliers) - _MOST_NAMED} further rows were given less than half their weight.")
    how = {
        "off": "Own weight was ignored: on request, or because the data do not determine it.",
        "axes": (
            "The cell file has no masses of the arm: the rotation of axes 2 and 3 under own weight was identified as "
            "six numbers in [axis_sag]; it includes the load on the flange."
        ),
        "cell": "Sag under own weight was taken from the cell file as it is.",
        "masses": "Sag under own weight was adapted by the masses of the bodies; compliances are the cell file's.",
        "torsion": "Sag under own weight was adapted by the torsion compliance of the driven axes.",
    }[setup.model.sag]
    out.append(how)
    if orders:
        named = ", ".join(f"axis {axis + 1}: {', '.join(map(str, k))}" for axis, k in sorted(orders.items()))
        out.append(
            "Periodic errors of the drives lower the error of held-out poses and were kept, periods per turn of "
            f"{named}. They are valid for the measured angles and fade beyond them."
        )
        outside = _outside(setup, sorted(orders))
        if outside > 0.0:
            out.append(
                f"{100.0 * outside:.0f} % of the poses held out lie beyond the angles that were measured, where "
                "periodic errors fade; measure there too."
            )
    if len(held_out.fits) > 1:
        out.append("The periodic errors were selected on other folds of the same poses.")
    return tuple(out)


def _outside(setup: CalibrationSetup, axes: Sequence[int]) -> float:
    """Share of the poses held out in which one of some axes is beyond the angles that were fitted."""
    fitted, unseen = (
        [arm.q[:, axes] for b in blocks if isinstance(arm := getattr(b, "arm", None), ArmGeometry)]
        for blocks in (setup.blocks, setup.unseen)
    )
    if not fitted or not unseen:
        return 0.0
    q, other = np.concatenate(fitted), np.concatenate(unseen)
    return float(np.mean(np.any((other < q.min(axis=0)) | (other > q.max(axis=0)), axis=1)))


def pictures(setup: CalibrationSetup, fit: Fit, held_out: HeldOut) -> tuple[Picture, ...]:
    """Errors of held-out rows in order of size, and residuals over the angles of the axes."""
    good = ~held_out.gross
    share = np.linspace(0.0, 100.0, int(np.sum(good)))
    out = [
        Picture(
            "Errors of held-out rows",
            "share of rows, %",
            "error, mm",
            (
                Curve("nominal, frames fitted", share, np.sort(held_out.nominal[good]) / MM, line=True),
                Curve("calibrated", share, np.sort(held_out.identified[good]) / MM, line=True),
            ),
        )
    ]
    pairs = [
        (b.arm.q, np.linalg.norm((r * b.sigma)[:, :3], axis=1))
        for b, r in zip(setup.blocks, fit.residuals, strict=True)
        if isinstance(b, TrackerResiduals) and isinstance(b.arm, ArmGeometry)
    ]
    if pairs:
        q: Float = np.concatenate([angles for angles, _ in pairs])
        off = np.concatenate([length for _, length in pairs]) / MM
        usual = off <= 10.0 * np.median(off)
        curves = tuple(Curve(f"axis {i + 1}", np.degrees(q[usual, i]), off[usual]) for i in range(3))
        out.append(Picture("Residuals over the angles of axes 1 to 3", "angle, deg", "position residual, mm", curves))
    return tuple(out)
