"""Trials of process monitoring on made-up force signals, tooth by tooth: how often it sees, how often it errs.

A straight cut at any speed, number of teeth and engagement. The signal is not the model: each tooth has a radius
(run-out) and a pitch angle, the spindle runs slower than commanded and yields at the entry, force and timing are off by
other amounts in every trial, the stock is uneven, the arm swings at the entry, only a part of the alternating force
reaches the sensor, and the sensor samples without a filter, so that every line above half its rate folds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
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
EXPONENT: Final = 0.75
AIR_M: Final = 30.0 * MM
REACHING: Final = 0.3
"""Share of the alternating force that gets through the spindle's inertia to the sensor."""
FULL_N: Final = 334.0
"""Mean force of the slot; less in narrower cuts."""
HELIX_RAD: Final = 0.35
"""Angle over which the edge of a tooth comes into the cut."""
_DISCS: Final = 8
_ANGLES: Final = 720


@dataclass(frozen=True)
class Cut:
    """Cut of a trial."""

    speed_rpm: float = 13_000.0  # spindle speed
    teeth: int = 3  # of the tool
    width_share: float = 1.0  # width of the cut by the diameter; 1 is a slot
    is_climb: bool = True  # climb milling; else conventional
    feed_tooth_m: float = 38.5 * UM  # feed per tooth
    ramp_m: float = 8.0 * MM  # way over which the tool comes into the cut
    runout_m: float = 6.0 * UM  # standard deviation of the radius of a tooth
    pitch_rad: float = 0.0  # largest difference of the pitch angles, as variable pitch cutters have
    sample_s: float = 1e-3  # period of the force sensor
    force_n: float = FULL_N  # mean force of a slot
    gaps: int = 0  # gaps of the stock, without material over a quarter of the cut

    @property
    def turn_per_s(self) -> float:
        """Turns of the spindle per second."""
        return self.speed_rpm / 60.0

    @property
    def feed_m_s(self) -> float:
        """Feed rate."""
        return self.feed_tooth_m * self.teeth * self.turn_per_s

    @property
    def angles(self) -> tuple[float, float]:
        """Entry and exit angle of a tooth, from across the feed."""
        arc = float(np.arccos(1.0 - 2.0 * min(self.width_share, 1.0)))
        return (np.pi - arc, np.pi) if self.is_climb else (0.0, arc)

    def table(self, broken: tuple[int, ...], radius: Float, pitch: Float) -> Float:
        """(k, 3) force over a turn in units of its full chip: along, across, axial.

        Args:
            broken: Teeth that are gone.
            radius: (z,) by which each tooth stands out, m.
            pitch: (z,) angle of each tooth.
        """
        entry, leave = self.angles
        psi: Float = np.arange(_ANGLES, dtype=np.float64) * 2.0 * np.pi / _ANGLES
        out = np.zeros((_ANGLES, 3))
        whole = [j for j in range(self.teeth) if j not in broken]
        for place, j in enumerate(whole):
            last = whole[place - 1]
            gap = (pitch[j] - pitch[last]) % (2.0 * np.pi) if len(whole) > 1 else 2.0 * np.pi
            feed = self.feed_tooth_m * gap * self.teeth / (2.0 * np.pi)
            off = radius[j] - radius[last]
            for disc in range(_DISCS):
                phi = (psi - pitch[j] - HELIX_RAD * (disc + 0.5) / _DISCS) % (2.0 * np.pi)
                inside = (phi >= entry) & (phi <= leave)
                h = np.where(inside, np.maximum(0.0, feed * np.sin(phi) + off), 0.0) / self.feed_tooth_m
                size = h**EXPONENT / _DISCS
                out += size[:, None] * np.stack(
                    [-0.4 * np.sin(phi) - np.cos(phi), np.sin(phi) - 0.4 * np.cos(phi), np.full_like(phi, -0.3)], axis=1
                )
        return out


SLOT: Final = Cut()


@dataclass(frozen=True)
class Incident:
    """An incident in a trial."""

    event: Event | None = None  # what it is; None is a sound cut
    at_m: float = 60.0 * MM  # where it begins, from the start of the cut
    # of it: share of the mean force of an overload, teeth that break, N of chatter or of slow chatter, rise of the
    # ratio per metre; m without material
    size: float = 0.0
    thinner_share: float = 0.0  # share by which the stock becomes thinner there; below 0 thicker


