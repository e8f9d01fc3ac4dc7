"""Execute the statements of one block: paths with their M functions, tools, cycles, planes."""

from __future__ import annotations

import functools
import re
from typing import Final

import numpy as np

from counterflex.core.errors import ProgramError
from counterflex.integrations.heidenhain.language.cycle_definitions import define_frame
from counterflex.integrations.heidenhain.language.cycles import DRILLING, Drilling, drilling
from counterflex.integrations.heidenhain.language.moves import KlartextMoveMaker
from counterflex.integrations.heidenhain.language.source import KlartextSource, KlartextStatement
from counterflex.integrations.heidenhain.language.state import KlartextState
from counterflex.integrations.heidenhain.language.table import CYCLES, M_CARRIED, M_READ, M_REFUSED, M_STATE
from counterflex.integrations.heidenhain.language.tilt import tilt
from counterflex.integrations.heidenhain.language.values import VALUE, KlartextValues, required
from counterflex.integrations.heidenhain.language.words import AXES, PathWords
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.program import Block, Word

_TOOL: Final = re.compile(
    r'\s*TOOL\s+CALL\s*(\d+(?:\.\d+)?(?![\d.])|"[^"]*"|Q[LR]?\d+)?\s*(?:([XYZUVW])(?![A-Z0-9+-]))?', re.IGNORECASE
)
_TOOL_WORD: Final = re.compile(rf"\s*(S|FU|FZ|F|DL|DR2|DR)\s*({VALUE})", re.IGNORECASE)
_CYCLE: Final = re.compile(r"\s*CYCL\s+DEF\s+(\d+)(\.0)?", re.IGNORECASE)
_PARAMETER: Final = re.compile(r"(Q\d+)\s*=\s*([^\s;~]+)", re.IGNORECASE)
_TCPM: Final = re.compile(
    r"FUNCTION TCPM F (TCP|CONT) AXIS (POS|SPAT) PATHCTRL (AXIS|VECTOR)(?: REFPNT (\S+))?(?: F\s?\d+)?"
)
_ENDS: Final = frozenset((2, 30))


