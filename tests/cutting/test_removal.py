"""Removal against closed forms, an independent solid modeller, and laws."""

from __future__ import annotations

import itertools
import math
import time

import manifold3d
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError, ModelError
from counterflex.core.jit import kernel
from counterflex.cutting.booking_kernels import BINS, phi_bin
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.envelope_kernels import NODES, fill_minimiser
from counterflex.cutting.removal import (
    RemovalResult,
    grid_of,
    remove_path,
    remove_segments,
    remove_tool_path,
    stamp_workspace,
    unit_widths,
)
from counterflex.cutting.stock import HeightMap, block_tops
from counterflex.cutting.sweep_kernels import stamp_segment
from counterflex.path import FEED, RAPID, ToolPath

FLAT = Cutter(0.016)
BALL = Cutter(0.010, 0.005)
BULL = Cutter(0.016, 0.003)
KINDS = pytest.mark.parametrize("cutter", [FLAT, BALL, BULL], ids=["flat", "ball", "bull"])


def _box(side: float = 0.06, cell: float = 2e-4) -> HeightMap:
    return HeightMap.from_box((-side / 2, -side / 2, -0.03), (side / 2, side / 2, 0.0), cell)


def _feeds(points: Float) -> Int:
    return np.full(len(points) - 1, FEED, dtype=np.int64)


def _cut(
    stock: HeightMap, points: Float, cutter: Cutter, *, engagement: bool = True, threads: int = 1
) -> RemovalResult:
    return remove_path(stock, points, _feeds(points), cutter, engagement=engagement, threads=threads)


def _wander(seed: int, n: int, reach: float = 0.02, depth: float = 0.006) -> Float:
    rng = np.random.default_rng(seed)
    p = np.cumsum(rng.normal(size=(n, 3)) * [1.5e-3, 1.5e-3, 3e-4], axis=0)
    p[:, :2] = reach * np.sin(p[:, :2] / reach)
    p[:, 2] = -depth * np.abs(np.sin(1.0 + p[:, 2] / depth))
    return p


@pytest.mark.by_turn
@KINDS
def test_envelope_equals_brute_force_over_the_segment(cutter: Cutter) -> None:
    stock = _box(0.05, 5e-4)
    a, b = np.array([-0.006, -0.004, -0.004]), np.array([0.005, 0.003, -0.0015])
    for start, end in ((a, b), (b, a), (a, a + np.array([0.0, 0.009, 0.0]))):
        stock = _box(0.05, 5e-4)
        _cut(stock, np.stack([start, end]), cutter)
        x, y = np.meshgrid(stock.x_m(), stock.y_m())
        low = np.zeros_like(x)
        corner, inner = cutter.corner_radius_m, cutter.radius_m - cutter.corner_radius_m
        for t in np.linspace(0.0, 1.0, 4001):
            c = start + t * (end - start)
            rho = np.hypot(x - c[0], y - c[1])
            over = np.maximum(rho - inner, 0.0)
            f = corner - np.sqrt(np.maximum(corner**2 - over**2, 0.0))
            low = np.where(rho <= cutter.radius_m, np.minimum(low, c[2] + f), low)
        # the samples of t see a cell's edge late by one step; compare away from the rim
        difference = np.abs(stock.z - low)
        assert np.quantile(difference, 0.995) < 1.5e-6
        assert np.sum(difference) * 5e-4**2 < 2e-4 * np.sum(-low) * 5e-4**2


def test_ball_slot_has_the_circular_segment_as_cross_section() -> None:
    areas = []
    for offset in np.arange(5) * 2e-5:  # over one cell, so that the ends of the rows average out
        stock = HeightMap.from_box((-0.01, -0.01, -0.02), (0.03, 0.01, 0.0), 1e-4)
        points = np.stack([np.linspace(0.0, 0.02, 41), np.full(41, offset), np.full(41, -0.002)], axis=1)
        areas.append(_cut(stock, points, BALL).volume_m3[15:35].sum() / (0.5e-3 * 20))
    area = 0.005**2 * math.acos(0.6) - 0.003 * 0.004
    assert np.mean(areas) == pytest.approx(area, rel=2e-5)


