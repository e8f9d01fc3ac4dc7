"""Motions of a Sinumerik block: straight moves, arcs, dwells."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG, MINUTE, RPM
from counterflex.geometry.circle import angle_to, circle
from counterflex.programs.gcode.read.arc import Arc, ArcFault
from counterflex.programs.gcode.read.motion import FARTHEST_M
from counterflex.programs.gcode.sinumerik.block import MIDDLE, SinumerikBlock
from counterflex.programs.gcode.sinumerik.cycles import Cycle
from counterflex.programs.gcode.sinumerik.state import PLANE_AXES, SinumerikState
from counterflex.programs.gcode.sinumerik.words import AXES, ROTARY, VECTOR
from counterflex.programs.program import TOOL_VECTOR, Motion, MotionKind

_CENTRE: Final = "IJK"
_SHORTEST_VECTOR: Final = 1e-3
_LONGEST_DWELL_S: Final = 1e6
_ARC_ENDS: Final = "Write I J K, CR= or AR="
PlanePoint = tuple[float, float]  # m, in the plane of an arc


class SinumerikMoveMaker:
    """Turns the motion words of blocks into motions and moves the state along.

    Args:
        state: Moved along.
        listed: Motions to and from places that are not known are made, and marked.
    """

    def __init__(self, state: SinumerikState, listed: bool = False) -> None:
        self._state = state
        self._listed = listed
        self.motions: list[Motion] = []  # Everything made so far
        # Where the tool went to a place that is not known (``SUPA in line 12``); empty while it is known
        self.away = ""

    def _append(
        self,
        number: int,
        kind: MotionKind,
        p_end: Float,
        angles: tuple[float, float, float],
        feed: tuple[float, float] = (0.0, 0.0),
        duration_s: float = 0.0,
        arc: tuple[Float, Float, float] | None = None,
        through: bool = False,
    ) -> None:
        state = self._state
        centre, normal, turn = arc if arc is not None else (None, None, 0.0)
        self.motions.append(
            Motion(
                block=number,
                kind=kind,
                p_start=state.p_part,
                p_end=p_end,
                feed_m_s=feed[0],
                spindle_rad_s=state.spindle_rpm * RPM,
                tool=state.tool,
                duration_s=duration_s,
                abc_start=state.angles,
                abc_end=angles,
                p_centre=centre,
                normal=normal,
                turn_rad=turn * (-1.0 if state.mirrored and not through else 1.0),
                feed_rad_s=feed[1],
                unknown="".join(c for axis, c in enumerate(AXES) if axis not in state.named) if self._listed else "",
            )
        )
        state.p_part, state.angles = p_end, angles

    def _feed(self, block: SinumerikBlock, length_m: float, angle_deg: float) -> tuple[float, float]:
        """Feed of a motion of that length in m/s and, where the tool only turns, in rad/s."""
        state = self._state
        if state.feed_mode == 93 and "F" not in block.given:
            raise block.fault("inverse time (G93) needs F in every block that feeds", "", "no F")
        if not state.feed:
            raise block.fault("a feed move without a feed", "F", "F0" if state.feed == 0.0 else "no F",
                              "Write F on this line or before")  # fmt: skip
        if state.feed_mode == 93:
            time_s = MINUTE / state.feed
            return length_m / time_s, 0.0 if length_m > 0.0 else angle_deg * DEG / time_s
        per_minute = state.feed
        if state.feed_mode == 95:
            if state.spindle_rpm == 0.0:
                raise block.fault("feed per revolution (G95) with the spindle stopped", "F", "0 rpm")
            per_minute *= abs(state.spindle_rpm)
        if length_m == 0.0 and angle_deg > 0.0:
            return 0.0, per_minute * DEG / MINUTE
        return per_minute * state.feed_unit_m / MINUTE, 0.0

    def require_place(self, block: SinumerikBlock) -> None:
        """Refuse a motion from a place that is not known. Raises ProgramError: it begins at one."""
        if self.away:
            raise block.fault(
                f"the program moves on after {self.away}, and where that leads is not known", "", None,
                "Retract with a plain G0 in the coordinates of the part",
            )  # fmt: skip

    def leave(self, number: int, name: str, axes: list[int]) -> None:
        """Go to a place of the machine that is not known. Before the first motion no place is known anyway."""
        self._state.named -= set(axes)
        if self._listed:
            self._append(number, "rapid", self._state.p_part, self._state.angles)
        elif self.motions and not self.away:
            self.away = f"{name} in line {self._state.line}"

    def _require_axes(self, block: SinumerikBlock, what: str) -> None:
        """Refuse a motion that needs to know where the tool stands."""
        lost = [letter for axis, letter in enumerate(AXES) if axis not in self._state.named]
        if lost and not self._state.start_known:
            raise block.fault(
                f"{what} while it is not known where the tool is along {' and '.join(lost)}", "", None,
                f"Go there with G0 before, in G90: G0 {lost[0]}...",
            )  # fmt: skip

    def _displaced(self, block: SinumerikBlock, letter: str, axis: int, here: float) -> float:
        """Origin of incremental words, in the programmed axes, m."""
        state = self._state
        if axis not in state.named and not state.start_known:
            raise block.fault(f"a displacement along {letter} from a place that is not known", letter,
                              hint=f"Name {letter} in G90 before")  # fmt: skip
        if axis not in state.shifted:
            return here
        line, before = state.shifted[axis]
        if state.shift_travelled is None:
            raise block.fault(
                f"a displacement along {letter} after its zero changed in line {line}: setting SD42440 "
                "(FRAME_OFFSET_INCR_PROG) decides whether the change is travelled too", letter, None,
                f"Name {letter} in G90 first, or write $SC_FRAME_OFFSET_INCR_PROG=1 (the standard) or 0",
            )  # fmt: skip
        return before if state.shift_travelled else here

    def target(self, block: SinumerikBlock) -> Float:
        """End point of a block in the part frame, from its axis words; axes that are not named stay bit for bit."""
        state, p_part = self._state, self._state.p_part.copy()
        p_work = state.to_work(state.p_part)
        named = []
        for axis, letter in enumerate(AXES):
            value = block.take(letter)
            if value is None:
                continue
            absolute = block.absolute(letter, state.absolute)
            base = 0.0 if absolute else self._displaced(block, letter, axis, float(p_work[axis]))
            p_work[axis] = value * state.unit_m + base
            named.append(axis)
            if absolute:
                state.named.add(axis)
        for axis in named:
            state.shifted.pop(axis, None)
        if state.R_part_work is None:
            p_part[named] = state.p_part_origin[named] + p_work[named]
        elif named:
            if len(state.named) < 3:
                raise block.fault("a motion in a rotated frame before X, Y and Z have all been named", "XYZ"[named[0]],
                                  hint="Name X, Y and Z in the first motion")  # fmt: skip
            p_part = state.to_part(p_work)
        far = int(np.argmax(np.abs(p_part)))
        if not abs(p_part[far]) <= FARTHEST_M:
            raise block.fault("the target is beyond any machine", AXES[far], hint="At most 1000 m")
        p_part.flags.writeable = False
        return p_part

    def _angles(self, block: SinumerikBlock) -> tuple[float, float, float]:
        """Rotary positions, or the tool axis in the part frame, at the end of a block."""
        state = self._state
        if state.tool_centre == TOOL_VECTOR:
            return self._vector(block)
        for name in VECTOR:
            if block.has(name):
                raise block.fault("a tool axis A3 B3 C3 without TRAORI", name, hint="Write TRAORI before")
        angles = list(state.angles)
        for axis, letter in enumerate(ROTARY):
            value = block.take(letter)
            if value is not None:
                if state.R_part_work is not None:
                    raise block.fault("rotary words in a rotated frame are not read", letter, hint="Post A3= B3= C3=")
                base = 0.0 if block.absolute(letter, state.absolute) else angles[axis]
                angles[axis] = base + value * DEG
        return (angles[0], angles[1], angles[2])

    def _vector(self, block: SinumerikBlock) -> tuple[float, float, float]:
        """The tool axis as a vector, A3 B3 C3, in the part frame."""
        for letter in ROTARY:
            if block.has(letter):
                what = "a rotary word beside A3 B3 C3 of the same program"
                raise block.fault(what, letter, hint="Give the tool axis in one way")
        if not block.has(*VECTOR):
            return self._state.angles
        vector = np.array([block.take(name) or 0.0 for name in VECTOR])
        if float(np.linalg.norm(vector)) < _SHORTEST_VECTOR:
            raise block.fault("the tool axis A3 B3 C3 has no length", next(n for n in VECTOR if n in block.given))
        x, y, z = map(float, self._state.turned(vector))
        return (x, y, z)

    def straight(self, block: SinumerikBlock, number: int, rapid: bool) -> None:
        """Execute G0 or G1."""
        self.require_place(block)
        state = self._state
        if not rapid and not self._listed:
            self._require_axes(block, "a feed motion")
        p_end, angles = self.target(block), self._angles(block)
        if rapid:
            self._append(number, "rapid", p_end, angles)
            return
        turned = math.dist(state.angles, angles) / DEG
        self._append(number, "feed", p_end, angles, self._feed(block, math.dist(state.p_part, p_end), turned))

    def dwell(self, block: SinumerikBlock, number: int) -> None:
        """Execute G4: F in seconds or S in revolutions of the spindle."""
        time_s, turns = block.take("F"), block.take("S")
        if time_s is None and turns is not None and self._state.spindle_rpm != 0.0:
            time_s = turns * MINUTE / abs(self._state.spindle_rpm)
        if time_s is None or not 0.0 <= time_s <= _LONGEST_DWELL_S:
            raise block.fault("G4 needs its time F in seconds, 0 to 1e6, or S in revolutions of a running spindle",
                              "F" if "F" in block.given else "G4")  # fmt: skip
        if not self.away:
            self._append(number, "dwell", self._state.p_part, self._state.angles, duration_s=time_s)

    def arc(self, block: SinumerikBlock, number: int, clockwise: bool) -> None:
        """Execute G2 or G3 with I J K, CR= or AR=, and TURN=."""
        self.require_place(block)
        state = self._state
        first, second, third = PLANE_AXES[state.plane]
        self._require_axes(block, "an arc")
        before = state.to_work(state.p_part)
        in_plane = block.has(AXES[first], AXES[second])
        p_part = self.target(block)
        end = state.to_work(p_part)
        turns = 1 + self.whole(block, "TURN")
        a, b = (float(before[first]), float(before[second])), (float(end[first]), float(end[second]))
        try:
            arc, b = self._plane_arc(block, a, b, in_plane, clockwise, turns)
        except ArcFault as fault:
            name = next((n for n in ("CR", "AR", _CENTRE[first], _CENTRE[second]) if n in block.given), "")
            raise block.fault(fault.what, name, fault.value) from fault
        if b != (float(end[first]), float(end[second])):  # AR with a centre tells the end
            end[first], end[second] = b
            p_part = state.to_part(end)
        centre = before.copy()
        centre[first], centre[second] = arc.first, arc.second
        normal = np.zeros(3)
        normal[third] = 1.0
        length = math.hypot(arc.radius_m * arc.turn_rad, float(end[third] - before[third]))
        feed = self._feed(block, length, 0.0)
        shape = (state.to_part(centre), state.turned(normal), arc.turn_rad)
        self._append(number, "arc", p_part, self._angles(block), feed, arc=shape)

    def through(self, block: SinumerikBlock, number: int) -> None:
        """Execute CIP: the arc through the point I1= J1= K1=, which counts as the end does (G90, G91)."""
        self.require_place(block)
        self._require_axes(block, "an arc")
        state = self._state
        before = state.to_work(state.p_part)
        middle = before.copy()
        for axis, name in enumerate(MIDDLE):
            value = block.take(name)
            if value is not None:
                middle[axis] = value * state.unit_m + (0.0 if block.absolute(name, state.absolute) else before[axis])
        p_end, p_middle = self.target(block), state.to_part(middle)
        parts = circle(state.p_part, p_middle, p_end)
        if parts is None:
            raise block.fault("the three points of CIP lie on a line", "CIP", hint="Write G1")
        turn = angle_to(state.p_part, p_end, *parts)
        length = float(np.linalg.norm(state.p_part - parts[0])) * turn
        angles = self._angles(block)
        self._append(number, "arc", p_end, angles, self._feed(block, length, 0.0), arc=(*parts, turn),
                     through=True)  # fmt: skip

    def drill(self, block: SinumerikBlock, number: int, cycle: Cycle) -> None:
        """Execute a drilling cycle where the tool stands.

        Raises:
            ProgramError: The tool stands below the height that it feeds from, or is turned.
        """
        self.require_place(block)
        state = self._state
        third = PLANE_AXES[state.plane][2]
        self._require_axes(block, "a drilling cycle")
        if state.traori:
            raise block.fault("a drilling cycle under TRAORI is not read", cycle.name)
        if state.to_work(state.p_part)[third] < cycle.safe_m - 1e-9:
            raise block.fault("a drilling cycle begins below RFP + SDIS: which way the control takes is not known",
                              cycle.name, hint="Go to the retraction plane before")  # fmt: skip
        for move in cycle.moves():
            if move.kind == "dwell":
                rpm = abs(state.spindle_rpm)
                if move.time_s < 0.0 and rpm == 0.0:
                    raise block.fault("a dwell in revolutions with the spindle stopped", cycle.name)
                time_s = move.time_s if move.time_s > 0.0 else -move.time_s * MINUTE / rpm
                self._append(number, "dwell", state.p_part, state.angles, duration_s=time_s)
                continue
            p_work = state.to_work(state.p_part)
            way = abs(move.height_m - float(p_work[third]))
            if way < 1e-12:
                continue
            p_work[third] = move.height_m
            feed = (0.0, 0.0) if move.kind == "rapid" else self._feed(block, way, 0.0)
            kind: MotionKind = "rapid" if move.kind == "rapid" else "feed"
            self._append(number, kind, state.to_part(p_work), state.angles, (feed[0] * move.share, feed[1]))

    def whole(self, block: SinumerikBlock, name: str) -> int:
        """Use a word that must be a whole number; 0 where the block has none."""
        value = block.take(name)
        if value is None:
            return 0
        if value != int(value) or not 0 <= value < 10_000:
            raise block.fault(f"{name} needs a whole number from 0 to 9999", name)
        return int(value)

    def _plane_arc(
        self, block: SinumerikBlock, a: PlanePoint, b: PlanePoint, in_plane: bool, clockwise: bool, turns: int
    ) -> tuple[Arc, tuple[float, float]]:
        """The arc from ``a`` in its plane, m, and its end: ``b``, or what AR with a centre says."""
        state = self._state
        radius, opening = block.take("CR"), block.take("AR")
        centre = self._centre(block, a)
        self._refuse_form(block, centre is not None, in_plane)
        unit = state.unit_m
        if centre is not None:
            b = b if opening is None else _turned(a, centre, opening * DEG * (-1.0 if clockwise else 1.0))
            return Arc.by_centre(a, b, centre, clockwise, turns, unit), b
        angle = opening or 0.0
        size = math.copysign(0.5 * math.dist(a, b) / math.sin(0.5 * angle * DEG), 180.0 - angle) if angle else 0.0
        return Arc.by_radius(a, b, size if radius is None else radius * unit, clockwise, turns, unit), b

    def _refuse_form(self, block: SinumerikBlock, centred: bool, in_plane: bool) -> None:
        """Refuse an arc that is given in no way, in two, or without the end that it needs."""
        given = [name for name in ("CR", "AR") if name in block.given]
        if len(given) + centred != 1 and (given != ["AR"] or in_plane):
            what = "an arc is given in two ways" if given else "an arc has neither a centre nor CR= nor AR="
            raise block.fault(what, "".join(given[:1]), None, _ARC_ENDS)
        if "AR" in given and not 0.0 < (block.given["AR"].value or 0.0) < 360.0:
            raise block.fault("the opening angle AR is out of range", "AR", hint="Above 0 and below 360 deg")
        if not in_plane and not (centred and given != ["CR"]):
            raise block.fault("an arc without a centre needs an end point in its plane", given[0])

    def _centre(self, block: SinumerikBlock, a: tuple[float, float]) -> tuple[float, float] | None:
        """Centre from I J K, which count from the start unless AC says otherwise; None where the block has none."""
        first, second, third = PLANE_AXES[self._state.plane]
        wrong = _CENTRE[third]
        if block.take(wrong):
            raise block.fault(f"{wrong} has no place in an arc of plane G{self._state.plane}", wrong)
        if not block.has(_CENTRE[first], _CENTRE[second]):
            return None
        out = []
        for axis, start in ((first, a[0]), (second, a[1])):
            value = block.take(_CENTRE[axis]) or 0.0
            absolute = _CENTRE[axis] in block.given and block.absolute(_CENTRE[axis], False)
            out.append(value * self._state.unit_m + (0.0 if absolute else start))
        return (out[0], out[1])


def _turned(a: tuple[float, float], centre: tuple[float, float], turn_rad: float) -> tuple[float, float]:
    """A point turned about a centre in their plane."""
    u, v, cos, sin = a[0] - centre[0], a[1] - centre[1], math.cos(turn_rad), math.sin(turn_rad)
    return centre[0] + u * cos - v * sin, centre[1] + u * sin + v * cos


def frame_of(block: SinumerikBlock, name: str, state: SinumerikState) -> tuple[Float, Float]:
    """Shift (3,) m and rotation vector (3,) rad of a TRANS, ATRANS, ROT or AROT; MIRROR and AMIRROR have neither.

    Raises:
        ProgramError: Words that it does not take, or rotations about several axes: their order is a machine datum.
    """
    values = {axis: block.take(letter) for axis, letter in enumerate(AXES)}
    given = {axis: value for axis, value in values.items() if value is not None}
    in_plane = block.take("RPL")
    shift, rotvec = np.zeros(3), np.zeros(3)
    if name in ("TRANS", "ATRANS"):
        if in_plane is not None:
            raise block.fault(f"RPL has no place beside {name}", "RPL")
        for axis, value in given.items():
            shift[axis] = value * state.unit_m
        return shift, rotvec
    if in_plane is not None:
        given[PLANE_AXES[state.plane][2]] = given.get(PLANE_AXES[state.plane][2], 0.0) + in_plane
    turned = [axis for axis, value in given.items() if value != 0.0]
    if len(turned) > 1:
        raise _several(block, name, turned)
    for axis in turned:
        rotvec[axis] = given[axis] * DEG
    return shift, rotvec


def _several(block: SinumerikBlock, name: str, turned: list[int]) -> ProgramError:
    return block.fault(
        f"{name} turns about several axes: the order is a machine datum that is not known here", AXES[turned[0]], None,
        "Write one angle per block: ROT, then AROT",
    )  # fmt: skip
