"""Cell files: the objects hold the numbers of the tables, in SI, and paths are relative to the file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
import trimesh
from hypothesis import given, settings, strategies as st

from counterflex.app import examples
from counterflex.core.errors import FileFormatError
from counterflex.cutting import material
from counterflex.cutting.coefficients import KienzleLaw, LinearEdgeLaw
from counterflex.cutting.force_laws import FORCE_LAWS, LawKind
from counterflex.files.cell.cell import KIND, VERSION, read_cell
from counterflex.files.schema import read_toml, write_toml
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.model import catalog

ROBOT = "kuka_kr300_r2500_ultra"


def data() -> dict[str, Any]:
    """A whole cell with a number of its own for every key that is checked."""
    return {
        "format": KIND,
        "version": VERSION,
        "name": "test cell",
        "robot": {
            "catalog": ROBOT,
            "elastic": [{"segment": "axis2", "rz_urad_per_knm": 77.0, "tx_um_per_kn": 3.0, "mass_kg": 99.0}],
        },
        "end_effector": [
            {"name": "sensor", "z_mm": 31.0, "a_deg": 12.0, "mass_kg": 7.5, "com_x_mm": 4.0, "ry_urad_per_knm": 301.0},
            {"name": "spindle", "x_mm": 8.0, "mass_kg": 61.0, "tz_um_per_kn": 5.5},
        ],
        "tcp": {"x_mm": 240.0, "z_mm": 70.0, "b_deg": 90.0},
        "part": {
            "x_mm": 1350.0,
            "y_mm": -75.0,
            "z_mm": 1000.0,
            "c_deg": 2.0,
            "datum_points_mm": [[0, 0, 20], [40, 0, 20], [40, 30, 20]],
            "stock": {"box_min_mm": [-5, 0, 1], "box_max_mm": [40, 30, 20], "cell_mm": 0.5},
        },
        "tools": [
            {"number": 3, "diameter_mm": 10, "corner_radius_mm": 1.5, "flutes": 4, "flute_length_mm": 22},
            {"number": 8, "diameter_mm": 6, "flutes": 2, "helix_deg": 45, "flute_length_mm": 12, "runout_um": 7},
        ],
        "material": {
            "kc11_n_mm2": 800.0,
            "mc": 0.2,
            "kr_over_kc": 0.4,
            "mr": 0.3,
            "ka_over_kc": -0.1,
            "ma": 0.1,
            "chip_min_um": 2.0,
            "chip_max_um": 500.0,
            "source": "somewhere",
        },
    }


def _written(folder: Path, content: dict[str, Any]) -> Path:
    path = folder / "cell.toml"
    path.write_text(tomli_w.dumps(content), encoding="utf-8")
    return path


def test_numbers_in_si(tmp_path: Path) -> None:
    cell = read_cell(_written(tmp_path, data()))
    assert cell.name == "test cell"
    names = list(cell.chain.names)
    sensor, spindle, axis2 = (names.index(name) for name in ("sensor", "spindle", "axis2"))
    assert cell.chain.compliance[sensor] == pytest.approx(np.array([0, 0, 0, 0, 301e-9, 0]))
    assert cell.chain.compliance[spindle] == pytest.approx(np.array([0, 0, 5.5e-9, 0, 0, 0]))
    assert cell.chain.mass[[sensor, spindle, axis2]] == pytest.approx(np.array([7.5, 61.0, 99.0]))
    body = cell.end_effector.segments[0]
    assert body.p_seg_com == pytest.approx(np.array([0.004, 0.0, 0.0]))
    turn = math.radians(12.0)
    assert body.T_prev_seg[:2, :2] == pytest.approx(
        np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    )
    assert body.T_prev_seg[:3, 3] == pytest.approx(np.array([0.0, 0.0, 0.031]))
    assert cell.T_base_part[:3, 3] == pytest.approx(np.array([1.35, -0.075, 1.0]))
    assert cell.T_base_part[2, 2] == pytest.approx(math.cos(math.radians(2.0)))
    assert cell.datum_points_part == pytest.approx(np.array([[0, 0, 0.02], [0.04, 0, 0.02], [0.04, 0.03, 0.02]]))


def test_elements_of_the_robot_are_replaced_key_by_key(tmp_path: Path) -> None:
    cell = read_cell(_written(tmp_path, data()))
    before = {segment.name: segment for segment in catalog.load(ROBOT).segments}
    after = {segment.name: segment for segment in cell.robot.segments}
    assert list(before) == list(after)
    expected = before["axis2"].compliance.copy()
    expected[[0, 5]] = 3e-9, 77e-9
    assert after["axis2"].compliance == pytest.approx(expected)
    for name in set(before) - {"axis2"}:
        assert after[name].compliance == pytest.approx(before[name].compliance)
        assert after[name].mass_kg == before[name].mass_kg


def test_tools(tmp_path: Path) -> None:
    cell = read_cell(_written(tmp_path, data()))
    bull, flat = cell.cutter(3), cell.cutter(8)
    assert (bull.diameter_m, bull.corner_radius_m, bull.flutes) == pytest.approx((0.010, 0.0015, 4))
    assert (bull.flute_length_m, bull.runout_m, bull.helix_rad) == pytest.approx((0.022, 0.0, math.radians(30.0)))
    assert (flat.diameter_m, flat.runout_m, flat.helix_rad) == pytest.approx((0.006, 7e-6, math.radians(45.0)))
    with pytest.raises(FileFormatError, match=r"got T4; expected T3, T8. Add a \[\[tools\]\] table with number = 4"):
        cell.cutter(4)


def test_kienzle_law(tmp_path: Path) -> None:
    law = read_cell(_written(tmp_path, data())).force_law
    assert isinstance(law, KienzleLaw)
    assert [k / 1e6 for k in law.k11_pa()] == pytest.approx([800.0, 320.0, -80.0])
    assert (law.mc, law.mr, law.ma) == (0.2, 0.3, 0.1)
    assert (law.h_min_m, law.h_max_m) == pytest.approx((2e-6, 5e-4))
    assert law.source == "somewhere"


def test_linear_edge_law(tmp_path: Path) -> None:
    content = data()
    content["material"] = {"law": "linear_edge", "ktc_n_mm2": 800.0, "krc_n_mm2": 300.0, "kte_n_mm": 12.0}
    law = read_cell(_written(tmp_path, content)).force_law
    assert isinstance(law, LinearEdgeLaw)
    assert (law.ktc_pa, law.krc_pa, law.kac_pa) == pytest.approx((8e8, 3e8, 0.0))
    assert (law.kte_n_m, law.kre_n_m, law.kae_n_m) == pytest.approx((12e3, 0.0, 0.0))


DOUBLED = LawKind(
    "Kienzle, twice as large",
    lambda values, valid: KienzleLaw.with_ratios(
        2e6 * values["kc11_n_mm2"], values["mc"], kr_over_kc=0.4, ka_over_kc=0.0, **vars(valid)
    ),
    {"kc11_n_mm2": (10.0, 2000.0), "mc": (0.0, 0.9)},
)


def test_a_law_of_our_own_with_ranges_reads_its_parameters(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A law of counterflex is registered as that of another package is: a class, its ranges, one line."""
    monkeypatch.setitem(FORCE_LAWS.own, "doubled", f"{__name__}:DOUBLED")
    content = data()
    content["material"] = {"law": "doubled", "parameters": {"kc11_n_mm2": 800.0, "mc": 0.2}}
    law = read_cell(_written(tmp_path, content)).force_law
    assert isinstance(law, KienzleLaw)
    assert law.k11_pa()[0] == pytest.approx(1600e6)
    content["material"]["kc11_n_mm2"] = 800.0
    with pytest.raises(FileFormatError, match=r"remove kc11_n_mm2"):
        read_cell(_written(tmp_path, content))