@pytest.mark.parametrize("slope", [-0.7, -0.2, 0.2, 0.7])
def test_inclined_moves_leave_the_exact_floor(slope: float) -> None:
    x = np.linspace(-0.012, 0.012, 25)
    points = np.stack([x, np.zeros(25), -0.012 + slope * x], axis=1)
    angle = math.atan(slope)
    for cutter in (BALL, FLAT):
        stock = _box(0.05, 2e-4)
        _cut(stock, points, cutter)
        i = stock.z.shape[1] // 2
        for j in (125, 135, 112):
            w = float(stock.y_m()[j])
            expected = -0.012 + slope * stock.x_m()[i]
            if cutter is BALL:
                expected += 0.005 - math.sqrt(0.005**2 - w * w) / math.cos(angle)
            else:  # the trailing edge going down, the one behind it going up: s sqrt(R^2 - w^2) below the tip's line
                expected -= abs(slope) * math.sqrt(0.008**2 - w * w)
            assert stock.z[j, i] == pytest.approx(expected, abs=2e-8)


def test_bull_nose_on_a_slope_is_the_offset_of_its_flat_core() -> None:
    """A bull nose is the flat core disc rolled with a sphere: on the centre line the envelope is that sphere's."""
    slope = 0.3
    x = np.linspace(-0.012, 0.012, 9)
    stock = _box(0.05, 2e-4)
    _cut(stock, np.stack([x, np.full(9, 1e-4), -0.012 + slope * x], axis=1), BULL)
    j = int(np.argmin(np.abs(stock.y_m() - 1e-4)))
    i = stock.z.shape[1] // 2
    # ball of radius r whose centre trails by the core radius: x_c = x - (R - r), touching below along the slope
    expected = -0.012 + slope * (stock.x_m()[i] - 0.005) + 0.003 - 0.003 * math.sqrt(1.0 + slope**2)
    assert stock.z[j, i] == pytest.approx(expected, abs=5e-8)


def test_scallop_between_two_ball_passes() -> None:
    stock = HeightMap.from_box((-0.005, -0.006, -0.01), (0.015, 0.007, 0.0), 1e-4)
    for y in (0.0, 1e-3):
        _cut(stock, np.array([[-0.003, y, -0.002], [0.013, y, -0.002]]), BALL)
    row = (stock.y_m() > 0.0) & (stock.y_m() < 1e-3)
    cusp = float(stock.z[row, 100].max()) + 0.002
    exact = 0.005 - math.sqrt(0.005**2 - 0.0005**2)
    assert exact == pytest.approx(25.06e-6, abs=1e-8)
    assert 20e-6 < cusp <= exact + 1e-8


def test_flat_ramp_has_its_volume() -> None:
    stock = HeightMap.from_box((-0.01, -0.01, -0.01), (0.05, 0.01, 0.0), 1e-4)
    points = np.stack([np.linspace(0.0, 0.04, 41), np.full(41, 2e-5), np.linspace(0.0, -0.006, 41)], axis=1)
    result = _cut(stock, points, FLAT)
    exact = 0.006 / 0.04 * (0.04**2 * 0.008 + 0.04 * math.pi * 0.008**2)
    assert result.volume_m3.sum() == pytest.approx(exact, rel=1e-4)


@KINDS
def test_plunge_is_booked_to_the_end_face(cutter: Cutter) -> None:
    stock = _box(0.03, 1e-4)
    result = _cut(stock, np.array([[0.0, 0.0, 0.01], [0.0, 0.0, -0.006]]), cutter)
    r, inner = cutter.corner_radius_m, cutter.radius_m - cutter.corner_radius_m
    corner = math.pi * r**3 * (2.0 / 3.0) + inner * math.pi**2 / 2.0 * r**2 + math.pi * inner**2 * r
    exact = corner + math.pi * cutter.radius_m**2 * (0.006 - r)
    assert result.volume_m3[0] == pytest.approx(exact, rel=2e-3)
    assert result.bottom_volume_m3[0] == result.volume_m3[0]
    assert result.bottom_area_m2[0] == pytest.approx(math.pi * cutter.radius_m**2, rel=3e-3)
    assert result.engagement is not None
    assert len(result.engagement.depth_m) == 0


