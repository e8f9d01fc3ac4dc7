"""Figures of the modes page: valid for plotly, one period of motion of a stated size, still at its farthest."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
import pytest

from counterflex.report.modes_page import mode_figure

POINTS = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, 0.5]])


def test_a_mode_swings_about_its_rest() -> None:
    moved = np.zeros((4, 3))
    moved[2:, 2] = [2e-6, 4e-6]  # up
    figure = mode_figure(POINTS, moved, flange=2)
    go.Figure({"data": figure["data"], "layout": figure["layout"], "frames": figure["frames"]})
    rest, tool = figure["data"][0], figure["data"][3]
    assert [trace["name"] for trace in figure["data"]] == ["at rest"] * 2 + ["robot", "tool"] * 2
    assert tool["y"][-1] - rest["y"][-1] == pytest.approx(0.12 * 2500.0)  # mm, of an arm 2.5 m long
    heights = [frame["data"][1]["y"][-1] for frame in figure["frames"]]
    assert max(heights) == tool["y"][-1]
    assert np.mean(heights) == pytest.approx(500.0, abs=0.1)
    assert [frame["traces"] for frame in figure["frames"]] == [[2, 3, 4, 5]] * 24
    assert set(figure["layout"]["updatemenus"][0]["buttons"][0]["args"][0]) == {
        frame["name"] for frame in figure["frames"]
    }


def test_a_mode_that_moves_nothing_is_drawn_at_rest() -> None:
    figure = mode_figure(POINTS, np.zeros((4, 3)), flange=2)
    assert figure["data"][3]["y"][-1] == figure["data"][0]["y"][-1]
