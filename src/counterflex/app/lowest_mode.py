"""Lowest mode of a cell in a posture, where it comes from and how well it is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.app.unknown_stiffness import corner_of_blank
from counterflex.core.arrays import Float
from counterflex.files.cell.cell import Cell
from counterflex.plan.elastic_motion import coordinates, matrices
from counterflex.plan.lowest_mode import assumed_masses, can_move, mode_of
from counterflex.plan.modes import ModelSpread, drawn_frequencies, modes
from counterflex.plan.plan import Plan
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.signals.preview import Mode

STATED: Final = 0.35
"""Relative standard deviation of a compliance that nobody measured on this cell. Two published sets of one robot
(``stiffness_data/published.toml``: KR 300, KR 500, R-2000iC) differ by 41, 62 and 45 % from axis to axis, standard
deviation of the logarithm; one set has that over the square root of two."""
MASS: Final = 0.15
"""The same of a stated mass: of a body with its hoses and cables, and with its centre of gravity."""
COMMON: Final = 0.2
"""Share of the variance that the compliances of one robot have in common: that of the axes of published sets, see
:mod:`counterflex.robot.model.class_prior`."""
ASSUMED_MASS: Final = 0.5
"""The same of masses by the length of the arm: a factor of two either way holds 90 %, with what the posture adds."""


@dataclass(frozen=True)
class Estimate:
    """A lowest mode."""

    mode: Mode
    low_hz: float  # 5 % of robots with these masses and springs swing more slowly; nan where it was measured
    high_hz: float  # 5 % swing faster
    origin: str  # Where it comes from

    @property
    def between(self) -> str:
        """The interval in brackets behind a space; empty where there is none."""
        return "" if math.isnan(self.low_hz) else f" ({self.low_hz:.1f} to {self.high_hz:.1f})"

    @property
    def text(self) -> str:
        """In one line."""
        return f"{self.mode.hz:.1f} Hz{self.between}, {self.origin}"

    @property
    def shown(self) -> dict[str, Any]:
        """Plain values for a summary."""
        within = None if math.isnan(self.low_hz) else [round(self.low_hz, 2), round(self.high_hz, 2)]
        ratio = round(self.mode.damping_ratio, 3)
        return {"hz": round(self.mode.hz, 2), "of_90_percent_hz": within, "damping_ratio": ratio, "from": self.origin}


def lowest_mode(cell: Cell, q: Float | None = None) -> Mode:
    """Return what a tap test of the cell file says, otherwise what masses and springs do.

    Args:
        q: (6,) rad; None is at the highest corner of the blank, or all axes at zero where there is no part.
    """
    measured = cell.tables.dynamics.mode
    if measured is not None:
        return measured
    return mode_of(cell.chain, posture_at_blank(cell) if q is None else q, None)


def estimate(cell: Cell, q: Float, *, planned: bool = False) -> Estimate:
    """The lowest mode in a posture, with the spread of what it is computed from.

    :data:`STATED` of a compliance, or what its identification left, :data:`COMMON` of that in common;
    :data:`MASS` of a mass, each by itself. That unknown drives yield, which makes every mode slower, is not in it.

    Args:
        q: (6,) rad.
        planned: With the drives that planning takes, those of the robot's class where the file has none; otherwise
            such drives stand still.
    """
    chain, measured = cell.planning_chain if planned else cell.chain, cell.tables.dynamics.mode
    mode = mode_of(chain, q, measured)
    moves = can_move(chain)
    if measured is not None and not moves:
        return Estimate(mode, math.nan, math.nan, "measured")
    if not np.any(chain.compliance > 0.0):
        return Estimate(mode, math.nan, math.nan, "nothing yields: any")
    swinging = swinging_chain(cell, q)
    low, high = swinging.frequency_intervals(q)[0] * mode.hz / undamped_hz(swinging.chain, q)
    return Estimate(mode, float(low), float(high), swinging.origin)


def undamped_hz(chain: ElasticChain, q: Float) -> float:
    """Lowest natural frequency with rigid drives, Hz."""
    return float(modes(*matrices(chain, q)[:2]).omega_rad_s[0]) / (2.0 * math.pi)


@dataclass(frozen=True, eq=False)
class SwingingChain:
    """A chain that can be moved, with how well its constants are known."""

    chain: ElasticChain  # With assumed masses where an axis has none behind it
    spread: ModelSpread
    origin: str  # Where its modes come from

    def frequency_intervals(self, q: Float) -> Float:
        """(n, 2) Hz, what nine of ten robots have: the lowest mode first."""
        drawn = drawn_frequencies(self.chain, q, self.spread)
        out: Float = np.quantile(drawn, [0.05, 0.95], axis=0, method="inverted_cdf").T / (2.0 * math.pi)
        return out


def swinging_chain(cell: Cell, q: Float) -> SwingingChain:
    """The chain of a cell as modes need it; q (6,) rad is any posture."""
    chain, moves = cell.chain, can_move(cell.chain)
    filled = chain if moves else assumed_masses(chain, q)
    relative = assumed_sigma(cell) | identified_sigma(cell)
    soft = np.array([relative.get(filled.names[i], STATED) for i in coordinates(filled)[0]])
    spread = ModelSpread(soft, np.where(chain.mass > 0.0, MASS, ASSUMED_MASS), COMMON)
    return SwingingChain(filled, spread, "from masses and stiffness" if moves else "from stiffness and assumed masses")


def at_largest_force(cell: Cell, plan: Plan) -> Estimate:
    """The estimate in the posture that planning took: where the predicted force is largest."""
    return estimate(cell, plan.q[int(np.argmax(np.linalg.norm(plan.w_tcp_part[:, :3], axis=1)))], planned=True)


def posture_at_blank(cell: Cell) -> Float:
    """(6,) rad at the first corner of the blank's top, or all zero where the cell is not one that mills."""
    if cell.tables.part is None or cell.tables.part.stock is None:
        return np.zeros(6)
    return corner_of_blank(cell)


def assumed_sigma(cell: Cell) -> dict[str, float]:
    """Spread of the axes whose stiffness is that of the robot's class."""
    given = cell.class_stiffness
    if given is None:
        return {}
    return {f"axis{axis + 1}": float(given.prior.log_sigma[axis]) for axis in given.axes}


def identified_sigma(cell: Cell) -> dict[str, float]:
    """Relative standard deviation of identified segments: of their directions together, the larger of both kinds.

    By the ratio of one direction, a stiff one that the data hardly show would make the whole segment unknown.
    """
    kinds: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for one in (value for entry in cell.tables.identified for value in entry.values):
        segment, _, direction = one.name.partition(".")
        if direction in ("tx", "ty", "tz", "rx", "ry", "rz") and one.value > 0.0 and one.seen != "prior":
            kinds.setdefault((segment, direction[0]), []).append((one.value, one.sigma))
    out: dict[str, float] = {}
    for (segment, _), ones in kinds.items():
        share = math.hypot(*(sigma for _, sigma in ones)) / sum(value for value, _ in ones)
        out[segment] = max(out.get(segment, 0.0), share)
    return out
