"""The table of hazards: every check of a preflight, what it compares, and the keys of the cell file that it needs.

This table is the only list: a preflight has one row for each of its entries, in this order, and docs/preflight.md
prints it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from counterflex.plan.preflight.row import NOT_LOOKED_AT, Row


@dataclass(frozen=True)
class Hazard:
    """One thing that can go wrong."""

    check: str  # name of the row
    value: str  # what is compared
    limit: str  # with what
    keys: tuple[str, ...]  # keys of the cell file that are read; without those marked `!` the hazard is not looked at
    beyond: str  # verdict beyond the limit

    @property
    def read(self) -> tuple[str, ...]:
        """Keys without their marks."""
        return tuple(key.rstrip("!") for key in self.keys)

    @property
    def needed(self) -> tuple[str, ...]:
        """Keys without which the hazard is not looked at."""
        return tuple(key[:-1] for key in self.keys if key.endswith("!"))


_RATES: Final = ("limits.joint_speed_deg_s!", "limits.joint_acceleration_deg_s2!")
_BODIES: Final = ("limits.clearance_mm", "cell.body", "tools.overhang_mm", "part.stock")

HAZARDS: Final = (
    Hazard("reach", "reserve of the wrist centre before the arm is stretched or folded",
           "0; scaled smallest singular value 0.005", ("robot", "part"), "fail"),
    Hazard("joint limits", "smallest distance of an axis to its limit", "`limits.joint_margin_deg`",
           ("limits.joint_margin_deg",), "fail"),
    Hazard("axis 3 against the upper arm",
           "angle between the arms, where the controller counts axis 3 from the horizontal",
           "the key; one of the joint limits", ("robot.controller_axes.axis_3_to_upper_arm_deg!",), "fail"),
    Hazard("wrist singularity", "smallest angle between axes 4 and 6", "`limits.wrist_singularity_deg`",
           ("limits.wrist_singularity_deg",), "fail"),
    Hazard("motions by axes",
           "PTP, MoveJ, J, movej between lines: swung in joint space; where they lead, the branch of the arm",
           "that of `[posture]`", ("posture",), "warning; not looked at before the first target and behind the last"),
    Hazard("posture of the program", "targets of a robot program whose posture (S, robconf, CONFIG, config) is another "
           "than that of `[posture]`, in which reach, axes and bodies are checked", "0",
           ("posture.shoulder", "posture.elbow", "posture.wrist"), "fail; not looked at where no target states one"),
    Hazard("joint speed at feed", "axis nearest to its limit", "the key, or the catalogue", (_RATES[0],), "fail"),
    Hazard("joint speed in rapids", "axis nearest to its limit", "the key, or the catalogue",
           (_RATES[0], "controller.rapid_mm_s"), "warning: the controller slows down or stops"),
    Hazard("joint acceleration at feed", "axis nearest to its limit", "the key, or the catalogue", (_RATES[1],),
           "warning: the controller slows down"),
    Hazard("path speed held", "lowest path speed in the cut, and share of the cut below the programmed one",
           "5 % of the cutting path", ("controller.acceleration_mm_s2", "controller.blending_mm",
                                       "limits.orientation_speed_deg_s"), "warning"),
    Hazard("cable wind-up, axis 4", "largest angle from 0 deg, where cables lie straight", "the key",
           ("limits.cable_axis4_deg!",), "fail"),
    Hazard("cable wind-up, axis 6", "largest angle from 0 deg, where cables lie straight", "the key",
           ("limits.cable_axis6_deg!",), "fail"),
    Hazard("robot and spindle to surroundings",
           "smallest distance of bodies; of the stock, what is not machined away yet", "`limits.clearance_mm`", _BODIES,
           "warning; fail on contact"),
    Hazard("tool to surroundings", "likewise, without the stock, which it cuts",
           "0; 1 mm in rapids, from the bodies of `cell.body`", _BODIES[1:],
           "warning; fail deeper than 1 mm: a cut through the part goes a little into its support"),
    Hazard("tool holder to stock and surroundings",
           "distance of the tool's holder contour to the machined stock and the surroundings", "0",
           ("tools.holder_mm!", "cell.body"), "fail"),
    Hazard("spindle to arm", "what the flange carries, to foot, column, link arm, elbow, forearm",
           "`limits.clearance_mm`", ("limits.clearance_mm", "cell.body"), "warning; fail on contact"),
    Hazard("first motion",
           "height over the blank until X, Y and Z are named: the way there is not known",
           "0; not in the blank", ("part.stock",), "fail in the blank; warning beside it below its top"),
    Hazard("rapids into the stock", "volume that the worst rapid removes", "0", ("part.stock",), "fail"),
    Hazard("external axes", "height of the tool over the blank while an external axis moves; its travel",
           "0; the limits of the axis", ("external_axes", "part.stock"), "fail"),
    Hazard("tool change", "height of the tool over the blank at a tool change", "0", ("part.stock",),
           "fail in the blank"),
    Hazard("end of the program", "height of the tool over the blank at the end", "0; spindle stopped",
           ("part.stock",), "fail in the cut; warning without a retract, or with the spindle on"),
    Hazard("tool length offset", "number of the offset (H) at feed", "that of the tool", ("tools.number",), "warning"),
    Hazard("work offset", "work offsets (G54 ...) in use", "those whose place is known: G54, G10, `--parameters`", (),
           "not looked at"),
    Hazard("tool of the program", "diameter of each tool that a comment of the program names",
           "that of the tool, to 2 %", ("tools.diameter_mm",), "warning; not looked at where no comment names it"),
    Hazard("words with two readings", "block delete, long dwells, zeros that controllers read in two ways",
           "none", (), "not looked at: the reading that was checked"),
    Hazard("removed material", "volume that each tool removes at feed", "more than 0", ("part.stock", "tools"),
           "warning"),
    Hazard("spindle in the cut", "cuts with the spindle off, reversed (M4), or stopped before the retract", "none",
           ("tools.spindle_rpm",), "fail"),
    Hazard("spindle run-up", "shortest time from a change of the spindle speed to the next cut; a wait for a person is "
           "long enough", "the key", ("process_limits.spindle_run_up_s!",), "warning"),
    Hazard("standing in the cut", "longest dwell of the tool in the material, or a wait for a person or signal there",
           "1 s", ("part.stock",), "warning"),
    Hazard("spindle speed", "highest and lowest speed", "the keys",
           ("process_limits.spindle_min_rpm", "process_limits.spindle_max_rpm!", "tools.max_rpm"),
           "fail above; warning below"),
    Hazard("spindle torque", "largest mean torque of a tooth period", "the key, at its speed",
           ("process_limits.spindle_torque_nm!", "process_limits.spindle_torque_curve_rpm_nm"), "fail"),
    Hazard("spindle power", "largest mean power", "the key", ("process_limits.spindle_power_w!",), "fail"),
    Hazard("cutting force", "largest mean force on the tool", "the key", ("process_limits.force_n!",), "fail"),
    Hazard("torque of the axes", "cutting torque on the axis nearest to its limit", "the key",
           ("process_limits.axis_torque_nm!",), "fail"),
    Hazard("tool bending", "bending of the tool at its tip under the mean force", "the key",
           ("process_limits.tool_bending_um!", "tools.overhang_mm!", "tools.modulus_gpa"), "warning"),
    Hazard("deflection", "deflection square to the path under the mean force", "the key",
           ("process_limits.deflection_um!",), "warning"),
    Hazard("correction", "correction that the deflection asks for", "the keys",
           ("limits.correction_mm", "limits.correction_deg"), "warning: compensate refuses"),
    Hazard("acceleration on arcs", "acceleration of the tool on arcs at feed", "the key",
           ("process_limits.acceleration_mm_s2!",), "warning"),
    Hazard("depth of cut to flutes",
           "least depth of the removed volume, or the engaged one over 3 columns of the stock", "the key + 5 %",
           ("tools.flute_length_mm",), "fail: above the flutes the shank rubs"),
    Hazard("feed per tooth", "largest and smallest feed per tooth in the cut",
           "the key; without it assumed 5 um to 2.5 % of the diameter", ("tools.feed_per_tooth_mm",),
           "fail above the key; warning below it, and where it is assumed"),
    Hazard("cutting speed", "largest and smallest cutting speed at the diameter", "the key",
           ("tools.cutting_speed_m_min!",), "warning"),
    Hazard("broken tooth in the force signal",
           "spindle slips (0 to 0.8 %) at which the lines of a broken tooth fold on the tooth passing or on 0 Hz",
           "none", ("monitor!",),
           "not looked at from half of them on, else a warning; with the nearest speed that shows it"),
    Hazard("chip thickness",
           "share of the force that is uncertain: mean chips outside the range of the cutting constants", "50 %",
           ("material.chip_min_um", "material.chip_max_um", "material.allow_extrapolation"),
           "warning: compensate refuses"),
    Hazard("plunging", "steepest descent into material under the centre of the mill",
           "`tools.ramp_deg` (10 deg) for a mill that does not cut at its centre",
           ("tools.centre_cutting!", "tools.ramp_deg"), "fail"),
    Hazard("coolant", "cuts with coolant on and off", "the key", ("tools.coolant!",), "warning"),
    Hazard("reversals in the cut", "largest lost motion at the tool where an axis turns round in the cut",
           "`limits.reversal_error_um`", ("robot.play!", "limits.reversal_error_um"), "warning"),
    Hazard("unloadings in the cut", "likewise where the torque of a drive changes its sign",
           "`limits.reversal_error_um`", ("robot.play!", "limits.reversal_error_um"), "warning"),
    Hazard("block time at feed", "time of the shortest block at its feed",
           "`controller.least_block_ms`, else `cycle_ms`",
           ("controller.least_block_ms", "controller.cycle_ms"), "warning"),
    Hazard("look-ahead", "smallest share of the feed that the controller can hold", "100 %",
           ("controller.look_ahead_blocks!",), "warning"),
    Hazard("approximation to points", "half of the shorter block beside a corner",
           "distance at which its rounding begins: that of the program, else the key", ("controller.blending_mm",),
           "warning: the controller shortens it and slows down"),
    Hazard("corner error of the approximation", "how far a rounding passes its corner", "the key",
           ("limits.corner_error_um!",), "warning"),
    Hazard("program size", "motions", "those of one file of the language", ("controller.spindle",),
           "warning; ok where the writer divides it"),
    Hazard("program name", "characters", "those of the language", ("controller.spindle",), "warning"),
    Hazard("line length", "characters of a program that is run as it stands", "those of the language", (), "warning"),
    Hazard("language of the controller", "maker of the program's language", "maker of the robot",
           ("robot.controller_axes",), "warning"),
)  # fmt: skip


def complete(rows: Iterable[Row], reasons: dict[str, str]) -> tuple[Row, ...]:
    """One row for each hazard, in the order of the table.

    Args:
        rows: Of the checks that were made; every check is one of the table.
        reasons: Why hazards without a row were not looked at, by check; ``""`` is the reason of all others.

    Raises:
        KeyError: A row of a check that is not in the table.
    """
    given_rows = {hazard.check: list[Row]() for hazard in HAZARDS}
    for row in rows:
        given_rows[row.check].append(row)
    out: list[Row] = []
    for check, given in given_rows.items():
        out += given or [Row(check, NOT_LOOKED_AT, what=reasons.get(check, reasons.get("", "")))]
    return tuple(out)
