"""Identified values in a cell file: what is read back is what was found, and nothing else has changed."""

from __future__ import annotations

import tomllib
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.examples import text as demo
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import MM, MRAD
from counterflex.cutting.coefficients import KienzleLaw, LinearEdgeLaw
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.measured import IdentifiedTable, IdentifiedValue
from counterflex.files.cell.update import apply, check_update, updated_text
from counterflex.identify.data.changes import (
    AxisPlay,
    AxisServo,
    BodyMass,
    Calibration,
    Change,
    CuttingLaw,
    ElementCompliance,
    TableValues,
)
from counterflex.robot.elasticity.chain import ElasticChain, forward_elastic
from counterflex.robot.model.calibration import calibrated, places
from counterflex.robot.model.description import Play, Servo
from known_drives import with_drives

EXAMPLES = Path(__file__).parents[2] / "examples" / "cells"
ENTRY = IdentifiedTable(
    recipe="stiffness",
    date="2026-11-21 20:00 UTC",
    data=("pulls.toml",),
    data_sha256=("0" * 64,),
    counterflex="0.1.0",
    holdout="holdout_mean_um = 40, 90 before, on folds of the data",
    values=(IdentifiedValue(name="axis1.rz", value=500.0, sigma=3.0, unit="urad/kNm"),),
)


def updated(cell: Cell, changes: list[Change], folder: Path, entry: IdentifiedTable = ENTRY) -> Cell:
    text = updated_text(cell, changes, entry, folder)
    found = check_update(text, folder / "new.toml")
    plain = tomllib.loads(cell.path.read_text(encoding="utf-8"))
    for change in changes:
        apply(plain, change, cell, f"identified: {entry.recipe}, {entry.date}")
    read = tomllib.loads(text)
    # What the comment-keeping writer wrote is what the same changes make of the plain tables.
    assert {k: v for k, v in read.items() if k != "identified"} == {k: v for k, v in plain.items() if k != "identified"}
    return found


def other(cell: Cell, seed: int) -> tuple[list[Change], Cell]:
    """Changes to everything, and the cell that they should make."""
    rng = np.random.default_rng(seed)
    changes: list[Change] = []
    displacements = {}
    for place in places(cell.nominal_robot, cell.nominal_end_effector):
        displacements[place] = rng.normal(0.0, 1.0, 6) * np.array([MM] * 3 + [MRAD] * 3)
        changes.append(Calibration(place, displacements[place]))
    bodies = {}
    for segment in (*cell.robot.segments, *cell.end_effector.segments):
        compliance = segment.compliance * rng.uniform(0.5, 2.0, 6)
        compliance[3] = 0.0 if rng.random() < 0.3 else compliance[3] + 1e-8
        bodies[segment.name] = compliance
        changes.append(ElementCompliance(segment.name, compliance))
    masses = {s.name: (rng.uniform(5.0, 50.0), rng.normal(0.0, 0.1, 3)) for s in cell.end_effector.segments}
    changes += [BodyMass(name, mass, com) for name, (mass, com) in masses.items()]
    plays = tuple(Play(rng.uniform(0.0, 1e-4), (10.0, 20.0 + i), (1e-5, 3e-5)) for i in range(6))
    servos = tuple(Servo(1e5 * (1 + i), 10.0 + i, 0.05, 100.0, 2e-5) for i in range(6))
    changes += [AxisPlay(i, play) for i, play in enumerate(plays)]
    changes += [AxisServo(i, servo) for i, servo in enumerate(servos)]
    robot = replace(
        cell.nominal_robot,
        segments=tuple(replace(s, compliance=bodies[s.name]) for s in cell.nominal_robot.segments),
        play=plays,
        servo=servos,
    )
    tool = replace(
        cell.nominal_end_effector,
        segments=tuple(
            replace(s, compliance=bodies[s.name], mass_kg=masses[s.name][0], p_seg_com=masses[s.name][1])
            for s in cell.nominal_end_effector.segments
        ),
    )
    true_robot, true_tool = calibrated(robot, tool, displacements)
    chain = ElasticChain.build(true_robot, true_tool)
    return changes, Cell(cell.tables, cell.path, true_robot, true_tool, chain, robot, tool)


