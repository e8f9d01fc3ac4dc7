"""Chains of A, FANUC's circle by single points: the controller goes through each three that follow one another."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.errors import ProgramError
from counterflex.geometry.circle import angle_to, circle
from counterflex.programs.program import Motion

_SAME_CIRCLE_M: Final = 5e-6
Fault = Callable[[str, str], ProgramError]


def arcs_of(chain: Sequence[Motion], fault: Fault) -> list[Motion]:
    """The motions of a chain: the first one straight to its point, the others along the circle that all lie on.

    Which three points the controller takes for a piece in a longer chain does not matter where all lie on one circle;
    other chains are refused.

    Args:
        chain: As straight motions.
        fault: Makes the error of a message and a hint.

    Raises:
        ProgramError: The chain is shorter than three, or lies on no single circle.
    """
    if len(chain) < 3:
        raise fault("a chain of A is shorter than three points: it is no circle", "Write C, or L")
    points = [np.asarray(motion.p_end) for motion in chain]
    parts = circle(points[0], points[1], points[2])
    if parts is None:
        raise fault("the points of a chain of A lie on a line", "Write L")
    centre, normal = parts
    radius = float(np.linalg.norm(points[0] - centre))
    off = max(max(abs(float(np.linalg.norm(p - centre)) - radius), abs(float((p - centre) @ normal))) for p in points)
    if off > _SAME_CIRCLE_M:
        raise fault(
            "a chain of A lies on no single circle: what is between its points is the controller's own", "Write C"
        )
    turns = [angle_to(a, b, centre, normal) for a, b in itertools.pairwise(points)]
    return [
        chain[0],
        *(
            replace(motion, kind="arc", p_centre=centre, normal=normal, turn_rad=turn)
            for motion, turn in zip(chain[1:], turns, strict=True)
        ),
    ]
