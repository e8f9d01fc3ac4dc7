"""Figures of the stability page: valid for plotly, the worst line marked, no point without a limit drawn."""

from __future__ import annotations

from typing import Any

import plotly.graph_objects as go

from counterflex.report.series_figure import lobe_figure, margin_figure

WORST = {"line": 12, "axial_depth_mm": 6.0, "spindle_rpm": 13000.0}


def _stretch(time_s: float, robot: float | None) -> dict[str, Any]:
    margin = 100.0 if robot is None else robot
    return {
        "time_s": time_s, "line": 12, "robot_margin": robot, "tool_margin": None, "low_frequency_margin": None,
        "margin": margin,
    }  # fmt: skip


def test_margins() -> None:
    figure = margin_figure([_stretch(0.0, None), _stretch(0.1, 0.8), _stretch(0.2, 50.0)])
    go.Figure(figure)
    assert [trace["name"] for trace in figure["data"]] == ["robot"]
    assert figure["data"][0]["y"] == [None, 0.8, 20.0]
    assert figure["layout"]["annotations"][0]["text"] == "line 12: 0.8"


def test_lobes() -> None:
    rows = [
        {"method": method, "spindle_rpm": rpm, "depth_mm": depth}
        for method in ("zeroth order", "semi-discretisation")
        for rpm, depth in ((6000.0, 4.0), (13000.0, None))
    ]
    figure = lobe_figure(rows, WORST)
    go.Figure(figure)
    assert figure["data"][0]["y"] == [4.0, None]
    assert figure["data"][2]["x"] == [13000.0]
    assert figure["layout"]["yaxis"]["range"][1] >= 15.0
