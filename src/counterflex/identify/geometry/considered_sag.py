"""Uncertainty of the sag that a geometric calibration takes as known: compliances, and where they act.

Weight bends the same arm in the same way in all poses. A compliance that is off by a tenth, or an element that turns
10 mm beside where it is thought to, passes for a displacement of the geometry in part, which no residual shows: its
standard deviation goes through the fit (:mod:`counterflex.identify.solver.jackknife`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final, cast

import numpy as np

from counterflex.core.arrays import Float, frozen
from counterflex.identify.geometry.arm_geometry import ArmGeometry
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.jackknife import added, considered, parts_of_groups, with_jackknife
from counterflex.identify.solver.residuals import Residuals

# Steps for a difference, scaled to a standard deviation afterwards: large against rounding, small against curvature.
_STEP, _STEP_M = 1e-2, 1e-3
_ARMS: Final = ("arm", "second")

Change = Callable[[ArmGeometry], ArmGeometry]


def with_honest_sigma(fit: Fit, blocks: Sequence[Residuals], compliance: float, bearing_m: float) -> Fit:
    """The fit with standard deviations that hold for what the model of the arm lacks.

    ``compliance``: Relative standard deviation of the compliances that are not fitted. ``bearing_m``: Standard
    deviation, per axis, of the points that the elements turn about.

    Returns:
        Standard deviations not below those of the jackknife over postures (drives, play, drift), and what is known of
        the sag may be off by.
    """
    wide = with_jackknife(fit, blocks, parts_of_groups(blocks))
    moved = sag_moved(blocks, fit.values, compliance, bearing_m)
    return added(wide, considered(fit, blocks, moved)) if moved[0].shape[2] else wide


def sag_moved(blocks: Sequence[Residuals], x: Float, share: float, bearing_m: float) -> list[Float]:
    """Changes of the measured values by one standard deviation of each quantity that the sag depends on.

    Args:
        blocks: Residuals, those with an arm that sags and others.
        x: (p,) values.
        share: Relative standard deviation of a compliance that is not fitted.
        bearing_m: See :func:`with_honest_sigma`; an element that turns b beside where it is thought to feels the
            moment ``b x f`` more of the weight f behind it.

    Returns:
        Per block (rows, components, m) in the units of the components: a column for each elastic direction, and three
        for each element that turns.
    """
    changes = _changes_of(blocks, share, bearing_m)
    out = []
    for block in blocks:
        before = block.evaluate(x)
        moved = np.zeros((*before.shape, len(changes)))
        for k, (change, scale) in enumerate(changes):
            moved[:, :, k] = (before - _changed(block, change).evaluate(x)) * block.sigma * scale
        out.append(moved)
    return out


def _changes_of(blocks: Sequence[Residuals], share: float, bearing_m: float) -> list[tuple[Change, float]]:
    """Steps of the compliances that are not fitted and of the bearings, each with how many a standard deviation is."""
    arms = [arm for b in blocks for name in _ARMS if isinstance(arm := getattr(b, name, None), ArmGeometry)]
    bent = next((arm for arm in arms if arm.loads is not None), None)
    if bent is None:
        return []
    soft = [(int(i), int(d)) for i, d in np.argwhere(bent.chain.compliance > 0.0)]
    changes = [(_softer(place), share / _STEP) for place in soft if place not in bent.layout.soft]
    turning = sorted({i for i, d in soft if d >= 3})
    return changes + [(_aside(i, axis), bearing_m / _STEP_M) for i in turning for axis in range(3)]


def _changed(block: Residuals, change: Change) -> Residuals:
    arms = {
        name: change(arm)
        for name in _ARMS
        if isinstance(arm := getattr(block, name, None), ArmGeometry) and arm.loads is not None
    }
    return cast(Residuals, replace(cast(Any, block), **arms)) if arms else block


def _softer(place: tuple[int, int]) -> Change:
    def change(arm: ArmGeometry) -> ArmGeometry:
        compliance = np.array(arm.chain.compliance)
        compliance[place] *= 1.0 + _STEP
        return replace(arm, chain=replace(arm.chain, compliance=frozen(compliance)))

    return change


def _aside(segment: int, axis: int) -> Change:
    def change(arm: ArmGeometry) -> ArmGeometry:
        loads = np.array(arm.loads)
        loads[:, segment, 3:] += np.cross(_STEP_M * np.eye(3)[axis], loads[:, segment, :3])
        return replace(arm, loads=loads)

    return change
