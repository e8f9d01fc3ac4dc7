"""Points of a robot program: no closer than the controller's cycle takes, and as near to the plan as that allows."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM, UM
from counterflex.integrations.kuka.language.writer import KrlSettings, KrlWriter
from counterflex.path.toolpath import FEED
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.robot_writer.points import RobotText
from counterflex.programs.robot_writer.spaced_points import spaced

CYCLE_S = 0.012
FEED_M_S = 0.025
APART = CYCLE_S * FEED_M_S  # 0.3 mm
DOWN = np.diag([1.0, -1.0, -1.0])


def chosen(p: Float, apart_m: float, tolerance_m: float, fixed: Int | None = None) -> Int:
    n = len(p)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    stays = np.zeros(n, dtype=np.bool_)
    if fixed is not None:
        stays[fixed] = True
    return spaced(way, p, np.zeros((n, 3)), way, np.full(n, apart_m), stays, tolerance_m, 1e-3)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 3.0), st.floats(1.0, 50.0), st.integers(0, 4))
def test_only_fixed_points_come_closer(seed: int, apart_mm: float, tolerance_um: float, fixed: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.uniform(0.01, 0.2, 200)) * MM
    p = np.stack([x, 0.2 * MM * np.sin(x / (0.8 * MM)) * rng.uniform(0.2, 1.0), 0.0 * x], axis=1)
    stays = np.sort(rng.choice(200, fixed, replace=False))
    found = chosen(p, apart_mm * MM, tolerance_um * UM, stays)
    assert found[0] == 0
    assert found[-1] == 199
    assert set(stays) <= set(found)
    assert np.all(np.diff(found) > 0)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    held = {0, 199, *stays.tolist()}
    for a, b in zip(found[:-1].tolist(), found[1:].tolist(), strict=True):
        assert way[b] - way[a] >= apart_mm * MM - 1e-12 or (a in held and b in held)


def test_without_a_distance_the_tolerance_holds() -> None:
    x = np.linspace(0.0, 30.0, 600) * MM
    p = np.stack([x, 0.5 * MM * np.sin(x / (2.0 * MM)), 0.0 * x], axis=1)
    found = chosen(p, 0.0, 5 * UM)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    line = np.stack([np.interp(way, way[found], p[found, c]) for c in range(3)], axis=1)
    assert np.linalg.norm(line - p, axis=1).max() <= 5 * UM + 1e-12
    assert len(found) < 200


def entry(cycle_s: float = CYCLE_S, feed: float = 1500.0, height_mm: float = 1.0) -> RobotText:
    """A correction that comes within 3 mm, as where a cutter enters; rows every 0.25 mm."""
    program = read_gcode(f"G21 G17 G90\nG0 X0 Y0 Z0\nG1 X30 F{feed:g}\nM2\n", name="groove.ngc")
    path = tool_path(program, step_m=0.25 * MM)
    s = np.clip((path.p_part_tcp[:, 0] - 10 * MM) / (3 * MM), 0.0, 1.0)
    shift = np.zeros((len(path), 3))
    shift[:, 1] = height_mm * MM * s * s * (3.0 - 2.0 * s)
    shift[path.kind != FEED] = 0.0
    poses = CompensatedPath.from_correction(path, shift).poses(np.broadcast_to(DOWN, (len(path), 3, 3)))
    name = KrlSettings(name="groove", start_axes_rad=(0.0,) * 6, cycle_s=cycle_s)
    return KrlWriter(program, path, poses, name, tolerance_m=5 * UM).text()


def test_points_between_the_rows_are_used() -> None:
    """Rows are 0.25 mm apart, the cycle takes 0.3: with rows alone every second one is left.

    Curvature 6 / (3 mm)^2 mm = 0.67 / mm, a kink of 0.167 rad at every row: 20.8 um with chords of 0.5 mm from row to
    row, at most 0.167 * 0.3 mm / 4 = 12.5 um with chords of 0.3 mm.
    """
    result = entry()
    points = re.findall(r"^LIN \{X (\S+),Y (\S+),Z", result.files["groove.src"], flags=re.MULTILINE)
    p = np.array([[float(x), float(y)] for x, y in points])
    apart = np.linalg.norm(np.diff(p, axis=0), axis=1)
    assert apart[apart > 1e-3].min() > 0.299
    assert result.largest_position_error_m < 12.5 * UM
    assert result.too_close == 0


def test_where_the_cycle_leaves_room_the_tolerance_holds() -> None:
    result = entry(cycle_s=0.004)
    assert result.largest_position_error_m <= 5 * UM + 1e-12
    assert result.warnings == ()


def test_a_coarser_path_names_place_and_remedy_and_the_remedy_works() -> None:
    result = entry(height_mm=3.0)
    (warning,) = result.warnings
    assert result.largest_position_error_m > 10 * UM
    assert result.largest_position_error_line == 3
    found = re.search(r"line (\d+): .*F(\d+) there .*cycle_ms = ([\d.]+) .*compensation.tolerance_um = (\d+)", warning)
    assert found is not None
    assert found[1] == "3"
    assert entry(height_mm=3.0, feed=float(found[2])).warnings == ()
    assert entry(height_mm=3.0, cycle_s=float(found[3]) * 1e-3).warnings == ()
    assert result.largest_position_error_m <= int(found[4]) * UM


@pytest.mark.parametrize("tolerance_um", [1.0, 5.0, 20.0])
def test_no_point_is_lost_on_a_straight_path(tolerance_um: float) -> None:
    p = np.stack([np.linspace(0.0, 0.1, 500), np.zeros(500), np.zeros(500)], axis=1)
    assert chosen(p, APART, tolerance_um * UM).tolist() == [0, 499]
