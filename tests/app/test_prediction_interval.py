"""A prediction says what it does not know: more for a catalogue cell than for a measured one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app import prediction_interval, unknowns
from counterflex.app.compensation.compensate import compensate
from counterflex.app.compensation.headline import worse_lines, worse_warnings
from counterflex.app.compensation.prediction import figures
from counterflex.app.cut_points import CutPoints, points_of_plan
from counterflex.app.inputs import read_job, setting_of
from counterflex.app.lowest_mode import at_largest_force
from counterflex.app.prediction_interval import (
    Foreseen,
    calibrated,
    calibration_of,
    expected_deflection,
    foreseen,
    sharp_corners,
    worse_text,
)
from counterflex.app.unknown_stiffness import Expected
from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.measured import IdentifiedTable, IdentifiedValue
from counterflex.path.toolpath import FEED, RAPID
from counterflex.plan.compensate import plan as make_plan
from counterflex.plan.plan import Plan, across
from counterflex.plan.sag_and_play import play_deviation
from counterflex.robot.model.class_prior import DrivePrior, drawn_play
from counterflex.robot.model.description import Play

EXAMPLES = Path(__file__).parents[2] / "examples"
PROGRAM = EXAMPLES / "programs" / "groove.ngc"


@pytest.fixture(scope="module")
def cell() -> Cell:
    return read_cell(EXAMPLES / "cells" / "kr300_d16_small.toml")


@pytest.fixture(scope="module")
def plan(cell: Cell) -> Plan:
    job = read_job(PROGRAM, cell)
    return make_plan(job.path, job.line_of_motion, cell.stock(), setting_of(cell), feeds=job.feeds)


def identified(cell: Cell, share: float) -> Cell:
    """The cell as if its stiffness and cutting constants had been identified with a relative standard deviation."""
    rows = tuple(
        IdentifiedValue(name=f"{name}.rz", value=500.0, sigma=500.0 * share, unit="urad/kNm")
        for name in cell.chain.names
    )
    entries = tuple(
        IdentifiedTable(recipe=recipe, date="", data=(), data_sha256=(), counterflex="", holdout="", values=values)
        for recipe, values in (("stiffness", rows), ("cutting", ()))
    )
    return replace(cell, tables=cell.tables.model_copy(update={"identified": entries}))


def found(plan: Plan, cell: Cell) -> Foreseen:
    """Of a plan that has one."""
    result = foreseen(plan, cell)
    assert result is not None
    return result


def intervals(plan: Plan, cell: Cell) -> dict[str, Expected]:
    """Both errors by name."""
    result = found(plan, cell)
    return {"nominal": result.nominal, "compensated": result.compensated}


def width(one: Expected) -> float:
    return one.high_m - one.low_m


def test_a_calibration_moves_the_ends_in_logarithms_and_leaves_the_median() -> None:
    drawn = np.array([0.2, 0.4, 0.6])
    np.testing.assert_allclose(calibrated(drawn, (1.0, 1.0)), drawn, rtol=1e-15)
    np.testing.assert_allclose(calibrated(drawn, (0.5, 2.0)), [0.4 / 2.0**0.5, 0.4, 0.4 * 1.5**2], rtol=1e-15)
    assert not calibrated(np.zeros(3), (0.5, 2.0)).any()


def test_the_calibration_of_the_catalogue_is_taken_by_no_other_level(cell: Cell, plan: Plan) -> None:
    factors, drawn = calibration_of(cell), foreseen(plan, cell, as_drawn=True)
    assert factors is not None
    assert drawn is not None
    for name, (low, high) in (("nominal", factors.before), ("compensated", factors.after)):
        told, one = intervals(plan, cell)[name], getattr(drawn, name)
        assert told.median_m == pytest.approx(one.median_m, rel=1e-3)
        assert told.low_m == pytest.approx(one.median_m * (one.low_m / one.median_m) ** low, rel=1e-3)
        assert told.high_m == pytest.approx(one.median_m * (one.high_m / one.median_m) ** high, rel=1e-3)
    measured = identified(cell, 0.02)
    by_class = read_cell(EXAMPLES / "cells" / "irb6640_d16.toml", assume_class=True)
    assert calibration_of(measured) is None
    assert calibration_of(by_class) is None
    assert found(plan, measured) == foreseen(plan, measured, as_drawn=True)


def test_what_was_measured_is_predicted_more_narrowly(cell: Cell, plan: Plan) -> None:
    catalogue, measured = intervals(plan, cell), intervals(plan, identified(cell, 0.02))
    for name in ("nominal", "compensated"):
        assert width(measured[name]) < 0.7 * width(catalogue[name])
    assert measured["compensated"].high_m < catalogue["compensated"].high_m


def test_the_uncompensated_error_lies_in_its_interval_and_doubled_force_beyond_a_measured_one(
    cell: Cell, plan: Plan
) -> None:
    size = np.linalg.norm(across(plan.deviation_nominal_part, plan.path.p_part_tcp), axis=1)[plan.cutting]
    inside = intervals(plan, cell)["nominal"]
    assert inside.low_m < np.quantile(size, 0.997) < inside.high_m
    narrow = intervals(plan, identified(cell, 0.02))["nominal"]
    assert 2.0 * np.quantile(size, 0.997) > narrow.high_m


def test_nothing_unknown_leaves_the_prediction_itself(cell: Cell, plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("STRUCTURE", "DRIVES", "SWING"):
        monkeypatch.setattr(prediction_interval, name, 0.0)
    monkeypatch.setattr(prediction_interval, "sources", lambda *_: [])
    monkeypatch.setattr(DrivePrior, "yield_log_sigma", 0.0)
    for name, deviation in (
        ("nominal", plan.deviation_nominal_part),
        ("compensated", plan.deviation_compensated_part),
    ):
        one = intervals(plan, cell)[name]
        p = plan.path.p_part_tcp
        size = np.linalg.norm(across(deviation, p), axis=1)[plan.judged]
        length = np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1)[plan.judged]
        of_length = np.quantile(size, 0.997, weights=length, method="inverted_cdf")
        assert width(one) < 1e-12
        assert one.median_m == pytest.approx(of_length, rel=0.05)


@pytest.mark.parametrize("spread", [0.3, 0.6])
def test_probability_of_worse_of_one_linear_unknown(
    cell: Cell, plan: Plan, monkeypatch: pytest.MonkeyPatch, spread: float
) -> None:
    """All deflection off by one factor x: worse than none where x < 1/2."""
    for name in ("STRUCTURE", "DRIVES", "SWING"):
        monkeypatch.setattr(prediction_interval, name, 0.0)
    monkeypatch.setattr(DrivePrior, "yield_log_sigma", 0.0)
    x = np.exp(spread * np.random.default_rng(8).standard_normal(1000))
    exact = replace(
        plan, deviation_nominal_part=plan.deflection_part[:, :3],
        deviation_compensated_part=np.zeros_like(plan.deviation_compensated_part),
    )  # fmt: skip

    def scaling(_: Cell, points: CutPoints) -> list[unknowns.DisplacementSource]:
        d = plan.deflection_part[points.row, :3] @ cell.T_base_part[:3, :3].T
        return [unknowns.DisplacementSource("force", "test", (x - 1.0)[:, None, None] * d, "cutting")]

    monkeypatch.setattr(prediction_interval, "sources", scaling)
    assert found(exact, cell).worse_share == pytest.approx(np.mean(x < 0.5), abs=0.002)


def test_nine_of_ten_robots_of_the_class_lose_what_the_interval_of_play_holds(cell: Cell, plan: Plan) -> None:
    """Play and friction drawn and followed along the path with their memory, against a twist at each point."""
    points, given = points_of_plan(plan, cell, "x"), cell.class_drives
    assert points is not None
    assert given is not None
    (one,) = [source for source in unknowns.sources(cell, points) if source.name.startswith("play")]
    assert one.displacements is not None
    low, high = np.quantile(points.sizes(one.displacements), [0.05, 0.95])
    chain, setting = given.given_to(cell.chain, servo=False), setting_of(cell)
    assert chain.play is not None
    rows = [row for row in chain.play if row is not None]
    relative, mode = setting.relative_motion(plan.path), at_largest_force(cell, plan).mode

    def lost(play: Sequence[Play]) -> Float:
        path, tuned = plan.path, replace(chain, play=tuple(play))
        d = play_deviation(tuned, relative, path.p_part_tcp, plan.q, plan.w_tcp_part, path.time_s, None, mode)
        return d[points.row] @ cell.T_base_part[:3, :3].T

    bands, friction = drawn_play(200, 5)
    sizes = []
    for band, dry in zip(bands.tolist(), friction.tolist(), strict=True):
        drawn = zip(rows, band, dry, strict=True)
        play = [replace(row, half_band_rad=b, friction_nm=(f * row.friction_nm[0],)) for row, b, f in drawn]
        sizes.append(points.sizes((lost(play) - lost(rows))[None])[0])
    held = np.mean((low <= np.array(sizes)) & (np.array(sizes) <= high))
    assert 0.85 <= held <= 0.95


def test_a_larger_spread_is_a_wider_interval(cell: Cell, plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    before = intervals(plan, cell)
    monkeypatch.setattr(unknowns, "HANDBOOK", 2.0 * unknowns.HANDBOOK)
    after = intervals(plan, cell)
    for name in before:
        assert width(after[name]) > 1.2 * width(before[name])


def test_a_plan_of_a_stiffer_cell_is_judged_as_the_linear_sum_says(cell: Cell, plan: Plan) -> None:
    """All compliances off by a fifth, planned anew, against the deflection scaled: what the draws assume."""
    job = read_job(PROGRAM, cell)
    softer = replace(cell.chain, compliance=1.2 * cell.chain.compliance)
    other = make_plan(job.path, job.line_of_motion, cell.stock(), setting_of(cell, chain=softer), predict=False)
    same = make_plan(job.path, job.line_of_motion, cell.stock(), setting_of(cell), predict=False)
    off = other.deflection_part[same.cutting, :3] - same.deflection_part[same.cutting, :3]
    np.testing.assert_allclose(
        off, 0.2 * same.deflection_part[same.cutting, :3], atol=5e-7
    )  # 0.5 um: large displacements


def test_a_mirrored_force_gives_a_mirrored_interval(cell: Cell, plan: Plan) -> None:
    """Every draw of what the force makes turns its sign, what play leaves stays, and so all ends keep their size."""
    points = points_of_plan(plan, cell, "x")
    assert points is not None
    some = slice(None, None, 25)
    few = replace(
        points, q=points.q[some], w_tcp_base=points.w_tcp_base[some], feed_base=points.feed_base[some],
        weight_m=points.weight_m[some], row=points.row[some],
    )  # fmt: skip
    other = replace(few, w_tcp_base=-few.w_tcp_base)
    signs = set()
    for known in (cell, identified(cell, 0.02)):
        for one, turned in zip(unknowns.sources(known, few), unknowns.sources(known, other), strict=True):
            assert (one.name, one.known_from) == (turned.name, turned.known_from)
            if one.displacements is None or turned.displacements is None:
                assert one.displacements is turned.displacements
                continue
            sign = 1.0 if one.name.startswith("play") else -1.0
            signs.add(sign)
            np.testing.assert_allclose(turned.displacements, sign * one.displacements, atol=1e-15)
    assert signs == {1.0, -1.0}
    ends = [(e.median_m, e.low_m, e.high_m) for e in (expected_deflection(cell, few), expected_deflection(cell, other))]
    assert ends[1] == pytest.approx(ends[0], rel=0.06)
    back = replace(
        plan, w_tcp_part=-plan.w_tcp_part, deflection_part=-plan.deflection_part,
        deviation_nominal_part=-plan.deviation_nominal_part,
        deviation_compensated_part=-plan.deviation_compensated_part,
    )  # fmt: skip
    for name, before in intervals(plan, cell).items():
        after = intervals(back, cell)[name]
        for end in ("median_m", "low_m", "high_m"):
            assert getattr(after, end) == pytest.approx(getattr(before, end), rel=0.12)


def test_the_summary_holds_both_ends(cell: Cell) -> None:
    prediction = compensate(PROGRAM, cell).summary["prediction"]
    for name in ("nominal", "compensated"):
        low, high = prediction[f"predicted_{name}"]["p997_90_mm"]
        assert 0.0 < low < high
    bare = compensate(PROGRAM, cell, predict=False).summary["prediction"]
    assert "predicted_nominal" not in bare


def test_compensation_by_too_much_is_probably_worse_and_by_nothing_never(cell: Cell, plan: Plan) -> None:
    """Three times the correction leaves twice the deflection on the other side; none leaves what there was."""
    assert found(plan, cell).worse_share < 0.1
    none = replace(plan, deviation_compensated_part=plan.deviation_nominal_part)
    assert found(none, cell).worse_share == 0.0
    thrice = replace(plan, deviation_compensated_part=-2.0 * plan.deviation_nominal_part)
    assert found(thrice, cell).worse_share > 0.5
    sure = found(thrice, identified(cell, 0.02)).worse_share
    assert sure > found(thrice, cell).worse_share
    assert [worse_text(share) for share in (0.0, 0.017, 0.5, 1.0)] == ["below 0.1 %", "1.7 %", "50 %", "above 99.9 %"]


def test_lines_that_get_worse_are_named_with_both_errors(plan: Plan) -> None:
    size = np.linalg.norm(across(plan.deviation_nominal_part, plan.path.p_part_tcp), axis=1)
    row = int(np.argmax(np.where(plan.cutting, size, 0.0)))
    line = int(plan.line[row])
    worse = np.where((plan.line == line)[:, None], 2.0, 0.5) * plan.deviation_nominal_part
    named = worse_lines(replace(plan, deviation_compensated_part=worse))
    assert [one["line"] for one in named] == [line]
    assert named[0]["before_mm"] == pytest.approx(size[row] / MM, abs=1e-4)
    assert named[0]["after_mm"] == pytest.approx(2.0 * size[row] / MM, abs=1e-4)
    assert f"line {line}" in worse_warnings(named)[0]
    assert worse_lines(replace(plan, deviation_compensated_part=0.5 * plan.deviation_nominal_part)) == []


def test_a_swing_is_drawn_larger_and_smaller_and_what_stays_is_not(
    cell: Cell, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sine at the lowest mode scales by the lognormal factor, ``exp(+-1.645 SWING)``; a constant does not move."""
    for name in ("STRUCTURE", "DRIVES"):
        monkeypatch.setattr(prediction_interval, name, 0.0)
    monkeypatch.setattr(prediction_interval, "sources", lambda *_: [])
    monkeypatch.setattr(DrivePrior, "yield_log_sigma", 0.0)
    monkeypatch.setattr(prediction_interval, "calibration_of", lambda _: None)
    hz, up = at_largest_force(cell, plan).mode.hz, np.array([0.0, 0.0, 1.0])
    swing = 0.2 * MM * np.sin(2.0 * np.pi * hz * plan.path.time_s)[:, None] * up
    one = intervals(replace(plan, deviation_compensated_part=swing), cell)["compensated"]
    wide = np.exp(1.645 * prediction_interval.SWING)
    assert one.median_m == pytest.approx(0.2 * MM, rel=0.05)
    assert one.high_m / one.median_m == pytest.approx(wide, rel=0.1)
    assert one.median_m / one.low_m == pytest.approx(wide, rel=0.1)
    still = np.full_like(swing, 0.2 * MM) * up
    one = intervals(replace(plan, deviation_compensated_part=still), cell)["compensated"]
    assert width(one) < 1e-6 * MM


