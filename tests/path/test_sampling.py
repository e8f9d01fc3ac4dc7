"""Sampling of motions into a tool path: ends exact, steps and chords within bounds, time at programmed speed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.path.sampling import (
    ARC_MOTION,
    DWELL_MOTION,
    FEED_MOTION,
    RAPID_MOTION,
    MotionTable,
    chord_angle,
    motion_length,
    point_spacing,
    sample,
)
from counterflex.path.toolpath import FEED, RAPID


def table(rows: list[dict[str, Any]]) -> MotionTable:
    """Motions one after the other; each row starts where the one before it ended unless it says otherwise."""
    here: Any = (0.0, 0.0, 0.0)
    columns: dict[str, list[Any]] = {name: [] for name in MotionTable.__dataclass_fields__}
    for row in rows:
        full = {
            "kind": FEED_MOTION, "p_start": here, "p_end": here, "feed_m_s": 0.025, "spindle_rad_s": 100.0, "tool": 1,
            "duration_s": 0.0, "p_centre": (0.0, 0.0, 0.0), "normal": (0.0, 0.0, 1.0), "turn_rad": 0.0, **row,
        }  # fmt: skip
        here = full["p_end"]
        for name, value in full.items():
            columns[name].append(value)
    arrays = {name: np.array(values, dtype=np.float64) for name, values in columns.items()}
    arrays["kind"] = arrays["kind"].astype(np.int64)
    arrays["tool"] = arrays["tool"].astype(np.int64)
    return MotionTable(**arrays)  # type: ignore[arg-type]


def arc(start_deg: float, turn_deg: float, radius: float, rise: float, height: float = 0.0) -> dict[str, Any]:
    def spoke(angle: float, z: float) -> tuple[float, float, float]:
        return (radius * math.cos(math.radians(angle)), radius * math.sin(math.radians(angle)), z)

    return {
        "kind": ARC_MOTION,
        "p_start": spoke(start_deg, height),
        "p_end": spoke(start_deg + turn_deg, height + rise),
        "p_centre": (0.0, 0.0, height),
        "turn_rad": math.radians(turn_deg),
    }


def test_straight_feed_is_divided_evenly_with_its_end_exact() -> None:
    path = sample(table([{"p_end": (0.01, 0.0, 0.0)}, {"p_end": (0.01, 0.0033, 0.1)}]), step_m=0.001)
    steps = np.linalg.norm(np.diff(path.p_part_tcp, axis=0), axis=1)
    assert len(path) == 1 + 10 + math.ceil(math.hypot(0.0033, 0.1) / 0.001)
    assert steps.max() <= 0.001 * (1.0 + 1e-9)
    assert path.p_part_tcp[10].tolist() == [0.01, 0.0, 0.0]
    assert path.p_part_tcp[-1].tolist() == [0.01, 0.0033, 0.1]
    assert path.time_s[-1] == pytest.approx((0.01 + math.hypot(0.0033, 0.1)) / 0.025, rel=1e-12)
    assert set(path.motion.tolist()) == {0, 1}
    assert np.all(path.kind[1:] == FEED)


@pytest.mark.parametrize(("feed_m_s", "steps"), [(0.05, 40), (0.01, 100), (0.001, 200)])
def test_slow_motions_have_steps_that_last_no_longer_than_asked(feed_m_s: float, steps: int) -> None:
    """10 mm in steps of at most 0.25 mm and 10 ms, but not below a fifth of 0.25 mm."""
    path = sample(table([{"p_end": (0.01, 0.0, 0.0), "feed_m_s": feed_m_s}]), step_m=0.25e-3, step_s=0.01)
    assert len(path) == 1 + steps
    assert path.time_s[-1] == pytest.approx(0.01 / feed_m_s, rel=1e-12)


def test_rapids_are_one_segment_at_the_assumed_speed() -> None:
    path = sample(table([{"kind": RAPID_MOTION, "feed_m_s": 0.0, "p_end": (0.5, 0.0, 0.0)}]), rapid_speed_m_s=0.25)
    assert path.kind.tolist() == [RAPID, RAPID]
    assert path.time_s.tolist() == [0.0, 2.0]
    assert path.feed_m_s[1] == 0.25


def test_dwell_passes_time_without_moving() -> None:
    path = sample(table([{"p_end": (0.001, 0.0, 0.0)}, {"kind": DWELL_MOTION, "feed_m_s": 0.0, "duration_s": 1.5}]))
    assert path.p_part_tcp[-1].tolist() == path.p_part_tcp[-2].tolist()
    assert path.time_s[-1] - path.time_s[-2] == pytest.approx(1.5)
    assert path.feed_m_s[-1] == 0.0


def test_a_jump_between_motions_becomes_a_rapid_of_the_later_motion() -> None:
    motions = table(
        [{"p_end": (0.001, 0.0, 0.0)}, {"p_start": (0.001, 0.0, 0.1), "p_end": (0.002, 0.0, 0.1), "tool": 2}]
    )
    path = sample(motions, step_m=0.01, rapid_speed_m_s=0.5)
    assert path.kind.tolist() == [RAPID, FEED, RAPID, FEED]
    assert path.p_part_tcp[2].tolist() == [0.001, 0.0, 0.1]
    assert path.motion.tolist() == [0, 0, 1, 1]
    assert path.tool.tolist() == [1, 1, 2, 2]
    assert path.time_s[2] - path.time_s[1] == pytest.approx(0.2)


@settings(max_examples=60, deadline=None)
@given(
    start=st.floats(-180.0, 180.0),
    turn=st.one_of(st.floats(-1500.0, -0.5), st.floats(0.5, 1500.0)),
    radius=st.floats(1e-4, 0.5),
    rise=st.floats(-0.05, 0.05),
    step=st.floats(2e-4, 5e-2),
    chord=st.floats(1e-6, 1e-4),
)
def test_arcs_stay_on_their_helix_within_step_and_chord(
    start: float, turn: float, radius: float, rise: float, step: float, chord: float
) -> None:
    motions = table([arc(start, turn, radius, rise, height=0.02)])
    path = sample(motions, step_m=step, chord_m=chord)
    points = path.p_part_tcp
    assert np.hypot(points[:, 0], points[:, 1]) == pytest.approx(np.full(len(points), radius), rel=1e-12)
    middle = 0.5 * (points[1:, :2] + points[:-1, :2])
    assert radius - np.hypot(middle[:, 0], middle[:, 1]).min() <= chord * (1.0 + 1e-6) + 1e-15
    length = math.hypot(radius * math.radians(turn), rise)
    assert length / (len(points) - 1) <= step * (1.0 + 1e-8)
    assert motion_length(motions)[0] == pytest.approx(length, rel=1e-9)
    assert path.time_s[-1] == pytest.approx(length / 0.025, rel=1e-9)
    assert points[-1].tolist() == motions.p_end[0].tolist()
    heights = 0.02 + rise * np.arange(len(points)) / (len(points) - 1)
    assert points[:, 2] == pytest.approx(heights, abs=1e-12)
    angle = np.unwrap(np.arctan2(points[:, 1], points[:, 0]))
    assert angle[-1] - angle[0] == pytest.approx(math.radians(turn), rel=1e-9, abs=1e-9)


def test_an_arc_in_any_plane_turns_right_handed_about_its_normal() -> None:
    motions = table(
        [{"kind": ARC_MOTION, "p_start": (0.01, 0.0, 0.0), "p_end": (0.0, 0.0, 0.01), "p_centre": (0.0, 0.0, 0.0),
          "normal": (0.0, 1.0, 0.0), "turn_rad": -0.5 * math.pi}]
    )  # fmt: skip
    path = sample(motions, step_m=1e-3)
    middle = path.p_part_tcp[len(path) // 2]
    assert middle[0] > 0.0
    assert middle[2] > 0.0


def test_a_radius_that_differs_at_the_end_is_spread_over_the_arc() -> None:
    motions = table(
        [{"kind": ARC_MOTION, "p_start": (0.01, 0.0, 0.0), "p_end": (-0.01001, 0.0, 0.0), "turn_rad": math.pi}]
    )
    path = sample(motions, step_m=1e-3)
    radii = np.linalg.norm(path.p_part_tcp, axis=1)
    assert radii[0] == pytest.approx(0.01, abs=1e-15)
    assert radii[-1] == pytest.approx(0.01001, abs=1e-15)
    assert np.all(np.diff(radii) > 0.0)


def test_point_spacing_of_berger() -> None:
    # DS[um] = f[mm/min] DT[ms] / 60: 1500 mm/min at 12 ms is 300 um.
    assert point_spacing(1500.0 / 60e3, 12e-3) == pytest.approx(1500.0 * 12.0 / 60.0 * 1e-6, rel=1e-12)


@pytest.mark.parametrize("arguments", [(0.0, 0.01), (0.01, 0.0), (math.nan, 0.01), (0.01, -1.0)])
def test_point_spacing_refuses_nonsense(arguments: tuple[float, float]) -> None:
    with pytest.raises(InputError):
        point_spacing(*arguments)


def test_chord_angle_is_the_sagitta_law() -> None:
    radius: Float = np.array([1e-3, 1e-2, 1.0])
    angle = chord_angle(radius, 5e-6)
    assert radius * (1.0 - np.cos(0.5 * angle)) == pytest.approx(np.full(3, 5e-6), rel=1e-6)
    assert chord_angle(np.array([1e-6]), 1.0)[0] == pytest.approx(0.5 * math.pi)


@pytest.mark.parametrize(
    ("name", "value"),
    [("step_m", 0.0), ("step_m", math.nan), ("rapid_speed_m_s", -1.0), ("chord_m", 0.0), ("step_m", 1e-12)],
)
def test_sample_refuses_arguments_out_of_range(name: str, value: float) -> None:
    arguments: dict[str, Any] = {name: value}
    with pytest.raises(InputError):
        sample(table([{"p_end": (1.0, 0.0, 0.0)}]), **arguments)


@pytest.mark.parametrize(
    ("row", "match"),
    [
        ({"feed_m_s": 0.0, "p_end": (1.0, 0.0, 0.0)}, "without feed"),
        ({"p_end": (math.nan, 0.0, 0.0)}, "p_end"),
        ({"kind": DWELL_MOTION, "duration_s": -1.0}, "negative time"),
    ],
)
def test_table_refuses_motions_without_sense(row: dict[str, Any], match: str) -> None:
    with pytest.raises(InputError, match=match):
        table([row])


def test_no_motions_give_an_empty_path() -> None:
    none = np.zeros(0)
    no, points = np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    assert len(sample(MotionTable(no, points, points, none, none, no, none, points, points, none))) == 0


def test_ninety_thousand_short_moves_keep_every_end() -> None:
    rng = np.random.default_rng(1)
    n = 90_000
    ends = np.cumsum(rng.normal(scale=4e-4, size=(n + 1, 3)), axis=0)
    zero, normal = np.zeros((n, 3)), np.tile([0.0, 0.0, 1.0], (n, 1))
    flat = np.zeros(n)
    motions = MotionTable(
        np.full(n, FEED_MOTION), ends[:-1], ends[1:], np.full(n, 0.025), flat, np.ones(n, dtype=np.int64), flat,
        zero, normal, flat,
    )  # fmt: skip
    path = sample(motions, step_m=1e-3)
    last = np.flatnonzero(np.append(np.diff(path.motion) > 0, True))
    assert path.p_part_tcp[last] == pytest.approx(ends[1:], abs=0.0)
    assert path.time_s[-1] == pytest.approx(np.linalg.norm(np.diff(ends, axis=0), axis=1).sum() / 0.025, rel=1e-9)
