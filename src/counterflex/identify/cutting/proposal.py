"""Test cuts to propose: slots at spread feeds and depths, and stepped widths along two sides of a blank."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import MM, MM_PER_MIN, RPM, UM
from counterflex.cutting.arc_force import ArcCuts, TermForce
from counterflex.cutting.cutter import Cutter
from counterflex.identify.cutting.considered import expected_sigma
from counterflex.identify.data.model import CellModel
from counterflex.identify.recipe import Proposal

CELL_M = 0.2 * MM
"""Side of a cell of the simulated blank."""


def machine_settings(cell: CellModel, tool: int, cutter: Cutter) -> dict[str, Any]:
    """Controller, cutter and blank of a cell in plain values, SI.

    Raises ModelError: the robot has no closed-form geometry, or the cell no box as blank.
    """
    opw, box = cell.nominal_robot.opw, cell.blank_part
    if opw is None or box is None:
        raise ModelError(
            "test cuts need the closed-form geometry of the robot and a box as blank", value=cell.nominal_robot.name
        )
    T = np.eye(4)
    for segment in cell.nominal_end_effector.segments:
        T = T @ segment.T_prev_seg
    settings: dict[str, Any] = {
        "tool": tool,
        "opw_m": [opw.a1_m, opw.a2_m, opw.b_m, opw.c1_m, opw.c2_m, opw.c3_m, opw.c4_m],
        "opw_offsets_rad": list(opw.offsets_rad),
        "opw_signs": [int(s) for s in opw.signs],
        "joint_limits_rad": cell.nominal_robot.joint_limits_rad.tolist(),
        "T_flange_tcp": (T @ cell.nominal_end_effector.T_last_tcp).tolist(),
        "T_base_part": cell.T_base_part.tolist(),
        "branch": cell.branch,
        "rotation_about_tool_rad": cell.rotation_about_tool_rad,
        "cutter_diameter_m": cutter.diameter_m,
        "cutter_corner_radius_m": cutter.corner_radius_m,
        "cutter_flutes": cutter.flutes,
        "cutter_flute_length_m": cutter.flute_length_m,
        "blank_low_m": box[0].tolist(),
        "blank_high_m": box[1].tolist(),
        "blank_cell_m": CELL_M,
    }
    if cell.datum_points_part is not None:
        settings["datum_points_m"] = cell.datum_points_part.tolist()
    return settings


SETTINGS: dict[str, float | int | str | bool] = {
    "spindle_rad_s": 13000.0 * RPM,
    "feed_tooth_max_m": 80.0 * UM,
    "feed_ratio": 5.0,
    "depth_max_m": 0.0,
    "force_max_n": 500.0,
    "side_share": 0.25,
    "measure_depth": True,
}
"""Settings of a proposal; ``depth_max_m`` 0 means 0.3 diameters."""
UNITS = {"kc": "Pa", "kr": "Pa", "ka": "Pa", "mc": "1", "mr": "1", "ma": "1", "ec": "N/m", "er": "N/m", "ea": "N/m"}
"""Units of the constants, for the report."""
GAP_M = 3.0 * MM
_RUN_IN_M = 10.0 * MM
_RUN_IN_S = 0.5
_STEADY_M = 12.0 * MM


@dataclass(frozen=True)
class CutMove:
    """One straight feed motion in the plane of a blank: a test piece, or what joins two of them."""

    blank: int  # number of the blank
    cut: int  # number of the cut
    start: tuple[float, float]  # (x, y) m, part
    end: tuple[float, float]  # (x, y) m
    depth_m: float  # below the top of the blank
    width_m: float  # signed, see the channel `width`
    feed_tooth_m: float  # feed per tooth
    piece: bool  # whether it is a test piece


def propose(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Propose ``count`` pieces of test cuts; see :data:`counterflex.identify.recipe.Propose`.

    Slots and, for a part of the pieces, side cuts of half and quarter the diameter, up and down. Feeds per tooth
    spread geometrically over ``feed_ratio``; the depth of each cut keeps the force of the law known so far below
    ``force_max_n``.

    ``count``: Number of pieces, each with a feed of its own. ``settings``: :data:`SETTINGS`, ``tool`` and ``seed``.
    Raises InputError: the cell has no box as blank, or the blank is too small for the tool.
    """
    options = {**SETTINGS, "tool": 1, "seed": 0, **settings}
    tool = int(options["tool"]) or 1
    cutter = cell.cutter_of(tool)
    if count < 1:
        raise InputError("number of test cuts is out of range", value=count, limit=">= 1")
    if float(options["feed_ratio"]) < 1.0:
        raise InputError("feed_ratio is out of range", value=options["feed_ratio"], limit=">= 1, better 4 or more")
    if cell.blank_part is None:
        raise InputError(
            "the blank of the cell is no box, so no test cuts can be laid out in it",
            where=cell.name,
            hint="Clamp a test blank and give [part.stock] box_min_mm and box_max_mm in a copy of the cell file",
        )
    moves = _CutLayout(cell, cutter, cell.blank_part, options, count).moves()
    columns = _columns(moves, cell.blank_part[1, 2], cutter, float(options["spindle_rad_s"]))
    pieces = [m for m in moves if m.piece]
    feeds = [m.feed_tooth_m for m in pieces]
    largest = _peak_force(cell, cutter, pieces)
    expected = expected_sigma(cell, cutter, moves, gauged=bool(options["measure_depth"]))
    program = program_text(moves, float(cell.blank_part[1, 2]), tool, cutter, float(options["spindle_rad_s"]))
    return Proposal(
        recipe="cutting",
        kind="slots",
        columns=columns,
        expected=expected,
        remarks=(
            f"{len(pieces)} pieces in {len({m.cut for m in moves})} cuts on {len({m.blank for m in moves})} blank(s), "
            f"feed per tooth {min(feeds) / UM:.1f} to {max(feeds) / UM:.1f} um, largest expected force "
            f"{largest:.0f} N",
            "Clamp a blank of the size of the cell's, touch it off, record force and joint angles over the whole "
            "program, some time in air before and after each cut included: the zero is taken from there",
            "Measure the depth of the slots afterwards where you can (channel depth_measured)",
        ),
        settings={**machine_settings(cell, tool, cutter), "measure_depth": bool(options["measure_depth"])},
        units=UNITS | {name: "m" for name in expected if name.startswith("top.")},
        files={"test_cuts.ngc": program},
    )


