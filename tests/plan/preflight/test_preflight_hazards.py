"""The table of hazards: it is what the manual prints, and every limit of the cell file is read by one of its rows."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from counterflex.app import preflight as job
from counterflex.files.cell.cell import Cell, resolve
from counterflex.files.cell.controller import ControllerTable
from counterflex.files.cell.machine import ProcessLimitsTable
from counterflex.files.cell.planning import LimitsTable
from counterflex.files.cell.tables import CellTables, MaterialTable, ToolTable
from counterflex.files.schema import Table, parse
from counterflex.plan.inputs import CorrectionLimits
from counterflex.plan.preflight.hazards import HAZARDS, complete
from counterflex.plan.preflight.row import Row
from counterflex.plan.process_limits import ProcessLimits

ROOT = Path(__file__).resolve().parents[3]
SMALL = ROOT / "tests" / "data" / "cells" / "small.toml"
READ = {key for hazard in HAZARDS for key in hazard.read}
NO_LIMITS = {
    "tools": {
        "name", "corner_radius_mm", "flutes", "helix_deg", "runout_um",  # what cuts
        "longer_mm", "heavier_kg",  # where its tip is, and what it weighs
        "tool_data", "tooldata",  # names on the controller, read by the readers of robot programs
    },
    "limits": set[str](),
    "process_limits": set[str](),
    "material": {
        name for name in MaterialTable.model_fields if not name.startswith(("chip_", "allow_"))
    },  # constants of the law
    "controller": {
        "tool_number", "base_number", "work_object", "robot_in_world",  # read by the readers of robot programs
        "rsi_version", "kss_version", "correction_output", "correction_signal", "armed_signal",  # of online correction
    },
}  # fmt: skip
"""Keys that limit nothing a program does."""
TABLES: dict[str, type[Table]] = {
    "tools": ToolTable, "limits": LimitsTable, "process_limits": ProcessLimitsTable, "material": MaterialTable,
    "controller": ControllerTable,
}  # fmt: skip
OF_PROCESS = {
    "spindle_min_rad_s": "process_limits.spindle_min_rpm", "spindle_max_rad_s": "process_limits.spindle_max_rpm",
    "power_w": "process_limits.spindle_power_w", "torque_nm": "process_limits.spindle_torque_nm",
    "torque_by_speed": "process_limits.spindle_torque_curve_rpm_nm", "force_n": "process_limits.force_n",
    "axis_torque_nm": "process_limits.axis_torque_nm", "bending_m": "process_limits.tool_bending_um",
    "overhang_m": "tools.overhang_mm", "modulus_pa": "tools.modulus_gpa",
    "deflection_m": "process_limits.deflection_um", "acceleration_m_s2": "process_limits.acceleration_mm_s2",
    "run_up_s": "process_limits.spindle_run_up_s",
}  # fmt: skip
"""What strategy and feed limiter read, by the key that it comes from."""
OF_PLAN = {
    "correction_m": "limits.correction_mm", "rotation_rad": "limits.correction_deg",
    "joint_margin_rad": "limits.joint_margin_deg", "wrist_rad": "limits.wrist_singularity_deg",
}  # fmt: skip
"""What the planner reads."""

HEAD = "G17 G54 G40 G49 G80 G90 G94\nG21\nM6 T1\nG43 H1\nM3 S13000\nG0 Z60\n"
PROGRAM = (
    HEAD + "G0 X-12 Y15\nG0 Z42\nG1 Z36 F3000\nG1 X20 F1500\nG1 X20.306\nG1 X23 Z35\nG2 X23 Y15 I2 J0\n"
    "G1 Y19\nG1 X6\nG1 Y45\nG0 Z60\nG0 X-12 Y24\nG0 Z42\nG1 Z37 F3000\nG1 X52 F1500\nG0 Z60\nG0 X-12 Y6\n"
    "G0 Z42\nG1 Z38 F3000\nG1 X52 F1500\nG0 Z60\nM5\nM30\n"
)  # fmt: skip
TIGHT: dict[str, tuple[Any, str]] = {
    "limits.joint_margin_deg": (150, "joint limits"),
    "limits.wrist_singularity_deg": (80, "wrist singularity"),
    "limits.joint_speed_deg_s": ([0.01] * 6, "joint speed at feed"),
    "limits.joint_acceleration_deg_s2": ([0.1] * 6, "joint acceleration at feed"),
    "limits.cable_axis4_deg": (1, "cable wind-up, axis 4"),
    "limits.cable_axis6_deg": (1, "cable wind-up, axis 6"),
    "limits.clearance_mm": (900, "robot and spindle to surroundings"),
    "limits.orientation_speed_deg_s": (0.001, ""),
    "limits.corner_error_um": (1, "corner error of the approximation"),
    "limits.correction_mm": (0.001, "correction"),
    "limits.correction_deg": (0.0001, "correction"),
    "limits.reversal_error_um": (0.01, "reversals in the cut"),
    "process_limits.spindle_min_rpm": (15000, "spindle speed"),
    "process_limits.spindle_max_rpm": (10000, "spindle speed"),
    "process_limits.spindle_power_w": (1, "spindle power"),
    "process_limits.spindle_torque_nm": (0.001, "spindle torque"),
    "process_limits.spindle_torque_curve_rpm_nm": ([[0, 5], [12000, 0.01], [24000, 0.01]], "spindle torque"),
    "process_limits.force_n": (1, "cutting force"),
    "process_limits.axis_torque_nm": ([0.1] * 6, "torque of the axes"),
    "process_limits.tool_bending_um": (0.001, "tool bending"),
    "process_limits.deflection_um": (0.1, "deflection"),
    "process_limits.spindle_run_up_s": (60, "spindle run-up"),
    "process_limits.acceleration_mm_s2": (1, "acceleration on arcs"),
    "tools.flute_length_mm": (2, "depth of cut to flutes"),
    "tools.overhang_mm": (300, "tool bending"),
    "tools.modulus_gpa": (50, "tool bending"),
    "tools.centre_cutting": (False, "plunging"),
    "tools.ramp_deg": (1, "plunging"),
    "tools.feed_per_tooth_mm": ([0.2, 0.3], "feed per tooth"),
    "tools.cutting_speed_m_min": ([10, 20], "cutting speed"),
    "tools.max_rpm": (100, "spindle speed"),
    "tools.coolant": (True, "coolant"),
    "tools.holder_mm": ([[2, 60], [50, 60]], "tool holder to stock and surroundings"),
    "tools.number": (3, ""),
    "tools.diameter_mm": (17, ""),
    "tools.spindle_rpm": (9000, ""),
    "material.chip_min_um": (900, "chip thickness"),
    "material.chip_max_um": (2, "chip thickness"),
    "material.allow_extrapolation": (True, ""),
    "controller.cycle_ms": (900, "block time at feed"),
    "controller.least_block_ms": (900, "block time at feed"),
    "controller.look_ahead_blocks": (1, "look-ahead"),
    "controller.blending_mm": (50, "approximation to points"),
    "controller.acceleration_mm_s2": (10, "path speed held"),
    "controller.rapid_mm_s": (90000, "joint speed in rapids"),
    "controller.spindle": ({}, ""),
}
"""A value of each key that the program above cannot keep, and the row that must say so; no row where the key limits
something only together with the program's language, its turning tool, or another key."""