def mean_force(cut: Cut) -> Float:
    """(3,) planned mean force, part axes."""
    pitch: Float = np.arange(cut.teeth) * 2.0 * np.pi / cut.teeth
    slot = Cut(teeth=cut.teeth).table((), np.zeros(cut.teeth), pitch).mean(axis=0)
    own = cut.table((), np.zeros(cut.teeth), pitch).mean(axis=0)
    out: Float = cut.force_n * own / np.linalg.norm(slot)
    return out


def trial_plan(cut_m: float, cut: Cut = SLOT) -> LoopPlan:
    """Plan of the cut: air, a ramp as the tool enters, the cut, a ramp out, air; a row every quarter millimetre."""
    x = np.arange(0.0, cut_m + 2.0 * AIR_M, 0.25 * MM)
    w = np.zeros((len(x), 6))
    w[:, :3] = mean_force(cut) * _engaged(x, cut_m, cut)[:, None]
    cutting = (_engaged(x, cut_m, cut) > 0.0).astype(np.float64)
    n = len(x)
    return LoopPlan(
        np.stack([x, np.zeros(n), np.zeros(n)], axis=1),
        x / cut.feed_m_s,
        w,
        cutting,
        np.zeros((n, 6)),
        turn_per_s=np.full(n, cut.turn_per_s),
        tool=np.ones(n, dtype=np.int64),
        teeth=np.full(n, cut.teeth, dtype=np.int64),
    )


def _engaged(x: Float, cut_m: float, cut: Cut) -> Float:
    """Share of the full engagement 0..1 at a place."""
    pieces = cut.gaps + 1
    pitch = cut_m / pieces
    length = pitch if not cut.gaps else 0.75 * pitch
    out: Float = np.zeros_like(x)
    for piece in range(pieces):
        begin = AIR_M + piece * pitch
        rise = np.clip((x - begin) / cut.ramp_m, 0.0, 1.0)
        fall = np.clip((begin + length - x) / cut.ramp_m, 0.0, 1.0)
        out = out + np.sqrt(np.minimum(rise, fall))
    return out


def signal(cut_m: float, incident: Incident, seed: int, cut: Cut = SLOT) -> Float:
    """Samples of the force sensor, (k, 3) N, part axes, without the tool's weight.

    Args:
        cut_m: Length of the cut.
        incident: What goes wrong.
        seed: Of everything that is not known.
        cut: Of the trial.
    """
    rng = np.random.default_rng((17, seed))
    k = int((cut_m + 2.0 * AIR_M) / cut.feed_m_s / cut.sample_s)
    t = np.arange(k, dtype=np.float64) * cut.sample_s
    x: Float = cut.feed_m_s * (t - float(rng.uniform(-0.03, 0.03))) + rng.uniform(-0.3, 0.3) * MM
    engaged: Float = _engaged(x, cut_m, cut) * rng.normal(1.0, 0.08)
    lag = int(0.4 / cut.sample_s)
    window = np.hanning(lag) / np.sqrt(np.sum(np.hanning(lag) ** 2))
    wave = np.convolve(rng.standard_normal(k + lag), window)[lag : lag + k]
    engaged = engaged * (1.0 + 0.015 * wave)
    place = x - AIR_M - incident.at_m
    after: Bool = place > 0.0
    slowly: Float = np.clip(place / cut.ramp_m, 0.0, 1.0)
    engaged = engaged * (1.0 - incident.thinner_share * slowly)
    broken: tuple[int, ...] = ()
    if incident.event == Event.MISSING_CUT:
        engaged = np.where(after & (place < incident.size), 0.0, engaged)
    elif incident.event == Event.OVERLOAD:
        engaged = engaged * (1.0 + incident.size * slowly)
    elif incident.event == Event.WEAR:
        engaged = engaged * (1.0 + incident.size * np.maximum(0.0, place))
    elif incident.event == Event.BREAKAGE:
        broken = tuple(range(round(incident.size)))
    loaded = np.convolve(engaged, np.exp(-t[: 4 * lag] / 0.1) * cut.sample_s / 0.1)[:k]
    speed = cut.turn_per_s * (1.0 - rng.uniform(0.0, 0.006) - 0.002 * loaded)
    angle: Float = np.cumsum(speed) * cut.sample_s + rng.uniform()
    force = _teeth(cut, angle, broken, after, engaged, rng)
    begin = int(np.argmax(engaged > 0.0))
    since = t[begin:] - t[begin]
    swing = np.zeros(k)
    swing[begin:] = 0.15 * np.exp(-0.05 * 2.0 * np.pi * 8.0 * since) * np.sin(2.0 * np.pi * 8.0 * since)
    force += swing[:, None] * np.linalg.norm(mean_force(cut)) * np.array([0.3, 1.0, 0.2])
    if incident.event in (Event.CHATTER, Event.LOW_CHATTER):
        band = (70.0, 480.0) if incident.event == Event.CHATTER else (4.0, 36.0)
        grown = incident.size * np.where(after, 1.0 - np.exp(-np.maximum(0.0, place) / (0.2 * cut.feed_m_s)), 0.0)
        line = 2.0 * np.pi * rng.uniform(*band) * t
        force += (grown * (engaged > 0.0))[:, None] * np.sin(line)[:, None] * np.array([0.4, 0.9, 0.1])
    return force + rng.standard_normal((k, 3))


