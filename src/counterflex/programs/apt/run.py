"""Execute the statements of a cutter location file."""

from __future__ import annotations

import itertools
import math
import re
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.similar import close_to
from counterflex.core.units import DEG, INCH, MINUTE, MM, RPM
from counterflex.programs.apt import word_table as apt_words
from counterflex.programs.apt.statements import SYSTEM, TOOL_ON_CIRCLE, AptLine, Argument, place
from counterflex.programs.apt.tool_on_circle import TOOL_ON_FORM, ToolOnCircle
from counterflex.programs.apt.word_table import NOTES
from counterflex.programs.gcode.read.arc import PLANE_AXES, Arc, ArcFault
from counterflex.programs.gcode.read.motion import FARTHEST_M
from counterflex.programs.program import TOOL_VECTOR, Block, Modal, Motion, MotionKind, Word


class AptRun:
    """One pass through a file."""

    def __init__(self, name: str, turning: bool, listed: bool = False) -> None:
        self._name, self._turning, self._listed = name, turning, listed
        self._away = ""
        self.blocks: list[Block] = []
        self.motions: list[Motion] = []
        self._p: Float = np.zeros(3)
        self._axis = (0.0, 0.0, 1.0) if turning else (0.0, 0.0, 0.0)
        self._unit_m, self._mode, self._feed_unit_m = MM, 94, MM
        self._feed: float | None = None
        self._rpm, self._turns, self._tool = 0.0, 0, 0
        self._rapid = False
        self._arc: AptLine | None = None
        self._indirv: tuple[float, float, float] | None = None
        self._msys: tuple[tuple[float | None, ...], int] | None = None
        self._motion, self._plane = "G1", 17
        self._lengths_in = ""

    def _fault(self, part: AptLine, what: str, at: Argument | None = None, hint: str | None = None) -> ProgramError:
        column = at.start if at is not None else len(part.text) - len(part.text.lstrip())
        value = at.text if at is not None else part.text.split("\n")[0].strip()[:40]
        return ProgramError(what, where=place(self._name, part.line, part.text, column), value=value, hint=hint)

    def statement(self, part: AptLine) -> None:
        """Execute a statement and append its block."""
        first, words = len(self.motions), self._execute(part)
        modal = Modal(
            motion=self._motion,
            plane=self._plane,
            unit_m=self._unit_m,
            absolute=True,
            arc_absolute=True,
            feed_mode=self._mode,
            p_part_origin=(0.0, 0.0, 0.0),
            tool=self._tool,
            spindle_rpm=self._turns * self._rpm,
            tool_centre=TOOL_VECTOR if self._turning else 0,
            feed_unit_m=self._feed_unit_m,
        )
        count = len(self.motions) - first
        self.blocks.append(Block(part.line, part.text, tuple(words), modal, first, count))

    def _execute(self, part: AptLine) -> list[Word]:
        major = part.major
        if self._is_harmless(part):
            return []
        if major in apt_words.REFUSED:
            raise self._fault(part, f"{apt_words.REFUSED[major][0]}: {major}", hint=apt_words.REFUSED[major][1])
        if major in _WORDS:
            return _WORDS[major](self, part)
        self._settings(part)
        return []

    def _settings(self, part: AptLine) -> None:
        """Statements that stand for no word of a machine."""
        major = part.major
        if major in _SETTINGS:
            _SETTINGS[major](self, part)
        elif major == "TLON":
            raise self._fault(part, f"{apt_words.REFUSED['GOFWD'][0]}: {major}", hint=apt_words.REFUSED["GOFWD"][1])
        elif major == "INSERT" and apt_words.CODES.search(
            re.sub(r"\([^)]*\)", "", part.text.upper().partition("INSERT")[2])
        ):
            raise self._fault(part, "text for the control with codes is not read: INSERT", hint="Use the words of APT")
        elif major.startswith(NOTES):
            if apt_words.MOVES_FRAMES.search(major):
                raise self._fault(
                    part, f"a word of SolidWorks CAM that may change frames or feeds: {major}", hint=apt_words.POST
                )
        elif major and major not in apt_words.CARRIED:
            close = close_to(major, [*apt_words.READ, *apt_words.CARRIED], 1)
            hint = f"Did you mean {close[0]}?" if close else None
            raise self._fault(part, f"an unknown word of APT: {major}", hint=hint)

    def _rapid_next(self, _: AptLine) -> None:
        self._rapid = True

    def _from(self, part: AptLine) -> None:
        self._lengths_in = self._lengths_in or f"FROM in line {part.line}"
        self._p, self._axis = self._point(part)

    def _direct(self, part: AptLine) -> None:
        if part.major == "TLAXIS":
            self._axis = self._direction(part, part.numbers())
        else:
            i, j, k = self._values(part, (3,))
            self._indirv = i, j, k

    def _is_harmless(self, part: AptLine) -> bool:
        """Return whether a word is neutral with its arguments: ``CUTCOM/OFF``, ``ORIGIN/0,0,0``."""
        for major, arguments in apt_words.HARMLESS:
            if part.major != major:
                continue
            if part.numbers() and not part.words() and all(a.value == 0.0 for a in part.numbers()):
                return arguments.startswith("0")
            if part.words()[:1] == [arguments]:
                return True
        return False

    def _leave(self, part: AptLine) -> None:
        """Go home: to a place of the machine that is not known."""
        if self._listed:
            self._append("rapid", self._p, self._axis, unknown="XYZ")
        self._away = f"{part.major} in line {part.line}" if self.motions else ""

    def _require_place(self, part: AptLine) -> None:
        if self._away and not self._listed:
            raise self._fault(
                part, f"the file moves on after {self._away}, and where that leads is not known",
                hint="Write GOTO instead",
            )  # fmt: skip

    def _allow(self, part: AptLine, words: tuple[str, ...]) -> None:
        for argument in part.arguments:
            if argument.value is None and argument.text not in words:
                raise self._fault(
                    part, f"an unknown word of APT in {part.major}", argument, "One of: " + " ".join(words)
                )

    def _values(self, part: AptLine, counts: tuple[int, ...]) -> list[float]:
        numbers = part.numbers()
        if len(numbers) not in counts or len(numbers) != len(part.arguments):
            shown = " or ".join(map(str, counts))
            raise self._fault(part, f"{part.major} needs {shown} numbers")
        return [argument.value or 0.0 for argument in numbers]

    def _point(self, part: AptLine) -> tuple[Float, tuple[float, float, float]]:
        """The point and the tool axis of GOTO, GODLTA or FROM."""
        counts = (1, 3) if part.major == "GODLTA" else (3, 6)
        values = self._values(part, counts)
        if len(values) == 1:
            values = [values[0] * c for c in (self._axis if self._turning else (0.0, 0.0, 1.0))]
        p = np.array(values[:3]) * self._unit_m + (self._p if part.major == "GODLTA" else 0.0)
        if not np.all(np.abs(p) <= FARTHEST_M):
            raise self._fault(part, "the target is beyond any machine", hint="At most 1000 m")
        axis = self._direction(part, part.numbers()[3:]) if len(values) == 6 else self._axis
        p.flags.writeable = False
        return p, axis

    def _direction(self, part: AptLine, numbers: list[Argument]) -> tuple[float, float, float]:
        values = [argument.value or 0.0 for argument in numbers]
        if len(values) != 3 or abs(math.hypot(*values) - 1.0) > 1e-3:
            raise self._fault(
                part, f"the tool axis needs three numbers of length 1, and has {math.hypot(*values):.5g}",
                numbers[0] if numbers else None,
            )  # fmt: skip
        return (values[0], values[1], values[2]) if self._turning else (0.0, 0.0, 0.0)

    def _goto(self, part: AptLine) -> list[Word]:
        self._require_place(part)
        p, axis = self._point(part)
        kind: MotionKind = "rapid" if self._rapid else "feed"
        shape = None
        length = math.dist(self._p, p)
        self._motion = "G0" if self._rapid else "G1"
        if self._arc is not None:
            kind, (shape, length) = "arc", self._arc_to(part, self._arc, p)
        feed = (0.0, 0.0) if kind == "rapid" else self._speed(part, length, math.dist(self._axis, axis))
        centre, normal, turn = shape if shape is not None else (None, None, 0.0)
        self._append(kind, p, axis, feed, centre=centre, normal=normal, turn_rad=turn)
        self._rapid, self._arc = False, None
        letters = zip("Z" if len(part.numbers()) == 1 else "XYZIJK", part.numbers(), strict=False)
        increment = False if part.major == "GODLTA" else None
        return [Word(letter, a.value or 0.0, a.start, a.end, True, increment) for letter, a in letters
                if self._turning or letter in "XYZ"]  # fmt: skip

    def _append(
        self,
        kind: MotionKind,
        p: Float,
        axis: tuple[float, float, float],
        feed: tuple[float, float] = (0.0, 0.0),
        duration_s: float = 0.0,
        centre: Float | None = None,
        normal: Float | None = None,
        turn_rad: float = 0.0,
        unknown: str = "",
    ) -> None:
        self.motions.append(
            Motion(
                block=len(self.blocks),
                kind=kind,
                p_start=self._p,
                p_end=p,
                feed_m_s=feed[0],
                spindle_rad_s=self._turns * self._rpm * RPM,
                tool=self._tool,
                duration_s=duration_s,
                abc_start=self._axis,
                abc_end=axis,
                p_centre=centre,
                normal=normal,
                turn_rad=turn_rad,
                feed_rad_s=feed[1],
                unknown=unknown,
            )
        )
        self._p, self._axis, self._indirv = p, axis, None

    def _speed(self, part: AptLine, length_m: float, angle_rad: float) -> tuple[float, float]:
        if not self._feed:
            raise self._fault(part, "a feed move without a feed", hint="Write FEDRAT, or RAPID, before")
        per_minute = self._feed
        if self._mode == 95:
            if self._turns * self._rpm == 0.0:
                raise self._fault(part, "feed per revolution with the spindle stopped", hint="Write SPINDL before")
            per_minute *= self._rpm
        if length_m == 0.0 and angle_rad > 0.0:
            return 0.0, per_minute * DEG / MINUTE
        return per_minute * self._feed_unit_m / MINUTE, 0.0

    def _circle(self, part: AptLine) -> list[Word]:
        """CIRCLE or MOVARC: centre, axis, radius of the arc that the next GOTO ends; the turn is right-handed."""
        numbers = part.numbers()
        if len(numbers) < 7:
            raise self._fault(part, f"{part.major} needs centre, axis and radius: 7 numbers",
                              hint="As NX writes it: CIRCLE/x,y,z,i,j,k,r")  # fmt: skip
        self._allow(part, ("TIMES", "ANGLE"))
        axis = [argument.value or 0.0 for argument in numbers[3:6]]
        if sorted(abs(value) for value in axis)[:2] != [0.0, 0.0] or abs(math.hypot(*axis) - 1.0) > 1e-6:
            raise self._fault(part, "an arc about a slanted axis is not read", numbers[3], apt_words.POST)
        if "TIMES" in part.words():
            raise self._fault(part, "an arc of several turns is not read", None, apt_words.POST)
        self._arc = part
        places = [*numbers[:3], numbers[6]]
        return [Word(letter, a.value or 0.0, a.start, a.end) for letter, a in zip("IJKR", places, strict=True)]

    def _arc_to(self, part: AptLine, arc: AptLine, p: Float) -> tuple[tuple[Float, Float, float], float]:
        """Centre, normal and turn of the arc that ends at ``p``, and its length."""
        if self._rapid:
            raise self._fault(part, "a rapid on an arc", hint="Write GOTO without CIRCLE, or without RAPID")
        values = [argument.value or 0.0 for argument in arc.numbers()]
        third = int(np.argmax(np.abs(values[3:6])))
        self._plane = {2: 17, 1: 18, 0: 19}[third]
        first, second, _ = PLANE_AXES[self._plane]
        clockwise = values[3 + third] < 0.0
        middle = np.array(values[:3]) * self._unit_m
        ends = [(float(q[first]), float(q[second])) for q in (self._p, p, middle)]
        try:
            solution = Arc.by_centre(ends[0], ends[1], ends[2], clockwise, 1, self._unit_m)
        except ArcFault as fault:
            raise self._fault(arc, f"{fault.what} ({fault.value})") from fault
        if abs(solution.radius_m - values[6] * self._unit_m) > 1e-3 * solution.radius_m + 1e-5:
            raise self._fault(arc, "the radius is not that of the arc's start and end", arc.numbers()[6])
        middle[third] = self._p[third]
        normal = np.zeros(3)
        normal[third] = 1.0
        self._motion = "G2" if clockwise else "G3"
        length = math.hypot(solution.radius_m * solution.turn_rad, float(p[third] - self._p[third]))
        return (middle, normal, solution.turn_rad), length

    def _tool_on_circle(self, part: AptLine) -> list[Word]:
        """TLON,GOFWD on a circle to a line, after INDIRV: an arc in a plane parallel to xy."""
        self._require_place(part)
        numbers = part.numbers()
        if len(numbers) != 10:
            raise self._fault(part, "the circle needs 4 numbers and the line 6", hint=TOOL_ON_FORM)
        if self._indirv is None or self._rapid or self._turning:
            what = "a rapid on an arc" if self._rapid else "an arc with a tool axis other than z"
            what = "TLON,GOFWD without INDIRV before it" if self._indirv is None else what
            raise self._fault(part, what, hint=TOOL_ON_FORM)
        circle = ToolOnCircle.of([n.value or 0.0 for n in numbers], self._unit_m, "INTOF" in part.words())
        try:
            arc = circle.arc(self._p, self._indirv, self._unit_m)
        except ArcFault as fault:
            raise self._fault(part, f"{fault.what} ({fault.value})" if fault.value else fault.what) from fault
        self._plane, self._motion = 17, "G2" if arc.turn_rad < 0.0 else "G3"
        p, middle = (np.array([*point[:2], self._p[2]]) for point in (circle.p_end, circle.p_centre))
        p.flags.writeable = False
        feed = self._speed(part, arc.radius_m * abs(arc.turn_rad), 0.0)
        normal = np.array([0.0, 0.0, 1.0])
        self._append("arc", p, self._axis, feed, centre=middle, normal=normal, turn_rad=arc.turn_rad)
        places = zip("IJKRXYZ", [*numbers[:4], *numbers[7:]], strict=True)
        return [Word(letter, a.value or 0.0, a.start, a.end, True) for letter, a in places]

    def _units(self, part: AptLine) -> None:
        words = part.words() if part.major in ("UNITS", "UNIT") else [part.major]
        if words not in (["MM"], ["INCH"], ["INCHES"]):
            raise self._fault(part, "an unknown unit of length", hint="UNITS/MM or UNITS/INCHES")
        unit_m = MM if words == ["MM"] else INCH
        if unit_m != self._unit_m and (self.motions or self._lengths_in):
            raise self._fault(part, f"the unit changes after {self._lengths_in or 'the first motion'}",
                              hint="State it at the head of the file")  # fmt: skip
        self._unit_m = self._feed_unit_m = unit_m

    def _feedrate(self, part: AptLine) -> list[Word]:
        self._allow(part, tuple(apt_words.FEEDS))
        numbers, words = part.numbers(), part.words()
        if len(numbers) != 1 or len(words) > 1 or not 0.0 <= (numbers[0].value or 0.0) <= 1e6:
            raise self._fault(part, "FEDRAT needs one number from 0 to 1e6 and its unit",
                              hint="FEDRAT/1500,MMPM; units: " + " ".join(apt_words.FEEDS))  # fmt: skip
        self._lengths_in = self._lengths_in or f"FEDRAT in line {part.line}"
        self._mode, unit_m = apt_words.FEEDS[words[0]] if words else (94, 0.0)
        self._feed_unit_m = unit_m or self._unit_m
        self._feed, self._rapid = numbers[0].value, False
        return [Word("F", numbers[0].value or 0.0, numbers[0].start, numbers[0].end)]

    def _machine(self, part: AptLine) -> list[Word]:
        """SPINDL, COOLNT, LOADTL, STOP, OPSTOP, FINI as the M codes, S and T that they stand for."""
        at = len(part.text) - len(part.text.lstrip())
        codes = _STOPS[part.major] if part.major in _STOPS else _CODES[part.major](self, part)
        return [Word(letter, number, at, at, False) for letter, number in codes]

    def _spindle(self, part: AptLine) -> list[tuple[str, float]]:
        self._allow(part, ("RPM", "ON", "RANGE", "LOW", "MEDIUM", "HIGH", *apt_words.TURNS))
        gears = [n for word, n in itertools.pairwise(part.arguments) if word.text == "RANGE"]
        speeds = [n.value for n in part.numbers() if n not in gears and n.value is not None]
        if len(speeds) > 1 or not all(0.0 <= speed <= 1e6 for speed in speeds):
            raise self._fault(part, "SPINDL takes one speed, 0 to 1e6 rpm")
        self._rpm = speeds[0] if speeds else self._rpm
        self._turns = next((apt_words.TURNS[word] for word in part.words() if word in apt_words.TURNS), 1)
        return [*(("S", speed) for speed in speeds), ("M", {0: 5, 1: 3, -1: 4}[self._turns])]

    def _coolant(self, part: AptLine) -> list[tuple[str, float]]:
        self._allow(part, tuple(apt_words.COOLANT))
        words = part.words()
        if len(words) != 1 or part.numbers():
            raise self._fault(part, "COOLNT takes one word", hint="One of: " + " ".join(apt_words.COOLANT))
        return [("M", apt_words.COOLANT[words[0]])]

    def _load(self, part: AptLine) -> list[tuple[str, float]]:
        of_load = part.major == "LOAD"
        self._allow(part, (*apt_words.LOADS, "TOOL") if of_load else apt_words.LOADS)
        if of_load and part.words()[:1] != ["TOOL"]:
            raise self._fault(part, "of LOAD only LOAD/TOOL is read", hint="LOAD/TOOL,1")
        value = part.numbers()[0].value if part.numbers() else None
        if value is None or value != int(value) or not 0 <= value <= 99_999:
            raise self._fault(part, f"{part.major} needs the number of a tool first", hint="LOADTL/1, LOAD/TOOL,1")
        self._tool, self._turns = int(value), 0
        return [("T", value), ("M", 6)]

    def _function(self, part: AptLine) -> list[tuple[str, float]]:
        value = part.numbers()[0].value if part.numbers() else None
        if value is None or value not in apt_words.NEUTRAL_M:
            raise self._fault(part, "a function of the machine that is not read: AUXFUN",
                              hint="Use SPINDL, COOLNT, LOADTL, STOP")  # fmt: skip
        return [("M", value)]

    def _delay(self, part: AptLine) -> list[Word]:
        self._allow(part, ())
        time_s = self._values(part, (1,))[0]
        if not 0.0 <= time_s <= 1e6:
            raise self._fault(part, "DELAY is out of range", hint="0 to 1e6 s")
        self._append("dwell", self._p, self._axis, duration_s=time_s)
        return [Word("G", 4.0, 0, 0, False)]

    def _system(self, part: AptLine) -> None:
        """MSYS, CSYS: the coordinates that the points are in; one for the whole file is that of the part."""
        values = tuple(argument.value for argument in part.arguments)
        if self._msys is None and self.motions:
            raise self._fault(
                part, f"a coordinate system {part.major} behind the first motion, which has none",
                hint="State it at the head of the file",
            )  # fmt: skip
        if self._msys is not None and self._msys[0] != values:
            raise self._fault(
                part, f"a second coordinate system {part.major}, other than in line {self._msys[1]}",
                hint="Write the file in one system",
            )  # fmt: skip
        self._msys = values, part.line