@KINDS
def test_booked_volume_is_the_change_of_the_map(cutter: Cutter) -> None:
    stock = _box()
    before = stock.volume_m3
    result = _cut(stock, _wander(5, 400), cutter)
    gone = before - stock.volume_m3
    assert result.volume_m3.sum() == pytest.approx(gone, rel=2e-6)
    assert result.engagement is not None
    depth = result.engagement.dense(0, 399)
    side = np.einsum("ilj,l,j,i->", depth, cutter.level_radii(), unit_widths(), result.length_m)
    assert side + result.bottom_volume_m3.sum() == pytest.approx(result.volume_m3.sum(), rel=1e-6)
    assert np.all(depth >= 0.0)


@KINDS
def test_every_number_of_threads_gives_the_same_bits(cutter: Cutter) -> None:
    points = _wander(8, 300)
    reference: tuple[HeightMap, RemovalResult] | None = None
    for threads in (1, 2, 5):
        stock = _box()
        result = _cut(stock, points, cutter, threads=threads)
        if reference is None:
            reference = (stock, result)
            continue
        assert np.array_equal(stock.z, reference[0].z)
        assert np.array_equal(stock.tops, reference[0].tops)
        assert np.array_equal(result.volume_m3, reference[1].volume_m3)
        assert np.array_equal(result.bottom_volume_m3, reference[1].bottom_volume_m3)
        assert result.engagement is not None
        assert reference[1].engagement is not None
        assert np.array_equal(result.engagement.depth_m, reference[1].engagement.depth_m)
        assert np.array_equal(result.engagement.cell, reference[1].engagement.cell)


def test_no_thread_spins_beside_the_one_that_cuts() -> None:
    points = _wander(8, 300)
    _cut(_box(), points, BALL)
    whole, own = time.process_time(), time.thread_time()
    for _ in range(8):
        _cut(_box(), points, BALL)
    whole, own = time.process_time() - whole, time.thread_time() - own
    assert whole <= 1.2 * own


@pytest.mark.parametrize("corner", [2e-4, 3e-3, 7.9e-3])
@pytest.mark.parametrize("slope", [1e-4, -0.02, 0.3, -5.0])
def test_minimiser_of_a_bull_nose_is_the_root_of_its_equation(corner: float, slope: float) -> None:
    radius, table = 8e-3, np.empty(NODES + 2, np.float32)
    fill_minimiser(table, radius, corner, slope)
    inner = radius - corner
    for i in range(NODES + 1):
        w = radius * (1.0 - (1.0 - i / NODES) ** 2)
        low, high = math.asin(min(1.0, max(0.0, (w - inner) / corner))), 0.5 * math.pi
        for _ in range(60):
            psi = 0.5 * (low + high)
            rho = inner + corner * math.sin(psi)
            below = math.tan(psi) * math.sqrt(max(0.0, 1.0 - (w / rho) ** 2)) < abs(slope)
            low, high = (psi, high) if below else (low, psi)
        u = math.sqrt(max(0.0, (inner + corner * math.sin(0.5 * (low + high))) ** 2 - w * w))
        assert abs(table[i]) == pytest.approx(u, abs=1e-6 * radius)
        assert table[i] * slope <= 0.0


@kernel()
def _bins(ratio: Float) -> Int:
    out = np.empty(ratio.size, np.int64)
    for k in range(ratio.size):
        out[k] = phi_bin(ratio[k])
    return out


def test_bin_of_a_ratio_is_that_of_its_arc_cosine() -> None:
    steps = np.arange(-2048, 2049) / 2048.0
    drawn = np.random.default_rng(4).uniform(-1.01, 1.01, 100_000)
    ratio = np.concatenate([drawn, steps, np.nextafter(steps, 2.0), np.nextafter(steps, -2.0)])
    expected = np.minimum((np.arccos(np.clip(ratio, -1.0, 1.0)) * (BINS / np.pi)).astype(np.int64), BINS - 1)
    assert np.array_equal(_bins(ratio), expected)


