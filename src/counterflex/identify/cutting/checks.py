"""Check test cuts against their manifest: signs, axes, units of force, feed, speed and depth.

The means of the cuts are fitted by a quick fit that trusts no force better than 5 %, as stated and as otherwise read;
see :mod:`counterflex.identify.data.manifest_checks`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.units import MINUTE, MM, RPM
from counterflex.cutting.arc_force import TermForce
from counterflex.identify.cutting.cut_rows import FORCES, cuts_of, has_air, rows_per_turn
from counterflex.identify.cutting.force_forms import FORMS
from counterflex.identify.cutting.record import contact, zero
from counterflex.identify.cutting.residuals import SlotResiduals
from counterflex.identify.cutting.steady_cuts import SteadyCuts, pieces_of
from counterflex.identify.data.alternative_readings import (
    AlternativeReading,
    sign_mistakes,
    swapped_columns,
    unit_mistakes,
)
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.manifest_checks import Misfit, check_reading
from counterflex.identify.data.model import CellModel
from counterflex.robot.elasticity.chain import forward

ROUGH: Final = 0.05
"""Relative standard deviation of a mean force in the quick fit."""
FACTORS: Final = (0.3, 0.4, 0.5)
"""Standard deviation of the logarithm of what is known of the specific forces c, r, a, whatever the material."""
_NONE: Final = 1e-3
_TURNED: Final = 0.05  # rad; axes closer than this make no other reading


def check(cell: CellModel, data: Dataset, tool: int | None, *, as_stated: bool = False) -> tuple[str, ...]:
    """Refuse test cuts that another reading explains far better.

    ``cell``: The cell, whose force law is what is known. ``data``: Kind ``slots``. ``tool``: Use cuts of this tool
    only; None where there is one. Raises InputError: another reading is suspected; the message names it and what to
    change.
    """
    means = cut_means(data)
    return check_reading(
        means,
        readings(cell, means),
        lambda sample: _misfit(cell, pieces_of(cell, [sample], tool=tool)),
        as_stated=as_stated,
    )


def _misfit(cell: CellModel, steady: SteadyCuts) -> Misfit:
    """Specific forces c, r, a by linear least squares, none below zero times its sign so far; exponents as known."""
    pieces = steady.pieces
    basis = np.zeros((len(pieces), 3, 3))
    cuts = SlotResiduals(pieces, steady.cutter, FORMS[0], MM, cell.force_law, len(steady.blanks)).stated()
    for p, *k in cell.force_law.terms():
        basis += TermForce.of(cuts, float(p)).value * np.array(k)
    weighted, measured = basis / pieces.sigma[:, :, None], pieces.force / pieces.sigma
    seen = np.any(basis != 0.0, axis=(0, 1))
    factor = np.ones(3)
    factor[seen], _ = scipy.optimize.nnls(weighted.reshape(-1, 3)[:, seen], measured.reshape(-1))
    rows = np.sqrt(np.mean((measured - weighted @ factor) ** 2, axis=1))
    return Misfit(rows, np.log(np.maximum(factor, _NONE)) / np.array(FACTORS), 3.0 * len(pieces) - 3.0)


def cut_means(data: Dataset) -> Dataset:
    """One row per cut and set of conditions: the median force of the middle half of its contact, zero taken out.

    Unlike the settled pieces it needs no distances, so that it stands even where the feed is wrong by a factor.
    A dataset without ``time_s`` is returned with the standard deviations of the quick fit.
    """
    name = next((n for n in FORCES if data.has(n)), FORCES[0])
    force = data.values(name)
    if not data.has("time_s"):
        return _trusted(data, name)
    time, depth = data.values("time_s")[:, 0], data.values("depth")[:, 0]
    keys = [n for n in ("feed_rate", "spindle_speed", "width", "feed_direction", "tool", "blank") if data.has(n)]
    state = np.column_stack([data.values(n) for n in keys])
    rows: list[int] = []
    values: list[Float] = []
    deep: list[float] = []
    for _, mine in cuts_of(data):
        touching = contact(
            force[mine, :3],
            depth[mine],
            rows_per_turn(time[mine], data.values("spindle_speed")[mine, 0]),
            steady=bool(np.all(state[mine] == state[mine[0]])),
            air=has_air(data),
        )
        shown = force[mine] - zero(force[mine], time[mine], touching).value
        change = np.any(np.diff(state[mine], axis=0) != 0.0, axis=1) | (np.diff(touching.astype(np.int8)) != 0)
        bounds = [0, *(np.flatnonzero(change) + 1).tolist(), len(mine)]
        for first, last in itertools.pairwise(bounds):
            quarter = (last - first) // 4
            inner = slice(first + quarter, max(last - quarter, first + quarter + 1))
            if not touching[first] or last - first < 4:
                continue
            rows.append(int(mine[(inner.start + inner.stop) // 2]))
            values.append(np.median(shown[inner], axis=0))
            deep.append(float(np.mean(depth[mine][inner])))
    keep = np.zeros(len(data), dtype=np.bool_)
    keep[rows] = True
    order = np.argsort(rows, kind="stable")
    out = data.rows(keep)
    channels = {key: c for key, c in out.channels.items() if key != "time_s"}
    channels[name] = replace(channels[name], values=np.array(values).reshape(-1, force.shape[1])[order])
    channels["depth"] = replace(channels["depth"], values=np.array(deep)[order][:, None])
    return _trusted(replace(out, channels=channels), name)


def _trusted(data: Dataset, name: str) -> Dataset:
    channel = data.channel(name)
    size = np.linalg.norm(channel.values[:, :3], axis=1)
    sigma = np.tile((ROUGH * size + 1e-9)[:, None], (1, channel.values.shape[1]))
    return replace(data, channels={**data.channels, name: replace(channel, sigma=sigma)})


def readings(cell: CellModel, data: Dataset) -> tuple[AlternativeReading, ...]:
    """Other readings of test cuts."""
    name = next((n for n in FORCES if data.has(n)), FORCES[0])
    out = [
        *sign_mistakes(data, name),
        *swapped_columns(data, name),
        *unit_mistakes(data, name),
        *unit_mistakes(data, "depth"),
        *_factor("feed_rate", MINUTE, "mm/s", "mm/min"),
        *_factor("spindle_speed", 1.0 / RPM, "rad/s", "rpm"),
        *_axes(cell, data, name),
    ]
    return tuple(out)


def _factor(channel: str, factor: float, large: str, small: str) -> tuple[AlternativeReading, ...]:
    """A channel whose unit ``large`` was taken for ``small`` (``factor`` times less), or the other way round."""
    return tuple(
        AlternativeReading(
            channel,
            f"'{channel}' is {factor:.3g} times too {size} ({right} read as {wrong})",
            f'write unit = "{right}" under [channels.{channel}]',
            partial(_scaled, channel, by),
        )
        for size, right, wrong, by in (("small", large, small, factor), ("large", small, large, 1.0 / factor))
    )


def _scaled(channel: str, by: float, data: Dataset) -> Dataset:
    return _with(data, channel, data.channel(channel).values * by)


def _with(data: Dataset, channel: str, values: Float) -> Dataset:
    return replace(data, channels={**data.channels, channel: replace(data.channel(channel), values=values)})


def _axes(cell: CellModel, data: Dataset, name: str) -> tuple[AlternativeReading, ...]:
    """Forces in other axes than stated: those of the part, the base, or the tool."""
    R_base_part = cell.T_base_part[:3, :3]
    in_part = name == "f_tcp_part"
    stated, other, to = ("part", "base", R_base_part.T) if in_part else ("base", "part", R_base_part)
    out = []
    if np.arccos(np.clip(0.5 * (np.trace(R_base_part) - 1.0), -1.0, 1.0)) > _TURNED:
        out.append(_turned(name, stated, other, lambda sample: np.tile(to, (len(sample), 1, 1))))
    if data.has("q"):
        out.append(_turned(name, stated, "tool", partial(_from_tool, cell, in_part)))
    return tuple(out)


def _from_tool(cell: CellModel, in_part: bool, sample: Dataset) -> Float:
    R_base_tcp: Float = forward(cell.chain, sample.values("q"))[:, :3, :3]
    return cell.T_base_part[:3, :3].T @ R_base_tcp if in_part else R_base_tcp


def _turned(name: str, stated: str, other: str, rotations: Callable[[Dataset], Float]) -> AlternativeReading:
    return AlternativeReading(
        name,
        f"'{name}' is written in the axes of the {other}, stated as those of the {stated}",
        f"turn it into the axes of the {stated}, or map the channel that means the axes of the {other}",
        lambda data: _with(data, name, _rotated(data.channel(name).values, rotations(data))),
    )


def _rotated(values: Float, R: Float) -> Float:
    """Vectors (n, 3 k) turned by R (n, 3, 3)."""
    out = np.array(values)
    for begin in range(0, out.shape[1], 3):
        out[:, begin : begin + 3] = np.einsum("nij,nj->ni", R, out[:, begin : begin + 3])
    return out
