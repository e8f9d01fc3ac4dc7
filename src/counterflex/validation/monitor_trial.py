"""Trials of process monitoring on made-up force signals, tooth by tooth at 1 kHz: how often it sees, how often it errs.

A slot along x is cut with D16, three teeth, 13 000 rpm, 25 mm/s. The signal is not the model: each tooth has a radius
of its own (runout), the spindle runs slower than told, force and timing are off by other amounts in every trial, the
stock is uneven, the arm swings at the entry, and only a part of what turns with the spindle reaches the sensor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.records import records
from counterflex.core.units import MM, UM
from counterflex.geometry import rotation
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.monitoring.monitor import Monitor
from counterflex.runtime.monitoring.settings import MonitorSettings
from counterflex.runtime.state.given import GIVEN
from counterflex.runtime.state.result import RESULT
from counterflex.runtime.state.supervisor import State

PERIOD_S: Final = 4e-3
SAMPLE_S: Final = 1e-3
FEED_M_S: Final = 25.0 * MM
TURN_PER_S: Final = 13_000.0 / 60.0
TEETH: Final = 3
EXPONENT: Final = 0.75
AIR_M: Final = 30.0 * MM
RAMP_M: Final = 8.0 * MM
REACHING: Final = 0.3
"""Share of the alternating force that gets through the spindle's inertia to the sensor."""
MEAN_N: Final = np.array([-120.0, 300.0, -80.0])
"""Mean force of the slot, part axes: against the feed, to the left, down into the stock."""


@dataclass(frozen=True)
class Incident:
    """What goes wrong in a trial.

    Attributes:
        event: What it is; None is a sound cut.
        at_m: Where it begins, from the start of the cut.
        size: Of it: N of an overload by its mean force, teeth that break, N of chatter or of slow chatter, rise of the
            ratio per metre; m without material.
    """

    event: Event | None = None
    at_m: float = 60.0 * MM
    size: float = 0.0


def trial_plan(cut_m: float) -> LoopPlan:
    """Plan of the slot: air, a ramp as the tool enters, the slot, a ramp out, air; a row every quarter millimetre."""
    x = np.arange(0.0, cut_m + 2.0 * AIR_M, 0.25 * MM)
    w = np.zeros((len(x), 6))
    w[:, :3] = MEAN_N * _engaged(x, cut_m)[:, None]
    cutting = (_engaged(x, cut_m) > 0.0).astype(np.float64)
    n = len(x)
    return LoopPlan(
        np.stack([x, np.zeros(n), np.zeros(n)], axis=1),
        x / FEED_M_S,
        w,
        cutting,
        np.zeros((n, 6)),
        turn_per_s=np.full(n, TURN_PER_S),
        tool=np.ones(n, dtype=np.int64),
        teeth=np.full(n, TEETH, dtype=np.int64),
    )


def _engaged(x: Float, cut_m: float) -> Float:
    """Share of the full engagement 0..1 at a place."""
    rise = np.clip((x - AIR_M) / RAMP_M, 0.0, 1.0)
    fall = np.clip((AIR_M + cut_m - x) / RAMP_M, 0.0, 1.0)
    out: Float = np.sqrt(np.minimum(rise, fall))
    return out


def signal(cut_m: float, incident: Incident, seed: int) -> Float:
    """Samples of the force sensor, (k, 3) N at 1 kHz, part axes, without the tool's weight.

    Args:
        cut_m: Length of the slot.
        incident: What goes wrong.
        seed: Of everything that is not known.
    """
    rng = np.random.default_rng((17, seed))
    k = int((cut_m + 2.0 * AIR_M) / FEED_M_S / SAMPLE_S)
    t = np.arange(k, dtype=np.float64) * SAMPLE_S
    x: Float = FEED_M_S * (t - float(rng.uniform(-0.03, 0.03))) + rng.uniform(-0.3, 0.3) * MM
    engaged: Float = _engaged(x, cut_m) * rng.normal(1.0, 0.08)
    lag = int(0.4 / SAMPLE_S)
    wave = np.convolve(rng.standard_normal(k + lag), np.hanning(lag) / np.sqrt(np.sum(np.hanning(lag) ** 2)))[
        lag : lag + k
    ]
    engaged = engaged * (1.0 + 0.015 * wave)
    place = x - AIR_M - incident.at_m
    after_tooth = place > 0.0
    teeth: Int = np.ones((k, TEETH), dtype=np.int64)
    if incident.event == Event.MISSING_CUT:
        engaged = np.where(after_tooth & (place < incident.size), 0.0, engaged)
    elif incident.event == Event.OVERLOAD:
        engaged = np.where(after_tooth, engaged * (1.0 + incident.size * np.clip(place / RAMP_M, 0.0, 1.0)), engaged)
    elif incident.event == Event.WEAR:
        engaged = engaged * (1.0 + incident.size * np.maximum(0.0, place))
    elif incident.event == Event.BREAKAGE:
        teeth[after_tooth, : round(incident.size)] = 0
    angle: Float = 2.0 * np.pi * TURN_PER_S * (1.0 - rng.uniform(0.0, 0.008)) * t + rng.uniform(0.0, 2.0 * np.pi)
    force = _teeth(angle, teeth, engaged, 6.0 * UM * rng.standard_normal(TEETH))
    swing = np.zeros(k)
    begin = int(np.argmax(engaged > 0.0))
    since = t[begin:] - t[begin]
    swing[begin:] = 0.15 * np.exp(-0.05 * 2.0 * np.pi * 8.0 * since) * np.sin(2.0 * np.pi * 8.0 * since)
    force += swing[:, None] * np.linalg.norm(MEAN_N) * np.array([0.3, 1.0, 0.2])
    if incident.event == Event.CHATTER:
        grown = incident.size * np.where(after_tooth, 1.0 - np.exp(-np.maximum(0.0, place) / (5.0 * MM)), 0.0)
        line = 2.0 * np.pi * rng.uniform(70.0, 480.0) * t
        force += (grown * (engaged > 0.0))[:, None] * np.sin(line)[:, None] * np.array([0.4, 0.9, 0.1])
    if incident.event == Event.LOW_CHATTER:
        grown = incident.size * np.where(after_tooth, 1.0 - np.exp(-np.maximum(0.0, place) / (5.0 * MM)), 0.0)
        arm = 2.0 * np.pi * rng.uniform(4.0, 36.0) * t
        force += (grown * (engaged > 0.0))[:, None] * np.sin(arm)[:, None] * np.array([0.4, 0.9, 0.1])
    return force + rng.standard_normal((k, 3))


