"""The model cut of a tool that is tilted or turns: against the height map, a tilted blank, the power of the spindle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.cutting.tilted_stock import box_along_tool, working_plane
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.cut import Cut, cut
from counterflex.plan.undisturbed_cut import least_depth

SPEED, SPINDLE = 0.025, 13000.0 / 60.0 * 2.0 * np.pi
LOW, HIGH = np.array([0.0, 0.0, -16.0]) * MM, np.array([24.0, 20.0, 0.0]) * MM
MILL = Cutter(diameter_m=0.010, flutes=3, helix_rad=0.5, flute_length_m=0.020)


def path_of(tips: Float, axes: Float) -> ToolPath:
    """Fed at a constant speed of a point 4 mm above the tip."""
    n = len(tips)
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    step = np.linalg.norm(np.diff(tips + 4 * MM * axes, axis=0, prepend=(tips + 4 * MM * axes)[:1]), axis=1)
    one = np.ones(n)
    return ToolPath(
        tips, axes, np.full(n, FEED), SPEED * one, SPINDLE * one, np.cumsum(step / SPEED), np.zeros(n, int),
        np.ones(n, int),
    )  # fmt: skip


def block(cell_mm: float = 0.4) -> HeightMap:
    return HeightMap.from_box(tuple(LOW), tuple(HIGH), cell_mm * MM)


def cut_of(path: ToolPath, stock: HeightMap, law: KienzleLaw) -> Cut:
    return cut(path, path.p_part_tcp, stock, lambda _: MILL, law)


def line(start: Float, end: Float, step: float = 0.5 * MM) -> Float:
    count = round(float(np.linalg.norm(end - start)) / step)
    return start + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - start)


def test_an_upright_path_cuts_what_the_height_map_says(law: KienzleLaw) -> None:
    """A ramp, then level; tilted by 2 urad so that columns are taken; those at the edge of the way are booked apart."""
    tips = line(np.array([-5.93, 9.02, -1.0]) * MM, np.array([8.07, 9.02, -3.0]) * MM)
    ramp = len(tips)
    tips = np.concatenate([tips, line(tips[-1], np.array([18.0, 12.0, -3.0]) * MM)[1:]])
    up = np.tile([0.0, 0.0, 1.0], (len(tips), 1))
    upright, leaning = path_of(tips, up), path_of(tips, up + np.array([2e-6, 0.0, 0.0]))
    one, other = cut_of(upright, block(), law), cut_of(leaning, block(), law)
    size = np.abs(one.w_tcp_part).max(axis=0)
    assert size[0] > 100.0
    assert np.median(np.abs(other.w_tcp_part[ramp:, :3] - one.w_tcp_part[ramp:, :3])) < 5e-3 * size[0]
    for rows in (slice(0, ramp), slice(ramp, None)):
        mean, expected = other.w_tcp_part[rows, :3].mean(axis=0), one.w_tcp_part[rows, :3].mean(axis=0)
        np.testing.assert_allclose(mean, expected, atol=0.02 * float(np.linalg.norm(expected)))
    assert other.volume_m3.sum() == pytest.approx(one.volume_m3.sum(), rel=1e-3)


def test_one_tilted_direction_cuts_what_its_working_plane_says(law: KienzleLaw) -> None:
    """Force of the same slot in columns along z of the part, and on a map along the tool, in the same axes."""
    axis = np.array([-np.sin(0.35), 0.12, np.cos(0.35)])
    axis /= np.linalg.norm(axis)
    tips = line(np.array([11.0, -7.0, -5.0]) * MM, np.array([12.0, 16.0, -5.5]) * MM)
    found = cut_of(path_of(tips, np.tile(axis, (len(tips), 1))), block(0.25), law)
    R_part_plane = working_plane(axis)
    seen = path_of(tips @ R_part_plane, np.tile([0.0, 0.0, 1.0], (len(tips), 1)))
    mapped = cut_of(seen, box_along_tool(LOW, HIGH, 0.25 * MM, R_part_plane), law)
    expected = np.concatenate([mapped.w_tcp_part[:, :3] @ R_part_plane.T, mapped.w_tcp_part[:, 3:] @ R_part_plane.T], 1)
    steady = tips[:, 1] > 6 * MM
    size = np.linalg.norm(expected[steady, :3], axis=1).mean()
    assert size > 100.0
    np.testing.assert_allclose(found.w_tcp_part[steady, :3] / size, expected[steady, :3] / size, atol=0.1)
    np.testing.assert_allclose(found.w_tcp_part.mean(axis=0), expected.mean(axis=0), atol=0.02 * size)  # with its entry
    np.testing.assert_allclose(found.w_tcp_part[steady].mean(axis=0), expected[steady].mean(axis=0), atol=0.01 * size)


def test_the_spindle_pays_for_what_a_turning_tool_removes(law: KienzleLaw) -> None:
    """A law without size effect: the moment about the tool axis times the speed is k times the removal rate."""
    plain = replace(law, mc=0.0)
    share = np.linspace(0.0, 1.0, 70)[:, None]
    tips = np.array([12.0, -4.0, -7.0]) * MM + share * np.array([1.0, 11.0, 0.5]) * MM
    axes = np.concatenate([-0.1 - 0.35 * share, 0.3 * share**2, np.ones_like(share)], axis=1)
    path = path_of(tips, axes)
    found = cut_of(path, block(), plain)
    dt = np.diff(path.time_s, prepend=np.nan)
    middle = 0.5 * (path.axis_part[1:] + path.axis_part[:-1])
    power = np.sum(found.w_tcp_part[1:, 3:] * middle, axis=1) * SPINDLE
    expected = plain.k11_pa()[0] * found.volume_m3[1:] / dt[1:]
    rows = slice(25, None)
    np.testing.assert_allclose(power[rows], expected[rows], rtol=0.03)  # axis, level radius, mean of a bin
    assert found.axial_depth_m[rows].min() > 4 * MM


def test_a_tool_that_turns_about_its_tip_cuts(law: KienzleLaw) -> None:
    """No way of the tip: the chip is that of the height that cuts."""
    share = np.linspace(0.0, 1.0, 40)[:, None]
    tips = np.tile(np.array([12.0, -8.0, -6.0]) * MM, (40, 1))
    axes = np.concatenate([np.zeros_like(share), 0.9 * share, np.ones_like(share)], axis=1)
    path = path_of(tips, axes)
    found = cut_of(path, block(), law)
    engaged = found.volume_m3 > 1e-11
    assert np.count_nonzero(engaged) > 8
    assert np.all(np.isfinite(found.w_tcp_part))
    assert np.all(found.w_tcp_part[engaged, 1] < 0.0)  # the part pushes it back
    flutes = np.full(40, MILL.flute_length_m)
    depth = least_depth(path, found.volume_m3, np.full(40, MILL.diameter_m), flutes)
    assert depth.max() < 8 * MM


def test_columns_grow_with_what_they_hold(law: KienzleLaw) -> None:
    """Nine slots from the side, one above the other, in one column: the last takes what the first takes."""
    levels = -1.5 - 1.6 * np.arange(9)
    thin = Cutter(diameter_m=0.001, flutes=2, flute_length_m=0.03)
    tips = np.concatenate(
        [np.array([[-1.0, -2.0, z], [12.0, -2.0, z], [12.0, 8.0, z], [12.0, -2.0, z]]) * MM for z in levels]
    )
    path = path_of(tips, np.tile([0.0, -1.0, 0.0], (len(tips), 1)))
    found = cut(path, path.p_part_tcp, block(), lambda _: thin, law)
    removed = found.volume_m3.reshape(len(levels), 4).sum(axis=1)
    assert removed[0] > 0.0
    np.testing.assert_allclose(removed, removed[0], rtol=1e-3)