def _teeth(
    cut: Cut, angle: Float, broken: tuple[int, ...], after: Bool, engaged: Float, rng: np.random.Generator
) -> Float:
    """Force of the teeth; of what turns with the spindle only REACHING gets to the sensor."""
    radius = cut.runout_m * rng.standard_normal(cut.teeth)
    even = np.arange(cut.teeth) * 2.0 * np.pi / cut.teeth
    pitch: Float = even + cut.pitch_rad * (np.arange(cut.teeth) % 2)
    scale = np.linalg.norm(mean_force(cut)) / np.linalg.norm(cut.table((), 0.0 * radius, even).mean(axis=0))
    at = (angle % 1.0) * _ANGLES
    out = np.zeros((len(angle), 3))
    for teeth, rows in ((cut.table((), radius, pitch), ~after), (cut.table(broken, radius, pitch), after)):
        mean = teeth.mean(axis=0)
        closed = np.vstack([teeth, teeth[:1]])
        for axis in range(3):
            now = np.interp(at[rows], np.arange(_ANGLES + 1), closed[:, axis])
            out[rows, axis] = mean[axis] + REACHING * (now - mean[axis])
    return out * scale * engaged[:, None]


@dataclass(frozen=True)
class Outcome:
    """Outcome of a trial."""

    events: dict[Event, float]  # first place of each event from the start of the cut, m
    trend_per_m: float  # change of the ratio per metre at the end
    trend_sigma_per_m: float  # its standard deviation
    seen: dict[Event, float]  # share of the cycles in the cut in which each event could be seen


def run_trial(settings: MonitorSettings, cut_m: float, incident: Incident, seed: int, cut: Cut = SLOT) -> Outcome:
    """One trial.

    Args:
        settings: Of the monitor; the period of the sensor is that of the cut.
        cut_m: Length of the cut.
        incident: What goes wrong.
        seed: Of everything that is not known.
        cut: Of the trial.
    """
    plan = trial_plan(cut_m, cut)
    path = plan.packed()
    monitor = Monitor(settings, None, path, plan.watched(settings), 5.0 * MM, 2.0 * MM)
    samples = np.ascontiguousarray(np.pad(signal(cut_m, incident, seed, cut), ((0, 0), (0, 3))))
    per_cycle = round(PERIOD_S / cut.sample_s)
    given, result = records(GIVEN)[0], records(RESULT)[0]
    given.nominal[:9] = rotation.about_x(np.pi).reshape(-1)
    given.elapsed = 1
    result.state = State.ACTIVE
    place: Float = np.zeros(2)
    step = 0.25 * MM
    detected: dict[Event, float] = {}
    cycles, could = 0, dict.fromkeys(Event, 0)
    for cycle in range(len(samples) // per_cycle):
        x = cut.feed_m_s * cycle * PERIOD_S
        row = min(int(x / step), len(path) - 2)
        place[:] = row, min(1.0, x / step - row)
        mine = samples[cycle * per_cycle : (cycle + 1) * per_cycle]
        monitor.take(mine, per_cycle, cycle * per_cycle, place)
        given.wrench[:3] = mine[:, :3].mean(axis=0)
        monitor.after(given, result, place)
        new, seen = int(monitor.outcome.new), int(monitor.outcome.seen)
        in_cut = AIR_M < x < AIR_M + cut_m
        cycles += in_cut
        for event in Event:
            if new >> event & 1:
                detected.setdefault(event, x - AIR_M)
            could[event] += in_cut and seen >> event & 1
    return Outcome(
        detected,
        float(monitor.results.trend),
        float(monitor.results.trend_sigma),
        {event: n / max(cycles, 1) for event, n in could.items()},
    )
