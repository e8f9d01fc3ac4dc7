"""The page of one inspected part, or of two compared: map, sections, features, histogram, how the scan was placed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.evaluate.features import FeatureRow
from counterflex.evaluate.inspection.coverage import Coverage
from counterflex.evaluate.inspection.sections import PartSection
from counterflex.evaluate.path_deviation import PathDeviation, PathFigures
from counterflex.evaluate.surface import NominalSurface, SurfaceDeviation
from counterflex.report.data import Fact
from counterflex.report.distribution_figure import area_shares
from counterflex.report.figure_data import (
    AFTER,
    BEFORE,
    METROLOGY,
    NOT_MACHINED,
    edges_mm,
    numbers,
    scale_limit_mm,
    stepped,
)
from counterflex.report.map_figure import callouts, figure_3d, map_figure, map_picture
from counterflex.report.page import feature_rows, render, signed
from counterflex.report.series_figure import components_figure

_PATH_COLOURS: Final = {"part": AFTER, "before": BEFORE, "after": AFTER}
_TITLES: Final = {
    "path": "Across the feed, where the tool cut",
    "entry": "Entries",
    "exit": "Exits",
    "plateau": "Between them",
    "air": "Feed motion in air",
    "along": "Along the feed (not counted)",
}
_MOST: Final = 5000


@dataclass(frozen=True, eq=False)
class MeasuredPath:
    """A measured path."""

    deviation: PathDeviation
    # By surface (floor, wall_left, wall_right), (k,) m along its normal; nan where the station makes none
    normal_m: Mapping[str, Float]
    figures: PathFigures
    cut_known: bool  # Whether it is known where the tool cut
    along_known: bool  # Whether the deviation along the feed is known

    def map_figure(self, limit_mm: float) -> dict[str, Any]:
        """Plotly specification of the path seen from above, coloured by the largest deviation along a normal."""
        values = np.stack([np.nan_to_num(v) for v in self.normal_m.values()])
        none = np.all(np.isnan(np.stack(list(self.normal_m.values()))), axis=0)
        worst = np.take_along_axis(values, np.argmax(np.abs(values), axis=0)[None], axis=0)[0] / MM
        place = self.deviation.p_part_nominal / MM
        traces: list[dict[str, Any]] = []
        for rows, colour in ((np.flatnonzero(none), None), (np.flatnonzero(~none), worst)):
            some = rows[:: max(1, -(-len(rows) // _MOST))]
            marker: dict[str, Any] = {"size": 3, "color": NOT_MACHINED}
            if colour is not None:
                some = some[np.argsort(np.abs(colour[some]), kind="stable")]  # the largest on top
                marker = {"size": 6, "color": numbers(colour[some], 4), "coloraxis": "coloraxis"}
            traces.append(
                {
                    "type": "scatter",
                    "mode": "markers",
                    "x": numbers(place[some, 0], 2),
                    "y": numbers(place[some, 1], 2),
                    "marker": marker,
                    "hovertemplate": "x %{x:.1f}, y %{y:.1f} mm<br>%{marker.color:+.3f} mm<extra></extra>",
                    "hoverinfo": "skip" if colour is None else "all",
                }
            )
            if colour is None:
                del traces[-1]["hovertemplate"]
        bar = {
            "orientation": "h",
            "x": 0.5,
            "y": 1.03,
            "yanchor": "bottom",
            "len": 0.86,
            "thickness": 12,
            "tickvals": edges_mm(limit_mm)[::3],
            "tickformat": "+.3~f",
            "title": {"text": "deviation along the normal, mm", "side": "top"},
        }
        layout = {
            "height": 440,
            "margin": {"l": 56, "r": 10, "t": 76, "b": 46},
            "showlegend": False,
            "coloraxis": {"cmin": -limit_mm, "cmax": limit_mm, "colorscale": stepped(METROLOGY), "colorbar": bar},
            "xaxis": {"title": {"text": "x, mm"}, "zeroline": False, "constrain": "domain"},
            "yaxis": {"title": {"text": "y, mm"}, "zeroline": False, "scaleanchor": "x"},
        }
        return {"data": traces, "layout": layout, "narrow": {"height": 360}}


def path_series(paths: Mapping[str, MeasuredPath]) -> dict[str, Any]:
    """Plotly specification of the components of each path over the length of the program."""
    lines = [(name, _PATH_COLOURS.get(name, AFTER), path.deviation) for name, path in paths.items()]
    return components_figure(lines, along=all(path.along_known for path in paths.values()))


def path_rows(paths: Mapping[str, MeasuredPath]) -> list[dict[str, Any]]:
    """Rows of the table of figures: name, and max, 99.7 %, rms in mm and length in mm of each path."""
    rows = []
    for key, title in _TITLES.items():
        if not paths or (key not in ("path", "along") and not all(path.cut_known for path in paths.values())):
            continue
        if key == "along" and not all(path.along_known for path in paths.values()):
            continue
        if key == "path" and not all(path.cut_known for path in paths.values()):
            title = "Across the feed, all feed motion"
        cells = []
        for path in paths.values():
            figures = getattr(path.figures, key)
            cells += [f"{v / MM:.3f}" for v in (figures.max_m, figures.p997_m, figures.rms_m)]
            cells.append(f"{figures.extent / MM:.1f}")
        rows.append({"name": title, "cells": cells})
    return rows


_ENLARGED: Final = (1, 2, 5, 10, 20, 50, 100)
_ROOM_M: Final = 2.0 * MM
_MOST_POINTS: Final = 1500
_COLOURS: Final = {"part": AFTER, "before": BEFORE, "after": AFTER}


def enlarged(section: PartSection) -> int:
    """Return how many times larger than the part the deviations of a section are drawn: up to about 2 mm."""
    every = np.concatenate([np.zeros(1), *(np.abs(one.deviation_m) for one in section.profiles.values())])
    largest = float(np.percentile(every, 95.0))
    return max((k for k in _ENLARGED if k * largest <= _ROOM_M), default=1)


def section_figure(section: PartSection) -> dict[str, Any]:
    """Plotly specification of one section, seen along the programmed motion: left is left of the feed."""
    factor = enlarged(section)
    traces: list[dict[str, Any]] = []
    for name, profile in section.profiles.items():
        rows = np.arange(len(profile.deviation_m))[:: max(1, len(profile.deviation_m) // _MOST_POINTS)]
        drawn = factor * profile.deviation_m[rows, None] * profile.normal[rows]
        traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": name,
                "x": numbers((profile.across_m[rows] + drawn[:, 0]) / MM, 3),
                "y": numbers((profile.height_m[rows] + drawn[:, 1]) / MM, 3),
                "customdata": numbers(profile.deviation_m[rows] / MM, 4),
                "marker": {"size": 3, "color": _COLOURS.get(name, AFTER)},
                "hovertemplate": "deviation %{customdata:+.3f} mm<extra></extra>",
            }
        )
    traces.append(
        {
            "type": "scatter",
            "mode": "lines",
            "name": "nominal",
            "x": numbers(section.across_m / MM, 3),
            "y": numbers(section.height_m / MM, 3),
            "line": {"color": "#1b2530", "width": 1.4},
            "hoverinfo": "skip",
        }
    )
    layout = {
        "height": 330,
        "margin": {"l": 56, "r": 12, "t": 30, "b": 46},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0},
        "xaxis": {"title": {"text": "to the left of the feed, mm"}, "zeroline": False, "autorange": "reversed"},
        "yaxis": {"title": {"text": "z, mm"}, "zeroline": False, "scaleanchor": "x"},
    }
    return {"data": traces, "layout": layout, "narrow": {"height": 280}}


TITLES: Final = {"part": "The part", "before": "Before", "after": "After"}
_MOST_SECTIONS: Final = 6


@dataclass(frozen=True, eq=False)
class InspectionData:
    """Everything on the page."""

    title: str
    subtitle: str
    created: str
    surface: NominalSurface  # Floors and walls of the nominal part
    deviations: Mapping[str, SurfaceDeviation]  # Map of ``part``, or of ``before`` and ``after``
    features: tuple[FeatureRow, ...]  # Measured on each
    sections: tuple[PartSection, ...]
    facts: Mapping[str, Sequence[Fact]]  # By part, how it was scanned and placed
    # By part, areas of the whole machined surface and of each feature
    coverage: Mapping[str, tuple[Coverage, Mapping[str, Coverage]]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # What the reader must know
    # By part, where the path of the tool was measured and not the surface; empty for scans
    paths: Mapping[str, MeasuredPath] = field(default_factory=dict)

    def page(self) -> str:
        """The page, as HTML text."""
        names = list(self.deviations)
        last = self.deviations[names[-1]]
        limit = scale_limit_mm(max(max(one.surface.max_m for one in self.deviations.values()) / MM, 1e-3))
        fine = scale_limit_mm(max(last.surface.p997_m / MM, 1e-3))
        pictures = [map_picture(self.surface, one) for one in self.deviations.values()]
        places = callouts(pictures[0], pictures[-1])
        figures: dict[str, Any] = {
            "map": map_figure(pictures[0], pictures[1], places, limit, (TITLES["before"], TITLES["after"]))
            if len(pictures) == 2
            else pictures[0].figure(places, limit, TITLES["part"]),
            "histogram": self._histogram(limit),
        }
        for name, one in self.deviations.items():
            figures[f"space_{'after' if name == 'part' else name}"] = figure_3d(self.surface, one, limit)
        for name, path in self.paths.items():
            figures[f"path_{name}"] = path.map_figure(fine)
        if self.paths:
            figures["path_series"] = path_series(self.paths)
        sections = self.sections[:_MOST_SECTIONS]
        for k, section in enumerate(sections):
            figures[f"section{k}"] = section_figure(section)
        scales = [
            {"name": f"±{value:g} mm", "limit": value, "ticks": edges_mm(value)}
            for value in ([limit, fine] if fine < limit else [limit])
        ]
        return render(
            "inspection.html.j2",
            figures,
            scales,
            data=self,
            names=[(name, TITLES[name]) for name in names],
            verdict=self._verdict(),
            badge=self._badge(),
            rows=self._figure_rows(),
            path_rows=path_rows(self.paths),
            coverage=self._coverage_rows(),
            features=self._feature_rows(),
            places=[
                (
                    p.label,
                    f"{p.x_mm:.1f}",
                    f"{p.y_mm:.1f}",
                    *(signed(v) for v in (p.before_mm, p.after_mm)[: len(names)]),
                )
                for p in places
            ],
            sections=[(k, s.feature, f"{s.place_m / MM:.1f}", enlarged(s)) for k, s in enumerate(sections)],
        )

    def _verdict(self) -> str:
        """The result in one sentence."""
        figures = [one.surface.p997_m / MM for one in self.deviations.values()]
        if self.paths:
            across = [path.figures.path.p997_m / MM for path in self.paths.values()]
            text = f"99.7 % of the path of the tool lies within {across[-1]:.3f} mm of the program's, across the feed"
            return text + (f"; before, within {across[0]:.3f} mm." if len(across) == 2 else ".")
        text = f"99.7 % of the measured machined surface lies within {figures[-1]:.3f} mm of the nominal one"
        return text + (f"; before, within {figures[0]:.3f} mm." if len(figures) == 2 else ".")

    def _badge(self) -> tuple[str, bool] | None:
        """Number of quantities of the last part out of tolerance or not wholly measured; and whether it is good."""
        name = list(self.deviations)[-1]
        if not self.features:
            return None
        missing = sum(name not in row.worst_m for row in self.features)
        bad = sum(name in row.worst_m and not row.ok(name) for row in self.features)
        partly = sum(name in row.worst_m and row.ok(name) and row.partly(name) for row in self.features)
        counts = ((bad, "out of tolerance"), (missing, "not measured"), (partly, "measured in part only"))
        counted = ", ".join(f"{count} {what}" for count, what in counts if count)
        total = len(self.features)
        if counted:
            return f"Of {total} quantities {counted}", False
        return f"All {total} quantities within tolerance", True

    def _coverage_rows(self) -> list[dict[str, Any]]:
        """Areas of each part and its features: machined, judged, not judged, not seen, mm2."""
        rows = []
        for name, (whole, of_features) in self.coverage.items():
            for feature, one in (("whole machined surface", whole), *of_features.items()):
                areas = (one.unseen_m2, one.unjudged_m2, one.judged_m2, one.machined_m2)
                cells = [f"{area / MM**2:.0f}" for area in areas]
                share = f"{100.0 * one.judged_share:.0f} %"
                rows.append({"part": TITLES[name], "feature": feature, "cells": [share, *cells], "whole": one.whole})
        return rows

    def _figure_rows(self) -> list[dict[str, Any]]:
        rows = []
        for part, title in (("surface", "Surface, floors and walls"), ("floor", "Floors"), ("wall", "Walls")):
            cells = []
            for one in self.deviations.values():
                figures = getattr(one, part)
                cells += [f"{v / MM:.3f}" for v in (figures.max_m, figures.p997_m, figures.rms_m)]
                cells.append(f"{figures.extent / MM**2:.0f}")
            rows.append({"name": title, "cells": cells})
        return rows

    def _feature_rows(self) -> list[dict[str, Any]]:
        rows = []
        for row in self.features:
            cells: list[dict[str, Any]] = []
            for name in self.deviations:
                if name not in row.worst_m:
                    cells.append({"value": "not found", "off": "", "sigma": "", "ok": None, "share": ""})
                    continue
                cells.append(
                    {
                        "value": f"{row.worst_m[name] / MM:.3f}",
                        "off": signed((row.worst_m[name] - row.nominal_m) / MM),
                        "sigma": f"{2.0 * row.standard_deviation_m.get(name, 0.0) / UM:.0f}",
                        "ok": row.ok(name),
                        "share": f"{100.0 * row.measured_share[name]:.0f} % seen" if row.partly(name) else "",
                    }
                )
            rows.append(cells)
        return feature_rows(self.features, rows)

    def _histogram(self, limit: float) -> dict[str, Any]:
        """Share of the measured area in each of 61 classes."""
        edges = np.linspace(-limit, limit, 62)
        centre = 0.5 * (edges[1:] + edges[:-1])
        colours = {"part": AFTER, "before": BEFORE, "after": AFTER}
        traces = [
            {
                "type": "bar",
                "name": TITLES[name].lower(),
                "x": numbers(centre, 4),
                "y": numbers(100.0 * area_shares(self.surface, one, edges), 4),
                "marker": {"color": colours[name], "opacity": 0.75},
                "width": round(float(edges[1] - edges[0]), 5),
                "hovertemplate": "%{x:+.3f} mm: %{y:.2f} % of the area<extra></extra>",
            }
            for name, one in self.deviations.items()
        ]
        layout = {
            "height": 300,
            "barmode": "overlay",
            "margin": {"l": 60, "r": 14, "t": 24, "b": 46},
            "xaxis": {"title": {"text": "surface deviation, mm (+ = material left)"}, "tickformat": "+.2~f"},
            "yaxis": {"title": {"text": "share of area, %"}, "type": "log", "dtick": 1, "range": [-2.5, 2.0]},
            "legend": {"orientation": "h", "x": 0.0, "y": 1.0, "yanchor": "bottom"},
            "showlegend": len(traces) > 1,
        }
        return {"data": traces, "layout": layout, "narrow": {"xaxis.title.text": "deviation, mm", "margin.l": 52}}
