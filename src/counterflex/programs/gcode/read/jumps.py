"""O words, M98 and M99 as jumps: loops, conditions and subroutines, in the program or in files of their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.read.expression import Expression
from counterflex.programs.gcode.read.flow import LOOPS, Construct, Source, split_lines
from counterflex.programs.gcode.read.parameters import Parameters
from counterflex.programs.gcode.read.scanner import FlowWord, error_at
from counterflex.programs.gcode.read.state import State

DEEPEST_CALL: Final = 10
MOST_REPEATS: Final = 1_000_000_000


@dataclass
class Frame:
    """A running subroutine: where to go back to, and what an M98 still has to repeat."""

    source: Source
    back: int
    entry: int
    modern: bool
    repeats: int = 1
    counters: dict[int, int] = field(default_factory=dict)


@dataclass
class Place:
    """Line about to be executed."""

    source: Source
    index: int


class FlowRunner:
    """Knows where the program stands and where it goes on.

    Args:
        source: The main program.
        state: Read by parameters.
        parameters: Known at the start.
        includes: Returns the text of a subroutine's file by name, or None.
    """

    def __init__(
        self,
        source: Source,
        state: State,
        parameters: Mapping[str | int, float] | None,
        includes: Callable[[str], str | None] | None,
    ) -> None:
        self._main = source
        self._place = Place(source, 0)
        self._parameters = Parameters(parameters, state, self._fault)
        self._includes = includes
        self._included: dict[str, Source | None] = {}
        self._frames: list[Frame] = []
        self._counters: dict[int, int] = {}

    def _fault(self, what: str, column: int, value: object = None, hint: str | None = None) -> ProgramError:
        return error_at(self._place.source.name, self._place.index + 1, what, column, value, hint)

    def _value(self, expression: Expression | None) -> float:
        return 0.0 if expression is None else expression.evaluate(self._parameters)

    def _jump(self, source: Source, index: int, flow: FlowWord) -> Place | None:
        """Execute an O word."""
        keyword = flow.keyword
        if keyword == "call":
            arguments = [self._value(argument) for argument in flow.arguments]
            return self._call(source, index, self._label(flow), arguments, 1, True, flow.column)
        if keyword in ("return", "endsub"):
            value = self._value(flow.arguments[0]) if flow.arguments else None
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

    def _condition(self, source: Source, index: int, keyword: str, construct: Construct) -> Place | None:
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
            if self._value(flow.arguments[0]) != 0.0:
                self._place = here
                return Place(source, branch + 1)
        return None

    def _loop_counters(self) -> dict[int, int]:
        return self._frames[-1].counters if self._frames else self._counters

    def _loop(self, source: Source, index: int, flow: FlowWord, loop: Construct) -> Place | None:
        if loop.keyword == "repeat":
            counters = self._loop_counters()
            if index == loop.start:
                count = self._value(flow.arguments[0])
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
            return None if self._value(flow.arguments[0]) != 0.0 else Place(source, loop.end + 1)
        if index == loop.end and self._value(flow.arguments[0]) != 0.0:
            return Place(source, loop.start + 1)
        return None

    def _label(self, flow: FlowWord) -> str:
        if isinstance(flow.label, str):
            return flow.label
        value = flow.label.evaluate(self._parameters)
        if value != round(value) or value < 0.0:
            raise self._fault("an O number is not whole", flow.column, f"{value:g}")
        return f"{value:g}"

    def _call(
        self, source: Source, index: int, label: str, arguments: list[float], repeats: int, modern: bool, column: int
    ) -> Place:
        if len(self._frames) >= DEEPEST_CALL:
            raise self._fault(
                "subroutines call each other too deeply", column, f"more than {DEEPEST_CALL} levels",
                "Look for a subroutine that calls itself",
            )  # fmt: skip
        target, entry = self._find(source, label, modern, column)
        self._frames.append(Frame(source, index + 1, entry, modern, repeats))
        if modern:
            self._parameters.enter(arguments)
        return Place(target, entry)

    def _find(self, source: Source, label: str, modern: bool, column: int) -> tuple[Source, int]:
        """Find a subroutine here, in the main program, or in a file of its name."""
        included = None
        for place in (source, self._main):
            entry = self._entry(place, label, modern)
            if entry is not None:
                return place, entry
        if self._includes is not None:
            if label not in self._included:
                text = self._includes(label)
                self._included[label] = None if text is None else Source(f"{label}.ngc", split_lines(text))
            included = self._included[label]
            if included is not None:
                entry = self._entry(included, label, modern)
                if entry is not None:
                    return included, entry
        raise self._fault("the subroutine is not defined", column, f"O{label}")

    @staticmethod
    def _entry(source: Source, label: str, modern: bool) -> int | None:
        if modern:
            sub = source.subs.get(label)
            return None if sub is None else sub.start + 1
        start = source.labels.get(label)
        return None if start is None else start + 1

    def _return(self, value: float | None, explicit: bool = False) -> Place:
        frame = self._frames[-1]
        if explicit:
            self._parameters.leave()
            self._parameters.returned(value)
        elif frame.repeats > 1:
            frame.repeats -= 1
            frame.counters.clear()
            return Place(self._place.source, frame.entry)
        self._frames.pop()
        return Place(frame.source, frame.back)
