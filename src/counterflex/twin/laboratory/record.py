"""Records over time at the simulated cell: command, controller and tracker, each late in its own way.

The commanded motion runs through the drives and the elastic robot with friction and play. Each channel shows what was
a dead time before, behind its low-pass, with stamps of its own clock that jitter, and loses samples. In a correction
run the motion goes through the sensor interface (dead time and lag) before it reaches the drives.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress
from counterflex.core.units import MS, UM, URAD
from counterflex.twin.laboratory.instrument_clocks import ClockedChannel, InstrumentClocks, OtherClock
from counterflex.twin.laboratory.laboratory import Measured, Measurement, Order
from counterflex.twin.plant.drives import first_order_lag
from counterflex.twin.plant.plant import STEP_S, Plant
from counterflex.twin.truth.truth import Truth

ENCODER_RAD: Final = 1.0 * URAD
SHOWN_M: Final = 1.0 * UM
"""Last digit of the position that the controller shows, and its standard deviation."""
_THROUGH: Final = ("program", "correction")


@Measurement
def measure(order: Order) -> Measured:
    """Run a commanded motion and record it.

    ``order``: Request: ``time_s`` (even steps), ``x_m y_m z_m`` commanded tip in the base, ``q1_rad`` ... ``q6_rad``
    what the controller makes of it; each (n,). Settings: ``through``: ``program`` (default) or ``correction``.

    Returns:
        ``time_s``, ``p_base_tcp`` (what the controller shows), ``q_motor``, ``time_tracker_s``, ``p_tracker_target``,
        and the command: ``p_base_command`` and ``q_command``, or ``d_correction``.
        Row k of channels of different clocks is not the same instant.

    Raises:
        InputError: A column is missing, uneven steps, or an unknown setting.
    """
    truth, laboratory, _request, settings, progress = order
    t = order.columns("time_s")[:, 0]
    tip, q = order.columns("x_m", "y_m", "z_m"), order.q
    through = str(settings.get("through", _THROUGH[0]))
    if through not in _THROUGH:
        raise InputError("through", value=through, limit=", ".join(_THROUGH))
    if len(t) < 100 or np.ptp(np.diff(t)) > 1e-6:
        raise InputError("a record needs even steps of time", value=len(t), limit=">= 100 rows")
    cycle = float((t[-1] - t[0]) / (len(t) - 1))
    times = InstrumentClocks.of(laboratory)
    reference = q
    if through == "correction":
        reference = q[0] + _late(t, q - q[0], t, times.correction)
    fine, p, motor = _run(truth, t, reference, progress)
    noise = laboratory.noise(f"record.{through}")
    rigid = np.array([truth.rigid_tcp(row)[:3, 3] for row in motor[:: max(1, round(cycle / (fine[1] - fine[0])))]])
    rows = fine[:: max(1, round(cycle / (fine[1] - fine[0])))]
    shown = _late(rows, rigid, t, times.feedback)
    shown = np.round((shown + SHOWN_M * 0.3 * noise.standard_normal(shown.shape)) / SHOWN_M) * SHOWN_M
    seen_at, tracker_stamps = _stamps(t, cycle, times.tracker, times.tracker_clock, noise)
    target = _late(fine, p, seen_at, times.tracker)
    T = laboratory.T_base_tracker
    in_tracker = (target - T[:3, 3]) @ T[:3, :3] + laboratory.tracker_m * noise.standard_normal(target.shape)
    n = min(len(t), len(tracker_stamps))
    channels = {
        "time_s": t[:n, None],
        "q_motor": _late(fine, motor, t, ClockedChannel(0.0, 0.0, 0.0, 0.0))[:n]
        + ENCODER_RAD * noise.standard_normal((n, 6)),
        "p_base_tcp": shown[:n],
        "time_tracker_s": tracker_stamps[:n, None],
        "p_tracker_target": in_tracker[:n],
    }
    sigma: dict[str, float | Float] = {
        "q_motor": ENCODER_RAD,
        "p_base_tcp": SHOWN_M,
        "p_tracker_target": laboratory.tracker_m,
    }
    if through == "correction":
        channels["d_correction"] = (tip - tip[0])[:n]
        sigma["d_correction"] = 0.1 * UM
    else:
        channels |= {"p_base_command": tip[:n], "q_command": q[:n]}
        sigma |= {"p_base_command": 0.1 * UM, "q_command": 0.1 * URAD}
    return Measured(channels, sigma, np.zeros(n, dtype=np.int64), {})


def _run(truth: Truth, t: Float, q: Float, progress: Progress) -> tuple[Float, Float, Float]:
    """Times, tool tips and motor angles of the run, every millisecond."""
    plant = Plant(truth)
    command = scipy.interpolate.CubicSpline(t, q)
    count = round((t[-1] - t[0]) / STEP_S)
    at = t[0] + STEP_S * np.arange(count + 1)
    q_ref, qd_ref = np.ascontiguousarray(command(at)), np.ascontiguousarray(command(at, 1))
    every = max(1, round(1.0 * MS / STEP_S))
    plant.reset(q_ref[0], None, qd_ref[0])
    free = np.zeros(6)
    p, motor = np.empty((count // every + 1, 3)), np.empty((count // every + 1, 6))
    for k in range(count + 1):
        if k % every == 0:
            p[k // every], motor[k // every] = plant.p_base_tcp, plant.q_motor()
        if k < count:
            plant.step(q_ref[k], qd_ref[k], free)
        if k % 2000 == 0:
            plant.check()
            progress(0.95 * k / count, "recording on the twin")
    return at[: len(p) * every : every], p, motor


def _late(time_s: Float, values: Float, at: Float, channel: ClockedChannel) -> Float:
    """A signal (n, k) at instants (m,) behind the channel's low-pass and dead time."""
    out = values
    if channel.lag_s > 0.0:
        out = first_order_lag(values, float(time_s[1] - time_s[0]), 1.0 / channel.lag_s)
    moved = np.clip(at - channel.dead_time_s, time_s[0], time_s[-1])
    result: Float = scipy.interpolate.CubicSpline(time_s, out)(moved)
    return result


def _stamps(
    t: Float, cycle: float, channel: ClockedChannel, clock: OtherClock, noise: np.random.Generator
) -> tuple[Float, Float]:
    """Instants of the samples that arrive, and the stamps they carry."""
    start = t[0] + cycle * noise.random()
    instants = np.arange(start, t[-1], cycle)
    stamps = clock.stamps(instants + channel.jitter_s * noise.standard_normal(len(instants)))
    arrived = noise.random(len(instants)) >= channel.lost
    return instants[arrived], stamps[arrived]