@pytest.mark.parametrize("name", ["kr300_d16_small.toml", "kr300_d10_ball.toml", "own_geometry.toml", "drives known"])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_cell_that_is_read_back_is_the_one_that_was_identified(name: str, seed: int, tmp_path: Path) -> None:
    file = EXAMPLES / name
    if name == "drives known":
        file = tmp_path / "drives.toml"
        file.write_text(with_drives((EXAMPLES / "kr300_d10_ball.toml").read_text(encoding="utf-8")), encoding="utf-8")
    cell = read_cell(file)
    changes, expected = other(cell, seed)
    found = updated(cell, changes, tmp_path)
    q = np.array([[0.1, -1.5, 1.8, 0.2, -0.7, 0.3], [-0.5, -1.2, 2.0, 1.0, 0.5, 2.0]])
    w = np.tile([100.0, -300.0, 200.0, 10.0, 5.0, -8.0], (2, 1))
    # Nine written digits of values of up to some metres, added up along the chain.
    np.testing.assert_allclose(forward_elastic(found.chain, q, w), forward_elastic(expected.chain, q, w), atol=1e-8)
    assert found.robot.servo is not None
    assert expected.robot.servo is not None
    for got, wanted in zip(found.robot.servo, expected.robot.servo, strict=True):
        assert got is not None
        assert wanted is not None
        assert astuple(got) == pytest.approx(astuple(wanted))
    assert found.robot.play is not None
    assert expected.robot.play is not None
    for played, meant in zip(found.robot.play, expected.robot.play, strict=True):
        assert played is not None
        assert meant is not None
        assert played.half_band_rad == pytest.approx(meant.half_band_rad, rel=1e-8)
        np.testing.assert_allclose((*played.friction_nm, *played.slip_rad), (*meant.friction_nm, *meant.slip_rad))
    for body, body_meant in zip(found.end_effector.segments, expected.end_effector.segments, strict=True):
        np.testing.assert_allclose(body.p_seg_com, body_meant.p_seg_com, rtol=1e-8)
        np.testing.assert_allclose(body.compliance, body_meant.compliance, rtol=1e-8)
        assert body.mass_kg == pytest.approx(body_meant.mass_kg, rel=1e-8)


def test_comments_order_and_everything_else_stay(tmp_path: Path) -> None:
    cell = read_cell(EXAMPLES / "kr300_d16_small.toml")
    before = cell.path.read_text(encoding="utf-8").splitlines()
    spindle = cell.end_effector.segments[1]
    text = updated_text(cell, [ElementCompliance("spindle", spindle.compliance * 1.25)], ENTRY, tmp_path)
    after = text.splitlines()
    gone = [line for line in before if line not in after]
    assert [line.split(" = ")[0] for line in gone] == [
        *(f"r{a}_urad_per_knm" for a in "xyz"),
        "source",
    ]
    kept = [line for line in before if line not in gone]
    assert [line for line in after if line in kept][: len(kept)] == kept
    assert "rx_urad_per_knm = 6578.75" in after


def test_identifying_again_replaces_the_entry_of_the_recipe(tmp_path: Path) -> None:
    cell = read_cell(EXAMPLES / "kr300_d16_small.toml")
    first = updated(cell, [], tmp_path)
    second = updated(first, [], tmp_path, ENTRY.model_copy(update={"recipe": "payload"}))
    third = updated(second, [], tmp_path, ENTRY.model_copy(update={"date": "2027-01-01 00:00 UTC"}))
    assert [(e.recipe, e.date[:4]) for e in third.tables.identified] == [("stiffness", "2027"), ("payload", "2026")]
    assert third.tables.identified[0].values == ENTRY.values


def test_what_is_made_rigid_or_stiffer_than_a_file_can_hold_stays_rigid(tmp_path: Path) -> None:
    cell = read_cell(EXAMPLES / "kr300_d16_small.toml")
    name = next(s.name for s in cell.robot.segments if np.any(s.compliance))
    for size in (0.0, 4e-20):
        found = updated(cell, [ElementCompliance(name, np.full(6, size))], tmp_path)
        assert not np.any(next(s for s in found.robot.segments if s.name == name).compliance)


