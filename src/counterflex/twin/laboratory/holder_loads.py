"""Loading the instrumented spindle holder against a dynamometer: kind ``holder_loads``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, MM_PER_MIN, N_PER_MM2, RPM
from counterflex.twin.laboratory.laboratory import Measured, Measurement, Order
from counterflex.twin.plant.strain_holder import FORCE_N, NOISE, SAMPLE_S, InstrumentedHolder, instrumented_holder

# A milling cut under the instrumented holder: tooth-resolved force, and what the bridges show of it.
# Cutter with helix in steps along its axis, circular tooth path ``h = f_z sin(phi)``, Kienzle's law; at entry and exit
# the width of cut grows and falls over the length of contact. The cut of Denkena2015 section 4: aluminium,
# 12000 rpm, 3000 mm/min, 1 mm wide, 10 mm deep, three flutes, 12 mm.

_FINE = 20
_SLICES = 20


@dataclass(frozen=True)
class SideCut:
    """Milling along an edge, down-milling; x feed, y normal (positive away from the material), z axis."""

    diameter_m: float = 12.0 * MM  # of the cutter
    flutes: int = 3
    helix_rad: float = 30.0 * DEG
    speed_rad_s: float = 12000.0 * RPM
    feed_m_s: float = 3000.0 * MM_PER_MIN
    width_m: float = 1.0 * MM  # radial depth of cut
    depth_m: float = 10.0 * MM  # axial depth of cut
    kc_pa: float = 780.0 * N_PER_MM2  # specific cutting force at 1 mm
    exponent: float = 0.25  # of the thickness
    radial_share: float = 0.35  # radial by tangential force
    axial_share: float = 0.25  # axial by tangential force
    runout_m: float = 5e-6  # offset of the tool's axis

    def force(self, time_s: Float, engaged: Float) -> Float:
        """Force on the tool (m, 3) N at times (m,) s with a share (m,) 0..1 of the width engaged."""
        R = 0.5 * self.diameter_m
        f_z = self.feed_m_s * 2.0 * np.pi / self.speed_rad_s / self.flutes
        z = (np.arange(_SLICES) + 0.5) / _SLICES * self.depth_m
        dz = self.depth_m / _SLICES
        out = np.zeros((len(time_s), 3))
        start = np.pi - np.arccos(np.clip(1.0 - self.width_m * engaged / R, -1.0, 1.0))
        for tooth in range(self.flutes):
            phase = 2.0 * np.pi * tooth / self.flutes
            phi = self.speed_rad_s * time_s[:, None] - phase - np.tan(self.helix_rad) * z / R
            phi = np.mod(phi, 2.0 * np.pi)
            cuts = (phi > start[:, None]) & (phi < np.pi) & (engaged[:, None] > 0.0)
            h = np.maximum(f_z * np.sin(phi) + self.runout_m * np.sin(phase), 0.0) * cuts
            tangential = self.kc_pa * (1e-3) ** self.exponent * h ** (1.0 - self.exponent) * dz
            radial = self.radial_share * tangential
            out[:, 0] += np.sum(-tangential * np.cos(phi) - radial * np.sin(phi), axis=1)
            out[:, 1] += np.sum(tangential * np.sin(phi) - radial * np.cos(phi), axis=1)
            out[:, 2] += np.sum(self.axial_share * tangential, axis=1)
        return out


def cut_record(
    holder: InstrumentedHolder,
    p_holder_tcp: Float,
    rng: np.random.Generator,
    *,
    cut: SideCut | None = None,
    length_s: float = 2.0,
    warmer_k: float = 0.5,
) -> tuple[Float, Float, Float, Float]:
    """Force and bridges along a cut with air before and after it.

    Args:
        holder: As it truly is; its x, y, z are feed, normal and tool axis here.
        p_holder_tcp: (3,) m tool tip.
        cut: What is cut; None is that of Denkena2015.
        length_s: Of the record; the tool is engaged from a quarter to three quarters of it.
        warmer_k: How much the holder warms up over the record.

    Returns:
        Times (m,) s, mean force of each sample (m, 3) N, strain (m, n), temperature (m,) deg C.
    """
    cut = cut if cut is not None else SideCut()
    count = round(length_s / SAMPLE_S)
    fine = SAMPLE_S * (np.arange(count * _FINE) + 0.5) / _FINE
    ramp_s = np.sqrt(cut.width_m * (cut.diameter_m - cut.width_m)) / cut.feed_m_s
    engaged = np.clip((fine - 0.25 * length_s) / ramp_s, 0.0, 1.0) * np.clip(
        (0.75 * length_s - fine) / ramp_s, 0.0, 1.0
    )
    force: Float = cut.force(fine, engaged).reshape(count, _FINE, 3).mean(axis=1)
    time_s = np.asarray(SAMPLE_S * (np.arange(count) + 1.0), dtype=np.float64)
    warm = np.asarray(22.0 + warmer_k * time_s / length_s, dtype=np.float64)
    return time_s, force, holder.record(force, p_holder_tcp, warm, rng), warm


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
