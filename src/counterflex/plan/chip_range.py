"""Chips outside the range of the cutting constants: how much less is known of the force there, and of the correction.

Inside its range a force law stands on data. Outside there are two readings: the law goes on as it is, or the specific
force stays that of the edge of the range, ``F(h) = F(h_edge) h / h_edge``. Planning uses the first; the distance
between the two is the uncertainty. For Kienzle's law it is ``|1 - (h / h_edge)^m|`` of the force: 17 % at half the
smallest chip with m = 0.27. A ramp, a helix or a return move leaves the range for a short stretch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import ModelError
from counterflex.core.similar import told_apart
from counterflex.core.units import MM
from counterflex.cutting.coefficients import ForceLaw
from counterflex.plan.plan import impulse_share

UNCERTAIN_SHARE: Final = 0.5
"""Largest uncertain share of the force impulse of a program. Constants of handbooks differ by 0.2 to 0.3 from one
another, and many are tabulated from 0.1 mm on, five times what a robot mills; where more than half is uncertain, the
correction may be worse than none, so the program is refused unless the cell file allows it."""


@dataclass(frozen=True)
class Outside:
    """Rows of a program whose chips are outside the range of the constants."""

    rows: Bool  # (n,) True there
    row_share: Float  # (n,) distance between both readings of the force, as a share of the force; 0 inside the range
    force_share: float  # share of the force impulse that comes from these rows
    uncertain_share: float  # share of the force impulse that is uncertain


def uncertainty(law: ForceLaw, chip_m: Float) -> Float:
    """Return the distance between both readings of the force outside the range, as a share of the force.

    Args:
        law: Force law with its range.
        chip_m: (n,) mean chip thickness; 0 out of the cut.
    """
    edge = np.clip(chip_m, law.h_min_m, law.h_max_m)
    outside = (chip_m > 0.0) & (edge != chip_m)
    h, edge = np.where(outside, chip_m, law.h_max_m), np.where(outside, edge, law.h_max_m)
    as_law = law.edge_force(h)
    as_edge = law.edge_force(edge) * (h / edge)[:, None]
    out: Float = np.linalg.norm(as_law - as_edge, axis=1) / np.linalg.norm(as_law, axis=1)
    return np.where(outside, out, 0.0)


def outside(law: ForceLaw, chip_m: Float, contact: Bool, w_tcp_part: Float, time_s: Float) -> Outside:
    """Return the rows outside the range of the constants and what they carry.

    Args:
        law: Force law with its range.
        chip_m: (n,) mean chip thickness.
        contact: (n,) rows that cut.
        w_tcp_part: (n, 6) N, N m.
        time_s: (n,) s.
    """
    share = np.where(contact, uncertainty(law, chip_m), 0.0)
    rows = contact & ((chip_m < law.h_min_m) | (chip_m > law.h_max_m))
    w = np.where(contact[:, None], w_tcp_part, 0.0)
    whole = np.linalg.norm(w[:, :3], axis=1) * np.diff(time_s, prepend=time_s[:1])
    total = float(whole.sum())
    uncertain = float((whole * share).sum()) / total if total > 0.0 else 0.0
    return Outside(rows, share, impulse_share(w, time_s, rows), uncertain)


def check(estimate: Outside, law: ForceLaw, chip_m: Float, row: int, where: str) -> None:
    """Refuse a program whose force is uncertain as a whole.

    Args:
        estimate: Of :func:`outside`.
        law: Force law with its range.
        chip_m: (n,) mean chip thickness.
        row: The row that is named.

    Raises:
        ModelError: The uncertain share is above :data:`UNCERTAIN_SHARE`.
    """
    if estimate.uncertain_share <= UNCERTAIN_SHARE:
        return
    value, limit = told_apart(100.0 * estimate.uncertain_share, 100.0 * UNCERTAIN_SHARE)
    raise ModelError(
        "the force comes from chips outside the range of the cutting constants and is uncertain",
        where=where,
        value=f"mean chip {chip_m[row] / MM:.3g} mm, {value} % of the force of the program uncertain",
        limit=f"{law.h_min_m / MM:g} to {law.h_max_m / MM:g} mm, or at most {limit} % uncertain",
        hint="Use constants measured at this feed, change the feed, or set material.allow_extrapolation = true",
        share=estimate.force_share,
    )