def test_a_pass_that_cuts_what_the_bent_tool_left_counts(cell: Cell, tmp_path: Path) -> None:
    """Back through the groove at high feed: nothing is left to cut as programmed, but the bent tool left some."""
    program = tmp_path / "there_and_back.ngc"
    text = PROGRAM.read_text(encoding="utf-8")
    program.write_text(text.replace("G1 X72 F1500", "G1 X72 F1500\nG1 X-12 F6000"), encoding="utf-8")
    job = read_job(program, cell)
    made = make_plan(job.path, job.line_of_motion, cell.stock(), setting_of(cell), feeds=job.feeds)
    assert made.recut is not None
    again = made.recut & (made.path.feed_m_s > 0.09)
    assert np.count_nonzero(again) > 50
    assert not np.any(made.cutting & again)
    moves = np.linalg.norm(np.diff(made.path.p_part_tcp, axis=0, prepend=made.path.p_part_tcp[:1]), axis=1) > 0.0
    assert np.all(moves[made.recut])
    size = np.linalg.norm(across(made.deviation_compensated_part, made.path.p_part_tcp), axis=1)
    told = figures(made)["predicted_compensated"]
    assert told["max_mm"] == pytest.approx(size[made.cutting | made.recut].max() / MM, abs=1e-4)
    assert size[again].max() > size[made.cutting].max()
    assert intervals(made, cell)["compensated"].median_m > 0.9 * np.quantile(size[again], 0.95)


def test_corners_that_the_range_does_not_cover_are_counted(cell: Cell, plan: Plan) -> None:
    """Straight cuts have none; of a square path in the cut each turn of 90 degrees is one, of 20 degrees none."""
    assert sharp_corners(plan) == 0
    for turn_deg, expected in ((90.0, 1), (29.0, 0), (31.0, 1), (180.0, 1)):
        n, half = len(plan.path), len(plan.path) // 2
        heading = np.radians(turn_deg) * (np.arange(n) > half)
        p = np.cumsum(np.stack([np.cos(heading), np.sin(heading), 0.0 * heading], axis=1), axis=0)
        path = replace(plan.path, p_part_tcp=p, kind=np.full(n, FEED))
        made = replace(plan, path=path, volume_m3=np.ones(n))
        assert sharp_corners(made) == expected
        behind: Float = (np.arange(n) > half).astype(np.float64)
        assert sharp_corners(replace(made, volume_m3=behind)) == 0  # entered at the corner
        cut_off = path.kind.copy()
        cut_off[half] = RAPID
        assert sharp_corners(replace(made, path=replace(path, kind=cut_off))) == 0
