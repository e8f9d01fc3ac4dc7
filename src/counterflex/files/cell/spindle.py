"""Table ``[controller.spindle]`` of a cell file: spindle, coolant and tool change as statements of the robot."""

from __future__ import annotations

import re
from typing import Annotated, Final

from pydantic import AfterValidator, Field, model_validator

from counterflex.files.schema import Table
from counterflex.programs.robot_writer.machine_functions import (
    DATA,
    ELSEWHERE,
    KEYS,
    SPEED,
    TOOL,
    Dialect,
    MachineFunctions,
)

_PLACEHOLDER: Final = re.compile(r"\{[A-Za-z_]*\}")
_M_CODE: Final = re.compile(r"M(\d{1,3})")


def _line(text: str) -> str:
    if not text.isascii() or not text.isprintable():
        raise ValueError("a statement is one line of plain ASCII text")
    unknown = next((word for word in _PLACEHOLDER.findall(text) if word not in (SPEED, TOOL, DATA)), None)
    if unknown is not None:
        raise ValueError(f"{unknown} stands for nothing; expected {SPEED} (rpm), {TOOL} (tool), {DATA} (tool data)")
    return text


Statement = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_line)]
Statements = Annotated[tuple[Statement, ...], Field(max_length=20)]
Condition = Annotated[str, Field(max_length=200), AfterValidator(_line)]


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

    def by_code(self) -> dict[int, Statements]:
        """Statements by M-code."""
        found = {code: getattr(self, key) for code, key in KEYS.items()}
        own = {int(name[1:]): lines for name, lines in self.m_codes.items()}
        return {code: lines for code, lines in found.items() if lines is not None} | own


class RapidStatementsTable(StatementsTable):
    """Statements of RAPID: each ends in a semicolon, conditions do not."""

    @model_validator(mode="after")
    def _ended(self) -> RapidStatementsTable:
        for lines in self.by_code().values():
            for line in lines:
                if not line.rstrip().endswith(";"):
                    raise ValueError(f"a RAPID statement ends in a semicolon: {line}")
        for key in ("ready", "standing"):
            if ";" in getattr(self, key):
                raise ValueError(f"{key} is a condition, for example diSpindleReady=1; without a semicolon")
        return self


class SpindleTable(Table):
    """Spindle, coolant and tool change, for each robot language that programs are written in."""

    wait_s: Annotated[float, Field(ge=0.1, le=600.0)] = 20.0
    pause_s: Annotated[float, Field(ge=0.0, le=600.0)] = 0.0
    krl: StatementsTable = StatementsTable()
    rapid: RapidStatementsTable = RapidStatementsTable()

    def functions(
        self, language: Dialect, tool_data: dict[int, str] | None = None, where: str = "the cell file"
    ) -> MachineFunctions:
        """What the writer of a language calls for every block.

        Args:
            language: ``krl`` or ``rapid``.
            tool_data: What the controller calls the tool frame, by number of the tool.
            where: Path of the cell file, for messages.
        """
        table = self.krl if language == "krl" else self.rapid
        return MachineFunctions(
            language,
            table.by_code(),
            table.ready,
            table.standing,
            self.wait_s,
            self.pause_s,
            tool_data or {},
            where,
        )