def _teeth(angle: Float, teeth: Int, engaged: Float, runout: Float) -> Float:
    """Force of the teeth in the slot; of what turns with the spindle only REACHING gets to the sensor."""
    chip = 38.5 * UM
    total, mean = np.zeros((len(angle), 3)), np.zeros((len(angle), 3))
    fine: Float = (np.arange(180, dtype=np.float64) + 0.5) * np.pi / 180.0
    for j in range(TEETH):
        run, open_ = np.ones(len(angle)), np.ones(len(angle), dtype=np.bool_)
        for back in range(1, TEETH):  # it takes the chip of every missing tooth right before it
            open_ = open_ & (teeth[:, (j - back) % TEETH] == 0)
            run = run + open_
        off = runout[j] - runout[(j - 1) % TEETH]
        phi = np.mod(angle - 2.0 * np.pi * j / TEETH, 2.0 * np.pi)
        total += _pulse(phi, np.asarray(run * chip), off, chip) * teeth[:, j : j + 1]
        for load in np.unique(run):
            mean += (
                (run == load)[:, None] * teeth[:, j : j + 1] * _pulse(fine, load * chip, off, chip).sum(axis=0) / 360.0
            )
    whole = TEETH * _pulse(fine, np.full(180, chip), 0.0, chip).sum(axis=0) / 360.0
    scale = np.abs(MEAN_N) / np.abs(whole)
    sign = np.sign(MEAN_N) * np.sign(whole)
    out: Float = (mean + REACHING * (total - mean)) * scale * sign * engaged[:, None]
    return out


def _pulse(phi: Float, feed: Float | float, off: float, chip: float) -> Float:
    """Force of one tooth at an angle, in units of the full chip's: along, across, axial."""
    h = np.maximum(0.0, np.where(phi < np.pi, feed * np.sin(phi) + off, 0.0)) / chip
    size = h**EXPONENT
    return np.stack([-size * (0.4 * np.sin(phi) + np.cos(phi) * 0.0 + 0.1), size * np.sin(phi), -0.3 * size], axis=-1)


@dataclass(frozen=True)
class Outcome:
    """How a trial went.

    Attributes:
        events: First place of each event from the start of the cut, m.
        trend_per_m: Change of the ratio per metre at the end.
        trend_sigma_per_m: Its standard deviation.
    """

    events: dict[Event, float]
    trend_per_m: float
    trend_sigma_per_m: float


def run_trial(settings: MonitorSettings, cut_m: float, incident: Incident, seed: int) -> Outcome:
    """One trial.

    Args:
        settings: Of the monitor.
        cut_m: Length of the slot.
        incident: What goes wrong.
        seed: Of everything that is not known.
    """
    plan = trial_plan(cut_m)
    path = plan.packed()
    monitor = Monitor(settings, None, path, plan.watched(settings), 5.0 * MM, 2.0 * MM)
    samples = np.ascontiguousarray(np.pad(signal(cut_m, incident, seed), ((0, 0), (0, 3))))
    per_cycle = round(PERIOD_S / SAMPLE_S)
    given, result = records(GIVEN)[0], records(RESULT)[0]
    given.nominal[:9] = rotation.about_x(np.pi).reshape(-1)
    given.elapsed = 1
    result.state = State.ACTIVE
    place: Float = np.zeros(2)
    step = 0.25 * MM
    detected: dict[Event, float] = {}
    for cycle in range(len(samples) // per_cycle):
        x = FEED_M_S * cycle * PERIOD_S
        row = min(int(x / step), len(path) - 2)
        place[:] = row, min(1.0, x / step - row)
        mine = samples[cycle * per_cycle : (cycle + 1) * per_cycle]
        monitor.take(mine, per_cycle, cycle * per_cycle, place)
        given.wrench[:3] = mine[:, :3].mean(axis=0)
        monitor.after(given, result, place)
        new = int(monitor.outcome.new)
        if new:
            for event in Event:
                if new >> event & 1:
                    detected.setdefault(event, x - AIR_M)
    return Outcome(detected, float(monitor.results.trend), float(monitor.results.trend_sigma))
