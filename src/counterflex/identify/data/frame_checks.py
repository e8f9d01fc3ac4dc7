"""Check a measuring frame: geometry that sees too little, beams that miss, signs, swapped sensors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, MRAD, UM
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.measuring_frame import (
    FEWEST,
    SIX,
    FrameMotion,
    SensorFrame,
    condition,
    feet,
    motion,
    passing,
)

MOST_CONDITION: Final = 100.0
"""Largest by smallest singular value beyond which a motion counts as not seen."""
MOST_TRAVEL_M: Final = 25.0 * MM
"""Change of a distance that no sensor of a measuring frame has in its range."""
OFF_PLANE_M: Final = 10.0 * MM
"""How far a beam may end from the plane that is stated, all rows in the median."""
MOST_PASSING_M: Final = 50.0 * MM
"""How far a normal may pass the reference point where the rotation is not found."""
CONTRADICTION: Final = 5.0
"""Misfit, in the median of the rows, beyond which readings contradict each other."""
BETTER: Final = 4.0
"""How many times smaller another reading must make the misfit to be named."""


def check_rows(data: Dataset, frame: SensorFrame, s_unloaded: Float, s_loaded: Float, reference: Float) -> None:
    """Refuse what cannot give a motion.

    ``s_unloaded``: (n, k) m. ``s_loaded``: (n, k) m. ``reference``: (n, 3) m, axes of the sensors. Raises InputError:
    too few sensors, changes beyond any range, beams that miss their planes, a motion that is not seen, normals that
    pass the reference point.
    """
    _check_numbers(data)
    if len(frame) < FEWEST:
        raise InputError("a displacement takes three sensors", where=frame.where, value=len(frame), limit=">= 3")
    travel = np.abs(s_loaded - s_unloaded)
    if np.any(travel > MOST_TRAVEL_M):
        row, k = (int(i) for i in np.unravel_index(int(np.argmax(travel)), travel.shape))
        raise InputError(
            f"sensor '{frame.names[k]}' changes by more than a sensor of a measuring frame can show",
            where=data.place(row),
            value=f"{travel[row, k] / MM:.4g} mm",
            limit=f"<= {MOST_TRAVEL_M / MM:.0f} mm",
            hint="Check the unit of s_unloaded and s_loaded, and which columns they are",
        )
    off = np.median(np.sum(frame.normal * (feet(frame, s_unloaded) - frame.point), axis=2), axis=0)
    if np.any(np.abs(off) > OFF_PLANE_M):
        k = int(np.nanargmax(np.abs(off)))
        raise InputError(
            f"the beam of sensor '{frame.names[k]}' does not hit its stated plane",
            where=frame.where,
            value=f"{off[k] / MM:.4g} mm in the median",
            limit=f"within {OFF_PLANE_M / MM:.0f} mm",
            hint="Check its position_mm (where it would show zero), direction and point_mm, the unit of its column, "
            "and whether columns are in the order of the sensors",
        )
    worst = 0
    figures = [condition(frame, s, r) for s, r in zip(s_unloaded, reference, strict=True)]
    worst = int(np.argmax([value for value, _ in figures]))
    value, unseen = figures[worst]
    if value > MOST_CONDITION:
        raise InputError(
            f"the sensors do not determine {_motion_words(unseen)}",
            where=data.place(worst),
            value=f"condition {value:.3g}" if value < 1e12 else "condition infinite",
            limit=f"<= {MOST_CONDITION:g}",
            hint="Place three sensors on one face, well apart, two on another and one on a third, as on a cube; or "
            "give three to five on three faces whose normals meet in the measured point for a displacement only",
        )
    if len(frame) < SIX:
        by = passing(frame, s_unloaded, reference)
        if np.any(by > MOST_PASSING_M):
            row, k = (int(i) for i in np.unravel_index(int(np.argmax(by)), by.shape))
            raise InputError(
                f"{len(frame)} sensors give a displacement only of a point that their normals meet in, and that of "
                f"'{frame.names[k]}' passes the measured point",
                where=data.place(row),
                value=f"{by[row, k] / MM:.3g} mm: a turn of 1 mrad would show as {by[row, k] * MRAD / UM:.3g} um",
                limit=f"<= {MOST_PASSING_M / MM:.0f} mm",
                hint="Give six sensors or more, or state the point where they meet as p_tcp_measured_mm",
            )


def _check_numbers(data: Dataset) -> None:
    """Refuse a gap: one reading that is no number leaves no singular values of anything. Raises FileFormatError."""
    for name in ("s_unloaded", "s_loaded", "q", "R_base_frame", "p_base_frame"):
        if data.has(name):
            data.finite(name)


def check_misfit(
    frame: SensorFrame, s_unloaded: Float, s_loaded: Float, stated: FrameMotion, reference: Float
) -> tuple[str, ...]:
    """Say whether readings contradict each other, and which sensor does it, where there are more than are needed.

    Tried are the sign of each sensor, each two exchanged, and each left out.

    ``s_unloaded``: (n, k) m. ``s_loaded``: (n, k) m. ``reference``: (n, 3) m. Returns what is wrong and what to do, in
    words; empty where the readings agree or none is spare.
    """
    if stated.spare < 1:
        return ()
    as_stated = float(np.median(stated.misfit()))
    if as_stated < CONTRADICTION:
        return ()
    alternatives = []
    for change, remedy, sensors, before, after, sigma, at_least in _readings(
        frame, s_unloaded, s_loaded, stated.sigma, stated.d.shape[1]
    ):
        if len(sensors) >= FEWEST and condition(sensors, before[0], reference[0])[0] <= MOST_CONDITION:
            other = motion(sensors, before, after, sigma, reference)
            alternatives.append((max(float(np.median(other.misfit())), 1.0) * at_least, change, remedy))
    alternatives.sort(key=lambda item: item[0])
    k = int(np.argmax(np.median(np.abs(stated.residual / stated.sigma), axis=0)))
    text = (
        f"the sensors of the frame contradict each other: {np.sqrt(np.mean(stated.residual**2)) / UM:.3g} um left, "
        f"{as_stated:.3g} times what their standard deviations give, most at '{frame.names[k]}'"
    )
    if alternatives and as_stated > BETTER * alternatives[0][0]:
        alike = [change for size, change, _ in alternatives[1:] if size <= 1.2 * alternatives[0][0]]
        return (
            f"{text}; they agree ({alternatives[0][0]:.3g} times) if {alternatives[0][1]}"
            + (f"; or if {'; or if '.join(alike[:2])}" if alike else ""),
            f"If so, {alternatives[0][2]}",
        )
    return (text, "Check position, direction and plane of each sensor, the order of the columns, units and sigma")


def _readings(
    frame: SensorFrame, s_unloaded: Float, s_loaded: Float, sigma: Float, unknown: int
) -> Iterator[tuple[str, str, SensorFrame, Float, Float, Float, float]]:
    """Other readings: words, remedy, sensors, readings, standard deviations, factor that handicaps them."""
    k = len(frame)
    for i in range(k):
        after = s_loaded.copy()
        after[:, i] = 2.0 * s_unloaded[:, i] - s_loaded[:, i]
        change = f"sensor '{frame.names[i]}' counts the other way"
        yield change, "write its -1 into signs of s_unloaded and s_loaded", frame, s_unloaded, after, sigma, 1.0
    for i, j in combinations(range(k), 2):
        order = np.arange(k)
        order[[i, j]] = j, i
        change = f"sensors '{frame.names[i]}' and '{frame.names[j]}' are exchanged"
        remedy = "put columns or [[sensors]] in the right order"
        yield change, remedy, frame, s_unloaded[:, order], s_loaded[:, order], sigma[:, order], 1.0
    if k - 1 <= unknown:
        return
    for i in range(k):
        keep = np.arange(k) != i
        fewer = replace(
            frame,
            names=tuple(name for name, used in zip(frame.names, keep, strict=True) if used),
            position=frame.position[keep],
            direction=frame.direction[keep],
            normal=frame.normal[keep],
            point=frame.point[keep],
        )
        # Handicapped by 1.3: a sensor less always fits better, whichever it is.
        change = f"sensor '{frame.names[i]}' is left out"
        remedy = "look at it, or leave its column and its table out"
        yield change, remedy, fewer, s_unloaded[:, keep], s_loaded[:, keep], sigma[:, keep], 1.3


def _motion_words(unseen: Float) -> str:
    """A motion in words: what part of it is large, and along or about which axis."""
    size = np.linalg.norm(unseen[:3])
    turn = np.linalg.norm(unseen[3:]) if len(unseen) == SIX else 0.0
    if turn == 0.0 or size > 5.0 * turn * 100.0 * MM:
        return f"the displacement along {_direction(unseen[:3])}"
    if turn * 100.0 * MM > 5.0 * size:
        return f"the turn about {_direction(unseen[3:])}"
    return f"a turn about {_direction(unseen[3:])} together with a displacement along {_direction(unseen[:3])}"


def _direction(v: Float) -> str:
    v = v / np.linalg.norm(v)
    k = int(np.argmax(np.abs(v)))
    if abs(v[k]) > np.cos(5.0 * DEG):
        return f"the {'xyz'[k]} axis"
    return f"({', '.join(f'{value:.2f}' for value in v * np.sign(v[k]))})"
