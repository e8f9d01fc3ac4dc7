"""Motions of a block: straight moves, arcs, canned cycles, stored positions and dwells."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MINUTE, MM, RPM
from counterflex.programs.gcode.read.arc import PLANE_AXES, Arc, ArcFault
from counterflex.programs.gcode.read.block import BlockWords
from counterflex.programs.gcode.read.codes import CYCLES, code_name
from counterflex.programs.gcode.read.parameters import GcodeParameters
from counterflex.programs.gcode.read.state import ModalState, plus
from counterflex.programs.gcode.read.targets import target_of
from counterflex.programs.gcode.read.work_offsets import ZERO, Six, six
from counterflex.programs.program import TOOL_VECTOR, Motion, MotionKind

# No machine is larger, and beyond it a float no longer resolves a micrometre against rounding.
FARTHEST_M: Final = 1000.0
UNKNOWN_PLACE: Final = (
    "Give the machine's own: --parameters FILE (a LinuxCNC parameter file with #5161 to #5166 for G28, #5181 to #5186 "
    "for G30, #5221 to #5226 for G54), or retract with a plain G0"
)
LONGEST_DWELL_S: Final = 1e6
_SHORTEST_VECTOR: Final = 1e-3
_CENTRE_LETTERS: Final = "IJK"
_NORMALS: Final[dict[int, Float]] = {}
for _plane, (_, _, _axis) in PLANE_AXES.items():
    _normal = np.zeros(3)
    _normal[_axis] = 1.0
    _normal.flags.writeable = False
    _NORMALS[_plane] = _normal


def point(values: tuple[float, ...]) -> Float:
    """Return the first three numbers as a read-only (3,) array."""
    array = np.array(values[:3])
    array.flags.writeable = False
    return array


class MotionMaker:
    """Turns the motion words of blocks into motions and moves the state along.

    Args:
        state: Moved along.
        parameters: Hold the stored positions of G28 and G30.
        machine_known: Where the part lies in the machine is known: G53 leads somewhere.
        listed: Motions to and from places that are not known are made, marked with
            :attr:`~counterflex.programs.program.Motion.unknown`.
    """

    def __init__(
        self, state: ModalState, parameters: GcodeParameters, machine_known: bool = True, listed: bool = False
    ) -> None:
        self._state = state
        self._parameters = parameters
        self._machine_known = machine_known
        self._listed = listed
        self.motions: list[Motion] = []  # Everything made so far
        self.block = 0  # Index of the block that the next motions belong to
        # Where the tool went to a place that is not known (``G28 in line 12``), empty while it is known. At the end of
        # a program that does not matter; nothing may be made of it.
        self.away = ""

    # Elementary motions ---------------------------------------------------------------------------------------------

    def start_point(self) -> Float:
        """(3,) m, where the next motion begins: the array at which the last one ends where that is the same place."""
        last, here = self.motions[-1].p_end if self.motions else None, self._state.position
        return last if last is not None and (last[0], last[1], last[2]) == here[:3] else point(here)

    def _append(
        self,
        kind: MotionKind,
        target: Six,
        feed_m_s: float = 0.0,
        duration_s: float = 0.0,
        arc: tuple[Float, Float, float] | None = None,
        feed_rad_s: float = 0.0,
        spindle: bool = True,
    ) -> None:
        state = self._state
        state.work_offsets.fix(state.work_offset, self._parameters.line)
        start, p_start = state.position, self.start_point()
        state.position = target
        centre, normal, turn = arc if arc is not None else (None, None, 0.0)
        self.motions.append(
            Motion(
                block=self.block,
                kind=kind,
                p_start=p_start,
                p_end=p_start if start[:3] == target[:3] else point(target),
                feed_m_s=feed_m_s,
                spindle_rad_s=state.spindle_rpm * RPM if spindle else 0.0,
                tool=state.tool,
                duration_s=duration_s,
                abc_start=radians(start),
                abc_end=radians(target),
                p_centre=centre,
                normal=normal,
                turn_rad=turn,
                feed_rad_s=feed_rad_s,
                unknown="".join("XYZ"[axis] for axis in sorted(state.unknown)) if self._listed else "",
            )
        )

    def _feed(self, block: BlockWords, length_m: float, angle_deg: float) -> tuple[float, float]:
        """Feed of a motion of that length in m/s and, where only rotary axes turn, in rad/s."""
        state = self._state
        if state.feed_mode == 93 and not block.names("F"):
            raise block.fault("inverse time (G93) needs F in every block that feeds", "F", "no F")
        if not state.feed or state.feed <= 0.0:
            value = "F0" if state.feed == 0.0 else "no F"
            raise block.fault("a feed move without a feed", "F", value, "Write F on this line or before")
        if state.feed_mode == 93:
            time_s = MINUTE / state.feed
            return length_m / time_s, 0.0 if length_m > 0.0 else angle_deg * DEG / time_s
        per_minute = state.feed
        if state.feed_mode == 95:
            if state.spindle == 0 or state.speed_rpm == 0.0:
                raise block.fault("feed per revolution (G95) with the spindle stopped", "F", "0 rpm")
            per_minute *= abs(state.spindle_rpm)
        if length_m == 0.0 and angle_deg > 0.0:
            return 0.0, per_minute * DEG / MINUTE
        return per_minute * state.feed_unit_m / MINUTE, 0.0

    def _check(self, block: BlockWords, target: Six) -> Six:
        for axis, value in enumerate(target):
            if not abs(value) <= (FARTHEST_M if axis < 3 else 1e7):
                letter = "XYZABC"[axis]
                shown = f"{letter}{value / self._state.unit_m if axis < 3 else value:.6g}"
                raise block.fault("the target is beyond any machine", letter, shown, "At most 1000 m or 1e7 deg")
        return target

    def straight(self, block: BlockWords, target: Six, rapid: bool, before: frozenset[int] = frozenset()) -> None:
        """Move straight to a point; ``before`` are the axes along which the start is not known."""
        self._require_place(block)
        self._check(block, target)
        if rapid:
            self._append("rapid", target)
            return
        if not self._listed:
            self._require_axes(block, before | self._state.unknown, "a feed motion")
        start = self._state.position
        if self._state.feed_mode == 93:
            self._require_axes(block, before, "a motion in inverse time (G93)")
        feed = self._feed(block, math.dist(start[:3], target[:3]), math.dist(start[3:], target[3:]))
        self._append("feed", target, feed[0], feed_rad_s=feed[1])

    def _leave(self, name: str, axes: Iterable[int]) -> None:
        """Go to a place that is not known along some axes. Before the first motion no place is known anyway."""
        self._state.unknown |= set(axes)
        if self._listed:
            self._append("rapid", self._state.position)
        elif self.motions and not self.away:
            self.away = f"{name} in line {self._parameters.line}"

    def _require_axes(self, block: BlockWords, axes: Iterable[int], what: str) -> None:
        """Refuse a motion that needs a place which is not known."""
        if letters := "".join("XYZ"[axis] for axis in sorted(axes)):
            raise block.fault(
                f"{what} while it is not known where the tool is along {' and '.join(letters)}", "", None,
                f"Go there with G0 before, in G90: G0 {letters[0]}...",
            )  # fmt: skip

    def _require_place(self, block: BlockWords) -> None:
        if self.away:
            raise block.fault(
                f"the program moves on after {self.away}, and where that leads is not known", "", None, UNKNOWN_PLACE
            )

    def dwell(self, block: BlockWords, time_s: float | None, spindle: bool = True) -> None:
        """Wait."""
        if time_s is None or not 0.0 <= time_s <= LONGEST_DWELL_S:
            value = None if time_s is not None else "no P"
            raise block.fault("a dwell needs its time P in seconds, 0 to 1e6", "P", value)
        self._append("dwell", self._state.position, duration_s=time_s, spindle=spindle)

    # Blocks ---------------------------------------------------------------------------------------------------------

    def run(self, block: BlockWords, code: int, machine: bool) -> None:
        """Execute the motion ``code`` (tenths) with the block's axis words."""
        if machine and code not in (0, 10):
            raise block.fault("G53 goes with G0 or G1 only", "G530", code_name("G", code))
        if machine and not self._state.absolute:
            raise block.fault("G53 under G91 is not defined", "G530", "G91", "Write G90")
        if machine and not self._machine_known:
            self._leave("G53", [axis for axis in block.take_axes() if axis < 3])
            return
        self._require_place(block)
        if code in CYCLES:
            self.cycle(block, code)
        elif code in (20, 30):
            self.arc(block, clockwise=code == 20)
        else:
            axes = block.take_axes()
            if self._state.tool_centre == TOOL_VECTOR:
                axes |= self._tool_vector(block, axes)
            before = frozenset(self._state.unknown)
            self.straight(block, target_of(self._state, block, axes, machine), code == 0, before)

    def _tool_vector(self, block: BlockWords, axes: dict[int, float]) -> dict[int, float]:
        """Components of the tool axis (G43.5) in the places of A B C; those that a block leaves out are 0."""
        turned = [axis for axis in axes if axis > 2]
        if turned:
            letter = "XYZABC"[turned[0]]
            raise block.fault("a rotary word under G43.5, which has the tool axis as I J K", letter, hint="Use G43.4")
        if not block.has("IJK"):
            return {}
        vector = [block.take(letter) or 0.0 for letter in "IJK"]
        if math.hypot(*vector) < _SHORTEST_VECTOR:
            raise block.fault("the tool axis I J K has no length", next(c for c in "IJK" if block.names(c)))
        if not self._state.absolute:
            raise block.fault("a tool axis I J K under G91 is not defined", "I", "G91", "Write G90")
        return {3 + axis: value / DEG for axis, value in enumerate(vector)}

    def arc(self, block: BlockWords, clockwise: bool) -> None:
        """Execute G2 or G3."""
        state = self._state
        first, second, third = PLANE_AXES[state.plane]
        unit = state.unit_m
        in_plane = block.has("XYZ"[first] + "XYZ"[second])
        self._require_axes(block, state.unknown, "an arc")
        p_target = self._check(block, target_of(state, block, block.take_axes()))
        start, target = state.position, p_target
        if state.frame.rows is not None:
            start, target = state.to_work(start), state.to_work(target)
        centred = next(filter(block.has, _CENTRE_LETTERS), None)
        if state.frame.polar and centred:
            raise block.fault("an arc in polar coordinates (G16) has its centre", centred, None,
                              "Write R, or G15 before")  # fmt: skip
        turns = block.whole("P", 1, 100_000) or 1
        radius = block.take("R")
        given = {axis: value for axis in (first, second) if (value := block.take(_CENTRE_LETTERS[axis])) is not None}
        wrong = _CENTRE_LETTERS[third]
        if block.take(wrong):
            raise block.fault(f"{wrong} has no place in an arc of plane G{state.plane}", wrong)
        a, b = (start[first], start[second]), (target[first], target[second])
        try:
            if radius is None:
                arc = Arc.by_centre(a, b, self._centre(block, given, start, clockwise), clockwise, turns, unit)
            elif given:
                raise block.fault("an arc has both R and a centre", "R")
            elif not in_plane:
                raise block.fault("an arc with R needs an end point in its plane", "R")
            else:
                arc = Arc.by_radius(a, b, radius * unit, clockwise, turns, unit)
        except ArcFault as fault:
            letter = fault.letter or next(_CENTRE_LETTERS[axis] for axis in given)
            raise block.fault(fault.what, letter, fault.value) from fault
        self._append_arc(block, arc, p_target, target[third] - start[third])

    def _centre(self, block: BlockWords, given: dict[int, float], start: Six, clockwise: bool) -> tuple[float, float]:
        """Centre of an arc in its plane, m, from the words I, J, K that a block has."""
        state = self._state
        first, second, _ = PLANE_AXES[state.plane]
        letters, name = f"{_CENTRE_LETTERS[first]} {_CENTRE_LETTERS[second]}", "G2" if clockwise else "G3"
        if not given:
            raise block.fault("an arc has neither R nor a centre", f"{name}0", name, f"Write {letters} or R")
        if state.arc_absolute and len(given) < 2:
            raise block.fault("under G90.1 an arc needs both words of its centre", "", name, f"Write {letters}")
        base = start
        if state.arc_absolute:
            base = state.origin if state.frame.rows is None else ZERO
        x, y = (base[axis] + given.get(axis, 0.0) * state.unit_m for axis in (first, second))
        return x, y

    def _append_arc(self, block: BlockWords, arc: Arc, target: Six, rise_m: float) -> None:
        state = self._state
        first, second, third = PLANE_AXES[state.plane]
        turned = state.frame.rows is not None
        start = state.to_work(state.position) if turned else state.position
        centre = [*start[:3], 0.0, 0.0, 0.0]
        centre[first], centre[second] = arc.first, arc.second
        p_centre: tuple[float, ...] = tuple(centre)
        normal, turn = _NORMALS[state.plane], arc.turn_rad
        if turned:
            p_centre = state.to_part((centre[0], centre[1], centre[2], 0.0, 0.0, 0.0))
            normal, turn = point(state.frame.direction(third)), turn * state.frame.sense
        feed, _ = self._feed(block, math.hypot(arc.radius_m * arc.turn_rad, rise_m), 0.0)
        self._append("arc", target, feed, arc=(point(p_centre), normal, turn))

    def _stored(self, code: int, axes: Collection[int]) -> tuple[Six, list[int]]:
        """Stored position of G28 or G30 along axes, all where none is named, and those along which it is not known."""
        goal, lost = list(self._state.position), []
        for axis in axes or range(6):
            stored = self._parameters.stored_position(code, axis)
            if stored is not None:
                goal[axis] = (stored * MM if axis < 3 else stored) - self._state.tool_length[axis]
            elif axes or axis < 3:
                lost.append(axis)
        return six(goal), lost

    def home(self, block: BlockWords, code: int) -> None:
        """Execute G28 or G30: through the point of the axis words, then those axes to the stored position.

        Where the stored position is not known, the way ends at the point of the axis words: :attr:`away`.
        """
        axes = block.take_axes()
        state, here = self._state, self._state.position
        before = frozenset(state.unknown)
        goal, lost = self._stored(code, axes)
        moves = axes if state.absolute else {axis: value for axis, value in axes.items() if value != 0.0}
        if moves:
            target = target_of(state, block, moves)
            if not lost or target != here or before != state.unknown:
                self.straight(block, target, True, before)
        elif axes and not lost:
            self.straight(block, here, rapid=True)
        if lost:
            self._leave(code_name("G", code), [axis for axis in lost if axis < 3])
            return
        state.unknown -= set(axes or range(3))
        self.straight(block, goal, rapid=True)

    def cycle(self, block: BlockWords, code: int) -> None:
        """Execute a canned cycle: see :class:`~counterflex.programs.gcode.read.canned_cycles.CycleMaker`."""
        raise NotImplementedError

    def machine_position(self) -> Six:
        """Position of the machine: tip and tool length offset together."""
        return plus(self._state.position, self._state.tool_length)


def radians(position: Six) -> tuple[float, float, float]:
    """Return the rotary axes in rad."""
    return (position[3] * DEG, position[4] * DEG, position[5] * DEG)
