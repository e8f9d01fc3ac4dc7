"""Calibrated geometry: constant displacements behind the segments of a nominal robot and end effector.

What follows a segment is displaced against the nominal geometry, constant in the segment's frame::

    T_seg_next = D(d) T_seg_next,nominal        D(d) = Trans(d_0..2) Exp(d_3..5)

For a driven segment the rotation about z is a constant error of its angle (times its sign).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float, frozen
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import MM, MRAD
from counterflex.geometry import pose, rotation
from counterflex.robot.model.description import EndEffector, Robot, Segment

BASE: Final = "base"
"""Displaces the whole chain in the base frame."""
TCP: Final = "tcp"
"""Displaces the tool centre point in its own frame: ``T_last_tcp D``."""
LARGEST_M: Final = 100.0 * MM
LARGEST_RAD: Final = 100.0 * MRAD


def displacement(d: Float) -> Float:
    """Pose (..., 4, 4) of a displacement (..., 6) m, rad: translation and rotation vector."""
    return pose.make(rotation.exp(d[..., 3:]), d[..., :3])


def places(robot: Robot, end_effector: EndEffector) -> tuple[str, ...]:
    """Places where a calibration can act: ``base``, every segment from the base outward, ``tcp``."""
    return (BASE, *(s.name for s in (*robot.segments, *end_effector.segments)), TCP)


def calibrated(
    robot: Robot, end_effector: EndEffector, displacements: Mapping[str, Float]
) -> tuple[Robot, EndEffector]:
    """Apply displacements to a nominal description.

    Args:
        robot: Nominal; its closed-form geometry is kept (it is what the controller computes with, and a seed).
        end_effector: Nominal.
        displacements: (6,) m, rad by place, see :func:`places`.

    Raises:
        InputError: An unknown place, a wrong shape or a number that is not finite.
        ModelError: A displacement beyond 100 mm or 100 mrad, which is no calibration but another geometry.
    """
    known = places(robot, end_effector)
    moves: dict[str, Float] = {}
    for name, value in displacements.items():
        if name not in known:
            raise InputError("there is no such segment to calibrate", value=name, limit=", ".join(known))
        d = as_float(f"calibration of {name}", value, (6,))
        if np.max(np.abs(d[:3])) > LARGEST_M or np.max(np.abs(d[3:])) > LARGEST_RAD:
            raise ModelError(
                "a calibration is far too large",
                where=name,
                value=f"{np.max(np.abs(d[:3])) / MM:.4g} mm, {np.max(np.abs(d[3:])) / MRAD:.4g} mrad",
                limit=f"<= {LARGEST_M / MM:g} mm, {LARGEST_RAD / MRAD:g} mrad",
                hint="Check units and frames; another geometry belongs into robot.geometry",
            )
        moves[name] = displacement(d)
    if not moves:
        return robot, end_effector
    arm, next_move = _moved(robot.segments, moves, moves.get(BASE))
    T_last_flange: Float = robot.T_last_flange if next_move is None else next_move @ robot.T_last_flange
    hand, next_move = _moved(end_effector.segments, moves, None)
    T_last_tcp: Float = end_effector.T_last_tcp if next_move is None else next_move @ end_effector.T_last_tcp
    if TCP in moves:
        T_last_tcp = T_last_tcp @ moves[TCP]
    return (
        replace(robot, segments=arm, T_last_flange=frozen(T_last_flange)),
        EndEffector(hand, frozen(T_last_tcp)),
    )


def _moved(
    segments: tuple[Segment, ...], moves: Mapping[str, Float], before: Float | None
) -> tuple[tuple[Segment, ...], Float | None]:
    out = []
    for segment in segments:
        out.append(segment if before is None else replace(segment, T_prev_seg=frozen(before @ segment.T_prev_seg)))
        # Displaced is what follows a segment: the move waits for the next pose, of the flange if none follows.
        before = moves.get(segment.name)
    return tuple(out), before