_STOPS: Final = {"STOP": [("M", 0)], "OPSTOP": [("M", 1)], "FINI": [("M", 30)], "END": [("M", 30)]}
_CODES: Final = {"SPINDL": AptRun._spindle, "COOLNT": AptRun._coolant, "LOADTL": AptRun._load, "LOAD": AptRun._load,
                 "AUXFUN": AptRun._function}  # fmt: skip
_WORDS: Final = dict.fromkeys((*_STOPS, *_CODES), AptRun._machine) | {
    "GOTO": AptRun._goto, "GODLTA": AptRun._goto, "FEDRAT": AptRun._feedrate, "DELAY": AptRun._delay,
    "CIRCLE": AptRun._circle, "MOVARC": AptRun._circle, TOOL_ON_CIRCLE: AptRun._tool_on_circle}  # fmt: skip
"""Statements that stand for words of a machine."""
_SETTINGS: Final = dict.fromkeys(("UNITS", "UNIT", "MM", "INCH", "INCHES"), AptRun._units) | {
    "RAPID": AptRun._rapid_next, "FROM": AptRun._from, "TLAXIS": AptRun._direct, "INDIRV": AptRun._direct,
    "MULTAX": lambda run, part: run._allow(part, ("ON", "OFF")), "MSYS": AptRun._system, SYSTEM: AptRun._system,
    "GOHOME": AptRun._leave}  # fmt: skip
"""Statements that stand for none."""
