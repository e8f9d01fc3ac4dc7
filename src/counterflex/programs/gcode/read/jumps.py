"""O words, M98 and M99 as jumps: loops, conditions and subroutines, in the program or in files of their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.read.block import BlockWords
from counterflex.programs.gcode.read.codes import code_name
from counterflex.programs.gcode.read.expression import Expression
from counterflex.programs.gcode.read.flow import LOOPS, Construct, GcodeSource, MacroFlow, split_lines
from counterflex.programs.gcode.read.parameters import ARGUMENTS, GcodeParameters, UnknownValue
from counterflex.programs.gcode.read.scanner import FlowWord, error_at
from counterflex.programs.gcode.read.state import ModalState
from counterflex.programs.unknown import Unknown

Include = Callable[[str], tuple[str, str] | None]
"""Returns file name and text of a subroutine by its name, or None."""
DEEPEST_CALL: Final = 10
MOST_REPEATS: Final = 1_000_000_000
MACRO_ARGUMENTS: Final = {
    letter: number
    for number, letter in ((1, "A"), (2, "B"), (3, "C"), (7, "D"), (8, "E"), (9, "F"), (11, "H"), (4, "I"), (5, "J"),
                           (6, "K"), (13, "M"), (17, "Q"), (18, "R"), (19, "S"), (20, "T"), (21, "U"), (22, "V"),
                           (23, "W"), (24, "X"), (25, "Y"), (26, "Z"))
}  # fmt: skip
"""Parameter of each letter in a block with G65 (Fanuc, argument specification I)."""


@dataclass
class SubroutineCall:
    """A running subroutine: where to go back to, what M98 and G65 still have to repeat, whether it has parameters."""

    source: GcodeSource
    back: int
    entry: int
    modern: bool
    repeats: int = 1
    counters: dict[int, int] = field(default_factory=dict)
    scope: bool = False


@dataclass
class Place:
    """Line about to be executed."""

    source: GcodeSource
    index: int


class FlowRunner:
    """Knows where the program stands and where it goes on.

    Args:
        state: Read by parameters.
        parameters: Known at the start.
        includes: Returns name and text of a subroutine's file, or None.
    """

    def __init__(
        self,
        source: GcodeSource,
        state: ModalState,
        parameters: Mapping[str | int, float] | None,
        includes: Include | None,
    ) -> None:
        self._main = source
        self._place = Place(source, 0)
        self._parameters = GcodeParameters(parameters, state, self._fault)
        self._includes = includes
        self._included: dict[str, GcodeSource | None] = {}
        self._frames: list[SubroutineCall] = []
        self._counters: dict[int, int] = {}

    def _fault(self, what: str, column: int, value: object = None, hint: str | None = None) -> ProgramError:
        return error_at(self._place.source.name, self._place.index + 1, what, column, value, hint)

    def _value(self, expression: Expression | None, use: str, column: int = 0) -> float:
        """Value of an expression that a statement needs; refuses one that is not known."""
        value = self._open_value(expression)
        if isinstance(value, Unknown):
            raise self._fault(f"{use} is not known: {value}", column, None, "Write the value itself")
        return value

    def _open_value(self, expression: Expression | None) -> float | Unknown:
        """Value of an expression, known or not."""
        try:
            return 0.0 if expression is None else expression.evaluate(self._parameters)
        except UnknownValue as unknown:
            return unknown.value

    def _jump(self, source: GcodeSource, index: int, flow: FlowWord) -> Place | None:
        """Execute an O word."""
        keyword = flow.keyword
        if keyword == "call":
            arguments: list[float | Unknown | None] = [self._open_value(argument) for argument in flow.arguments]
            return self._call(source, index, self._label(flow), arguments, 1, flow.column, modern=True)
        if keyword in ("return", "endsub"):
            value = self._open_value(flow.arguments[0]) if flow.arguments else None
            if not self._frames or not self._frames[-1].modern:
                raise self._fault(f"O... {keyword} outside a subroutine that was called", flow.column)
            return self._return(value, explicit=True)
        if keyword in ("break", "continue"):
            loop = source.loop_around(index, self._label(flow))
            if loop is None:
                raise self._fault(f"{keyword} stands in no loop of its label", flow.column, f"O{self._label(flow)}")
            if keyword == "break":
                self._loop_counters().pop(loop.start, None)
                return Place(source, loop.end + 1)
            return Place(source, loop.start if loop.keyword == "while" else loop.end)
        construct = source.at.get(index)
        if construct is None:
            return None
        if keyword == "sub":
            return Place(source, construct.end + 1)
        if keyword in ("if", "elseif", "else"):
            return self._condition(source, index, keyword, construct)
        if construct.keyword in LOOPS:
            return self._loop(source, index, flow, construct)
        return None

    def _condition(self, source: GcodeSource, index: int, keyword: str, construct: Construct) -> Place | None:
        """Go to the branch whose condition holds; a branch that is reached from above has run and leaves."""
        if keyword != "if":
            return Place(source, construct.end)
        here = self._place
        for branch in (index, *construct.branches):
            flow = source.scan(branch).flow
            if flow is None or flow.keyword in ("else", "endif"):
                self._place = here
                return Place(source, branch + 1)
            self._place = Place(source, branch)
            if self._value(flow.arguments[0], "a condition") != 0.0:
                self._place = here
                return Place(source, branch + 1)
        return None

    def _loop_counters(self) -> dict[int, int]:
        return self._frames[-1].counters if self._frames else self._counters

    def _loop(self, source: GcodeSource, index: int, flow: FlowWord, loop: Construct) -> Place | None:
        if loop.keyword == "repeat":
            counters = self._loop_counters()
            if index == loop.start:
                count = self._value(flow.arguments[0], "the number of repetitions")
                if not abs(count) <= MOST_REPEATS:
                    raise self._fault("the number of repetitions is out of range", flow.column, f"{count:g}")
                counters[index] = round(count)
                if counters[index] < 1:
                    return Place(source, loop.end + 1)
                return None
            counters[loop.start] = counters.get(loop.start, 1) - 1
            return Place(source, loop.start + 1) if counters[loop.start] > 0 else None
        if loop.keyword == "while":
            if index == loop.end:
                return Place(source, loop.start)
            return None if self._value(flow.arguments[0], "a condition") != 0.0 else Place(source, loop.end + 1)
        if index == loop.end and self._value(flow.arguments[0], "a condition") != 0.0:
            return Place(source, loop.start + 1)
        return None

    def _label(self, flow: FlowWord) -> str:
        if isinstance(flow.label, str):
            return flow.label
        value = self._value(flow.label, "the number of a subroutine")
        if value != round(value) or value < 0.0:
            raise self._fault("an O number is not whole", flow.column, f"{value:g}")
        return f"{value:g}"

    def _call(
        self,
        source: GcodeSource,
        index: int,
        label: str,
        arguments: list[float | Unknown | None] | None,
        repeats: int,
        column: int,
        modern: bool = False,
    ) -> Place:
        self._refuse_depth(column)
        target, entry = self._find(source, label, modern, column)
        self._frames.append(SubroutineCall(source, index + 1, entry, modern, repeats, scope=arguments is not None))
        if arguments is not None:
            self._parameters.enter(arguments)
        return Place(target, entry)

    def _find(self, source: GcodeSource, label: str, modern: bool, column: int) -> tuple[GcodeSource, int]:
        """Find a subroutine here, in the main program, or in a file of its name."""
        included = None
        for place in (source, self._main):
            entry = self._entry(place, label, modern)
            if entry is not None:
                return place, entry
        if self._includes is not None:
            if label not in self._included:
                file = self._includes(label)
                self._included[label] = None if file is None else GcodeSource(file[0], split_lines(file[1]))
            included = self._included[label]
            if included is not None:
                entry = self._entry(included, label, modern)
                if entry is None and not modern and not included.labels:
                    entry = 0  # a file that is the subprogram, without a number
                if entry is not None:
                    return included, entry
        raise self._fault("the subroutine is not defined", column, f"O{label}",
                          "Put its file into the folder of the program, named by its number")  # fmt: skip

    def _defined(self, source: GcodeSource, label: str) -> bool:
        try:
            self._find(source, label, False, 0)
        except ProgramError:
            return False
        return True

    # Fanuc macros ---------------------------------------------------------------------------------------------------

    def _macro_flow(self, source: GcodeSource, index: int, flow: MacroFlow) -> Place | None:
        """Return the place that a line of the flow of a macro leads to; None: the next line. The caller runs a THEN."""
        if flow.condition is not None and self._value(flow.condition, "a condition") == 0.0:
            return Place(source, source.loops.get(index, index) + 1) if flow.keyword == "while" else None
        if flow.target is not None:
            number = self._value(flow.target, "the target of a jump")
            place = source.jump(round(number), index)
            if place is None:
                raise self._fault("a jump to a block that is not there", 0, f"N{number:g}", "Write the block number")
            return Place(source, place)
        if flow.keyword in ("while", "do") and index not in source.loops:
            raise self._fault(f"DO{flow.loop} is never closed", 0, None, f"Write END{flow.loop}")
        return Place(source, source.loops[index]) if flow.keyword == "end" else None

    # M97, M98, M99, G65 ---------------------------------------------------------------------------------------------

    def _subprogram(self, source: GcodeSource, block: BlockWords) -> Callable[[], Place | None] | None:
        """Return the target of M97, M98, M99 or G65; None where the block has none of them."""
        stop, index = block.m.get("stopping"), self._place.index
        if block.g.get("non-modal") == 650:
            return self._macro(source, block)
        if stop in (970, 980):
            number = block.whole("P", 1, 99_999_999)
            if number is None:
                code = code_name("M", stop)
                raise block.fault(f"{code} needs the number P of the subprogram", f"M{stop}", code)
            repeats = block.whole("L", 1, MOST_REPEATS) or 1
            if stop == 970:
                place = number
                return lambda: self._call_block(source, index, place, repeats)
            if number > 9999 and repeats == 1 and not self._defined(source, str(number)):
                repeats, number = divmod(number, 10_000)  # Fanuc: repetitions before the last four digits
            return lambda: self._call(source, index, str(number), None, repeats, 0)
        if stop == 990:
            if block.has("P"):
                raise block.fault("M99 P jumps to a block and is not read", "P", None, "Write GOTO")
            if not self._frames or self._frames[-1].modern:
                raise block.fault(
                    "M99 outside a subprogram runs the program for ever", "M990", "M99", "End it with M2 or M30"
                )
            return lambda: self._return(None)
        return None

    def _macro(self, source: GcodeSource, block: BlockWords) -> Callable[[], Place | None]:
        """G65: the letters of the block are the parameters of the macro; those it leaves out have no value."""
        number, index = block.whole("P", 1, 99_999_999), self._place.index
        if number is None:
            raise block.fault("G65 needs the number P of the macro", "G650", "G65")
        repeats = block.whole("L", 1, MOST_REPEATS) or 1
        arguments: list[float | Unknown | None] = [None] * ARGUMENTS
        for letter, place in MACRO_ARGUMENTS.items():
            if block.has(letter):
                arguments[place - 1] = block.take(letter)
        return lambda: self._call(source, index, str(number), arguments, repeats, 0)

    def _call_block(self, source: GcodeSource, index: int, number: int, repeats: int) -> Place:
        """M97: go on at a block number of the same file, until M99."""
        self._refuse_depth(0)
        entry = source.jump(number, -1)
        if entry is None:
            raise self._fault("M97 names a block that is not there", 0, f"N{number}", "Write the block number")
        self._frames.append(SubroutineCall(source, index + 1, entry, False, repeats))
        return Place(source, entry)

    def _refuse_depth(self, column: int) -> None:
        if len(self._frames) >= DEEPEST_CALL:
            raise self._fault(
                "subroutines call each other too deeply", column, f"more than {DEEPEST_CALL} levels",
                "Look for a subroutine that calls itself",
            )  # fmt: skip

    @staticmethod
    def _entry(source: GcodeSource, label: str, modern: bool) -> int | None:
        if modern:
            sub = source.subs.get(label)
            return None if sub is None else sub.start + 1
        start = source.labels.get(label)
        return None if start is None else start + 1

    def _return(self, value: float | Unknown | None, explicit: bool = False) -> Place:
        frame = self._frames[-1]
        if explicit:
            self._parameters.leave()
            self._parameters.returned(value)
        elif frame.repeats > 1:
            frame.repeats -= 1
            frame.counters.clear()
            return Place(self._place.source, frame.entry)
        elif frame.scope:
            self._parameters.leave()
        self._frames.pop()
        return Place(frame.source, frame.back)
