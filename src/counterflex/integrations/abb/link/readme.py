"""The README beside a made EGM program: what to set on the controller, and what only the controller can tell."""

from __future__ import annotations

from counterflex.files.cell.links import EgmTable
from counterflex.files.cell.online import OnlineTable
from counterflex.integrations.abb.language.egm_switching import EgmSwitching


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
