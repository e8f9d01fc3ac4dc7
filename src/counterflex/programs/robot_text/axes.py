"""How a robot program holds its tool: upright in the part, or along axes that its motions then carry."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.programs.program import Motion

UPRIGHT_RAD: Final = 5e-5
"""A tool within this of z is along z: posts write three decimals of a degree, the tip is where it is commanded."""


def tilted(Rs_part_tcp: Float) -> bool:
    """Whether a tool frame (n, 3, 3) leaves the part's z anywhere."""
    axes = -Rs_part_tcp[:, :, 2]
    return bool(np.any(np.linalg.norm(axes[:, :2], axis=1) > UPRIGHT_RAD) or np.any(axes[:, 2] < 0.0))


def with_axes(motions: Sequence[Motion], Rs_part_tcp: Float) -> Iterator[Motion]:
    """The motions with the tool axis at their ends as I J K."""
    axes = -Rs_part_tcp[:, :, 2]
    before = axes[0] if len(axes) else None
    for motion, axis in zip(motions, axes, strict=True):
        if before is None:
            return
        start, end = (tuple(float(value) for value in one) for one in (before, axis))
        yield replace(motion, abc_start=(start[0], start[1], start[2]), abc_end=(end[0], end[1], end[2]))
        before = axis
