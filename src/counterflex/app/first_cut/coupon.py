"""A coupon that loads the arm in many directions, and the places to measure on it.

Four shoulders (feed +y, -y, -x, +x) and three slots (+x, -y, +y) of different depths, each face made by one stretch of
the path, ribs between them. Forces of slots and shoulders differ in direction, so walls and floors show the deflection
in all directions of the part; feeds to and fro tell it from an offset of the part frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell

SHOULDER: Final = 0.1875
"""Radial depth of a shoulder, of the tool's diameter."""
RIB: Final = 0.3125
"""Rib between two faces, of the tool's diameter: stiff against the tool."""
DEPTH: Final = 0.25
"""Axial depth of the shallowest slot, of the tool's diameter; the others are 1.25 and 1.5 times as deep, the shoulders
twice. The slot along x is the deepest: the last slot begins in it without a plunge."""
_AIR: Final = 0.75
"""Path beside the blank, of the tool's diameter."""
_CLEAR_MM: Final = 20.0
_FASTEST_MM_MIN: Final = 60_000.0
_FASTEST_RPM: Final = 200_000.0
COLUMNS: Final = ("number", "face", "axis", "x_mm", "y_mm", "z_mm", "nominal_mm", "measured_mm")


@dataclass(frozen=True)
class MeasuringPlace:
    """A place to measure: the coordinate of a face along an axis of the part."""

    face: str
    axis: int  # 0..2
    p_part: tuple[float, float, float]  # m, on the nominal face


@dataclass(frozen=True)
class Coupon:
    """Program and places."""

    text: str
    places: tuple[MeasuringPlace, ...]


@dataclass(frozen=True)
class _Stretch:
    name: str
    begin: tuple[float, float]  # mm
    end: tuple[float, float]
    depth: float
    walls: tuple[tuple[int, float, tuple[float, ...]], ...]  # axis, coordinate, stations along the feed
    floor: tuple[float, ...]  # stations along the feed

    def places(self, top: float) -> list[MeasuringPlace]:
        """Places on the walls of a stretch, at half their depth, and on its floor."""
        out = []
        feed = 0 if self.begin[1] == self.end[1] else 1
        for axis, value, stations in self.walls:
            for station in stations:
                p = [0.0, 0.0, top - 0.5 * self.depth]
                p[axis], p[feed] = value, station
                out.append(MeasuringPlace(f"{self.name} wall", axis, (p[0] * MM, p[1] * MM, p[2] * MM)))
        for station in self.floor:
            p = [self.begin[0], self.begin[1], top - self.depth]
            p[feed] = station
            out.append(MeasuringPlace(f"{self.name} floor", 2, (p[0] * MM, p[1] * MM, p[2] * MM)))
        return out


def coupon(cell: Cell, tool: int, *, feed_mm_min: float, rpm: float, depth_mm: float | None = None) -> Coupon:
    """The coupon for the blank and a tool of a cell.

    Args:
        depth_mm: Of the shallowest slot; None: :data:`DEPTH` of the diameter.

    Raises:
        InputError: The blank is too small, or the flutes are too short.
    """
    for name, value, most in (
        ("feed, mm/min", feed_mm_min, _FASTEST_MM_MIN),
        ("spindle speed, rpm", rpm, _FASTEST_RPM),
    ):
        if not 1.0 <= value <= most:
            raise InputError(
                f"{name}, of the coupon is out of range", where="--propose", value=value, limit=f"1 to {most:g}"
            )
    stock, cutter = cell.stock(), cell.cutter(tool)
    d = 2.0 * cutter.radius_m / MM
    a = DEPTH * d if depth_mm is None else depth_mm
    x, y, top = stock.x_m() / MM, stock.y_m() / MM, float(stock.z.max()) / MM
    half = 0.5 * stock.cell_m / MM
    x0, x1, y0, y1 = x[0] - half, x[-1] + half, y[0] - half, y[-1] + half
    ae, rib = SHOULDER * d, RIB * d
    needed = (2.0 * (ae + rib + d) + rib, 2.0 * (ae + rib) + 2.5 * d)
    flute = cutter.flute_length_m / MM
    if x1 - x0 < needed[0] or y1 - y0 < needed[1] or float(stock.z.min()) / MM < top - 1e-6:
        raise InputError(
            f"the blank is too small or not flat for a coupon of tool {tool}, diameter {d:g} mm",
            where=str(cell.path),
            value=f"{x1 - x0:g} x {y1 - y0:g} mm",
            limit=f"at least {needed[0]:.0f} x {needed[1]:.0f} mm, flat",
            hint="State a larger blank in [part.stock], or choose a smaller tool: --tool",
        )
    if cutter.corner_radius_m / MM > 0.5 * a:
        raise InputError(
            "the tool is too round for the walls of a coupon",
            where=f"tool {tool}",
            value=f"corner radius {cutter.corner_radius_m / MM:g} mm",
            limit=f"<= {0.5 * a:g} mm, half the depth of the shallowest slot",
        )
    if 2.0 * a > flute:
        raise InputError(
            "the shoulders are deeper than the flutes are long", value=f"{2.0 * a:g} mm", limit=f"<= {flute:g} mm"
        )
    stretches = _stretches((x0, x1, y0, y1), d, a)
    places = [place for one in stretches for place in one.places(top)]
    return Coupon(_program(stretches, tool, d, top, feed_mm_min, rpm), tuple(places))


