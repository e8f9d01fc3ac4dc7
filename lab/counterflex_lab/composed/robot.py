"""The machine: a robot that runs its program and follows the correction late, its arm, its spindle, its instruments."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.geometry import rotation
from counterflex.protocols.tracker.telegram import BEAM_BROKEN, DATAGRAM, MAGIC
from counterflex.twin.devices.commanded_motion import Report
from counterflex_lab.composed import bench
from counterflex_lab.composed.story import Active
from counterflex_lab.devices import COUNTS, SATURATED, netft

_BRAKES_M_S2: Final = 0.5
_RIPPLE_N: Final = 4.0
_NOISE_N: Final = 0.3
_RATE_HZ: Final = 1000.0
"""Of the force sensor."""
_BLOCK: Final = 256
_RAIL: Final = 2**31 - 1
_CUTS_N: Final = 50.0
_BAD_STATUS: Final = 0x80020000
_TRACKER_EPOCH_NS: Final = 100_000_000_000
_DEAD_S: Final = 12e-3
_STEP_S: Final = 4e-3
"""Longest step of integration."""
_TRACKER_AGE_S: Final = 4e-3


class Robot:
    """Program, arm and instruments, cycle by cycle.

    Args:
        active: Faults that act.
        rng: Chance of noise and of the truth.
        period_s: Cycle.
        measures_axes: The controller shows measured angles, which contain the correction.

    Attributes:
        place: Row of the program, with its fraction.
        speed: m/s.
        runs: The program runs.
        made_m: (3,) what the drives have made of the correction.
        force: (3,) N on the tool.
        samples_per_cycle: Of the force sensor.
    """

    def __init__(
        self, active: Active, rng: np.random.Generator, period_s: float, *, measures_axes: bool = False
    ) -> None:
        self._measures_axes, self.samples_per_cycle = measures_axes, round(period_s * _RATE_HZ)
        self._dead = round(_DEAD_S / period_s)
        self._active, self._rng, self._dt = active, rng, period_s
        self._program = bench.program()
        self._C = bench.true_compliance(rng)
        self._off = self._C - bench.model_compliance()
        self._natural = 2.0 * np.pi * 5.0 * float(rng.uniform(0.9, 1.15))
        self._damping = 0.7 * float(rng.uniform(0.9, 1.1))
        self._reading = bench.reading()
        self.place = self.speed = 0.0
        self.runs = False
        self.made_m: Float = np.zeros(3)
        self._rate = [0.0, 0.0, 0.0]
        self._sent: deque[Float] = deque([np.zeros(3)] * 200, maxlen=200)
        self.force: Float = np.zeros(3)
        self._harder = float(rng.uniform(0.93, 1.07))
        self._axis = int(rng.integers(0, 6))
        self._direction: Float = _unit(rng)
        self._sequence = self._sample = self._tracked = 0
        self._shown: Float | None = None
        self._seen: Float | None = None
        self._measured: tuple[Float, float] | None = None
        self._drift = 0.0
        self._noises: Float = np.zeros((0, self.samples_per_cycle, 6))
        self._noise_at = 0
        self._T: Float = np.eye(4)
        self._T[:3, :3] = self._program.R

    @property
    def cuts(self) -> bool:
        """The tool is in material."""
        return abs(float(self._program.force[int(self.place), 1])) > _CUTS_N

    @property
    def bent_m(self) -> Float:
        """(3,) by which the arm yields to the force on the tool."""
        out: Float = self._C @ self.force
        return out

    @property
    def unmodelled_m(self) -> Float:
        """(3,) of :attr:`bent_m` that the cell's compliances do not have."""
        out: Float = self._off @ self.force
        return out

    @property
    def cuts_fully(self) -> bool:
        """The planned force is the largest: neither an entry nor an exit."""
        return bool(self._program.force[int(self.place), 1] ** 2 >= bench.FULL_N2)

    @property
    def last(self) -> int:
        """Last row of the way back."""
        return len(self._program.p) - 1

    @property
    def at_end(self) -> bool:
        """The program has come to its end."""
        return self.place >= self._program.end

    def begin(self) -> None:
        """Stand at the beginning of the program, no correction in force."""
        self.place = self.speed = 0.0
        self.runs = False
        self.made_m[:] = 0.0
        self._rate = [0.0, 0.0, 0.0]
        self._sent.extend([np.zeros(3)] * self._sent.maxlen if self._sent.maxlen else [])

    def move(self, correction_m: Float, *, holds: bool, stopped: bool, override: float) -> None:
        """One cycle.

        Args:
            correction_m: (3,) in force, part axes.
            holds: The feed is to be held.
            stopped: The controller has stopped the motion.
            override: Speed of the program.
        """
        active, dt = self._active, self._dt
        now = active.now
        requested = bench.FEED_M_S * override if self.runs else 0.0
        if "feed-differs" in now:
            requested *= active.size("feed-differs")
        if (holds and "ignores-hold" not in now) or stopped:
            requested = 0.0
        most = _BRAKES_M_S2 * dt
        self.speed += min(most, max(-most, requested - self.speed))
        last = self.last
        self.place = min(self.place + self.speed * dt / bench.SPACING_M, float(last))
        self._sent.append(correction_m)
        if not stopped:
            self._follow(now)
        self._cut(now)

    def guided(self, p: Float) -> None:
        """One cycle after a pose that guides: what of it lies beside the path is the correction, as the drives make it.

        Args:
            p: (3,) m where the controller has the tool, part frame.
        """
        before, now = self.place, self._active.now
        self.place, beside = bench.beside(p, int(before))
        self.speed = abs(self.place - before) * bench.SPACING_M / self._dt
        self._sent.append(beside)
        if "robot-stays" not in now:
            self.made_m = self._asked(now, 0).copy()
        self._cut(now)

    def _asked(self, now: Mapping[str, object], back: int) -> Float:
        """Request to the drives, of what was sent some cycles ago."""
        size = self._active.size
        if "robot-delays" in now:
            back += min(180, round(size("robot-delays") / self._dt))
        u = self._sent[-1 - back]
        if "robot-share" in now:
            u = u * size("robot-share")
        if "robot-negates" in now:
            u = -u
        if "robot-clamps" in now:
            length = float(np.linalg.norm(u))
            u = u * min(1.0, size("robot-clamps") / length) if length > 0.0 else u
        return u

    def _follow(self, now: Mapping[str, object]) -> None:
        u = self._asked(now, self._dead)
        if "robot-stays" in now:
            self._rate = [0.0, 0.0, 0.0]
            return
        made = self.made_m.tolist()
        follow(made, self._rate, u.tolist(), self._natural, self._damping, self._dt)
        self.made_m[:] = made

    def _cut(self, now: Mapping[str, object]) -> None:
        row = int(self.place)
        planned = self._program.force[row]
        if self.speed <= 1e-4 or not self._program.cuts[row]:
            self.force = 0.1 * planned
            return
        scale = self._harder * (self.speed / bench.FEED_M_S) ** 0.7
        if "harder" in now:
            scale *= self._active.size("harder")
        self.force = scale * planned + _RIPPLE_N * self._rng.standard_normal(3)

    def report(self, time_s: float, drive_torque: Float) -> Report:
        """Report of the controller about the robot, whose drives have a torque (6,) N m."""
        active, program = self._active, self._program
        row = int(self.place)
        share = self.place - row
        p, q = program.p[row], program.q[row]
        if share > 0.0:
            p = p + share * (program.p[row + 1] - p)
            q = q + share * (program.q[row + 1] - q)
        T, made = self._T.copy(), self._T.copy()
        now = active.now
        T[:3, 3] = p
        made[:3, 3] = p + self.made_m
        if "pose-off" in now:
            made[:3, 3] += active.size("pose-off") * self._direction
        if "axis-off" in now:
            q = q.copy()
            q[self._axis] += active.size("axis-off")
        actual = q
        if self._measures_axes:
            actual = q + bench.angles()[row] @ self.made_m
        return Report(time_s, T, made, q, actual, self.runs, self.at_end, drive_torque)

    @property
    def base_off_m(self) -> Float:
        """(3,) by which BASE or TOOL of the program is off: its poses, not its path; part axes."""
        out: Float = self._active.size("base-off") * self._direction
        return out

    def samples(self) -> list[bytes]:
        """Records of the force sensor in this cycle."""
        now = self._active.now
        w, status = self._read(now)
        counts = np.rint(w * COUNTS)
        if now:
            counts = np.clip(counts, -_RAIL, _RAIL)
            if np.abs(counts).max() >= _RAIL and "force-rail" not in now:
                status |= SATURATED
        if "force-nan" in now:
            status |= _BAD_STATUS
        out = []
        for row in counts.astype(np.int64).tolist():
            self._sample = (self._sample + 1) & 0xFFFFFFFF
            self._sequence = (self._sequence + 1) & 0xFFFFFFFF
            out.append(netft.RECORD.pack(self._sequence, self._sample, status, *row))
        return [] if "force-silent" in now else out

    def own_force(self) -> Float | None:
        """(6,) what the robot itself measures in this cycle, or None."""
        now = self._active.now
        w, _ = self._read(now)
        return None if "force-silent" in now else w[-1]

    def _read(self, now: Mapping[str, object]) -> tuple[Float, int]:
        """Readings of the sensor in this cycle, (n, 6), and its status."""
        w, status = self._reading[:, :3] @ self.force + self._noise(), 0
        if now:
            w, status = self._falsified(w, now)
        self._shown = self._shown if "force-frozen" in now or "force-stuck" in now else w[-1]
        return w, status

    def _noise(self) -> Float:
        if self._noise_at == len(self._noises):
            self._noises = _NOISE_N * _MOMENTS * self._rng.standard_normal((_BLOCK, self.samples_per_cycle, 6))
            self._noise_at = 0
        self._noise_at += 1
        out: Float = self._noises[self._noise_at - 1]
        return out

    def _falsified(self, w: Float, now: Mapping[str, object]) -> tuple[Float, int]:
        size = self._active.size
        if "force-unit" in now:
            w = w * size("force-unit")
        if "force-axes" in now:
            w = w[:, [1, 0, 2, 4, 3, 5]]
        if "force-turned" in now:
            c, s = np.cos(size("force-turned")), np.sin(size("force-turned"))
            w = w.copy()
            w[:, 0], w[:, 1] = c * w[:, 0] - s * w[:, 1], s * w[:, 0] + c * w[:, 1]
        if "force-offset" in now:
            w = w + size("force-offset") * np.r_[self._direction, np.zeros(3)]
        if "force-spikes" in now and self._rng.random() < 0.1:
            w = w.copy()
            w[self._rng.integers(0, self.samples_per_cycle), self._rng.integers(0, 3)] += size("force-spikes")
        if "force-rail" in now:
            w = w.copy()
            w[:, 1] = np.sign(size("force-rail")) * _RAIL / COUNTS
        if "force-frozen" in now and self._shown is not None:
            w = np.tile(self._shown, (self.samples_per_cycle, 1))
        if "force-stuck" in now and self._shown is not None:
            w = self._shown + self._noise()
        return w, 0

    def pose(self, time_s: float) -> bytes | None:
        """Datagram of the tracker in this cycle: what it measured 4 ms ago, between the last cycle and this one."""
        now, size = self._active.now, self._active.size
        row = int(self.place)
        p = self._program.p[row] + (self.place - row) * (
            self._program.p[min(row + 1, len(self._program.p) - 1)] - self._program.p[row]
        )
        tool = p + self.made_m + self.bent_m + bench.TRACKER_NOISE_M * self._rng.standard_normal(3)
        before, self._measured = self._measured, (tool, time_s)
        if before is None:
            return None
        back = _TRACKER_AGE_S / self._dt
        point = back * before[0] + (1.0 - back) * tool
        time_s = back * before[1] + (1.0 - back) * time_s
        if "tracker-frozen" in now or "tracker-stuck" in now:
            point = point if self._seen is None else self._seen
            if "tracker-stuck" in now:
                point = point + bench.TRACKER_NOISE_M * self._rng.standard_normal(3)
        else:
            self._seen = point
        self._drift = self._drift + size("tracker-drift") * self._dt if "tracker-drift" in now else 0.0
        off = self._drift + size("tracker-jump") + size("tracker-reflector")
        self._tracked = (self._tracked + 1) & 0xFFFFFFFF
        stamp = round(time_s * 1e9) + _TRACKER_EPOCH_NS
        if "tracker-stamp" in now:
            stamp = max(0, stamp + round(size("tracker-stamp") * 1e9))
        status = BEAM_BROKEN if "tracker-beam" in now else 0
        if "tracker-silent" in now:
            return None
        mm = ((point + off * self._direction) / MM).tolist()
        return DATAGRAM.pack(MAGIC, self._tracked, stamp, status, 0, *mm, *_TURNED, bench.TRACKER_NOISE_M / MM)


_TURNED: Final = tuple(rotation.quat_wxyz(rotation.about_x(np.pi)).tolist())
"""Orientation of the tool, which never turns, as the tracker's datagram has it."""
_MOMENTS: Final = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])


def follow(value: list[float], rate: list[float], goals: list[float], w: float, damping: float, time_s: float) -> None:
    """Follow ``x'' + 2 zeta w x' + w^2 x = w^2 u`` for a while.

    Args:
        value: x of each coordinate; changed.
        rate: Its rate; changed.
        goals: u, held.
        w: rad/s.
        damping: Ratio.
        time_s: A multiple of 4 ms.
    """
    steps = max(1, round(time_s / _STEP_S))
    dt, spring, drag = time_s / steps, w * w, 2.0 * damping * w
    for k, goal in enumerate(goals):
        x, v = value[k], rate[k]
        for _ in range(steps):  # numbers of Python: arrays of three take three times as long
            v += dt * (spring * (goal - x) - drag * v)
            x += dt * v
        value[k], rate[k] = x, v


def _unit(rng: np.random.Generator) -> Float:
    v = rng.standard_normal(3)
    out: Float = v / np.linalg.norm(v)
    return out