@KINDS
def test_engagement_does_not_change_the_cut(cutter: Cutter) -> None:
    points = _wander(9, 200)
    a, b = _box(), _box()
    with_it, without = _cut(a, points, cutter), _cut(b, points, cutter, engagement=False)
    assert np.array_equal(a.z, b.z)
    assert np.array_equal(with_it.volume_m3, without.volume_m3)
    assert without.engagement is None


@KINDS
@settings(max_examples=15, deadline=None)
@given(
    st.floats(-0.012, 0.012),
    st.floats(-0.012, 0.012),
    st.floats(-0.008, -0.0005),
    st.lists(st.floats(0.02, 0.98), min_size=1, max_size=4, unique=True),
)
def test_splitting_a_segment_changes_nothing(cutter: Cutter, x: float, y: float, z: float, cuts: list[float]) -> None:
    a, b = np.array([0.001, -0.002, -0.003]), np.array([x, y, z])
    whole, pieces = _box(0.05, 4e-4), _box(0.05, 4e-4)
    one = _cut(whole, np.stack([a, b]), cutter)
    share = np.array([0.0, *sorted(cuts), 1.0])[:, None]
    many = _cut(pieces, a + share * (b - a), cutter)
    # at the rim, where the outline is vertical, rounding of 1 nm in plan is 2 um in height, and a
    # cell on the rim may be in or out: three cells of the full depth are allowed
    assert np.mean(np.abs(whole.z - pieces.z) > 4e-7) < 1e-3
    assert many.volume_m3.sum() == pytest.approx(one.volume_m3.sum(), abs=3 * 4e-4**2 * 0.008)


@KINDS
@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000))
def test_material_only_goes_down_and_stops_at_the_bottom(cutter: Cutter, seed: int) -> None:
    stock = _box(0.04, 5e-4)
    stock.bottom_m = -0.03
    before = stock.z.copy()
    points = _wander(seed, 30, depth=0.04)
    _cut(stock, points, cutter)
    assert np.all(stock.z <= before)
    assert float(stock.z.min()) >= np.float32(-0.03)
    assert np.array_equal(stock.tops, block_tops(stock.z))


@KINDS
def test_cutting_twice_removes_nothing_more(cutter: Cutter) -> None:
    stock = _box()
    points = _wander(11, 100)
    first = _cut(stock, points, cutter)
    second = _cut(stock, points, cutter)
    assert second.volume_m3.sum() < 1e-6 * first.volume_m3.sum()


@KINDS
def test_one_segment_at_a_time_equals_the_whole_path(cutter: Cutter) -> None:
    points = _wander(13, 60)
    whole, step = _box(), _box()
    result = _cut(whole, points, cutter)
    workspace, shape = stamp_workspace(cutter), cutter.kernel_parameters()
    depth, extra = np.empty((cutter.n_levels, 64)), np.empty(2)
    assert result.engagement is not None
    for i in range(59):
        (ax, ay, az), (bx, by, bz) = points[i], points[i + 1]
        volume = stamp_segment(grid_of(step), shape, ax, ay, az, bx, by, bz, i > 0, workspace, depth, extra)
        assert volume == pytest.approx(result.volume_m3[i], rel=1e-12, abs=1e-18)
        assert extra[0] == pytest.approx(result.bottom_volume_m3[i], rel=1e-12, abs=1e-18)
        assert extra[1] == pytest.approx(result.bottom_area_m2[i], rel=1e-12, abs=1e-18)
        assert np.allclose(depth, result.engagement.dense(i)[0], rtol=1e-6, atol=1e-12)
    assert np.array_equal(whole.z, step.z)


