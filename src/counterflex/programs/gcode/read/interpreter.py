"""Executes a program line by line: plain lines by a short way, O words as jumps, everything else word by word."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from counterflex.core.units import MINUTE, RPM
from counterflex.programs.endless import LoopWatch, frozen
from counterflex.programs.gcode.read.block import BlockWords
from counterflex.programs.gcode.read.canned_cycles import CycleMaker
from counterflex.programs.gcode.read.codes import TAKES_AXES, code_name
from counterflex.programs.gcode.read.expression import NamedParameter
from counterflex.programs.gcode.read.flow import GcodeSource, MacroFlow
from counterflex.programs.gcode.read.jumps import FlowRunner, Include, Place
from counterflex.programs.gcode.read.modes import apply_modes, apply_offsets, apply_rates
from counterflex.programs.gcode.read.motion import FARTHEST_M, point, radians
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.scanner import ScannedLine, scan_plain, strip_comments
from counterflex.programs.gcode.read.state import ModalState
from counterflex.programs.gcode.read.work_offsets import Six
from counterflex.programs.program import TOOL_VECTOR, Block, Modal, Motion, Word

_ONE_FILE: Final = "Give each program a file of its own"
_ZERO_ABC: Final = (0.0, 0.0, 0.0)


class Interpreter(FlowRunner):
    """One run of one program.

    Args:
        state: Offsets and modes at the start.
        machine: What is known of the machine at the start.
        includes: Returns name and text of a subroutine's file, or None.
        step_limit: Largest number of lines executed.
        block_delete: Skip lines that begin with a slash.
        complete: Refuse a program that stops without M2, M30 or a closing ``%``.
        plain: Use the short way for plain lines (the result is the same).
    """

    def __init__(
        self,
        source: GcodeSource,
        state: ModalState,
        machine: MillingMachine,
        includes: Include | None,
        *,
        step_limit: int,
        block_delete: bool,
        complete: bool,
        plain: bool,
    ) -> None:
        super().__init__(source, state, machine.parameters, includes)
        self._state = state
        self._tool_lengths = machine.tool_lengths
        self._step_limit = step_limit
        self._block_delete = block_delete
        self._complete = complete
        self._plain = plain
        self._maker = CycleMaker(state, self._parameters, machine.known, machine.listed)
        self._modals: dict[Modal, Modal] = {}
        self._modal = state.modal()
        self._ended = False
        self._percent = False
        self.blocks: list[Block] = []
        self._counts: dict[int, int] = {}
        self._inside: set[int] = set()
        self._loops = LoopWatch(self._everything)

    @property
    def motions(self) -> list[Motion]:
        """Motions made so far."""
        return self._maker.motions

    # The run --------------------------------------------------------------------------------------------------------

    def run(self) -> bool:
        """Execute to the end of the program.

        Returns:
            True when every line was executed at most once and in order.

        Raises:
            ProgramError: At the first line that cannot be executed exactly, or when the step limit is reached.
        """
        steps = 0
        while not self._ended:
            place = self._place
            if place.index >= len(place.source.lines):
                if place.source is not self._main or self._frames:
                    place.index = len(place.source.lines) - 1
                    raise self._fault("the file ends inside a subroutine", 0, hint="Close it with endsub or M99")
                if self._complete:
                    place.index = len(place.source.lines) - 1
                    raise self._fault(
                        "the program stops without M2, M30 or a closing %", 0,
                        hint="The file may be truncated. If it is complete, add --without-end",
                    )  # fmt: skip
                break
            steps += 1
            if steps > self._step_limit:
                raise self._fault(
                    "the program does not end within the step limit", 0, f"{self._step_limit} lines executed",
                    "Look for an endless loop",
                )  # fmt: skip
            self._line(place.source, place.index)
            self._watch_jump(place)
        return self._mark_repeated()

    def _watch_jump(self, place: Place) -> None:
        """Refuse a jump back that will be made for ever."""
        now = self._place
        if now.source is place.source and now.index > place.index:
            return
        back = place.index - now.index + 1 if now.source is place.source else 1
        why = self._loops.jumped_back((id(now.source), now.index, self._state.position), back, len(self.motions))
        if why:
            now.index = min(now.index, len(now.source.lines) - 1)
            raise self._fault(why, 0, hint="Look at the condition of the loop and for the line that should change it")

    def _everything(self) -> object:
        """All that decides how the program goes on."""
        known = (vars(self._parameters), vars(self._state), self._frames, self._counters)
        return [
            frozen({k: v for k, v in part.items() if k != "line"} if isinstance(part, dict) else part) for part in known
        ]

    def _line(self, source: GcodeSource, index: int) -> None:
        self._place = Place(source, index + 1)
        here = Place(source, index)
        text = source.lines[index]
        macro = source.macro.get(index)
        if macro is not None:
            self._macro_line(source, index, macro)
            return
        words = scan_plain(text) if self._plain else None
        if words is not None and not self._frames and self._straight(text, index, words):
            return
        after, self._place = self._place, here
        scanned = source.scan(index) if words is None else None
        self._parameters.line = index + 1
        jump = self._execute(source, index, text, scanned, words or ())
        self._place = after if jump is None else jump

    def _macro_line(self, source: GcodeSource, index: int, flow: MacroFlow) -> None:
        """Execute a line of the flow of a Fanuc macro."""
        self._place, self._parameters.line = Place(source, index), index + 1
        self._append_block(source, index, source.lines[index], (), self._modal, len(self._maker.motions), False)
        holds = flow.then is not None and self._value(flow.condition, "a condition") != 0.0
        jump = None
        if holds and flow.then is not None:
            self._evaluate(flow.then)
        elif flow.then is None:
            jump = self._macro_flow(source, index, flow)
        self._place = jump or Place(source, index + 1)

    def _count(self, source: GcodeSource, index: int) -> None:
        if source is self._main:
            self._counts[index] = self._counts.get(index, 0) + 1
            if self._frames:
                self._inside.add(index)

    def _mark_repeated(self) -> bool:
        """Mark the blocks of lines that ran more than once, in a subroutine, or in another file."""
        straight = True
        for number, block in enumerate(self.blocks):
            if block.single and (self._counts.get(block.line - 1, 0) != 1 or block.line - 1 in self._inside):
                self.blocks[number] = replace(block, single=False)
            straight = straight and self.blocks[number].single
        return straight

    def _append_block(
        self, source: GcodeSource, index: int, text: str, words: tuple[Word, ...], modal: Modal, first: int, cycle: bool
    ) -> None:
        self._count(source, index)
        self.blocks.append(
            Block(
                line=index + 1,
                text=text,
                words=words,
                modal=modal,
                first_motion=first,
                motion_count=len(self._maker.motions) - first,
                single=source is self._main and not self._frames,
                cycle=cycle,
            )
        )

    # Plain straight moves -------------------------------------------------------------------------------------------

    def _straight(self, text: str, index: int, words: tuple[Word, ...]) -> bool:
        """Execute a plain G0 or G1 line under G94; False where the line needs the long way."""
        state = self._state
        plain = _plain_words(words, state.motion) if state.plain and not self._maker.away else None
        if plain is None:
            return False
        code, feed, axes = plain
        target = _plain_target(state, axes)
        if target is None or (code == 10 and feed is None and not state.feed):
            return False
        rapid = code == 0
        if feed is not None:
            state.feed, state.feed_unit_m = feed, state.unit_m
        if code != state.motion:
            state.choose_motion(code)
            self._refresh()
        motions, here = self._maker.motions, state.position
        p_start = self._maker.start_point()
        abc = _abc(here)
        state.position = (*target, *here[3:])
        if state.constant_surface:
            self._refresh()
        motions.append(
            Motion(
                len(self.blocks),
                "rapid" if rapid else "feed",
                p_start,
                p_start if target == here[:3] else point(target),
                0.0 if rapid else (state.feed or 0.0) * state.feed_unit_m / MINUTE,
                state.spindle_rpm * RPM,
                state.tool,
                0.0,
                abc,
                abc,
            )
        )
        self._append_block(self._main, index, text, words, self._modal, len(motions) - 1, False)
        return True

    def _refresh(self, machine: bool = False) -> Modal:
        modal = self._state.modal()
        self._modal = self._modals.setdefault(modal, modal)
        if not machine:
            return self._modal
        modal = self._state.modal(machine)
        return self._modals.setdefault(modal, modal)

    # Every other line -----------------------------------------------------------------------------------------------

    def _execute(
        self, source: GcodeSource, index: int, text: str, scanned: ScannedLine | None, literal: tuple[Word, ...]
    ) -> Place | None:
        """Execute a line; the place to go on at where that is not the next line."""
        first = len(self._maker.motions)
        words = literal
        if scanned is not None:
            if scanned.percent or (scanned.block_delete and self._block_delete):
                if scanned.percent:
                    self._percent_line(source, index)
                self._append_block(source, index, text, (), self._modal, first, False)
                return None
            words = self._evaluate(scanned, text)
            if scanned.flow is not None:
                self._append_block(source, index, text, words, self._modal, first, False)
                return self._jump(source, index, scanned.flow)
        if not words:
            self._append_block(source, index, text, (), self._modal, first, False)
            return None
        block = BlockWords(words, self._fault, index + 1)
        self._maker.block = len(self.blocks)
        modal, cycle, jump = self._words(source, block)
        self._append_block(source, index, text, words, modal, first, cycle)
        return jump() if jump is not None else None

    def _percent_line(self, source: GcodeSource, index: int) -> None:
        """Open the program at a percent sign behind nothing but comments; end it at a later one.

        DIN 66025: the sign, and behind it number or name of the program.
        """
        before = source.lines[:index]
        if not any(strip_comments(line, source.name, n)[0] for n, line in enumerate(before, 1)):
            self._percent = True
        elif source.lines[index].strip() != "%":
            column = source.lines[index].index("%")
            raise self._fault("another program begins in the same file", column, source.lines[index].strip(), _ONE_FILE)
        elif self._percent or not any(line.strip() for line in source.lines[index + 1 :]):
            self._ended = True
        else:
            column = source.lines[index].index("%")
            raise self._fault("a % in a program that does not begin with one", column, "%")

    def _evaluate(self, scanned: ScannedLine, text: str = "") -> tuple[Word, ...]:
        """Evaluate words, then let assignments take effect."""
        for word in scanned.words if self._state.of_fanuc and "ROUND" in text.upper() else ():
            if "ROUND" in (shown := text[word.start : word.end]).upper():
                what = "ROUND in a word rounds to the least increment on Fanuc and Haas, to a whole number elsewhere"
                raise self._fault(what, word.start, shown, "Write the number, or set a parameter to it before")
        words = tuple(
            Word(word.letter, word.value, word.start, word.end)
            if word.value is not None
            else Word(
                word.letter, self._value(word.expression, word.letter, word.start), word.start, word.end, literal=False
            )
            for word in scanned.words
        )
        settled = [(assignment, self._open_value(assignment.value)) for assignment in scanned.assignments]
        for assignment, value in settled:
            target = assignment.target
            if isinstance(target, NamedParameter):
                self._parameters.set_named(target.name, value, assignment.column)
            else:
                number = self._value(target.index, "the number of a parameter")
                self._parameters.set_numbered(number, value, assignment.column)
        return words

    def _places(self, block: BlockWords, special: int | None) -> bool:
        """Execute what goes to stored positions or sets them and offsets; whether the block moved there."""
        if special in (280, 300):
            self._maker.home(block, special)
            return True
        if special in (281, 301):
            self._parameters.store_position(special - 1, self._maker.machine_position())
        else:
            apply_offsets(block, self._state)
        return False

    def _move(self, block: BlockWords, motion: int | None, machine: bool) -> bool:
        """Make the motion that a block's words ask for; whether it was a canned cycle."""
        state, maker = self._state, self._maker
        active, moved = state.motion_of(machine), block.has("XYZABC")
        vector = active in (0, 10) and state.tool_centre == TOOL_VECTOR and block.has("IJK")
        if not (moved or (active in (20, 30) and block.has("IJKR")) or vector):
            if machine:
                raise block.fault("G53 needs an axis word", "G530", "G53")
            if motion not in (None, 0, 10, 800):
                raise block.fault("the motion code has no axis word", f"G{motion}", code_name("G", motion or 0))
            return False
        if motion == 800:
            raise block.fault("G80 moves nothing, yet there are axis words", "G800", "G80")
        if active == 800:
            letter = next(axis for axis in "XYZABC" if block.has(axis))
            raise block.fault("an axis word, but no motion code is active", letter, hint="Write G0, G1, G2 or G3")
        count = len(maker.motions)
        maker.run(block, active, machine)
        return active >= 730 and len(maker.motions) > count

    def _words(self, source: GcodeSource, block: BlockWords) -> tuple[Modal, bool, Callable[[], Place | None] | None]:
        """Execute a block's words in LinuxCNC's order."""
        state = self._state
        special = block.g.get("non-modal")
        motion = block.g.get("motion")
        machine = special == 530
        stop = block.m.get("stopping")
        if special == 650:
            jump = self._subprogram(source, block)
            block.finish()
            return self._refresh(), False, jump
        apply_rates(block, state)
        if special == 40:
            self._maker.dwell(block, block.take("P") if block.has("P") else block.take("X"))
        apply_modes(block, state, self._tool_lengths)
        if special in TAKES_AXES and motion not in (None, 800) and block.has("XYZABC"):
            raise block.fault(
                "two codes of one block both need the axis words", f"G{special}",
                f"{code_name('G', special or 0)} and {code_name('G', motion or 0)}",
            )  # fmt: skip
        if motion is not None:
            state.choose_motion(motion)
        cycle = self._places(block, special)
        modal = self._refresh(machine)
        jump = self._subprogram(source, block)
        cycle = self._move(block, motion, machine) or cycle
        block.finish(state.idle)
        if "input" in block.m:
            self._parameters.forget_input()
        if stop in (20, 300):
            self._ended = True
        if not machine and state.constant_surface:
            modal = self._refresh()
        return modal, cycle, jump


