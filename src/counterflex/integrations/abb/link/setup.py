"""ABB EGM set-ups: judge a RAPID program before a robot runs it, or make one for a cell."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from counterflex import __version__
from counterflex.app import robot_folder
from counterflex.core.errors import FileFormatError, InputError, ProgramError
from counterflex.core.units import MS
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.links import EgmTable
from counterflex.files.cell.online import OnlineTable
from counterflex.integrations.abb.language.egm import (
    called,
    called_parts,
    last_move,
    part_with_egm,
    start_move,
    with_egm,
)
from counterflex.integrations.abb.language.egm_switching import EgmSwitching
from counterflex.integrations.abb.link.calls import EgmCalls, parse_egm_calls, read_egm_calls
from counterflex.integrations.abb.link.check import ExpectedEgm, check_egm
from counterflex.integrations.abb.link.readme import readme
from counterflex.protocols.finding import Finding

_ZERO_S: Final = 1.0  # How long the program waits for the correction beyond what ramping it out takes


@dataclass(frozen=True)
class EgmMakeSettings:
    """Settings of the modules that are made."""

    cell: Path  # Cell file with the tables ``[online]`` and ``[egm]``
    program: Path  # RAPID program that compensate wrote (``.mod``)
    host: str = "192.168.125.10"  # Address of the sensor computer, for the README

    def make(self, out: str | Path) -> dict[str, Any]:
        """Write the RAPID program of a cell with EGM around its path, and a README, all of it or nothing.

        Args:
            out: Folder; made when missing.

        Returns:
            The summary: files, mode, findings about what was written.

        Raises:
            FileFormatError: The cell has no ``[online]`` table, or a file cannot be read.
            InputError: EGM cannot do what the cell file wants; what would be written has a finding of severity error.
            ProgramError: The program cannot run under EGM.
        """
        robot_folder.require_other_folder(out, self.program)
        cell = read_cell(self.cell)
        online = cell.tables.online
        if online is None:
            raise FileFormatError(
                "the cell file has no table [online]",
                where=str(self.cell),
                hint='Add a table [online], for example with force = "pilot"',
            )
        try:
            ipaddress.IPv4Address(self.host)
        except ValueError as fault:
            raise InputError(
                "not an IPv4 address", where="--host", value=repr(self.host), limit="for example 192.168.125.10"
            ) from fault
        table = cell.tables.egm or EgmTable()
        expected = expected_of(cell)
        switching = EgmSwitching(
            mode=table.mode,
            device=table.device,
            configuration=table.configuration_name,
            period_ms=online.period_ms,
            timeout_s=table.timeout_ms * MS,
            zero_s=round(online.correction_mm / online.ramp_mm_s + _ZERO_S, 2),
            low_pass_hz=table.low_pass_hz,
            speed_deviation_deg_s=table.speed_deviation_deg_s,
            ramp_in_s=table.ramp_in_ms * MS,
            window_mm=table.window_mm,
            window_deg=table.window_deg,
            standing_s=table.standing_s,
            armed_signal=cell.tables.controller.armed_signal or "",
            correction_signal=cell.tables.controller.correction_signal or "",
        )
        files, elsewhere = _programs(self.program, switching)
        findings = check_egm(_together(files), expected)
        robot_folder.refuse_errors(findings)
        summary = {
            "job": "egm make",
            "cell": cell.name,
            "program": self.program.name,
            "mode": table.mode,
            "files": list(files),
            "timeout_ms": table.timeout_ms,
            "sample_ms": online.period_ms,
            "warnings": [
                *(item.line() for item in findings),
                *robot_folder.unwatched(cell.tables.controller.correction_signal, "correction_signal"),
            ],
            "counterflex": __version__,
        }
        about = readme(cell.name, table, online, switching, self.host, tuple(files), elsewhere)
        robot_folder.write_folder(out, files, {"README.txt": about}, summary)
        return summary


def expected_of(cell: Cell) -> ExpectedEgm:
    """Return the facts of a cell file that a RAPID program is checked against.

    Raises:
        InputError: EGM cannot do what the table ``[online]`` wants.
    """
    table, online = cell.tables.egm or EgmTable(), cell.tables.online or OnlineTable()
    table.require(online, str(cell.path))
    return ExpectedEgm(
        table.mode, online.period_ms, table.device, table.configuration_name, in_part=table.frame == "part"
    )


def check(program: Path, cell: Path | None = None) -> tuple[Finding, ...]:
    """Judge a RAPID program.

    Args:
        program: The module that sets up EGM.
        cell: Cell file with an ``[egm]`` table, or None.

    Returns:
        Findings, errors first.

    Raises:
        FileFormatError: A file cannot be read as what it should be.
    """
    return check_egm(read_egm_calls(program), None if cell is None else expected_of(read_cell(cell)))


def _programs(program: Path, switching: EgmSwitching) -> tuple[dict[str, str], tuple[str, ...]]:
    """Modules by name, the main one first, and procedures that it calls but that are no part of its path."""
    text = _rapid(program)
    parts: dict[str, str] = {}
    names = called_parts(text, program.name)
    for name in names:
        part = program.with_name(f"{name}{program.suffix}")
        if not part.is_file():
            raise ProgramError(
                "the program calls a procedure whose module does not lie beside it", where=str(program), value=name,
                hint=f"Its path is not corrected: put {part.name} there",
            )  # fmt: skip
        parts[part.name] = _rapid(part)
    last = next((end for name, part in reversed(parts.items()) if (end := last_move(part, name))), None)
    files = {program.name: with_egm(text, switching, program.name, last)}
    start = start_move(text, program.name)
    for k, (name, part_text) in enumerate(parts.items()):
        files[name] = part_with_egm(part_text, name, first=k == 0, start=start)
    return files, tuple(name for name in called(text, program.name) if name not in names)


def _together(files: dict[str, str]) -> EgmCalls:
    """The instructions of all modules in the order in which they are run: parts where the main module calls them."""
    (main, text), *parts = files.items()
    called = {Path(name).stem.upper(): parse_egm_calls(part, name) for name, part in parts}
    moves = []
    for item in parse_egm_calls(text, main).instructions:
        part = called.get(item.name)
        moves += [item] if part is None else list(part.of("MOVEL", "EGMMOVEL", "EGMMOVEC"))
    return EgmCalls(tuple(moves), main)


def _rapid(path: Path) -> str:
    return robot_folder.read_program(path, (".mod", ".modx"), "RAPID module", "rapid")


SETUP: Final = robot_folder.RobotSetup("ABB EGM", check, lambda out, **given: EgmMakeSettings(**given).make(out))
