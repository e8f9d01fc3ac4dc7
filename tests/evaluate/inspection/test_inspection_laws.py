"""Laws of figures: a pose depends on no origin, opposite faces count alike, order and sense of passes do not matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, UM
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.feature_finding import CircularPocket, Groove, find_features
from counterflex.evaluate.inspection.datum import datum_faces
from counterflex.evaluate.inspection.part_deviations import FREE, PartDeviations
from counterflex.evaluate.inspection.registration import Registration
from counterflex.evaluate.inspection.size_errors import scale_of
from counterflex.evaluate.iso230.circular_test import BiDirectional, Circle as NominalCircle, Turn, turns
from counterflex.evaluate.iso230.positioning import DOWN, UP, Approaches
from counterflex.path.toolpath import FEED, RAPID, ToolPath

QUICK = settings(max_examples=40)
seed = st.integers(0, 2**31)


@QUICK
@given(seed)
def test_the_uncertainty_of_a_pose_does_not_know_where_the_origin_is(number: int) -> None:
    """Part, scan and centre shifted together leave it; away from the centre a turn adds to it, along normals alone."""
    rng = np.random.default_rng(number)
    root = rng.normal(size=(6, 6)) * 1e-5
    points, centre = rng.normal(size=(20, 3)), rng.normal(size=3)
    normals = rng.normal(size=(20, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    one = Registration(np.eye(4), root @ root.T, centre, (), {}, {}, 0.0, 1.0)
    shift = 100.0 * rng.normal(size=3)
    other = replace(one, centre=centre + shift)
    np.testing.assert_allclose(
        other.standard_deviation_m(points + shift, normals), one.standard_deviation_m(points, normals), rtol=1e-9
    )
    step = rng.normal(size=6) * 1e-6
    moved = points + step[:3] + np.cross(step[3:], points - centre)
    np.testing.assert_allclose(
        one.sensitivity(points, normals) @ step, np.sum((moved - points) * normals, axis=1), atol=1e-15
    )
    at_centre = one.standard_deviation_m(np.tile(centre, (20, 1)), normals)
    np.testing.assert_allclose(at_centre**2, np.einsum("ni,ij,nj->n", normals, one.covariance[:3, :3], normals))


SIZE = np.array([100.0, 60.0, 40.0]) * MM


def blank_scan(off: dict[str, float]) -> PartDeviations:
    """Points on faces that lie off their planes by so much, outside positive."""
    rng = np.random.default_rng(3)
    points, normals, deviation = [], [], []
    for side, value in off.items():
        k = "xyz".index(side[0])
        some = rng.uniform(1.5 * MM, SIZE - 1.5 * MM, (800, 3))
        some[:, k] = SIZE[k] if side[1] == "+" else 0.0
        points.append(some)
        normals.append(np.tile(np.eye(3)[k] * (1.0 if side[1] == "+" else -1.0), (800, 1)))
        deviation.append(value + 1e-7 * rng.normal(size=800))
    n = 800 * len(off)
    return PartDeviations(np.concatenate(points), np.concatenate(normals), np.concatenate(deviation),
                          np.full(n, UM), np.full(n, FREE))  # fmt: skip


@QUICK
@given(st.tuples(*[st.floats(-50.0, 50.0)] * 6))
def test_a_scale_is_the_sum_of_what_both_faces_are_off(off_um: tuple[float, ...]) -> None:
    """However it is shared between the two: a scan laid on one face is not twice as large."""
    z = np.full((60, 100), 40.0 * MM, np.float32)
    stock = HeightMap(0.5 * MM, 0.5 * MM, 1.0 * MM, z, 0.0)
    off = dict(zip(("x-", "x+", "y-", "y+", "z-", "z+"), (v * UM for v in off_um), strict=True))
    found = scale_of(blank_scan(off), datum_faces(stock, stock))
    for k, axis in enumerate("xyz"):
        expected = (off[f"{axis}-"] + off[f"{axis}+"]) / SIZE[k]
        assert found.directions[axis] == pytest.approx(expected, abs=5e-7)


def program(motions: list[tuple[int, Float]]) -> ToolPath:
    """Rows of motions one behind the other."""
    p = np.concatenate([rows for _, rows in motions])
    n, counts = len(p), [len(rows) for _, rows in motions]
    kinds, numbers = np.repeat([kind for kind, _ in motions], counts), np.repeat(np.arange(len(motions)), counts)
    return ToolPath(p, np.tile([0.0, 0.0, 1.0], (n, 1)), kinds, np.full(n, 0.02), np.full(n, 1000.0),
                    np.linspace(0.0, 1.0, n), numbers, np.ones(n, np.int64))  # fmt: skip


LEVELS = st.permutations([-1.0, -2.0, -4.0])


@QUICK
@given(LEVELS, st.lists(st.booleans(), min_size=3, max_size=3))
def test_passes_of_a_groove_there_and_back_are_one_groove_at_its_deepest(levels: list[float], back: list[bool]) -> None:
    ends = np.array([[-0.01, 0.02], [0.09, 0.03]])
    motions: list[tuple[int, Float]] = []
    for z, turned in zip(levels, back, strict=True):
        a, b = ends[::-1] if turned else ends
        motions += [(RAPID, np.array([[*a, 0.01]])), (FEED, np.array([[*a, z * MM]])), (FEED, np.array([[*b, z * MM]])),
                    (RAPID, np.array([[*b, 0.01]]))]  # fmt: skip
    (groove,) = find_features(program(motions), 4.0 * MM)
    assert isinstance(groove, Groove)
    assert (groove.start[2], groove.end[2]) == pytest.approx((-4.0 * MM, -4.0 * MM))
    np.testing.assert_allclose(sorted([groove.start[0], groove.end[0]]), [-0.01, 0.09], atol=1e-9)


@QUICK
@given(LEVELS, st.integers(1, 6), st.booleans())
def test_a_circle_in_pieces_at_several_levels_is_one_pocket(levels: list[float], pieces: int, left: bool) -> None:
    centre, radius = np.array([0.05, 0.04]), 12.0 * MM
    angle = np.linspace(0.0, 2.0 * np.pi, 60 * pieces + 1) * (1.0 if left else -1.0)
    motions: list[tuple[int, Float]] = []
    for z in levels:
        ring = np.column_stack([centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1),
                                np.full(len(angle), z * MM)])  # fmt: skip
        motions += [(RAPID, np.add(ring[:1], [0.0, 0.0, 0.05])), (FEED, ring[:1])]
        motions += [(FEED, ring[60 * k + 1 : 60 * k + 61]) for k in range(pieces)]
        motions += [(RAPID, np.add(ring[-1:], [0.0, 0.0, 0.05]))]
    (pocket,) = find_features(program(motions), 4.0 * MM)
    assert isinstance(pocket, CircularPocket)
    assert pocket.floor_m == pytest.approx(-4.0 * MM, abs=0.01 * UM)
    assert pocket.path_radius_m == pytest.approx(radius, abs=0.01 * UM)
    np.testing.assert_allclose(pocket.centre, centre, atol=0.01 * UM)


place_um = st.integers(-20_000, 20_000).map(lambda k: 5 * k)


@settings(max_examples=25)
@given(st.tuples(place_um, place_um), st.integers(2000, 4000), st.integers(1, 5), st.booleans())
def test_a_pocket_has_the_place_and_size_of_its_circle_to_the_micrometre(
    centre_um: tuple[int, int], radius_5um: int, quarters: int, there_and_back: bool
) -> None:
    """Quarter arcs that close a turn make one pocket of just their circle; less than a turn cut twice makes none."""
    centre, radius = np.array(centre_um) * UM, 5.0 * UM * radius_5um
    motions: list[tuple[int, Float]] = [(RAPID, np.array([[centre[0] + radius, centre[1], 0.05]]))]
    ends = list(range(quarters))
    for k in [*ends, *([-1 - e for e in reversed(ends)] if there_and_back else [])]:
        begin, end = (k, k + 1) if k >= 0 else (-k, -k - 1)
        angle = np.linspace(begin, end, 31)[1:] * np.pi / 2.0
        ring = centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        motions.append((FEED, np.column_stack([ring, np.full(30, -2.0 * MM)])))
    start = np.array([[centre[0] + radius, centre[1], -2.0 * MM]])
    found = find_features(program([motions[0], (FEED, start), *motions[1:]]), 4.0 * MM)
    if quarters < 4:
        assert not [one for one in found if isinstance(one, CircularPocket)]
        return
    (pocket,) = found
    assert isinstance(pocket, CircularPocket)
    np.testing.assert_allclose(pocket.centre, centre, atol=0.01 * UM)
    assert pocket.path_radius_m == pytest.approx(radius, abs=0.01 * UM)
    assert pocket.floor_m == pytest.approx(-2.0 * MM, abs=0.01 * UM)


R = 50.0 * MM
ANGLE = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)


@settings(max_examples=12)
@given(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0), st.floats(-50.0, 50.0), st.floats(0.0, 10.0))
def test_a_turn_run_the_other_way_has_the_same_figures(
    x_um: float, y_um: float, off_um: float, lobes_um: float
) -> None:
    """About its own centre the deviations are those of the radius, about the nominal one those of the place too."""
    rho = R + (off_um + lobes_um * np.cos(3.0 * ANGLE)) * UM
    points = np.column_stack([rho * np.cos(ANGLE), rho * np.sin(ANGLE)]) + np.array([x_um, y_um]) * UM
    one = Turn("ccw", points, 0.0).figures(R, nominal_centre=True)
    other = Turn("cw", points[::-1], 0.0).figures(R, nominal_centre=True)
    about = np.linalg.norm(points, axis=1) - R
    assert one.f_nominal_max_m == pytest.approx(about.max(), abs=1e-12)
    assert one.f_nominal_min_m == pytest.approx(about.min(), abs=1e-12)
    assert one.f_max_m == pytest.approx((off_um + lobes_um) * UM, abs=0.05 * UM)
    assert one.f_min_m == pytest.approx((off_um - lobes_um) * UM, abs=0.05 * UM)
    for name in ("g_m", "g_lsc_m", "f_max_m", "f_min_m", "f_nominal_max_m", "f_nominal_min_m", "radius_m"):
        assert getattr(other, name) == pytest.approx(getattr(one, name), abs=1e-10)
    wider = Turn("cw", np.column_stack([(R + 7.0 * UM) * np.cos(ANGLE), -(R + 7.0 * UM) * np.sin(ANGLE)]), 0.0)
    plain = Turn("ccw", np.column_stack([R * np.cos(ANGLE), R * np.sin(ANGLE)]), 0.0)
    for pair in ((wider, plain), (replace(plain, direction="cw"), replace(wider, direction="ccw"))):
        assert BiDirectional.of(*pair, R).h_m == pytest.approx(7.0 * UM, abs=0.01 * UM)


@QUICK
@given(st.floats(20.0, 180.0), st.booleans())
def test_a_path_that_turns_back_makes_no_whole_turn_of_two_halves(half_deg: float, left: bool) -> None:
    """Less than a turn there and back holds none; one whole turn behind them is found, with its sense."""
    sense = 1.0 if left else -1.0
    there = np.linspace(0.0, 150.0 + 0.5 * half_deg, 400)
    angle = np.concatenate([there, there[::-1], np.linspace(0.0, 365.0, 900)]) * DEG * sense
    p = np.column_stack([R * np.cos(angle), R * np.sin(angle), np.zeros(len(angle))])
    circle = NominalCircle(np.zeros(3), np.array([0.0, 0.0, 1.0]), R)
    found = turns(p, circle)
    assert [turn.direction for turn in found] == ["ccw" if left else "cw"]


@QUICK
@given(seed)
def test_a_test_of_positioning_mirrored_in_value_or_direction_has_the_same_figures(number: int) -> None:
    """Deviations of the other sign, or up and down exchanged: the same ranges, the reversal with the other sign."""
    rng = np.random.default_rng(number)
    target, way = (np.tile(v, 5) for v in np.meshgrid(np.arange(6) * 0.1, [UP, DOWN]))
    target, way = target.ravel(), way.ravel()
    deviation = rng.normal(scale=5.0 * UM, size=len(target)) + np.where(way == UP, 8.0, -3.0) * UM
    one = Approaches(target, deviation, way).figures()
    for other, same in (
        (Approaches(target, -deviation, way).figures(), True),
        (Approaches(target, deviation, -way).figures(), False),
    ):
        for name in ("accuracy_m", "repeatability_m", "systematic_m", "mean_deviation_m", "reversal_m"):
            assert getattr(other, name) == pytest.approx(getattr(one, name), rel=1e-9)
        names = ("accuracy", "repeatability", "systematic")
        for figure in names:
            up, down = (f"{figure}_{d}_m" for d in ("up", "down"))
            swapped = (up, down) if same else (down, up)
            assert [getattr(other, n) for n in swapped] == pytest.approx(
                [getattr(one, n) for n in (up, down)], rel=1e-9
            )
        assert one.mean_reversal_m is not None
        assert other.mean_reversal_m == pytest.approx(-one.mean_reversal_m)
