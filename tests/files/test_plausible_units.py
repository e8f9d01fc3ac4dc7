"""R25: a mistaken unit in a cell file is refused or told, with the limit and the likely unit; real cells pass."""

from __future__ import annotations

import copy
import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

import counterflex
from counterflex.core.errors import FileFormatError
from counterflex.files.cell.cell import read_cell
from counterflex.files.cell.measured import IdentifiedTable
from counterflex.files.cell.plausibility import WINDOWS, unusual
from counterflex.files.cell.update import updated_text
from counterflex.identify.data.changes import AxisPlay, BodyMass, ElementCompliance
from counterflex.robot.model import catalog
from counterflex.robot.model.description import Play
from known_drives import with_drives

DEMO = Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml"
EXAMPLES = sorted((Path(__file__).parents[2] / "examples" / "cells").glob("*.toml"))


def changed(folder: Path, place: tuple[str | int, ...], value: Any) -> Path:
    data = tomllib.loads(with_drives(DEMO.read_text(encoding="utf-8")))
    at: Any = data
    for key in place[:-1]:
        at = at.setdefault(key, {}) if isinstance(at, dict) else at[key]
    at[place[-1]] = value
    file = folder / "cell.toml"
    file.write_text(tomli_w.dumps(data), encoding="utf-8")
    return file


@pytest.mark.parametrize("file", [DEMO, *EXAMPLES], ids=lambda file: file.stem)
def test_cells_that_are_right_pass_without_a_word(file: Path) -> None:
    assert unusual(read_cell(file).tables) == []


@pytest.mark.parametrize("name", catalog.names())
def test_robots_of_the_catalogue_pass(tmp_path: Path, name: str) -> None:
    file = changed(tmp_path, ("robot",), {"catalog": name})
    assert unusual(read_cell(file).tables) == []


@pytest.mark.parametrize(
    ("place", "value", "key", "hint"),
    [
        (("robot", "play", 0, "friction_nm"), [75e3, 105.0, 120.0], r"play\[1\]\.friction_nm\[1\]", "Is it in N mm?"),
        (("robot", "servo", 2, "friction_nm"), 0.06, r"servo\[3\]\.friction_nm", "Is it in kN m?"),
        (("tools", 0, "diameter_mm"), 0.016, r"tools\[1\]\.diameter_mm", "Is it in m?"),
        (("dynamics", "mode_hz"), 487.0, "mode_hz", "Is it in rad/s?"),
        (("controller", "acceleration_mm_s2"), 1.0, "acceleration_mm_s2", "Is it in m/s2?"),
        (("limits", "correction_mm"), 0.003, "correction_mm", "Is it in m?"),
        (("material", "kc11_n_mm2"), 0.78, "kc11_n_mm2", "Is it in GPa?"),
        (("online", "correction_mm"), 0.002, "online.correction_mm", "Is it in m?"),
    ],
)
def test_a_refusal_names_place_value_limit_and_likely_unit(
    tmp_path: Path, place: tuple[str | int, ...], value: Any, key: str, hint: str
) -> None:
    with pytest.raises(FileFormatError, match=key) as found:
        read_cell(changed(tmp_path, place, value))
    line = str(found.value)
    assert hint in line
    assert "expected magnitude" in line
    assert "\n" not in line


@pytest.mark.parametrize(
    ("place", "value", "hint"),
    [
        (("tcp", "x_mm"), 0.24, "is it in m?"),
        (("part", "datum_points_mm"), [[0, 0, 0.04], [200, 0, 40], [200, 150, 40]], "is it in m?"),
        (("tcp", "b_deg"), round(math.pi / 2.0, 5), "is it in rad?"),
        (("posture", "rotation_about_tool_deg"), 3.14159, "is it in rad?"),
        (("end_effector", 1, "rx_urad_per_knm"), 92.0, "rx_urad_per_knm = 92 is unusual: 497.5 to 329670"),
        (("end_effector", 1, "ry_urad_per_knm"), 260.0, "the other rotational compliances of this element are far"),
        (("end_effector", 0, "rz_urad_per_knm"), 11000.0, "the other rotational compliances of this element are far"),
        (("end_effector", 1, "rz_urad_per_knm"), 1.5, "is it in"),
    ],
)
def test_what_could_be_meant_so_is_told(tmp_path: Path, place: tuple[str | int, ...], value: Any, hint: str) -> None:
    found = unusual(read_cell(changed(tmp_path, place, value)).tables)
    assert [one.refused for one in found] == [False]
    assert hint in found[0].sentence()