class Control:
    """Effect of a block on the state of the control."""

    def __init__(self, source: KlartextSource, machine: MillingMachine) -> None:
        self._source = source
        self._tool_names, self._names_open = machine.tool_names, machine.names_open
        vectors = any(tilts(part.code) for part in source.statements)
        self._state = KlartextState(vectors=vectors, inch=source.inch, start_known=machine.known)
        self.values = KlartextValues()
        self.maker = KlartextMoveMaker(self._state, machine.listed)
        self.blocks: list[Block] = []
        self._cycle: Drilling | None = None
        self._cycle_modal = False
        self._preset = ""
        self._ended = False

    def _fault(
        self, part: KlartextStatement, what: str, at: int | None = None, value: object = None, hint: str = ""
    ) -> ProgramError:
        return part.fault(self._source.name, what, at, value, hint)

    def _end_program(self, words: PathWords) -> None:  # noqa: ARG002
        """Execute M2 or M30."""
        self._ended = True

    # ---- paths -------------------------------------------------------------------------------------------------

    def _path(self, part: KlartextStatement, function: str, begin: int) -> tuple[tuple[Word, ...], bool]:
        """Execute a path statement: its words for writers, and whether it made a cycle."""
        words, number = PathWords(part, begin, self.values, self._source.name), len(self.blocks)
        self._before(words)
        machine = next((m for m, _ in words.m if m in (91, 92)), 0)
        self._refuse_correction(words)
        rapid = False if function == "RND" else self._speed(words)
        self._move(words, function, number, rapid, machine)
        self._back(words, number)
        drilled = self._after(words, number, function)
        words.finish()
        self._finish_m(words)
        joined, self.maker.joined = self.maker.joined, ()
        return () if machine else (*joined, *words.written(lambda m: M_READ.get(m, ()))), drilled

    @staticmethod
    def _refuse_correction(words: PathWords) -> None:
        """Refuse what the control computes from its tool table."""
        name = next((name for name in ("RL", "RR", "R+", "R-") if words.has(name)), "")
        if name:
            raise words.fault("radius compensation depends on the tool table of the control", name,
                              "Let the CAM system write the tool-centre path (R0)")  # fmt: skip
        name = next((name for name in ("NX", "NY", "NZ") if words.has(name)), "")
        if name:
            raise words.fault("surface normals let the control correct by the deltas of its tool table", name,
                              "Post LN with TX TY TZ only")  # fmt: skip
        words.take("R0")

    def _move(self, words: PathWords, function: str, number: int, rapid: bool, machine: int) -> None:
        maker = self.maker
        if machine and function != "L":
            raise words.fault(f"M{machine} goes with L only", None, "L Z-1 R0 FMAX M91")
        if machine:
            axes = {axis for axis, letter in enumerate(AXES) if words.take(letter) is not None}
            turned = [letter for letter in "ABC" if words.take_item(letter) is not None]
            if turned:
                raise words.fault(
                    f"a rotary axis in coordinates of the machine (M{machine})", turned[0], "Leave M91 out"
                )
            if axes:
                maker.leave(number, f"M{machine}", words.part.line, axes)
        elif function in ("L", "LN", "LP"):
            maker.straight(words, number, rapid=rapid, polar=function == "LP")
        elif function == "CC":
            maker.centre(words)
        elif function == "RND":
            maker.rounding(words, number)
        elif rapid:
            raise words.fault("FMAX on an arc", "FMAX", "Write F")
        elif function == "CP":
            maker.polar_arc(words, number)
        else:
            maker.arc(words, number, kind=function)

    def _speed(self, words: PathWords) -> bool:
        """Use F, FU, FAUTO and FMAX; whether the block is a rapid."""
        state = self._state
        if words.has("FZ"):
            raise words.fault("feed per tooth: the number of teeth is in the tool table", "FZ", "Write F in mm/min")
        given = [name for name in ("F", "FU", "FAUTO", "FMAX") if words.has(name)]
        if len(given) > 1:
            raise words.fault("two feeds in one block", given[1], "Write one")
        if words.take("FMAX") is not None:
            return True
        if words.take("FAUTO") is not None:
            if state.called_feed is None:
                raise words.fault("F AUTO without F in TOOL CALL", "FAUTO", "Write F in mm/min")
            state.feed, state.per_turn = state.called_feed, False
        for name in ("F", "FU"):
            value = words.take(name)
            if value is not None:
                if not 0.0 < value <= 1e6:
                    raise words.fault("the feed is out of range", name, "Above 0 and at most 1e6")
                state.feed, state.per_turn = value, name == "FU"
        return False

    def _before(self, words: PathWords) -> None:
        """M functions that act at the start of a block, and those that are refused."""
        state = self._state
        for number, item in words.m:
            if number in M_REFUSED or number not in {*M_READ, *M_CARRIED, *M_STATE}:
                what, hint = M_REFUSED.get(
                    number, ("an M function of the machine builder is not read", "Leave it out, and write it by hand")
                )
                raise words.fault(f"{what}: M{number}", item, hint)
            if number == 94 and any(state.angles[: 2 if state.vectors else 3]):
                raise words.fault("M94 changes the value of a rotary axis that is turned", item, "Turn it back before")
            if number in (3, 13):
                state.spindle = 1
            elif number in (4, 14):
                state.spindle = -1
            elif number == 126:
                state.shortest = True
            elif number == 128:
                state.tcpm = True
        for name in ("F|M", "X|M", "Y|M", "Z|M", "LA"):
            words.take(name)

    def _back(self, words: PathWords, number: int) -> None:
        """M140: along the tool axis to a place that the control computes, or by a distance."""
        if not words.has("MB"):
            return
        words.take("MB")
        if not any(m == 140 for m, _ in words.m):
            raise words.fault("MB without M140", "MB")
        self.maker.leave(number, "M140", words.part.line, {0, 1, 2} if self._state.vectors else {2})

    def _after(self, words: PathWords, number: int, function: str) -> bool:
        """Make the cycle of M99 or M89; whether one was made."""
        codes = [m for m, _ in words.m]
        self._cycle_modal = self._cycle_modal or 89 in codes
        if not (99 in codes or (self._cycle_modal and function in ("L", "LP") and words.items)):
            return False
        if 99 in codes:
            self._cycle_modal = False
        self._drill(words, number)
        return True

    def _drill(self, words: PathWords, number: int) -> None:
        if self._cycle is None:
            raise words.fault("a cycle is called, and none has been defined", None, "CYCL DEF 200 before")
        self.maker.drill(words, number, self._cycle)

    def _finish_m(self, words: PathWords) -> None:
        """M functions that act at the end of a block."""
        state = self._state
        for number, _ in words.m:
            if number in (5, 6):
                state.spindle = 0
            elif number == 127:
                state.shortest = False
            elif number == 129:
                state.tcpm = False
            elif number in _ENDS:
                self._end_program(words)
                state.spindle = 0

    def _machine_functions(self, part: KlartextStatement, begin: int | None = None) -> tuple[Word, ...]:
        """A block of M functions alone, perhaps with the words that they take."""
        words = PathWords(part, part.start if begin is None else begin, self.values, self._source.name)
        if any(m in (91, 92) for m, _ in words.m):
            raise words.fault("M91 and M92 without a motion", None, "L Z-1 R0 FMAX M91")
        self._before(words)
        number = len(self.blocks)
        self._back(words, number)
        if self._after(words, number, "M"):
            raise words.fault("M99 alone in a block", None, "Write CYCL CALL")
        words.finish()
        self._finish_m(words)
        return words.written(lambda m: M_READ.get(m, ()))

    # ---- tools, cycles, planes ---------------------------------------------------------------------------------

    def _tool_call(self, part: KlartextStatement) -> tuple[Word, ...]:
        match, state = _TOOL.match(part.code), self._state
        assert match is not None
        if match[2] is not None and match[2].upper() != "Z":
            raise self._fault(part, "a tool axis other than Z is not read", match.start(2), match[2],
                              "Post the program for tool axis Z")  # fmt: skip
        out, at = list[Word](), match.end()
        if match[1] is not None:
            state.tool, state.spindle = self._tool_number(part, match), 0
            out += [Word("T", float(state.tool), *match.span(1), True), Word("M", 6.0, *match.span(1), False)]
        while part.code[at:].strip():
            word = _TOOL_WORD.match(part.code, at)
            if word is None:
                column = at + len(part.code[at:]) - len(part.code[at:].lstrip())
                raise self._fault(part, "an unknown word in TOOL CALL", column, part.code[column:].split()[0][:20],
                                  "TOOL CALL 1 Z S5000 F300")  # fmt: skip
            name, at = word[1].upper(), word.end()
            value = required(self.values.number(word[2]), name, part.place(self._source.name, word.start(1)), part.code)
            self._tool_word(part, name, value, word)
            if name == "S":
                out.append(Word("S", value, word.start(1), word.end(), "Q" not in word[2].upper()))
        return tuple(out)

    def _tool_number(self, part: KlartextStatement, match: re.Match[str]) -> int:
        text = match[1]
        if text.startswith('"'):
            named = self._tool_names.get(text.strip('"').upper())
            if named is None and self._names_open:
                return 0
            if named is None:
                raise self._fault(part, "the cell file has no tool of this name", match.start(1), text,
                                  "tools.name of the cell file, or call it by number")  # fmt: skip
            return named
        value = self.values.number(text) if text[:1] in "Qq" else float(text)
        number = required(value, "the tool", part.place(self._source.name, match.start(1)), part.code)
        if number != int(number) or not 0 <= number <= 32_767:
            raise self._fault(part, "a tool is called by a whole number", match.start(1), text, "0 to 32767")
        return int(number)

    def _tool_word(self, part: KlartextStatement, name: str, value: float, word: re.Match[str]) -> None:
        state = self._state
        if name == "S":
            if not 0.0 <= value <= 1e6:
                raise self._fault(part, "the spindle speed is out of range", word.start(1), word[0].strip(), "0 to 1e6")
            state.speed_rpm = value
        elif name == "DL" and value != 0.0:
            raise self._fault(part, "a delta of the tool length moves the tool off the programmed path", word.start(1),
                              word[0].strip(), "Post the path with the allowance in it, DL+0")  # fmt: skip
        elif name in ("FU", "FZ"):
            raise self._fault(part, f"{name} in TOOL CALL is not read", word.start(1), word[0].strip(), "F in mm/min")
        elif name == "F":
            if not 0.0 < value <= 1e6:
                raise self._fault(part, "the feed is out of range", word.start(1), word[0].strip(), "Above 0, <= 1e6")
            state.feed, state.called_feed, state.per_turn = value, value, False

    def _cycle_define(self, part: KlartextStatement) -> tuple[Word, ...]:
        match = _CYCLE.match(part.code)
        if match is None:
            raise self._fault(part, "CYCL DEF needs the number of a cycle", None, None, "CYCL DEF 200 DRILLING")
        number = int(match[1])
        treatment = CYCLES.get(number)
        if number in DRILLING:
            self._cycle, self._cycle_modal = self._drilling(part, number), False
        elif number == 9:
            return self._dwell(part)
        elif number == 247:
            self._use_preset(part)
        elif treatment == "":
            return ()
        elif treatment is None or number not in (7, 8, 10, 11, 19, 26):
            shown = treatment or "this cycle is not read"
            raise self._fault(part, f"{shown}: CYCL DEF {number}", None, None,
                              "Let the CAM system write the moves of the cycle")  # fmt: skip
        else:
            before = self._state.frames.A, self._state.frames.t
            tilted = define_frame(part, number, self._state, self.values, self._source.name)
            self._state.frame_changed(before, tilted)
            if tilted:
                self._state.aligned = self._stands_upright()
        return ()

    def _drilling(self, part: KlartextStatement, number: int) -> Drilling:
        given: dict[str, float] = {}
        for match in _PARAMETER.finditer(part.code):
            where = part.place(self._source.name, match.start())
            if re.fullmatch(VALUE, match[2], re.IGNORECASE) is None:
                raise self._fault(part, f"{match[1].upper()} of cycle {number} is no number", match.start(), match[0],
                                  "Write a number")  # fmt: skip
            value = required(self.values.number(match[2]), match[1].upper(), where, part.code)
            given[match[1].upper()] = value
            self.values.set(match[1], value)

        return drilling(number, given, self._state.unit_m, functools.partial(self._cycle_fault, part))

    def _cycle_fault(self, part: KlartextStatement, what: str, name: str, hint: str) -> ProgramError:
        """Return the fault of a parameter of a cycle."""
        at = next((m.start() for m in _PARAMETER.finditer(part.code) if m[1].upper() == name), None)
        return self._fault(part, what, at, None, hint)

    def _dwell(self, part: KlartextStatement) -> tuple[Word, ...]:
        match = re.search(rf"CYCL\s+DEF\s+9\.1\s+(?:[A-Z. ]*?)({VALUE})\s*$", part.code, re.IGNORECASE)
        if match is None:
            raise self._fault(part, "cycle 9 needs its time", None, None, "CYCL DEF 9.1 DWELL 0.5")
        time_s = required(self.values.number(match[1]), "the dwell", part.place(self._source.name, match.start(1)),
                          part.code)  # fmt: skip
        if not 0.0 <= time_s <= 3600.0:
            raise self._fault(part, "the dwell is out of range", match.start(1), match[1], "0 to 3600 s")
        self.maker.dwell(len(self.blocks), time_s)
        return (Word("G", 4.0, part.start, part.start, False), Word("P", time_s, *match.span(1), "Q" not in match[1]))

    def _use_preset(self, part: KlartextStatement) -> None:
        match = re.search(r"Q339\s*=\s*\+?(\d+)", part.code, re.IGNORECASE)
        if match is None:
            raise self._fault(part, "cycle 247 needs the number of the preset", None, None, "Q339=+1")
        if self._preset not in ("", match[1]) or self.maker.motions:
            raise self._fault(part, f"how far preset {match[1]} lies from the one before is not in the program",
                              match.start(), match[0], "Use one preset, and cycle 7 for shifts")  # fmt: skip
        self._preset = match[1]

    def _cycle_call(self, part: KlartextStatement) -> tuple[Word, ...]:
        begin = re.match(r"\s*CYCL\s+CALL", part.code, re.IGNORECASE)
        assert begin is not None
        if re.match(r"\s*(PAT|POS)\b", part.code[begin.end() :], re.IGNORECASE):
            raise self._fault(part, "a pattern or position of a cycle call is not read", None, None,
                              "Write L X+.. Y+.. R0 FMAX M99")  # fmt: skip
        words = PathWords(part, begin.end(), self.values, self._source.name)
        self._before(words)
        words.take("FMAX")
        self._drill(words, len(self.blocks))
        words.finish()
        self._finish_m(words)
        return words.written(lambda m: M_READ.get(m, ()))

    def _plane(self, part: KlartextStatement) -> tuple[Word, ...]:
        before = self._state.frames.A, self._state.frames.t
        turned = tilt(part, self._state, self.values, self._source.name)
        self._state.frame_changed(before, True)
        self._state.aligned = turned or self._stands_upright()
        return ()

    def _stands_upright(self) -> bool:
        """The tool stands at right angles to the working plane without being turned."""
        state = self._state
        return not state.vectors or bool(np.allclose(state.angles, state.plane_axis, rtol=0.0, atol=1e-12))

    def _tcpm(self, part: KlartextStatement) -> tuple[Word, ...]:
        head = " ".join(part.code.upper().split())
        if head.startswith("FUNCTION RESET TCPM"):
            self._state.tcpm = False
            return ()
        if head == "FUNCTION MODE MILL":
            return ()
        match = _TCPM.fullmatch(head)
        if match is None or match.groups()[:3] != ("TCP", "POS", "AXIS") or match[4] not in (None, "TIP-TIP"):
            raise self._fault(part, "of FUNCTION only one way of guiding the tool is read", None, head[:60],
                              "FUNCTION TCPM F TCP AXIS POS PATHCTRL AXIS")  # fmt: skip
        self._state.tcpm = True
        return ()


_TILTS: Final = re.compile(r"\s*PLANE\s+(?!RESET)|\s*CYCL\s+DEF\s+19\b|\s*LN\b.*\bT[XYZ]\s*[+-]?[\d.Q]", re.IGNORECASE)


def tilts(code: str) -> bool:
    """Return whether a statement gives the tool a direction in the part: PLANE, cycle 19, LN with TX TY TZ."""
    return _TILTS.match(code) is not None
