"""Natural frequencies, damping and mode shapes of a cell in a posture."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.lowest_mode import posture_at_blank, swinging_chain
from counterflex.app.unknown_stiffness import require_stiffness
from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG
from counterflex.files.cell.cell import Cell
from counterflex.plan.elastic_motion import coordinates, matrices
from counterflex.plan.elastic_motion_kernel import AXES
from counterflex.plan.lowest_mode import damping_of, mode_of
from counterflex.plan.modes import ModelSpread, UndampedModes, driven_modes, kinetic_shares, modes
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.signals.preview import Mode

DIRECTIONS: Final = ("tx", "ty", "tz", "rx", "ry", "rz")
_NAMED: Final = 3
"""Elements and bodies that are named of each mode."""
_WORTH: Final = 0.05
"""Share of the energy from which one is named."""
COUNT: Final = 6


@dataclass(frozen=True, eq=False)
class PostureModes:
    """The modes of a cell in a posture."""

    cell: Cell
    q: Float  # (6,) rad
    chain: ElasticChain
    free: UndampedModes
    tip: Float  # (6, m) motion of the tool's tip in each mode, m and rad, base axes
    intervals: Float  # (n, 2) Hz, what nine of ten cells have, the lowest mode first
    damping_s: float  # beta of the damping beta K
    spread: ModelSpread  # How well masses and stiffnesses are known
    driven: tuple[Mode, ...]  # Modes with the drives on, where loop gains are known
    summary: dict[str, Any]


def modes_in(cell: Cell, q: Float | None = None, *, count: int = COUNT) -> PostureModes:
    """The modes of a cell.

    Args:
        q: (6,) rad; None is at the blank, or all axes at zero where the cell has no part.

    Raises:
        InputError: Axes of unknown stiffness, or nothing that yields.
    """
    require_stiffness(cell)
    if not np.any(cell.chain.compliance > 0.0):
        raise InputError(
            "nothing of the cell yields, so nothing swings",
            where=str(cell.path),
            hint="Give compliances in [[robot.elastic]] or of the end effector",
        )
    begin = time.perf_counter()
    angles = posture_at_blank(cell) if q is None else as_float("q", q, (6,))
    swinging = swinging_chain(cell, angles)
    chain = swinging.chain
    M, stiffness, J, _ = matrices(chain, angles)
    free = modes(M, stiffness)
    kinetic = kinetic_shares(chain, angles, free.shapes)
    intervals = swinging.frequency_intervals(angles)
    beta = damping_of(chain, mode_of(chain, angles, cell.tables.dynamics.mode))
    servo = chain.servo or (None,) * AXES
    driven = tuple(driven_modes(M, stiffness, beta, servo)) if chain.servo is not None else ()
    tip = J @ free.shapes
    rows = [_row(k, chain, free, kinetic, tip, intervals, beta) for k in range(min(count, len(free.omega_rad_s)))]
    summary = {
        "cell": cell.label,
        "robot": cell.robot.name,
        "joints_deg": np.round(chain.axes.shown(angles) / DEG, 4).tolist(),
        "modes": rows,
        "with_drives": [
            {"hz": round(mode.hz, 3), "damping_ratio": round(mode.damping_ratio, 4)} for mode in driven[:count]
        ],
        "masses": swinging.origin,
        "drives": "rigid" if chain.servo is None else "loop gains of the cell file",
        "damping": "assumed" if cell.tables.dynamics.mode is None and chain.servo is None else "cell file",
        "seconds": round(time.perf_counter() - begin, 3),
        "counterflex": __version__,
    }
    return PostureModes(cell, angles, chain, free, tip, intervals, beta, swinging.spread, driven, summary)


def _row(
    k: int, chain: ElasticChain, free: UndampedModes, kinetic: Float, tip: Float, intervals: Float, beta_s: float
) -> dict[str, Any]:
    """A mode in plain values."""
    omega = float(free.omega_rad_s[k])
    hz = omega / (2.0 * math.pi)
    segment, direction, _ = coordinates(chain)
    springs = [f"{chain.names[s]} {DIRECTIONS[d]}" for s, d in zip(segment.tolist(), direction.tolist(), strict=True)]
    moved = tip[:3, k]
    size = float(np.linalg.norm(moved))
    whole = float(np.sum(tip[:3] ** 2))
    towards = moved / size if size > 0.0 else np.zeros(3)
    return {
        "hz": round(hz, 3),
        "of_90_percent_hz": np.round(intervals[k], 3).tolist(),
        "damping_ratio": round(0.5 * beta_s * omega, 4),
        "tip_direction": np.round(towards * (1.0 if towards[np.argmax(np.abs(towards))] >= 0.0 else -1.0), 3).tolist(),
        "share_of_compliance": round(size**2 / whole, 4) if whole > 0.0 else 0.0,
        "springs": _largest(free.strain[:, k], springs),
        "bodies": _largest(kinetic[:, k], list(chain.names)),
    }


def _largest(share: Float, names: list[str]) -> list[dict[str, Any]]:
    order = np.argsort(-share)[:_NAMED]
    return [{"name": names[i], "share": round(float(share[i]), 3)} for i in order.tolist() if share[i] >= _WORTH]
