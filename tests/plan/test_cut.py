"""Cutting a path in the model: force against closed forms, displacement against statics, order in time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import quad

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ModelError, ProgramError
from counterflex.core.units import MM
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.path.toolpath import FEED, RAPID, ToolPath
from counterflex.plan.cut import cut
from counterflex.signals.preview import Mode

PathOf = Callable[..., ToolPath]
Block = Callable[..., HeightMap]
FEED_TOOTH = 1.5 / 13000 / 3
"""1500 mm/min, 13 000 rpm, three teeth: m."""


def kienzle_mean(law: KienzleLaw, teeth: int, depth_m: float, first: float, last: float) -> Float:
    """Mean force in the feed frame by quadrature of the edge force over the revolution (x feed, y left, z up)."""
    k11, h1 = law.k11_pa(), 1e-3

    def pressure(k: float, m: float, phi: float) -> float:
        h = FEED_TOOTH * np.sin(phi)
        return float(k * h * (h / h1) ** -m)

    def part(k: float, m: float, turn: Callable[[float], float]) -> float:
        return float(quad(lambda phi: pressure(k, m, phi) * turn(phi), first, last)[0])

    tangential, radial, axial = zip(k11, (law.mc, law.mr, law.ma), strict=True)
    fx = -part(*tangential, np.cos) - part(*radial, np.sin)
    fy = part(*tangential, np.sin) - part(*radial, np.cos)
    fz = -part(*axial, lambda _: 1.0)  # right-hand helix: the part holds the tool
    out: Float = np.array([fx, fy, fz]) * teeth * depth_m / (2.0 * np.pi)
    return out


def middle(path: ToolPath, low_mm: float, high_mm: float, axis: int = 0) -> Float:
    """Rows whose whole segment lies between two stations."""
    p = path.p_part_tcp[:, axis] / MM
    before = np.concatenate([[np.nan], p[:-1]])
    out: Float = (path.kind == FEED) & (np.minimum(p, before) >= low_mm) & (np.maximum(p, before) <= high_mm)
    return out


def middle_mean(values: Float, path: ToolPath) -> Float:
    """Mean over the rows between 15 and 25 mm."""
    out: Float = values[middle(path, 15, 25)].mean(axis=0)
    return out


@pytest.mark.parametrize(
    ("name", "y", "first", "last"),
    [("slot", 15.0, 0.0, np.pi), ("up", 0.0, 0.0, 0.5 * np.pi), ("down", 30.0, 0.5 * np.pi, np.pi)],
)
def test_undisturbed_force_is_the_closed_form(
    law: KienzleLaw, cutter: Cutter, path_of: PathOf, block: Block, name: str, y: float, first: float, last: float
) -> None:
    path = path_of(f"G0 Z10\nG0 X-10 Y{y}\nG0 Z-3\nG1 X70 F1500")
    found = cut(path, path.p_part_tcp, block((0, 0), (60, 30), 0.1), lambda _: cutter, law)
    force = found.w_tcp_part[middle(path, 10, 50), :3].mean(axis=0)
    expected = kienzle_mean(law, 3, 3 * MM, first, last)
    assert np.linalg.norm(force - expected) < (2e-3 if name == "slot" else 5e-3) * np.linalg.norm(expected)
    assert found.feed_per_tooth_m[middle(path, 10, 50)] == pytest.approx(FEED_TOOTH, rel=1e-9)
    assert np.all(found.displacement_part == 0.0)


def test_force_follows_the_feed_direction(law: KienzleLaw, cutter: Cutter, path_of: PathOf, block: Block) -> None:
    along_x = path_of("G0 Z10\nG0 X-10 Y30\nG0 Z-2\nG1 X70 F1500")
    along_y = path_of("G0 Z10\nG0 X30 Y-10\nG0 Z-2\nG1 Y70 F1500")
    size = ((0, 0), (60, 60), 0.2)
    fx = cut(along_x, along_x.p_part_tcp, block(*size), lambda _: cutter, law).w_tcp_part
    fy = cut(along_y, along_y.p_part_tcp, block(*size), lambda _: cutter, law).w_tcp_part
    a = fx[middle(along_x, 10, 50), :3].mean(axis=0)
    b = fy[middle(along_y, 10, 50, 1), :3].mean(axis=0)
    assert b == pytest.approx([-a[1], a[0], a[2]], rel=5e-3)


def test_up_milling_pushes_back_and_down_milling_pulls_ahead(
    law: KienzleLaw, cutter: Cutter, path_of: PathOf, block: Block
) -> None:
    forces = {}
    for name, y in (("up", 0.0), ("down", 30.0)):
        path = path_of(f"G0 Z10\nG0 X-10 Y{y}\nG0 Z-3\nG1 X70 F1500")
        found = cut(path, path.p_part_tcp, block((0, 0), (60, 30)), lambda _: cutter, law)
        forces[name] = found.w_tcp_part[middle(path, 10, 50), :3].mean(axis=0)
        engaged = middle(path, 10, 50)
        span = (0.0, 90.0) if name == "up" else (90.0, 180.0)
        # The end that lies along the feed is ill-posed on a grid (the chip is zero there): one cell is 9 deg.
        assert np.degrees(np.nanmedian(found.entry_rad[engaged])) == pytest.approx(span[0], abs=12.0)
        assert np.degrees(np.nanmedian(found.exit_rad[engaged])) == pytest.approx(span[1], abs=12.0)
    assert forces["up"][0] < 0.0 < forces["down"][0]  # against the feed, with the feed
    assert 0.0 < forces["up"][1] < forces["down"][1]


def test_bending_tool_reaches_the_static_deflection(
    law: KienzleLaw, cutter: Cutter, path_of: PathOf, block: Block, stiffness: Callable[[int], Float]
) -> None:
    path = path_of("G0 Z10\nG0 X-10 Y15\nG0 Z-4\nG1 X130 F1500")
    C = stiffness(len(path))
    C[:, 0, 1] = C[:, 1, 0] = 3e-7  # coupled directions
    C[:, 2, 2] = 0.0  # keeps the depth, and so the force, what it is without bending
    undisturbed = cut(path, path.p_part_tcp, block((0, 0), (120, 30), 0.05), lambda _: cutter, law)
    bent = cut(
        path, path.p_part_tcp, block((0, 0), (120, 30), 0.05), lambda _: cutter, law,
        compliance_part=C, mode=Mode(2 * np.pi * 8, 0.2),
    )  # fmt: skip
    late = middle(path, 60, 110)
    expected = C[0] @ undisturbed.w_tcp_part[late].mean(axis=0)
    met = bent.displacement_part[late].mean(axis=0)
    assert np.linalg.norm(expected[:3]) > 0.3 * MM
    assert np.linalg.norm(met[:3] - expected[:3]) < 0.01 * np.linalg.norm(expected[:3])
    assert np.max(np.linalg.norm(bent.displacement_part[late, :3] - expected[:3], axis=1)) < 0.05 * np.linalg.norm(
        expected[:3]
    )


def test_whole_path_iteration_diverges_at_entry_and_exit_and_the_order_in_time_does_not(
    law: KienzleLaw, cutter: Cutter, path_of: PathOf, block: Block, stiffness: Callable[[int], Float]
) -> None:
    path = path_of("G0 Z10\nG0 X-12 Y15\nG0 Z-9.5\nG1 X52 F1500", step_mm=0.25)
    C = stiffness(len(path))
    size = ((0, 0), (40, 30), 0.1)
    displaced, peaks = path.p_part_tcp, []
    for _ in range(4):
        found = cut(path, displaced, block(*size), lambda _: cutter, law)
        peaks.append(float(np.linalg.norm(found.w_tcp_part[:, :3], axis=1).max()))
        displaced = path.p_part_tcp + (C @ found.w_tcp_part[..., None])[:, :3, 0]
    assert peaks[1] > 1.3 * peaks[0]
    assert peaks[2] > 1.5 * peaks[1]
    causal = cut(
        path, path.p_part_tcp, block(*size), lambda _: cutter, law, compliance_part=C, mode=Mode(2 * np.pi * 8, 0.1)
    )
    assert np.linalg.norm(causal.w_tcp_part[:, :3], axis=1).max() < 1.15 * peaks[0]
    static = (C[0] @ found.w_tcp_part[path.kind == FEED].T).T
    assert np.isfinite(static).all()
    steady = np.linalg.norm((C[0] @ middle_mean(causal.w_tcp_part, path))[:3])
    largest = np.linalg.norm(causal.displacement_part[:, :3], axis=1).max()
    assert steady < largest < 1.8 * steady  # a step of force on a mode of damping 0.1 overshoots by 1.73


@pytest.mark.parametrize("step_mm", [0.05, 0.2, 0.5, 1.5])
def test_bending_does_not_depend_on_how_the_path_is_sampled(
    law: KienzleLaw, cutter: Cutter, path_of: PathOf, block: Block, stiffness: Callable[[int], Float], step_mm: float
) -> None:
    path = path_of("G0 Z10\nG0 X-12 Y15\nG0 Z-9.5\nG1 X72 F1500", step_mm=step_mm)
    bent = cut(
        path, path.p_part_tcp, block((0, 0), (60, 30)), lambda _: cutter, law,
        compliance_part=stiffness(len(path)), mode=Mode(2 * np.pi * 8, 0.1),
    )  # fmt: skip
    size = np.linalg.norm(bent.displacement_part[:, :3], axis=1)
    assert 1.40 * MM < size.max() < 1.55 * MM
    assert np.linalg.norm(bent.displacement_part[middle(path, 20, 50), :3].mean(axis=0)) == pytest.approx(
        1.426 * MM, rel=0.003
    )


@pytest.mark.parametrize("slope", [1 / 8, 1 / 20, 1 / 60])
def test_descending_tool_stays_calm(
    law: KienzleLaw, cutter: Cutter, path_of: PathOf, block: Block, stiffness: Callable[[int], Float], slope: float
) -> None:
    path = path_of(f"G0 Z10\nG0 X20 Y15\nG0 Z1\nG1 Z0 F600\nG1 X80 Z{-60 * slope:.4f} F600", step_mm=0.25)
    undisturbed = cut(path, path.p_part_tcp, block((0, 0), (100, 30)), lambda _: cutter, law)
    C = stiffness(len(path))
    bent = cut(
        path, path.p_part_tcp, block((0, 0), (100, 30)), lambda _: cutter, law,
        compliance_part=C, mode=Mode(2 * np.pi * 8, 0.1),
    )  # fmt: skip
    late = middle(path, 40, 79)
    static = (C @ undisturbed.w_tcp_part[..., None])[..., 0]
    assert np.max(np.abs(bent.displacement_part[late, 2] - static[late, 2])) < 0.25 * np.max(static[late, 2])


@pytest.mark.parametrize("corner", [0.0, 1.0, 5.0])
def test_a_plunge_that_drifts_a_little_bears_no_side_force(
    law: KienzleLaw, path_of: PathOf, block: Block, corner: float
) -> None:
    """The rear of the tool cuts as the front does; only a drift worth the name tips the balance."""
    tool = Cutter(diameter_m=0.01, corner_radius_m=corner * MM, flutes=2, helix_rad=0.5, flute_length_m=0.025)
    sides = []
    for drift in (0.0, 0.001, 0.1):
        path = path_of(f"G0 Z10\nG0 X20 Y15\nG0 Z0.5\nG1 X{20 + drift} Z-2 F1500", step_mm=0.05)
        found = cut(path, path.p_part_tcp, block((0, 0), (40, 30), 0.1), lambda _: tool, law)
        deep = (path.kind == FEED) & (path.p_part_tcp[:, 2] < -1.5 * MM)
        force = found.w_tcp_part[deep, :3].mean(axis=0)
        assert force[2] > 100.0
        sides.append(float(np.hypot(*force[:2]) / force[2]))
    assert sides[0] < 1e-9
    assert sides[1] < 1e-2
    assert sides[2] < 0.05


def test_dwell_cuts_nothing_and_lets_the_tool_swing_back(
    law: KienzleLaw, cutter: Cutter, path_of: PathOf, block: Block, stiffness: Callable[[int], Float]
) -> None:
    path = path_of("G0 Z10\nG0 X-10 Y15\nG0 Z-2\nG1 X20 F1500\nG4 P2\nG1 X30")
    undisturbed = cut(path, path.p_part_tcp, block((0, 0), (40, 30)), lambda _: cutter, law)
    standing = np.flatnonzero(np.diff(path.time_s) > 1.0) + 1
    assert len(standing) == 1
    assert undisturbed.volume_m3[standing] == 0.0
    assert np.all(undisturbed.w_tcp_part[standing] == 0.0)
    bent = cut(
        path, path.p_part_tcp, block((0, 0), (40, 30)), lambda _: cutter, law,
        compliance_part=stiffness(len(path)), mode=Mode(2 * np.pi * 8, 0.1),
    )  # fmt: skip
    assert np.linalg.norm(bent.displacement_part[standing, :3]) < 0.02 * MM
    assert np.linalg.norm(bent.displacement_part[standing - 1, :3]) > 0.1 * MM


def test_rapid_through_material_is_reported_and_bears_no_force(
    law: KienzleLaw, cutter: Cutter, path_of: PathOf, block: Block
) -> None:
    path = path_of("G0 Z10\nG0 X-10 Y15\nG0 Z-2\nG0 X20\nG1 X50 F1500")
    found = cut(path, path.p_part_tcp, block((0, 0), (40, 30)), lambda _: cutter, law)
    hit = found.collisions(path.kind)
    assert len(hit) > 0
    assert np.all(path.kind[hit] == RAPID)
    assert np.all(found.w_tcp_part[path.kind == RAPID] == 0.0)
    removed = found.volume_m3[path.kind == RAPID].sum()
    assert removed == pytest.approx((20 * 16 + np.pi * 64 / 2) * 2 * MM**3, rel=1e-2)


def test_each_tool_cuts_with_its_own_edges(law: KienzleLaw, path_of: PathOf, block: Block) -> None:
    tools = {
        1: Cutter(diameter_m=0.016, flutes=3, helix_rad=0.5, flute_length_m=0.035),
        2: Cutter(diameter_m=0.008, flutes=2, helix_rad=0.5, flute_length_m=0.035),
    }
    body = "G0 Z10\nG0 X-10 Y10\nG0 Z-2\nG1 X70 F1500\nG0 Z10\nM6 T2\nM3 S13000\nG0 X-10 Y30\nG0 Z-2\nG1 X70 F1500"
    path = path_of(body)
    found = cut(path, path.p_part_tcp, block((0, 0), (60, 40), 0.1), tools.__getitem__, law)
    engaged = middle(path, 10, 50)
    first = found.w_tcp_part[engaged & (path.tool == 1), :3].mean(axis=0)
    second = found.w_tcp_part[engaged & (path.tool == 2), :3].mean(axis=0)
    assert first == pytest.approx(kienzle_mean(law, 3, 2 * MM, 0.0, np.pi), rel=5e-3)
    # Two teeth at the same feed: half as many revolutions' chips, each 1.5 times as thick.
    share = 2 / 3 * 1.5 ** (1 - np.array([law.mr, law.mc, law.ma]))
    assert second == pytest.approx(first * share, rel=1e-2)
    only_first = cut(path, path.p_part_tcp, block((0, 0), (60, 40), 0.1), lambda _: tools[1], law)
    assert only_first.volume_m3.sum() > found.volume_m3.sum()


def test_same_input_gives_the_same_bits(
    law: KienzleLaw, cutter: Cutter, path_of: PathOf, block: Block, stiffness: Callable[[int], Float]
) -> None:
    path = path_of("G0 Z10\nG0 X-10 Y15\nG0 Z-4\nG1 X20 F1500\nG3 X30 Y25 I0 J10\nG1 Y45")
    runs = [
        cut(
            path, path.p_part_tcp, block((0, 0), (40, 30)), lambda _: cutter, law,
            compliance_part=stiffness(len(path)), mode=Mode(2 * np.pi * 8, 0.1),
        )
        for _ in range(2)
    ]  # fmt: skip
    for name in runs[0].__dataclass_fields__:
        assert np.array_equal(getattr(runs[0], name), getattr(runs[1], name), equal_nan=True), name


def test_part_of_a_path_is_cut_as_within_the_whole(
    law: KienzleLaw, cutter: Cutter, path_of: PathOf, block: Block
) -> None:
    """Rows are handed to the kernel in portions; where one ends must not show."""
    coarse = path_of("G0 Z10\nG0 X-10 Y15\nG0 Z-4\nG1 X70 F1500", step_mm=0.02)
    found = cut(coarse, coarse.p_part_tcp, block((0, 0), (60, 30)), lambda _: cutter, law)
    assert len(coarse) > 3900
    fine = middle(coarse, 15, 51)
    force = found.w_tcp_part[fine, 1]
    sums = np.add.reduceat(force, np.arange(0, len(force), 100)) / 100
    assert np.std(sums[:-1]) < 0.002 * np.mean(force)


def test_stopped_spindle_is_refused(law: KienzleLaw, cutter: Cutter, path_of: PathOf, block: Block) -> None:
    path = path_of("G0 Z10\nG0 X-10 Y15\nG0 Z-2\nG1 X30 F1500", head="G21 G17 G90 G94\nT1 M6\n")
    with pytest.raises(ProgramError, match="spindle stopped"):
        cut(path, path.p_part_tcp, block((0, 0), (40, 30)), lambda _: cutter, law)


def test_backward_spindle_is_refused(law: KienzleLaw, cutter: Cutter, path_of: PathOf, block: Block) -> None:
    path = path_of("G0 Z10\nG0 X-10 Y15\nG0 Z-2\nG1 X30 F1500", head="G21 G17 G90 G94\nT1 M6\nM4 S13000\n")
    with pytest.raises(ModelError, match="M3"):
        cut(path, path.p_part_tcp, block((0, 0), (40, 30)), lambda _: cutter, law)


def test_spindle_may_stand_in_the_air(law: KienzleLaw, cutter: Cutter, path_of: PathOf, block: Block) -> None:
    path = path_of("G0 Z10\nG1 X-10 Y15 F1500\nG1 X30\nM3 S100\nG1 X50", head="G21 G17 G90 G94\nT1 M6\n")
    found = cut(path, path.p_part_tcp, block((0, 0), (40, 30)), lambda _: cutter, law)
    assert np.all(found.volume_m3 == 0.0)


def test_bending_needs_compliance_and_mode(law: KienzleLaw, cutter: Cutter, path_of: PathOf, block: Block) -> None:
    path = path_of("G0 Z10\nG0 X-10 Y15\nG1 X30 F1500")
    with pytest.raises(InputError):
        cut(
            path, path.p_part_tcp, block((0, 0), (40, 30)), lambda _: cutter, law,
            compliance_part=np.zeros((len(path), 6, 6)),
        )  # fmt: skip
    with pytest.raises(InputError):
        cut(path, path.p_part_tcp[:-1], block((0, 0), (40, 30)), lambda _: cutter, law)


def test_progress_may_interrupt(law: KienzleLaw, cutter: Cutter, path_of: PathOf, block: Block) -> None:
    path = path_of("G0 Z10\nG0 X-10 Y15\nG0 Z-2\nG1 X30 F1500")

    def stop(fraction: float, what: str = "") -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cut(path, path.p_part_tcp, block((0, 0), (40, 30)), lambda _: cutter, law, progress=stop)
