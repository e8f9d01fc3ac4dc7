"""What a cell does not know is ranked by what it leaves, and what was measured leaves less."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.app import unknowns as room
from counterflex.app.compensation.compensate import compensate
from counterflex.app.cut_points import CutPoints, corner_points, points_of_plan
from counterflex.app.lowest_mode import identified_sigma
from counterflex.app.prediction_interval import foreseen
from counterflex.app.questions import check_cell
from counterflex.app.unknown_stiffness import ROBOTS, Expected, cost_at_blank
from counterflex.app.unknowns import HANDBOOK, CellUnknown, first_measurement, unknowns
from counterflex.core.arrays import Float
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.measured import IdentifiedTable, IdentifiedValue
from counterflex.robot.elasticity import compliance
from counterflex.robot.elasticity.chain import jacobian
from counterflex.robot.model.class_prior import HALF_BAND_RAD
from counterflex.robot.model.description import Play

EXAMPLES = Path(__file__).parents[2] / "examples"
ABB, KUKA = (EXAMPLES / "cells" / f"{name}.toml" for name in ("irb6640_d16", "kr300_d16_small"))


def named(cell: Cell, points: CutPoints | None = None) -> dict[str, CellUnknown]:
    return {one.name: one for one in unknowns(cell, corner_points(cell) if points is None else points)}


def replace_values(entry: IdentifiedTable, rows: tuple[IdentifiedValue, ...]) -> IdentifiedTable:
    return entry.model_copy(update={"values": rows})


def median_mm(one: CellUnknown) -> float:
    assert one.cost is not None
    return 1e3 * one.cost.median_m


def with_identified(cell: Cell, recipe: str, values: dict[str, float] | None = None) -> Cell:
    """The cell after an identification: relative standard deviations by name."""
    rows = tuple(
        IdentifiedValue(name=name, value=500.0, sigma=500.0 * share, unit="urad/kNm")
        for name, share in (values or {}).items()
    )
    entry = IdentifiedTable(recipe=recipe, date="", data=(), data_sha256=(), counterflex="", holdout="", values=rows)
    tables = cell.tables.model_copy(update={"identified": (*cell.tables.identified, entry)})
    return replace(cell, tables=tables)


@settings(max_examples=30)
@given(st.lists(st.tuples(st.sampled_from("abc"), st.none() | st.floats(1e-6, 1e-3)), min_size=1, max_size=8))
def test_what_is_measured_first_takes_away_the_most(costs: list[tuple[str, float | None]]) -> None:
    """Independent unknowns of one measurement add as squares; the figures are shown in their places."""
    ranked = [
        CellUnknown(f"{k}", "-", None if m is None else Expected(m, 0.5 * m, 3.0 * m, "x"), f"{recipe} --propose 9")
        for k, (recipe, m) in enumerate(costs)
    ]
    total = {name: np.sqrt(sum(m**2 for r, m in costs if r == name and m is not None)) for name in "abc"}
    points = CutPoints(np.zeros((1, 6)), np.zeros((1, 6)), np.zeros((1, 3)), np.ones(1), "here", np.zeros(1, int))
    answer = room.shown(ranked, points, "cell.toml")
    assert answer["where"] == "here"
    for row, (_, m) in zip(answer["rows"], costs, strict=True):
        assert row["leaves_mm"] == (None if m is None else round(1e3 * m, 3))
        assert row["of_90_percent_mm"] == (None if m is None else [round(500.0 * m, 3), round(3e3 * m, 3)])
    first = answer["measure_first"]
    if not any(total.values()):
        assert first is None
        return
    best = max(total.values())
    assert (first["removes_mm"], first["up_to_mm"]) == pytest.approx((1e3 * best, 3e3 * best), abs=6e-4)
    assert total[first["command"].split()[2]] == pytest.approx(best)
    assert first["command"].split()[3:5] == ["--propose", "9"]


def test_the_most_expensive_comes_first_and_says_what_to_measure() -> None:
    answer = check_cell(str(ABB))["unknowns"]
    known = [row["leaves_mm"] for row in answer["rows"] if row["leaves_mm"] is not None]
    assert known == sorted(known, reverse=True)
    assert answer["rows"][0]["unknown"] == "stiffness of A1, A2, A3, A4, A5, A6"
    assert answer["rows"][0]["known_from"] == "nothing; by the class prior"
    command = answer["measure_first"]["command"].split()
    assert command[:5] == ["counterflex", "identify", "stiffness", "--propose", "30"]
    assert Path(command[command.index("--cell") + 1]).name == "irb6640_d16.toml"
    cost = cost_at_blank(read_cell(ABB))
    assert cost is not None
    assert answer["rows"][0]["leaves_mm"] == pytest.approx(1e3 * cost.median_m, abs=1e-3)


def test_in_the_cut_of_a_program_the_force_is_that_of_the_cut() -> None:
    at_corner = check_cell(str(ABB))["unknowns"]
    in_cut = check_cell(str(ABB), EXAMPLES / "programs" / "groove.ngc")["unknowns"]
    assert "in groove.ngc" in in_cut["where"]
    assert 0.1 < in_cut["rows"][0]["leaves_mm"] < at_corner["rows"][0]["leaves_mm"]


def test_the_class_assumed_leaves_less_than_nothing_known() -> None:
    axes = "stiffness of A1, A2, A3, A4, A5, A6"
    rigid, assumed = named(read_cell(ABB)), named(read_cell(ABB, assume_class=True))
    assert median_mm(assumed[axes]) < 0.7 * median_mm(rigid[axes])
    assert assumed[axes].known_from == "class prior: its median"


def test_what_was_identified_leaves_less() -> None:
    cell = read_cell(KUKA)
    before = named(cell)
    sigma = {f"{name}.rz": 0.03 for name in cell.chain.names}
    after = named(with_identified(with_identified(cell, "stiffness", sigma), "cutting"))
    for name in ("stiffness of the robot", "stiffness of the end effector", "cutting force"):
        assert median_mm(after[name]) < 0.3 * median_mm(before[name])
        assert after[name].known_from == "identified"


def test_a_stiff_direction_that_the_data_hardly_show_does_not_make_its_segment_unknown() -> None:
    """The ledger of real pulls showed intervals up to 64 mm of 2 mm: axis 2 about y, 1.6 +- 110 urad/kNm."""
    cell = with_identified(read_cell(KUKA), "stiffness", {"axis2.rz": 0.1})
    alone = identified_sigma(cell)["axis2"]
    (entry,) = cell.tables.identified
    stiff = entry.values[0].model_copy(update={"name": "axis2.ry", "value": 1.6, "sigma": 110.0})
    both = entry.model_copy(update={"values": (*entry.values, stiff)})
    tables = cell.tables.model_copy(update={"identified": (both,)})
    assert alone == pytest.approx(0.1)
    assert identified_sigma(replace(cell, tables=tables))["axis2"] == pytest.approx(np.hypot(50.0, 110.0) / 501.6)


def test_handbook_force_is_its_share_of_the_deflection(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lognormal of relative deviation s: the median of what it leaves is about 0.67 s of the whole deflection."""
    monkeypatch.setattr(room, "WORN", 0.0)
    cell = read_cell(KUKA)
    points = corner_points(cell)
    C = compliance.cartesian_compliance(cell.chain, points.q[0])[:3, :3]
    whole_mm = 1e3 * 500.0 * np.linalg.norm(C, axis=0).max()
    assert median_mm(named(cell)["cutting force"]) == pytest.approx(0.67 * HANDBOOK * whole_mm, rel=0.1)


