"""Facts of the cell on the page: what its file states and assumes, the robot in its worst posture, blank and path."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from counterflex.app.lowest_mode import at_largest_force, posture_at_blank
from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, N_PER_MM2
from counterflex.cutting.coefficients import KienzleLaw, LinearEdgeLaw
from counterflex.cutting.stock import HeightMap
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.class_stiffness import axis_names
from counterflex.files.cell.robot import PlayTable, ServoTable
from counterflex.geometry import pose
from counterflex.path.external_axes import ExternalPlaces
from counterflex.path.toolpath import FEED
from counterflex.plan.plan import Plan
from counterflex.report.data import CellDrawing, Fact
from counterflex.robot.elasticity.chain import ElasticChain, forward, frames
from counterflex.robot.model import catalog

_UNKNOWN_BODY: Final = "ASSUMED: its stiffness is not known"
_CLASS: Final = "ASSUMED: median of the robot's class, not measured"
_DRIVES: Final = "ASSUMED: typical of the robot's class, not measured"


def robot_name(cell: Cell) -> str:
    """Maker and model of a catalogue robot, otherwise the name of the chain."""
    if cell.tables.robot.catalog is None:
        return cell.chain.name
    entry = catalog.entry(cell.tables.robot.catalog)
    return f"{entry.manufacturer} {entry.model}"


def _of_robot(cell: Cell) -> list[Fact]:
    tables, given, facts = cell.tables, cell.class_stiffness, []
    if tables.robot.catalog is not None:
        for group, source in catalog.entry(tables.robot.catalog).sources.items():
            facts.append(Fact(f"Robot: {group.replace('_', ' ')}", source.status, source.source))
    if given is not None:
        k = ", ".join(f"{value:.2g}" for value in given.prior.median_nm_per_rad[list(given.axes)])
        facts.append(Fact(f"Robot: stiffness of {given.named}", f"{k} Nm/rad", _CLASS))
    for body in tables.end_effector:
        rigid = body.name in cell.bodies_of_unknown_stiffness
        value = f"{body.mass_kg:g} kg" + (", taken as rigid" if rigid else "")
        facts.append(Fact(f"End effector: {body.name}", value, _UNKNOWN_BODY if rigid else body.source or "cell file"))
    return facts


def _of_cutting(cell: Cell) -> list[Fact]:
    law, material = cell.force_law, cell.material
    if isinstance(law, KienzleLaw):
        kc, kr, ka = (value / N_PER_MM2 for value in law.k11_pa())
        value = f"kc1.1 {kc:.0f}, kr1.1 {kr:.0f}, ka1.1 {ka:.0f} N/mm2; m {law.mc:g}, {law.mr:g}, {law.ma:g}"
    elif isinstance(law, LinearEdgeLaw):
        value = f"ktc {law.ktc_pa / N_PER_MM2:.0f}, krc {law.krc_pa / N_PER_MM2:.0f} N/mm2"
    else:
        value = ", ".join(f"{key} {number:g}" for key, number in material.law_values().items())
    chip = f"{law.h_min_m / MM:g} to {law.h_max_m / MM:g} mm"
    beyond, extrapolated = (", and beyond", ", extrapolated") if material.allow_extrapolation else ("", "")
    return [
        Fact(f"Cutting constants: {material.name or material.catalog}", value, law.source),
        Fact("Mean chip thickness allowed", chip + beyond, "range of the constants" + extrapolated),
    ]


def assumptions(cell: Cell, plan: Plan) -> tuple[Fact, ...]:
    """Every assumption behind a plan for this cell."""
    tables = cell.tables
    facts = [*_of_robot(cell), *_of_cutting(cell)]
    for tool in tables.tools:
        shape = f"D{tool.diameter_mm:g} r{tool.corner_radius_mm:g}, {tool.flutes} flutes"
        facts.append(Fact(f"Tool T{tool.number}", shape, tool.name or "cell file"))
    part, dynamics, lowest = cell.part, tables.dynamics, at_largest_force(cell, plan)
    how = "touched with the robot" if part.measured_with == "robot" else "measured from outside"
    facts += [
        Fact("Part frame", how, f"{len(part.datum_points_mm)} datum points"),
        *drive_facts(cell),
        Fact(
            "Shape of the correction",
            f"for the mode, {dynamics.correction_smoothing_ms:g} ms; sent {dynamics.correction_lead_ms:g} ms earlier",
            "cell file",
        ),
        Fact(
            "Lowest mode",
            f"{lowest.mode.hz:.1f} Hz{lowest.between}, damping {lowest.mode.damping_ratio:.2g}",
            f"{lowest.origin}, where the force is largest; for corrections, the feed and the prediction",
        ),
        Fact(
            "Posture",
            f"{tables.posture.branch}, turned {tables.posture.rotation_about_tool_deg:g} deg about the tool",
            "cell file",
        ),
    ]
    return tuple(facts)


def drive_facts(cell: Cell) -> list[Fact]:
    """Play, friction and loop gains: of the cell file, and of the robot's class where that has none."""
    tables, given = cell.tables.robot, cell.class_drives
    names: tuple[tuple[str, Sequence[PlayTable | ServoTable]], ...] = (
        ("Play and friction of the axes", tables.play),
        ("Loop gains of the drives", tables.servo),
    )
    if given is None:
        return [Fact(name, *_known(rows)) for name, rows in names]
    facts = []
    typical = ((given.play_axes, given.lost), (given.servo_axes, given.loops))
    for (name, rows), (axes, values) in zip(names, typical, strict=True):
        texts = [
            f"{key} {', '.join(f'{one:.3g}' for one in value)} (nine of ten within a factor of {factor:g})"
            for key, (value, factor) in values.items()
        ]
        facts += [Fact(name, *_known(rows))] if rows or not axes else []
        facts += [Fact(f"{name}, {axis_names(axes)}", "; ".join(texts), _DRIVES)] if axes else []
    return facts


