"""All texts of the studio: a translation replaces this module alone."""

from __future__ import annotations

from typing import Final

CLOSED: Final = "Open the link that counterflex studio has printed: it holds the key."
STEPS: Final = {
    "cell": "1 Cell",
    "measure": "2 Measure, identify",
    "program": "3 Program",
    "plan": "4 Check, plan, prove",
    "inspect": "5 Inspect, correct",
    "run": "6 Run",
}
INTRO: Final = {
    "cell": "Which robot holds which tool, and where the part stands. All of it is in one text file.",
    "measure": "Measure what is not known: go to the poses, type the readings or drop the file, identify.",
    "program": "The path as the robot will run it. Select a line or a point; drag the slider along the time.",
    "plan": "Check the program, choose how the robot holds the tool, compensate, and prove it on a simulated cell.",
    "inspect": "Drop the scan of the finished part, judge it, and write the program of the next part.",
    "run": "The compensated program runs on the controller as it is. Correction while milling is a step further.",
}
CELL, PROGRAM, PLAN = "Cell file", "Program", "Plan"
DARK: Final = "Light or dark"
HELP_COMMAND: Final = "The command that does the same; it is run in the folder of the project"
COPIED, CANCEL, RESUME, UPLOAD = "Copied", "Cancel", "Run again", "Drop a file here, or click +"
COMMANDS: Final = "Commands"
NO_COMMANDS: Final = "No command has run yet."
STATES: Final = {
    "waiting": "waiting",
    "running": "running",
    "done": "done",
    "checked": "done: a check failed",
    "failed": "failed",
    "cancelled": "cancelled",
    "interrupted": "interrupted",
}
INTERRUPTED: Final = "interrupted with the studio: the same command goes on, or begins anew"
ALREADY: Final = "There is a file {name} already: give another name."
NO_NAME: Final = "Give a plain file name that ends in {ending}."
NOT_TAKEN: Final = "{name} cannot be kept: {fault}"
NOT_SHOWN: Final = "A file of the folder cannot be shown: {fault}"
OUTSIDE: Final = "This file is not in the folder of the project."
TOO_LARGE: Final = "The file has more than {limit} MB."

NEW_CELL: Final = "New cell"
NEW_CELL_HELP: Final = "Robot of the catalogue, with an example spindle, tool, part and programs"
ROBOT, FILE_NAME, MAKE_CELL = "Robot", "File name", "Write the cell"
ROBOT_OPTION: Final = "{model}: {reach} mm, {payload} kg"
SET, FILE, UNKNOWN = "Choose", "File", "Not known"
INCOMPLETE: Final = " (state kr_over_kc, ka_over_kc)"
MATERIAL, AS_IN_FILE = "Material", "as in the file ({name})"
TOOL, DIAMETER, FLUTES, OVERHANG = "Tool", "Diameter, mm", "Flutes", "Overhang, mm"
PART: Final = "Place of the part in the robot base, mm and deg"
CHANGED: Final = "the file has changed since it was read; nothing is overwritten"
CHANGED_HINT: Final = "Copy the text if you need it, then press Read again"
SAVE, REVERT, UNSAVED = "Save", "Read again", "Not saved yet"
CELL_OK: Final = "The file can be used."
AT_LINE: Final = "Line {line}: {text}"
UNKNOWN_OF: Final = "What is not known, by the error it leaves uncorrected {where}"
UNKNOWN_COLUMNS: Final = ("unknown", "known from", "leaves, mm", "9 of 10 cells, mm", "measure by")
NOT_AT_REST: Final = "in motion only"
MEASURE: Final = "Measure"
PUSHED: Final = (
    "Under 100 N the tool tip deflects by {0:.0f} um along x, {1:.0f} y, {2:.0f} z, at most {3:.0f} um. {more}"
)
PUSHED_SHARE: Final = "{share:.0f} % of that is {segment}. Blue: 2000 times larger."

