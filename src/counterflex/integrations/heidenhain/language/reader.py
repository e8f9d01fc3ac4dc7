"""Read Klartext programs: executed statement by statement, with labels, calls, parameters and cycles."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.errors import ProgramError
from counterflex.integrations.heidenhain.language.control import Control, tilts
from counterflex.integrations.heidenhain.language.moves import open_corner
from counterflex.integrations.heidenhain.language.source import KlartextSource, KlartextStatement, Library, label_key
from counterflex.integrations.heidenhain.language.table import NEUTRAL, REFUSED
from counterflex.integrations.heidenhain.language.values import ASSIGNMENT, VALUE, is_arithmetic, required
from counterflex.integrations.heidenhain.language.words import PathWords
from counterflex.programs.endless import LoopWatch, frozen
from counterflex.programs.expression import ExpressionError, Value
from counterflex.programs.gcode.read.flow import line_end, split_lines
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import COORDINATES_OF_THE_PART, FileReader
from counterflex.programs.program import Block, Modal, Program, Word
from counterflex.programs.unknown import Unknown

_PATH: Final = re.compile(r"\s*(LP|LN|L|CC|CTP|CT|CR|CP|C|RND)(?![A-Z0-9])", re.IGNORECASE)
_CALL: Final = re.compile(
    r'\s*CALL\s+LBL\s*(\d+|"[^"]+"|Q[SLR]?\d+)(?:\s*REP\s*(\d+)(?:\s*/\s*\d+)?)?\s*$', re.IGNORECASE
)
_PROGRAM: Final = re.compile(r'\s*CALL\s+PGM\s+("[^"]+"|\S+)\s*$', re.IGNORECASE)
_IF: Final = re.compile(
    rf'\s*FN\s*(9|10|11|12)\s*:\s*IF\s*({VALUE})\s*(EQU|NE|GT|LT)\s*({VALUE})\s*GOTO\s*LBL\s*(\d+|"[^"]+"|Q[SLR]?\d+)\s*$',
    re.IGNORECASE,
)
_WORD: Final = re.compile(r"\s*([A-Z]+)", re.IGNORECASE)
_FUNCTION: Final = re.compile(r"\s*FN\s*(\d+)", re.IGNORECASE)
_READ: Final = re.compile(r"(?:SYSREAD|TABREAD)\s*(Q[LRS]?\d+)\s*=", re.IGNORECASE)
_DEEPEST: Final = 19  # Nesting of subprograms and of program section repeats (TNC 640, "Nesting")
_COMPARE: Final[dict[str, Callable[[float, float], bool]]] = {
    "EQU": lambda a, b: a == b, "NE": lambda a, b: a != b, "GT": lambda a, b: a > b, "LT": lambda a, b: a < b,
}  # fmt: skip
_OPERATOR: Final = {9: "EQU", 10: "NE", 11: "GT", 12: "LT"}


@dataclass
class ActiveCall:
    """A running subprogram or program: where it goes back to."""

    source: KlartextSource
    index: int
    program: bool


class KlartextRun(Control):
    """One run of a program."""

    def __init__(self, source: KlartextSource, machine: MillingMachine, library: Library) -> None:
        super().__init__(source, machine)
        self._main, self._library = source, library
        self._index, self._calls = 0, list[ActiveCall]()
        self._repeats: dict[tuple[int, int], int] = {}
        self._watch = LoopWatch(self._everything)
        self._modals: dict[Modal, Modal] = {}
        self._counts: dict[int, int] = {}

    # ---- flow --------------------------------------------------------------------------------------------------

    def run(self) -> bool:
        """Execute to the end; whether the program said that it ends.

        Raises:
            ProgramError: At the first statement that cannot be executed exactly.
        """
        while not self._ended:
            if self._index >= len(self._source.statements):
                if self._calls:
                    raise self._fault(self._source.statements[-1], "a called program stops without END PGM, or a "
                                      "subprogram without LBL 0", None, None, "The file may be truncated")  # fmt: skip
                break
            source, index = self._source, self._index
            self._index += 1
            self._statement(source.statements[index])
            self._watch_jump(source, index)
        corner = open_corner(self.maker, self._source.name)
        if corner is not None:
            raise corner
        return self._ended

    def _watch_jump(self, source: KlartextSource, index: int) -> None:
        if self._source is source and self._index > index:
            return
        back = index - self._index + 1 if self._source is source else 1
        place = (self._source.name, self._index, len(self._calls))
        why = self._watch.jumped_back(place, max(back, 1), len(self.maker.motions))
        if why:
            raise self._fault(source.statements[index], why, None, None,
                              "Look at the condition of the jump and for the block that should change it")  # fmt: skip

    def _everything(self) -> object:
        state = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in vars(self._state).items()}
        state["frames"] = self._state.frames.memory()
        return frozen([state, self.values.memory(), [(c.source.name, c.index) for c in self._calls],
                       [[list(k), v] for k, v in sorted(self._repeats.items())], repr(self._cycle),
                       self._cycle_modal])  # fmt: skip

    def _append(self, part: KlartextStatement, words: tuple[Word, ...], first: int, *, cycle: bool = False) -> None:
        modal = self._state.modal()
        modal = self._modals.setdefault(modal, modal)
        own = self._source is self._main and not self._calls
        if own:
            self._counts[part.line] = self._counts.get(part.line, 0) + 1
        file = "" if self._source is self._main else self._source.name
        count = len(self.maker.motions) - first
        rounded = self.blocks[self.maker.motions[first].block] if count and self.maker.motions[first].block < len(
            self.blocks) else None  # fmt: skip
        if rounded is not None:  # the arc of an RND, known only now
            at = self.maker.motions[first].block
            self.blocks[at] = replace(rounded, first_motion=first, motion_count=1)
            for later in range(at + 1, len(self.blocks)):
                self.blocks[later] = replace(self.blocks[later], first_motion=first + 1)
            first, count = first + 1, count - 1
        self.blocks.append(Block(part.line, part.text, words, modal, first, count, single=own, cycle=cycle, file=file))

    def finished_blocks(self) -> tuple[Block, ...]:
        """Return the blocks; those that were executed several times, or not in order, are not single."""
        lines = [block.line for block in self.blocks if not block.file]
        ordered = all(a < b for a, b in itertools.pairwise(lines))
        return tuple(
            replace(block, single=False) if block.single and (not ordered or self._counts.get(block.line, 0) != 1)
            else block for block in self.blocks
        )  # fmt: skip

    # ---- statements --------------------------------------------------------------------------------------------

    def _statement(self, part: KlartextStatement) -> None:
        """Execute a statement and append its block."""
        first, code = len(self.maker.motions), part.code
        if not code.strip():
            self._append(part, (), first)
            return
        path = _PATH.match(code)
        if path is not None:
            words, drilled = self._path(part, path[1].upper(), path.end())
            self._append(part, words, first, cycle=drilled)
            return
        words = ()
        assignment = ASSIGNMENT.fullmatch(code)
        if assignment is not None and (assignment[1] is None or is_arithmetic(int(assignment[1]))):
            self._assign(part, assignment)
        elif (number := _FUNCTION.match(code)) is not None:
            self._function(part, int(number[1]))
        else:
            words = self._worded(part, code)
        self._append(part, words, first)

    def _worded(self, part: KlartextStatement, code: str) -> tuple[Word, ...]:
        """Execute a statement by its key words."""
        match = _WORD.match(code)
        head = " ".join(code.upper().split())
        for words, execute in (
            ("TOOL CALL", self._tool_call), ("CYCL DEF", self._cycle_define), ("CYCL CALL", self._cycle_call),
            ("PLANE", self._plane), ("FUNCTION", self._tcpm), ("CALL LBL", self._call_label),
            ("CALL PGM", self._call_program), ("LBL", self._label), ("STOP", self._stop),
            ("BEGIN PGM", self._begin), ("END PGM", self._end),
        ):  # fmt: skip
            if head == words or head.startswith((f"{words} ", f"{words}0", f'{words}"')):
                return execute(part)
        if match is not None and match[1].upper() == "M":
            return self._machine_functions(part)
        for words in sorted(NEUTRAL, key=len, reverse=True):
            if head.startswith(words):
                return ()
        for words in sorted(REFUSED, key=len, reverse=True):
            if head.startswith(words):
                raise self._fault(part, f"{REFUSED[words][0]}: {words}", None, None, REFUSED[words][1])
        raise self._fault(part, "an unknown statement of Klartext", None, None, "Post the path as L, C and CP")

    def _begin(self, part: KlartextStatement) -> tuple[Word, ...]:
        if part is not next(one for one in self._source.statements if one.code.strip()):
            raise self._fault(part, "a second BEGIN PGM in one file", None, None, "One program per file")
        return ()

    def _end(self, part: KlartextStatement) -> tuple[Word, ...]:
        if self._calls and not self._calls[-1].program:
            raise self._fault(part, "a subprogram ends without LBL 0", None, None, "Write LBL 0 behind it")
        if self._calls:
            call = self._calls.pop()
            self._source, self._index = call.source, call.index
            self._state.inch = self._source.inch
            self.values.leave()
        else:
            self._ended = True
        return ()

    def _label(self, part: KlartextStatement) -> tuple[Word, ...]:
        text = part.code.strip()[3:].strip()
        if re.fullmatch(r'\d+|"[^"]+"|Q[SLR]?\d+', text, re.IGNORECASE) is None:
            raise self._fault(part, "LBL needs a number or a name in quotation marks", None, None, "LBL 1")
        if text in ("0", "00") and self._calls and not self._calls[-1].program:
            call = self._calls.pop()
            self._index = call.index
        return ()

    def _target(self, part: KlartextStatement, text: str) -> int:
        if text[:1] in "Qq":
            value = self.values.value_of(text)
            text = f"{required(value, 'the label', part.place(self._source.name, part.start), part.code):.0f}"
        index = self._source.labels.get(label_key(text))
        if index is None:
            raise self._fault(part, f"there is no LBL {text}", part.code.find(text) if text in part.code else None,
                              text, "Labels are those of this file")  # fmt: skip
        return index

    def _call_label(self, part: KlartextStatement) -> tuple[Word, ...]:
        match = _CALL.match(part.code)
        if match is None:
            raise self._fault(part, "CALL LBL needs a label, and REP a number", None, None, "CALL LBL 1 REP 3")
        target = self._target(part, match[1])
        if match[2] is None:
            if len(self._calls) >= _DEEPEST:
                raise self._fault(part, f"subprograms are nested deeper than {_DEEPEST} times", None, None,
                                  "A label calls itself")  # fmt: skip
            self._calls.append(ActiveCall(self._source, self._index, False))
            self._index = target
            return ()
        key = (part.line, len(self._calls))
        left = self._repeats.get(key, int(match[2]))
        if left > 0:
            self._repeats[key] = left - 1
            self._index = target
        else:
            self._repeats.pop(key, None)
        return ()

    def _call_program(self, part: KlartextStatement) -> tuple[Word, ...]:
        match = _PROGRAM.match(part.code)
        source = None if match is None else self._library.find(match[1])
        if match is None or source is None or len(self._calls) >= _DEEPEST:
            name = "" if match is None else match[1]
            raise self._fault(part, "a program is called that is not in the folder of this one", None, name or None,
                              f"Put {name or 'it'} beside the program")  # fmt: skip
        if any(tilts(one.code) for one in source.statements) and not self._state.vectors:
            raise self._fault(part, "a called program tilts the working plane", None, None, "Tilt it in the main one")
        self._calls.append(ActiveCall(self._source, self._index, True))
        self._source, self._index = source, 0
        self._state.inch = source.inch
        self._state.feed = self._state.feed if source.inch == self._calls[-1].source.inch else None
        self.values.enter()
        return ()

    def _end_program(self, words: PathWords) -> None:
        if self._calls and self._calls[-1].program:
            raise words.fault("a called program ends the main one", None, "End it with END PGM")
        super()._end_program(words)

    def _stop(self, part: KlartextStatement) -> tuple[Word, ...]:
        words = self._machine_functions(part, part.start + 4)
        return (Word("M", 0.0, part.start, part.start + 4, False), *words)

    # ---- parameters --------------------------------------------------------------------------------------------

    def _assign(self, part: KlartextStatement, match: re.Match[str]) -> None:
        if match[2].upper().startswith("QS"):
            self.values.set(match[2], Unknown("a text", f"{self._source.name}:{part.line}"))
            return
        try:
            value: Value = self.values.formula(match[3])
        except ExpressionError as fault:
            raise self._fault(part, str(fault), match.start(3) + fault.at, match[3][:40],
                              "Q1 = Q2 * SIN (Q3)") from fault  # fmt: skip
        self.values.set(match[2], value)

    def _function(self, part: KlartextStatement, number: int) -> None:
        """FN of flow, of unknown values and without effect."""
        if number in _OPERATOR:
            match = _IF.match(part.code)
            if match is None or _OPERATOR[number] != match[3].upper():
                raise self._fault(part, f"FN {number} compares with {_OPERATOR[number]} and jumps to a label", None,
                                  None, f"FN {number}: IF +Q1 {_OPERATOR[number]} +0 GOTO LBL 1")  # fmt: skip
            where = part.place(self._source.name, match.start(2))
            a, b = (required(self.values.number(match[k]), "the condition", where, part.code) for k in (2, 4))
            target = self._target(part, match[5])
            if _COMPARE[match[3].upper()](a, b):
                self._index = target
            return
        read = _READ.search(part.code)
        if number in (18, 28) and read is not None:
            self.values.set(read[1], Unknown(f"the control gives it (FN {number})",
                                                   f"{self._source.name}:{part.line}"))  # fmt: skip
            return
        for word in (f"FN {number}", "FN"):
            if word in NEUTRAL and word != "FN":
                return
            if word in REFUSED:
                raise self._fault(part, f"{REFUSED[word][0]}: FN {number}", None, None, REFUSED[word][1])


_HIDDEN: Final = re.compile(r"\s*\d+\s*/")


def hidden_blocks(program: Program) -> list[str]:
    """Return one sentence where blocks with motions are marked with / behind their number."""
    lines = [block.line for block in program.blocks if block.motion_count and _HIDDEN.match(block.text)]
    if not lines:
        return []
    more = f" and {len(lines) - 1} more" if len(lines) > 1 else ""
    return [
        f"line {lines[0]}{more}: a block with / behind its number is read as executed; leave the switch that hides "
        "blocks off, or take it out and plan again"
    ]


def read_heidenhain(
    text: str,
    *,
    name: str = "program",
    complete: bool = False,
    machine: MillingMachine = COORDINATES_OF_THE_PART,
    folder: Path | None = None,
) -> Program:
    """Execute a program's text and return the statements passed and the motions made.

    The active preset is the zero of the part, tool lengths are compensated by the control. Where the program tilts the
    working plane (PLANE, cycle 19) or gives tool vectors (LN with TX TY TZ), the tool axis of each motion is given as
    I J K of :data:`~counterflex.programs.program.TOOL_VECTOR`; M128 with A B C is
    :data:`~counterflex.programs.program.TOOL_CENTRE`.

    Args:
        complete: Refuse a text that stops without END PGM, M2 or M30: it may have been cut off.
        machine: Tools by name. ``known``: the tool starts at zero; else where it stands is not known before the
            program names its axes.
        folder: Where programs of CALL PGM are.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, refused or contradictory.

    Source: HEIDENHAIN TNC 640 (34059x-05), User's Manual Conversational Programming.
    """
    lines = split_lines(text)
    if not any(line.strip() for line in lines):
        raise ProgramError("the program is empty", where=f"{name}:1:1", hint="Give a file with a Klartext program")
    source = KlartextSource(name, lines)
    run = KlartextRun(source, machine, Library(folder))
    ended = run.run()
    if complete and not ended:
        raise source.statements[-1].fault(
            name, "the program stops without END PGM, M2 or M30", None, None,
            "The file may be truncated. If it is complete, add --without-end",
        )  # fmt: skip
    blocks = run.finished_blocks()
    return Program(
        name=name,
        dialect="heidenhain",
        lines=(*lines, "") if text.endswith(("\n", "\r")) else lines,
        newline=line_end(text),
        blocks=blocks,
        motions=tuple(run.maker.motions),
        straight=all(block.single for block in blocks),
    )


read_heidenhain_file = FileReader(read_heidenhain, "Klartext")
