"""Thrust of the end face of a tilted tool: closed form of the force law along its axis, mirrored with it."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.cut import Cut, cut
from counterflex.signals.preview import Mode

SPINDLE = 13000.0 / 60.0 * 2.0 * np.pi
MILL = Cutter(diameter_m=0.010, flutes=3, helix_rad=0.5, flute_length_m=0.030)
DESCENT_M_S = 0.020
AXES = ((0.0, 0.0, 1.0), (0.25, 0.0, 1.0), (-0.3, 0.2, 1.0), (0.1, -0.45, 1.0))
START, STEP, ROWS = np.array([0.0, 0.0, -6.0]) * MM, 0.25 * MM, 25


def unit(axis: tuple[float, ...]) -> Float:
    out = np.array(axis, dtype=np.float64)
    return out / np.linalg.norm(out)


def plunge(axis: Float, aside: float = 0.0) -> ToolPath:
    """Down the tool axis from above the block, and by a share of it square to the axis."""
    square = np.cross([0.0, 1.0, 0.0], axis)
    way = -axis + aside * square / np.linalg.norm(square)
    tips = START + 8 * MM * axis + (STEP * np.arange(60))[:, None] * way
    n, one = len(tips), np.ones(len(tips))
    time_s: Float = np.arange(n, dtype=np.float64) * STEP / DESCENT_M_S
    speed = DESCENT_M_S * float(np.linalg.norm(way))
    return ToolPath(
        tips, np.tile(axis, (n, 1)), np.full(n, FEED), speed * one, SPINDLE * one, time_s,
        np.zeros(n, int), np.ones(n, int),
    )  # fmt: skip


def block() -> HeightMap:
    return HeightMap.from_box((-0.02, -0.02, -0.03), (0.02, 0.02, 0.0), 0.25 * MM)


def cut_of(path: ToolPath, law: KienzleLaw, compliance: Float | None = None) -> Cut:
    mode = None if compliance is None else Mode(2.0 * np.pi * 12.0, 0.3)
    return cut(
        path, path.p_part_tcp, block(), lambda _: MILL, law, mode=mode,
        compliance_part=None if compliance is None else np.tile(compliance, (len(path), 1, 1)),
    )  # fmt: skip


def closed_form(law: KienzleLaw) -> float:
    """``N R k_r f_d^p`` of the whole end face, in the Kienzle form ``k_r1.1 f_d (f_d / 1 mm)^-m``."""
    drop = DESCENT_M_S / (MILL.flutes * SPINDLE / (2.0 * np.pi))
    return float(MILL.flutes * 0.5 * MILL.diameter_m * 273e6 * drop * (drop / MM) ** -0.3)


@pytest.mark.parametrize("axis", AXES)
def test_a_plunge_is_pushed_back_along_its_axis_by_the_force_law(axis: tuple[float, ...], law: KienzleLaw) -> None:
    u = unit(axis)
    found = cut_of(plunge(u), law).w_tcp_part[-ROWS:, :3].mean(axis=0)
    assert found @ u == pytest.approx(closed_form(law), rel=0.03)  # grain of the columns under the face
    assert np.linalg.norm(found - (found @ u) * u) < 0.03 * closed_form(law)


@pytest.mark.parametrize("aside", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("axis", AXES[1:])
def test_a_mirrored_tool_has_the_mirrored_thrust(axis: tuple[float, ...], aside: float, law: KienzleLaw) -> None:
    """Plunge and ramp: the spindle turns the same way in both, so only what it does not turn is mirrored."""
    mirror = np.array([-1.0, 1.0, 1.0])
    path = plunge(unit(axis), aside)
    other = ToolPath(
        path.p_part_tcp * mirror, path.axis_part * mirror, path.kind, path.feed_m_s, path.spindle_rad_s, path.time_s,
        path.motion, path.tool,
    )  # fmt: skip
    rows = slice(20, 45)
    first, second = (cut_of(one, law).w_tcp_part[rows, :3] for one in (path, other))
    along, mirrored = first @ unit(axis), second @ (unit(axis) * mirror)
    assert along.mean() > 0.5 * closed_form(law)
    assert mirrored.mean() == pytest.approx(along.mean(), rel=0.02)
    if aside == 0.0:
        np.testing.assert_allclose(second.mean(axis=0), first.mean(axis=0) * mirror, atol=0.03 * along.mean())


@pytest.mark.parametrize("axis", AXES[1:])
def test_a_tool_that_yields_rests_where_its_thrust_holds_it(axis: tuple[float, ...], law: KienzleLaw) -> None:
    """At rest it descends as programmed, so the deflection is compliance times the closed form, along its axis."""
    u, softness = unit(axis), 0.5e-6
    compliance = np.diag([softness] * 3 + [0.0] * 3)
    path = plunge(u)
    found = cut_of(path, law, compliance)
    bent = found.displacement_part[-ROWS:, :3].mean(axis=0)
    np.testing.assert_allclose(bent, softness * closed_form(law) * u, atol=0.05 * softness * closed_form(law))
