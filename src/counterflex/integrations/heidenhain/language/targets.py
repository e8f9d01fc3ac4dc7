"""Motions of Klartext: L, LP, LN, C, CP, CR, CT, CTP, RND, dwells and drilling cycles.

Source: HEIDENHAIN TNC 640 (34059x-05), Conversational Programming, "Path contours" in Cartesian and polar coordinates;
iTNC 530 (60642x-03), "Corner rounding RND" (tangential to both elements, its feed acts in its block only).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MINUTE, RPM
from counterflex.integrations.heidenhain.language.state import KlartextState
from counterflex.integrations.heidenhain.language.values import TILT_ANGLES
from counterflex.integrations.heidenhain.language.words import AXES, ROTARY, PathWords, WordItem
from counterflex.programs.gcode.read.motion import FARTHEST_M
from counterflex.programs.program import Motion, MotionKind, Word
from counterflex.programs.unknown import Unknown

_VECTOR: Final = ("TX", "TY", "TZ")
_PLACE: Final = "Retract in coordinates of the part: L Z+100 R0 FMAX"
_NAME_ALL: Final = "Write X, Y and Z without I"


class KlartextTargets:
    """Turns path statements into motions and moves the state along.

    Args:
        state: Moved along.
        listed: Motions to and from places that are not known are made, and marked.
    """

    def __init__(self, state: KlartextState, listed: bool = False) -> None:
        self._state, self._listed = state, listed
        self.motions: list[Motion] = []  # Everything made so far
        self.away = ""  # Where the tool went to a place that is not known (``M91 in line 12``); empty while it is known
        # Coordinates of blocks before that the last motion reaches too, without a place in its text
        self.joined: tuple[Word, ...] = ()
        # Rounding radius, m, feed, m/s, block and words of an RND whose second line is still to come
        self.corner: tuple[float, float, int, PathWords] | None = None

    # ---- elementary motions ------------------------------------------------------------------------------------

    def _append(
        self,
        number: int,
        kind: MotionKind,
        p_end: Float,
        feed: tuple[float, float] = (0.0, 0.0),
        angles: tuple[float, float, float] | None = None,
        duration_s: float = 0.0,
        arc: tuple[Float, Float, float] | None = None,
    ) -> None:
        state = self._state
        angles = state.angles if angles is None else angles
        centre, normal, turn = arc if arc is not None else (None, None, 0.0)
        p_end.flags.writeable = False
        lost = "".join(c for axis, c in enumerate(AXES) if axis not in state.named) if self._listed else ""
        self.motions.append(
            Motion(
                block=number,
                kind=kind,
                p_start=state.p_part,
                p_end=p_end,
                feed_m_s=feed[0],
                spindle_rad_s=state.spindle * state.speed_rpm * RPM,
                tool=state.tool,
                duration_s=duration_s,
                abc_start=state.angles,
                abc_end=angles,
                p_centre=centre,
                normal=normal,
                turn_rad=turn,
                feed_rad_s=feed[1],
                unknown=lost,
            )
        )
        state.p_part, state.angles = p_end, angles

    def _feed(self, words: PathWords, length_m: float, angle_rad: float) -> tuple[float, float]:
        """Feed of a motion of that length in m/s and, where only rotary axes turn, in rad/s."""
        state = self._state
        if not state.feed or state.feed < 0.0:
            raise words.fault("a feed move without a feed", None, "Write F in this block or before, or FMAX")
        per_minute = state.feed
        if state.per_turn:
            if state.spindle * state.speed_rpm == 0.0:
                raise words.fault("feed per revolution with the spindle stopped", "FU", "Write TOOL CALL with S and M3")
            per_minute *= state.speed_rpm
        if length_m == 0.0 and angle_rad > 0.0:
            return 0.0, per_minute * DEG / MINUTE
        return per_minute * (state.unit_m if state.per_turn else state.feed_unit_m) / MINUTE, 0.0

    def leave(self, number: int, name: str, line: int, axes: set[int]) -> None:
        """Go to a place of the machine that is not known."""
        self._state.named -= axes
        if self._listed:
            self._append(number, "rapid", self._state.p_part.copy())
        elif self.motions and not self.away:
            self.away = f"{name} in line {line}"

    def require_place(self, words: PathWords) -> None:
        """Refuse a motion from a place that is not known. Raises ProgramError: it begins at one."""
        if self.away:
            raise words.fault(
                f"the program moves on after {self.away}, and where that leads is not known", None, _PLACE
            )

    def require_axes(self, words: PathWords, what: str) -> None:
        """Refuse a motion that needs to know where the tool stands.

        Raises:
            ProgramError: It is not known along an axis.
        """
        state = self._state
        lost = [letter for axis, letter in enumerate(AXES) if axis not in state.named]
        if lost and (not state.start_known or state.partial is not None) and not self._listed:
            raise words.fault(f"{what} while it is not known where the tool is along {' and '.join(lost)}", None,
                              f"Go there with FMAX before: L {lost[0]}... R0 FMAX")  # fmt: skip
        if not state.aligned:
            raise words.fault(f"{what} before the tool has been turned to the tilted plane", None,
                              "PLANE ... TURN or MOVE, or L A+Q120 B+Q121 C+Q122 R0 FMAX")  # fmt: skip

    def dwell(self, number: int, time_s: float) -> None:
        """Wait."""
        if not self.away:
            self._append(number, "dwell", self._state.p_part, duration_s=time_s)

    # ---- targets -----------------------------------------------------------------------------------------------

    def target(self, words: PathWords, *, rapid: bool, p_plane: tuple[float, float] | None = None) -> Float | None:
        """Return the end point in the part; None where a tilted plane does not know it yet.

        Args:
            words: Their axes are used.
            rapid: Axes of a new plane may be named one after the other.
            p_plane: Coordinates in the plane of the state, m, where polar words gave them.
        """
        state = self._state
        given: dict[int, tuple[float, bool]] = {}
        for axis, letter in enumerate(AXES):
            named = words.coordinate(letter)
            if named is not None:
                given[axis] = named[0] * state.unit_m, named[1]
        for axis, value in zip(state.plane, p_plane or (), strict=False):
            given[axis] = value, False
        self._check_frame(words, given)
        if state.partial is not None:
            return self._named_in_new_plane(words, given, rapid)
        p_work = state.to_work(state.p_part) if state.is_turned else state.p_part - state.frames.t
        for axis, (value, incremental) in given.items():
            p_work[axis] = value + (p_work[axis] if incremental else 0.0)
            if not incremental:
                state.named.add(axis)
                state.shifted.discard(axis)
        if state.is_turned:
            if given and len(state.named) < 3:
                raise words.fault("a motion in a rotated frame before X, Y and Z have all been named", None, _NAME_ALL)
            p_part = state.to_part(p_work) if given else state.p_part.copy()
        else:
            p_part = state.p_part.copy()
            for axis in given:
                p_part[axis] = state.frames.t[axis] + p_work[axis]
        return self._reachable(words, p_part)

    def _reachable(self, words: PathWords, p_part: Float) -> Float:
        if not np.all(np.abs(p_part) <= FARTHEST_M):
            raise words.fault("the target is beyond any machine", None, "At most 1000 m")
        return p_part

    def _check_frame(self, words: PathWords, given: dict[int, tuple[float, bool]]) -> None:
        state = self._state
        for axis, (_, incremental) in given.items():
            letter = AXES[axis]
            if incremental and axis not in state.named and not state.start_known:
                raise words.fault(f"a displacement along {letter} from a place that is not known", f"I{letter}",
                                  f"Name {letter} without I before")  # fmt: skip
            if incremental and axis in state.shifted:
                raise words.fault(f"a displacement along {letter} after its datum changed: from where it counts is "
                                  "not known", f"I{letter}", f"Name {letter} without I first")  # fmt: skip
        mixed = state.settle & set(given)
        if mixed and not state.settle <= set(given):
            raise words.fault(
                "the first motion behind cycle 8, 10 or 26 leaves out an axis that it changes", AXES[min(mixed)],
                "Name " + " and ".join(AXES[axis] for axis in sorted(state.settle)),
            )  # fmt: skip
        if mixed:
            state.settle = frozenset()

    def _named_in_new_plane(self, words: PathWords, given: dict[int, tuple[float, bool]], rapid: bool) -> Float | None:
        state = self._state
        assert state.partial is not None
        for axis, (value, _) in given.items():
            state.partial[axis] = value
            state.named.add(axis)
            state.shifted.discard(axis)
        if len(state.partial) < 3:
            if not rapid:
                self.require_axes(words, "a feed motion")
            return None
        p_work = np.array([state.partial[axis] for axis in range(3)])
        self.joined = tuple(
            Word(AXES[axis], float(p_work[axis]) / state.unit_m, 0, 0, False, True)
            for axis in range(3)
            if axis not in given
        )
        state.partial = None
        return self._reachable(words, state.to_part(p_work))

    def _angles(self, words: PathWords) -> tuple[float, float, float]:
        """Rotary positions, or the tool axis in the part, at the end of a block."""
        state = self._state
        if state.vectors:
            return self._tool_axis(words)
        if words.has(*_VECTOR):
            raise words.fault("a tool vector in a block without all of TX, TY and TZ", _VECTOR[0])
        angles = list(state.angles)
        for axis, letter in enumerate(ROTARY):
            value, incremental = words.coordinate(letter) or (0.0, True)
            angle = value * DEG
            if incremental:
                angles[axis] += angle
            elif state.shortest:
                angles[axis] += math.remainder(angle - angles[axis], 2.0 * math.pi)
            else:
                angles[axis] = angle
            if not abs(angles[axis]) <= 1e7:
                raise words.fault("the target is beyond any machine", letter, "At most 1e7 rad")
        return (angles[0], angles[1], angles[2])

    def _of_plane(self, item: WordItem) -> bool:
        """Return whether a rotary word turns the tool to the plane in force: its angle, or 0 without a tilted plane."""
        if not self._state.frames.has("plane"):
            return item.value == 0.0 and not item.name.startswith("I")
        angle = TILT_ANGLES[ROTARY.index(item.name[-1])]
        return isinstance(item.value, Unknown) and item.value.why.startswith(f"{angle} ")

    def _tool_axis(self, words: PathWords) -> tuple[float, float, float]:
        """Turn to the plane in force or to a tool vector: the tool axis, in the part."""
        state = self._state
        if self._turned_to_plane(words):
            state.aligned = True
            return state.plane_axis
        if not words.has(*_VECTOR):
            return state.plane_axis if state.aligned and not state.tcpm else state.angles
        vector = state.frames.A @ np.array([words.take(name) or 0.0 for name in _VECTOR])
        size = float(np.linalg.norm(vector))
        if size < 1e-3 or not state.tcpm:
            what = "the tool vector TX TY TZ has no length" if state.tcpm else "a tool vector without M128"
            raise words.fault(what, next(n for n in _VECTOR if n in words.items), "Write M128 before")
        x, y, z = (vector / size).tolist()
        return (x, y, z)

    def _turned_to_plane(self, words: PathWords) -> bool:
        """Use rotary words; whether there are any."""
        turned = [words.take_item(letter) for letter in (*ROTARY, *(f"I{c}" for c in ROTARY))]
        rotary = [item for item in turned if item is not None]
        for item in rotary:
            if not self._of_plane(item):
                raise words.fault(
                    "a rotary position beside PLANE or tool vectors belongs to a machine that is not known", item,
                    "A+Q120 B+Q121 C+Q122 behind PLANE, zero behind PLANE RESET",
                )  # fmt: skip
        return bool(rotary)
