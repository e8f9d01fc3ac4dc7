"""Routines that are called several times, written once for each call that needs other targets."""

from __future__ import annotations

import itertools
import re

from counterflex.core.errors import ProgramError
from counterflex.core.next_command import next_command
from counterflex.integrations.abb.language import LIMITS
from counterflex.integrations.abb.language.program import RapidProgram, RoutineCall
from counterflex.programs.robot_text.spans import Spans


class Copies:
    """Puts edits of each execution of a routine together.

    The first execution changes the routine itself; a later one with other edits gets a copy behind it, under a name of
    its own, and its call names that. Calls that a loop repeats have one name and must need the same.
    """

    def __init__(self, program: RapidProgram) -> None:
        self.program, self.made = program, 0
        declared = re.findall(r"\b(?:PROC|TRAP)\s+(\w+)", program.text, re.IGNORECASE)
        self._taken = {*program.names, *(name.upper() for name in declared)}

    def merged(self, edits: list[Spans]) -> Spans:
        """Edits of the whole text.

        Args:
            edits: For each of ``program.calls``; calls within copies get the names of theirs.
        """
        calls, out = self.program.calls, Spans()
        named: dict[tuple[int, tuple[int, int]], str] = {}
        versions: dict[str, list[tuple[int, str]]] = {}  # by routine: the first execution of each version, its name
        for index, call in enumerate(calls):
            versions.setdefault(call.routine.upper(), [(index, call.routine)])
        for index in sorted(range(len(calls)), key=lambda i: (-self._depth(i), i)):  # calls inside a routine first
            call = calls[index]
            known = versions[call.routine.upper()]
            name = next((name for other, name in known if other == index or edits[other] == edits[index]), "")
            if not name:
                name = self._name(call.routine)
                known.append((index, name))
            place = (call.parent, call.place)
            if place not in named and name != call.routine:
                edits[call.parent].replace(*call.place, name)
            if named.setdefault(place, name) != name:
                raise self._several(call)
        for (original, _), *others in versions.values():
            out += edits[original]
            for index, name in others:
                out.insert(calls[index].end, self._copy(index, name, edits[index]))
        return out

    def _several(self, call: RoutineCall) -> ProgramError:
        program = self.program
        return ProgramError(
            f"a loop calls {call.routine} several times, and each call needs another correction",
            where=program.place(call.place[0]), value=program.text[slice(*call.place)][:60],
            limit="one correction for each call",
            hint="Write it out: " + next_command("convert", program.name, to="rapid", cell="CELL", out="OUT"),
        )  # fmt: skip

    def _copy(self, index: int, name: str, edits: Spans) -> str:
        call, text = self.program.calls[index], self.program.text
        indent = re.search(r"[^\S\r\n]*\Z", text[: call.start])
        own = Spans()
        own += edits
        own.replace(*call.name, name)
        self.made += 1
        return self.program.newline + ("" if indent is None else indent[0]) + own.applied(text, call.start, call.end)

    def _depth(self, index: int) -> int:
        parent, depth = self.program.calls[index].parent, 0
        while parent >= 0:
            parent, depth = self.program.calls[parent].parent, depth + 1
        return depth

    def _name(self, routine: str) -> str:
        for count in itertools.count(2):
            name = f"{routine[: LIMITS.name_characters - 4]}_{count}"
            if name.upper() not in self._taken:
                break
        self._taken.add(name.upper())
        return name
