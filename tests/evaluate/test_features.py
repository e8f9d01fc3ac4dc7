"""Features are found in the program and measured exactly."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.feature_finding import CircularPocket, Groove, find_features
from counterflex.evaluate.features import FeatureRow, Machined, flatness_k, linear_m, measure_features
from counterflex.evaluate.prismatic.finding import PrismaticFeature, stands_out
from counterflex.evaluate.surface import nominal_surface
from counterflex.path import FEED, RAPID, ToolPath

CUTTER = Cutter(diameter_m=16e-3)
CELL = 0.25e-3


def program() -> ToolPath:
    """A groove in two passes, a ramp and a round pocket, cut in three arcs."""
    angle = np.linspace(0.0, 2 * np.pi, 301)
    circle = np.stack([0.11 + 0.012 * np.cos(angle), 0.03 + 0.012 * np.sin(angle), np.full(301, -0.003)], axis=1)
    motions: list[tuple[int, list[list[float]]]] = [
        (RAPID, [[-0.01, 0.012, 0.01]]),
        (FEED, [[-0.01, 0.012, -0.002]]),
        (FEED, [[0.09, 0.012, -0.002]]),
        (RAPID, [[0.09, 0.012, 0.01], [-0.01, 0.012, 0.01]]),
        (FEED, [[-0.01, 0.012, -0.004]]),
        (FEED, [[0.09, 0.012, -0.004]]),
        (RAPID, [[0.09, 0.012, 0.01], [0.01, 0.04, 0.01]]),
        (FEED, [[0.01, 0.04, 0.0]]),
        (FEED, [[0.08, 0.04, -0.003]]),
        (RAPID, [[0.08, 0.04, 0.01], [0.122, 0.03, 0.01]]),
        (FEED, [[0.122, 0.03, -0.003]]),
        *((FEED, circle[100 * k + 1 : 100 * k + 101].tolist()) for k in range(3)),
        (RAPID, [[0.122, 0.03, 0.01]]),
    ]
    rows = [(kind, m, p) for m, (kind, points) in enumerate(motions) for p in points]
    p = np.array([row[2] for row in rows])
    n = len(p)
    return ToolPath(
        p_part_tcp=p,
        axis_part=np.tile([0.0, 0.0, 1.0], (n, 1)),
        kind=np.array([row[0] for row in rows], dtype=np.int64),
        feed_m_s=np.full(n, 0.025),
        spindle_rad_s=np.full(n, 1361.0),
        time_s=np.linspace(0.0, 60.0, n),
        motion=np.array([row[1] for row in rows], dtype=np.int64),
        tool=np.ones(n, dtype=np.int64),
    )


def milled(path: Float) -> HeightMap:
    out = HeightMap.from_box((0.0, 0.0, -0.02), (0.14, 0.055, 0.0), CELL)
    x, y = np.meshgrid(out.x_m(), out.y_m())
    z = out.z.astype(float)
    length = np.linalg.norm(np.diff(path, axis=0), axis=1)
    for a, b, size in zip(path[:-1], path[1:], length, strict=True):
        if min(a[2], b[2]) >= 0.0:
            continue
        for t in np.linspace(0.0, 1.0, max(2, int(size / 2e-4))):
            c = a + t * (b - a)
            i = slice(*np.searchsorted(out.x_m(), [c[0] - 8e-3, c[0] + 8e-3]))
            j = slice(*np.searchsorted(out.y_m(), [c[1] - 8e-3, c[1] + 8e-3]))
            inside = (x[j, i] - c[0]) ** 2 + (y[j, i] - c[1]) ** 2 <= 64e-6
            z[j, i] = np.where(inside, np.minimum(z[j, i], c[2]), z[j, i])
    out.z = z.astype(np.float32)
    out.refresh()
    return out


def table() -> dict[tuple[str, str], FeatureRow]:
    nominal = program()
    path = nominal.p_part_tcp
    stock = HeightMap.from_box((0.0, 0.0, -0.02), (0.14, 0.055, 0.0), CELL)
    surface = nominal_surface(stock, milled(path), path, CUTTER)
    parts = {}
    for name, shift in (("nominal", [0.0, 4e-4, 1.5e-4]), ("compensated", [0.0, 2e-5, 1e-5])):
        moved = path + np.array(shift)
        parts[name] = Machined(milled(moved), moved)
    rows = measure_features(surface, path, find_features(nominal, CUTTER.radius_m), parts)
    return {(row.feature, row.quantity): row for row in rows}


def test_features_are_found_once_at_their_deepest() -> None:
    groove, ramp, pocket = find_features(program(), CUTTER.radius_m)
    assert isinstance(groove, Groove)
    assert isinstance(ramp, Groove)
    assert isinstance(pocket, CircularPocket)
    assert groove.name == "groove 1"
    assert groove.start[2] == pytest.approx(-0.004)
    assert not groove.inclined
    assert ramp.inclined
    np.testing.assert_allclose(pocket.centre, [0.11, 0.03], atol=1e-9)
    assert pocket.path_radius_m == pytest.approx(0.012, abs=1e-9)
    assert pocket.floor_m == pytest.approx(-0.003)


def test_shifted_part_is_measured_exactly_and_judged() -> None:
    rows = table()
    assert rows["groove 1", "width"].worst_m["nominal"] == pytest.approx(0.016, abs=1e-9)
    assert rows["groove 1", "wall left"].worst_m["nominal"] == pytest.approx(8.4e-3, abs=1e-9)
    assert rows["groove 1", "wall right"].worst_m["nominal"] == pytest.approx(7.6e-3, abs=1e-9)
    assert rows["groove 1", "depth"].worst_m["nominal"] == pytest.approx(4e-3 - 1.5e-4, abs=1e-8)
    assert rows["groove 1", "flatness"].worst_m["nominal"] == pytest.approx(0.0, abs=1e-8)
    assert not rows["groove 1", "wall left"].ok("nominal")
    assert rows["groove 1", "wall left"].ok("compensated")
    assert rows["groove 1", "width"].ok("nominal")
    pocket = rows["pocket 1", "diameter"]
    assert pocket.nominal_m == pytest.approx(0.04, abs=1e-9)
    assert pocket.worst_m["nominal"] == pytest.approx(0.04, abs=2e-6)  # chords of the sampled arc
    assert rows["pocket 1", "centre"].worst_m["nominal"] == pytest.approx(4e-4, abs=2e-6)
    assert rows["pocket 1", "roundness"].worst_m["nominal"] < 2e-6
    assert ("ramp 1", "depth") in rows


def test_general_tolerances_of_iso_2768() -> None:
    assert linear_m(0.016) == pytest.approx(0.2e-3)
    assert linear_m(0.006) == pytest.approx(0.1e-3)
    assert linear_m(0.07) == pytest.approx(0.3e-3)
    assert flatness_k(0.2) == pytest.approx(0.4e-3)
    with pytest.raises(InputError, match="beyond the table"):
        linear_m(5.0)


def test_no_variant_is_refused() -> None:
    nominal = program()
    stock = HeightMap.from_box((0.0, 0.0, -0.02), (0.14, 0.055, 0.0), CELL)
    surface = nominal_surface(stock, stock, nominal.p_part_tcp, CUTTER)
    with pytest.raises(InputError, match="no machined part"):
        measure_features(surface, nominal.p_part_tcp, [], {})


@pytest.mark.parametrize(
    ("name", "outward"), [("island 1", True), ("rib 2", True), ("boss 1", True), ("bore 1", False)]
)
def test_what_stands_out_has_material_left_where_its_size_is_too_large(name: str, *, outward: bool) -> None:
    feature = PrismaticFeature(name)
    assert stands_out(feature) == outward
    row = FeatureRow(name, "length", 10e-3, {"made": 10.04e-3}, {}, 0.1e-3, "given", grows=stands_out(feature))
    assert row.material_left_m("made") == pytest.approx(40e-6 if outward else -40e-6)
