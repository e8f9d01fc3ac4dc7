"""KUKA RSI set-ups: judge one before a robot runs it, or make one for a cell."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from counterflex import __version__
from counterflex.app import robot_folder
from counterflex.core.errors import FileFormatError, ProgramError
from counterflex.files.cell.cell import read_cell
from counterflex.files.cell.controller import ControllerTable
from counterflex.files.cell.online import OnlineTable
from counterflex.files.cell.tables import CellTables
from counterflex.integrations.kuka.language.rsi import called, check_main, check_path, link_test, with_correction
from counterflex.integrations.kuka.language.rsi_switching import RsiSwitching
from counterflex.integrations.kuka.link.calls import parse_calls, read_calls
from counterflex.integrations.kuka.link.check.all_rules import check as judge
from counterflex.integrations.kuka.link.config import parse_config, read_config
from counterflex.integrations.kuka.link.context import parse_context, read_context
from counterflex.integrations.kuka.link.make import files as rsi_files
from counterflex.integrations.kuka.link.readme import readme
from counterflex.integrations.kuka.link.whole_setup import OnlineLimits, Setup
from counterflex.programs.compensated import marks
from counterflex.protocols.finding import Finding

NAME: Final = "counterflex"
"""Of the context and its files."""
LINK_TEST: Final = "cf_link_test"
"""Of the program that tries the link."""
_ARMED_S: Final = 60.0  # How long the program waits for the loop to be armed: it settles, and a person arms it
_ZERO_S: Final = 2.0  # How long the program waits for the correction beyond what ramping it out takes


@dataclass(frozen=True)
class CheckSettings:
    """Settings of the check."""

    config: Path  # ETHERNET file
    cell: Path | None = None  # Cell file with an ``[online]`` table, or None
    context: Path | None = None  # Context (``.rsi.xml``, ``.rsix``), or None
    program: Path | None = None  # KRL program (``.src``), or None
    # Other UDP ports in use on the sensor computer, by what uses them
    ports: dict[str, int] = field(default_factory=dict)

    def check(self) -> tuple[Finding, ...]:
        """Judge a set-up.

        Returns:
            Findings, errors first.

        Raises:
            FileFormatError: A file cannot be read as what it should be.
        """
        return judge(
            Setup(
                read_config(self.config),
                None if self.context is None else read_context(self.context),
                None if self.program is None else read_calls(self.program),
                None if self.cell is None else _limits(self.cell),
                self.ports,
            )
        )


@dataclass(frozen=True)
class RsiMakeSettings:
    """Settings of the files that are made."""

    cell: Path  # Cell file with an ``[online]`` table
    program: Path | None = None  # Compensated KRL program (``.src``), or None: a program that only tries the link
    host: str = "192.168.44.10"  # Address of the sensor computer
    port: int = 59152  # UDP port on it
    sentype: str = "Counterflex"  # Type of the answers

    def make(self, out: str | Path) -> dict[str, Any]:
        """Write ETHERNET file, context, KRL program and README of a cell into a folder, all of them or none.

        Args:
            out: Folder; made when missing.

        Returns:
            The summary: files, limits, findings about what was written.

        Raises:
            FileFormatError: The cell has no ``[online]`` table, or does not say which RSI the controller has.
            InputError: Address or limits cannot be used: what would be written has a finding of severity error.
            ProgramError: The program cannot run under correction.
        """
        robot_folder.require_other_folder(out, self.program)
        cell = read_cell(self.cell)
        table = _online_of(cell.tables, self.cell)
        controller = cell.tables.controller
        files = rsi_files.RsiFiles(
            NAME,
            self.host,
            self.port,
            self.sentype,
            limits_of(table, override=cell.tables.override is not None),
            currents=table.torque_per_current_nm is not None,
            override=cell.tables.override is not None,
            generation=controller.rsi_generation(str(self.cell)),
        )
        rsi_files.check_files(files)
        switching = RsiSwitching(
            context=files.created_as,
            parameters=files.public_parameters(),
            cycle_ms=files.limits.period_ms,
            enable_index=rsi_files.ENABLE_INDEX,
            feed_hold_index=rsi_files.FEED_HOLD_INDEX,
            state_index=rsi_files.STATE_INDEX,
            correction_index=rsi_files.CORRECTION_INDEX,
            armed_s=_ARMED_S,
            zero_s=table.correction_mm / table.ramp_mm_s + _ZERO_S,
            output=controller.correction_output,
        )
        programs, main, elsewhere = _programs(self.program, switching, controller)
        texts = {files.ethernet_name: files.ethernet(), **files.contexts()}
        findings = judge(
            Setup(
                parse_config(texts[files.ethernet_name].encode(), files.ethernet_name),
                parse_context(texts[files.context_name].encode(), files.context_name),
                parse_calls(programs[main], main),
                files.limits,
            )
        )
        robot_folder.refuse_errors(findings)
        texts["README.txt"] = readme(files, cell.name, main, tuple(programs), elsewhere, switching)
        summary = {
            "job": "rsi make",
            "cell": cell.name,
            "program": main,
            "job_hash": next(iter(marks(programs[main])), ""),
            "files": [*programs, *texts],
            "limits": _limits_said(files, table),
            "warnings": [
                *(item.line() for item in findings),
                *_unmarked(self.program, programs[main]),
                *robot_folder.unwatched(controller.correction_output, "correction_output"),
            ],
            "counterflex": __version__,
        }
        robot_folder.write_folder(out, programs, texts, summary)
        return summary


def _limits_said(files: rsi_files.RsiFiles, table: Any) -> dict[str, Any]:
    return {
        "correction_mm": table.correction_mm,
        "correction_deg": table.correction_deg,
        "controller_mm": None if files.limits.axes else files.clamp_mm,
        "controller_deg": files.axis_clamp_deg if files.limits.axes else files.clamp_deg,
        "cycle_ms": files.limits.period_ms,
        "timeout_cycles": files.timeout,
    }


def limits_of(table: OnlineTable, *, override: bool | None = None) -> OnlineLimits:
    """Return the limits that an ``[online]`` table promises; ``override``: there is a table ``[override]``."""
    return OnlineLimits(
        correction_mm=table.correction_mm,
        correction_deg=table.correction_deg,
        hard_factor=table.hard_factor,
        period_ms=table.period_ms,
        axes=table.output == "axes",
        orientation=table.orientation,
        override=override,
    )


def _unmarked(program: Path | None, text: str) -> tuple[str, ...]:
    """Remark on a program that does not say which plan it belongs to."""
    if program is None or len(marks(text)) == 1:
        return ()
    return (
        f"warning: {program.name} does not say of which plan it is ({len(marks(text))} marks of a job, not 1): the "
        "loop cannot tell a program of another plan; give the program as compensate wrote it",
    )


def _limits(cell: Path) -> OnlineLimits:
    tables = read_cell(cell).tables
    return limits_of(_online_of(tables, cell), override=tables.override is not None)


def _online_of(tables: CellTables, path: Path) -> OnlineTable:
    if tables.online is None:
        raise FileFormatError(
            "the cell file has no table [online]",
            where=str(path),
            hint='Add a table [online], for example with force = "pilot"',
        )
    return tables.online


def _programs(
    program: Path | None, switching: RsiSwitching, controller: ControllerTable
) -> tuple[dict[str, str], str, tuple[str, ...]]:
    """KRL files by name, the main one, and routines that it calls but that do not lie beside it."""
    if program is None:
        main = f"{LINK_TEST}.src"
        return (
            {main: link_test(LINK_TEST, switching, tool=controller.tool_number, base=controller.base_number)},
            main,
            (),
        )
    text = _krl(program)
    check_main(text, program.stem, program.name)
    subprograms = [name for name in called(text) if program.with_name(f"{name}.src").is_file()]
    corrected = {program.name: with_correction(text, switching, program.name, subprograms)}
    elsewhere = []
    for name in (program.stem, *called(text)):
        source, data = program.with_name(f"{name}.src"), program.with_name(f"{name}.dat")
        if name != program.stem:
            if not source.is_file():
                elsewhere.append(name)
                continue
            corrected[source.name] = _krl(source)
            check_path(corrected[source.name].splitlines(), source.name, output=switching.output)
        if data.is_file():
            corrected[data.name] = _krl(data)
        elif name == program.stem and re.search(r"\bXSTART\b", text):
            raise ProgramError(
                "the data list of the program is missing: the controller does not load it", where=str(program),
                value=f"XSTART, but no {data.name}", hint="Keep the .dat beside the .src, as compensate writes them",
            )  # fmt: skip
    return corrected, program.name, tuple(elsewhere)


def _krl(path: Path) -> str:
    return robot_folder.read_program(path, (".src", ".dat"), "KRL program", "krl")


SETUP: Final = robot_folder.RobotSetup(
    "KUKA RSI", lambda **given: CheckSettings(**given).check(), lambda out, **given: RsiMakeSettings(**given).make(out)
)
