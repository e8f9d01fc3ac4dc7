"""Next steps after a result: what to load on the controller, and the commands that follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from counterflex.app.robot_axes import part_in_world, pose_text
from counterflex.core.next_command import next_command
from counterflex.core.units import MM
from counterflex.evaluate.features import FeatureRow
from counterflex.files.cell.cell import Cell
from counterflex.programs.language import LANGUAGES, dialect_at, is_robot, object_at
from counterflex.report.data import Fact

_ENOUGH: Final = 0.8
"""Share of the error that an unmeasured cell can be expected to lose; below it measuring comes first."""
_MOST: Final = 6  # Features out of tolerance that are listed one by one
_PLACES: Final = {
    "entry": "where the cutter enters the material",
    "plateau": "between entry and exit",
    "exit": "where it leaves the material",
}


def to_load(summary: Mapping[str, Any], cell: Cell, tools: Sequence[int]) -> tuple[Fact, ...]:
    """Files of a compensated program and what the controller must have set for them.

    Args:
        summary: Of the job ``compensate``.
    """
    files, dialect = ", ".join(summary["files"]), dialect_at(summary["language"], "write")
    load = LANGUAGES[dialect].load
    if load is not None:
        facts: tuple[Fact, ...] = object_at(load)(files, cell, tools)
        return facts
    if cell.T_base_tcp is not None:
        return against_fixed_tool(files, cell)
    frame = part_in_world(cell, dialect) if is_robot(dialect) else cell.T_base_part
    words = "mm, deg about z, y', x''"
    return (
        Fact("Load", files, "", "in place of the original, under the same name"),
        Fact("Part frame", pose_text(frame), words, "program zero in the robot's base, as planned"),
        Fact("Tool", pose_text(cell.controller_chain.T_flange_tcp), words, "tip in the flange, as planned"),
    )


def against_fixed_tool(
    files: str, cell: Cell, names: tuple[str, str] = ("Tool that stands", "Part in the flange"), remark: str = ""
) -> tuple[Fact, ...]:
    """Return what must be set where the robot holds the part against a spindle that stands.

    Args:
        names: What the controller calls the frame of the tool, and that of the part.
    """
    T_base_tcp = cell.T_base_tcp
    assert T_base_tcp is not None, "the robot holds the tool"
    return (
        Fact("Load", files, "", remark),
        Fact(names[0], pose_text(T_base_tcp), "mm, deg", "the spindle's tool frame in the robot's base (external "
             "tool)"),
        Fact(names[1], pose_text(cell.controller_chain.T_flange_tcp), "mm, deg", "the part frame in the flange, as "
             "planned"),
    )  # fmt: skip


def tool_frames(
    cell: Cell, language: str, tools: Sequence[int], *, frame: str, other: str = "", form: str = "{}"
) -> list[Fact]:
    """Return the tool frames that a robot program uses by name: of the tools that have one, else of another one.

    Args:
        frame: The frame as the controller shows it.
        other: Name of the frame where a tool has none; empty where there is none.
    """
    named = cell.machine_functions(language).tool_data
    names = {number: form.format(named[number]) for number in named}
    own = [(names.get(number, other), number) for number in tools]
    if len(tools) > 1:
        what = "its tip, measured on this robot; lengths differ from tool to tool, the direction does not"
        return [Fact(name, f"T{number}", "", what) for name, number in own if name]
    return [Fact(name, frame, "mm, deg", f"T{number} as it was planned with") for name, number in own if name]


def proving(cell: Cell, program: str | Path) -> str:
    """Return the command that proves a compensation of a program on the simulated cell."""
    return next_command("prove", program, cell=cell.path, assume_class=cell.class_stiffness is not None, out="proof")


def after_compensation(summary: Mapping[str, Any], cell: Cell, program: str | Path) -> tuple[str, ...]:
    """Return what comes after a plan, in order.

    Args:
        summary: Of the job ``compensate``.
    """
    prediction = summary["prediction"]
    steps = [
        f"Mend line {item['line']} of the program: a rapid move removes {item['volume_mm3']:.1f} mm³ of material."
        for item in prediction["collisions"]
    ]
    if not cell.tables.identified:
        steps.append(
            f"Measure the cell: {next_command('cell check', cell.path)} ranks what to measure first. Stiffness and "
            "cutting constants are not measured; they make the range of the expected error."
        )
    steps.append(f"Try the program on the simulated cell before you cut metal: {proving(cell, program)}")
    if "predicted_compensated" in prediction:
        after, before = prediction["predicted_compensated"], prediction["predicted_nominal"]
        chatters = prediction["chatter"]
        if chatters:
            lines = ", ".join(str(item["line"]) for item in chatters[:_MOST])
            steps.insert(
                len(prediction["collisions"]),
                f"Cut line {lines} less deep (pecks: G83), at another feed or spindle speed or with a stiffer tool: "
                "the tool is predicted to chatter there, which no correction mends.",
            )
        elif after["max_mm"] > (1.0 - _ENOUGH) * before["max_mm"]:
            steps.append(
                f"Lower the feed where the force changes faster than the robot follows (up to {after['max_mm']:.3f} mm "
                f"remain there by the model): {_slower(program, cell.path, 500.0 * after['max_mm'])}"
            )
    steps.append("Run the program above the part first, at reduced speed, with the tool that was planned with.")
    steps.append(
        "Correct during milling what cannot be planned for: counterflex run"
        if cell.tables.online is not None
        else "Correct during milling what cannot be planned for: add [online] to the cell file, then counterflex run."
    )
    return tuple(steps)


def _slower(program: object, cell: object, tolerance_um: float) -> str:
    """Return the command that lowers the feed where the predicted error is above a tolerance."""
    wish = f"compensation.feed_for_tolerance_um={tolerance_um:.0f}"
    return next_command("compensate", program, cell=cell, out="slower", scenario=wish)


def out_of_tolerance(rows: Sequence[FeatureRow], variant: str) -> list[FeatureRow]:
    """Measured quantities of a variant that miss their tolerance, or that were not found."""
    return [row for row in rows if variant not in row.worst_m or not row.ok(variant)]


def after_proof(rows: Sequence[FeatureRow], summary: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what comes after a part was machined before and after on the simulated cell, in order."""
    steps = []
    missed = out_of_tolerance(rows, "compensated")
    for row in missed[:_MOST]:
        if "compensated" in row.worst_m:
            left, allowed = row.material_left_m("compensated") / MM, f"{row.tolerance_m / MM:g} mm allowed"
            steps.append(f"Mend {row.feature}, {row.quantity}: {left:+.3f} mm off (+ = material left), {allowed}.")
        else:
            steps.append(f"Look at {row.feature}, {row.quantity}: not found on the compensated part.")
    if len(missed) > _MOST:
        steps.append(f"See the table of features for {len(missed) - _MOST} more that are out of tolerance.")
    variants = summary["variants"]
    path = variants["compensated"]["path"]
    part = max(_PLACES, key=lambda name: variants["compensated"].get(name, {}).get("max_mm", 0.0))
    where = f"the largest error that remains, {path['max_mm']:.3f} mm, is {_PLACES[part]}"
    steps.append(
        f"Lower the feed there, {where}: {_slower('PROGRAM', 'CELL', 50.0)}"
        if part != "plateau"
        else f"Measure the cell, counterflex identify: {where}, where the constants of the model decide."
    )
    steps.append(
        "Plan your own program, with your robot in the cell file: "
        + next_command("compensate", "PROGRAM", cell="CELL", out="DIR")
    )
    steps.append("Correct during milling what cannot be planned for: counterflex run.")
    return tuple(steps)
