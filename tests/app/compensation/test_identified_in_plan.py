"""What identification writes into a cell file changes the plan, or the page says that planning has no use for it."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from counterflex.app.compensation.compensate import compensate
from counterflex.app.inputs import setting_of
from counterflex.core.arrays import Float
from counterflex.core.units import UM
from counterflex.files.cell.cell import read_cell
from counterflex.files.cell.tables import CellTables
from counterflex.plan.inputs import solve_joints
from counterflex.plan.plan import Plan
from counterflex.plan.relative_motion import tool_carried
from counterflex.plan.sag_and_play import corrected_joints, residual_sag
from counterflex.robot.elasticity.chain import forward

ProgramFile = Callable[..., Path]
Change = Callable[[dict[str, object]], None]
DATA = Path(__file__).resolve().parents[2] / "data" / "cells"
DOCS = Path("docs/identify.md")


def _set(*path: str | int, value: object) -> Change:
    def change(cell: dict[str, object]) -> None:
        place: object = cell
        for key in path[:-1]:
            place = place.setdefault(key, {}) if isinstance(place, dict) else place[key]  # type: ignore[index]
        place[path[-1]] = value  # type: ignore[index]

    return change


USED: dict[str, Change] = {
    "robot.calibration": _set("robot", "calibration", value=[{"segment": "axis2", "x_mm": 0.4}]),
    "robot.play": _set(
        "robot", "play", value=[{"axis": k, "friction_nm": [120.0], "slip_urad": [40.0]} for k in (1, 2, 3)]
    ),
    "robot.servo": _set(
        "robot",
        "servo",
        value=[
            {"axis": k, "position_gain_per_s": 15, "speed_gain_nm_s": 150000, "integral_time_ms": 60}
            for k in range(1, 7)
        ],
    ),
    "robot.elastic_region": _set(
        "robot",
        "elastic_region",
        value=[
            {"segment": "axis2", "direction": "rz", "axis": 2, "angles_deg": [-180, 30], "factors": [1.6, 1.2]},
            {"segment": "axis1", "direction": "rz", "axis": 1, "angles_deg": [-90, 90], "factors": [1.4, 1.4]},
        ],
    ),
    "robot.compliance_curve": _set(
        "robot",
        "compliance_curve",
        value=[{"segment": "axis1", "direction": "rz", "loads_nm": [-2000, 0, 2000], "factors": [0.6, 1.8, 0.6]}],
    ),
    "compliances": _set("end_effector", 0, "rx_urad_per_knm", value=9000.0),
    "masses": _set("end_effector", 0, "mass_kg", value=110),
    "material": _set("material", "kc11_n_mm2", value=900),
    "drive_error": _set("drive_error", value={"axis1": [[90, 300.0, 0.0]], "axis2": [[120, 0.0, 200.0]]}),
    "dynamics": _set("dynamics", value={"mode_hz": 6.0, "damping_ratio": 0.02}),
}
"""Of each table, a change that the plan of a groove must feel."""
UNUSED = {"tracker", "sensor", "holder", "timing"}
"""Tables for which planning has no use; the loop online and later identifications have."""


def _cell(folder: Path, change: Change | None, name: str = "small.toml") -> Path:
    cell = tomllib.loads((DATA / name).read_text())
    if change is not None:
        change(cell)
    file = folder / f"cell{abs(hash(str(cell)))}.toml"
    file.write_text(tomli_w.dumps(cell))
    return file


@cache
def _base(folder: Path, program: Path) -> Plan:
    return compensate(program, read_cell(_cell(folder, None)), predict=False).plan


@pytest.mark.by_turn
@pytest.mark.parametrize("table", sorted(USED))
def test_what_was_identified_changes_the_plan(table: str, tmp_path: Path, program: ProgramFile) -> None:
    file = program()
    before = _base(tmp_path, file)
    after = compensate(file, read_cell(_cell(tmp_path, USED[table])), predict=False).plan
    assert float(np.max(np.abs(after.correction_part - before.correction_part))) > 2 * UM


def test_the_page_lists_every_identified_table() -> None:
    """Whoever adds a table that recipes write has to say whether planning uses it."""
    text = DOCS.read_text()
    section = text[text.index("## What planning uses") :]
    for table in [*USED, *UNUSED, "axis_sag"]:
        assert f"| `{table}` |" in section or f"| {table} |" in section, table
    written = {"tracker", "sensor", "holder", "timing", "drive_error", "dynamics", "material", "axis_sag"}
    assert written <= set(CellTables.model_fields)
    assert written <= set(USED) | UNUSED | {"axis_sag"}


def _erring(angle: Float, rows: list[list[float]]) -> Float:
    """Angle of a link by the words of docs/cell-file.md."""
    return np.asarray(angle + sum(1e-6 * (s * np.sin(k * angle) + c * (np.cos(k * angle) - 1.0)) for k, s, c in rows))


def test_a_rigid_arm_with_periodic_drives_meets_the_path_after_compensation(
    tmp_path: Path, program: ProgramFile
) -> None:
    """Drives that err 60 and 200 times per turn: the commanded path puts the tool on the programmed one."""
    rows = {"axis1": [[60, 100.0, 50.0]], "axis2": [[200, 0.0, 80.0]], "axis3": [[200, 60.0, 0.0]]}
    plain = _cell(tmp_path, None, "rigid.toml")
    erring = _cell(tmp_path, _set("drive_error", value=rows), "rigid.toml")
    left = {}
    for name, known in (("unknown", plain), ("known", erring)):
        cell = read_cell(known)
        plan = compensate(program(), cell, predict=False).plan
        setting = setting_of(cell)
        R = setting.T_base_part[:3, :3]
        joints = solve_joints(plan.path, plan.line, setting)
        contact = np.any(plan.w_tcp_part != 0.0, axis=1)
        # Where the links of the erring robot put the tool, by the angles that the controller commands.
        turn = np.zeros_like(plan.correction_part)
        q = corrected_joints(
            setting.controller_chain, tool_carried(setting.T_base_part), joints.q, plan.correction_part, turn
        )
        links = np.column_stack([_erring(q[:, k], rows.get(f"axis{k + 1}", [])) for k in range(6)])
        off = forward(setting.chain, links)[:, :3, 3] - forward(setting.chain, joints.q)[:, :3, 3]
        left[name] = float(np.sqrt(np.mean(np.sum((off[contact] @ R) ** 2, axis=1))))
    assert left["unknown"] > 100 * UM
    assert left["known"] < 0.1 * left["unknown"]


def test_a_robot_without_periodic_errors_has_none_in_its_plan(tmp_path: Path, program: ProgramFile) -> None:
    cell = read_cell(_cell(tmp_path, None, "rigid.toml"))
    plan = compensate(program(), cell, predict=False).plan
    assert not np.any(
        residual_sag(plan.path.p_part_tcp, plan.q, setting_of(cell), tool_carried(setting_of(cell).T_base_part))
    )


def test_sag_of_a_robot_without_masses_changes_the_plan(tmp_path: Path, program: ProgramFile) -> None:
    """A frame from outside: the whole turn of axes 2 and 3 by weight is undone at the tool."""
    sag: dict[str, object] = {"axis2_by_link3_mrad": [1.0, 0.2], "axis3_by_link3_mrad": [0.5, 0.8]}
    cell = read_cell(_cell(tmp_path, _set("axis_sag", value=sag), "rigid.toml"))
    plan = compensate(program(), cell, predict=False).plan
    off = residual_sag(plan.path.p_part_tcp, plan.q, setting_of(cell), tool_carried(setting_of(cell).T_base_part))
    assert np.all(np.linalg.norm(off, axis=1) > 100 * UM)
    # Where they are undone the links are at the angles that the controller has.
    setting = setting_of(cell)
    true = forward(setting.chain, setting.drive_errors.link_angles(plan.q))[:, :3, 3]
    expected = (true - forward(setting.chain, plan.q)[:, :3, 3]) @ setting.T_base_part[:3, :3]
    np.testing.assert_allclose(off, expected, atol=1 * UM)
    contact = np.any(plan.w_tcp_part != 0.0, axis=1)
    np.testing.assert_allclose(plan.correction_part[contact], -off[contact], atol=40 * UM)


def test_a_path_beyond_the_measured_angles_is_told(tmp_path: Path, program: ProgramFile) -> None:
    rows: dict[str, object] = {"axis1": [[60, 100.0, 50.0]], "measured_deg": [[40, 90]] + 5 * [[-350, 350]]}
    told = compensate(program(), read_cell(_cell(tmp_path, _set("drive_error", value=rows))), predict=False)
    assert any("axis 1 leaves the angles" in w for w in told.summary["written"]["warnings"])
    rows["measured_deg"] = 6 * [[-350, 350]]
    quiet = compensate(program(), read_cell(_cell(tmp_path, _set("drive_error", value=rows))), predict=False)
    assert not any("leaves the angles" in w for w in quiet.summary["written"]["warnings"])


def test_a_path_beyond_the_angles_of_a_region_is_told(tmp_path: Path, program: ProgramFile) -> None:
    row = {"segment": "axis2", "direction": "rz", "axis": 2, "factors": [1.2, 0.8]}
    for angles, expected in (([10, 40], True), ([-300, 300], False)):
        cell = read_cell(_cell(tmp_path, _set("robot", "elastic_region", value=[{**row, "angles_deg": angles}])))
        said = compensate(program(), cell, predict=False).summary["written"]["warnings"]
        assert any("axis2.rz over the angle of axis 2 was measured" in w for w in said) is expected


def _bending(tables: dict[str, object]) -> None:
    """Change a cell so that its spindle bends by its load, and by the angle of an axis."""
    row = {"segment": "spindle", "direction": "rz", "factors": [1.1, 0.9]}
    _set("end_effector", 0, "rz_urad_per_knm", value=2000.0)(tables)
    _set("robot", "compliance_curve", value=[{**row, "loads_nm": [-10, 10]}])(tables)
    _set("robot", "elastic_region", value=[{**row, "axis": 6, "angles_deg": [-90, 90]}])(tables)


def test_springs_of_the_end_effector_may_change_with_load_and_posture(tmp_path: Path) -> None:
    """Identification names bodies behind the flange, which the robot alone has not."""
    assert read_cell(_cell(tmp_path, _bending)).unknown_axes == read_cell(DATA / "small.toml").unknown_axes