def cell_with(key: str = "", value: Any = None) -> Cell:
    data = tomllib.loads(SMALL.read_text(encoding="utf-8"))
    data["robot"]["play"] = [{"axis": axis, "dead_band_half_urad": 4.0} for axis in range(1, 7)]
    data["tools"][0] |= {"overhang_mm": 60, "centre_cutting": True}
    data["process_limits"] = {"tool_bending_um": 40}
    data["controller"]["blending_mm"] = 0.1
    if key.startswith("tools."):
        data["tools"][0] |= {"centre_cutting": False} if key == "tools.ramp_deg" else {}
        data["tools"][0][key.removeprefix("tools.")] = value
    elif key:
        table, name = key.split(".")
        data.setdefault(table, {})[name] = value
    return resolve(parse(CellTables, data, where="test"), SMALL)


@pytest.fixture(scope="module")
def verdicts(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., dict[str, str]]:
    file = tmp_path_factory.mktemp("hazards") / "part.ngc"
    file.write_text(PROGRAM)

    def of(key: str = "", value: Any = None) -> dict[str, str]:
        return {row["check"]: row["verdict"] for row in job.check(file, cell_with(key, value)).summary["checks"]}

    return of


def test_the_manual_prints_the_table() -> None:
    text = (ROOT / "docs" / "preflight.md").read_text(encoding="utf-8")
    assert _as_table() in text


def test_a_row_for_every_hazard_in_the_order_of_the_table() -> None:
    rows = complete([Row("spindle power", "ok"), Row("reach", "fail")], {"": "a reason"})
    assert [row.check for row in rows] == [hazard.check for hazard in HAZARDS]
    assert {row.verdict for row in rows[1:] if row.check != "spindle power"} == {"not looked at"}
    with pytest.raises(KeyError):
        complete([Row("not in the table", "ok")], {})


@pytest.mark.parametrize("table", TABLES)
def test_every_key_that_limits_something_is_read_by_a_row(table: str) -> None:
    keys = {f"{table}.{name}" for name in TABLES[table].model_fields if name not in NO_LIMITS[table]}
    assert keys <= READ


def test_what_planner_strategy_and_feed_limiter_read_is_read_by_a_row() -> None:
    assert {field.name for field in fields(ProcessLimits)} == set(OF_PROCESS)
    assert {field.name for field in fields(CorrectionLimits)} == set(OF_PLAN)
    assert {*OF_PROCESS.values(), *OF_PLAN.values()} <= READ


def test_a_tight_value_is_known_for_every_key() -> None:
    of_tables = {key for key in READ if "." in key and key.split(".")[0] in TABLES}
    assert of_tables == set(TIGHT)


@pytest.mark.by_turn
@pytest.mark.parametrize("key", [key for key, (_, check) in TIGHT.items() if check])
def test_a_value_that_is_too_tight_is_said_by_its_row(key: str, verdicts: Callable[..., dict[str, str]]) -> None:
    value, check = TIGHT[key]
    assert verdicts()[check] in ("ok", "not looked at")
    assert verdicts(key, value)[check] in ("warning", "fail")


def _as_table() -> str:
    """The table of hazards as docs/preflight.md prints it, in Markdown."""
    lines = ["| check | value | limit | keys of the cell file | beyond the limit |", "|---|---|---|---|---|"]
    for hazard in HAZARDS:
        keys = ", ".join(f"**`{key[:-1]}`**" if key.endswith("!") else f"`{key}`" for key in hazard.keys)
        lines.append(f"| {hazard.check} | {hazard.value} | {hazard.limit} | {keys} | {hazard.beyond} |")
    return "\n".join(lines) + "\n"
