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
from counterflex.protocols.finding import Finding


def readme(
    cell: str,
    table: EgmTable,
    online: OnlineTable,
    switching: EgmSwitching,
    host: str,
    programs: tuple[str, ...],
    elsewhere: tuple[str, ...] = (),
) -> str:
    """Text of README.txt.

    Args:
        cell: Name of the cell.
        table: Table ``[egm]`` of it.
        online: Table ``[online]`` of it.
        switching: What the program says to EGM.
        host: Address of the sensor computer.
        programs: RAPID files, the main one first.
        elsewhere: Procedures that it calls and that are not among them.
    """
    path = table.mode == "path"
    way = (
        "Path correction: the robot runs the program, counterflex moves it sideways (y and z of the path frame)."
        if path
        else "Position guidance: the program has no path, counterflex sends it pose by pose."
    )
    level = "Path" if path else "Filtering"
    missing = f"\n  Not here, must be on the controller: {', '.join(elsewhere)}" if elsewhere else ""
    gain = "" if path else f"\n    Default proportional Position Gain  {table.position_gain_per_s:g}"
    armed = _path_waits(switching) if path else _guidance_waits(switching)
    signal = switching.correction_signal
    watched = (
        f"{signal} is 1 from before the path until the correction is back at zero."
        if signal
        else "No output shows that the correction may act: set controller.correction_signal for a safety PLC."
    )
    return f"""ABB EGM program of the cell {cell}

NOT TRIED ON A CONTROLLER, NOR COMPILED BY ABB'S TOOLS. Load it in RobotStudio first; then in air, in manual mode, a
hand on the enabling device, before anything is cut.

{way}
Messages every {switching.period_ms} ms. The loop's own limits: {online.correction_mm:g} mm, {online.correction_deg:g} \
deg, fault at {online.hard_factor:g} times that.

FILES
  {", ".join(programs)}
      load all of them; start the procedure of {programs[0]}{missing}

SET ON THE CONTROLLER
  Option Externally Guided Motion (689-1 in RobotWare 6, 3124-1 in RobotWare 7).
  Communication, UDP Unicast Device
    Name                {switching.device}
    Type                UDPUC
    Remote Address      {host}
    Remote Port Number  {table.port}
  Motion, External Motion Interface Data
    Name                {switching.configuration}
    Level               {level}{gain}
  The sensor computer needs an address in the network of the port that is used, and UDP port {table.port} open in its
  firewall.

RUN
  1. Start the program. It goes to its start posture{"" if path else " and the first point"} and stops.
  2. counterflex run --cell CELL --egm {table.port} -s run.listen={host} --plan PLAN --out LOG [--arm]
     (--original where the program is not the compensated one; without --arm nothing is corrected)
  3. Press start. {armed}
  {watched}

CHECK ON THE CONTROLLER, IN THIS ORDER
 1. The names of device and configuration are taken; some versions of RobotWare 6 want a colon: "{switching.device}:".
 2. Without --arm: messages come every {switching.period_ms} ms, `counterflex log show LOG` counts none lost.
 3. Poses: the pose that counterflex logs is the one that the teach pendant shows in the work object of the program. If
    it is that in the robot's base, set [egm] frame = "base".
{_path_checks() if path else _guidance_checks(table)}
"""


def _guidance_waits(switching: EgmSwitching) -> str:
    return f"It waits at the first point until the loop is armed; {switching.standing_s:g} s without a path end it."


def _path_waits(switching: EgmSwitching) -> str:
    if switching.armed_signal:
        sentence = f"It waits until {switching.armed_signal} = 1"
    else:
        sentence = "It asks the operator whether counterflex run is armed"
    return f"""{sentence}: within {switching.armed_s:g} s, else it ends.
     If the loop is not armed, it stops answering when the path begins, and the controller ends the path.
  4. Behind the path it waits up to {switching.zero_s:g} s for the correction to go, takes out what is left at 5 mm/s,
     and ends where the tool is not within {switching.zero_mm:g} mm then. The tool must be clear of the part there."""


def _path_checks() -> str:
    return """ 4. Sign and axes: on a straight line along x of the work object, tool down, +0.5 mm in y moves the tool
    to the left of the feed, +0.5 mm in z up: x = tangent, y = x cross z of the tool, z = x cross y.
 5. The planned pose in the messages does not contain the correction.
 6. EGMStreamStart gives messages while the robot stands; else take the line out and give the loop time on a first
    movement in air.
 7. How late a correction acts: [online] dead_ms, natural_hz, damping; identify it before anything is cut.
 8. An instruction between two EGMMoveL ends the corrected movement in a fine point, and it goes on behind it.
 9. Pull the cable in air: the program ends within the CommTimeout, by its error handler."""


def _guidance_checks(table: EgmTable) -> str:
    reference = (
        "    Speed references are sent: a robot without messages continues with the last one until its CommTimeout."
        if table.speed_reference
        else "    Speed references are not sent: the tool runs behind its path by v / gain."
    )
    return f""" 4. The robot stays where it is when EGMRunPose begins, and waits for counterflex.
 5. MaxSpeedDeviation is enough: utilization in the log stays below 100 %.
{reference}
 6. How late the robot is where it was sent: [online] dead_ms, natural_hz, damping, for path and correction alike;
    identify it before anything is cut.
 7. The movement ends by itself {table.standing_s:g} s after the tool stands at the end of its path.
 8. Pull the cable in air: the program ends within the CommTimeout, by its error handler."""


_ZERO_S: Final = 1.0
"""How long the program waits for the correction beyond what ramping it out takes."""


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
