"""Coarse bodies and their distances: closed forms, another library, and every row of a path instead of a choice."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import coal
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.files.cell.bodies import Frame
from counterflex.geometry import pose, rotation
from counterflex.plan.preflight import bodies as coarse
from counterflex.plan.preflight.bodies import CollisionBody, along, box
from counterflex.plan.preflight.collision import NEAR_M, PartAlongPath, Scene, closest, collision_rows, poses
from counterflex.plan.preflight.sweep import sweep_of_flange, sweep_of_joints
from counterflex.robot.elasticity.chain import ElasticChain, forward, frames
from counterflex.robot.model import catalog
from counterflex.robot.model.description import EndEffector

X, Y, Z = np.eye(3)
TCP = pose.make(rotation.about_y(np.pi / 2), np.array([0.24, 0.0, 0.15]))
"""Spindle across the flange: the tool along its x, 150 mm off."""
HOME = np.radians([0.0, -90.0, 90.0, 0.0, 20.0, 0.0])


@pytest.fixture(scope="module")
def chain() -> ElasticChain:
    return ElasticChain.build(catalog.load("kuka_kr300_r2500_ultra"), EndEffector((), TCP))


def distance(first: CollisionBody, second: CollisionBody, T_a: Float | None = None, T_b: Float | None = None) -> float:
    scene = Scene([first, second])
    at = [np.eye(4) if T is None else T for T in (T_a, T_b)]
    scene.place(np.stack([T @ body.T_frame_body for T, body in zip(at, (first, second), strict=True)]))
    return scene.distance(0, 1)


def capsule(p: Float, to: Float, radius_m: float = 0.1) -> CollisionBody:
    return along("capsule", "base", p, to, radius_m)


CUBE = box("box", "base", np.array([-0.1, -0.2, -0.3]), np.array([0.1, 0.2, 0.3]))


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        (capsule(-X, X), capsule(-X + Z, X + Z), 0.8),  # parallel
        (capsule(-X, X), capsule(-Y + 0.5 * Z, Y + 0.5 * Z), 0.3),  # crossed
        (capsule(-X, X), capsule(2 * X, 3 * X), 0.8),  # in line
        (capsule(0 * X, X), capsule(X + 3 * Y + 4 * Z, 2 * X + 3 * Y + 4 * Z), 4.8),  # end to end
        (capsule(-X, X), capsule(-Y + 0.15 * Z, Y + 0.15 * Z), -0.05),  # overlap by 50 mm
        (capsule(0 * X, 0 * X), capsule(Y, Y), 0.8),  # spheres
        (capsule(Y, Y + Z), CUBE, 0.7),  # beside a face
        (capsule(np.array([0.4, 0.6, -1.0]), np.array([0.4, 0.6, 1.0])), CUBE, 0.4),  # beside an edge: 3-4-5
        (capsule(np.array([0.4, 0.6, 0.3 + 1.2]), np.array([0.4, 0.6, 3.0])), CUBE, 1.2),  # off a corner: 3-4-12
        (capsule(0 * X, Z, 0.05), box("b", "base", np.array([0.0, -1, -1]), np.array([2.0, 1, 1])), -0.05),
        (along("c", "base", Z, 2 * Z, 0.1, "cylinder"), CUBE, 0.7),  # no cap above
        (along("c", "base", Y, Y + X, 0.1, "cylinder"), CUBE, 0.7),
        (CUBE, box("b", "base", np.array([1.1, 0, 0]), np.array([2.0, 1, 1])), 1.0),
    ],
)
def test_distances_are_those_of_closed_forms(first: CollisionBody, second: CollisionBody, expected: float) -> None:
    assert distance(first, second) == pytest.approx(expected, abs=1e-6)
    assert distance(second, first) == pytest.approx(expected, abs=1e-6)


def _segments(p: Float, u: Float, q: Float, v: Float) -> float:
    """Distance of two segments p + s u, q + t v, s and t in 0..1: where both slopes or an end is least."""
    pairs = [(s, t) for s in (0.0, 1.0) for t in (0.0, 1.0)]
    w = p - q
    a, b, c, d, e = u @ u, u @ v, v @ v, u @ w, v @ w
    pairs += [(s, float(np.clip((e + s * b) / c, 0.0, 1.0))) for s in (0.0, 1.0)]
    pairs += [(float(np.clip((t * b - d) / a, 0.0, 1.0)), t) for t in (0.0, 1.0)]
    if a * c - b * b > 1e-12:
        s, t = float((b * e - c * d) / (a * c - b * b)), float((a * e - b * d) / (a * c - b * b))
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            pairs.append((s, t))
    return min(float(np.linalg.norm(w + s * u - t * v)) for s, t in pairs)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=12, max_size=12))
def test_capsules_anywhere_are_as_far_as_their_axes_less_their_radii(numbers: list[float]) -> None:
    p, a, q, b = np.array(numbers).reshape(4, 3)
    if min(np.linalg.norm(a - p), np.linalg.norm(b - q)) < 0.05:
        return
    between = _segments(p, a - p, q, b - q)
    if between < 1e-3:
        return
    assert distance(capsule(p, a, 0.05), capsule(q, b, 0.03)) == pytest.approx(between - 0.08, abs=2e-6)


def test_bodies_at_random_are_as_far_as_another_library_has_them() -> None:
    rng = np.random.default_rng(14)
    shapes = {
        "box": lambda s: coal.Box(*(2.0 * np.array(s))),
        "capsule": lambda s: coal.Capsule(s[0], 2.0 * s[1]),
        "cylinder": lambda s: coal.Cylinder(s[0], 2.0 * s[1]),
    }
    apart = deep = 0
    for _ in range(100):
        made, other, Ts = [], [], []
        for _ in range(2):
            shape = str(rng.choice(list(shapes)))
            size = tuple(rng.uniform(0.05, 0.4, 3 if shape == "box" else 2).tolist())
            T = pose.make(rotation.exp(rng.normal(size=3)), rng.uniform(-0.8, 0.8, 3))
            made.append(CollisionBody("b", "base", shape, np.eye(4), size))  # type: ignore[arg-type]
            other.append(shapes[shape](size))
            Ts.append(T)
        result = coal.DistanceResult()
        coal.distance(
            other[0], coal.Transform3s(Ts[0][:3, :3], Ts[0][:3, 3]),
            other[1], coal.Transform3s(Ts[1][:3, :3], Ts[1][:3, 3]), coal.DistanceRequest(), result,
        )  # fmt: skip
        ours = distance(made[0], made[1], *Ts)
        assert (ours > 0.0) == (result.min_distance > 0.0), made
        deep += ours < 0.0
        if result.min_distance > 0.0:
            apart += 1
            assert ours == pytest.approx(result.min_distance, abs=5e-6)
    assert min(apart, deep) > 15


def test_a_link_through_the_table_is_no_clear_way() -> None:
    """Random capsules whose axis runs through a box: each overlaps it by its radius at least."""
    rng = np.random.default_rng(3)
    for _ in range(60):
        inside = rng.uniform(-0.9, 0.9, 3) * CUBE.size_m
        way = rng.normal(size=3)
        piercing = capsule(inside - rng.uniform(0.1, 1.0) * way, inside + rng.uniform(0.1, 1.0) * way, 0.05)
        assert distance(piercing, CUBE) <= -0.05 + 1e-5
    assert distance(capsule(-X, X, 0.05), CUBE) <= -0.05 + 1e-5  # through its middle
    assert distance(along("c", "base", -X, X, 0.05, "cylinder"), CUBE) < -0.04


def test_capsules_of_links_end_at_the_joints(chain: ElasticChain) -> None:
    """Joint frames at the test pose, from the kinematics; the arm is 1150 mm long, the forearm reaches its wrist."""
    links = coarse.links(chain)
    placed = poses(chain, links, HOME[None], PartAlongPath(np.eye(4)))[0]
    joints = frames(chain, HOME)[chain.joint >= 0][:, :3, 3]
    by_name = {body.name: (T[:3, 3] - b.size_m[1] * T[:3, 2], T[:3, 3] + b.size_m[1] * T[:3, 2])
               for body, b, T in zip(links, links, placed, strict=True)}  # fmt: skip
    assert np.linalg.norm(joints[2] - joints[1]) == pytest.approx(1.15)
    assert by_name["link arm"][0] == pytest.approx(joints[1])
    assert by_name["link arm"][1] == pytest.approx(joints[2])
    assert by_name["elbow"][1] == pytest.approx(joints[3])
    forearm = next(body for body in links if body.name == "forearm")
    end = by_name["forearm"][1] + forearm.size_m[0] * (joints[4] - joints[3]) / np.linalg.norm(joints[4] - joints[3])
    assert end == pytest.approx(joints[4])
    assert by_name["hand"][1] == pytest.approx((forward(chain, HOME) @ pose.inverse(TCP))[:3, 3])


def test_assumed_radii_go_with_the_arm(chain: ElasticChain) -> None:
    """Shares of the length along the joints; an arm whose numbers say less gets the same for every link."""
    reach = coarse.arm_reach(chain)
    joints = frames(chain, HOME)[chain.joint >= 0][:, :3, 3]
    flange = (forward(chain, HOME) @ pose.inverse(TCP))[:3, 3]
    assert reach == pytest.approx(np.linalg.norm(np.diff([*joints[1:], flange], axis=0), axis=1).sum())
    assert [body.size_m[0] for body in coarse.links(chain)] == pytest.approx(
        np.array([*coarse.SHARES.values()]) * reach
    )
    slender = coarse.links(replace(chain, opw=None))
    assert {round(body.size_m[0] / reach, 9) for body in slender} == {coarse.SLENDER_SHARE}
    assert coarse.carried(chain, {}, {})[0].size_m[0] == pytest.approx(coarse.SPINDLE_SHARE * reach)


def test_tool_and_spindle_lie_behind_the_tip(chain: ElasticChain) -> None:
    cutter = Cutter(diameter_m=0.016, flutes=3, helix_rad=0.5, flute_length_m=0.035)
    spindle, bracket, tool = coarse.carried(chain, {1: cutter}, {})
    assert (tool.tool, tool.shape) == (1, "cylinder")
    assert tool.size_m == pytest.approx((0.008, 0.5 * 0.051))
    assert tool.T_frame_body[:3, 3] == pytest.approx([0.0, 0.0, -0.5 * 0.051])
    nose = spindle.T_frame_body[2, 3] + spindle.size_m[1] + spindle.size_m[0]
    assert nose == pytest.approx(-0.051)
    back = spindle.T_frame_body[2, 3] - spindle.size_m[1]
    assert back == pytest.approx(-0.24)
    long, known = coarse.carried(chain, {1: cutter}, {1: 0.08})[::2]
    assert long.T_frame_body[2, 3] + long.size_m[1] + long.size_m[0] == pytest.approx(-0.08)
    assert 2.0 * known.size_m[1] == pytest.approx(0.08)
    ends = bracket.T_frame_body[:3, 3] + np.outer([-1.0, 1.0], bracket.size_m[1] * bracket.T_frame_body[:3, 2])
    flange = pose.inverse(TCP)[:3, 3]
    assert min(np.linalg.norm(ends - flange, axis=1)) == pytest.approx(0.0, abs=1e-12)


def test_stock_and_table_lie_on_each_other() -> None:
    stock, table = coarse.part_bodies(HeightMap.from_box((0.0, 0.0, -0.02), (0.06, 0.04, 0.0), 0.5 * MM))
    assert 2.0 * np.array(stock.size_m) == pytest.approx([0.06, 0.04, 0.02])
    assert stock.T_frame_body[:3, 3] == pytest.approx([0.03, 0.02, -0.01])
    assert table.T_frame_body[2, 3] + table.size_m[2] == pytest.approx(-0.02)
    assert distance(stock, table) == pytest.approx(0.0, abs=2e-5)  # touching bodies are asked again 10 um apart


def test_what_is_compared() -> None:
    names = {"foot": "base", "column": "joint1", "link arm": "joint2", "forearm": "joint4", "hand": "joint6"}
    made = [along(name, frame, np.zeros(3), Z, 0.1) for name, frame in names.items()]
    made += [
        along("spindle", "tcp", np.zeros(3), Z, 0.1),
        replace(along("tool T1", "tcp", np.zeros(3), Z, 0.01, tool=1), cuts=True),
    ]
    made += [box("stock", "part", -X - Y - Z, X + Y + Z), box("table", "part", -X - Y - Z, X + Y + Z)]
    outer, inner = coarse.pairs(made)
    named = {(made[a].name, made[b].name) for a, b in outer}
    moving = {"column", "link arm", "forearm", "hand", "spindle"}
    made_holder = [along("holder of T1", "tcp", np.zeros(3), Z, 0.02, tool=1), *made]
    assert ("holder of T1", "stock") in {
        (made_holder[a].name, made_holder[b].name) for a, b in coarse.pairs(made_holder)[0]
    }
    expected = {(a, b) for a in moving for b in ("stock", "table")} | {("tool T1", "table")}
    assert named == expected  # the tool cuts the stock, the foot stands still
    assert {(made[a].name, made[b].name) for a, b in inner} == {
        ("spindle", link) for link in ("foot", "column", "link arm", "forearm")
    }


def test_bodies_of_a_cell_file_replace_those_of_their_name() -> None:
    assumed = [along("spindle", "tcp", 0 * Z, Z, 0.1), along("tool T1", "tcp", 0 * Z, Z, 0.01, tool=1), CUBE]
    mine = along("tool T1", "tcp", 0 * Z, -Z, 0.02, assumed=False)
    present = coarse.with_given(assumed, [mine, capsule(X, Y)], ["box"])
    assert [body.name for body in present] == ["spindle", "tool T1", "capsule"]
    assert (present[1].tool, present[1].size_m[0]) == (1, 0.02)  # still the tool that cuts the stock


def test_frames_of_the_file_are_those_of_the_bodies() -> None:
    assert get_args(Frame) == coarse.FRAMES


def swing(n: int = 400, seed: int = 0) -> Float:
    """(n, 6) rad, joints that wander back and forth in straight lines: what is closest is so for a moment only."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, n)[:, None]
    q: Float = HOME + 0.2 * np.arcsin(np.sin(2 * np.pi * (t * rng.uniform(0.5, 2.0, 6) + rng.uniform(0.0, 1.0, 6))))
    return q


