"""The simulated cut of a tool that turns: against that of an upright one, and the power of the spindle."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import SimulationError
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.geometry import rotation
from counterflex.twin.plant.process import StockCutting
from counterflex.twin.plant.turning.column_material import ColumnMaterial, outline_of, place_tool
from counterflex.twin.plant.turning.process import TurningProcess
from counterflex.twin.truth.truth import CuttingTruth

STEP, SPEED, SPINDLE = 0.5e-3, 25e-3, 13000.0 / 60.0 * 2.0 * np.pi
LAW = CuttingTruth(k_pa=(800e6, 280e6, 120e6), exponent=(0.25, 0.40, 0.30))
DOWN = np.diag([1.0, -1.0, -1.0])


def block(cell: float = 0.25e-3) -> HeightMap:
    return HeightMap.from_box((0.0, 0.0, -0.016), (0.024, 0.020, 0.0), cell)


def machined(process: StockCutting, tips: Float, R: Float, axes: Float | None = None) -> Float:
    """(n, 7) force, moment, depth at each step; axes are taken on through the live view of the tool frame."""
    out = np.zeros((len(tips), 7))
    process.restart(tips[0])
    process.spindle(SPINDLE)
    for k, tip in enumerate(tips):
        if axes is not None:
            R[:] = turned_to(axes[k])
        if k % 4 == 0:
            process.advance(tip)
        process.wrench(tip)
        out[k] = process.wrench_part
    return out


def turned_to(axis: Float) -> Float:
    x = np.array([1.0, 0.0, 0.0]) - axis[0] * axis
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(-axis, x), -axis], axis=1)


def straight(start: Float, end: Float) -> Float:
    count = round(float(np.linalg.norm(end - start)) / (SPEED * STEP))
    return start + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - start)


@pytest.mark.parametrize(
    "mill", [Cutter(0.010, flutes=3), Cutter(0.010, 0.005, flutes=2), Cutter(0.010, 0.001, flutes=3)]
)
def test_an_upright_tool_cuts_as_the_height_map_has_it(mill: Cutter) -> None:
    tips = straight(np.array([-0.006, 0.009, -0.003]), np.array([0.016, 0.011, -0.0035]))
    R = DOWN.copy()
    upright = machined(StockCutting(block(), mill, LAW, STEP, np.eye(4)), tips, R)
    process = TurningProcess(block(), mill, LAW, STEP, np.eye(4), R)
    turned = machined(process, tips, R)
    steady = tips[:, 0] > 0.006
    size = np.linalg.norm(upright[steady, :3], axis=1).mean()
    assert size > 50.0
    np.testing.assert_allclose(turned[steady, :3].mean(axis=0), upright[steady, :3].mean(axis=0), atol=0.02 * size)
    np.testing.assert_allclose(turned[steady, 3:6].mean(axis=0), upright[steady, 3:6].mean(axis=0), atol=1e-4 * size)


def test_the_spindle_pays_for_what_a_turning_tool_removes() -> None:
    """Without size effect and ploughing: moment about the tool axis times speed is k times the removal rate."""
    plain, mill = CuttingTruth(k_pa=(800e6, 0.0, 0.0), exponent=(0.0, 0.0, 0.0), edge_n_m=(0.0, 0.0, 0.0)), Cutter(0.01)
    tips = straight(np.array([0.012, -0.006, -0.007]), np.array([0.013, 0.012, -0.0065]))
    share = np.linspace(0.0, 1.0, len(tips))[:, None]
    axes = np.concatenate([-0.1 - 0.3 * share, 0.3 * share**2, np.ones_like(share)], axis=1)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    R = turned_to(axes[0])
    process = TurningProcess(block(), mill, plain, STEP, np.eye(4), R)
    before = volume(process.material)
    w = machined(process, tips, R, axes)
    work = float(np.sum(w[:, 3:6] * axes)) * SPINDLE * STEP
    removed = before - volume(process.finish_material())
    assert removed > 0.5e-6
    assert work == pytest.approx(800e6 * removed, rel=0.04)  # bilinear columns, material that trails the tool


def volume(material: ColumnMaterial) -> float:
    layer = np.arange(material.high.shape[2])
    tall = np.where(layer < material.held[..., None], material.high - material.low, 0.0)
    return float(tall.sum(dtype=np.float64)) * material.cell_m**2


def test_a_tilted_ball_leaves_its_own_shape() -> None:
    """Placed once in a block that it is wholly inside of but for its shank: the volume of ball and cylinder."""
    material = ColumnMaterial.of(HeightMap.from_box((-0.02, -0.02, -0.02), (0.02, 0.02, 0.02), 0.1e-3))
    before = volume(material)
    axis = rotation.exp(np.array([0.4, -0.7, 0.0])) @ np.array([0.0, 0.0, 1.0])
    parts = outline_of(Cutter(0.006, 0.003), 0.010)
    assert place_tool(material.low, material.high, material.held, material.grid, np.zeros(3), axis, parts)
    expected = 2.0 / 3.0 * np.pi * 0.003**3 + np.pi * 0.003**2 * 0.007
    assert before - volume(material) == pytest.approx(expected, rel=2e-3)


def test_a_shank_in_the_material_is_refused() -> None:
    short = Cutter(0.010, flutes=3, flute_length_m=0.004)
    R = turned_to(np.array([-0.2, 0.0, 1.0]) / np.hypot(0.2, 1.0))
    process = TurningProcess(block(), short, LAW, STEP, np.eye(4), R)
    with pytest.raises(SimulationError, match="deeper in the stock than its flutes"):
        machined(process, straight(np.array([0.012, -0.008, -0.008]), np.array([0.012, 0.004, -0.008])), R)
