"""The grain of the stock's cells: what it is, where stock is made finer, and that a trial then shows less of it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from counterflex.app.inputs import setting_of
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan import stock_grain
from counterflex.plan.compensate import plan
from counterflex.plan.inputs import CompensationInputs, feed_runs
from counterflex.plan.plan import across
from counterflex.plan.static_correction import between_walls
from counterflex.plan.stock_grain import FINEST_M, GRAIN_M, fine_enough, grain_per_cell

Block = Callable[..., HeightMap]


def groove_per_cell(deflection_m: float) -> float:
    """Grain over the side of a cell: 16 mm mill at 25 mm/s, 8.7 Hz, and a row that does not cut beside it."""
    still, tool = np.zeros((2, 3)), np.ones(2, np.int64)
    up = np.tile([0.0, 0.0, 1.0], (2, 1))
    path = ToolPath(still, up, tool * FEED, np.full(2, 25 * MM), np.ones(2), np.arange(2.0), tool, tool)
    bent = np.zeros((2, 6))
    bent[:, 1] = deflection_m, 1.0
    contact = np.array([True, False])
    return grain_per_cell(path, bent, contact, lambda _: Cutter(16 * MM, flutes=3), 2.0 * np.pi * 8.7)


def test_a_deep_groove_in_coarse_cells_has_the_grain_that_was_measured() -> None:
    assert groove_per_cell(1.1 * MM) * 0.2 * MM == pytest.approx(37 * UM, rel=0.05)
    assert groove_per_cell(0.0) == 0.0


def test_stock_is_made_finer_where_the_arm_yields_and_only_there(block: Block) -> None:
    stock = block((0, 0), (20, 20))
    assert fine_enough(stock, groove_per_cell(0.1 * MM)) is stock
    finer = fine_enough(stock, groove_per_cell(1.1 * MM))
    assert finer.cell_m == pytest.approx(0.2 * MM / 2)
    assert groove_per_cell(1.1 * MM) * finer.cell_m <= GRAIN_M
    assert fine_enough(stock, groove_per_cell(50 * MM)).cell_m >= FINEST_M


def test_finer_stock_is_the_same_body(block: Block) -> None:
    stock = block((0, 0), (20, 20))
    stock.z[:10, :] = -3 * MM
    stock.refresh()
    finer = stock.finer(3)
    assert finer.volume_m3 == pytest.approx(stock.volume_m3, rel=1e-9)
    assert finer.x_m()[0] - 0.5 * finer.cell_m == pytest.approx(stock.x_m()[0] - 0.5 * stock.cell_m, abs=1e-12)
    at = np.searchsorted(finer.y_m(), stock.y_m()[9] + 0.49 * stock.cell_m) - 1
    assert finer.z[at, 0] == stock.z[9, 0] != finer.z[at + 1, 0]


def test_a_block_gets_cells_as_small_as_the_grain_asks_where_whole_divisions_do_not_serve() -> None:
    """The demonstration: 26 um in cells of 0.1 mm, of which the half is below what is divided by whole numbers."""
    stock = HeightMap.from_box((0.0, 0.0, -0.04), (0.2, 0.15, 0.0), 0.1 * MM)
    share = 26 * UM / (0.1 * MM)
    finer = fine_enough(stock, share)
    assert share * finer.cell_m <= GRAIN_M < share * finer.cell_m * 1.02
    assert finer.volume_m3 == pytest.approx(stock.volume_m3, rel=1e-9)
    for coarse, fine in ((stock.x_m(), finer.x_m()), (stock.y_m(), finer.y_m())):
        for end in (0, -1):
            side = 0.5 if end else -0.5
            assert fine[end] + side * finer.cell_m == pytest.approx(coarse[end] + side * stock.cell_m, abs=1e-9)
    assert fine_enough(stock, 100 * share).cell_m >= FINEST_M
    carved = stock.copy()
    carved.z[:10] = -3 * MM
    carved.refresh()
    assert fine_enough(carved, share).cell_m == pytest.approx(0.05 * MM)
    with pytest.raises(InputError, match="whole numbers"):
        carved.finer_block(0.07 * MM)


@pytest.fixture(scope="module")
def cell(cell_of: Callable[..., Cell]) -> Cell:
    return cell_of()


@pytest.fixture(scope="module")
def groove(path_of: Callable[..., ToolPath]) -> ToolPath:
    return path_of("G0 Z60\nG0 X-12 Y15\nG0 Z42\nG1 Z34 F3000\nG1 X52 F1500\nG0 Z60")


def test_the_trial_of_a_groove_is_calm_in_fine_stock_pair(
    cell: Cell, groove: ToolPath, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Same groove, same coarse cells: what the model leaves in the plateau, cells divided or not."""
    lines = np.arange(1, int(groove.motion.max()) + 2)

    def predicted() -> float:
        found = plan(groove, lines, cell.stock(), setting_of(cell))
        inside = found.cutting & (found.path.p_part_tcp[:, 0] > 5 * MM) & (found.path.p_part_tcp[:, 0] < 30 * MM)
        left = across(found.deviation_compensated_part, found.path.p_part_tcp)[inside]
        return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))

    fine = predicted()
    monkeypatch.setattr(stock_grain, "GRAIN_M", 1.0)
    assert fine < 10 * UM < 20 * UM < predicted()


def test_a_tool_between_its_walls_is_still_corrected(cell: Cell, groove: ToolPath) -> None:
    """It has cut its way out at x = 40 mm; its back half leaves the walls 8 mm later."""
    setting = setting_of(cell)
    x, low = groove.p_part_tcp[:, 0] / MM, groove.p_part_tcp[:, 2] < 34.5 * MM
    contact = low & (x > -8.0) & (x <= 40.0)
    inputs = CompensationInputs(groove, np.zeros(len(x), np.int64), cell.stock(), setting, np.zeros((len(x), 6)))
    between = between_walls(inputs, contact, feed_runs(groove))
    assert np.all(between[low & (x > 40.0) & (x < 48.5)])
    assert not np.any(between[low & (x > 49.5)])
