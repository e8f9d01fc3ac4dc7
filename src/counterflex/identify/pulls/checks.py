"""Check pulls: work that no passive arm does, signs, units, swapped columns, other axes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.identify.data import alternative_readings
from counterflex.identify.data.data_checks import check_finite, check_moves
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.pulls.pulls import Pulls
from counterflex.robot.elasticity.chain import ElasticChain, flange, forward

MOST_NEGATIVE: Final = 0.3
"""Share of rows with negative work above which the data are refused."""
ALL_BUT: Final = 0.8
"""Share above which a sign is wrong, and no other reading needs to be tried."""
_SURE: Final = 3.0  # standard deviations of the work
_LEAST_FORCE_N: Final = 1.0
_MOVES_RAD: Final = 1e-3
_FEWEST: Final = 3
_NOTHING_PERCENT: Final = 100.0
_OF_SENSORS: Final = (
    "check the description of the measuring frame: which readings are s_unloaded and s_loaded, their unit and signs, "
    "position and direction of each of [[sensors]], sensor_axes"
)


def check_plain(data: Dataset) -> None:
    """Refuse gaps, poses that never change, zero loads. Raises InputError: names channel and line."""
    check_finite(data, [name for name in data.channels if name != "time_s"])
    if len(data) < _FEWEST:
        raise InputError(
            "too few pulls", where=data.where or data.name, value=f"{len(data)} rows", limit=f"at least {_FEWEST}"
        )
    check_moves(data, "q", _MOVES_RAD)
    for name in ("w_tcp_base", "f_tcp_base"):
        if data.has(name):
            size = np.linalg.norm(data.values(name)[:, :3], axis=1)
            moment = np.linalg.norm(data.values(name)[:, 3:], axis=1) if data.values(name).shape[1] > 3 else 0.0 * size
            idle = (size < _LEAST_FORCE_N) & (moment < _LEAST_FORCE_N)
            if np.any(idle):
                raise InputError(
                    f"{int(np.sum(idle))} rows have no load",
                    where=data.place(int(np.flatnonzero(idle)[0])),
                    value=f"{float(np.min(size)):.3g} N",
                    limit=f">= {_LEAST_FORCE_N:g} N",
                    hint="Remove the unloaded rows, or check the unit of the load",
                )


def work(chain: ElasticChain, pulls: Pulls, R_base_tracker: Float | None) -> tuple[Float, Float]:
    """Work of each load on the displacement it caused, ``w . d``, and its standard deviation, N m.

    Where three components were measured beside the tool tip the force is taken at the measured point; the turn of the
    tool is then left out.

    ``R_base_tracker``: (3, 3), where the displacement is in tracker axes.
    """
    d, sigma = pulls.d, pulls.d_sigma
    if pulls.in_tracker and R_base_tracker is not None:
        d = np.concatenate([d[:, i : i + 3] @ R_base_tracker.T for i in range(0, d.shape[1], 3)], axis=1)
        sigma = np.repeat(np.max(sigma.reshape(len(d), -1, 3), axis=2), 3, axis=1)
    f, m = pulls.w_tcp_base[:, :3], pulls.w_tcp_base[:, 3:]
    out = np.sum(f * d[:, :3], axis=1)
    variance = np.sum((f * sigma[:, :3]) ** 2, axis=1)
    if d.shape[1] == 6:
        lever = (forward(chain, pulls.q)[:, :3, :3] @ pulls.p_tcp_measured[:, None])[..., 0]
        # Work does not depend on the point, but force and moment must be of one and the same.
        turning = m - np.cross(lever, f)  # about the measured point
        out = out + np.sum(turning * d[:, 3:], axis=1)
        variance = variance + np.sum((turning * sigma[:, 3:]) ** 2, axis=1)
    return out, np.sqrt(variance)


def impossible(chain: ElasticChain, pulls: Pulls, R_base_tracker: Float | None) -> Bool:
    """(n,) rows whose load did clearly negative work: the tool moved against it, which no passive arm does."""
    value, sigma = work(chain, pulls, R_base_tracker)
    out: Bool = value < -_SURE * sigma
    return out


def check_work(
    chain: ElasticChain, pulls: Pulls, R_base_tracker: Float | None, *, as_stated: bool, most: float = MOST_NEGATIVE
) -> tuple[str, ...]:
    """Name rows with negative work; refuse data that are mostly so.

    ``R_base_tracker``: (3, 3), where the displacement is in tracker axes. ``as_stated``: The user insists: the finding
    is a remark. ``most``: Share of the rows above which the data are refused. Raises InputError: more rows than
    ``most``, and the user does not insist.
    """
    bad = impossible(chain, pulls, R_base_tracker)
    count, n = int(np.sum(bad)), len(pulls)
    if count == 0:
        return ()
    rows = np.flatnonzero(bad)
    lines = ", ".join(str(int(pulls.line[i])) for i in rows[:8]) + (" ..." if count > 8 else "")
    if count > most * n and not as_stated:
        first = int(rows[0])
        raise InputError(
            f"{count} of {n} displacements point against their loads: negative work, which no passive arm does",
            where=f"{pulls.where or pulls.name}: line {int(pulls.line[first])}",
            value=f"load {np.round(pulls.w_tcp_base[first, :3], 1).tolist()} N, "
            f"displacement {np.round(pulls.d[first, :3] / MM, 3).tolist()} mm",
            hint="Displacement is loaded minus unloaded, the load is what acts on the tool: check both signs "
            '(acts_on = "surroundings" under the load\'s channel turns it round), the order of columns and the axes',
        )
    return (
        f"{pulls.name}: {count} of {n} rows have a displacement against their load (negative work, which no passive "
        f"arm does): lines {lines}",
    )


def check_worth(unexplained_percent: float, where: str) -> None:
    """Refuse a result that predicts unseen deflections worse than no deflection at all would.

    However large the priors, springs that were found have to explain something; where they do not, deflections are
    smaller than anything the priors allow (mm stated as m), or have nothing to do with the loads.

    ``unexplained_percent``: ``sum |measured - predicted| / sum |measured|`` of held-out pulls, in %. Raises InputError:
    100 % or more.
    """
    if not unexplained_percent < _NOTHING_PERCENT:
        raise InputError(
            "unseen deflections are predicted worse than by no deflection at all",
            where=where,
            value=f"{unexplained_percent:.4g} % not explained",
            limit=f"below {_NOTHING_PERCENT:.0f} %",
            hint="Check the units of displacement and load and which rows belong together; if the data are right, add "
            "--set as_stated=true",
        )


def readings(chain: ElasticChain, data: Dataset) -> tuple[alternative_readings.AlternativeReading, ...]:
    """Other readings of a dataset of pulls: signs, units, columns, rows, axes of the flange or the tool."""
    load = "w_tcp_base" if data.has("w_tcp_base") else "f_tcp_base"
    moved = "d_tcp_base" if data.has("d_tcp_base") else "d_tracker_target"
    out: list[alternative_readings.AlternativeReading] = []
    for channel in (load, moved):
        out += [
            *alternative_readings.sign_mistakes(data, channel),
            *alternative_readings.unit_mistakes(data, channel),
            *alternative_readings.swapped_columns(data, channel),
        ]
    out += [
        *alternative_readings.unit_mistakes(data, "q"),
        *alternative_readings.sign_mistakes(data, "q"),
        *_in_tool_axes(chain, load),
    ]
    if moved == "d_tcp_base":
        out += _in_tool_axes(chain, moved)
        if data.values(moved).shape[1] == 3:
            out += alternative_readings.left_handed([moved], free_frame=False)
    out += alternative_readings.row_mistakes(moved)
    if data.sensors is not None:
        # The displacement is found from the sensors: what is wrong about it is wrong about them.
        out = [replace(r, channel="s_loaded", remedy=_OF_SENSORS) if r.channel == moved else r for r in out]
    return tuple(out)


def _rotation(frame: Callable[[ElasticChain, Float], Float], chain: ElasticChain, data: Dataset) -> Float:
    return frame(chain, data.values("q"))[:, :3, :3]


def _in_tool_axes(chain: ElasticChain, channel: str) -> Sequence[alternative_readings.AlternativeReading]:
    remedy = f"turn '{channel}' into base axes with the pose of the robot, row by row"
    return [
        alternative_readings.other_axes(
            channel,
            partial(_rotation, frame, chain),
            f"'{channel}' is in the axes of the {name} instead of the base",
            remedy,
        )
        for frame, name in ((forward, "tool"), (flange, "flange or sensor"))
    ]
