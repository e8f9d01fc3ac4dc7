"""A commanded arc as few written arcs and straight pieces as the tolerance allows."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np

from counterflex.core.arrays import Float
from counterflex.programs.gcode.write.arc_fit import arc_error, fit_centre
from counterflex.programs.motion_rows import simplify

T = TypeVar("T")
_LARGEST_PIECE_RAD: Final = 1.9 * math.pi
"""rad. A written piece turns less than a whole turn, so that its start and end tell its angle."""


@dataclass(frozen=True)
class ArcPiece:
    """A stretch of a commanded arc between two of its points."""

    first: int  # Index of its start among the points
    last: int  # Index of its end
    centre: tuple[float, float] | None  # (u, v) m of the arc, or None for a straight piece
    turn_rad: float  # Signed angle of the arc, 0 for a straight piece


def nominal_share(points: Float, centre: Float, turn_rad: float) -> Float:
    """Share of the turn at which nominal points of an arc lie.

    Args:
        points: (n, >=2) m, in plane coordinates, start first, end last, neighbours less than half a turn apart.
        centre: (>=2,) m, nominal centre.
        turn_rad: Signed nominal angle.

    Returns:
        (n,) from 0 to 1, non-decreasing.
    """
    n = len(points)
    if n < 3 or turn_rad == 0.0:
        return np.linspace(0.0, 1.0, n)
    angle = np.unwrap(np.arctan2(points[:, 1] - centre[1], points[:, 0] - centre[0]))
    share = np.clip((angle - angle[0]) / turn_rad, 0.0, 1.0)
    share[0], share[-1] = 0.0, 1.0
    out: Float = np.maximum.accumulate(share)
    return out


def arc_pieces(points: Float, share: Float, turn_rad: float, tolerance_m: float) -> list[ArcPiece]:
    """Cover commanded points of an arc with arcs, and with straight pieces where no arc fits.

    The whole is tried first; what does not fit is halved, and neighbours that fit one arc are joined again. Where the
    arcs come out as numerous as the straight pieces would be, straight pieces are taken.

    Args:
        points: (n, 3) m, in plane coordinates, n >= 2; the start as it will be commanded, then the samples.
        share: (n,) share of the turn of each point.
        turn_rad: Signed nominal angle of the whole.
        tolerance_m: Largest distance of a point from its piece at the same share, m.

    Returns:
        Pieces in order, each starting where the one before ends.
    """
    pieces = _halved(points, share, 0, len(points) - 1, turn_rad, tolerance_m, whole=True)
    if len(pieces) == 1 and pieces[0].centre is not None:
        return pieces
    pieces = _joined(points, share, pieces, turn_rad, tolerance_m)
    straight = straight_pieces(points, share, 0, len(points) - 1, tolerance_m)
    return straight if len(straight) <= len(pieces) else pieces


def written_pieces(
    points: Float, share: Float, turn_rad: float, tolerance_m: float, rounded: Callable[[ArcPiece], T | None]
) -> Iterator[tuple[ArcPiece, T | None]]:
    """Pieces as they can be written: where rounding breaks an arc, straight pieces take its place.

    Args:
        points: See :func:`arc_pieces`, as ``share``, ``turn_rad`` and ``tolerance_m``.
        rounded: What a language writes for an arc, called when all before it is written; None where rounding breaks it.

    Yields:
        Each piece with what ``rounded`` returns, None of a straight one.
    """
    waiting = arc_pieces(points, share, turn_rad, tolerance_m)[::-1]
    while waiting:
        piece = waiting.pop()
        written = None if piece.centre is None else rounded(piece)
        if piece.centre is not None and written is None:
            waiting += straight_pieces(points, share, piece.first, piece.last, tolerance_m)[::-1]
        else:
            yield piece, written


def straight_pieces(points: Float, share: Float, first: int, last: int, tolerance_m: float) -> list[ArcPiece]:
    """Cover the points from ``first`` to ``last`` with as few straight pieces as the tolerance allows.

    Args:
        points: (n, 3) m.
        share: (n,) share of the turn of each point.
        first: Index of the first point.
        last: Index of the last point.
        tolerance_m: Largest distance of a point from its piece at the same share, m.
    """
    vertices = first + simplify(share[first : last + 1], points[first : last + 1], tolerance_m)
    return [ArcPiece(int(a), int(b), None, 0.0) for a, b in itertools.pairwise(vertices)]


def _halved(
    points: Float, share: Float, a: int, b: int, turn_rad: float, tolerance_m: float, *, whole: bool
) -> list[ArcPiece]:
    piece = _fitted(points, share, a, b, turn_rad, tolerance_m, whole=whole)
    if piece is not None:
        return [piece]
    if b - a < 6:
        return straight_pieces(points, share, a, b, tolerance_m)
    middle = (a + b) // 2
    return [
        *_halved(points, share, a, middle, turn_rad, tolerance_m, whole=False),
        *_halved(points, share, middle, b, turn_rad, tolerance_m, whole=False),
    ]


def _fitted(
    points: Float, share: Float, a: int, b: int, turn_rad: float, tolerance_m: float, *, whole: bool
) -> ArcPiece | None:
    """One arc from point a to point b, or None where it does not hold the tolerance."""
    span = float(share[b] - share[a])
    turn = turn_rad * span
    if span <= 0.0 or not (whole or (b - a >= 3 and abs(turn) <= _LARGEST_PIECE_RAD)):
        return None
    part = points[a : b + 1]
    centre = fit_centre(part, turn)
    error = _error(part, (share[a : b + 1] - share[a]) / span, centre, turn)
    return ArcPiece(a, b, centre, turn) if error <= tolerance_m else None


def _joined(points: Float, share: Float, pieces: list[ArcPiece], turn_rad: float, tolerance_m: float) -> list[ArcPiece]:
    """Join neighbours that one arc can cover: halving cuts at the middle, not where the path bends."""
    out = pieces[:1]
    for piece in pieces[1:]:
        union = _fitted(points, share, out[-1].first, piece.last, turn_rad, tolerance_m, whole=False)
        if union is None:
            out.append(piece)
        else:
            out[-1] = union
    return out


def _error(points: Float, share: Float, centre: tuple[float, float], turn_rad: float) -> float:
    """Error of the arc with the angle its ends really span, infinite where that is another turn."""
    start, end = points[0], points[-1]
    a = math.atan2(start[1] - centre[1], start[0] - centre[0])
    b = math.atan2(end[1] - centre[1], end[0] - centre[0])
    turned = b - a + 2.0 * math.pi * round((turn_rad - (b - a)) / (2.0 * math.pi))
    if abs(turned - turn_rad) > 0.25 * abs(turn_rad):
        return math.inf
    return arc_error(points, share, centre, turned)