def _abc(position: Six) -> tuple[float, float, float]:
    """Rotary axes in rad; of all motions that turn none, the same object."""
    return _ZERO_ABC if position[3:] == _ZERO_ABC else radians(position)


def _plain_target(state: ModalState, axes: dict[str, float]) -> tuple[float, float, float] | None:
    """(3,) m, where the axis words of a plain line lead; None where no machine reaches that."""
    here, unit = state.position, state.unit_m
    origin = state.origin if state.absolute else here
    x, y, z = (origin[k] + axes[c] * unit if c in axes else here[k] for k, c in enumerate("XYZ"))
    return (x, y, z) if abs(x) <= FARTHEST_M and abs(y) <= FARTHEST_M and abs(z) <= FARTHEST_M else None


def _plain_words(words: tuple[Word, ...], motion: int) -> tuple[int, float | None, dict[str, float]] | None:
    """Motion code, feed and axis words of a line that has nothing else; None for any other line."""
    code, feed, axes, named = motion, None, {}, False
    for word in words:
        letter, value = word.letter, word.value
        if letter in "XYZ" and letter not in axes:
            axes[letter] = value
        elif letter == "G" and value in (0.0, 1.0) and not named:
            code, named = int(value) * 10, True
        elif letter == "F" and feed is None and 0.0 < value <= 1e6:
            feed = value
        else:
            return None
    return (code, feed, axes) if code in (0, 10) and axes else None
