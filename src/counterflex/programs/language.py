"""Languages of programs by name: what a language is for every command, and the registry in which makers put theirs.

A :class:`Language` states in one place all that counterflex has for a language. It is light: what reads, writes and
converts stands as ``module:object``, so that a command imports the parts of one language only.

Another package adds one with an entry point of the group ``counterflex.languages`` (docs/extend.md).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final, Literal

from counterflex.core.errors import InputError
from counterflex.core.registry import Registry, imported
from counterflex.core.similar import close_to
from counterflex.programs.limits import LINUXCNC, Limits


@dataclass(frozen=True)
class StatementForms:
    """Statements of a language, one a line, without line numbers."""

    stop: Callable[[str], list[str]]  # Stops for a person, with what he is told
    pause: str  # Waits; ``{}`` is the time in s
    # Waits until a condition holds: condition, longest time in s, what is said where it does not hold
    until: Callable[[str, float, str], list[str]]
    in_place: tuple[str, ...]  # Before a machine function: makes a controller that runs ahead of the motion wait for it
    comment: str  # What begins a comment
    output: str  # An output that is set, as an example
    output_of_word: str  # The same by the P word of an M-code
    data_key: Literal["tool_data", "tooldata"]  # Key of ``[[tools]]`` that names the tool frame on the controller
    end: str = ""  # What every statement of the cell file's table ends in, and no condition has; empty where nothing

    def __post_init__(self) -> None:
        if self.pause.count("{}") != 1 or not self.comment:
            raise InputError("forms need a pause with one {} for the time, and a sign that begins a comment",
                             value=(self.pause, self.comment))  # fmt: skip

    @classmethod
    def of(cls, dialect: str) -> StatementForms:
        """Statements that writers of a robot's language add themselves."""
        forms = LANGUAGES[dialect].forms
        assert forms is not None, dialect
        return forms


BY_ENDING: Final = "ending"
"""In place of a dialect: that of the ending of the file."""
GCODE: Final = "linuxcnc"
"""Dialect of a file whose ending tells none."""
Place = str | Callable[..., Any] | None
"""``module:object``, or the object itself; None where the language has none."""


@dataclass(frozen=True)
class Signs:
    """Signs of a language in the first lines of a text, without capitals and blanks around.

    Those of machines and of languages that are not read are looked for in lines without what G-code takes for comments.
    """

    name: str  # As people call the language; that of a row of ``foreign_language`` replaces the row
    sure: tuple[str, ...]  # Regular expressions; a line that matches one is enough
    likely: tuple[str, ...] = ()  # Two lines are needed that match different ones
    hint: str = ""  # What to do with such a file; empty names dialect and ending

    def __post_init__(self) -> None:
        for sign in (*self.sure, *self.likely):
            try:
                re.compile(sign, re.IGNORECASE)
            except re.error as fault:
                raise InputError(f"a sign of {self.name} is no regular expression: {fault}", value=sign) from fault


@dataclass(frozen=True)
class UnitWords:
    """Words that say the unit of a program: G codes, or the form of a statement, as people write them."""

    codes: frozenset[float]
    shown: str
    form: re.Pattern[str] | None = None


