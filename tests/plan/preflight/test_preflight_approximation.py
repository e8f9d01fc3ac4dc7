"""Corners that the controller rounds, by their closed forms: distances, errors, exact stops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.units import DEG, MM, UM
from counterflex.path.path_speed import build_track
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.preflight.approximation import BLENDING_KEY, Corners, approximation_rows, corners_of
from counterflex.plan.preflight.row import CheckLimits, Row
from counterflex.plan.preflight.spacing import blocks_of

BOUNDS = CheckLimits(
    2.0 * DEG, 5.0 * DEG, acceleration_m_s2=1.0, least_block_s=0.012, clearance_m=0.02, blending_m=2 * MM
)
PathOf = Callable[..., ToolPath]
SQUARE = "G1 X20 Y0 F3000\nX40\nY20\nX30 Y10"


def corners(path: ToolPath, blending_mm: float = 2.0, own: float = float("nan")) -> Corners:
    count = int(path.motion.max()) + 1
    return corners_of(path, blocks_of(path), np.full(count, own), blending_mm * MM)


def rows(path: ToolPath, own: float = float("nan"), **changes: object) -> tuple[Row, Row]:
    bounds = replace(BOUNDS, **changes)  # type: ignore[arg-type]
    found = corners(path, bounds.blending_m / MM, own)
    first, second = approximation_rows(found, path.kind == FEED, bounds)
    return first, second


def test_corners_have_the_angle_of_their_sides(path_of: PathOf) -> None:
    """Straight on at 20 mm, 90 deg at 40 mm, 135 deg back: a stop in programs that counterflex writes."""
    found = corners(path_of(SQUARE))
    assert found.turn_rad[-3:] / DEG == pytest.approx([0.0, 90.0, 135.0], abs=1e-6)
    assert found.sharp[-3:].tolist() == [False, True, True]
    assert found.exact[-3:].tolist() == [False, False, True]
    assert found.side_m[-2:] / MM == pytest.approx([20.0, np.sqrt(200.0)])
    assert found.error_m[-2:] / MM == pytest.approx([0.5 * 2.0 * np.sin(45 * DEG), 0.0])


def test_error_is_that_of_the_parabola_that_the_controller_runs(path_of: PathOf) -> None:
    """Distance of the corner from the rounded polyline of the controller's model, for one angle after the other."""
    for turn_deg in (10.0, 60.0, 90.0, 115.0):
        x, y = 20 + 20 * np.cos(turn_deg * DEG), 20 * np.sin(turn_deg * DEG)
        path = path_of(f"G1 X0 Y0 F3000\nX20\nX{x:.6f} Y{y:.6f}", step_mm=50.0)
        found = corners(path)
        track = build_track(path, blending_m=2 * MM, rapid_m_s=0.25, acceleration_m_s2=1.0)
        at = path.p_part_tcp[found.point[-1]]
        share = np.linspace(0.0, 1.0, 41)[:, None, None]
        between = track.p[:-1] + share * np.diff(track.p, axis=0)
        least = np.min(np.linalg.norm(between - at, axis=-1))
        assert found.error_m[-1] == pytest.approx(least, rel=0.02)


def test_an_approximation_that_does_not_fit_is_shortened(path_of: PathOf) -> None:
    """A side of 1 mm beside the corner leaves 0.5 mm of 2."""
    fits, _ = rows(path_of("G1 X0 Y0 F3000\nX20\nY20"))
    assert (fits.verdict, fits.what) == ("ok", "1 corners")
    tight = path_of("G1 X0 Y0 F3000\nX19\nX20\nY20")
    row, error = rows(tight)
    assert (row.verdict, row.limit) == ("warning", 2 * MM)
    assert row.value == pytest.approx(0.5 * MM)
    assert row.what.startswith("1 of 1 corners have a point closer than twice their distance")
    assert error.value == pytest.approx(0.25 * MM * np.sin(45 * DEG))
    assert tight.p_part_tcp[row.point] == pytest.approx([20 * MM, 0.0, tight.p_part_tcp[-1, 2]])


@pytest.mark.parametrize(("factor", "verdict"), [(0.99, "warning"), (1.0, "ok"), (1.01, "ok")])
def test_limit_is_twice_the_distance(path_of: PathOf, factor: float, verdict: str) -> None:
    assert rows(path_of(f"G1 X0 Y0 F3000\nX20\nY{4.0 * factor:.6f}"))[0].verdict == verdict


@pytest.mark.parametrize(("um", "verdict", "missing"), [(None, "not looked at", "limits.corner_error_um"),
                                                        (700.0, "warning", ""), (710.0, "ok", "")])  # fmt: skip
def test_corner_error_against_its_tolerance(path_of: PathOf, um: float | None, verdict: str, missing: str) -> None:
    """2 mm before a right angle: 1 mm sin 45 deg = 707 um."""
    _, row = rows(path_of("G1 X0 Y0 F3000\nX20\nY20"), corner_error_m=None if um is None else um * UM)
    assert (row.verdict, row.missing) == (verdict, missing)
    assert row.value == pytest.approx(707.1 * UM, rel=1e-3)


def test_exact_stops_and_own_distances_of_the_program_count(path_of: PathOf) -> None:
    path = path_of("G1 X0 Y0 F3000\nX20\nY20")
    stopped, _ = rows(path, own=0.0)
    assert (stopped.verdict, stopped.what) == ("ok", "no rounded corners in the cut; 1 exact stops")
    _, own = rows(path, own=0.5 * MM)
    assert own.value == pytest.approx(0.25 * MM * np.sin(45 * DEG))


def test_a_default_of_the_cell_file_is_named(path_of: PathOf) -> None:
    path = path_of("G1 X0 Y0 F3000\nX20\nY20")
    assert "controller.blending_mm 2 is assumed" in rows(path, assumed=frozenset({BLENDING_KEY}))[0].what
    assert "assumed" not in rows(path)[0].what


def test_a_dwell_at_the_corner_makes_it_none(path_of: PathOf) -> None:
    row, _ = rows(path_of("G1 X0 Y0 F3000\nX20\nG4 P1\nY20"))
    assert row.what == "no rounded corners in the cut"


def test_an_arc_that_begins_along_its_line_is_no_corner(path_of: PathOf) -> None:
    found = corners(path_of("G1 X0 Y0 F3000\nX20\nG3 X20 Y10 I0 J5", step_mm=0.1))
    assert not found.sharp[-1]
