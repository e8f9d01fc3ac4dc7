"""Spindle, coolant and tool change in the robot's language: what a cell's table says for each M-code."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.programs.language import StatementForms
from counterflex.programs.limits import WORDS_OF_M
from counterflex.programs.program import Block

KEYS: Final[dict[int, str]] = {
    3: "clockwise",
    4: "counter_clockwise",
    5: "off",
    6: "tool_change",
    7: "mist",
    8: "flood",
    9: "coolant_off",
}
"""Key of the table by M-code."""
ELSEWHERE: Final = frozenset({0, 1, 2, 17, 30, 60, 97, 98, 99})
"""M-codes that writers turn into stops and ends themselves, and calls, which are written out."""
_NO_EFFECT: Final = frozenset({48, 49})
_ORDER: Final = (6, 3, 4, 7, 8, 9, 5)
BEHIND: Final = frozenset({0, 1, 5, 9, 60})
"""M-codes that act when the motions of their block are done (DIN 66025-2): stops, coolant off, spindle off."""
_BY_HAND: Final = frozenset({3, 4, 5, 6})
SPEED, TOOL, DATA = "{s}", "{t}", "{d}"
WORDS: Final = ("{p}", "{q}", "{e}", "{r}")
"""What stands for a word of an M-code in its statements."""
_NOT_AT_SPEED: Final = "the spindle is not at speed"
_NOT_STANDING: Final = "the spindle does not stand"
_CARRIED: Final = re.compile(r"(?:[A-Z]\s*[-+]?[\d.]+\s*)+", re.IGNORECASE)
_STARTED: Final = re.compile(r"\bM0?[346](?!\d)", re.IGNORECASE)
_NO_DEED: Final = re.compile(
    r"\s*(?:S?PTP|S?LIN|S?CIRC|PTP_REL|LIN_REL|END\b|\$VEL|\$TOOL|\$BASE|MoveL|MoveC|MoveJ|MoveAbsJ|EGMMoveL|ENDPROC)",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class MachineFunctions:
    """Statements of one robot language for what is no motion.

    ``{s}`` stands for the spindle speed in rpm, ``{t}`` for the number of the tool in the program, ``{d}`` for its tool
    data on the controller (:attr:`tool_data`), ``{p}``, ``{q}``, ``{e}`` and ``{r}`` for words of the M-code. Several
    M-codes of a block act in this order: tool change, spindle on, coolant on, coolant off, spindle off. Where the
    statements of the spindle or of a tool change are an empty list, a person does it: the program stops there.
    """

    language: str  # Of the robot
    statements: Mapping[int, Sequence[str]] = field(default_factory=dict)  # By M-code; a missing one is not mapped
    ready: str = ""  # Condition that holds while the spindle turns at speed; empty where there is no such signal
    standing: str = ""  # Condition that holds while the spindle stands; likewise
    wait_s: float = 20.0  # How long such a condition is waited for until the program stops, s
    pause_s: float = 0.0  # Pause behind a start of the spindle, s
    # What the controller calls the tool frame, by number of the tool: a number or a name
    tool_data: Mapping[int, str] = field(default_factory=dict)
    where: str = "the cell file"  # Place of the table, for messages

    def lines(self, block: Block) -> list[str]:
        """Lines for a block, as the writers call it for every block (``block_lines``).

        Raises:
            ProgramError: The block has an M-code that is not mapped, or starts the spindle without a speed.
        """
        out: list[str] = []
        for code in sorted(_codes(block), key=lambda item: _ORDER.index(item) if item in _ORDER else len(_ORDER)):
            out += self._function(code, block)
        return [*self._in_place(), *out] if out else []

    def templates(self) -> dict[int, tuple[list[str], list[str]]]:
        """Lines by M-code as :meth:`lines` writes them, ``{s}`` and the like left in, for who reads such a program.

        Returns:
            By M-code: the statements that do it (one that is done by hand: those that stop for a person), and the
            pause and the wait behind them, which may be missing.
        """
        out: dict[int, tuple[list[str], list[str]]] = {}
        for code, statements in self.statements.items():
            lines = list(statements) or (self._stop(_by_hand(code, SPEED, TOOL)) if code in _BY_HAND else [])
            behind: list[str] = []
            if code in (3, 4):
                behind = self._pause() + self._until(self.ready, _NOT_AT_SPEED)
            elif code == 5:
                behind = self._until(self.standing, _NOT_STANDING)
            if lines:
                out[code] = (lines, behind)
        return out

    def check(self, blocks: Iterable[Block]) -> None:
        """Refuse blocks that :meth:`lines` would refuse; every M-code that is not mapped is named at once.

        Raises:
            ProgramError: As :meth:`lines`; its place is the first of the blocks.
        """
        taken = list(blocks)
        missing: dict[int, Block] = {}
        for block in taken:
            for code in _codes(block):
                if code not in self.statements and (code not in missing or block.line < missing[code].line):
                    missing[code] = block
        if missing:
            raise self._unmapped(missing)
        for block in taken:
            self.lines(block)
        self._check_told_apart(taken)

    def _check_told_apart(self, blocks: Iterable[Block]) -> None:
        """Refuse one statement for an M-code that the program gives several values: M62 P1 and M62 P2."""
        messages: dict[int, tuple[dict[str, str], Block]] = {}
        for block in blocks:
            for code in _codes(block):
                words = {key: text for key, text in _own_words(code, block).items() if not self._says(code, key)}
                first, where = messages.setdefault(code, (words, block))
                if words != first:
                    letters = sorted({key[1].upper() for key in {**words, **first}})
                    raise ProgramError(
                        f"M{code} is used with several values, and its statements do not say which",
                        where=f"line {block.line}",
                        value=f"{' '.join(where.text.split())[:30]}, {' '.join(block.text.split())[:30]}",
                        limit=f"{' '.join(f'{{{letter.lower()}}}' for letter in letters)} in controller.spindle."
                        f"{self.language}.m_codes.M{code} in {self.where}",
                        hint=f'Write for example M{code} = ["{StatementForms.of(self.language).output_of_word}"]',
                    )

    def _says(self, code: int, key: str) -> bool:
        return any(key in line for line in self.statements[code])

    def _unmapped(self, missing: Mapping[int, Block]) -> ProgramError:
        table = f"controller.spindle.{self.language}"
        codes = sorted(missing, key=lambda code: (missing[code].line, code))
        keys = [KEYS.get(code, f"m_codes.M{code}") for code in codes]
        first = missing[codes[0]]
        lines = [f"M{code} (line {missing[code].line})" for code in codes]
        return ProgramError(
            f"the cell file does not say what {' and '.join(f'M{code}' for code in codes)} "
            f"{'is' if len(codes) == 1 else 'are'} on this controller",
            where=f"line {first.line}",
            value=" ".join(first.text.split())[:60] if len(codes) == 1 else ", ".join(lines),
            limit=f"{', '.join(f'{table}.{key}' for key in keys)} in {self.where}",
            hint=f"Add under [{table}] the statements of the robot's language, for example "
            + " and ".join(self._example(key) for key in keys[:2])
            + "; an empty list stops the program for a person to do it"
            * any(code in _BY_HAND and code in missing for code in codes),
        )

    def _function(self, code: int, block: Block) -> list[str]:
        if code not in self.statements:
            raise self._unmapped({code: block})
        words = self._filling(code, block)
        out = [_filled(line, words) for line in self.statements[code]]
        if not out and code in _BY_HAND:
            out = self._stop(_by_hand(code, words[SPEED], words[TOOL]))
        if code in (3, 4):
            out += self._pause() + self._until(self.ready, _NOT_AT_SPEED)
        elif code == 5:
            out += self._until(self.standing, _NOT_STANDING)
        return out

    def _filling(self, code: int, block: Block) -> dict[str, str]:
        """Text for each place of the statements of a code."""
        rpm, tool = abs(block.modal.spindle_rpm), block.modal.tool
        if rpm == 0.0 and self._says(code, SPEED):
            raise ProgramError(
                "the spindle is started without a speed", where=f"line {block.line}", value=f"M{code}",
                limit="S above 0",
            )  # fmt: skip
        data = self.tool_data.get(tool)
        if data is None and self._says(code, DATA):
            raise ProgramError(
                "the cell file does not name the tool data of a tool", where=f"line {block.line}", value=f"T{tool}",
                limit=f"tools.{StatementForms.of(self.language).data_key} of T{tool} in {self.where}",
            )  # fmt: skip
        own = _own_words(code, block)
        for key in WORDS:
            if self._says(code, key) and key not in own:
                raise ProgramError(
                    f"the statements of M{code} need a word that the block does not give it",
                    where=f"line {block.line}", value=" ".join(block.text.split())[:60],
                    limit=f"M{code} with {key[1].upper()}, for {key}",
                )  # fmt: skip
        return {SPEED: f"{rpm:.0f}", TOOL: f"{tool}", DATA: data or "", **own}

    def _example(self, key: str) -> str:
        return f'{key} = ["{StatementForms.of(self.language).output}"]'

    def _in_place(self) -> list[str]:
        """A controller that runs ahead of the motion waits until the tool is there."""
        return list(StatementForms.of(self.language).in_place)

    def _stop(self, why: str) -> list[str]:
        return StatementForms.of(self.language).stop(why)

    def _pause(self) -> list[str]:
        return [] if self.pause_s == 0.0 else [StatementForms.of(self.language).pause.format(f"{self.pause_s:.1f}")]

    def _until(self, condition: str, fault: str) -> list[str]:
        return StatementForms.of(self.language).until(condition, self.wait_s, fault) if condition else []


def _codes(block: Block) -> list[int]:
    """M-codes of a block that need statements; a new speed of a spindle that turns starts it again."""
    codes = [int(word.value) for word in block.words if word.letter == "M" and word.value == int(word.value)]
    codes = [code for code in codes if code not in ELSEWHERE | _NO_EFFECT]
    if not codes and block.modal.spindle_rpm != 0.0 and any(word.letter == "S" for word in block.words):
        codes = [3 if block.modal.spindle_rpm > 0.0 else 4]
    return codes


def _own_words(code: int, block: Block) -> dict[str, str]:
    """Words that an M-code takes, by what stands for them in statements: ``{"{p}": "1"}`` for M62 P1."""
    letters = WORDS_OF_M.get(code, "")
    return {f"{{{word.letter.lower()}}}": f"{word.value:g}" for word in block.words if word.letter in letters}


def only_said(lines: Sequence[str], comment: str) -> int | None:
    """Return the line where a robot program starts the spindle or changes the tool by a comment alone.

    A block of the milling program that is carried as a comment (``; M3 S13000``) must be followed by something that
    does it, or stops for a person to do it; a motion behind it would run over standing metal.

    Args:
        comment: What begins a comment: ``;`` or ``!``.

    Returns:
        Index of the comment, or None.
    """
    for i, line in enumerate(lines):
        text = re.sub(r"\([^)]*\)", "", line.strip().removeprefix(comment)).strip()
        if not line.strip().startswith(comment) or not _CARRIED.fullmatch(text) or not _STARTED.search(text):
            continue
        code = (later.split(comment)[0].strip() for later in lines[i + 1 :])
        following = next((later for later in code if later), "")
        if not following or _NO_DEED.match(following):
            return i
    return None


def refuse_only_said(lines: Sequence[str], comment: str, where: str) -> None:
    """Refuse a program that starts the spindle or changes the tool by a comment alone. Raises ProgramError: it does."""
    at = only_said(lines, comment)
    if at is not None:
        raise ProgramError(
            "a comment alone stands where the spindle is started or the tool changed", where=f"{where}:{at + 1}",
            value=lines[at].strip()[:60], limit="statements that do it, or a stop for a person",
            hint="Say in [controller.spindle] of the cell file what does it, and compensate again",
        )  # fmt: skip


def stop_under_correction(line: str, where: str, statement: str) -> ProgramError:
    """The error of a program that stops for a person while the correction acts.

    Args:
        line: That stops.
        statement: What stops a program in its language.
    """
    return ProgramError(
        "the program stops for the operator on its path, while the correction acts",
        where=where,
        value=line.strip()[:60],
        limit=f"{statement} before the first path motion or behind the last one",
        hint="Say in [controller.spindle] of the cell file what does it, or compensate the parts before and behind the "
        "stop as programs of their own, and set each of them up by itself",
    )


def _by_hand(code: int, rpm: str, tool: str) -> str:
    if code == 6:
        return f"change to tool T{tool}, then press start"
    if code == 5:
        return "stop the spindle, then press start"
    return f"start the spindle{' counter-clockwise' if code == 4 else ''}, {rpm} rpm, then press start"


def _filled(line: str, words: Mapping[str, str]) -> str:
    for word, text in words.items():
        line = line.replace(word, text)
    return line
