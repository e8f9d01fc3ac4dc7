"""The words of one Sinumerik block: which codes it names, and which words nothing has used yet."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.core.similar import close_to
from counterflex.programs.gcode.sinumerik.scanner import Address, Line, ScannedName
from counterflex.programs.gcode.sinumerik.words import (
    AXES,
    REFUSED_CALL,
    REFUSED_CYCLE,
    ROTARY,
    SINUMERIK,
    VECTOR,
    WordTable,
)
from counterflex.programs.program import Word

Fault = Callable[[str, int, object, str | None], ProgramError]
_ROLES: Final = {"CR": "R", "TURN": "P", "A3": "I", "B3": "J", "C3": "K", "S1": "S"}
_NEUTRAL_WITH: Final = {"CYCLE800": ("",), "SETMS": ("", "1")}
"""Calls that are neutral with these arguments, and refused with others."""
_NO_SWIVEL: Final = re.compile(
    r"\(?\s*0*\s*,\s*\"[^\"]*\"(?:\s*,[^,]*){2}(?:\s*,\s*[-+]?0*\.?0*\s*){9}(?:,[^,]*)*\)?\s*"
)
"""Arguments of CYCLE800 without retraction (FR), shifts (X0 Y0 Z0, X1 Y1 Z1) and angles (A, B, C)."""
MIDDLE: Final = ("I1", "J1", "K1")
"""Point on the arc of CIP."""
_OF_DWELL: Final = {"F": "P", "S": "Q"}
_TAKEN: Final = frozenset((*AXES, *ROTARY, *VECTOR, *"IJKFSTDNHP", "CR", "AR", "TURN", "RPL", "S1", *MIDDLE,
                             "SPOS", "SPOSA",
        "X1",
        "Y1",
        "Z1",
        "FP"))  # fmt: skip


class SinumerikBlock:
    """Words of a block, checked against the tables.

    Raises:
        ProgramError: A word that is unknown, refused, or there twice.

    Attributes:
        cycle: Call of a drilling cycle, as written; empty where there is none.
        modal_call: MCALL: the cycle is made behind the blocks that follow, or none is any more.
    """

    def __init__(self, line: Line, fault: Fault, text: str, table: WordTable = SINUMERIK) -> None:
        self._fault, self._text, self._table = fault, text, table
        self.groups: dict[str, str] = {}  # Code of each modal group named
        self.m: list[int] = []  # M codes
        self.given: dict[str, Address] = {}  # Addresses by name
        self.calls: list[ScannedName] = []  # Subprograms that the block calls, as written
        self.cycle, self.modal_call = "", False
        self._codes: list[Word] = []
        self._columns: dict[str, int] = {}
        for name in line.names:
            self._name(name)
        for address in line.addresses:
            self._address(address)
        self._unused = set(self.given) - {"N"} - table.carried_values

    def _shown(self, start: int, end: int) -> str:
        return self._text[start:end].strip()[:40]

    def _name(self, name: ScannedName) -> None:
        table, word = self._table, name.name
        if word in table.drilling and name.called and not self.cycle:
            self.cycle = self._text[name.start : name.end]
            self._columns[word] = name.start
        elif word == "MCALL" and table.drilling:
            self.modal_call = True
        elif self._neutral(name):
            return
        elif word in table.refused or word.startswith(table.cycles or "0"):
            if word not in table.carried:
                what, hint = table.refused.get(word, REFUSED_CYCLE)
                raise self._fault(f"{what}: {word}", name.start, self._shown(name.start, name.end), hint)
        elif word in table.group:
            self._group(word, name.start)
        elif word == "RET":
            self.m.append(17)
        elif word not in table.carried:
            if not table.subprograms:
                raise self._unknown(name)
            self.calls.append(name)

    def _neutral(self, name: ScannedName) -> bool:
        """Return whether a name with its arguments changes nothing that is read."""
        arguments = name.arguments
        if name.name == "FGROUP":
            if not {axis.strip().upper() for axis in arguments.split(",")} >= set(AXES):
                shown = self._shown(name.start, name.end)
                raise self._fault("the feed belongs to some axes only: FGROUP", name.start, shown, "FGROUP(X,Y,Z)")
            return True
        if name.name == "CYCLE800" and _NO_SWIVEL.fullmatch(arguments):
            return True
        return arguments.strip("() ") in _NEUTRAL_WITH.get(name.name, ()) and (name.called or name.name == "SETMS")

    def _unknown(self, name: ScannedName) -> ProgramError:
        what, hint = REFUSED_CALL
        if not name.called:
            close = close_to(name.name, [*self._table.group, *self._table.carried], 1)
            what = f"an unknown word of the {self._table.dialect} dialect"
            hint = f"Did you mean {close[0]}?" if close else ""
        return self._fault(what, name.start, self._shown(name.start, name.end), hint or None)

    def _group(self, code: str, start: int) -> None:
        group = self._table.group[code]
        if group in self.groups:
            raise self._fault(
                f"two words of the group '{group}' in one block", start, f"{self.groups[group]} and {code}",
                "Put them on two lines",
            )  # fmt: skip
        self.groups[group] = code
        self._columns[code] = start

    def _address(self, address: Address) -> None:
        table, name, value = self._table, address.name, address.value
        shown = self._shown(address.start, address.end)
        if name in ("G", "M", "M1") and value is not None:
            self._code(address, name[0], value, shown)
        elif name in table.refused:
            what, hint = table.refused[name]
            raise self._fault(what, address.start, shown, hint)
        elif name == "L":
            if not table.subprograms or value is None:
                raise self._fault(REFUSED_CALL[0], address.start, shown, REFUSED_CALL[1])
            self.calls.append(ScannedName(shown.replace(" ", "").upper(), False, address.start, address.end))
        elif name not in _TAKEN and name not in table.carried_values:
            declare = f"If it is a variable of the program, declare it: DEF REAL {name}"
            raise self._fault(f"an unknown word of the {table.dialect} dialect", address.start, shown,
                              declare if table.subprograms and len(name) > 1 else None)  # fmt: skip
        elif name in self.given:
            raise self._fault("the word appears twice in one block", address.start, shown, None)
        else:
            self.given[name] = address

    def _code(self, address: Address, letter: str, value: float, shown: str) -> None:
        """Note a G or M code."""
        table, code = self._table, f"{letter}{value:g}"
        if letter == "M":
            if value not in table.m_codes:
                raise self._fault(f"an unknown M code of the {table.dialect} dialect", address.start, shown,
                                  "M functions of the machine builder are not read")  # fmt: skip
            self.m.append(int(value))
        elif code in table.refused:
            what, hint = table.refused[code]
            raise self._fault(what, address.start, shown, hint)
        elif code not in table.group:
            raise self._fault(f"an unknown G code of the {table.dialect} dialect", address.start, shown, None)
        else:
            self._group(code, address.start)
        self._codes.append(Word(letter, value, address.start, address.end))

    def fault(self, what: str, name: str = "", value: object = None, hint: str | None = None) -> ProgramError:
        """Make an error at a word, a code, or the line's beginning."""
        address = self.given.get(name)
        column = address.start if address is not None else self._columns.get(name, 0)
        if value is None and address is not None:
            value = self._shown(address.start, address.end)
        return self._fault(what, column, value, hint)

    def fault_at(self, what: str, column: int, value: object, hint: str) -> ProgramError:
        """Make an error at a column."""
        return self._fault(what, column, value, hint)

    def named_fault(self, call: ScannedName, name: str, meant: str) -> ProgramError:
        """Make the error of a name that is neither a word of the language nor a subprogram."""
        shown = self._shown(call.start, call.end)
        if call.called or call.name.endswith("CALL") or (call.name[:1] == "L" and call.name[1:].isdecimal()):
            what = "a subprogram is called that is neither in the program's file nor in its folder"
        else:
            what = f"an unknown word of the {self._table.dialect} dialect"
        meant = meant or f"If it is a subprogram, put {name}.spf beside the program"
        return self._fault(what, call.start, shown, meant)

    def has(self, *names: str) -> bool:
        """Return whether one of the words is there and nothing has used it yet."""
        return any(name in self._unused for name in names)

    def take(self, name: str) -> float | None:
        """Use a word; None where the block has none. Raises ProgramError: it is a string."""
        if name not in self._unused:
            return None
        self._unused.discard(name)
        value = self.given[name].value
        if value is None:
            raise self.fault(f"{name} needs a number", name)
        return value

    def take_text(self, name: str) -> str | None:
        """Use a word that may be a string."""
        if name not in self._unused:
            return None
        self._unused.discard(name)
        address = self.given[name]
        return address.string if address.string is not None else f"{address.value:g}"

    def absolute(self, name: str, default: bool) -> bool:
        """Return whether a word counts from zero, by AC or IC or the mode given."""
        mode = self.given[name].mode
        return default if not mode else mode == "AC"

    def words(self, dwell: bool, axes: bool) -> tuple[Word, ...]:
        """The words in the roles that writers know: CR as R, A3 B3 C3 as I J K, F of a dwell as P.

        A block that leaves for a place of the machine (SUPA, G153, G500) has G53 for it, and no targets.

        Args:
            dwell: F is a time.
            axes: The block moves: its axis words are targets.
        """
        words = list(self._codes)
        for address in self.given.values():
            if address.value is None or (not axes and address.name in (*AXES, *ROTARY, *VECTOR, *"IJK")):
                continue
            role = _OF_DWELL.get(address.name) if dwell else None
            role = role or _ROLES.get(address.name, address.name)
            absolute = None if not address.mode else address.mode == "AC"
            words.append(Word(role, address.value, address.start, address.end, address.literal, absolute))
        if not axes and "frame" not in self.groups and any(name in self.given for name in AXES):
            words.append(Word("G", 53.0, 0, 0, False))
        return tuple(sorted(words, key=lambda word: word.start))

    def finish(self) -> None:
        """Refuse words that nothing used. Raises ProgramError: there is one."""
        if self._unused:
            name = min(self._unused, key=lambda key: self.given[key].start)
            raise self.fault("nothing in this block uses the word", name)
