"""The stock as the studio draws it: what is left agrees with the fine removal, and states follow the tool."""

from __future__ import annotations

import base64
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app import examples
from counterflex.app.inputs import read_in_plane
from counterflex.app.proof.simulate import undisturbed
from counterflex.app.studio import stock_film
from counterflex.app.studio.stock_film import StockFilm, coarse
from counterflex.app.studio.tool_way import ToolWay
from counterflex.core.arrays import Float
from counterflex.core.errors import ModelError
from counterflex.cutting.stock import HeightMap
from counterflex.files.cell.cell import read_cell


def tops_at(film: StockFilm, point: int) -> Float:
    """(ny, nx) m, heights when the tool has reached a drawn point."""
    z = film.blank.z.astype(np.float64).reshape(-1)
    reached = int(np.searchsorted(film.point, point, side="right"))
    count = int(film.end[reached - 1]) if reached else 0
    z[film.cell[:count]] = film.top_m[:count]  # of several changes of a cell the last one holds
    return z.reshape(film.blank.z.shape)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with the demonstration cells."""
    made = tmp_path_factory.mktemp("project")
    examples.write_all(made / "cell.toml")
    return made


@pytest.fixture(scope="module")
def way(folder: Path) -> ToolWay:
    return ToolWay.of_program(folder / "groove.ngc", folder / "cell-small.toml")


@pytest.fixture(scope="module")
def film(way: ToolWay) -> StockFilm:
    made = StockFilm.of(way)
    assert made is not None
    return made


def test_at_the_end_it_is_the_part_that_the_program_makes(folder: Path, way: ToolWay, film: StockFilm) -> None:
    """Against the removal on the fine grid of the cell file; they differ in cells that the edge of a cut crosses."""
    cell, job = read_in_plane(folder / "groove.ngc", read_cell(folder / "cell-small.toml"))
    fine = undisturbed(job, cell)
    left = tops_at(film, len(way.drawn_rows) - 1)
    removed = cell.stock().volume_m3 - fine.volume_m3
    drawn = float(np.sum(film.blank.z - left)) * film.blank.cell_m**2
    assert max(film.blank.z.shape) <= 200
    walls = 2.0 * 60e-3 * 6e-3  # m^2 of the groove; a cell that a wall halves is cut whole
    assert drawn == pytest.approx(removed, abs=walls * 0.51 * film.blank.cell_m)
    columns = np.floor((film.blank.x_m() - fine.x0_m) / fine.cell_m + 0.5).astype(int)
    rows = np.floor((film.blank.y_m() - fine.y0_m) / fine.cell_m + 0.5).astype(int)
    apart = np.abs(left - fine.z[np.ix_(rows, columns)]) > 2e-5
    crossed = fine.z[np.ix_(rows, columns)] < fine.z.max() - 2e-5
    beside = np.stack([np.roll(crossed, by, axis) for by in (-1, 1) for axis in (0, 1)])
    assert np.all(np.any(beside != crossed, axis=0)[apart])


def test_no_state_is_ahead_of_the_tool(way: ToolWay, film: StockFilm) -> None:
    """A state takes nothing further from the points that are reached than the radius of the tool and a cell."""
    assert way.cell is not None
    reach = way.cell.cutter(1).radius_m + film.blank.cell_m
    p = way.p_part[way.drawn_rows] * 1e-3
    x, y = np.meshgrid(film.blank.x_m(), film.blank.y_m())
    before = film.blank.z.astype(float)
    np.testing.assert_array_equal(tops_at(film, 0), before)
    for state in range(0, len(film.point), 20):
        point = int(film.point[state])
        now = tops_at(film, point)
        assert np.all(now <= before + 1e-9)
        places = np.stack([x[now < film.blank.z - 1e-9], y[now < film.blank.z - 1e-9]], axis=1)
        for place in places[:: max(1, len(places) // 50)]:
            assert np.linalg.norm(p[: point + 1, :2] - place, axis=1).min() <= reach
        before = now


def test_the_browser_gets_the_same_numbers(film: StockFilm) -> None:
    drawn = film.drawn()
    tops = np.frombuffer(base64.b64decode(drawn["top"]), "<f4")
    cells = np.frombuffer(base64.b64decode(drawn["cell"]), "<u4")
    assert drawn["end"][-1] == len(tops) == len(cells)
    z = np.frombuffer(base64.b64decode(drawn["blank"]), "<f4").copy()
    z[cells] = tops
    np.testing.assert_allclose(z.reshape(drawn["ny"], drawn["nx"]), tops_at(film, 10**9), atol=1e-7)


@pytest.mark.parametrize("states", [1, 2, 39, 40])
def test_fewer_changes_end_in_the_same_part(film: StockFilm, monkeypatch: pytest.MonkeyPatch, states: int) -> None:
    """Many passes over the same cells: joined states hold the same heights at their points."""
    rng = np.random.default_rng(states)
    cells = [rng.permutation(50)[:30] for _ in range(states)]
    whole = [(one, np.full(30, 0.04 - 1e-3 * k)) for k, one in enumerate(cells)]
    monkeypatch.setattr(stock_film, "MOST", 300)
    points, changes = stock_film._thinned(np.arange(10, 10 + states), whole)
    assert points[-1] == 9 + states
    assert sum(len(one) for one, _ in changes) <= max(300, 30)
    films = []
    for at, parts in ((np.arange(10, 10 + states), whole), (points, changes)):
        cell, top = (np.concatenate(one) for one in zip(*parts, strict=True))
        end = np.cumsum([len(one) for one, _ in parts])
        films.append(replace(film, point=at, end=end, cell=cell, top_m=top))
    for point in points:
        np.testing.assert_array_equal(tops_at(films[0], int(point)), tops_at(films[1], int(point)))


def test_it_stops_when_nobody_looks(way: ToolWay) -> None:
    asked: list[bool] = []

    def stopped() -> bool:
        asked.append(True)
        return len(asked) > 3

    assert StockFilm.of(way, stopped) is None
    assert len(asked) == 4


def test_a_stretch_that_leaves_the_cut_between_two_drawn_points_takes_nothing() -> None:
    """Of a long program each k-th point is drawn: a chord over a rapid would cut through the part."""
    cutting = np.array([0, 1, 1, 1, 0, 1, 1, 1, 1.0])
    assert stock_film._cuts(cutting, np.array([0, 2, 4, 6, 8])).tolist() == [False, True, False, True, True]


def test_what_no_height_map_holds_is_refused(way: ToolWay) -> None:
    with pytest.raises(ModelError, match="keeps its direction"):
        StockFilm.of(replace(way, cell=None))


@pytest.mark.parametrize("shape", [(40, 1000), (401, 399), (64, 64)])
def test_a_coarse_stock_hides_no_material(shape: tuple[int, int]) -> None:
    z = np.random.default_rng(1).uniform(0.0, 0.01, shape).astype(np.float32)
    fine = HeightMap(0.0, 0.0, 1e-3, z, 0.0)
    made = coarse(fine)
    times = round(made.cell_m / fine.cell_m)
    assert min(made.z.shape) >= 16
    assert max(made.z.shape) <= 200 or min(shape) < 32 * times
    assert made.x0_m - 0.5 * made.cell_m == pytest.approx(-0.5e-3)
    for j, i in ((0, 0), (shape[0] - 1, shape[1] - 1), (17, 23)):
        block = z[j // times * times : j // times * times + times, i // times * times : i // times * times + times]
        assert made.z[j // times, i // times] == block.max()