@pytest.mark.parametrize("seed", range(3))
def test_closest_is_that_of_all_rows(chain: ElasticChain, seed: int) -> None:
    """Rows are left out by how far bodies can have moved; the result is that of looking at every one."""
    made = [
        *coarse.links(chain),
        *coarse.carried(chain, {}, {}),
        box("post", "base", np.array([1.2, 0.5, 0.0]), np.array([1.4, 0.7, 2.0])),
    ]
    outer, inner = coarse.pairs(made)
    q, tool = swing(1000, seed), np.zeros(1000, dtype=np.int64)
    scene, placed = Scene(made), poses(chain, made, q, PartAlongPath(np.eye(4)))
    for compared in (outer, inner):
        every = []
        for Ts in placed:
            scene.place(Ts)
            every.append(min(scene.distance(a, b) for a, b in compared))
        found = closest(chain, made, compared, q, tool, PartAlongPath(np.eye(4)))
        assert found is not None
        assert min(every) <= found.distance_m <= min(every) + NEAR_M
        assert every[found.point] == pytest.approx(found.distance_m, abs=1e-9)


def test_no_body_moves_farther_than_its_bound(chain: ElasticChain) -> None:
    made = [*coarse.links(chain), *coarse.carried(chain, {}, {})]
    q, tool = swing(200, 5), np.zeros(200, dtype=np.int64)
    placed = poses(chain, made, q, PartAlongPath(np.eye(4)))
    joints, flange = sweep_of_joints(chain, made, q, tool), sweep_of_flange(chain, made, q, tool)
    pairs_of_rows = np.random.default_rng(2).integers(0, len(q), (300, 2)).tolist()
    for k, body in enumerate(made):
        end = np.array([0.0, 0.0, body.size_m[1] + body.size_m[0], 1.0])
        for tip in (end, end * [1, 1, -1, 1]):
            p = (placed[:, k] @ tip)[:, :3]
            for sweep in (joints, flange) if body.link == 6 else (joints,):
                assert np.all(np.linalg.norm(np.diff(p, axis=0), axis=1) <= np.diff(sweep.moved) + 1e-12)
                for a, b in pairs_of_rows:
                    assert np.linalg.norm(p[a] - p[b]) <= sweep.motion(a, b) + 1e-12