def _stretches(box: tuple[float, float, float, float], d: float, a: float) -> list[_Stretch]:
    x0, x1, y0, y1 = box
    ae, rib, r, air = SHOULDER * d, RIB * d, 0.5 * d, _AIR * d
    off, edge = r - ae, ae + rib
    row = y0 + edge + r  # middle of the slot along x
    left, right = x0 + edge + r, x1 - edge - r  # middles of the slots along y
    begin = row + r + 0.3 * d
    along_y = _between(begin, y1 - ae - 0.4 * d)
    along_x = _between(x0 + 0.5 * d, x1 - 0.5 * d)
    between = _between(left + r + 0.1 * d, right - r - 0.1 * d, 2)
    entry, first = y1 - ae - 0.15 * d, x0 + ae + 0.15 * d
    return [
        _Stretch("left shoulder", (x0 - off, y0 - air), (x0 - off, y1 + air), 2 * a, ((0, x0 + ae, along_y),), ()),
        _Stretch("right shoulder", (x1 + off, y1 + air), (x1 + off, y0 - air), 2 * a, ((0, x1 - ae, along_y),), ()),
        _Stretch("front shoulder", (x1 + air, y0 - off), (x0 - air, y0 - off), 2 * a, ((1, y0 + ae, along_x),), ()),
        _Stretch("back shoulder", (x0 - air, y1 + off), (x1 + air, y1 + off), 2 * a, ((1, y1 - ae, between),), ()),
        _Stretch(
            "slot +x", (x0 - air, row), (x1 + air, row), 1.5 * a,
            ((1, row - r, (first, *along_x)), (1, row + r, between)), (first, *between),
        ),
        _Stretch(
            "slot -y", (left, y1 + air), (left, row), a,
            ((0, left - r, (entry, *along_y)), (0, left + r, along_y)), along_y,
        ),
        _Stretch(
            "slot +y", (right, row), (right, y1 + air), 1.25 * a,
            ((0, right - r, along_y), (0, right + r, (*along_y, entry))), along_y,
        ),
    ]  # fmt: skip


def _between(begin: float, end: float, count: int = 3) -> tuple[float, ...]:
    """Places (count,) evenly between two, the ends included."""
    return tuple(begin + (end - begin) * k / (count - 1) for k in range(count))


def _program(stretches: list[_Stretch], tool: int, d: float, top: float, feed_mm_min: float, rpm: float) -> str:
    lines = [
        f"(Coupon for a first cut, tool {tool}, diameter {d:g} mm)",
        "G17 G54 G40 G49 G80 G90", "G21", f"M6 T{tool}", f"G43 H{tool}", f"M3 S{rpm:g}", f"G0 Z{top + _CLEAR_MM:g}",
    ]  # fmt: skip
    for one in stretches:
        (bx, by), (ex, ey) = one.begin, one.end
        lines += [
            f"({one.name})", f"G0 X{bx:.3f} Y{by:.3f}", f"G0 Z{top + 2.0:g}",
            f"G1 Z{top - one.depth:.3f} F{0.2 * feed_mm_min:g}", f"G1 X{ex:.3f} Y{ey:.3f} F{feed_mm_min:g}",
            f"G0 Z{top + _CLEAR_MM:g}",
        ]  # fmt: skip
    return "\n".join([*lines, "M5", "M30", ""])


def table(places: tuple[MeasuringPlace, ...]) -> str:
    """The places as a table to fill in: the last column is what is measured."""
    rows = [",".join(COLUMNS)]
    for number, one in enumerate(places, 1):
        p = ",".join(f"{value / MM:.3f}" for value in one.p_part)
        nominal = one.p_part[one.axis] / MM
        rows.append(f"{number},{one.face},{'xyz'[one.axis]},{p},{nominal:.3f},")
    return "\n".join([*rows, ""])


def shown(cell: Cell, tool: int, coupon: Coupon) -> dict[str, Any]:
    """Plain values for a summary."""
    faces: dict[str, int] = {}
    for one in coupon.places:
        faces[one.face] = faces.get(one.face, 0) + 1
    return {"job": "firstcut", "cell": cell.name, "tool": tool, "places": len(coupon.places), "faces": faces}
