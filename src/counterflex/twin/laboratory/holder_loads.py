"""Loading the instrumented spindle holder against a dynamometer: kind ``holder_loads``."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.twin.laboratory.laboratory import Measured, Measurement, Order
from counterflex.twin.plant.strain_holder import FORCE_N, NOISE, SAMPLE_S, instrumented_holder

COLUMNS = ("fx_n", "fy_n", "fz_n", "px_m", "py_m", "pz_m")
STEP_S, RAMP, HOLD = 0.05, 10, 10
START_C, WARM_C, WARM_S = 21.0, 1.5, 900.0


@Measurement
def measure(order: Order) -> Measured:
    """Press to each load and back to none, and read bridges and dynamometer after each.

    ``order``: Request: ``fx_n`` ... ``fz_n`` force on the tool and ``px_m`` ... ``pz_m`` where, in holder axes.
    Settings: ``gauges``: five numbers for each bridge, x, y, z m, angle rad, notch factor.

    Returns:
        Channels ``strain``, ``f_tcp_holder``, ``p_holder_load``, ``temperature_c``, ``time_s``: two rows for each
        load, the second without load.

    Raises:
        InputError: A column or the gauges are missing.
    """
    _truth, laboratory, _request, settings, progress = order
    if "gauges" not in settings:
        raise InputError("the request does not say where the gauges sit", limit="settings: gauges")
    loads = order.columns(*COLUMNS)
    holder = instrumented_holder(np.asarray(settings["gauges"], dtype=np.float64).reshape(-1, 5), laboratory.seed)
    rng = laboratory.noise("holder_loads")
    force, place = _history(loads)
    time_s = STEP_S * np.arange(len(force))
    warm = START_C + WARM_C * (1.0 - np.exp(-time_s / WARM_S))
    strain = holder.record(force, place, warm, rng, STEP_S)
    ends = np.arange(RAMP + HOLD, len(force) + 1, RAMP + HOLD)
    rows = [slice(int(e) - HOLD, int(e)) for e in ends]
    n = len(rows)
    progress(1.0, f"{len(loads)} loads")
    group: Int = np.repeat(np.arange(len(loads), dtype=np.int64), 2)
    return Measured(
        channels={
            "strain": np.array([strain[r].mean(axis=0) for r in rows]),
            "f_tcp_holder": np.array([force[r][-1] for r in rows]) + FORCE_N * rng.standard_normal((n, 3)),
            "p_holder_load": np.array([place[r][-1] for r in rows]),
            "temperature_c": np.array([warm[r].mean() for r in rows])[:, None] + 0.05 * rng.standard_normal((n, 1)),
            "time_s": np.array([time_s[r].mean() for r in rows])[:, None],
        },
        sigma={
            "strain": NOISE * np.sqrt(SAMPLE_S / STEP_S / HOLD),
            "f_tcp_holder": FORCE_N,
            "p_holder_load": 0.5e-3,
            "temperature_c": 0.05,
        },
        group=group,
        settings={"gauges": [float(v) for v in np.ravel(np.asarray(settings["gauges"], dtype=np.float64))]},
    )


def _history(loads: Float) -> tuple[Float, Float]:
    """Loads and their places over time: up within RAMP steps, HOLD steps, down and hold, for each wanted load."""
    up = np.concatenate([np.arange(1, RAMP + 1) / RAMP, np.ones(HOLD)])
    share = np.concatenate([up, 1.0 - up])
    force = np.concatenate([share[:, None] * row[:3] for row in loads])
    place = np.repeat(loads[:, 3:], len(share), axis=0)
    return force, place