def test_a_tool_counts_only_while_it_is_in_the_spindle(chain: ElasticChain) -> None:
    """Tool 2 is long enough to reach the post; it is looked at in the rows in which it is there."""
    long = replace(along("tool T2", "tcp", 0 * Z, Z, 0.01, "cylinder", tool=2), cuts=True)
    T = forward(chain, HOME)
    post = box("post", "base", T[:3, 3] + 0.5 * T[:3, 2] - 0.05, T[:3, 3] + 0.5 * T[:3, 2] + 0.05)
    q = np.tile(HOME, (5, 1))
    rows = collision_rows(chain, [long, post], q, np.array([1, 1, 2, 2, 1]), PartAlongPath(np.eye(4)), 0.02)
    assert (rows[1].verdict, rows[1].point) == ("fail", 2)
    assert "size assumed" in rows[1].advice
    assert (
        collision_rows(chain, [long, post], q, np.ones(5, dtype=np.int64), PartAlongPath(np.eye(4)), 0.02)[1].verdict
        == "not looked at"
    )


@pytest.mark.parametrize(("gap_m", "verdict"), [(0.03, "ok"), (0.01, "warning"), (-0.001, "fail")])
def test_clearance_warns_and_contact_fails(chain: ElasticChain, gap_m: float, verdict: str) -> None:
    ball = along("spindle", "tcp", 0 * Z, 0 * Z, 0.1, assumed=False)
    p = forward(chain, HOME)[:3, 3]
    low, high = np.array([0.1 + gap_m, -1.0, -1.0]), np.array([0.3, 1.0, 1.0])
    wall = box("wall", "base", p + low, p + high, assumed=False)
    row = collision_rows(chain, [ball, wall], HOME[None], np.zeros(1, dtype=np.int64), PartAlongPath(np.eye(4)), 0.02)[
        0
    ]
    assert (row.verdict, row.what) == (verdict, "spindle to wall")
    assert row.value == pytest.approx(gap_m, abs=1e-5)
    assert "assumed" not in row.advice