@pytest.mark.parametrize("name", material.names())
def test_material_of_the_catalogue(tmp_path: Path, name: str) -> None:
    """Every row can be used: ratios are given where it has no radial or axial constants, and refused where it has."""
    content, laws, refusals = data(), [], []
    for ratios in ({}, {"kr_over_kc": 0.3}, {"ka_over_kc": 0.2}, {"kr_over_kc": 0.3, "ka_over_kc": 0.2}):
        content["material"] = {"catalog": name, **ratios}
        try:
            laws.append(read_cell(_written(tmp_path, content)).force_law)
        except FileFormatError as fault:
            refusals.append(str(fault))
    assert laws
    assert all(law.source for law in laws)
    assert all("cell.toml: material.catalog" in line and "k" in line for line in refusals)


def test_stock_from_a_box(tmp_path: Path) -> None:
    stock = read_cell(_written(tmp_path, data())).stock()
    assert stock.cell_m == pytest.approx(5e-4)
    assert stock.bottom_m == pytest.approx(1e-3)
    assert np.unique(stock.z) == pytest.approx([0.02])
    assert stock.z.shape == (60, 90)
    assert stock.x_m()[[0, -1]] == pytest.approx(np.array([-0.00475, 0.03975]))


@pytest.mark.parametrize("kind", ["stl", "result"])
def test_stock_from_a_file_beside_the_cell(tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Paths are relative to the cell file, wherever the command runs."""
    folder = tmp_path / "cells"
    folder.mkdir()
    box = read_cell(_written(folder, data())).stock()
    if kind == "stl":
        mesh = trimesh.creation.box(bounds=np.array([[-5.0, 0.0, 1.0], [40.0, 30.0, 20.0]]))
        (folder / "blank.stl").write_bytes(trimesh.exchange.stl.export_stl(mesh))
    else:
        box.save(folder / "blank.npz")
    content = data()
    content["part"]["stock"] = {kind: "blank.stl" if kind == "stl" else "blank.npz", "cell_mm": 0.5}
    path = _written(folder, content)
    monkeypatch.chdir(tmp_path)
    stock = read_cell(path).stock()
    assert stock.z == pytest.approx(box.z, abs=1e-6)
    assert (stock.x0_m, stock.y0_m, stock.bottom_m) == pytest.approx((box.x0_m, box.y0_m, box.bottom_m))


def test_own_geometry_is_that_of_the_catalogue(tmp_path: Path) -> None:
    """The KR 300 given by its lengths stands where the catalogue's stands."""
    content = data()
    robot = catalog.load(ROBOT)
    content["robot"] = {
        "geometry": {
            "a1_mm": 350.0,
            "a2_mm": 41.0,
            "c1_mm": 675.0,
            "c2_mm": 1150.0,
            "c3_mm": 1000.0,
            "c4_mm": 240.0,
            "offsets_deg": [0.0, -90.0, 0.0, 0.0, 0.0, 0.0],
            "signs": [-1, 1, 1, -1, 1, -1],
            "limits_deg": np.degrees(robot.joint_limits_rad).tolist(),
        }
    }
    own = read_cell(_written(tmp_path, content))
    listed = read_cell(_written(tmp_path, data()))
    q = np.radians(np.array([[0.0, -90.0, 90.0, 0.0, 0.0, 0.0], [20.0, -70.0, 60.0, 40.0, -50.0, 10.0]]))
    flange = [np.linalg.inv(cell.chain.T_flange_tcp) for cell in (own, listed)]
    assert forward(own.chain, q) @ flange[0] == pytest.approx(forward(listed.chain, q) @ flange[1], abs=1e-6)


@pytest.mark.parametrize("name", catalog.names())
def test_every_robot_of_the_catalogue_makes_a_cell(tmp_path: Path, name: str) -> None:
    content = data()
    content["robot"] = {"catalog": name}
    cell = read_cell(_written(tmp_path, content))
    assert cell.chain.names[-2:] == ("sensor", "spindle")


@settings(max_examples=40)
@given(
    st.just(0.0) | st.floats(0.02, 2000.0),
    st.floats(1e-3, 1e5),
    st.floats(0.1, 400.0),
    st.integers(1, 64),
    st.floats(-2000.0, 2000.0),
)
def test_any_number_arrives(
    tmp_path_factory: pytest.TempPathFactory, mass: float, soft: float, diameter: float, flutes: int, x: float
) -> None:
    content = data()
    content["end_effector"][1] |= {"mass_kg": mass, "ty_um_per_kn": soft, "x_mm": x}
    content["tools"][1] |= {"diameter_mm": diameter, "flutes": flutes, "runout_um": 0.0}
    cell = read_cell(_written(tmp_path_factory.mktemp("cell"), content))
    body = cell.end_effector.segments[1]
    assert body.mass_kg == mass
    assert body.compliance[1] == pytest.approx(soft * 1e-9, rel=1e-12)
    assert body.T_prev_seg[0, 3] == pytest.approx(x * 1e-3, rel=1e-12)
    assert cell.cutter(8).diameter_m == pytest.approx(diameter * 1e-3, rel=1e-12)
    assert cell.cutter(8).flutes == flutes


def test_written_tables_read_the_same(tmp_path: Path) -> None:
    (tmp_path / "first.toml").write_text(examples.text("cell.toml"), encoding="utf-8")
    first = read_cell(tmp_path / "first.toml")
    write_toml(tmp_path / "second.toml", first.tables.model_dump(mode="json", exclude_none=True), comment="again")
    second = read_cell(tmp_path / "second.toml")
    assert second.tables == first.tables
    assert read_toml(tmp_path / "second.toml")["name"] == first.name


def test_demonstration_cell(tmp_path: Path) -> None:
    """The cell that ships: weights and elastic elements of the published set-up, in SI."""
    (tmp_path / "cell.toml").write_text(examples.text("cell.toml"), encoding="utf-8")
    cell = read_cell(tmp_path / "cell.toml")
    names = list(cell.chain.names)
    stiffness = 1.0 / cell.chain.compliance[names.index("spindle"), 3:]
    assert stiffness == pytest.approx(np.array([190e3, 67e3, 91e3]), rel=1e-3)  # N m/rad, Haehn2020 table 1
    assert cell.cutter(1).diameter_m == pytest.approx(0.016)
    assert cell.stock().z.shape == (1500, 2000)
    assert cell.tables.posture.branch == "front up noflip"


@pytest.mark.parametrize("version", [VERSION + 1, 99])
def test_newer_files_are_refused(tmp_path: Path, version: int) -> None:
    with pytest.raises(FileFormatError, match=f"newer .* version {version}; expected at most {VERSION}"):
        read_cell(_written(tmp_path, data() | {"version": version}))


def test_body_names(tmp_path: Path) -> None:
    content = data()
    content["end_effector"][0]["name"] = "axis3"
    with pytest.raises(FileFormatError, match="end_effector: .*name of a segment of the robot; got axis3"):
        read_cell(_written(tmp_path, content))


KIENZLE = {"kc11_n_mm2": 780.0, "mc": 0.25, "kr_over_kc": 0.35, "ka_over_kc": 0.15}
CATALOG = {"catalog": "en-aw-7075-carbide-190"}


@pytest.mark.parametrize(("table", "more", "said"), [
    (KIENZLE, {"ktc_n_mm2": 900.0}, "the kienzle law reads other keys: remove ktc_n_mm2"),
    ({"law": "linear_edge", "ktc_n_mm2": 900.0, "krc_n_mm2": 300.0}, {"edge_c_n_mm": 8.0}, "remove edge_c_n_mm"),
    (CATALOG, {"edge_c_n_mm": 8.0}, "a catalog material brings its own constants: remove edge_c_n_mm"),
    (CATALOG, {"chip_max_um": 50.0}, "remove chip_max_um"), (CATALOG, {"law": "linear_edge"}, "remove law"),
])  # fmt: skip
def test_a_key_of_the_material_that_nothing_reads_is_refused(
    tmp_path: Path, table: dict[str, object], more: dict[str, object], said: str
) -> None:
    content = data()
    content["material"] = table
    read_cell(_written(tmp_path, content))
    content["material"] = table | more
    with pytest.raises(FileFormatError, match=said):
        read_cell(_written(tmp_path, content))


def test_a_tip_of_no_urdf_is_refused(tmp_path: Path) -> None:
    content = data()
    content["robot"]["urdf_tip"] = "tool0"
    with pytest.raises(FileFormatError, match="urdf_tip names a link of urdf; the robot comes from catalog"):
        read_cell(_written(tmp_path, content))
