"""Motion of a robot along a program: path speed, joint speeds and accelerations, distances of points, reversals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import DEG, MM, MM_PER_MIN, PERCENT
from counterflex.report.figure_data import numbers, thin

COLOURS: Final = ("#c2410c", "#0369a1", "#15803d", "#7c3aed", "#d9a000", "#374151")
"""Of axes 1 to 6."""
_PROGRAMMED: Final = "#94a3b8"
_HELD: Final = "#0369a1"
_SLOW: Final = "#b91c1c"
_POINTS: Final = 3000
_SHOWN_PERCENT: Final = 40.0  # Below that the limit is not drawn: the curves would lie on the axis
_WAY: Final = "way along the program, m"


@dataclass(frozen=True, eq=False)
class PathCurves:
    """Curves along m rows of a path."""

    way_m: Float  # (m,) way from the beginning
    at_feed: Bool  # (m,) no rapid; rapids are gaps in all pictures
    programmed_m_s: Float  # (m,) on the segment that ends here
    held_m_s: Float  # (m,) that the robot holds here
    slow: Bool  # (m,) segments in the cut on which it is slower than programmed
    joint_speeds_rad_s: Float  # (m, 6) at the programmed feed
    joint_accelerations_rad_s2: Float  # (m, 6) likewise
    speed_limits_rad_s: Float | None  # (6,) or None
    acceleration_limits_rad_s2: Float | None  # (6,) or None
    point_way_m: Float  # (k,) where each block at feed ends
    point_length_m: Float  # (k,) its length
    point_least_m: Float  # (k,) shortest one that the controller works off at this feed
    # Row and axis 0..5 where an axis turns round in the cut
    reversals: Sequence[tuple[int, int]] = field(default_factory=tuple)

    def figures(self) -> dict[str, dict[str, Any]]:
        """All pictures by name."""
        figures = {
            "path_speed": self._speed_figure(),
            "joint_speed": self._axes_figure(
                self.joint_speeds_rad_s, self.speed_limits_rad_s, "joint speed", "deg/s", turns=True
            ),
            "joint_acceleration": self._axes_figure(
                self.joint_accelerations_rad_s2, self.acceleration_limits_rad_s2, "joint acceleration", "deg/s2"
            ),
        }
        if len(self.point_way_m):
            figures["point_distance"] = self._distance_figure()
        return figures

    def _speed_figure(self) -> dict[str, Any]:
        """Programmed and held path speed; red where the robot is slower in the cut."""
        feed = self.at_feed
        held = self.held_m_s / MM_PER_MIN
        slow = self.slow | np.append(self.slow[1:], False)  # a segment has two ends
        traces = [
            _line("programmed", self.way_m, self.programmed_m_s / MM_PER_MIN, feed, _PROGRAMMED, 1.6, shape="vh"),
            _line("held", self.way_m, held, feed, _HELD, 1.6),
            _line("slower in the cut", self.way_m, held, feed & slow, _SLOW, 2.2),
        ]
        return _figure(traces, "path speed, mm/min", {"rangemode": "tozero"})

    def _axes_figure(
        self, values: Float, limits: Float | None, title: str, unit: str, *, turns: bool = False
    ) -> dict[str, Any]:
        """A quantity of the six axes, in shares of their limits where those are known, else in its unit."""
        size = np.abs(values) / (DEG if limits is None else limits * PERCENT)
        traces = [
            _line(f"axis {axis + 1}", self.way_m, size[:, axis], self.at_feed, colour, 1.4)
            for axis, colour in enumerate(COLOURS)
        ]
        if turns and self.reversals:
            rows, axes = (np.array(column) for column in zip(*self.reversals, strict=True))
            traces.append(
                {
                    "type": "scatter",
                    "mode": "markers",
                    "name": "axis turns round in the cut",
                    "x": numbers(self.way_m[rows], 4),
                    "y": numbers(size[rows, axes], 2),
                    "marker": {
                        "symbol": "diamond",
                        "size": 9,
                        "color": [COLOURS[axis] for axis in axes.tolist()],
                        "line": {"color": "#1b2530", "width": 1},
                    },
                }
            )
        shown = f"{title}, {unit}" if limits is None else f"{title}, % of its limit"
        figure = _figure(traces, shown, {"rangemode": "tozero"})
        if limits is not None and np.max(size[self.at_feed], initial=0.0) > _SHOWN_PERCENT:
            line = {"color": _SLOW, "width": 1.2, "dash": "dash"}
            figure["layout"]["shapes"] = [
                {"type": "line", "xref": "paper", "x0": 0.0, "x1": 1.0, "y0": 100.0, "y1": 100.0, "line": line}
            ]
        return figure

    def _distance_figure(self) -> dict[str, Any]:
        """Length of each block, and the least that the controller works off at its feed; logarithmic."""
        whole = np.ones(len(self.point_way_m), dtype=np.bool_)
        x, y = thin(self.point_way_m, self.point_length_m / MM, whole, _POINTS)
        points = {
            "type": "scatter", "mode": "markers", "name": "distance of points", "x": numbers(x, 4), "y": numbers(y, 4),
            "marker": {"size": 5, "color": _HELD},
        }  # fmt: skip
        least = _line(
            "least at this feed", self.point_way_m, self.point_least_m / MM, whole, _SLOW, 1.6, shape="vh", digits=4
        )
        return _figure([points, least], "distance of points, mm", {"type": "log"})


def _line(
    name: str, x: Float, y: Float, keep: Bool, colour: str, width: float, *, shape: str = "linear", digits: int = 2
) -> dict[str, Any]:
    way, values = thin(x, y, keep, _POINTS)
    return {
        "type": "scatter", "mode": "lines", "name": name, "x": numbers(way, 4), "y": numbers(values, digits),
        "line": {"color": colour, "width": width, "shape": shape}, "connectgaps": False,
    }  # fmt: skip


def _figure(traces: list[dict[str, Any]], title: str, axis: dict[str, Any]) -> dict[str, Any]:
    layout = {
        "height": 320,
        "margin": {"l": 70, "r": 12, "t": 40, "b": 48},
        "hovermode": "x",
        "legend": {"orientation": "h", "y": 1.03, "yanchor": "bottom", "x": 0.0},
        "xaxis": {"title": {"text": _WAY}, "zeroline": False},
        "yaxis": {"title": {"text": title}} | axis,
    }
    return {"data": traces, "layout": layout, "narrow": {"margin": {"l": 56, "r": 6, "t": 84, "b": 48}}}