def _known(rows: Sequence[PlayTable | ServoTable]) -> tuple[str, str]:
    """Axes that something is known about, and where from."""
    if not rows:
        return "not known, left out", "cell file"
    axes = ", ".join(f"A{row.axis}" for row in sorted(rows, key=lambda row: row.axis))
    return f"known for {axes}", "; ".join(dict.fromkeys(row.source or "cell file" for row in rows))


_SWEEP: Final = 61
_POINTS: Final = 800


def drawing(plan: Plan, cell: Cell, places: ExternalPlaces | None = None) -> CellDrawing:
    """The cell in the posture of the largest predicted deflection.

    Args:
        places: Of external axes that move along it: blank and path are drawn where they are in that posture.
    """
    size = np.linalg.norm(plan.deflection_part[:, :3], axis=1)
    worst = int(np.argmax(size))
    axes = ", ".join(f"{angle / DEG:.0f}" for angle in cell.chain.axes.shown(plan.q[worst]))
    caption = (
        f"Posture of the largest predicted deflection, {size[worst] / MM:.2f} mm, in line {int(plan.line[worst])}: "
        f"axes at {axes} deg."
    )
    feed = plan.path.p_part_tcp[plan.path.kind == FEED]
    step = max(1, -(-len(feed) // _POINTS))
    T_base_part = forward(cell.controller_chain, plan.q[worst]) if cell.holds_part else cell.T_base_part
    if places is not None:
        T_base_part = places.Ts_base_part(plan.path.place[worst : worst + 1])[0]
    return _drawn(cell, plan.q[worst], caption, T_base_part, feed[::step])


def drawing_at_part(cell: Cell) -> CellDrawing:
    """Return the cell in its posture at the first corner of the blank."""
    q = posture_at_blank(cell)
    axes = ", ".join(f"{angle / DEG:.0f}" for angle in cell.chain.axes.shown(q))
    T_base_part = forward(cell.controller_chain, q) if cell.holds_part else cell.T_base_part
    return _drawn(cell, q, f"Posture at the blank: axes at {axes} deg.", T_base_part, np.empty((0, 3)))


def _drawn(cell: Cell, q: Float, caption: str, T_base_part: Float, path_part: Float) -> CellDrawing:
    links, flange = links_of(cell.chain, q)
    return CellDrawing(
        robot=robot_name(cell),
        caption=caption,
        links_m=links,
        flange=flange,
        reach_m=reach(cell.chain),
        blank_m=pose.transform(T_base_part, corners(cell.stock())),
        path_m=pose.transform(T_base_part, path_part),
    )


def links_of(chain: ElasticChain, q: Float) -> tuple[Float, int]:
    """Points (k, 3) m, base frame, from the robot's foot to the tool tip at q (6,) rad, and which is the flange."""
    Ts = frames(chain, q)
    last = chain.flange_segment
    T_base_flange = (Ts[last] if last >= 0 else np.eye(4)) @ chain.T_segment_flange
    points = [np.zeros(3), *Ts[: last + 1, :3, 3], T_base_flange[:3, 3], *Ts[last + 1 :, :3, 3]]
    return np.array([*points, forward(chain, q)[:3, 3]]), last + 2


def reach(chain: ElasticChain) -> tuple[Float, ...]:
    """Border of what the limits of axes 2 and 3 let the flange reach with axis 1 at zero and the wrist stretched.

    Returns:
        Curves (m, 2) m, one per side of the rectangle of limits and one with the elbow stretched, if its limits allow
        that: horizontal distance from axis 1, positive where the arm reaches farthest, and height.
    """
    (low2, high2), (low3, high3) = chain.joint_limits_rad[1], chain.joint_limits_rad[2]
    second, third = np.linspace(low2, high2, _SWEEP), np.linspace(low3, high3, _SWEEP)
    sides = [
        (second, np.full(_SWEEP, low3)),
        (np.full(_SWEEP, high2), third),
        (second[::-1], np.full(_SWEEP, high3)),
        (np.full(_SWEEP, low2), third[::-1]),
    ]
    elbow = np.zeros((40 * _SWEEP, 6))
    elbow[:, 2] = np.linspace(low3, high3, len(elbow))
    T = frames(chain, elbow)
    axis2 = int(np.flatnonzero(np.asarray(chain.joint) == 1)[0])
    from_axis2 = np.linalg.norm(_flange(chain, T) - T[:, axis2, :3, 3], axis=1)
    stretched = int(np.argmax(from_axis2))
    if 0 < stretched < len(elbow) - 1:
        sides.append((second, np.full(_SWEEP, elbow[stretched, 2])))
    points = []
    for a2, a3 in sides:
        q = np.zeros((_SWEEP, 6))
        q[:, 1], q[:, 2] = a2, a3
        points.append(_flange(chain, frames(chain, q)))
    every = np.concatenate(points)
    farthest = every[int(np.argmax(np.hypot(every[:, 0], every[:, 1]))), :2]
    along = farthest / max(float(np.linalg.norm(farthest)), 1e-9)
    return tuple(np.stack([p[:, :2] @ along, p[:, 2]], axis=1) for p in points)


def _flange(chain: ElasticChain, Ts: Float) -> Float:
    """Flange (n, 3) m from the frames of all segments."""
    out: Float = (Ts[:, chain.flange_segment] @ chain.T_segment_flange)[:, :3, 3]
    return out


def corners(stock: HeightMap) -> Float:
    """Corners (8, 3) m of the box around a blank, part frame."""
    half = 0.5 * stock.cell_m
    x, y = stock.x_m(), stock.y_m()
    low = np.array([x[0] - half, y[0] - half, stock.bottom_m])
    high = np.array([x[-1] + half, y[-1] + half, float(stock.z.max())])
    pick = np.array([[i >> k & 1 for k in range(3)] for i in range(8)])
    out: Float = np.where(pick == 1, high, low)
    return out
