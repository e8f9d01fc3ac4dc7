"""Table ``[controller]`` of a cell file: what the robot controller does with a program, and which one it is."""

from __future__ import annotations

import re
from typing import Annotated, Final

from pydantic import AfterValidator, Field, model_validator

from counterflex.core.errors import FileFormatError
from counterflex.files.cell.spindle import SpindleTable
from counterflex.files.schema import Table

_DIGITS: Final = re.compile(r"[0-9]{1,2}(\.[0-9]{1,4}){0,3}", re.ASCII)
_NAMED: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}", re.ASCII)


def _version(text: str) -> str:
    if not _DIGITS.fullmatch(text):
        raise ValueError(f'not a version: {text!r}; expected numbers and dots, for example "4.1"')
    return text


def _name(text: str) -> str:
    if not _NAMED.fullmatch(text):
        raise ValueError(f"not the name of a signal: {text!r}; expected up to 32 letters, digits and _, a letter first")
    return text


Version = Annotated[str, AfterValidator(_version)]
SignalName = Annotated[str, AfterValidator(_name)]


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
    """What the robot controller does with a program."""

    cycle_ms: Annotated[float, Field(ge=0.1, le=1000.0)] = 12.0
    blending_mm: Annotated[float, Field(ge=0.0, le=100.0)] = 0.5
    acceleration_mm_s2: Annotated[float, Field(ge=1.0, le=1e6)] = 1000.0
    rapid_mm_s: Annotated[float, Field(ge=0.1, le=1e5)] = 250.0
    tool_number: Annotated[int, Field(ge=1, le=32)] = 1
    base_number: Annotated[int, Field(ge=1, le=64)] = 1
    rsi_version: Version | None = None
    kss_version: Version | None = None
    correction_output: Annotated[int, Field(ge=1, le=8192)] | None = None
    correction_signal: SignalName | None = None
    armed_signal: SignalName | None = None
    spindle: SpindleTable = SpindleTable()

    @model_validator(mode="after")
    def _together(self) -> ControllerTable:
        rsi_generation(self.rsi_version, self.kss_version)
        return self

    def rsi_generation(self, where: str) -> int:
        """Major version of RSI that contexts are written for: 3, 4 or 5.

        Raises:
            FileFormatError: The file does not say which RSI the controller has.
        """
        found = rsi_generation(self.rsi_version, self.kss_version)
        if found is None:
            raise FileFormatError(
                "the cell file does not say which RSI the controller has: its files differ",
                where=f"{where}: controller",
                limit='rsi_version = "3.3", "4.1" or "5.0" (on the controller: Help, Info, Options)',
                hint="Add the key to the table [controller]",
            )
        return found
