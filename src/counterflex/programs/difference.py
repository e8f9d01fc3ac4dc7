"""Difference between two programs, motion by motion: moved ends, turned tools, other feeds, points put in."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, MM_PER_MIN, UM
from counterflex.geometry import rotation
from counterflex.programs.program import Motion, Program
from counterflex.programs.robot_text.program import RobotProgram

_LARGEST: Final = 100_000_000  # Most pairs of motions that are compared between two rapids
_LEAST_M: Final = 1e-9
_LEAST_RAD: Final = 1e-9


_SIDES: Final = ("before", "after")


@dataclass(frozen=True)
class Change:
    """A motion of the first program and what became of it."""

    line_before: int  # Its line in the first program
    line_after: int  # The line in the second one that leads to its end
    kind: str  # ``rapid``, ``feed``, ``arc`` or ``dwell``, in the first program
    shift_m: Float  # (3,) m, end after minus end before
    turn_rad: Float  # (3,) rad, of robot programs the rotation vector in part axes, else the difference of A B C
    feed_before_m_s: float  # Programmed speed; 0 of rapids
    feed_after_m_s: float  # Lowest one of its pieces
    off_path_m: float  # Largest distance of the ends of its pieces from the programmed motion: how far it was corrected
    added: int  # Motions of the second program that lead to the same end besides
    files: tuple[str, str] = ("", "")  # Files of both lines; empty for the program's own file

    @property
    def distance_m(self) -> float:
        """Distance by which its end has moved, m."""
        return float(np.linalg.norm(self.shift_m))

    @property
    def largest_m(self) -> float:
        """The larger one of both distances."""
        return max(self.distance_m, self.off_path_m)

    @property
    def changed(self) -> bool:
        """True where anything changed."""
        moved = self.largest_m > _LEAST_M or float(np.linalg.norm(self.turn_rad)) > _LEAST_RAD
        return moved or self.added > 0 or abs(self.feed_after_m_s - self.feed_before_m_s) > 1e-12

    def shown(self) -> dict[str, object]:
        """In shop units."""
        x, y, z = (round(float(value) / UM, 2) + 0.0 for value in self.shift_m)
        a, b, c = (round(float(value) / DEG, 5) + 0.0 for value in self.turn_rad)
        return {
            "line_before": self.line_before, "line_after": self.line_after,
            **{
                f"place_{name}": f"{file}:{line}"
                for name, file, line in zip(_SIDES, self.files, (self.line_before, self.line_after), strict=True)
                if file
            },
            "motion": self.kind,
            "off_path_um": round(self.off_path_m / UM, 2), "x_um": x, "y_um": y, "z_um": z,
            "a_deg": a, "b_deg": b, "c_deg": c,
            "feed_before_mm_min": round(self.feed_before_m_s / MM_PER_MIN, 3),
            "feed_after_mm_min": round(self.feed_after_m_s / MM_PER_MIN, 3),
            "points_added": self.added,
        }  # fmt: skip


def differences(before: Program, after: Program) -> list[Change]:
    """Match the motions of two versions of a program in order and compare them.

    Between two rapids (of which both have as many) each motion of the first program is matched with the one of the
    second that ends nearest, so that the sum of the distances is least and the order is kept; what lies between two
    matches was put in. Waits are matched with waits.

    Args:
        after: The second one, with at least as many motions.

    Raises:
        InputError: They are no versions of one program: rapids and waits differ in number, there are fewer motions, or
            external axes go elsewhere.
    """
    if before.dialect != after.dialect:
        raise InputError(
            "two programs of one language are compared", where=Path(after.name).name, value=after.dialect,
            limit=before.dialect,
        )  # fmt: skip
    _require_same_moves(before, after)
    first, second = _pieces(before.motions), _pieces(after.motions)
    if [kind for kind, _ in first if kind] != [kind for kind, _ in second if kind]:
        raise InputError(
            "the programs are no versions of one: their rapids and waits differ", where=Path(after.name).name,
            value=f"{sum(bool(kind) for kind, _ in second)}",
            limit=f"{sum(bool(kind) for kind, _ in first)}, in the same order",
        )  # fmt: skip
    changes: list[Change] = []
    for (kind, one), (_, other) in zip(first, second, strict=True):
        matched = other if kind else _matched(before, after, one, other)
        last = other[0] - 1 if other else -1
        for i, j in zip(one, matched, strict=True):
            changes.append(_change(before, after, i, range(j if kind else last + 1, j + 1)))
            last = j
    return changes


def _pieces(motions: Sequence[Motion]) -> list[tuple[str, list[int]]]:
    """Motions in order: each rapid and wait alone, with its kind, and what lies between them (perhaps nothing)."""
    out: list[tuple[str, list[int]]] = [("", [])]
    for index, motion in enumerate(motions):
        if motion.kind in ("rapid", "dwell"):
            out += [(motion.kind, [index]), ("", [])]
        else:
            out[-1][1].append(index)
    return out


def _matched(before: Program, after: Program, one: list[int], other: list[int]) -> list[int]:
    """Motions of the second program for those of the first, by least sum of distances; the last ends match."""
    n, m = len(one), len(other)
    if n == 0 and m == 0:
        return []
    if m < n or n == 0:
        name = Path(before.name).name
        first = before.blocks[before.motions[one[0]].block].where(name) if one else Path(after.name).name
        raise InputError(
            "the programs are no versions of one: there are fewer motions in the second"
            if n else "the programs are no versions of one: there are motions where the first has none",
            where=first, value=m, limit=f">= {n}",
        )  # fmt: skip
    if n * m > _LARGEST:
        raise InputError(
            "too many motions between two rapids to be compared", value=f"{n} and {m}", limit=f"product {_LARGEST}"
        )
    ends = np.array([after.motions[j].p_end for j in other])
    total, choice = np.full(m, 0.0), np.zeros((n, m), dtype=np.int32)
    for k, i in enumerate(one):
        cost = np.linalg.norm(ends - before.motions[i].p_end, axis=1)
        if k == 0:
            total = cost
            continue
        least = np.minimum.accumulate(total)
        place = np.maximum.accumulate(np.where(total <= least, np.arange(m), 0))
        choice[k, 1:] = place[:-1]
        total = np.concatenate([[np.inf], least[:-1] + cost[1:]])
    j, out = m - 1, []
    for k in range(n - 1, -1, -1):
        out.append(other[j])
        j = int(choice[k, j])
    return out[::-1]


def _change(before: Program, after: Program, i: int, pieces: range) -> Change:
    j = pieces[-1]
    one, other = before.motions[i], after.motions[j]
    ends = np.array([after.motions[k].p_end for k in pieces])
    return Change(
        line_before=before.blocks[one.block].line,
        line_after=after.blocks[other.block].line,
        files=(before.blocks[one.block].file, after.blocks[other.block].file),
        kind=one.kind,
        shift_m=np.asarray(other.p_end) - np.asarray(one.p_end),
        turn_rad=_turn(before, after, i, j),
        feed_before_m_s=one.feed_m_s,
        feed_after_m_s=min(after.motions[k].feed_m_s for k in pieces),
        off_path_m=0.0 if one.kind in ("rapid", "dwell") else _off_path(one, ends),
        added=len(pieces) - 1,
    )


def _off_path(motion: Motion, points: Float) -> float:
    """Largest distance of points (k, 3) m from a straight motion, or from the circle or cylinder of an arc."""
    p_start, p_end = np.asarray(motion.p_start), np.asarray(motion.p_end)
    if motion.p_centre is not None and motion.normal is not None:
        spoke, start = points - motion.p_centre, p_start - motion.p_centre
        height = spoke @ motion.normal
        radius = np.linalg.norm(spoke - height[:, None] * motion.normal, axis=1) - np.linalg.norm(start)
        low, high = sorted((0.0, float((p_end - motion.p_centre) @ motion.normal)))
        return float(np.hypot(radius, height - np.clip(height, low, high)).max())
    step = p_end - p_start
    share = np.clip((points - p_start) @ step / max(float(step @ step), 1e-30), 0.0, 1.0)
    return float(np.linalg.norm(points - p_start - share[:, None] * step, axis=1).max())


def _turn(before: Program, after: Program, i: int, j: int) -> Float:
    if isinstance(before, RobotProgram) and isinstance(after, RobotProgram):
        if before.Rs_part_tcp is None or after.Rs_part_tcp is None:
            return np.zeros(3)
        return rotation.log(after.Rs_part_tcp[j] @ before.Rs_part_tcp[i].T)
    out: Float = np.array(after.motions[j].abc_end) - np.array(before.motions[i].abc_end)
    return out


def largest_first(changes: Sequence[Change]) -> Iterator[Change]:
    """Those that changed, the largest first."""
    yield from sorted((change for change in changes if change.changed), key=lambda change: -change.largest_m)


def _require_same_moves(before: Program, after: Program) -> None:
    """Refuse programs whose external axes go to other places: their targets are those of another place."""
    moves = [
        [dict(values) for _, values in sorted(one.external.items())] if isinstance(one, RobotProgram) else []
        for one in (before, after)
    ]
    if moves[0] != moves[1]:
        value, limit = (
            ", ".join(f"E{n} {v:g}" for values in own for n, v in sorted(values.items())) or "they stand"
            for own in reversed(moves)
        )
        raise InputError(
            "the programs are no versions of one: external axes go elsewhere", where=Path(after.name).name,
            value=value, limit=limit,
        )  # fmt: skip


def summary(before: Program, after: Program, changes: Sequence[Change]) -> dict[str, object]:
    """Counts and the largest change, in shop units."""
    worst = max(changes, key=lambda change: change.largest_m, default=None)
    return {
        "before": Path(before.name).name, "after": Path(after.name).name, "dialect": before.dialect,
        "motions_before": len(before.motions), "motions_after": len(after.motions),
        "changed": sum(change.changed for change in changes),
        "points_added": sum(change.added for change in changes),
        "largest_um": 0.0 if worst is None else round(worst.largest_m / UM, 2),
        "largest_line": 0 if worst is None else worst.line_before,
        **({} if worst is None or not worst.files[0] else {"largest_place": f"{worst.files[0]}:{worst.line_before}"}),
        "length_before_mm": round(_length_m(before) / MM, 3),
        "length_after_mm": round(_length_m(after) / MM, 3),
    }  # fmt: skip


def _length_m(program: Program) -> float:
    return float(sum(np.linalg.norm(np.asarray(m.p_end) - np.asarray(m.p_start)) for m in program.motions))