def test_zero_and_what_was_identified_is_not_told(tmp_path: Path) -> None:
    """A pose that an identification has shifted may hold any small number."""
    file = changed(tmp_path, ("tcp", "y_mm"), 0.04)
    assert len(unusual(read_cell(file).tables)) == 1
    data = tomllib.loads(file.read_text(encoding="utf-8"))
    data["identified"] = [
        {
            "recipe": "kinematics",
            "date": "2026-11-01",
            "data": ["poses.csv"],
            "data_sha256": ["0" * 64],
            "counterflex": "0.1.0",
            "holdout": "0.1 mm",
            "values": [{"name": "tcp y", "value": 0.04, "sigma": 0.01, "unit": "mm"}],
        }
    ]
    file.write_text(tomli_w.dumps(data), encoding="utf-8")
    assert unusual(read_cell(file).tables) == []
    whole = copy.deepcopy(data)
    whole["tcp"]["y_mm"] = 0
    file.write_text(tomli_w.dumps(whole), encoding="utf-8")
    assert unusual(read_cell(file).tables) == []


def test_windows_are_in_order() -> None:
    for name, window in WINDOWS.items():
        assert 0.0 <= window.least <= window.low < window.high <= window.most, name
        assert window.high / window.low >= 15.0, name


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("end_effector", 1, "com_y_mm"), 0.117),
        (("end_effector", 1, "com_y_mm"), 0.1),
        (("end_effector", 0, "com_x_mm"), -0.02),
        (("end_effector", 1, "y_mm"), 0.0371),
        (("tcp", "y_mm"), 0.117),
        (("tcp", "y_mm"), -0.0371),
        (("part", "y_mm"), 0.734),
        (("part", "datum_points_mm"), [[0.117, -0.031, 40], [200.02, 0.116, 40], [200, 150, 40]]),
        (("part", "stock", "box_min_mm"), [-0.252, -0.117, 0]),
        (("part", "a_deg"), 0.031),
        (("tcp", "a_deg"), -0.2),
        (("tcp", "c_deg"), 0.0041),
        (("end_effector", 0, "b_deg"), 0.05),
        (("posture", "rotation_about_tool_deg"), 0.3),
    ],
)
def test_what_may_be_near_zero_is_not_told(tmp_path: Path, place: tuple[str | int, ...], value: Any) -> None:
    """A component of a place whose other components are of usual size, and angles: they may be aligned."""
    assert unusual(read_cell(changed(tmp_path, place, value)).tables) == []


@pytest.mark.parametrize(
    ("place", "value", "count"),
    [
        (("tcp",), {"x_mm": 0.24, "z_mm": 0.07, "b_deg": 90}, 2),
        (("tcp",), {"x_mm": 0.2413, "z_mm": 0.0702, "b_deg": 90}, 2),
        (("end_effector", 1), {"name": "spindle", "com_x_mm": 0.12, "com_z_mm": 0.07, "z_mm": 50}, 2),
    ],
)
def test_a_place_that_is_small_as_a_whole_is_told(
    tmp_path: Path, place: tuple[str | int, ...], value: Any, count: int
) -> None:
    found = unusual(read_cell(changed(tmp_path, place, value)).tables)
    assert len(found) == count
    assert all("is it in m?" in one.sentence() for one in found)


def test_nothing_is_told_of_what_an_identification_wrote(tmp_path: Path) -> None:
    """Mass and centre of gravity by the payload, a stiff element by pulls: the file is read back silently."""
    file = changed(tmp_path, ("name",), "own")
    cell = read_cell(file)
    changes = (
        BodyMass("spindle", 0.0871, np.array([0.000117, -2.4e-5, 3.1e-5])),
        ElementCompliance("sensor", np.array([0.0, 0.0, 2e-10, 3e-7, 4e-9, 1.9e-7])),
        AxisPlay(0, Play(2e-7, (0.31, 2.0), (4e-6, 9e-6))),
    )
    entry = IdentifiedTable(
        recipe="payload", date="2026-11-22", data=(), data_sha256=(), counterflex="0.1.0", holdout="none"
    )
    new = tmp_path / "new.toml"
    new.write_text(updated_text(cell, changes, entry, tmp_path), encoding="utf-8")
    told = unusual(read_cell(new).tables)
    assert told == []
    typed = new.read_text(encoding="utf-8").replace("identified: payload", "measured by hand: payload")
    new.write_text(typed, encoding="utf-8")
    assert len(unusual(read_cell(new).tables)) >= 5