RECIPE, COUNT, PROPOSE = "What to identify", "Measurements", "Propose poses"
FORM_FOLDER, READINGS = "Form", "readings"
SOURCES: Final = {"typed": "Type the readings", "file": "File of the instrument"}
TYPED_HELP: Final = "Select a row: the robot stands at its pose. Paste blocks from a spreadsheet; each entry is saved."
MEASURED_FILE_HELP: Final = "CSV, Parquet, LVM, TDMS or MAT, as the instrument wrote it; the file is not changed."
FORM: Final = {"row": "no.", "pose": "axes, deg"}
NO_FORM: Final = "{folder} has no form for such data: write a manifest for them, and identify at the prompt."
WILL_FIND: Final = "Determines {count} parameters: standard deviations to expect"
EXPECTED_COLUMNS: Final = ("parameter", "standard deviation", "unit")
SPREAD: Final = "Std. deviation of {channel}, {unit}"
ROW_TODO: Final = "not measured yet"
ROW_NO_NUMBER: Final = "{column}: '{text}' is no number"
ROW_INCOMPLETE: Final = "missing: {columns}"
ROW_UNIT: Final = "{size} {unit}, the others about {usual}: wrong unit?"
ROW_TWICE: Final = "the same reading as no. {row}"
ROW_OUTLIER: Final = "outlier: {size:.1f} standard deviations off"
ROWS_WRONG: Final = "Correct the marked rows first."
COMPLETE: Final = "{done} of {count} readings are complete; only these are used."
ROWS_READ: Final = "{count} rows in {name}."
LINES_ODD: Final = " Look at lines {lines}."
JUDGED: Final = "By the recipe: {count} outliers."
SO_FAR: Final = "{text}: {value} {unit}{before}"
SO_FAR_BEFORE: Final = " ({value} with the former values)"
FORM_CHANGED: Final = "the form was changed by another program; nothing is overwritten"
FORM_CHANGED_HINT: Final = "Open the page anew to read it"
NOTHING_MAPPED: Final = "no column of the file is chosen for any quantity"
NO_COLUMNS: Final = "no column of numbers is found in the file"
KIND, GROUP, MORE_CHANNELS = "Kind of data", "Repeats, or one motion: equal in", "Add a quantity"
NO_COLUMN, UNIT, SIGMA, ROTATION = "none", "unit", "std. deviation", "rotation"
IDENTIFY: Final = "Identify"
IDENTIFIED: Final = {"better": "{folder}: new values", "confirmed": "{folder}: the cell file is confirmed"}
PARAMETER_COLUMNS: Final = ("parameter", "value", "95 %", "unit", "before", "by the data")
ALL_PARAMETERS: Final = "All {count} parameters"
INTERVAL: Final = "{low} to {high}"
TAKE_CELL: Final = "Go on with {cell}"
NEXT_UNKNOWN: Final = "What to measure next"
LEAVES: Final = " leaves {leaves:.2f} mm"
_CHANNELS: Final = {
    "p_tracker_target": "position",
    "R_tracker_target": "orientation",
    "w_sensor": "sensor",
    "f_tcp_base": "force",
    "d_tcp_base": "displacement",
    "temperature_c": "temperature",
    "f_tcp_holder": "force",
    "p_holder_load": "place of the force",
    "p_base_fiducial": "known place",
    "p_tracker_fiducial": "measured place",
}


def channel(name: str) -> str:
    """Short name of a quantity of measurements."""
    return _CHANNELS.get(name, name)


PLAN_COLOUR: Final = "Colour"
CHANNELS: Final = {
    "height": ("Height", "mm"),
    "feed": ("Feed", "mm/min"),
    "force": ("Force", "N"),
    "deflection": ("Deflection", "um"),
    "correction": ("Correction", "um"),
    "before": ("Predicted error before", "um"),
    "after": ("Predicted error after", "um"),
}
OTHER_CELL: Final = (
    "made with another cell file, or with this one before it was changed: plan again to see it on this cell"
)
NO_PLAN: Final = "without a plan"
NOT_REACHED: Final = "The robot does not move: {fault}"
NOT_CUT: Final = "The stock is not cut: {fault}"
THINNED: Final = "{shown} of {points} points are drawn."
SUMMARY: Final = "{language}, {lines} lines, {length:.0f} mm in {seconds:.0f} s, tools {tools}"
SCENE: Final = {
    "empty": "Nothing to show yet.",
    "play": "Play",
    "pause": "Pause",
    "near": "Part",
    "far": "Cell",
    "line": "line",
    "time": "s",
    "slider": "Time along the program",
    "most": "One scale before and after; here at most",
}

