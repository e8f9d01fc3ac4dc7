"""Colour maps of the part before and after, side by side on one stepped scale, with call-outs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.evaluate.surface import NominalSurface, SurfaceDeviation
from counterflex.report.figure_data import METROLOGY, NOT_MACHINED, STEPS, block, edges_mm, stepped

LIMIT_CELLS: Final = 120_000
_LIMIT_3D: Final = 16_000
_SPACING: Final = 0.14  # of the part's longer side
_LABEL_PX: Final = (64.0, 20.0)
_NUMBER_PX: Final = (24.0, 20.0)
_BAND_MM: Final = 2.0


@dataclass(frozen=True)
class MapPicture:
    """A deviation map thinned for the screen: every pixel shows the largest deviation in its block of cells."""

    x_mm: Float  # (nx,) pixel centres
    y_mm: Float  # (ny,) pixel centres
    # (ny, nx) deviation, NaN where nothing was machined. Walls are drawn as a band just outside the floor.
    value_mm: Float

    def _heatmap(self, dx: float, axis: str) -> dict[str, Any]:
        return {
            "type": "heatmap",
            "x0": round(float(self.x_mm[0]), 4),
            "dx": round(dx, 6),
            "y0": round(float(self.y_mm[0]), 4),
            "dy": round(dx, 6),
            "z": block(np.round(self.value_mm, 4)),
            "coloraxis": "coloraxis",
            "xaxis": f"x{axis}",
            "yaxis": f"y{axis}",
            "hoverongaps": False,
            "hovertemplate": "x %{x:.1f}, y %{y:.1f} mm<br>deviation %{z:+.3f} mm<extra></extra>",
        }

    def figure(self, places: tuple[Callout, ...], limit_mm: float, title: str) -> dict[str, Any]:
        """Plotly specification of one map alone, over the whole width."""
        figure = map_figure(self, self, (), limit_mm, (title, ""))
        figure["data"] = figure["data"][:1]
        layout = figure["layout"]
        dx = float(self.x_mm[1] - self.x_mm[0])
        width, height = float(np.ptp(self.x_mm)) + dx, float(np.ptp(self.y_mm)) + dx
        pixels = min(max(1090.0 * height / width, 180.0), 620.0)
        del layout["xaxis2"], layout["yaxis2"]
        layout["xaxis"]["domain"] = [0.0, 1.0]
        layout["height"] = round(pixels + 150.0)
        layout["coloraxis"]["colorbar"]["y"] = -52.0 / pixels
        offsets = _offsets(places, self, min(1090.0 / width, pixels / height))
        pointers = [place.pointer(0, offset) for place, offset in zip(places, offsets, strict=True)]
        layout["annotations"] = [layout["annotations"][0], *pointers]
        offsets = _offsets(places, self, 290.0 / width, _NUMBER_PX)
        figure["medium"] = {}
        for k, (place, offset) in enumerate(zip(places, offsets, strict=True)):
            figure["medium"] |= {f"annotations[{1 + k}].text": f"<b>{place.label}</b>"}
            figure["medium"] |= {f"annotations[{1 + k}].ax": offset[0], f"annotations[{1 + k}].ay": offset[1]}
        narrow = min(max(300.0 * height / width, 120.0), 420.0)
        figure["narrow"] = {
            "height": round(narrow + 170.0),
            "coloraxis.colorbar.y": -58.0 / narrow,
            "coloraxis.colorbar.len": 1.0,
            "coloraxis.colorbar.tickvals": edges_mm(limit_mm)[::3],
            "coloraxis.colorbar.title.text": "deviation, mm<br><b>+ = material left</b>, − = too much removed",
        }
        return figure


@dataclass(frozen=True)
class Callout:
    """A place that both maps point at."""

    label: str
    x_mm: float
    y_mm: float
    before_mm: float  # Deviation before, NaN where unknown
    after_mm: float  # Deviation after, NaN where unknown

    def pointer(self, n: int, offset: tuple[int, int]) -> dict[str, Any]:
        """Annotation with an arrow, on the map before (0) or after (1)."""
        value = self.after_mm if n else self.before_mm
        text = f"<b>{self.label}</b> {'n/a' if math.isnan(value) else f'{value:+.2f}'}"
        return {
            "x": round(self.x_mm, 3),
            "y": round(self.y_mm, 3),
            "xref": f"x{'2' if n else ''}",
            "yref": f"y{'2' if n else ''}",
            "text": text,
            "showarrow": True,
            "arrowhead": 6,
            "arrowsize": 0.8,
            "arrowwidth": 1.2,
            "arrowcolor": "#222",
            "ax": offset[0],
            "ay": offset[1],
            "bgcolor": "rgba(255,255,255,0.92)",
            "bordercolor": "#222",
            "borderpad": 2,
            "font": {"size": 11},
        }


def map_picture(surface: NominalSurface, measured: SurfaceDeviation, limit_cells: int = LIMIT_CELLS) -> MapPicture:
    """Thin a deviation map to at most ``limit_cells`` pixels and draw its walls."""
    part = surface.nominal
    ny, nx = measured.floor_m.shape
    k = max(1, math.ceil(math.sqrt(ny * nx / limit_cells)))
    value = _largest(measured.floor_m.astype(np.float64), k) / MM
    x, y = (
        (origin + part.cell_m * (np.arange(count, dtype=np.float64) * k + 0.5 * (k - 1))) / MM
        for origin, count in ((part.x0_m, value.shape[1]), (part.y0_m, value.shape[0]))
    )
    known = np.isfinite(measured.wall_m)
    if known.any():
        wall, deviation = surface.wall_point[known, :2] / MM, measured.wall_m[known] / MM
        band = max(_BAND_MM, 1.6 * k * part.cell_m / MM)
        j, i = np.nonzero(np.isnan(value))
        centre = np.column_stack([x[i], y[j]])
        distance, nearest = scipy.spatial.cKDTree(wall).query(centre, k=min(3, len(wall)), distance_upper_bound=band)
        distance, nearest = np.reshape(distance, (len(centre), -1)), np.reshape(nearest, (len(centre), -1))
        padded = np.append(deviation, 0.0)
        here = padded[nearest]
        worst = np.take_along_axis(here, np.argmax(np.abs(here), axis=1)[:, None], axis=1)[:, 0]
        close = np.isfinite(distance[:, 0])
        value[j[close], i[close]] = worst[close]
    return MapPicture(x, y, value)


def callouts(before: MapPicture, after: MapPicture) -> tuple[Callout, ...]:
    """The three worst places after and the two worst before, at least a seventh of the part apart, after first."""
    chosen: list[tuple[int, int]] = []
    for picture, count in ((after, 3), (before, 2)):
        size = np.where(np.isnan(picture.value_mm), 0.0, np.abs(picture.value_mm))
        for j, i in chosen:
            _blank(size, picture, j, i)
        for _ in range(count):
            j, i = (int(v) for v in np.unravel_index(int(np.argmax(size)), size.shape))
            if size[j, i] <= 0.0:
                break
            chosen.append((j, i))
            _blank(size, picture, j, i)
    return tuple(
        Callout(
            str(n + 1),
            float(before.x_mm[i]),
            float(before.y_mm[j]),
            float(before.value_mm[j, i]),
            float(after.value_mm[j, i]),
        )
        for n, (j, i) in enumerate(chosen)
    )


def map_figure(
    before: MapPicture,
    after: MapPicture,
    places: tuple[Callout, ...],
    limit_mm: float,
    titles: tuple[str, str] = ("Before: original program", "After: compensated program"),
) -> dict[str, Any]:
    """Plotly specification of both maps with linked zoom and one colour bar."""
    dx = float(before.x_mm[1] - before.x_mm[0])
    width = float(np.ptp(before.x_mm)) + dx
    height = float(np.ptp(before.y_mm)) + dx
    pixels = min(max(530.0 * height / width, 180.0), 620.0)
    offsets = _offsets(places, before, min(530.0 / width, pixels / height))
    data = [picture._heatmap(dx, axis) for picture, axis in ((before, ""), (after, "2"))]
    frame = {"showgrid": False, "zeroline": False, "ticks": "outside", "mirror": True, "showline": True}
    x_range = [float(before.x_mm[0]) - 0.5 * dx, float(before.x_mm[-1]) + 0.5 * dx]
    y_range = [float(before.y_mm[0]) - 0.5 * dx, float(before.y_mm[-1]) + 0.5 * dx]
    layout: dict[str, Any] = {
        "height": round(pixels + 150.0),
        "margin": {"l": 50, "r": 10, "t": 36, "b": 100},
        "plot_bgcolor": "#d9dee3",
        "xaxis": {**frame, "domain": [0.0, 0.485], "range": x_range, "title": {"text": "x, mm"}, "constrain": "domain"},
        "xaxis2": {
            **frame, "domain": [0.515, 1.0], "range": x_range, "title": {"text": "x, mm"}, "matches": "x",
            "anchor": "y2", "constrain": "domain",
        },
        "yaxis": {**frame, "range": y_range, "title": {"text": "y, mm"}, "scaleanchor": "x", "constrain": "domain"},
        "yaxis2": {
            **frame, "range": y_range, "matches": "y", "anchor": "x2", "showticklabels": False,
            "scaleanchor": "x2", "constrain": "domain",
        },
        "coloraxis": {
            "cmin": -limit_mm,
            "cmax": limit_mm,
            "colorscale": stepped(METROLOGY),
            "colorbar": {
                "orientation": "h",
                "x": 0.5,
                "y": -52.0 / pixels,
                "yanchor": "top",
                "len": 0.86,
                "thickness": 14,
                "title": {"text": "deviation, mm &nbsp; <b>+ = material left</b>, − = too much removed", "side": "top"},
                "tickvals": edges_mm(limit_mm),
                "tickformat": "+.3~f",
                "tickfont": {"size": 10},
            },
        },
        "annotations": [
            *(
                {
                    "text": f"<b>{title}</b>", "x": x, "y": 1.0, "xref": "paper", "yref": "paper", "yshift": 24,
                    "xanchor": "left", "showarrow": False, "font": {"size": 14},
                }
                for title, x in zip(titles, (0.0, 0.515), strict=True)
            ),
            *(place.pointer(n, offset) for place, offset in zip(places, offsets, strict=True) for n in (0, 1)),
        ],
    }  # fmt: skip
    return {
        "data": data,
        "layout": layout,
        "medium": _short(places, before, width),
        "narrow": _narrow(height / width, limit_mm),
    }


def _narrow(aspect: float, limit_mm: float) -> dict[str, Any]:
    """Return what changes on a narrow screen: the maps one below the other, every third number at the scale."""
    pixels = min(max(290.0 * aspect, 130.0), 420.0)
    whole = 2.0 * pixels + 90.0
    low = (pixels + 8.0) / whole
    return {
        "height": round(whole + 150.0),
        "margin": {"l": 44, "r": 6, "t": 36, "b": 100},
        "xaxis.domain": [0.0, 1.0],
        "xaxis.title.text": "",
        "xaxis2.domain": [0.0, 1.0],
        "yaxis.domain": [1.0 - pixels / whole, 1.0],
        "yaxis2.domain": [0.0, pixels / whole],
        "yaxis2.showticklabels": True,
        "yaxis2.title.text": "y, mm",
        "coloraxis.colorbar.y": -58.0 / whole,
        "coloraxis.colorbar.len": 1.0,
        "coloraxis.colorbar.tickvals": edges_mm(limit_mm)[::3],
        "coloraxis.colorbar.title.text": "deviation, mm<br><b>+ = material left</b>, − = too much removed",
        "annotations[1].x": 0.0,
        "annotations[1].y": low,
        "annotations[1].yshift": 12,
    }


def _short(places: tuple[Callout, ...], picture: MapPicture, width_mm: float) -> dict[str, Any]:
    """Call-outs on a narrow screen: numbers alone, the values stand in the table; placed anew, the maps are smaller."""
    out: dict[str, Any] = {}
    offsets = _offsets(places, picture, 290.0 / width_mm, _NUMBER_PX)
    for k, (place, offset) in enumerate(zip(places, offsets, strict=True)):
        for n in (2 + 2 * k, 3 + 2 * k):  # behind the two titles
            out |= {f"annotations[{n}].text": f"<b>{place.label}</b>"}
            out |= {f"annotations[{n}].ax": offset[0], f"annotations[{n}].ay": offset[1]}
    return out


def figure_3d(surface: NominalSurface, deviation: SurfaceDeviation, limit_mm: float) -> dict[str, Any]:
    """Plotly specification of the nominal part in space, coloured by its deviation; needs WebGL.

    One closed surface: what was not machined has a step of its own behind the scale, so that walls are drawn too.
    """
    picture = map_picture(surface, deviation, _LIMIT_3D)
    part = surface.nominal
    k = max(1, math.ceil(math.sqrt(part.z.size / _LIMIT_3D)))
    ny, nx = picture.value_mm.shape
    height = part.z[k // 2 :: k, k // 2 :: k][:ny, :nx].astype(np.float64) / MM
    shape = (min(ny, height.shape[0]), min(nx, height.shape[1]))
    colour = picture.value_mm[: shape[0], : shape[1]]
    height = height[: shape[0], : shape[1]]
    x, y = picture.x_mm[: shape[1]], picture.y_mm[: shape[0]]
    rise = float(np.ptp(height))
    place = {"type": "surface", "x": block(x), "y": block(y)}
    axis = {"backgroundcolor": "#f4f6f8", "gridcolor": "#ffffff", "showbackground": True}
    return {
        "data": [
            {
                **place,
                "z": block(height),
                "surfacecolor": block(np.where(np.isnan(colour), limit_mm * (1.0 + 1.0 / STEPS), colour)),
                "cmin": -limit_mm,
                "cmax": limit_mm * (1.0 + 2.0 / STEPS),
                "colorscale": stepped((*METROLOGY, NOT_MACHINED)),
                "colorbar": {
                    "orientation": "h",
                    "y": -0.02,
                    "yanchor": "top",
                    "tickvals": edges_mm(limit_mm)[::3],
                    "tickformat": "+.3~f",
                    "thickness": 12,
                    "len": 0.9,
                    "title": {"text": "deviation, mm", "side": "top"},
                },
                "hovertemplate": "%{x:.1f}, %{y:.1f} mm<br>%{surfacecolor:+.3f} mm<extra></extra>",
            }
        ],
        "layout": {
            "height": 480,
            "margin": {"l": 0, "r": 0, "t": 0, "b": 70},
            "scene": {
                "aspectmode": "manual",
                "aspectratio": {
                    "x": 1.5,
                    "y": round(1.5 * float(np.ptp(y)) / float(np.ptp(x)), 4),
                    "z": round(4.5 * rise / float(np.ptp(x)), 4),
                },
                "xaxis": {**axis, "title": {"text": "x, mm"}},
                "yaxis": {**axis, "title": {"text": "y, mm"}},
                "zaxis": {**axis, "title": {"text": "z, mm (x 3)"}, "nticks": 4},
                "camera": {"eye": {"x": -0.6, "y": -1.9, "z": 1.5}, "center": {"x": 0.0, "y": 0.0, "z": -0.15}},
            },
        },
        "narrow": {"height": 400, "scene.camera.eye": {"x": -0.9, "y": -2.9, "z": 2.3}},
    }


def _largest(value: Float, k: int) -> Float:
    """Value of largest magnitude in each block of k x k; NaN where all are."""
    ny, nx = value.shape
    my, mx = math.ceil(ny / k), math.ceil(nx / k)
    padded = np.full((my * k, mx * k), np.nan)
    padded[:ny, :nx] = value
    blocks = padded.reshape(my, k, mx, k).transpose(0, 2, 1, 3).reshape(my, mx, k * k)
    pick = np.argmax(np.nan_to_num(np.abs(blocks), nan=-1.0), axis=2)
    out: Float = np.take_along_axis(blocks, pick[..., None], axis=2)[..., 0]
    return out


def _blank(size: Float, picture: MapPicture, j: int, i: int) -> None:
    """Take a neighbourhood out of the search."""
    spacing = _SPACING * max(float(np.ptp(picture.x_mm)), float(np.ptp(picture.y_mm)))
    near = np.hypot(picture.x_mm[None, :] - picture.x_mm[i], picture.y_mm[:, None] - picture.y_mm[j]) < spacing
    size[near] = 0.0


def _offsets(
    places: tuple[Callout, ...], picture: MapPicture, px_per_mm: float, label_px: tuple[float, float] = _LABEL_PX
) -> list[tuple[int, int]]:
    """Offset of each label from its place in pixels (right, down), so that labels hide no other label or place."""
    width, height = label_px
    spots = [(p.x_mm * px_per_mm, -p.y_mm * px_per_mm) for p in places]
    left, right = float(picture.x_mm[0]) * px_per_mm, float(picture.x_mm[-1]) * px_per_mm
    top, bottom = -float(picture.y_mm[-1]) * px_per_mm, -float(picture.y_mm[0]) * px_per_mm
    taken: list[tuple[float, float]] = []
    chosen = []
    for spot in spots:
        best, least = (0, -30), math.inf
        for ring in (1.0, 1.7, 2.5):
            for ax, ay in ((46, -26), (-46, -26), (46, 26), (-46, 26), (0, -32), (0, 32), (62, 0), (-62, 0)):
                x, y = spot[0] + ring * ax, spot[1] + ring * ay
                clash = sum(abs(x - u) < width and abs(y - v) < height for u, v in taken)
                clash += sum(abs(x - u) < 0.6 * width and abs(y - v) < 0.7 * height for u, v in spots)
                outside = x - width / 2 < left or x + width / 2 > right or y - height / 2 < top or y > bottom - 10
                cost = 10.0 * clash + 5.0 * outside + ring
                if cost < least:
                    least, best = cost, (round(ring * ax), round(ring * ay))
        taken.append((spot[0] + best[0], spot[1] + best[1]))
        chosen.append(best)
    return chosen