def test_a_tool_may_be_worn_where_the_force_is_that_of_a_handbook(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only more force, half of the most on average; nothing of it in constants that were identified."""
    cell = read_cell(KUKA)
    points = corner_points(cell)
    whole = compliance.shares(cell.chain, points.q, points.w_tcp_base)[..., :3].sum(axis=1)

    def force(of: Cell) -> Float:
        (one,) = [source for source in room.sources(of, points) if source.name == "cutting force"]
        assert one.displacements is not None
        return one.displacements

    monkeypatch.setattr(room, "HANDBOOK", 1e-9)
    more = np.einsum("rnd,nd->r", force(cell), whole) / np.sum(whole**2)
    assert np.all(more > -1e-6)
    assert np.all(more < room.WORN)
    assert np.mean(more) == pytest.approx(0.5 * room.WORN, rel=0.05)
    measured = force(with_identified(cell, "cutting"))
    monkeypatch.setattr(room, "WORN", 0.0)
    np.testing.assert_array_equal(force(with_identified(cell, "cutting")), measured)


def test_play_is_unknown_of_the_axes_that_have_no_row() -> None:
    cell = read_cell(ABB)
    assert "play and friction of A1, A2, A3, A4, A5, A6" in named(cell)
    rows = (Play(), None, Play(), Play(), None, Play())
    assert "play and friction of A2, A5" in named(replace(cell, chain=replace(cell.chain, play=rows)))


def test_play_of_the_class_leaves_what_the_plan_does_not_take(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing, of a robot that loses what its class does; twice the play and friction leave what the plan takes."""
    cell = read_cell(KUKA)
    points, taken = corner_points(cell), cell.planning_chain.play
    assert taken is not None

    def left(times: float, planned: bool = True) -> Float:
        drawn = np.full((ROBOTS, 6), times)
        monkeypatch.setattr(room, "drawn_play", lambda *_: (HALF_BAND_RAD * drawn, drawn))
        (one,) = [source for source in room.sources(cell, points, planned=planned) if source.name.startswith("play")]
        assert one.displacements is not None
        return one.displacements

    assert not np.any(left(1.0))
    soft = cell.chain.compliance[cell.chain.torsion, 5]
    twist = [
        row.half_band_rad + k * sum(row.friction_nm) for row, k in zip(taken, soft, strict=True) if row is not None
    ]
    columns = jacobian(cell.chain, points.q)[..., :3, :]
    np.testing.assert_allclose(
        np.mean(left(2.0) ** 2, axis=0), np.sum((columns * twist) ** 2, axis=2), rtol=0.2, atol=1e-12
    )
    np.testing.assert_allclose(left(1.0, planned=False), left(2.0), atol=1e-15)


def test_what_the_identification_of_play_left_open_is_a_twist_of_the_axis() -> None:
    """Half of the dead band and the slip angle of axis 1, 3 and 4 urad: a twist of 5 urad by the lever of the axis."""
    cell = read_cell(KUKA)
    points = corner_points(cell)
    rows = tuple(
        IdentifiedValue(name=name, value=0.03, sigma=sigma, unit="mrad")
        for name, sigma in (("axis1.half_band", 0.003), ("axis1.slip2", 0.004), ("axis1.delay", 9.0))
    )
    known = with_identified(cell, "play")
    (entry,) = known.tables.identified
    known = replace(known, tables=cell.tables.model_copy(update={"identified": (replace_values(entry, rows),)}))
    (one,) = [source for source in room.sources(known, points) if source.known_from == "identified"]
    assert one.name == "play and friction of A1"
    assert one.displacements is not None
    lever = jacobian(cell.chain, points.q)[..., :3, 0]
    got = np.std(one.displacements, axis=0) / 5e-6
    np.testing.assert_allclose(got, np.abs(lever), rtol=0.08, atol=1e-9)


def test_measurements_add_up_by_recipe() -> None:
    found = unknowns(read_cell(ABB), corner_points(read_cell(ABB)))
    first = first_measurement(found)
    assert first is not None
    costs = [one.cost.median_m for one in found if one.cost is not None and one.recipe == first[0]]
    assert len(costs) == 2
    assert first[1].median_m == pytest.approx(np.linalg.norm(costs))


def test_a_cell_for_calibration_only_is_not_judged(tmp_path: Path) -> None:
    file = tmp_path / "cell.toml"
    file.write_text(ABB.read_text(encoding="utf-8").partition("[part]")[0], encoding="utf-8")
    assert check_cell(str(file))["unknowns"] is None


def test_a_plan_on_the_class_leaves_all_that_is_not_known() -> None:
    """Not its stiffness alone: play, friction and force add to what remains, and some robots become worse."""
    cell = read_cell(ABB, assume_class=True)
    plan = compensate(EXAMPLES / "programs" / "groove.ngc", cell).plan
    points, left = points_of_plan(plan, cell, "groove.ngc"), foreseen(plan, cell)
    assert points is not None
    assert left is not None
    alone = named(cell, points)["stiffness of A1, A2, A3, A4, A5, A6"]
    assert left.compensated.median_m > 1.3e-3 * median_mm(alone)
    assert 0.0 < left.worse_share < 0.5
