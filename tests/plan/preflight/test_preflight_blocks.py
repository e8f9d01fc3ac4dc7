"""Blocks against the controller: least block time and look-ahead, by their closed forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.units import DEG, MM
from counterflex.path.sampling import point_spacing
from counterflex.path.toolpath import ToolPath
from counterflex.plan.preflight.row import CheckLimits, Row
from counterflex.plan.preflight.spacing import blocks_of, reached_feed, spacing_rows

BOUNDS = CheckLimits(2.0 * DEG, 5.0 * DEG, acceleration_m_s2=1.0, least_block_s=0.012, clearance_m=0.02)
PathOf = Callable[..., ToolPath]


def rows_of(path: ToolPath, **changes: object) -> tuple[Row, Row]:
    time, ahead = spacing_rows(path, replace(BOUNDS, **changes))  # type: ignore[arg-type]
    return time, ahead


def dense(length_mm: float, step_mm: float, head: str = "G1 Z0 F3000\n") -> str:
    count = round(length_mm / step_mm)
    return head + "\n".join(f"X{step_mm * k:.4f}" for k in range(1, count + 1))


def test_blocks_have_the_length_of_their_motion(path_of: PathOf) -> None:
    """A line of 10 mm, a half circle of radius 5 mm, a dwell: two blocks, the second one stands at its end."""
    path = path_of("G1 X10 Y0 F3000\nG3 X0 Y0 I-5 J0\nG4 P1\nG1 X30", step_mm=0.1)
    blocks = blocks_of(path)
    assert blocks.length_m[-2:] == pytest.approx([5 * np.pi * MM, 30 * MM], rel=1e-4)
    assert blocks.stands[-2:].tolist() == [True, True]
    assert not blocks.stands[:-2].any()


def test_dense_points_let_the_feed_collapse_and_one_block_does_not(path_of: PathOf) -> None:
    """0.1 mm at 50 mm/s take 2 ms; a controller of 12 ms makes 8.3 mm/s of it (Berger2013 eq. 5)."""
    path = path_of(dense(20, 0.1))
    time, _ = rows_of(path)
    assert (time.verdict, time.limit) == ("warning", 0.012)
    assert time.value == pytest.approx(0.002, rel=1e-6)
    assert "200 of 20" in time.what
    assert "feed falls to 17 %, 2.0 s more" in time.what
    coarse, _ = rows_of(path_of("G1 Z0 F3000\nX20"))
    assert coarse.verdict == "ok"


@pytest.mark.parametrize(("factor", "verdict"), [(0.99, "warning"), (1.0, "ok"), (1.01, "ok")])
def test_limit_is_the_spacing_of_berger(path_of: PathOf, factor: float, verdict: str) -> None:
    step_mm = factor * point_spacing(0.05, 0.012) / MM
    assert step_mm == pytest.approx(factor * 0.6)
    assert (
        rows_of(path_of("G1 Z0 F3000\n" + "\n".join(f"X{step_mm * k:.9f}" for k in range(1, 20))))[0].verdict == verdict
    )


def test_a_faster_controller_takes_them(path_of: PathOf) -> None:
    assert rows_of(path_of(dense(20, 0.1)), least_block_s=0.001)[0].verdict == "ok"


def test_look_ahead_limits_to_what_can_be_braked(path_of: PathOf) -> None:
    """Five blocks of 0.1 mm ahead at 1 m/s2: sqrt(2 a L) = 31.6 mm/s of 50."""
    path = path_of(dense(20, 0.1))
    _, ahead = rows_of(path, look_ahead=5, least_block_s=1e-4)
    assert ahead.verdict == "warning"
    assert ahead.value == pytest.approx(np.sqrt(2 * 0.5e-3) / 0.05, rel=1e-6)
    _, far = rows_of(path, look_ahead=13, least_block_s=1e-4)
    assert far.verdict == "ok"
    assert far.value == pytest.approx(1.0)


def test_what_the_controller_does_not_say_is_unknown(path_of: PathOf) -> None:
    _, ahead = rows_of(path_of(dense(20, 0.1)))
    assert (ahead.verdict, ahead.missing) == ("not looked at", "controller.look_ahead_blocks")


def test_a_stop_that_it_sees_is_no_fault_of_its_look_ahead(path_of: PathOf) -> None:
    """The last blocks before the end brake anyway; only blocks whose end is not in sight count."""
    path = path_of("G1 Z0 F3000\nX20\nX20.1\nX20.2")
    assert rows_of(path, look_ahead=2)[1].verdict == "ok"
    assert rows_of(path_of(dense(0.5, 0.1, "G1 Z0 F3000\nX-20\nX0\n") + "\nX20"), look_ahead=2)[1].verdict == "warning"


def test_both_limits_together_against_the_definition(path_of: PathOf) -> None:
    rng = np.random.default_rng(8)
    x = np.cumsum(rng.uniform(0.02, 2.0, 60))
    blocks = blocks_of(path_of("G1 Z0 F3000\n" + "\n".join(f"X{v:.4f}" for v in x)))
    least, n, a = 0.012, 3, 1.0
    feed = reached_feed(blocks, least, n, a)
    for k, length in enumerate(blocks.length_m):
        allowed = min(blocks.feed_m_s[k], length / least)
        if k + 1 + n < len(blocks.length_m):
            allowed = min(allowed, np.sqrt(2 * a * blocks.length_m[k + 1 : k + 1 + n].sum()))
        assert feed[k] == pytest.approx(allowed, rel=1e-9)
