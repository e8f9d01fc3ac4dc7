"""A coupon that loads the arm in many directions, and the places to measure on it.

Four shoulders (feed +y, -y, -x, +x), a slot with a corner (+x, then +y) and one that ends in it (-y), of different
depths, each face made by one stretch of the path, ribs between them. Forces of slots and shoulders differ in direction,
so walls and floors show the deflection in all directions of the part; feeds to and fro tell it from an offset of the
part frame. Three shoulders are milled again half their length, lightly and the other way: little deflection is there,
and what the axes lose by play and friction remains. Behind the corner and where a cut begins the drives yield.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import InputError
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell

SHOULDER: Final = 0.1875
"""Radial depth of a shoulder, of the tool's diameter."""
RIB: Final = 0.3125
"""Rib between two faces, of the tool's diameter: stiff against the tool."""
LIGHT: Final = 0.0625
"""Radial depth of a light pass, of the tool's diameter."""
DEPTH: Final = 0.25
"""Axial depth of the shallowest slot, of the tool's diameter; the other is 1.5 times as deep, the shoulders
twice. The slot with the corner is the deepest: the other one ends in it."""
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
    points: tuple[tuple[float, float], ...]  # mm, the path
    depth: float
    walls: tuple[tuple[int, float, tuple[float, ...]], ...]  # axis, coordinate, stations along the wall
    floor: tuple[tuple[float, float], ...]

    def places(self, top: float) -> list[MeasuringPlace]:
        """Places on the walls of a stretch, at half their depth, and on its floor."""
        out = []
        for axis, value, stations in self.walls:
            for station in stations:
                p = [station, station, top - 0.5 * self.depth]
                p[axis] = value
                out.append(MeasuringPlace(f"{self.name} wall", axis, (p[0] * MM, p[1] * MM, p[2] * MM)))
        for x, y in self.floor:
            out.append(MeasuringPlace(f"{self.name} floor", 2, (x * MM, y * MM, (top - self.depth) * MM)))
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
    off, edge, more = r - ae, ae + rib, LIGHT * d
    row = y0 + edge + r  # middle of the slot along x
    left, right = x0 + edge + r, x1 - edge - r  # middles of the slots along y
    low, high = row + r + 0.3 * d, y1 - ae - 0.4 * d  # where walls along y are whole
    near, far = x0 + 0.5 * d, x1 - 0.5 * d  # the same along x
    between = _between(left + r + 0.1 * d, right - r - 0.1 * d)
    entry, first = y1 - ae - 0.15 * d, x0 + ae + 0.15 * d
    begins, ends = (low, low + 0.25 * d), (low + 0.7 * d, high)
    up, down, aside = low + 0.6 * d, high - 0.6 * d, far - 0.6 * d  # ends of the light passes
    return [
        _Stretch("left shoulder", ((x0 - off, y0 - air), (x0 - off, y1 + air)), 2 * a, ((0, x0 + ae, begins),), ()),
        _Stretch(
            "left shoulder light", ((x0 - off + more, y1 + air), (x0 - off + more, up), (x0 - r, up)), 2 * a,
            ((0, x0 + ae + more, ends),), (),
        ),
        _Stretch(
            "right shoulder", ((x1 + off, y1 + air), (x1 + off, y0 - air)), 2 * a,
            ((0, x1 - ae, (high - 0.25 * d, high)),), (),
        ),
        _Stretch(
            "right shoulder light", ((x1 + off - more, y0 - air), (x1 + off - more, down), (x1 + r, down)), 2 * a,
            ((0, x1 - ae - more, _between(y0 + ae + 0.4 * d, high - 0.7 * d)),), (),
        ),
        _Stretch(
            "front shoulder", ((x1 + air, y0 - off), (x0 - air, y0 - off)), 2 * a,
            ((1, y0 + ae, (far - 0.25 * d, far)),), (),
        ),
        _Stretch(
            "front shoulder light", ((x0 - air, y0 - off + more), (aside, y0 - off + more), (aside, y0 - r)), 2 * a,
            ((1, y0 + ae + more, _between(near, far - 0.7 * d)),), (),
        ),
        _Stretch("back shoulder", ((x0 - air, y1 + off), (x1 + air, y1 + off)), 2 * a, ((1, y1 - ae, between),), ()),
        _Stretch(
            "corner slot", ((x0 - air, row), (right, row), (right, y1 + air)), 1.5 * a,
            (
                (1, row - r, (first, near, left + 0.1 * d, *(right - k * d for k in (0.8, 0.4)))),
                (0, right + r, (*(row + k * d for k in (0.25, 0.5, 0.9)), *_between(low, high), entry)),
            ),
            ((first, row), *((x, row) for x in between), *((right, y) for y in _between(low, high))),
        ),
        _Stretch(
            "slot -y", ((left, y1 + air), (left, row)), a,
            ((0, left - r, (entry, *_between(low, high, 3))), (0, left + r, _between(low, high))),
            tuple((left, y) for y in _between(low, high, 3)),
        ),
    ]  # fmt: skip


def _between(begin: float, end: float, count: int = 2) -> tuple[float, ...]:
    """Places (count,) evenly between two, the ends included."""
    return tuple(begin + (end - begin) * k / (count - 1) for k in range(count))


def _program(stretches: list[_Stretch], tool: int, d: float, top: float, feed_mm_min: float, rpm: float) -> str:
    lines = [
        f"(Coupon for a first cut, tool {tool}, diameter {d:g} mm)",
        "G17 G54 G40 G49 G80 G90", "G21", f"M6 T{tool}", f"G43 H{tool}", f"M3 S{rpm:g}", f"G0 Z{top + _CLEAR_MM:g}",
    ]  # fmt: skip
    for one in stretches:
        (bx, by), *rest = one.points
        lines += [
            f"({one.name})", f"G0 X{bx:.3f} Y{by:.3f}", f"G0 Z{top + 2.0:g}",
            f"G1 Z{top - one.depth:.3f} F{0.2 * feed_mm_min:g}", f"F{feed_mm_min:g}",
            *(f"G1 X{x:.3f} Y{y:.3f}" for x, y in rest),
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


class ProposedCoupon(Summary):
    """Coupon and what to measure on it."""

    def _shown(self) -> Parts:
        yield ShownTable.of("To measure", "face=0 | places=1", self["faces"].items())


def shown(cell: Cell, tool: int, coupon: Coupon) -> ProposedCoupon:
    """Plain values for a summary."""
    faces: dict[str, int] = {}
    for one in coupon.places:
        faces[one.face] = faces.get(one.face, 0) + 1
    answer = {"job": "firstcut", "cell": cell.name, "tool": tool, "places": len(coupon.places), "faces": faces}
    return ProposedCoupon(answer)
