"""Table ``[controller]`` of a cell file: what the robot controller does with a program, and which one it is."""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar, Final

from pydantic import AfterValidator, Field, create_model, model_validator

from counterflex.core.errors import FileFormatError
from counterflex.core.units import MM, MS
from counterflex.files.schema import PoseTable, Table
from counterflex.programs.language import LANGUAGES
from counterflex.programs.robot_writer.machine_functions import (
    DATA,
    ELSEWHERE,
    KEYS,
    SPEED,
    TOOL,
    WORDS,
    MachineFunctions,
)

_PLACEHOLDER: Final = re.compile(r"\{[A-Za-z_]*\}")
_M_CODE: Final = re.compile(r"M(\d{1,3})")


def _line(text: str) -> str:
    if not text.isascii() or not text.isprintable():
        raise ValueError("a statement is one line of plain ASCII text")
    known = (SPEED, TOOL, DATA, *WORDS)
    unknown = next((word for word in _PLACEHOLDER.findall(text) if word not in known), None)
    if unknown is not None:
        raise ValueError(
            f"{unknown} stands for nothing; expected {SPEED} (rpm), {TOOL} (tool), {DATA} (tool data), "
            f"{' '.join(WORDS)} (words of the M-code)"
        )
    return text


Statement = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_line)]
Statements = Annotated[tuple[Statement, ...], Field(max_length=20)]
Condition = Annotated[str, Field(max_length=200), AfterValidator(_line)]
_SIGNS: Final = {";": "a semicolon"}  # Names of the ends of statements, for messages


class StatementsTable(Table):
    """Statements of one robot language. A key that is left out is not mapped; an empty list says: by hand."""

    clockwise: Statements | None = None
    counter_clockwise: Statements | None = None
    off: Statements | None = None
    ready: Condition = ""
    standing: Condition = ""
    mist: Statements | None = None
    flood: Statements | None = None
    coolant_off: Statements | None = None
    tool_change: Statements | None = None
    m_codes: dict[str, Statements] = Field(default_factory=dict)
    language: ClassVar[str] = ""
    end: ClassVar[str] = ""  # Of every statement, and of no condition; empty where statements have none

    @model_validator(mode="after")
    def _codes(self) -> StatementsTable:
        for name in self.m_codes:
            match = _M_CODE.fullmatch(name)
            if match is None:
                raise ValueError(f"m_codes.{name} is no M-code; expected M and a number, for example M51")
            code = int(match[1])
            if name != f"M{code}":
                raise ValueError(f"m_codes.{name}: write M{code}")
            if code in KEYS:
                raise ValueError(f"m_codes.{name} has a key of its own: {KEYS[code]}")
            if code in ELSEWHERE:
                raise ValueError(f"m_codes.{name} stops or ends the program by itself and cannot be mapped")
        return self

    @model_validator(mode="after")
    def _ended(self) -> StatementsTable:
        if not self.end:
            return self
        sign = _SIGNS.get(self.end, self.end)
        for line in (line for lines in self.by_code().values() for line in lines):
            if not line.rstrip().endswith(self.end):
                raise ValueError(f"a {self.language} statement ends in {sign}: {line}")
        for key in ("ready", "standing"):
            if self.end in getattr(self, key):
                raise ValueError(f"{key} is a condition, for example diSpindleReady=1; without {sign}")
        return self

    def by_code(self) -> dict[int, Statements]:
        """Statements by M-code."""
        results = {code: getattr(self, key) for code, key in KEYS.items()}
        own = {int(name[1:]): lines for name, lines in self.m_codes.items()}
        return {code: lines for code, lines in results.items() if lines is not None} | own


class _SpindleTimes(Table):
    wait_s: Annotated[float, Field(ge=0.1, le=600.0)] = 20.0
    pause_s: Annotated[float, Field(ge=0.0, le=600.0)] = 0.0


def _statements_table(language: str, end: str) -> type[StatementsTable]:
    named = {"__module__": __name__, "language": language, "end": end}
    return type(f"{language}StatementsTable", (StatementsTable,), named) if end else StatementsTable


_TABLES: Final[dict[str, Any]] = {
    name: (table := _statements_table(one.short, one.forms.end), table())
    for name, one in LANGUAGES.items()
    if one.forms is not None
} | {name: (StatementsTable, StatementsTable()) for name in LANGUAGES.broken()}
_SpindleLanguages: Any = create_model("SpindleLanguages", __base__=_SpindleTimes, **_TABLES)


class SpindleTable(_SpindleLanguages):  # type: ignore[misc]
    """Spindle, coolant and tool change, with a table for each robot language that is registered."""

    def of_language(self, language: str) -> StatementsTable:
        """Statements of a robot language."""
        table: StatementsTable = getattr(self, language)
        return table

    def functions(
        self, language: str, tool_data: dict[int, str] | None = None, where: str = "the cell file"
    ) -> MachineFunctions:
        """Return what the writer of a language calls for every block.

        Args:
            tool_data: What the controller calls the tool frame, by number of the tool.
        """
        table = self.of_language(language)
        return MachineFunctions(
            language, table.by_code(), table.ready, table.standing, self.wait_s, self.pause_s, tool_data or {}, where
        )