def test_lists_of_tables_written_in_one_line(tmp_path: Path) -> None:
    text = demo("cell.toml").replace(
        'catalog = "kuka_kr300_r2500_ultra"',
        'catalog = "kuka_kr300_r2500_ultra"\nelastic = [{ segment = "axis1", rz_urad_per_knm = 400.0 }]  # mine',
    )
    (tmp_path / "cell.toml").write_text(text)
    cell = read_cell(tmp_path / "cell.toml")
    names = [s.name for s in cell.robot.segments]
    changes: list[Change] = [ElementCompliance(name, np.full(6, 3e-7)) for name in names[:3]]
    found = updated(cell, changes, tmp_path)
    for segment in found.robot.segments[:3]:
        np.testing.assert_allclose(segment.compliance, 3e-7, rtol=1e-9)
    assert "# mine" in (tmp_path / "new.toml").read_text()


@pytest.mark.parametrize(
    "law",
    [
        KienzleLaw(2.1e9, 0.26, 0.9e9, 0.35, -0.2e9, 0.1, 4e-5, 5e-6, 3e-4, "x", "measured", (1200.0, 800.0, 50.0)),
        LinearEdgeLaw(800e6, 300e6, 100e6, 1e4, 2e4, 1e3, 5e-6, 3e-4, "x", "measured"),
    ],
)
@pytest.mark.parametrize("catalog", [False, True])
def test_cutting_constants(law: KienzleLaw | LinearEdgeLaw, catalog: bool, tmp_path: Path) -> None:
    path = EXAMPLES / "kr300_d16_small.toml"
    if catalog:
        head, rest = path.read_text().split("[material]")
        own = 'catalog = "en-aw-7075-vdi22"\nkr_over_kc = 0.3\nka_over_kc = 0.1\n'
        (tmp_path / "c.toml").write_text(f"{head}[material]\n{own}\n[posture]{rest.split('[posture]')[1]}")
        path = tmp_path / "c.toml"
    found = updated(read_cell(path), [CuttingLaw(law)], tmp_path)
    h = np.geomspace(law.h_min_m, law.h_max_m, 20)
    np.testing.assert_allclose(found.force_law.edge_force(h), law.edge_force(h), rtol=1e-7, atol=1e-3)
    assert (found.force_law.h_min_m, found.force_law.h_max_m) == pytest.approx((law.h_min_m, law.h_max_m))


def test_plain_tables_and_paths_relative_to_the_new_folder(tmp_path: Path) -> None:
    source = (EXAMPLES / "kr300_d16_small.toml").read_text()
    box = "box_min_mm = [0, 0, 0]\nbox_max_mm = [60, 60, 40]\n"
    assert box in source
    (tmp_path / "a").mkdir()
    (tmp_path / "b" / "c").mkdir(parents=True)
    measured = "\n[dynamics]\nmode_hz = 8.5\ndamping_ratio = 0.1\n"
    (tmp_path / "a" / "cell.toml").write_text(source.replace(box, 'stl = "../blank.stl"\n') + measured)
    cell = read_cell(tmp_path / "a" / "cell.toml")
    change = TableValues("dynamics", {"mode_hz": 9.5})
    found = updated_text(cell, [change], ENTRY, tmp_path / "b" / "c")
    read = tomllib.loads(found)
    assert read["part"]["stock"]["stl"] == "../../blank.stl"
    assert read["dynamics"]["mode_hz"] == 9.5
    assert read["dynamics"]["damping_ratio"] == 0.1


def test_what_has_no_place_in_a_cell_file_is_refused(tmp_path: Path) -> None:
    cell = read_cell(EXAMPLES / "kr300_d16_small.toml")
    robot = cell.robot.segments[1].name
    for change in (ElementCompliance("nowhere", np.zeros(6)), BodyMass(robot, 10.0, np.zeros(3))):
        with pytest.raises(InputError):
            updated_text(cell, [change], ENTRY, tmp_path)
    soft = updated_text(cell, [ElementCompliance("spindle", np.full(6, 1.0))], ENTRY, tmp_path)
    with pytest.raises(FileFormatError, match="implausibly large"):
        check_update(soft, tmp_path / "x.toml")