CHECK, CHECK_HELP = "Check the program", "Reach, joints, collisions, speeds, process: {counts}"
CHECK_COLUMNS: Final = ("check", "verdict", "value", "limit", "place", "")
ALL_ROWS: Final = "Show all {count} checks"
POSTURE: Final = "Choose the posture"
POSTURE_HELP: Final = "Arm configuration and rotation about the tool with the least deflection; a new cell file"
PLACE: Final = "Choose the place of the part"
PLACE_HELP: Final = "Where the arm is stiff and reaches everything; a new cell file"
STRATEGY: Final = "Choose how to finish the wall"
STRATEGY_HELP: Final = (
    "Up- or down-milling, widths, depths, feeds per tooth, spindle speeds (G-code that finishes a wall)"
)
FEED: Final = "Keep the programmed feed (else it is lowered where a limit asks for it)"
CHOICES: Final = "Choices side by side"
CHOICES_HELP: Final = (
    "Expected error in mm, median and nine of ten such cells. Posture, place and strategy: before compensation; "
    "only errors of the same quantity compare."
)
CHOICE_COLUMNS: Final = ("choice", "of", "now, mm", "then, mm", "less", "with", "")
OF_DEFLECTION, OF_WALL, OF_PATH = "deflection", "error normal to the wall", "path error, compensated"
OF_MODEL: Final = "{of}, model without its unknowns"
TURNED: Final = "{branch}, turned to {turn:.0f} deg"
CUT: Final = "{milling}-milling, ae {ae_mm:g} mm, ap {ap_mm:g} mm, fz {fz_mm:g} mm, {spindle_rpm:.0f} rpm"
TAKES_S: Final = "{seconds:.0f} s"
TAKE: Final = "Take this cell"
ASSUME: Final = "Axes of unknown stiffness: take the median of the robot's class (marked in all results)"
ASSUMED: Final = "Stiffness of axes is assumed, not measured: {source}"
COMPENSATE: Final = "Compensate"
LANGUAGES: Final = "Languages of the output"
PROVE: Final = "Prove"
PROVE_HELP: Final = "Machines the part before and after on a simulated cell that differs from the cell file"
BEFORE, AFTER = "before", "after"
EXPECTED: Final = "Expected path error, mm (median; nine of ten such cells)"
PROVED: Final = "Path error on the simulated cell, mm (99.7 % of the cut)"
WARNINGS: Final = "Warnings: {count}"
WITHIN: Final = {True: "yes", False: "no", None: "not decided"}
WORSE: Final = "Probability that compensation makes it worse: {percent:.0f} %"
REPORT: Final = "Open the report"
NO_RESULTS: Final = "Nothing yet: compensate the program."

SCAN, SCAN_HELP = "Scan of the part", "PLY, STL, OBJ, E57, LAS, PCD, PTX or a table of points"
INSPECT, CORRECT = "Inspect", "Correct the next part"
MADE_BY: Final = "Made by the plan"
SCAN_OF_EARLIER: Final = "This scan shows an earlier part: inspect the part that was made by this plan."
MEASURED_BY: Final = "Measured in"
ACCEPT: Final = "This is the plan of the next part"
HISTORY: Final = "Parts of this program: deviation in mm"
HISTORY_COLUMNS: Final = ("part", "scan", "surface, 99.7 %", "path, rms", "changed against the part before")
EXPECTED_PART: Final = "expected of the next part"
FEATURE_COLUMNS: Final = ("feature", "quantity", "measured (nominal), mm", "tolerance, mm", "verdict")
NOT_FOUND: Final = "not found"
CORRECTED: Final = "Deviation of the surface, mm (99.7 %): this part, and expected of the next (5 to 95 %)"
CORRECT_HELP: Final = "Takes back what repeats of the measured deviations; its folder is the plan of the next part"
NEEDS: Final = "Still missing: {what}"

PANEL_STEPS: Final = (
    ("Load the program", "Copy the files of the plan to the controller. The report lists what must be set there."),
    ("Correct while milling", "Start the loop before the program; without --arm it only watches."),
    ("Watch it", "Open the operator panel in another terminal; it prints the link for this browser."),
)
NOT_AN_E_STOP: Final = "Neither studio nor panel is an emergency stop: use that of the robot."