_DIGITS: Final = re.compile(r"[0-9]{1,2}(\.[0-9]{1,4}){0,3}", re.ASCII)
_NAMED: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}", re.ASCII)


def _version(text: str) -> str:
    if not _DIGITS.fullmatch(text):
        raise ValueError(f'not a version: {text!r}; expected numbers and dots, for example "4.1"')
    return text


def _name(text: str) -> str:
    if not _NAMED.fullmatch(text):
        raise ValueError(
            f"not the name of a signal or frame: {text!r}; expected up to 32 letters, digits and _, a letter first"
        )
    return text


Version = Annotated[str, AfterValidator(_version)]
ControllerName = Annotated[str, AfterValidator(_name)]


def rsi_generation(rsi: str | None, kss: str | None) -> int | None:
    """Major version of RSI, from its own version and that of the system software KSS; None where neither is given.

    RSI 3 reads three files (``.rsi``, ``.rsi.xml``, ``.rsi.diagram``), RSI 4 and 5 one (``.rsix``). Systems before
    KSS 8.5 read the three in any case.

    Raises:
        ValueError: A version that no context can be written for, or two that do not belong together.
    """
    if kss is not None and not (8, 1) <= _numbers(kss) < (9,):
        raise ValueError(
            f"kss_version = {kss}: no RSI files can be made for it; expected 8.1 to 8.7 "
            "(KR C2 has no context files, iiQKA other calls)"
        )
    old = kss is not None and _numbers(kss) < (8, 5)
    if rsi is None:
        return None if kss is None else 3 if old else 4 if _numbers(kss) < (8, 7) else 5
    major = _numbers(rsi)[0]
    if major not in (3, 4, 5):
        raise ValueError(
            f"rsi_version = {rsi}: no RSI files can be made for it; expected 3, 4 or 5 "
            "(RSI 2 of a KR C2 has no context files, RSI 6 of iiQKA has other calls)"
        )
    if kss is not None and major == 3 and not old:
        raise ValueError(f"rsi_version = {rsi} and kss_version = {kss} do not belong together; KSS 8.5 has RSI 4 or 5")
    if major == 5 and old:
        raise ValueError(f"rsi_version = {rsi} and kss_version = {kss} do not belong together; RSI 5 needs KSS 8.7")
    return 3 if old else major


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(word) for word in version.split("."))


class ControllerTable(Table):
    """Behaviour of the robot controller on a program."""

    cycle_ms: Annotated[float, Field(ge=0.1, le=1000.0)] = 12.0
    blending_mm: Annotated[float, Field(ge=0.0, le=100.0)] = 0.5
    acceleration_mm_s2: Annotated[float, Field(ge=1.0, le=1e6)] = 1000.0
    rapid_mm_s: Annotated[float, Field(ge=0.1, le=1e5)] = 250.0
    least_block_ms: Annotated[float, Field(ge=0.1, le=1000.0)] | None = None
    look_ahead_blocks: Annotated[int, Field(ge=1, le=100_000)] | None = None
    tool_number: Annotated[int, Field(ge=1, le=32)] = 1
    base_number: Annotated[int, Field(ge=1, le=64)] = 1
    work_object: ControllerName | None = None
    robot_in_world: PoseTable | None = None
    rsi_version: Version | None = None
    kss_version: Version | None = None
    correction_output: Annotated[int, Field(ge=1, le=8192)] | None = None
    correction_signal: ControllerName | None = None
    armed_signal: ControllerName | None = None
    spindle: SpindleTable = SpindleTable()

    @model_validator(mode="after")
    def _together(self) -> ControllerTable:
        rsi_generation(self.rsi_version, self.kss_version)
        return self

    @property
    def cycle_s(self) -> float:
        """Interpolation cycle, s."""
        return self.cycle_ms * MS

    @property
    def least_block_s(self) -> float:
        """Shortest time for a block, s; the interpolation cycle where nothing else is known."""
        return self.cycle_s if self.least_block_ms is None else self.least_block_ms * MS

    @property
    def blending_m(self) -> float:
        """Distance from a corner within which it is blended, m."""
        return self.blending_mm * MM

    @property
    def acceleration_m_s2(self) -> float:
        """Acceleration along the path, m/s2."""
        return self.acceleration_mm_s2 * MM

    @property
    def rapid_m_s(self) -> float:
        """Speed of rapid moves, m/s."""
        return self.rapid_mm_s * MM

    def rsi_generation(self, where: str) -> int:
        """Major version of RSI that contexts are written for: 3, 4 or 5.

        Raises:
            FileFormatError: The file does not say which RSI the controller has.
        """
        result = rsi_generation(self.rsi_version, self.kss_version)
        if result is None:
            raise FileFormatError(
                "the cell file does not state the RSI version of the controller: its files differ",
                where=f"{where}: controller",
                limit='rsi_version = "3.3", "4.1" or "5.0" (on the controller: Help, Info, Options)',
                hint="Add the key to the table [controller]",
            )
        return result