def test_collinear_runs_are_booked_like_single_segments() -> None:
    x = np.concatenate([[0.0], np.cumsum(np.random.default_rng(2).uniform(2e-4, 9e-4, 40))])
    straight = np.stack([0.8 * x - 0.01, 0.6 * x - 0.01, np.full(41, -0.003)], axis=1)
    nudged = straight + np.where(np.arange(41) % 2, 1e-8, -1e-8)[:, None] * [-0.6, 0.8, 0.0]
    a, b = _box(0.06, 1e-4), _box(0.06, 1e-4)
    joined, single = _cut(a, straight, FLAT), _cut(b, nudged, FLAT)
    assert np.allclose(joined.volume_m3, single.volume_m3, rtol=0.0, atol=7e-11)
    assert joined.engagement is not None
    assert single.engagement is not None
    assert np.abs(joined.engagement.dense(1, 40) - single.engagement.dense(1, 40)).mean() < 2e-5


class _Told:
    def __init__(self, fractions: list[float]) -> None:
        self.fractions = fractions

    def __call__(self, fraction: float, what: str = "") -> None:
        assert what == "removing material"
        self.fractions.append(fraction)


def test_chunks_add_up_to_the_path(monkeypatch: pytest.MonkeyPatch) -> None:
    points = _wander(17, 700)
    whole, parts = _box(), _box()
    result = _cut(whole, points, BALL)
    monkeypatch.setattr("counterflex.cutting.removal.CHUNK_BYTES", 1)
    told: list[float] = []
    pieces = list(remove_segments(parts, points, _feeds(points), BALL, progress=_Told(told)))
    assert len(pieces) == 3
    assert [first for first, _ in pieces] == [0, 256, 512]
    assert told[-1] == 1.0
    assert np.array_equal(whole.z, parts.z)
    assert np.array_equal(np.concatenate([p.volume_m3 for _, p in pieces]), result.volume_m3)


def test_rapids_through_material_are_reported_and_not_booked() -> None:
    stock = _box()
    points = np.array([[-0.04, 0.0, 0.01], [-0.04, 0.0, -0.002], [0.0, 0.0, -0.002], [0.01, 0.0, -0.002]])
    result = remove_path(stock, points, np.array([RAPID, RAPID, FEED]), FLAT)
    assert result.collisions.tolist() == [1]
    assert result.volume_m3[1] > 0.0
    assert result.engagement is not None
    assert result.engagement.dense(1).sum() == 0.0
    assert result.engagement.dense(2).sum() > 0.0


def test_a_rapid_through_material_is_named_by_its_place_on_the_whole_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """In any chunk, and whether chunks are joined or taken one by one."""
    monkeypatch.setattr("counterflex.cutting.removal.CHUNK_BYTES", 1)
    x = np.linspace(-0.02, 0.02, 701)
    points = np.column_stack([x, 0.002 * np.sin(40.0 * x), np.full_like(x, 0.01)])
    points[400:406, 2] = -0.003
    points[650:652, 2] = -0.003
    kind = np.full(700, RAPID)
    kind[402] = FEED
    sinks = [i for i in range(700) if points[i + 1, 2] < 0.0 or points[i, 2] < 0.0]
    stock = _box()
    expected = [i for i in sinks if i != 402]
    whole = remove_path(stock, points, kind, FLAT)
    cutting = np.flatnonzero((whole.volume_m3 > 0.0) & (kind == RAPID))
    assert whole.collisions.tolist() == cutting.tolist()
    assert set(whole.collisions.tolist()) <= set(expected)
    assert {400, 650} & set(whole.collisions.tolist())
    assert max(whole.collisions) >= 649
    pieces = list(remove_segments(_box(), points, kind, FLAT))
    assert len(pieces) == 3
    assert np.concatenate([piece.collisions for _, piece in pieces]).tolist() == cutting.tolist()


def _tool(cutter: Cutter, around: int) -> Float:
    """Points on the cutter with cross-sections of the true area, 20 mm tall."""
    angle = np.arange(around) * 2.0 * math.pi / around
    scale = math.sqrt(math.pi / (0.5 * around * math.sin(2.0 * math.pi / around)))
    r = cutter.corner_radius_m
    psi = np.linspace(0.0, math.pi / 2.0, 1 if r == 0.0 else 25)
    rho = np.append(cutter.radius_m - r + r * np.sin(psi), cutter.radius_m)
    z = np.append(r - r * np.cos(psi), 0.02)
    if r == 0.0:
        rho, z = np.array([cutter.radius_m] * 2), np.array([0.0, 0.02])
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * scale
    return np.concatenate([np.column_stack([ring * a, np.full(around, b)]) for a, b in zip(rho, z, strict=True)])