class _CutLayout:
    """Places pieces in blanks: side cuts along both long sides, slots between them."""

    def __init__(self, cell: CellModel, cutter: Cutter, box: Float, options: Mapping[str, Any], count: int) -> None:
        self.cell, self.cutter, self.box, self.count = cell, cutter, box, count
        self.rng = np.random.default_rng(int(options["seed"]))
        diameter = cutter.diameter_m
        size = box[1, :2] - box[0, :2]
        self.axis = int(self.rng.integers(0, 2))  # along x or y
        self.length, self.breadth = float(size[self.axis]), float(size[1 - self.axis])
        self.feed_most = float(options["feed_tooth_max_m"])
        self.feed_least = self.feed_most / float(options["feed_ratio"])
        self.spindle = float(options["spindle_rad_s"])
        self.teeth_per_s = cutter.flutes * self.spindle / (2.0 * math.pi)
        least = 2.0 * diameter + 0.4 * self.speed(self.feed_most) + _STEADY_M
        self.per_cut = max(1, int(self.length / least))
        if self.length < diameter + _STEADY_M or self.breadth < diameter + 2.0 * GAP_M:
            raise InputError(
                "the blank is too small for test cuts with this tool",
                value=f"{self.length / MM:.0f} x {self.breadth / MM:.0f} mm",
                limit=f"{(diameter + _STEADY_M) / MM:.0f} x {(diameter + 2.0 * GAP_M) / MM:.0f} mm",
            )
        deepest = float(options["depth_max_m"]) or 0.3 * diameter
        self.deepest = min(deepest, 0.9 * cutter.flute_length_m, 0.8 * float(box[1, 2] - box[0, 2]))
        self.force = float(options["force_max_n"])
        sides = round(float(options["side_share"]) * count)
        self.sides = 0 if count < 6 else min(sides, 2 * self.per_cut)
        self.margin = 0.5 * diameter + GAP_M if self.sides else 0.0

    def moves(self) -> list[CutMove]:
        """All motions, in order."""
        spread = np.linspace(0.0, 1.0, self.count) if self.count > 1 else np.ones(1)
        rising = self.feed_least * (self.feed_most / self.feed_least) ** spread
        upper = self.rng.permutation(rising[len(rising) // 3 :])  # side cuts have thinner chips: not the least feeds
        rest = self.rng.permutation(np.concatenate([rising[: len(rising) // 3], upper[: len(upper) - self.sides]]))
        feeds = [*rest.tolist(), *upper[len(upper) - self.sides :].tolist()]
        out: list[CutMove] = []
        cut, blank = 0, 0
        side, lanes = 0, self._lanes()
        remaining = self.sides
        while remaining > 0 and side < 2:
            n = min(self.per_cut, -(-remaining // (2 - side)))
            # A long blank takes more pieces along a side than there are widths: these come again, in the same order.
            widths = np.resize(self.rng.permutation([0.5, 0.25, 0.75, 0.35]), n) * self.cutter.diameter_m
            out += self._along(blank, cut, self._side_lines(widths, side), [feeds.pop() for _ in range(n)], widths)
            remaining, cut, side = remaining - n, cut + 1, side + 1
        lane = 0
        while feeds:
            if lane == len(lanes):
                blank, lane = blank + 1, 0
                self.margin, lanes = 0.0, self._lanes()
            n = min(self.per_cut, len(feeds))
            own = [feeds.pop() for _ in range(n)]
            out += self._along(blank, cut, [lanes[lane]] * n, own, None)
            lane, cut = lane + 1, cut + 1
        return out

    def speed(self, feed_tooth_m: float) -> float:
        """Feed in m/s."""
        return feed_tooth_m * self.teeth_per_s

    def _lanes(self) -> list[float]:
        """Centre lines of slots across the blank."""
        diameter = self.cutter.diameter_m
        room = self.breadth - 2.0 * self.margin - 2.0 * GAP_M - diameter
        count = max(1, int(room / (diameter + GAP_M)) + 1)
        begin = self.margin + GAP_M + 0.5 * diameter
        return [begin + i * (diameter + GAP_M) for i in range(count)]

    def _side_lines(self, widths: Float, side: int) -> list[float]:
        """Centre lines of side cuts: beyond the low or the high side by the radius less the width."""
        radius = self.cutter.radius_m
        return [w - radius if side == 0 else self.breadth + radius - w for w in widths.tolist()]

    def _along(
        self, blank: int, cut: int, lines: list[float], feeds: list[float], widths: Float | None
    ) -> list[CutMove]:
        """One cut through the blank, piece after piece; up or down along a side, either way in a slot."""
        forward = bool(self.rng.integers(0, 2))
        before, after = (self.cutter.radius_m + _RUN_IN_M + _RUN_IN_S * self.speed(f) for f in (feeds[0], feeds[-1]))
        begin, end = (-before, self.length + after) if forward else (-after, self.length + before)
        inner = np.linspace(0.0, self.length, len(feeds) + 1)
        bounds = [begin, *inner[1:-1].tolist(), end]
        if not forward:
            bounds.reverse()
        depth = self._depth(max(feeds), widths)
        out: list[CutMove] = []
        for i, (feed, line) in enumerate(zip(feeds, lines, strict=True)):
            signed = self.cutter.diameter_m if widths is None else self._signed(float(widths[i]), line, forward)
            if out and lines[i - 1] != line:
                across = replace(out[-1], start=out[-1].end, end=self._point(bounds[i], line), piece=False)
                out.append(across)
            start, stop = self._point(bounds[i], line), self._point(bounds[i + 1], line)
            out.append(CutMove(blank, cut, start, stop, depth, signed, feed, True))
        return out

    def _signed(self, width: float, line: float, forward: bool) -> float:
        """Positive where the work lies to the left of the feed."""
        work_on_high_side = line < 0.5 * self.breadth
        left_is_high = forward if self.axis == 0 else not forward
        return width if work_on_high_side == left_is_high else -width

    def _depth(self, feed: float, widths: Float | None) -> float:
        most = self.cutter.diameter_m if widths is None else float(np.max(widths))
        probe = CutMove(0, 0, (0.0, 0.0), (1.0, 0.0), MM, most, feed, True)
        per_m = _peak_force(self.cell, self.cutter, [probe]) / MM
        largest = min(self.deepest, self.force / per_m)
        return float(np.round(largest * self.rng.uniform(0.4, 1.0) / (0.1 * MM)) * 0.1 * MM) or 0.1 * MM

    def _point(self, along: float, across: float) -> tuple[float, float]:
        x, y = (along, across) if self.axis == 0 else (across, along)
        return float(self.box[0, 0]) + x, float(self.box[0, 1]) + y


def arc_cuts(cutter: Cutter, moves: list[CutMove]) -> ArcCuts:
    """The arcs of level moves."""
    n, R = len(moves), cutter.radius_m
    width = np.array([m.width_m for m in moves])
    slot = np.abs(width) >= 2.0 * R * (1.0 - 1e-9)
    left = np.where(slot | (width > 0.0), R, -R - width)
    right = np.where(slot | (width < 0.0), -R, R - width)
    return ArcCuts(
        cutter,
        np.array([m.depth_m for m in moves]),
        np.arccos(np.clip(left / R, -1.0, 1.0)),
        np.arccos(np.clip(right / R, -1.0, 1.0)),
        np.array([m.feed_tooth_m for m in moves]),
        np.zeros(n),
    )


def _peak_force(cell: CellModel, cutter: Cutter, moves: list[CutMove]) -> float:
    """Largest mean force of the moves by the law known so far, N."""
    cuts = arc_cuts(cutter, moves)
    force = np.zeros((len(moves), 3))
    for p, *k in cell.force_law.terms():
        force += TermForce.of(cuts, float(p)).value @ np.array(k)
    return float(np.max(np.linalg.norm(force, axis=1)))


def _columns(moves: list[CutMove], top_m: float, cutter: Cutter, spindle: float) -> dict[str, Float]:
    speed = cutter.flutes * spindle / (2.0 * math.pi)
    z = np.array([top_m - m.depth_m for m in moves])
    return {
        "blank": np.array([float(m.blank) for m in moves]),
        "cut": np.array([float(m.cut) for m in moves]),
        "start_x_m": np.array([m.start[0] for m in moves]),
        "start_y_m": np.array([m.start[1] for m in moves]),
        "start_z_m": z,
        "end_x_m": np.array([m.end[0] for m in moves]),
        "end_y_m": np.array([m.end[1] for m in moves]),
        "end_z_m": z,
        "feed_m_s": np.array([m.feed_tooth_m * speed for m in moves]),
        "spindle_rad_s": np.full(len(moves), spindle),
        "depth_m": np.array([m.depth_m for m in moves]),
        "width_m": np.array([m.width_m for m in moves]),
    }


def program_text(moves: list[CutMove], top_m: float, tool: int, cutter: Cutter, spindle: float) -> str:
    """The test cuts as G-code: blanks one after the other, with a stop (M0) to change them."""
    speed = cutter.flutes * spindle / (2.0 * math.pi)
    clear = (top_m + 15.0 * MM) / MM
    lines = [
        "(Test cuts for the force constants)", "G17 G21 G90 G94", f"M6 T{tool}", f"M3 S{spindle / RPM:.0f}",
    ]  # fmt: skip
    blank, cut = 0, -1
    for m in moves:
        z = (top_m - m.depth_m) / MM
        if m.blank != blank:
            lines += [f"G0 Z{clear:.3f}", "M0 (next blank)"]
            blank = m.blank
        if m.cut != cut:
            cut = m.cut
            lines += [
                f"G0 Z{clear:.3f}",
                f"G0 X{m.start[0] / MM:.3f} Y{m.start[1] / MM:.3f}",
                f"(cut {cut + 1}: depth {m.depth_m / MM:.2f} mm)",
                f"G0 Z{z:.3f}",
            ]
        feed = m.feed_tooth_m * speed / MM_PER_MIN
        lines.append(f"G1 X{m.end[0] / MM:.3f} Y{m.end[1] / MM:.3f} F{feed:.1f}")
    return "\n".join([*lines, f"G0 Z{clear:.3f}", "M5", "M30", ""])
