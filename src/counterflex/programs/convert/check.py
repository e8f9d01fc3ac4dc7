"""Check of a written program, read back: the same path, speeds and process words, or nothing is written."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Final

import numpy as np

from counterflex.core.errors import OutputError
from counterflex.core.units import DEG, UM
from counterflex.geometry import rotation
from counterflex.programs.convert.steps import MachineFunction, Move, Step

SAME_M: Final = 1.0 * UM
"""Largest distance of a point that is read back from where it was."""
SAME_RAD: Final = 2e-6
_SAME_FEED: Final = 1e-4
_SAME_RPM: Final = 0.51
_STOPS: Final = frozenset((0, 1))


def refuse_other_path(
    source: Sequence[Step],
    pieces: dict[int, list[float]],
    back: Sequence[Step],
    *,
    tolerance_m: float,
    whole_frame: bool,
) -> float:
    """Compare what a program does with what is read back.

    Args:
        source: Steps of the program.
        pieces: See :class:`~counterflex.programs.convert.emitter.Written`.
        back: Steps of what was written.
        tolerance_m: Allowed in the middle of pieces of a circle.
        whole_frame: The language states the rotation about the tool axis too.

    Returns:
        Largest distance of points, m.

    Raises:
        OutputError: They are not the same.
    """
    moves = [step for step in source if isinstance(step, Move) and step.index in pieces]
    read = [step for step in back if isinstance(step, Move)]
    expected = [(move, ends) for move in moves for ends in itertools.pairwise([0.0, *(pieces[move.index] or [1.0])])]
    if len(read) != len(expected):
        raise _fault(moves[-1].line if moves else 1, f"{len(read)} motions", f"{len(expected)} motions")
    worst = 0.0
    for at, ((move, ends), other) in enumerate(zip(expected, read, strict=True)):
        off = _compared(move, ends, other, first=at == 0, whole_frame=whole_frame, tolerance_m=tolerance_m)
        worst = max(worst, off)
    _compare_words(_functions(source), _functions(back))
    return worst


def _compared(
    move: Move, ends: tuple[float, float], other: Move, *, first: bool, whole_frame: bool, tolerance_m: float
) -> float:
    """Distance of a piece between two shares of a move that is read back, m."""
    motion, made, (begin, share) = move.motion, other.motion, ends
    if (motion.kind == "dwell") != (made.kind == "dwell"):
        raise _fault(move.line, made.kind, motion.kind)
    if motion.kind == "dwell":
        if abs(motion.duration_s - made.duration_s) > 1e-3:
            raise _fault(move.line, f"a wait of {made.duration_s:g} s", f"{motion.duration_s:g} s")
        return 0.0
    known = ["XYZ".index(letter) for letter in move.named]
    off = float(np.linalg.norm((move.at(share) - np.asarray(made.p_end))[known]))
    if off > SAME_M:
        raise _fault(move.line, f"its end is {off / UM:.2f} um off", f"{SAME_M / UM:g} um")
    if motion.kind == "arc" and not first and len(known) == 3:
        between = float(np.linalg.norm(move.at(0.5 * (begin + share)) - other.at(0.5)))
        if between > SAME_M + (tolerance_m if made.kind != "arc" else 0.0):
            raise _fault(move.line, f"its middle is {between / UM:.2f} um off", f"{SAME_M / UM:g} um")
        off = max(off, between)
    if share >= 1.0 and (turned := _turned(move, other, whole_frame)) > SAME_RAD:
        raise _fault(move.line, f"the tool is turned by {turned / DEG:.5f} deg", f"{SAME_RAD / DEG:.5f} deg")
    if "rapid" not in (motion.kind, made.kind) and abs(made.feed_m_s / motion.feed_m_s - 1.0) > _SAME_FEED:
        raise _fault(move.line, f"{made.feed_m_s * 1e3:g} mm/s", f"{motion.feed_m_s * 1e3:g} mm/s")
    return off


def _functions(steps: Sequence[Step]) -> list[MachineFunction]:
    return [step for step in steps if isinstance(step, MachineFunction)]


def _turned(move: Move, other: Move, whole_frame: bool) -> float:
    """Angle between the orientations at two ends, rad; without the rotation about the tool its sine."""
    if whole_frame:
        return float(np.linalg.norm(rotation.log(move.R_part_tcp.T @ other.R_part_tcp)))
    return float(np.linalg.norm(np.cross(move.axis, other.axis)))


def _compare_words(source: Sequence[MachineFunction], back: Sequence[MachineFunction]) -> None:
    for index, step in enumerate(source):
        other = back[index] if index < len(back) else None
        if other is None or not _same(step, other):
            raise OutputError(
                "a process word is not read back as it was", where=f"line {step.line}",
                value="nothing" if other is None else _shown(other), limit=_shown(step),
                hint="The reader of that language gives its stop no word M0"
                if step.code in _STOPS
                else "Let each function have statements of its own in [controller.spindle], with {s} and {t}",
            )  # fmt: skip
    if len(back) > len(source):
        raise OutputError("more process words are read back than there were", value=_shown(back[len(source)]))


def _same(step: MachineFunction, other: MachineFunction) -> bool:
    if step.code in _STOPS and other.code in _STOPS:
        return True
    one, two = step.words, other.words
    return len(one) == len(two) and all(
        a[0] == b[0] and abs(a[1] - b[1]) <= (_SAME_RPM if a[0] == "S" else 1e-9) for a, b in zip(one, two, strict=True)
    )


def _shown(step: MachineFunction) -> str:
    return " ".join(f"{letter}{value:g}" for letter, value in step.words)


def _fault(line: int, value: str, limit: str) -> OutputError:
    return OutputError(
        "a motion is not read back as it was", where=f"line {line}", value=value, limit=limit,
        hint="Nothing is written. Post the path in the other language",
    )  # fmt: skip