@pytest.mark.by_turn
@pytest.mark.parametrize(
    ("cutter", "n", "around"),
    [(FLAT, 1200, 40), (BALL, 150, 40), (BULL, 150, 40)],
    ids=["flat", "ball", "bull"],
)
def test_volume_agrees_with_a_solid_modeller(cutter: Cutter, n: int, around: int) -> None:
    t = np.linspace(0.0, 1.0, n + 1)
    turn = 2.0 * math.pi * 7.0 * t * n / 900.0
    radius = 0.004 + 0.018 * t
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), -0.0045 + 0.0012 * np.sin(3.1 * turn)], axis=1)
    stock = HeightMap.from_box((-0.035, -0.035, -0.012), (0.035, 0.035, 0.0), 1e-4)
    removed = float(_cut(stock, points, cutter).volume_m3.sum())
    # mm, because the modeller works in single precision near its tolerance
    tool = _tool(cutter, around) * 1e3
    swept = [
        manifold3d.Manifold.hull_points(np.concatenate([tool + a * 1e3, tool + b * 1e3]))
        for a, b in itertools.pairwise(points)
    ]
    block = manifold3d.Manifold.cube((70.0, 70.0, 12.0)).translate((-35.0, -35.0, -12.0))
    left = block - manifold3d.Manifold.batch_boolean(swept, manifold3d.OpType.Add)
    assert removed == pytest.approx((block.volume() - left.volume()) * 1e-9, rel=5e-4)


def _tool_path(points: Float) -> ToolPath:
    n = len(points)
    return ToolPath(
        points,
        np.tile([0.0, 0.0, 1.0], (n, 1)),
        np.full(n, FEED),
        np.full(n, 0.025),
        np.full(n, 1000.0),
        np.linspace(0.0, 2.0, n),
        np.arange(n),
        np.ones(n, dtype=np.int64),
    )


def test_tool_paths_are_cut_and_tilt_is_refused() -> None:
    points = _wander(21, 20)
    path = _tool_path(points)
    a, b = _box(), _box()
    assert np.array_equal(remove_tool_path(a, path, FLAT).volume_m3, _cut(b, points, FLAT).volume_m3)
    tilted = ToolPath(
        path.p_part_tcp, np.tile([0.1, 0.0, 0.995], (20, 1)), path.kind, path.feed_m_s, path.spindle_rad_s,
        path.time_s, path.motion, path.tool,
    )  # fmt: skip
    with pytest.raises(ModelError, match="tilted"):
        remove_tool_path(a, tilted, FLAT)
    changed = ToolPath(
        path.p_part_tcp, path.axis_part, path.kind, path.feed_m_s, path.spindle_rad_s, path.time_s, path.motion,
        np.arange(20),
    )  # fmt: skip
    with pytest.raises(InputError, match="tool by tool"):
        remove_tool_path(a, changed, FLAT)


def test_bad_paths_are_refused() -> None:
    stock = _box()
    good = np.zeros((3, 3))
    with pytest.raises(InputError):
        remove_path(stock, good[:1], np.array([], dtype=np.int64), FLAT)
    with pytest.raises(InputError):
        remove_path(stock, good, np.ones(7, dtype=np.int64), FLAT)
    with pytest.raises(InputError):
        remove_path(stock, good * np.nan, np.ones(2, dtype=np.int64), FLAT)
    with pytest.raises(InputError):
        remove_path(stock, good, np.ones(2, dtype=np.int64), FLAT, threads=0)
    with pytest.raises(InputError):
        result = remove_path(stock, good - 0.001, np.ones(2, dtype=np.int64), FLAT)
        assert result.engagement is not None
        result.engagement.dense(5)
