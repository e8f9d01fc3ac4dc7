"""Answers as JSON: stable keys, right values."""

from __future__ import annotations

import io
import json
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

ROBOT = "kuka_kr300_r2500_ultra"
JOINTS = "5,-95,110,20,-35,40"


def _json(ended: Any) -> Any:
    assert ended.status == 0, ended.err
    assert ended.err == ""
    return json.loads(ended.out, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


def test_robots(counterflex: Any) -> None:
    rows = _json(counterflex("robots", "--json"))
    assert len(rows) >= 20
    for row in rows:
        assert set(row) == {"name", "model", "reach_mm", "payload_kg", "status", "source"}
        assert set(row["status"]) == set(row["source"])
        assert set(row["status"].values()) <= {"VERIFIED", "SECONDARY", "UNVERIFIED", "not known"}
    one = _json(counterflex("robots", ROBOT, "--json"))
    sheet = one[0].pop("data_sheet")
    assert one == [row for row in rows if row["name"] == ROBOT]
    assert sheet["controller"] == "KUKA"
    assert sheet["world"] == "on the base plate, on axis 1"
    assert sheet["lengths_mm"]["axis 2 to axis 3 (upper arm)"] == 1150.0
    assert sheet["axes"][1] == {"axis": "A2", "low_deg": -140.0, "high_deg": -5.0, "speed_deg_s": 101.0}
    assert sheet["at_zero"] == {"X mm": 2740.0, "Y mm": 0.0, "Z mm": 634.0, "A deg": 0.0, "B deg": 90.0, "C deg": 0.0}


def test_robots_shows_an_own_robot_as_its_data_sheet_does(counterflex: Any) -> None:
    sheet = _json(counterflex("robots", "examples/cells/fanuc_r2000ic.toml", "--json"))[0]["data_sheet"]
    assert (sheet["controller"], sheet["coupled"], sheet["axis_3"]) == (
        "FANUC",
        True,
        "from the horizontal, whatever axis 2 does",
    )
    assert sheet["world"] == "on axis 1, 670 mm above the base plate (height of axis 2)"
    assert sheet["axis_3_against_upper_arm_deg"] is None
    assert sheet["at_zero"]["Z mm"] == 1300.0
    assert [sheet["at_zero"][key] for key in ("W deg", "P deg", "R deg")] == [-180.0, -90.0, 0.0]


def test_the_pose_of_a_fanuc_takes_and_gives_its_own_axes(counterflex: Any) -> None:
    cell = "examples/cells/fanuc_r2000ic.toml"
    there = _json(counterflex("pose", cell, "--joints-deg", "10,-20,-36,5,-50,7", "--json"))["tcp_in_base"]
    xyz = ",".join(str(there[f"{axis}_mm"]) for axis in "xyz")
    abc = ",".join(str(there[f"{axis}_deg"]) for axis in "abc")
    back = _json(counterflex("pose", cell, "--xyz-mm", xyz, f"--abc-deg={abc}", "--json"))["solutions"]
    apart = [max(abs(a - b) for a, b in zip(one["joints_deg"], [10, -20, -36, 5, -50, 7], strict=True)) for one in back]
    assert min(apart) < 1e-4


def _reachable_checks() -> list[tuple[str, dict[str, Any]]]:
    """Published check poses of the catalogue whose joint angles lie within the robot's limits."""
    found = []
    for item in (resources.files("counterflex.robot.model") / "catalog_data").iterdir():
        if not item.name.endswith(".toml"):
            continue
        data = tomllib.loads(item.read_text(encoding="utf-8"))
        if "limits" not in data:
            continue
        low, high = (np.array(data["limits"][key]) for key in ("lower_deg", "upper_deg"))
        for check in data.get("checks", []):
            q = np.array(check["q_deg"])
            if np.all((q >= low) & (q <= high)) and "rotation" in check:
                found.append((str(data["name"]), check))
    return sorted(found, key=lambda pair: (pair[0], pair[1]["name"]))


CHECKS = _reachable_checks()


def _text(values: Any) -> str:
    return ",".join(f"{value:.10g}" for value in values)


def _zyx(a: float, b: float, c: float) -> Any:
    """Rotation z-y'-x'' from degrees, written out here so that it is not the program's own."""
    (ca, sa), (cb, sb), (cc, sc) = ((np.cos(np.radians(v)), np.sin(np.radians(v))) for v in (a, b, c))
    about_z = np.array([[ca, -sa, 0], [sa, ca, 0], [0, 0, 1]])
    about_y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    about_x = np.array([[1, 0, 0], [0, cc, -sc], [0, sc, cc]])
    return about_z @ about_y @ about_x


def test_there_are_check_poses() -> None:
    assert len(CHECKS) >= 20
    assert len({name for name, _ in CHECKS}) >= 10


@pytest.mark.parametrize(("robot", "check"), CHECKS, ids=[f"{name} {check['name']}" for name, check in CHECKS])
def test_pose_is_the_published_one(counterflex: Any, robot: str, check: dict[str, Any]) -> None:
    answer = _json(counterflex("pose", robot, "--json", "--joints-deg", _text(check["q_deg"])))
    assert set(answer) == {"tcp_in_base", "joints_deg", "margins"}
    assert answer["joints_deg"] == check["q_deg"]
    assert set(answer["margins"]) == {f"axis{i}" for i in range(1, 7)}
    tcp = answer["tcp_in_base"]
    assert [tcp[f"{axis}_mm"] for axis in "xyz"] == pytest.approx(check["position_mm"], abs=0.02)
    assert _zyx(tcp["a_deg"], tcp["b_deg"], tcp["c_deg"]) == pytest.approx(np.array(check["rotation"]), abs=2e-5)


@pytest.mark.parametrize("target", [ROBOT, "cell.toml"])
def test_pose_and_back(folder: Path, counterflex: Any, target: str) -> None:
    tcp = _json(counterflex("pose", target, "--json", "--joints-deg", JOINTS))["tcp_in_base"]
    xyz = _text([tcp[f"{axis}_mm"] for axis in "xyz"])
    abc = _text([tcp[f"{axis}_deg"] for axis in "abc"])
    back = _json(counterflex("pose", target, "--json", "--xyz-mm", xyz, "--abc-deg", abc))
    assert back["tcp_in_base"] == pytest.approx(tcp, abs=1e-6)
    wanted = [float(angle) for angle in JOINTS.split(",")]
    found = [solution["joints_deg"] for solution in back["solutions"]]
    assert min(np.max(np.abs(np.array(joints) - wanted)) for joints in found) < 2e-5
    for solution in back["solutions"]:
        assert set(solution) == {"branch", "joints_deg", "margins", "wrist_deg"}
        again = _json(counterflex("pose", target, "--json", "--joints-deg", _text(solution["joints_deg"])))
        assert [again["tcp_in_base"][f"{axis}_mm"] for axis in "xyz"] == pytest.approx(
            [tcp[f"{axis}_mm"] for axis in "xyz"], abs=1e-3
        )


def test_deflection(folder: Path, counterflex: Any) -> None:
    def ask(force: str, moment: str = "0,0,0") -> Any:
        return _json(
            counterflex(
                *("deflection", "cell.toml", "--json", "--joints-deg", JOINTS),
                *("--force-n", force, "--moment-nm", moment),
            )
        )

    answer = ask("0,500,0")
    assert set(answer) >= {
        *("tcp_in_base", "force_n", "moment_nm", "linear", "nonlinear", "gap_um", "gravity_sag", "compliance", "shares")
    }
    along = [ask(force)["linear"]["dx_dy_dz_um"][i] for i, force in enumerate(("300,0,0", "0,300,0", "0,0,300"))]
    assert min(along) > 0.0  # the tool yields in the direction of the force
    assert ask("0,-500,0")["linear"]["dx_dy_dz_um"] == pytest.approx(
        [-value for value in answer["linear"]["dx_dy_dz_um"]], abs=2e-3
    )
    matrix = np.array(answer["compliance"]["translation_um_per_kn"])
    assert matrix == pytest.approx(matrix.T, abs=2e-3)
    assert np.all(np.linalg.eigvalsh(matrix) > 0.0)
    assert answer["linear"]["dx_dy_dz_um"] == pytest.approx(0.5 * matrix[:, 1], abs=2e-3)
    assert answer["linear"]["length_um"] == pytest.approx(np.linalg.norm(answer["linear"]["dx_dy_dz_um"]), abs=2e-3)
    assert answer["gap_um"] < 0.01 * answer["linear"]["length_um"]
    assert answer["gravity_sag"]["dx_dy_dz_um"][2] < 0.0
    assert sum(row["share"] for row in answer["shares"]) == pytest.approx(1.0, abs=1e-3)
    total = np.sum([row["dx_dy_dz_um"] for row in answer["shares"]], axis=0)
    assert total == pytest.approx(answer["linear"]["dx_dy_dz_um"], abs=0.02)
    assert ask("0,0,0", "0,0,100")["linear"]["rx_ry_rz_urad"][2] > 0.0


def test_cell_check(folder: Path, counterflex: Any) -> None:
    answer = _json(counterflex("cell", "check", "cell.toml", "--json"))
    assert answer["warnings"] == []
    assert set(answer) >= {
        *("cell", "robot", "segments", "mass_kg", "force_law", "tools", "stock_mm", "at_corner", "softness"),
        *("sag_at_corners_um", "sag_variation_um", "smallest_joint_margin_deg"),
    }
    names = [row["segment"] for row in answer["segments"]]
    assert {"axis1", "axis6", "sensor", "spindle"} <= set(names)
    assert answer["mass_kg"] == pytest.approx(sum(row["mass_kg"] for row in answer["segments"]), abs=0.01)
    assert [row["direction"] for row in answer["softness"]] == ["x", "y", "z"]
    for row in answer["softness"]:
        assert 0.1 < row["um_per_n"] < 10.0
        assert row["weakest"] in names
        assert 0.0 < row["share"] <= 1.0
    assert answer["stock_mm"]["high"][2] == 20.0
    corner = answer["at_corner"]
    tcp = _json(counterflex("pose", "cell.toml", "--json", "--joints-deg", _text(corner["joints_deg"])))["tcp_in_base"]
    offset = np.array([tcp[f"{axis}_mm"] for axis in "xyz"]) - corner["xyz_mm"]
    assert offset == pytest.approx([1350.0, -75.0, 1000.0], abs=0.05)  # the part frame


def test_path_table(folder: Path, counterflex: Any) -> None:
    ended = counterflex("path", "part.ngc", "--csv", "path.csv")
    assert (ended.status, ended.out) == (0, "wrote path.csv: 6 motions\n")
    printed = counterflex("path", "part.ngc").out
    assert printed == (folder / "path.csv").read_text(encoding="utf-8")
    table = pl.read_csv(io.StringIO(printed))
    assert table["line"].to_list() == [4, 5, 6, 7, 8, 9]
    assert table["motion"].to_list() == ["rapid", "rapid", "rapid", "feed", "feed", "rapid"]
    assert table["x_mm"].to_list()[-2:] == [10.0, 10.0]
    assert table["z_mm"].to_list() == [40.0, 40.0, 22.0, 17.0, 17.0, 40.0]
    assert table["feed_mm_min"].to_list()[3:5] == [3000.0, 1500.0]


def test_path_table_of_arcs(folder: Path, counterflex: Any) -> None:
    (folder / "arc.ngc").write_text("G21 G90 G17\nG0 X10 Y0 Z5\nG3 X0 Y10 I-10 J0 F600\nM2\n", encoding="ascii")
    table = pl.read_csv(io.StringIO(counterflex("path", "arc.ngc").out))
    arc = table.row(1, named=True)
    assert arc["motion"] == "arc"
    assert arc["plane"] == "G17"
    assert arc["turns"] == pytest.approx(0.25)
    assert [value for name, value in arc.items() if "cent" in name or name[:2] in ("i_", "j_", "k_")][:2] == [0.0, 0.0]


def test_compensate(folder: Path, counterflex: Any) -> None:
    command = ("compensate", "part.ngc", "--cell", "cell.toml", "--out", "out", "--json")
    answer = _json(counterflex(*command))
    written = json.loads((folder / "out/summary.json").read_text(encoding="utf-8"))
    assert {name: written[name] for name in answer} == answer
    assert written["format"] == "counterflex-summary"
    assert answer["files"] == ["part.ngc"]
    assert answer["language"] == "gcode"
    found = answer["prediction"]
    assert found["peak_force_n"]["line"] == 8
    assert 100.0 < found["peak_force_n"]["value"] < 500.0
    assert found["peak_axial_depth_mm"]["value"] == pytest.approx(3.0, abs=0.3)
    assert found["collisions"] == []
    before, after = found["predicted_nominal"], found["predicted_compensated"]
    assert after["p997_mm"] < 0.5 * before["p997_mm"]
    assert sorted(path.name for path in (folder / "out").iterdir()) == [
        *("part.ngc", "plan.parquet", "report.html", "summary.json")
    ]


@pytest.mark.parametrize(("language", "names"), [("krl", {"part.src", "part.dat"}), ("rapid", {"part.mod"})])
def test_compensate_for_a_robot(folder: Path, counterflex: Any, language: str, names: set[str]) -> None:
    command = ("compensate", "part.ngc", "--cell", "cell.toml", "--out", "out", "--as", language)
    answer = _json(counterflex(*command, "--no-predict", "--no-report", "--json"))
    assert {name.lower() for name in answer["files"]} == names
    assert {path.name for path in (folder / "out").iterdir()} == {*answer["files"], "plan.parquet", "summary.json"}
