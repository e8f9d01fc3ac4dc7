"""The README beside a made RSI set-up: where the files go, and what only the controller can tell."""

from __future__ import annotations

from counterflex.wire.rsi_files import ENABLE_INDEX, FEED_HOLD_INDEX, RsiFiles


def readme(
    files: RsiFiles, cell: str, main: str, programs: tuple[str, ...], elsewhere: tuple[str, ...], ramp_s: float
) -> str:
    """Text of README.txt.

    Args:
        files: What was written.
        cell: Name of the cell.
        main: Main file of the KRL program.
        programs: All KRL files.
        elsewhere: Routines that it calls and that are not among them.
        ramp_s: Time that the program waits for ramping out.
    """
    limits = files.limits
    if limits.axes:
        kind = f"axis corrections, AXISCORR +-{files.axis_clamp_deg:g} deg"
    else:
        kind = f"Cartesian corrections in BASE, POSCORR +-{files.clamp_mm:g} mm and {files.clamp_deg:g} deg"
    missing = f"\nNot here, must be on the controller: {', '.join(elsewhere)}\n" if elsewhere else ""
    return f"""KUKA RSI set-up of the cell {cell}

THE CONTEXT WAS NOT TRIED ON A CONTROLLER. Its form is that of published contexts for RSI 3 on KR C4.
Try it in air, override 10 %, a hand on the emergency stop, before anything is cut.

Sends {kind}.
The loop's own limits: {limits.correction_mm:g} mm, {limits.correction_deg:g} deg, fault at {limits.hard_factor:g} \
times that.
Telegrams go to {files.host}, UDP port {files.port}, every {limits.period_ms} ms; answers carry Type="{files.sentype}".

FILES
  {files.ethernet_name}, {files.context_name}
      to C:\\KRC\\ROBOTER\\Config\\User\\Common\\SensorInterface
  {", ".join(programs)}
      to KRC:\\R1\\Program; start {main}
{missing}
CHECK ON THE CONTROLLER, IN THIS ORDER
 1. The version of RSI. RSI 3 takes .rsi.xml; RSI 4.1 and later take .rsix, with other indices: draw the context again
    in the editor of that version after the list of objects below, and judge it with counterflex rsi check --context.
 2. Editors keep a context in three files (.rsi, .rsi.xml, .rsi.diagram). Only the one that the controller reads is
    here. If RSI_CREATE asks for the .rsi, draw the context in RSIVisual and export all three.
 3. RSI_CREATE succeeds. "Invalid index" means that context and ETHERNET file do not belong together.
 4. RSI_SETPUBLICPAR succeeds. Some versions allow it for parameters that are marked public only. The context has
    the same limits: the lines may be taken out.
 5. The address of the controller's RSI interface lies in the network of {files.host}, no other device does.
 6. Standing still, `counterflex run` without --arm: telegrams every {limits.period_ms} ms, Delay stays 0.
 7. STOP: its Mode 1 (PathNormal) stops a LIN motion when Stop becomes 1. In one published report a STOP object made
    the controller ignore every correction: measure with a dial gauge that a correction of 0.5 mm moves the tool.
 8. Sign and axes: +0.5 mm in each of X, Y, Z of BASE moves the tool that way. RefCorrSys is Base.
 9. Corrections act on the LIN and CIRC motions of this program. No public source shows it for this context.
10. The speed stays when RSI is switched on: MAP2OV_PRO writes $OV_PRO in every cycle, and before the first answer
    the value may be 0.
11. Feed hold: $SEN_PREA[{FEED_HOLD_INDEX}] = 1 stops the path by interrupt 21 (BRAKE), 0 lets it go on. Is interrupt
    21 free? May an interrupt compare $SEN_PREA? Does the correction stay while the path stands?
12. Enable: $SEN_PREA[{ENABLE_INDEX}] arrives as Enable in the telegrams. Are both $SEN_PREA free? The parameter
    number of the SEN_PREA object was taken from its sister SEN_PINT.
13. Behind the path the program waits {ramp_s:.1f} s for the correction to ramp out. The tool must be clear of the part
    there. If the correction stands still while no motion runs, ramp out on a retract motion instead.
14. Timeout is {files.timeout} cycles. Whether late answers are counted back is not published: watch Delay for an hour.
15. The correction's limit: send {"0.1 deg" if limits.axes else "0.1 mm"} more than it and see Stat rise above 1.

OBJECTS
  ETHERNET      ConfigFile {files.ethernet_name}, Timeout {files.timeout}, Precision {files.precision}
                inputs: 1 Stat of {"AXISCORR" if limits.axes else "POSCORR"}, 2 SEN_PREA
  {"AXISCORR      inputs 1..6 from outputs 1..6 of ETHERNET" if limits.axes else ""}\
{"" if limits.axes else "POSCORR       inputs 1..6 from outputs 1..6 of ETHERNET, RefCorrSys Base"}
  {"AXISCORRMON" if limits.axes else "POSCORRMON"}    above those limits by a fifth
  STOP          input 1 from output 7, Mode PathNormal
  MAP2SEN_PREA  input 1 from output 8, Index {FEED_HOLD_INDEX}
  MAP2OV_PRO    input 1 from output 9
  SEN_PREA      Index {ENABLE_INDEX}
"""
