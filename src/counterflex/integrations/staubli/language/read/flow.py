"""Branches and loops of a VAL3 program."""

from __future__ import annotations

from typing import cast

from counterflex.integrations.staubli.language.read.branches import FOR, Val3Branches
from counterflex.integrations.staubli.language.read.program_file import Val3Routine, arguments
from counterflex.programs.expression import Value, is_number
from counterflex.programs.unknown import Unknown


class Val3Flow(Val3Branches):
    """Decides which line follows."""

    def decision(self, routine: Val3Routine, at: int, text: str) -> bool | Unknown:
        """Return the value of a condition. Raises ProgramError: it is none."""
        value = self.value(routine, at, text)
        if isinstance(value, Unknown):
            return Unknown(value.why, value.where or f"{routine.name}:{at + 1}")
        if not isinstance(value, bool):
            raise routine.fault(at, "this is no condition", limit="if nA==1", hint="Post the program again")
        return value

    def do_next(self, _: Val3Routine, at: int) -> int:
        """Go on behind the line."""
        return at + 1

    def do_return(self, routine: Val3Routine, _: int) -> int:
        """End the program."""
        return routine.last

    def do_if(self, routine: Val3Routine, at: int) -> int:
        """The first branch whose condition holds; all of them are passed where one is not known."""
        branches = [at, *routine.branches.get(at, [])]
        end = routine.ends[at]
        for branch in branches:
            code = routine.codes[branch]
            if not code.startswith("elseIf") and branch != at:
                return branch + 1
            decision = self.decision(routine, branch, code.removeprefix("elseIf").removeprefix("if"))
            if isinstance(decision, Unknown):
                self.act(routine, branch)
                self.pass_over(routine, branch + 1, end, decision, ("if", branch + 1))
                return end + 1
            if decision:
                return branch + 1
        return end + 1

    def do_else(self, routine: Val3Routine, at: int) -> int:
        """The branch before is done: go on behind the end of the block."""
        return routine.ends[routine.ends[at]] + 1

    def do_while(self, routine: Val3Routine, at: int) -> int:
        """A loop while a condition holds."""
        end = routine.ends[at]
        decision = self.decision(routine, at, routine.codes[at].removeprefix("while"))
        if isinstance(decision, Unknown):
            self.act(routine, at)
            self.pass_over(routine, at + 1, end, decision, ("while", at + 1))
            return end + 1
        return at + 1 if decision else end + 1

    def do_repeat(self, routine: Val3Routine, at: int) -> int:
        """Go back to while."""
        return routine.ends[at]

    def do_until(self, routine: Val3Routine, at: int) -> int:
        """Repeat until a condition holds."""
        decision = self.decision(routine, at, routine.codes[at].removeprefix("until"))
        if isinstance(decision, Unknown):
            self.act(routine, at)
            for line in range(routine.ends[at] + 1, at):
                if routine.codes[line]:
                    self._pass(routine, line, decision, ("until", at + 1), 0)
            return at + 1
        return at + 1 if decision else routine.ends[at] + 1

    def _for(self, routine: Val3Routine, at: int) -> tuple[str, list[Value]]:
        match = FOR.fullmatch(routine.codes[at])
        if match is None:
            raise routine.fault(
                at, "for is not understood", limit="for nA=0 to 5 step 1", hint="Post the program again"
            )
        return match[1].strip(), [self.value(routine, at, text) for text in (match[2], match[3], match[4] or "1")]

    def do_for(self, routine: Val3Routine, at: int) -> int:
        """A counted loop."""
        counter, values = self._for(routine, at)
        end = routine.ends[at]
        unknown = next((one for one in values if isinstance(one, Unknown)), None)
        if unknown is not None:
            self.act(routine, at)
            condition = Unknown(unknown.why, unknown.where or f"{routine.name}:{at + 1}")
            self.pass_over(routine, at, end, condition, ("for", at + 1))
            return end + 1
        self.put(routine, at, counter, values[0])
        return at + 1 if self._within(routine, at, values[0], values) else end + 1

    def _within(self, routine: Val3Routine, at: int, value: Value, values: list[Value]) -> bool:
        if not all(is_number(one) for one in (value, *values)):
            raise routine.fault(at, "for counts with what is no number", limit="for nA=0 to 5 step 1")
        last, step = cast("float", values[1]), cast("float", values[2])
        if step == 0.0:
            raise routine.fault(at, "for repeats without end: its step is 0", limit="a step that is not 0")
        return cast("float", value) <= last if step > 0.0 else cast("float", value) >= last

    def do_end_for(self, routine: Val3Routine, at: int) -> int:
        """Count on, and go back while the end is not passed."""
        begin = routine.ends[at]
        match = FOR.fullmatch(routine.codes[begin])
        counter = "" if match is None else match[1].strip()
        value = self.value(routine, begin, counter)
        _, values = self._for(routine, begin)
        unknown = next((one for one in (value, *values) if isinstance(one, Unknown)), None)
        if unknown is not None:
            raise self.refusal(routine, begin, unknown, ("for", begin + 1))
        then = cast("float", value) + cast("float", values[2])
        self.put(routine, begin, counter, then)
        return begin + 1 if self._within(routine, begin, then, values) else at + 1

    def do_switch(self, routine: Val3Routine, at: int) -> int:
        """The branch whose value fits, else default."""
        end = routine.ends[at]
        value = self.value(routine, at, routine.codes[at].removeprefix("switch"))
        if isinstance(value, Unknown):
            self.act(routine, at)
            condition = Unknown(value.why, value.where or f"{routine.name}:{at + 1}")
            self.pass_over(routine, at + 1, end, condition, ("switch", at + 1))
            return end + 1
        default = end
        for branch in routine.branches.get(at, []):
            code = routine.codes[branch]
            if code.startswith("default"):
                default = branch
                continue
            text = code.removeprefix("case").strip().removesuffix(":")
            values = [self.value(routine, branch, text[a:b]) for a, b in arguments(text, 0, len(text))]
            if value in values:
                return branch + 1
        return default + 1

    def do_break(self, routine: Val3Routine, at: int) -> int:
        """Go on behind the end of switch."""
        inner = [end for begin, end in routine.ends.items() if begin < at < end and routine.codes[end] == "endSwitch"]
        if not inner:
            raise routine.fault(at, "break stands outside of switch", hint="The file may be damaged")
        return min(inner) + 1
