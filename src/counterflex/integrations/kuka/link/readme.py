"""The README beside a made RSI set-up: where the files go, and what only the controller can tell."""

from __future__ import annotations

from counterflex.integrations.kuka.language.rsi_switching import RsiSwitching
from counterflex.integrations.kuka.link.make.files import (
    CORRECTION_INDEX,
    ENABLE_INDEX,
    FEED_HOLD_INDEX,
    STATE_INDEX,
    RsiFiles,
)

_FIRST, _LAST = CORRECTION_INDEX, CORRECTION_INDEX + 5


def readme(
    files: RsiFiles,
    cell: str,
    main: str,
    programs: tuple[str, ...],
    elsewhere: tuple[str, ...],
    switching: RsiSwitching,
) -> str:
    """Text of README.txt.

    Args:
        files: What was written.
        main: Main file of the KRL program.
        programs: All KRL files.
        elsewhere: Routines that it calls and that are not among them.
        switching: What the program does.
    """
    limits = files.limits
    missing = f"\nNot here, must be on the controller: {', '.join(elsewhere)}\n" if elsewhere else ""
    reads = _generation(files)
    drawn = [name for name in files.contexts() if name != files.context_name]
    editor = f"\n      ({' and '.join(drawn)} show the same context in the editor RSIVisual)" if drawn else ""
    return f"""KUKA RSI set-up of the cell {cell}

THE CONTEXT WAS NOT TRIED ON A CONTROLLER. Its form is that of published contexts for {reads}.
Try it in air, override 10 %, a hand on the emergency stop, before anything is cut.

Sends {_kind(files)}.
The loop's own limits: {limits.correction_mm:g} mm, {limits.correction_deg:g} deg, fault at {limits.hard_factor:g} \
times that.
Telegrams go to {files.host}, UDP port {files.port}, every {limits.period_ms} ms; answers carry Type="{files.sentype}".

FILES
  {", ".join([files.ethernet_name, files.context_name, *drawn])}
      to C:\\KRC\\ROBOTER\\Config\\User\\Common\\SensorInterface{editor}
  {", ".join(programs)}
      to KRC:\\R1\\Program; start {main}
{missing}
WHAT THE PROGRAM WAITS FOR
  - HALT before RSI_ON: start counterflex run, then press start.
  - The loop says that it is armed ($SEN_PREA[{STATE_INDEX}] = 2): within {switching.armed_s:g} s, else the program
    halts, and again at every start, until it is.
  - Behind the path: the controller itself says that its correction is zero ($SEN_PREA[{_FIRST}..{_LAST}] within
    0.005 mm and deg), and the loop that it corrects no more: within {switching.zero_s:.1f} s, else it halts in the same
    way. The tool must be clear of the part there.

CHECK ON THE CONTROLLER, IN THIS ORDER
 1. The version of RSI. These files are for {reads}: look at Help, Info, Options. For another one change
    controller.rsi_version in the cell file and make them again.
 2. The editor RSIVisual opens the context and shows the objects below. RSI_CREATE succeeds; "Invalid index" means that
    context and ETHERNET file do not belong together.
 3. RSI_SETPUBLICPAR succeeds: the parameters are marked public in the context, which has the same limits.
 4. {_output(switching)}
 5. The address of the controller's RSI interface lies in the network of {files.host}, no other device does.
 6. Standing still, with the link test (made without --program), `counterflex run` without --arm: telegrams every
    {limits.period_ms} ms, Delay stays 0.
 7. STOP: its Mode 1 (PathNormal) stops a LIN motion when Stop becomes 1. In one published report a STOP object made
    the controller ignore every correction: measure with a dial gauge that a correction of 0.5 mm moves the tool.
 8. Sign and axes: +0.5 mm in each of X, Y, Z of BASE moves the tool that way, and $SEN_PREA[{_FIRST}..{_LAST}] show it.
    RefCorrSys is Base.
 9. Corrections act on the LIN and CIRC motions of this program. No public source shows it for this context.
10. {_override(files)}
11. Feed hold: $SEN_PREA[{FEED_HOLD_INDEX}] = 1 stops the path by interrupt 21 (BRAKE), 0 lets it go on. Is interrupt
    21 free? May an interrupt compare $SEN_PREA? Does the correction stay while the path stands?
12. Enable: $SEN_PREA[{ENABLE_INDEX}] arrives as Enable in the telegrams. Are $SEN_PREA[1..{_LAST}] and $TIMER[20] free?
    The parameter number of the SEN_PREA object was taken from its sister SEN_PINT.
13. If the correction stands still while no motion runs, the program halts behind the path: then ramp out on a retract
    motion instead.
14. Timeout is {files.timeout} cycles. Whether late answers are counted back is not published: watch Delay for an hour.
15. The correction's limit: send {"0.1 deg" if limits.axes else "0.1 mm"} more than it and see Stat rise above 1.

OBJECTS
{_objects(files)}
"""


def _kind(files: RsiFiles) -> str:
    if files.limits.axes:
        return f"axis corrections, AXISCORR +-{files.axis_clamp_deg:g} deg"
    return f"Cartesian corrections in BASE, POSCORR +-{files.clamp_mm:g} mm and {files.clamp_deg:g} deg"


def _generation(files: RsiFiles) -> str:
    return "RSI 3 (systems before KSS 8.5)" if files.generation == 3 else f"RSI {files.generation}"


def _output(switching: RsiSwitching) -> str:
    if switching.output is None:
        return (
            "No output shows that the correction may act. For a safety PLC set controller.correction_output in the\n"
            "    cell file and make the program again."
        )
    return (
        f"$OUT[{switching.output}] is TRUE from before the correction is enabled until it is back at zero, and\n"
        "    stays so where the program is stopped in between. Is the output free, does the safety PLC see it?"
    )


def _override(files: RsiFiles) -> str:
    if not files.override:
        return "The speed of the program is not changed: the cell file has no table [override]."
    return (
        "The speed stays when RSI is switched on: MAP2OV_PRO writes $OV_PRO in every cycle, and before the first\n"
        "    answer the value may be 0."
    )


def _objects(files: RsiFiles) -> str:
    axes = files.limits.axes
    kind = "AXISCORR" if axes else "POSCORR"
    rows = [
        f"  ETHERNET      ConfigFile {files.ethernet_name}, Timeout {files.timeout}, Precision {files.precision}",
        f"                inputs: 1 Stat of {kind}, 2 SEN_PREA",
        f"  {kind:<12}  inputs 1..6 from outputs 1..6 of ETHERNET{'' if axes else ', RefCorrSys Base'}; limits public",
        f"  {kind + 'MON':<12}  above those limits by a fifth",
        "  STOP          input 1 from output 7, Mode PathNormal",
        f"  MAP2SEN_PREA  output 8 (feed hold) to $SEN_PREA[{FEED_HOLD_INDEX}], 9 (state) to $SEN_PREA[{STATE_INDEX}];",
        f"                outputs 1..6 of {kind}MON to $SEN_PREA[{_FIRST}..{_LAST}]",
        *(["  MAP2OV_PRO    input 1 from output 10"] if files.override else []),
        f"  SEN_PREA      Index {ENABLE_INDEX}",
    ]
    return "\n".join(rows)