@dataclass(frozen=True, kw_only=True)
class Language:
    """A language of programs."""

    title: str  # One line for help
    short: str = "G-code"  # Name in sentences
    prompt: str = ""  # Name at the prompt (``--as``, ``--to``) where it is not that of the dialect
    endings: tuple[str, ...] = ()  # Of its files, lower case, the usual one first
    signs: Signs | None = None  # What tells it in a file with another ending
    limits: Limits = LINUXCNC  # Of its controller
    # Statements that writers add themselves: a language of robots has them, one of machines has none
    forms: StatementForms | None = None
    waits: re.Pattern[str] | None = None  # Statement that waits for a person or a signal, for a time that nobody knows
    comment: re.Pattern[str] | None = None  # Comment in the text of a block; the first group that matches is its text
    tool_stays: bool = False  # A program that names no tool runs with the one that is active
    orientation: bool = True  # What is written states the orientation of the tool, so that it can be corrected
    # Its programs can name the frame of their targets, ``controller.work_object``; it goes with an axis
    work_object: bool = False
    read: Place = None  # ``(file, *, machine, complete) -> Program``; of a robot ``cell`` in place of ``machine``
    # ``(file) -> tuple[Path, ...]``, files that are read with a program, of languages with jobs of several
    files: Place = None
    table: Place = None  # The :class:`~counterflex.programs.statement_table.StatementTable`
    doubts: Place = None  # ``(program) -> list[str]``, readings of the language that are in doubt, one sentence each
    units: UnitWords | None = None  # Words that say the unit, of a language that may leave it unsaid
    offsets: Place = None  # Class of :mod:`counterflex.programs.stated.offsets` that follows numbered offsets
    diameters: Place = None  # ``(program) -> Iterator[(tool, diameter, line)]``, in program units, stated by statements
    cell: Place = None  # ``(Cell) -> RobotTextCell``, what a robot program is held against
    spelling: Place = None  # :class:`~counterflex.programs.gcode.write.written_line.Spelling` of a dialect of G-code
    # ``(program, CompensatedPath, **settings)``: the program with other targets, all else as it was; see
    # :func:`counterflex.app.compensation.languages.written`
    in_place: Place = None
    write: Place = None  # ``(WritingOrder) -> Written``: a program of another language, compensated, in this one
    # ``(Conversion) -> Emitter``: the same without a correction; see :mod:`counterflex.app.conversion`
    convert: Place = None
    # ``(files, Cell, tools) -> tuple[Fact, ...]``: what the controller must have set, see
    # :func:`counterflex.app.compensation.next_steps.to_load`
    load: Place = None

    def __post_init__(self) -> None:
        wrong = [one for one in self.endings if not re.fullmatch(r"\.[^.\sA-Z]+", one)]
        if wrong:
            raise InputError(
                "an ending is a dot and lower-case characters", value=repr(self.endings), limit="('.prg',)"
            )
        if self.comment is not None and self.comment.groups < 1:
            raise InputError("the comment of a language needs a group, its text", value=self.comment.pattern)
        needed = {
            "read": self.in_place is not None or self.convert is not None,
            "cell": self.robot and self.read is not None,
        }
        missing = next((part for part, needs in needed.items() if needs and getattr(self, part) is None), None)
        if missing is not None:
            raise InputError(f"in_place and convert need read, and read of a robot cell: {missing} is missing",
                             value=self.title)  # fmt: skip

    @property
    def robot(self) -> bool:
        """The language of a robot: its programs state the orientation of the tool."""
        return self.forms is not None


def object_at(place: Place) -> Any:
    """Return the object at a place of a language, imported now. Raises InputError: it cannot be imported."""
    if not isinstance(place, str):
        return place
    try:
        return imported(place)
    except (ImportError, AttributeError) as fault:
        raise InputError(f"a part of a language cannot be imported: {fault}", value=place) from fault


LANGUAGES: Final[Registry[Language]] = Registry(
    "counterflex.languages",
    "language of programs",
    "counterflex.programs.language:Language",
    {GCODE: "counterflex.programs.gcode:LANGUAGE", "apt": "counterflex.programs.apt:LANGUAGE"},
)
"""By dialect."""


def dialects() -> Iterator[str]:
    """Names that a program can be read in, :data:`BY_ENDING` first; to use one that cannot be loaded says why."""
    yield BY_ENDING
    yield from (name for name, one in LANGUAGES.items() if one.read is not None)
    yield from LANGUAGES.broken()


def robot_dialects() -> Iterator[str]:
    """Dialects of robots."""
    return (name for name, one in LANGUAGES.items() if one.robot)


def is_robot(dialect: str) -> bool:
    """Return whether a dialect is that of a robot; False for one that is not registered."""
    return dialect in LANGUAGES and LANGUAGES[dialect].robot


def at_prompt(part: str, *, own: bool = False) -> dict[str, str]:
    """Dialect by name at the prompt, of the languages that have a part: ``write`` or ``convert``.

    Args:
        part: Field of :class:`Language`.
        own: Without those of other packages.
    """
    names: dict[str, str] = {}
    for name, one in LANGUAGES.items():
        if getattr(one, part) is not None and (name in LANGUAGES.own or not own):
            names.setdefault(one.prompt or name, name)  # Our own come first, so that no package takes their names
    return names if own else {name: name for name in LANGUAGES.broken()} | names


def dialect_at(prompt: str, part: str) -> str:
    """Dialect of a name at the prompt.

    Raises:
        InputError: No language of this name has the part; close names are given.
    """
    known = at_prompt(part)
    if prompt not in known:
        close = close_to(prompt, list(known), 1)
        raise InputError(
            "there is no such output language", value=prompt, limit=", ".join(known),
            hint=f"Did you mean '{close[0]}'?" if close else None,
        )  # fmt: skip
    return known[prompt]
