"""Laws of the figures that people are shown: weight by length, sign, worst of both sides, order, pieces of a record."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st
from scipy import stats

from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.error_budget import error_budget
from counterflex.evaluate.features import FeatureRow
from counterflex.evaluate.figures import DeviationFigures, reduction
from counterflex.evaluate.incidents import IncidentFinder
from counterflex.evaluate.loop_timing import LatencyHistogram, Percentiles
from counterflex.evaluate.measured_values import flatness, values_row
from counterflex.evaluate.missing_cycles import MissingFinder
from counterflex.evaluate.path_deviation import entry_exit
from counterflex.evaluate.process_record import ProcessRecord
from counterflex.evaluate.run_curves import RunCurves, curves_of, deviations, figures, needed_of, trend
from counterflex.runtime import record_ring as record
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.state.supervisor import Cause, State

size = st.floats(-1e-3, 1e-3, allow_nan=False)
length = st.floats(1e-5, 1e-2)
rows_of_path = st.lists(st.tuples(size, length), min_size=1, max_size=30)
seed = st.integers(0, 2**31)


def values(figure: Any) -> tuple[float, ...]:
    return figure.max_m, figure.p997_m, figure.rms_m, figure.extent


@given(rows_of_path, st.integers(0, 29), st.floats(0.01, 0.99))
def test_figures_do_not_see_how_a_path_is_divided(rows: list[tuple[float, float]], at: int, share: float) -> None:
    """A stretch cut in two uneven pieces of the same deviation leaves every figure as it was."""
    d, w = np.array(rows).T
    at %= len(d)
    weights = np.insert(w, at, share * w[at])
    weights[at + 1] *= 1.0 - share
    whole, divided = DeviationFigures.weighted(d, w), DeviationFigures.weighted(np.insert(d, at, d[at]), weights)
    assert values(divided) == pytest.approx(values(whole), rel=1e-9, abs=1e-18)


@given(rows_of_path, st.integers(0, 30))
def test_rows_without_length_count_for_nothing(rows: list[tuple[float, float]], at: int) -> None:
    d, w = np.array(rows).T
    at %= len(d) + 1
    with_point = DeviationFigures.weighted(np.insert(d, at, 1.0), np.insert(w, at, 0.0))
    assert values(with_point) == pytest.approx(values(DeviationFigures.weighted(d, w)), rel=1e-12)


@given(rows_of_path, st.floats(0.1, 10.0), seed)
def test_figures_follow_size_not_sign_nor_order(rows: list[tuple[float, float]], factor: float, number: int) -> None:
    d, w = np.array(rows).T
    order = np.random.default_rng(number).permutation(len(d))
    whole, other = DeviationFigures.weighted(d, w), DeviationFigures.weighted(-factor * d[order], w[order])
    assert values(other)[:3] == pytest.approx([factor * v for v in values(whole)[:3]], rel=1e-9, abs=1e-18)
    assert whole.rms_m**2 * whole.extent == pytest.approx(float(np.sum(w * d**2)), rel=1e-9, abs=1e-30)
    assert whole.max_m >= whole.p997_m


@given(st.floats(1e-6, 1e-3), st.floats(0.0, 2.0))
def test_a_reduction_is_what_does_not_remain(before: float, remains: float) -> None:
    found = reduction(remains * before, before)
    assert found == pytest.approx(1.0 - remains, abs=1e-12)


@given(st.floats(1e-3, 1e-1), st.floats(-1e-3, 1e-3), st.floats(1e-6, 1e-3), st.booleans())
def test_too_small_is_as_wrong_as_too_large(nominal: float, off: float, tolerance: float, grows: bool) -> None:
    """A deviation and its mirror image are in tolerance together, and leave material with opposite signs."""
    assume(abs(abs(off) - tolerance) > 1e-12)
    one, other = (
        FeatureRow("bore 1", "diameter", nominal, {"part": nominal + d}, {}, tolerance, "given", grows=grows)
        for d in (off, -off)
    )
    assert one.ok("part") == other.ok("part") == (abs(off) <= tolerance)
    assert one.material_left_m("part") == pytest.approx(-other.material_left_m("part"), abs=1e-15)
    assert one.material_left_m("part") == pytest.approx(off if grows else -off, abs=1e-15)


@given(st.lists(st.floats(-1e-3, 1e-3), min_size=1, max_size=20), st.integers(0, 5), st.floats(1e-3, 1e-1))
def test_the_worst_value_is_the_farthest_on_either_side(off: list[float], missing: int, nominal: float) -> None:
    assume(len({round(abs(v), 9) for v in off}) == len(off))
    for sign in (1.0, -1.0):
        measured = np.concatenate([nominal + sign * np.array(off), np.full(missing, np.nan)])
        _, _, _, worst, mean, share = values_row("width", nominal, nominal, {"part": measured})
        assert worst["part"] == pytest.approx(nominal + sign * max(off, key=abs), abs=1e-15)
        assert mean["part"] == pytest.approx(nominal + sign * float(np.mean(off)), abs=1e-15)
        assert share["part"] == pytest.approx(len(off) / (len(off) + missing))


def test_nothing_measured_has_no_worst_value_and_no_share() -> None:
    _, _, _, worst, mean, share = values_row("width", 0.01, 0.01, {"part": np.full(4, np.nan)})
    assert (worst, mean, share) == ({}, {}, {"part": 0.0})


@given(st.lists(st.none() | st.floats(-1.0, 1.0), min_size=5, max_size=30), st.booleans())
def test_a_trend_is_the_line_of_least_squares_over_the_runs(scatter: list[float | None], falls: bool) -> None:
    """Runs without the figure keep their place; a falling trend is as clear as a rising one."""
    slope = -3.0 if falls else 3.0
    runs = [None if v is None else 10.0 + slope * k + v for k, v in enumerate(scatter)]
    known = [(k, v) for k, v in enumerate(runs) if v is not None]
    found = trend(runs)
    if len(known) < 4:
        assert found is None
        return
    line = stats.linregress(*zip(*known, strict=True))
    x, y = np.array(
        known, dtype=float
    ).T  # from the residuals: the other library takes 1 - r**2, which is rounding on a line
    rest = float(np.sum((y - line.intercept - line.slope * x) ** 2)) / (len(known) - 2)
    wide = float(np.sqrt(rest / np.sum((x - x.mean()) ** 2))) * float(stats.t.ppf(0.975, len(known) - 2))
    assert found is not None
    assert found.runs == len(known)
    assert found.slope == pytest.approx(line.slope, abs=1e-9)
    assert found.half_width == pytest.approx(wide, rel=1e-6, abs=1e-7)
    assert found.mean == pytest.approx(float(np.mean([v for _, v in known])))
    mirrored = trend([None if v is None else -v for v in runs])
    assert mirrored is not None
    assert mirrored.clear == found.clear == (abs(line.slope) > wide)


@given(st.lists(st.floats(0.1, 5.0), min_size=2, max_size=120), st.floats(2e-4, 3e-3))
def test_entry_and_exit_change_places_with_the_direction(level: list[float], radius_m: float) -> None:
    engagement, n = np.array(level), len(level)
    entry, leave = entry_exit([(0, n)], engagement, 1e-4, radius_m)
    back_entry, back_leave = entry_exit([(0, n)], engagement[::-1], 1e-4, radius_m)
    assert not np.any(entry & leave)
    if entry.sum() + leave.sum() < n:  # else the two share what there is
        np.testing.assert_array_equal(back_entry[::-1], leave)
        np.testing.assert_array_equal(back_leave[::-1], entry)


def test_a_slow_entry_is_longer_than_a_sharp_exit() -> None:
    rise = np.concatenate([np.linspace(0.0, 1.0, 20), np.ones(200)])
    entry, leave = entry_exit([(0, 220)], rise, 1e-4, 1e-3)
    assert (entry.sum(), leave.sum()) == (19, 10)  # 95 % is reached in the 20th station; a radius at the least


@given(seed, st.integers(2, 5))
def test_shares_of_an_error_budget_add_up_to_one(number: int, count: int) -> None:
    rng = np.random.default_rng(number)
    met = rng.normal(size=(50, 3))
    parts = {f"part {k}": rng.normal(size=(50, 3)) for k in range(count)}
    lines = error_budget(met, parts)
    assert sum(line.share for line in lines) == pytest.approx(1.0)
    assert sum(line.mean_m for line in lines) == pytest.approx(float(np.linalg.norm(met, axis=1).mean()))
    for line, part in zip(lines, parts.values(), strict=False):
        length = np.linalg.norm(part, axis=1)
        assert (line.max_m, line.rms_m) == pytest.approx((length.max(), math.sqrt(np.mean(length**2))))
        along = np.sum(part * met / np.linalg.norm(met, axis=1)[:, None])
        assert line.share == pytest.approx(along / np.linalg.norm(met, axis=1).sum())


@given(st.lists(st.floats(0.02, 1e7), min_size=1, max_size=300), st.floats(0.01, 1.0))
def test_a_counted_percentile_is_at_most_a_hundredth_above_the_sorted_one(times: list[float], share: float) -> None:
    counted = LatencyHistogram()
    counted.add(np.array(times[: len(times) // 2]))
    counted.add(np.array(times[len(times) // 2 :]))
    true = sorted(times)[math.ceil(share * len(times) - 1e-9) - 1]
    assert true * (1.0 - 1e-9) <= counted.at(share) <= min(true * 1.0101, max(times) * (1.0 + 1e-9))
    assert counted.at(1.0) == pytest.approx(max(times))


def test_lost_replies_are_late_in_every_percentile() -> None:
    found = Percentiles.of(np.array([1.0, 2.0, np.nan, np.nan]))
    assert (found.p50_s, found.p99_s, found.max_s, found.n) == (2.0, math.inf, math.inf, 4)


def log(states: list[int], cycles: list[int], speeds: list[float]) -> Float:
    """Records of a run whose telegrams come unevenly; an event in every state HOLD."""
    out = np.zeros((len(states), record.WIDTH))
    out[:, record.CYCLE] = np.cumsum(cycles)
    out[:, 1] = 1e9 + 4e6 * out[:, record.CYCLE] ** 1.1
    out[:, 3] = 1
    out[:, record.column("out_state")] = states
    out[:, record.column("out_cause")] = [Cause.FORCE_STALE if s == State.HOLD else 0 for s in states]
    out[:, record.column("path_distance")] = 1e-3 * (7 * np.arange(len(states)) % 11)
    out[:, record.column("speed_asked")] = speeds
    out[:, record.column("event_new")] = [1 << Event.CHATTER if s == State.HOLD else 0 for s in states]
    return out


state_rows = st.lists(
    st.tuples(st.sampled_from([int(State.ACTIVE), int(State.HOLD), int(State.ARMED)]), st.integers(1, 4),
              st.floats(0.2, 1.0)),
    min_size=1, max_size=40,
)  # fmt: skip
cuts = st.lists(st.integers(0, 40), max_size=5)


def pieces(rows: Float, places: list[int]) -> list[Float]:
    return [piece for piece in np.split(rows, sorted(min(p, len(rows)) for p in places)) if len(piece)]


@given(state_rows, cuts)
def test_a_log_read_in_pieces_gives_what_the_whole_gives(
    given_: list[tuple[int, int, float]], places: list[int]
) -> None:
    rows = log(*(list(column) for column in zip(*given_, strict=True)))
    found: list[Any] = []
    for parts in ([rows], pieces(rows, places)):
        missing, incidents, process = MissingFinder(), IncidentFinder(), ProcessRecord()
        for part in parts:
            missing.add(part)
            incidents.add(part)
            process.add(part)
        found.append((missing.gaps, missing.total, incidents.incidents, incidents.total, process.figures()))
    assert found[0] == found[1]


@given(state_rows)
def test_figures_of_a_log_are_those_of_its_rows(given_: list[tuple[int, int, float]]) -> None:
    """Cycles without a record by the difference of the counts; slowed cycles and the slowest by the rows themselves."""
    states, steps, speeds = (list(column) for column in zip(*given_, strict=True))
    rows = log(states, steps, speeds)
    missing, incidents, process = MissingFinder(), IncidentFinder(), ProcessRecord()
    missing.add(rows)
    incidents.add(rows)
    process.add(rows)
    assert missing.total == sum(steps) - len(steps)
    assert [gap.count for gap in missing.gaps] == [step - 1 for step in steps if step > 1]
    holds = [k for k, s in enumerate(states) if s == State.HOLD and (k == 0 or states[k - 1] != State.HOLD)]
    assert [one.cycle for one in incidents.incidents] == [int(rows[k, record.CYCLE]) for k in holds]
    path = rows[:, record.column("path_distance")]
    assert [one.path_m for one in incidents.incidents] == [path[max(0, k - 1) : k + 1].max() for k in holds]
    figure = process.figures()
    assert figure.least_speed == min(1.0, *speeds)
    assert figure.slowed == pytest.approx(sum(v < 1.0 for v in speeds) / len(speeds))


@given(seed)
def test_what_remains_is_what_was_predicted_and_what_was_corrected(number: int) -> None:
    rng = np.random.default_rng(number)
    n = 40
    deflection, sent, contained = (rng.normal(size=(n, 2)) * 1e-4 for _ in range(3))
    every = np.ones(n, dtype=np.bool_)
    some = np.zeros(n)
    curves = RunCurves(some, some, every, every, np.zeros((n, 2, 3)), deflection, sent, sent, some, some, some)
    found = deviations(curves, contained)
    np.testing.assert_allclose(found["remaining"], found["predicted"] + found["corrected"], atol=1e-18)
    np.testing.assert_allclose(found["corrected"] - contained, sent, atol=1e-18)
    np.testing.assert_allclose(found["predicted"], deflection - contained, atol=1e-18)
    shown = figures(curves, contained)
    assert shown["remaining_m"] == pytest.approx(float(np.quantile(np.linalg.norm(deflection + sent, axis=1), 0.997)))
    np.testing.assert_allclose(shown["mean_sent_m"], sent.mean(axis=0))


@settings(max_examples=40)
@given(seed, st.sampled_from(["some", "none"]), st.floats(0.0, 0.9))
def test_figures_of_a_run_are_those_of_the_cut_alone(number: int, cuts: str, unknown: float) -> None:
    """Where nothing is cut, of what the loop was active in; a gap of a tracker or of the force counts nowhere."""
    rng = np.random.default_rng(number)
    n = 60
    cut = rng.random(n) < 0.4 if cuts == "some" else np.zeros(n, np.bool_)
    active = rng.random(n) < 0.7
    deflection, sent, measured = (rng.normal(size=(n, 2)) * 1e-4 for _ in range(3))
    force, ratio = rng.uniform(0.0, 900.0, n), rng.uniform(0.5, 2.0, n)
    for values in (measured, force, ratio):
        values[rng.random(n) < unknown] = np.nan
    none = np.zeros(n)
    curves = RunCurves(none, none, cut, active, np.zeros((n, 2, 3)), deflection, sent, measured, force, none, ratio)
    shown = figures(curves, None)
    judged = cut if cut.any() else active
    for name, values in (
        ("remaining_m", deflection + sent),
        ("measured_m", measured),
        ("predicted_m", measured * np.nan),
    ):
        size = [math.hypot(*row) for row in values[judged] if np.isfinite(row).all()]
        assert shown[name] == (pytest.approx(np.quantile(size, 0.997)) if size else None)
    mean = sent[judged].mean(axis=0) if judged.any() else None
    assert (shown["mean_sent_m"] is None) == (mean is None)
    if mean is not None:
        np.testing.assert_allclose(shown["mean_sent_m"], mean)
    known = ratio[judged & np.isfinite(ratio)]
    assert shown["ratio"] == (np.median(known) if len(known) else None)
    assert shown["force_peak_n"] == (np.nanmax(force) if np.isfinite(force).any() else None)


@settings(max_examples=30)
@given(seed, st.floats(-2e-3, 2e-3), st.floats(-2e-3, 2e-3), st.floats(0.0, 0.95))
def test_flatness_knows_no_tilt_and_says_how_much_of_the_floor_it_saw(
    number: int, tilt_x: float, tilt_y: float, hidden: float
) -> None:
    """Zone about the plane of least squares through what was measured, with the share of the floor that it rests on."""
    rng = np.random.default_rng(number)
    z = np.full((16, 24), -2.0 * MM, np.float32)
    surface: Any = SimpleNamespace(
        nominal=HeightMap(0.0, 0.0, MM, z, -9.0 * MM), floor=np.ones(z.shape, np.bool_),
        rise_m=np.full(z.shape, np.inf), fall_m=np.full(z.shape, np.inf),
    )  # fmt: skip
    place = rng.uniform([0.0, 0.0], [23.0, 15.0], (60, 2)) * MM
    bumps, seen = rng.normal(scale=5.0 * UM, size=60), rng.random(60) >= hidden
    tilted = bumps + place @ np.array([tilt_x, tilt_y])

    def part(off: Float) -> Any:
        height = surface.nominal.z[0, 0].astype(np.float64) + np.where(seen, off, np.nan)
        return SimpleNamespace(
            heights=lambda xy: height[[int(np.argmin(np.sum((place - p) ** 2, axis=1))) for p in xy]]
        )

    ((name, nominal, side, worst, _, share),) = flatness(place, surface, {"a": part(bumps), "b": part(tilted)}, 0.02)
    assert (name, nominal, side) == ("flatness", 0.0, 0.02)
    assert share == {"a": pytest.approx(seen.mean()), "b": pytest.approx(seen.mean())}
    if seen.sum() < 10:
        assert worst == {}
        return
    A = np.column_stack([place[seen], np.ones(seen.sum())])
    rest = bumps[seen] - A @ np.linalg.lstsq(A, bumps[seen], rcond=None)[0]
    assert worst == {"a": pytest.approx(np.ptp(rest), rel=1e-6), "b": pytest.approx(np.ptp(rest), rel=1e-6)}


@given(st.floats(0.0, 2.0 * math.pi), st.integers(60, 120), st.integers(60, 120))
def test_left_of_the_feed_changes_side_where_the_tool_turns_back(angle: float, there: int, back: int) -> None:
    """The path returns on its own line, at another length than it came: left is left of the way it goes."""
    way = np.array([math.cos(angle), math.sin(angle), 0.0])
    along = np.concatenate([np.arange(there), there - 1.0 - np.arange(1, back)]) * 0.1 * MM
    rows = np.zeros((len(along), record.WIDTH))
    rows[:, record.column("received_ns")] = 4e6 * np.arange(len(along))
    for axis, name in enumerate("xyz"):
        rows[:, record.column(f"nominal_{name}")] = along * way[axis]
    rows[:, record.column("nominal_R22")] = -1.0  # the tool points down, out of the spindle
    sides = curves_of([needed_of(rows)], planned=True).sides
    left = np.array([-way[1], way[0], 0.0])
    np.testing.assert_allclose(sides[: there - 11, 0], np.tile(left, (there - 11, 1)), atol=1e-9)
    np.testing.assert_allclose(sides[there + 11 :, 0], np.tile(-left, (back - 12, 1)), atol=1e-9)
    np.testing.assert_allclose(sides[:, 1], np.tile([0.0, 0.0, -1.0], (len(along), 1)))


@given(st.lists(st.integers(1, 139), min_size=1, max_size=4, unique=True), st.integers(0, 2**32 - 1))
def test_curves_do_not_depend_on_how_a_log_is_cut_into_segments(cuts: list[int], seed: int) -> None:
    """A tool that stands from the end of one segment on into the next goes on having the feed that it had."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((140, record.WIDTH))
    rows[:, record.column("received_ns")] = 4e6 * np.arange(140)
    steps = np.repeat(rng.random(14) < 0.5, 10)[:, None] * np.repeat(rng.standard_normal((7, 3)), 20, axis=0)
    for axis, name in enumerate("xyz"):
        rows[:, record.column(f"nominal_{name}")] = np.cumsum(0.1 * MM * steps[:, axis])
    whole = curves_of([needed_of(rows)], planned=True)
    pieces = np.split(rows, sorted(cuts))
    parts = curves_of([needed_of(one) for one in pieces], planned=True)
    for name in ("sides", "deflection_m", "sent_m", "measured_m", "force_n", "cut"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))


def test_a_micrometre_is_seen() -> None:
    assert values(DeviationFigures.weighted(np.array([UM, -2.0 * UM]), np.array([1.0, 3.0])))[0] == 2.0 * UM
