"""Unknowns of a cell file, by the error in mm that each leaves uncorrected, and what to measure first.

Each unknown is drawn from what is known of it and leaves a displacement of the tool; all others stay as the file has
them. At rest and linear: what it is in motion, a plan says.

- Stiffness: of an axis without any, the whole deflection by the class of the robot; where the class is assumed, what is
  beyond its median; of an element of the file, ``STATED`` of its deflection, or its standard deviation once
  identified.
- Stiffness of a spindle, bracket or holder that states no compliance: the whole deflection by published ones
  (:mod:`counterflex.robot.model.class_prior`). It is planned as rigid.
- Cutting force: :data:`HANDBOOK` of the deflection, and up to :data:`WORN` more of a worn tool, until constants are
  identified.
- Play and friction: of an axis without ``[[robot.play]]``, what a robot of the class loses beyond what the plan takes
  (:mod:`counterflex.robot.model.class_prior`). Of an identified axis, the standard deviations of dead band and slip
  angles, or of both together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.app.cut_points import CutPoints
from counterflex.app.lowest_mode import STATED, estimate, identified_sigma
from counterflex.app.unknown_stiffness import ROBOTS, Expected, drawn_deflections, expected, why_no_prior
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.next_command import next_command
from counterflex.core.units import MM, MRAD
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.class_stiffness import axis_names, prior_of
from counterflex.robot.elasticity import play
from counterflex.robot.elasticity.chain import axis_deflections, frames, jacobian
from counterflex.robot.elasticity.compliance import shares
from counterflex.robot.model import class_prior as end_effector_prior
from counterflex.robot.model.class_prior import HALF_BAND_RAD, arm_over_axis, drawn_play

HANDBOOK: Final = 0.3
"""Relative standard deviation of handbook constants: published sets of one alloy differ by up to 1.8."""
WORN: Final = 0.3
"""A worn tool needs up to 30 % more than handbook constants say (Victor and Kienzle's ``K_ver`` = 1.3)."""
IDENTIFIED: Final = 0.05
"""The same of identified constants."""
_DRAWS: Final = ROBOTS
_FORCE_SEED: Final = 1001
_PLAY_SEED: Final = 1002
_WEAR_SEED: Final = 1003
_END_EFFECTOR_SEED: Final = 1004
_SIGN_SEED: Final = 1005  # Of the random numbers; elements have that of their number
_PULLS: Final = "stiffness --propose 30"
_PLAY: Final = "play --propose 24"
_TYPICAL: Final = "typical of the class"
_COUNT: Final = 20  # Measurements that are proposed where a recipe asks for no number of its own


@dataclass(frozen=True)
class CellUnknown:
    """Something that is not known of a cell."""

    name: str
    known_from: str  # What is known of it, and from where
    cost: Expected | None  # What it leaves uncorrected; None where that cannot be said at rest
    recipe: str  # What to measure: ``identify`` with these words, the recipe first


@dataclass(frozen=True, eq=False)
class DisplacementSource:
    """An unknown as it displaces the tool."""

    name: str
    known_from: str
    displacements: Float | None  # (draws, n, 3) m, base axes, left uncorrected; None where that cannot be said at rest
    recipe: str

    @classmethod
    def of_force(cls, cell: Cell, points: CutPoints) -> DisplacementSource:
        """Constants of the material: they scale every deflection."""
        known = any(entry.recipe in ("cutting", "first_cut") for entry in cell.tables.identified)
        whole = shares(cell.chain, points.q, points.w_tcp_base)[..., :3].sum(axis=1, keepdims=True)
        if cell.unknown_axes and not why_no_prior(cell):
            k = prior_of(cell.nominal_robot, cell.tables.robot).median_nm_per_rad[list(cell.unknown_axes)]
            per_stiffness = axis_deflections(cell.chain, points.q, points.w_tcp_base, cell.unknown_axes)
            whole += np.sum(per_stiffness / k[:, None], axis=1, keepdims=True)
        if known:
            d = _scaled(whole, np.array([IDENTIFIED]), _FORCE_SEED)
            return cls("cutting force", "identified", d, "cutting --propose 12")
        wear = np.random.default_rng(_WEAR_SEED).uniform(0.0, WORN, (_DRAWS, 1, 1))
        d = (1.0 + wear) * _scaled(whole, np.array([HANDBOOK]), _FORCE_SEED) + wear * whole[:, 0]
        return cls("cutting force", "handbook constants", d, "cutting --propose 12")


def unknowns(cell: Cell, points: CutPoints) -> list[CellUnknown]:
    """Everything that is not known of a cell, the most expensive first."""
    listed = [
        CellUnknown(
            one.name,
            one.known_from,
            None if one.displacements is None else expected(points.sizes(one.displacements), points.of),
            one.recipe,
        )
        for one in sources(cell, points)
    ]
    return sorted(listed, key=lambda one: -1.0 if one.cost is None else one.cost.median_m, reverse=True)


def sources(cell: Cell, points: CutPoints, *, planned: bool = True) -> list[DisplacementSource]:
    """Everything that is not known of a cell, each drawn by itself; ``planned``: a plan takes what the class loses."""
    listed = [*_axes_of_the_class(cell, points), *_unknown_end_effector(cell, points), *_stated(cell, points)]
    listed.append(DisplacementSource.of_force(cell, points))
    listed += [*_play(cell, points, planned=planned), *_identified_play(cell, points)]
    given = cell.class_drives
    if cell.chain.servo is None:
        known = _TYPICAL if given is not None and given.servo_axes else "nothing; shown by what moves"
        listed.append(DisplacementSource("loop gains of the drives", known, None, "servo"))
    if cell.tables.dynamics.mode_hz is None:
        known = "nothing; it needs the stiffness"
        if not cell.unknown_axes or cell.class_stiffness is not None:
            known = estimate(cell, points.q[len(points.q) // 2]).text
        listed.append(DisplacementSource("lowest mode", known, None, "servo"))
    if not np.any(cell.chain.mass[: cell.chain.flange_segment + 1]):
        listed.append(DisplacementSource("masses of the arm", "nothing; matters in larger parts", None, "kinematics"))
    return listed


def first_measurement(ranked: list[CellUnknown]) -> tuple[str, Expected] | None:
    """The recipe whose unknowns leave the most, root of the sum of squares of the medians, and what they leave."""
    total: dict[str, list[Expected]] = {}
    for one in ranked:
        if one.cost is not None:
            total.setdefault(one.recipe, []).append(one.cost)
    if not total:
        return None
    joined = {
        recipe: Expected(
            median_m=float(np.linalg.norm([one.median_m for one in costs])),
            low_m=float(np.linalg.norm([one.low_m for one in costs])),
            high_m=float(np.linalg.norm([one.high_m for one in costs])),
            of=costs[0].of,
        )
        for recipe, costs in total.items()
    }
    recipe = max(joined, key=lambda name: joined[name].median_m)
    return recipe, joined[recipe]


def shown(ranked: list[CellUnknown], points: CutPoints, cell_file: str) -> dict[str, Any]:
    """Plain values for ``cell check``: rows and what to measure first, mm."""
    first = first_measurement(ranked)
    return {
        "where": points.of,
        "rows": [
            {
                "unknown": one.name,
                "known_from": one.known_from,
                "leaves_mm": None if one.cost is None else round(one.cost.median_m / MM, 3),
                "of_90_percent_mm": None
                if one.cost is None
                else [round(one.cost.low_m / MM, 3), round(one.cost.high_m / MM, 3)],
                "measure": f"identify {one.recipe.split()[0]}",
            }
            for one in ranked
        ],
        "measure_first": None
        if first is None
        else {
            "command": _proposing(first[0], cell_file),
            "removes_mm": round(first[1].median_m / MM, 3),
            "up_to_mm": round(first[1].high_m / MM, 3),
        },
    }


def _proposing(recipe: str, cell_file: str) -> str:
    """Return the command that proposes the measurements of a recipe, ``name`` or ``name --propose N``."""
    name, _, count = recipe.partition(" --propose ")
    return next_command(f"identify {name}", propose=count or _COUNT, cell=cell_file, out="proposal")


def _axes_of_the_class(cell: Cell, points: CutPoints) -> list[DisplacementSource]:
    """Axes that have no stiffness, or that of their class."""
    given = cell.class_stiffness
    axes = cell.unknown_axes if given is None else given.axes
    if not axes:
        return []
    name = f"stiffness of {axis_names(axes)}"
    per_stiffness = axis_deflections(cell.chain, points.q, points.w_tcp_base, axes)
    if given is not None:
        d = drawn_deflections(given.prior, per_stiffness, axes)
        d -= np.einsum("a,nad->nd", 1.0 / given.prior.median_nm_per_rad[list(axes)], per_stiffness)
        return [DisplacementSource(name, "class prior: its median", d, _PULLS)]
    try:
        prior = prior_of(cell.nominal_robot, cell.tables.robot)
    except InputError:
        return [DisplacementSource(name, "nothing, and no class", None, _PULLS)]
    d = drawn_deflections(prior, per_stiffness, axes)
    return [DisplacementSource(name, "nothing; by the class prior", d, _PULLS)]


def _unknown_end_effector(cell: Cell, points: CutPoints) -> list[DisplacementSource]:
    """Bodies beyond the flange that state no compliance: one spring at the first of them."""
    bodies = cell.bodies_of_unknown_stiffness
    if not bodies:
        return []
    chain = cell.chain
    Ts = frames(chain, points.q)
    p_tip = (Ts[:, -1] @ chain.T_last_tcp)[:, :3, 3]
    p_spring = Ts[:, chain.names.index(bodies[0]), :3, 3]
    arm = p_tip - p_spring
    moment = points.w_tcp_base[:, 3:] + np.cross(arm, points.w_tcp_base[:, :3])
    d = np.cross(moment, arm)[None] / end_effector_prior.drawn(_DRAWS, _END_EFFECTOR_SEED)[:, None, None]
    name = f"stiffness of the end effector ({', '.join(bodies)})"
    return [DisplacementSource(name, "nothing; by two published ones", d, _PULLS)]


def _stated(cell: Cell, points: CutPoints) -> list[DisplacementSource]:
    """Elastic elements of the file: those of the robot and those beyond its flange, by where they come from."""
    chain, parts = cell.chain, shares(cell.chain, points.q, points.w_tcp_base)[..., :3]
    relative = identified_sigma(cell)
    assumed = set() if cell.class_stiffness is None else {f"axis{axis + 1}" for axis in cell.class_stiffness.axes}
    groups: dict[tuple[str, str], list[int]] = {}
    for i, name in enumerate(chain.names):
        if np.any(parts[:, i] != 0.0) and name not in assumed:
            where = "robot" if i <= chain.flange_segment else "end effector"
            groups.setdefault((where, "identified" if name in relative else "stated, not measured"), []).append(i)
    out = []
    for (where, known), elements in groups.items():
        sigma = np.array([relative.get(chain.names[i], STATED) for i in elements])
        d = _scaled(parts[:, elements], sigma, elements[0])
        out.append(DisplacementSource(f"stiffness of the {where}", known, d, _PULLS))
    return out


def _play(cell: Cell, points: CutPoints, *, planned: bool) -> list[DisplacementSource]:
    """Lost motion of axes without a row of ``[[robot.play]]``; ``planned``: beyond what a plan takes of the class."""
    known = cell.chain.play or (None,) * 6
    axes = [axis for axis in range(6) if known[axis] is None]
    if not axes:
        return []
    given, columns = cell.class_drives, jacobian(cell.chain, points.q)[..., :3, axes]
    held, (band, friction) = _held_by_friction(cell), drawn_play(_DRAWS, _PLAY_SEED)
    taken = 0.0 if given is None or not planned else HALF_BAND_RAD + held
    sign = np.random.default_rng(_SIGN_SEED).choice([-1.0, 1.0], (_DRAWS, 6))  # of the motion before the point
    d = np.einsum("nda,ra->rnd", columns, (sign * (band + friction * held - taken))[:, axes])
    name = f"play and friction of {axis_names(tuple(axes))}"
    return [DisplacementSource(name, "nothing; that of other robots" if given is None else _TYPICAL, d, _PLAY)]


def _identified_play(cell: Cell, points: CutPoints) -> list[DisplacementSource]:
    """Standard deviations that the identification of play leaves: half of the dead band, slip angles, or their sum."""
    twist = np.zeros(6)
    for entry in cell.tables.identified:
        variance: dict[int, float] = {}
        for one in entry.values if entry.recipe in ("play", "first_cut") else ():
            axis, _, what = one.name.partition(".")
            if what in ("half_band", "lost") or what.startswith("slip"):
                number = int(axis.removeprefix("axis")) - 1
                variance[number] = variance.get(number, 0.0) + (one.sigma * MRAD) ** 2
        for number, value in variance.items():
            twist[number] = np.sqrt(value)
    axes = np.flatnonzero(twist)
    if len(axes) == 0:
        return []
    columns = jacobian(cell.chain, points.q)[..., :3, axes]
    z = np.random.default_rng(_PLAY_SEED).standard_normal((_DRAWS, len(axes)))
    d = np.einsum("nda,ra->rnd", columns, twist[axes] * z)
    return [DisplacementSource(f"play and friction of {axis_names(tuple(axes.tolist()))}", "identified", d, _PLAY)]


def _held_by_friction(cell: Cell) -> Float:
    """(6,) rad, twist of the axes that the friction of their class holds; axes without stiffness have its median."""
    chain = cell.planning_chain
    soft = chain.compliance[chain.torsion, 5]
    if (axes := list(cell.unknown_axes)) and cell.class_drives is not None and cell.class_stiffness is None:
        soft[axes] = (arm_over_axis() / prior_of(cell.nominal_robot, cell.tables.robot).median_nm_per_rad)[axes]
    out: Float = play.arrays(chain)[1].sum(axis=1) * soft
    return out


def _scaled(parts: Float, sigma: Float, seed: int) -> Float:
    """Displacements (draws, n, 3) by elements (n, k, 3) whose compliances are off by relative ``sigma`` (k,)."""
    z = np.random.default_rng(seed).standard_normal((_DRAWS, len(sigma)))
    off = np.exp(np.sqrt(np.log1p(sigma**2)) * z) - 1.0
    out: Float = np.einsum("rk,nkd->rnd", off, parts)
    return out
