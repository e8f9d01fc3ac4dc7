"""The online loop of one cell: owns the arrays of the step and gives them names. Knows no socket, clock or file."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.robot.chain import ElasticChain
from counterflex.robot.kernels_step import OUT_C, OUT_SIZE, SCRATCH
from counterflex.runtime import fusion_kernel as fk
from counterflex.runtime import layout as at
from counterflex.runtime.axis_play import AxisPlay
from counterflex.runtime.follow_kernel import (
    PLAN_A,
    PLAN_C,
    PLAN_COLUMNS,
    PLAN_CUT,
    PLAN_P,
    PLAN_PLAY,
    PLAN_TIME,
    PLAN_V,
    PLAN_W,
)
from counterflex.runtime.fusion import Source
from counterflex.runtime.monitor import Monitor
from counterflex.runtime.monitor_layout import P_SPEED
from counterflex.runtime.monitor_plan import monitor_plan
from counterflex.runtime.monitor_settings import MonitorSettings, unwatched
from counterflex.runtime.override_plan import SpeedPlan, speed_plan
from counterflex.runtime.override_settings import OverrideSettings
from counterflex.runtime.pilot_lead import pilot_lead
from counterflex.runtime.plausibility_stage import PlausibilityStage
from counterflex.runtime.settings import (
    ForceMode,
    OnlineSettings,
    TrackerMode,
    force_delay,
    inertia_smoothing,
    per_direction,
    robot_answer,
)
from counterflex.runtime.step_kernel import step
from counterflex.runtime.supervisor import Cause, State
from counterflex.signals.filters import Smoother

_WINDOW = 200
_NO_CURRENTS = 10_000
_TORQUE_MEMORY_S = 0.5
"""Over which the friction in a motor current stays the same, so that its samples are no new information."""
_SCALE_VARIANCE = 0.25**2
_OFFSET_M2 = (0.5e-3) ** 2
_OFFSET_RAD2 = (5e-3) ** 2


@dataclass(frozen=True, eq=False)
class LoopPlan:
    """What the loop knows of the program; n rows, part frame, SI.

    Attributes:
        p_part: (n, 3) points as the program sends them (its correction included).
        time_s: (n,) planned time, not decreasing.
        w_tcp_part: (n, 6) predicted wrench on the tool about its tip.
        cutting: (n,) 1 where material is cut.
        contained: (n, 6) correction that the program already contains, m and rotation vector.
        play: (n, 3) m, deviation by play and friction that the plan predicts; None is none.
        turn_per_s: (n,) spindle speed, turns per second; None is not known.
        tool: (n,) number of the tool; None is one and the same.
        teeth: (n,) of the tool; None is not known.
        chip_m: (n,) mean chip thickness where it cuts, else NaN; None is not known.
        need_m: (n, 3) correction across the feed that the loop will want at this place; None is not known.
        left_m: (n,) size of the error that the program itself is predicted to leave; None is not known.
        w_ahead_part: (n, 6) wrench whose deflection is to be commanded here so that the robot, as slow as it is, undoes
            the predicted one in time; None reads the predicted wrench ahead by the lead instead.
    """

    p_part: Float
    time_s: Float
    w_tcp_part: Float
    cutting: Float
    contained: Float
    play: Float | None = None
    turn_per_s: Float | None = None
    tool: Int | None = None
    teeth: Int | None = None
    chip_m: Float | None = None
    need_m: Float | None = None
    left_m: Float | None = None
    w_ahead_part: Float | None = None

    def packed(self) -> Float:
        """(n, PLAN_COLUMNS) for the step, with feed directions.

        Raises:
            InputError: Fewer than two rows, wrong shapes, numbers that are not finite, time that runs backwards.
        """
        p = as_float("plan: p_part", self.p_part, (None, 3))
        n = len(p)
        if n < 2:
            raise InputError("a plan needs two points", value=n)
        time = as_float("plan: time_s", self.time_s, (n,))
        if np.any(np.diff(time) < 0.0):
            raise InputError("time of the plan runs backwards", value=f"row {int(np.argmin(np.diff(time))) + 1}")
        out = np.zeros((n, PLAN_COLUMNS))
        out[:, PLAN_P : PLAN_P + 3] = p
        out[:, PLAN_TIME] = time
        out[:, PLAN_W : PLAN_W + 6] = as_float("plan: w_tcp_part", self.w_tcp_part, (n, 6))
        ahead = self.w_tcp_part if self.w_ahead_part is None else self.w_ahead_part
        out[:, PLAN_A : PLAN_A + 6] = as_float("plan: w_ahead_part", ahead, (n, 6))
        out[:, PLAN_CUT] = as_float("plan: cutting", self.cutting, (n,))
        out[:, PLAN_C : PLAN_C + 6] = as_float("plan: contained", self.contained, (n, 6))
        if self.play is not None:
            out[:, PLAN_PLAY : PLAN_PLAY + 3] = as_float("plan: play", self.play, (n, 3))
        step_p = np.diff(p - out[:, PLAN_C : PLAN_C + 3], axis=0)
        length = np.linalg.norm(step_p, axis=1, keepdims=True)
        out[:-1, PLAN_V : PLAN_V + 3] = step_p / np.where(length > 0.0, length, 1.0)
        out[-1, PLAN_V : PLAN_V + 3] = out[-2, PLAN_V : PLAN_V + 3]
        return out

    def watched(self, settings: MonitorSettings) -> Float:
        """The plan as the monitor needs it, see :func:`counterflex.runtime.monitor_plan.monitor_plan`."""
        n = len(self.p_part)
        turn = np.zeros(n) if self.turn_per_s is None else as_float("plan: turn_per_s", self.turn_per_s, (n,))
        none = np.zeros(n, dtype=np.int64)
        tool = none if self.tool is None else self.tool
        teeth = none if self.teeth is None else self.teeth
        return monitor_plan(self.packed(), settings, turn, teeth, tool)

    def speeds(self, settings: OnlineSettings, override: OverrideSettings) -> SpeedPlan:
        """Speeds at which the predicted remaining error stays within a tolerance."""
        return speed_plan(self.time_s, self.need_m, self.left_m, settings, override)


class Loop:
    """One online loop.

    Fill ``given`` and ``flags`` (or use :meth:`feed`), call :meth:`run`, read ``correction``. Nothing is allocated in
    :meth:`run`. Not safe to share between threads.

    Args:
        chain: Elastic chain of the cell, calibrated.
        settings: What to do.
        T_base_part: (4, 4) part frame, the frame of all poses.
        plan: Or None: then only a measured force can be corrected, along the feed too.
        monitor: What of the process is watched; None watches all and reacts to nothing.
        override: How the program's speed may be changed; None leaves it alone.

    Attributes:
        given: (GIVEN,) inputs, see :mod:`counterflex.runtime.layout`.
        flags: (FLAGS,) inputs.
        results: (RESULTS,) results.
        outcome: (OUTCOME,) results.
        correction: (6,) view: what to send, m and rotation vector, part axes.
        axes: (6,) view: the same as change of the axis angles, rad.
        settings: As given.
        monitor: Process monitoring and feed override.

    Raises:
        InputError: The settings need a plan and there is none, or the monitor has another cycle.
    """

    def __init__(
        self,
        chain: ElasticChain,
        settings: OnlineSettings,
        T_base_part: Float,
        plan: LoopPlan | None = None,
        *,
        monitor: MonitorSettings | None = None,
        override: OverrideSettings | None = None,
    ) -> None:
        if plan is None and (settings.force in (ForceMode.PILOT, ForceMode.SCALE) or settings.compensated):
            raise InputError(
                "this way of correcting needs a plan", value=settings.force.name.lower(), hint="Give the plan file"
            )
        if plan is None and settings.normal_only:
            raise InputError(
                "without a plan the feed direction is not known",
                hint="Give the plan file, or correct along the feed too",
            )
        self.settings = settings
        compact = chain.compact
        m = compact.stations
        self._real, self._kind = compact.real, compact.kind
        self._constants = _constants(settings, as_float("T_base_part", T_base_part, (4, 4)), plan)
        self._choices = _choices(settings, plan)
        self._supervisor = settings.supervisor.packed()
        self._plan = np.zeros((2, PLAN_COLUMNS)) if plan is None else plan.packed()
        self.given: Float = np.zeros(at.GIVEN)
        self.flags: Int = np.zeros(at.FLAGS, dtype=np.int64)
        self.results: Float = np.zeros(at.RESULTS)
        self.outcome: Int = np.zeros(at.OUTCOME, dtype=np.int64)
        self.correction: Float = self.results[at.R_CORRECTION : at.R_CORRECTION + 6]
        self.axes: Float = self.results[at.R_AXES : at.R_AXES + 6]
        self.measured_filter = Smoother(settings.smoothing, 6)
        self.predicted_filter = Smoother(settings.smoothing, 6)
        self._state: Float = np.zeros(at.STATE)
        self._whole: Int = np.zeros(at.WHOLE, dtype=np.int64)
        self._ring: Float = np.zeros((at.RING_ROWS, at.RING))
        self._elastic: Float = np.zeros(OUT_SIZE)
        self._frame: Float = np.zeros((m + 1, 12))
        self._delta: Float = np.zeros((m, 6))
        self._scratch: Float = np.zeros((SCRATCH, 36))
        self._load: Float = np.zeros(12)
        self._work: Float = np.zeros((11, 12))
        self.monitor = _monitor(settings, self._plan, plan, monitor, override)
        self.plausibility = PlausibilityStage(settings, self._choices, self._state, self._whole, self._ring)
        self._place: Float = self._state[at.S_PLACE : at.S_PLACE + 2]
        self._axis_play: AxisPlay | None = None
        if settings.axis_play:
            own = np.array(settings.own_play_rad)
            self._axis_play = AxisPlay(chain, settings.period_s, contained=settings.compensated, own_rad=own)
        self.reset()

    def reset(self) -> None:
        """Begin anew: IDLE, correction zero, nothing learnt, place on the path unknown; as a loop just made."""
        for array in (self._state, self._elastic, self._frame, self._delta, self._scratch, self._load, self._work):
            array[:] = 0.0
        self.results[:] = 0.0
        self.outcome[:] = 0
        self._state[at.S_PLACE] = -1.0
        self._state[at.S_SCALE : at.S_SCALE + 3] = 1.0
        self._state[at.S_SPEED] = self._state[at.S_SLOWER] = 1.0
        self._state[at.S_VARIANCE : at.S_VARIANCE + 3] = _SCALE_VARIANCE
        self._state[at.S_OFFSET_VARIANCE : at.S_OFFSET_VARIANCE + 2] = _OFFSET_M2, _OFFSET_RAD2
        self.settings.fusion.begin(self._state[at.S_FUSION : at.S_FUSION + fk.SIZE])
        self._whole[:] = 0
        self._ring[:] = 0.0
        self.given[:] = 0.0
        self.flags[:] = 0
        self.measured_filter.reset(np.zeros(6))
        self.predicted_filter.reset(np.zeros(6))
        self.monitor.reset()
        self.plausibility.reset()
        if self._axis_play is not None:
            self._axis_play.reset()

    def take(self, samples: Float, count: int, number: int) -> None:
        """Hand over the force sensor's own samples of the cycle, see :meth:`Monitor.take`; before :meth:`run`."""
        self.monitor.take(samples, count, number, self._place)

    def feed(
        self,
        *,
        T_part_tcp: Float,
        q: Float,
        w_tcp_part: Float | None = None,
        T_part_actual: Float | None = None,
        T_part_reported: Float | None = None,
        elapsed: int = 1,
        force_age: int = 0,
        tracker_age: int = 0,
        healthy: bool = True,
        arm: bool = False,
        enable: bool = False,
        stop: bool = False,
        reset: bool = False,
        soft: Cause = Cause.NONE,
        hard: Cause = Cause.NONE,
        sources: Source = Source.FORCE | Source.TRACKER,
        tracker_late_s: float | None = None,
        tracker_sigma_m: float = 0.0,
        torque: Float | None = None,
    ) -> None:
        """Fill the inputs of a cycle; for tests, replays and experiments.

        Args:
            T_part_tcp: (4, 4) commanded pose without correction.
            q: (6,) rad.
            w_tcp_part: (6,) wrench of the process about the TCP, part axes; None leaves the last one.
            T_part_actual: (4, 4) measured pose; None where there is none in this cycle.
            T_part_reported: (4, 4) pose that the controller itself reports, correction included; None: it does not.
            elapsed: Cycles since the last telegram; 0 where none came.
            force_age: Cycles since the last good force.
            tracker_age: Cycles since the last good tracker sample.
            healthy: Telegrams, sensors and self-tests are good.
            arm: The operator arms.
            enable: The robot program wants the correction.
            stop: Stop.
            reset: The operator resets a fault.
            soft: Cause of a hold found elsewhere.
            hard: Cause of a fault found elsewhere.
            sources: What the cell has beside the plan, for the estimator.
            tracker_late_s: Time from the measurement of ``T_part_actual`` to now; None is the identified one.
            tracker_sigma_m: Standard deviation that the tracker states; 0 where it does not.
            torque: (6,) N m, torque of the process about the axes from motor currents; None where there are none.
        """
        self.given[:9] = T_part_tcp[:3, :3].reshape(-1)
        self.given[9:12] = T_part_tcp[:3, 3]
        self.given[at.G_Q : at.G_Q + 6] = q
        if w_tcp_part is not None:
            self.given[at.G_W : at.G_W + 6] = w_tcp_part
        if T_part_actual is not None:
            self.given[at.G_ACTUAL : at.G_ACTUAL + 9] = T_part_actual[:3, :3].reshape(-1)
            self.given[at.G_ACTUAL + 9 : at.G_ACTUAL + 12] = T_part_actual[:3, 3]
        if T_part_reported is not None:
            self.given[at.G_REPORTED : at.G_REPORTED + 9] = T_part_reported[:3, :3].reshape(-1)
            self.given[at.G_REPORTED + 9 : at.G_REPORTED + 12] = T_part_reported[:3, 3]
        new = int(T_part_actual is not None)
        self.given[at.G_TRACKER_LATE] = -1.0 if tracker_late_s is None else tracker_late_s
        self.given[at.G_TRACKER_SIGMA] = tracker_sigma_m
        if torque is not None:
            self.given[at.G_TORQUE : at.G_TORQUE + 6] = torque
        self.flags[:] = (
            elapsed, force_age, new, tracker_age, healthy, arm, enable, stop, reset, soft, hard, sources,
            int(torque is None) * _NO_CURRENTS, int(T_part_reported is not None),
        )  # fmt: skip

    def run(self) -> None:
        """One cycle."""
        m, p = self.measured_filter, self.predicted_filter
        self.monitor.before(self.flags)
        self.plausibility.before(self.given, self.flags, self.results)
        step(
            self.given,
            self.flags,
            self._constants,
            self._choices,
            self._supervisor,
            self._plan,
            self._real,
            self._kind,
            self._state,
            self._whole,
            self._ring,
            m.coefficients,
            m.memory,
            m.ring,
            m.place,
            p.memory,
            p.ring,
            p.place,
            self._elastic,
            self._frame,
            self._delta,
            self._scratch,
            self._load,
            self.results,
            self.outcome,
            self._work,
        )
        if self._axis_play is not None:
            self._axis_play.after(self.given, self.flags, self.results, self.outcome)
        self.plausibility.after(self.given, self.flags, self.results, self.outcome)
        self.monitor.after(self.given, self.flags, self.results, self.outcome, self._place)
        if self.monitor.overriding:
            self._state[at.S_SPEED] = self.monitor.speed
            self._state[at.S_SLOWER] = self.monitor.speed**self.monitor.settings.exponent

    @property
    def compliance(self) -> Float:
        """(36,) view: compliance of the arm at the tip in the last cycle, base axes, by rows."""
        return self._elastic[OUT_C : OUT_C + 36]

    @property
    def in_effect(self) -> Float:
        """(6,) view: correction that the robot has made of what was sent, m and rotation vector, part axes."""
        return self._state[at.S_IN_FORCE : at.S_IN_FORCE + 6]

    @property
    def cycle(self) -> int:
        """Cycles run since the start or the last :meth:`reset`; after the first :meth:`run` it is 1."""
        return int(self._whole[at.N_CYCLES])

    def sha256(self) -> str:
        """Hash over every number the step is given besides its inputs: two loops that agree in it compute the same."""
        digest = hashlib.sha256()
        m = self.measured_filter
        for array in (
            self._constants,
            self._choices,
            self._supervisor,
            self._plan,
            self._real,
            self._kind,
            m.coefficients,
            np.array(m.ring.shape),
            *self.monitor.numbers(),
            *self.plausibility.numbers(),
            *(() if self._axis_play is None else (self._axis_play.parameters,)),
        ):
            digest.update(f"{array.dtype.str}{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    @property
    def state(self) -> State:
        """State of the supervisor."""
        return State(int(self.outcome[at.O_STATE]))

    @property
    def cause(self) -> Cause:
        """Why it is in that state."""
        return Cause(int(self.outcome[at.O_CAUSE]))

    @property
    def scale(self) -> Float:
        """(3,) learnt factors of the force: feed, across, along the tool."""
        if self.settings.force == ForceMode.FUSED:
            return self._state[at.S_FUSION + fk.X : at.S_FUSION + fk.X + 3].copy()
        return self._state[at.S_SCALE : at.S_SCALE + 3].copy()

    @property
    def offset(self) -> Float:
        """(6,) deviation that force and plan do not explain, m and rad, part axes."""
        if self.settings.force == ForceMode.FUSED:
            return self.results[at.R_OFFSET : at.R_OFFSET + 6].copy()
        return self._state[at.S_OFFSET : at.S_OFFSET + 6].copy()

    @property
    def sources(self) -> Source:
        """What the estimate of the last cycle rests on; nothing where the loop has no estimator."""
        return Source(int(self.outcome[at.O_SOURCES]))

    @property
    def place(self) -> float:
        """Row of the plan, with fraction; -1 unknown."""
        return float(self._state[at.S_PLACE] + self._state[at.S_PLACE + 1])


def _monitor(
    settings: OnlineSettings,
    path: Float,
    plan: LoopPlan | None,
    monitor: MonitorSettings | None,
    override: OverrideSettings | None,
) -> Monitor:
    monitor = unwatched(settings) if monitor is None else monitor
    if abs(monitor.period_s - settings.period_s) > 1e-9:
        raise InputError("the monitor has another cycle", value=monitor.period_s, limit=settings.period_s)
    watched = None if plan is None else plan.watched(monitor)
    if watched is not None and plan is not None and override is not None:
        watched[:, P_SPEED] = plan.speeds(settings, override).speed
    return Monitor(monitor, override, path, watched, settings.off_path_m, settings.translation.radius)


def _shaped(settings: OnlineSettings, plan: LoopPlan | None) -> bool:
    """Whether the plan says itself what to command ahead of time."""
    return plan is not None and plan.w_ahead_part is not None and settings.pilot.lead_s is None


def _lead(settings: OnlineSettings, plan: LoopPlan | None) -> float:
    """How much ahead the plan is read, s."""
    if plan is None or plan.w_ahead_part is None or settings.pilot.lead_s is not None:
        return settings.lead_s
    if settings.force != ForceMode.PILOT:
        return 0.0
    return pilot_lead(
        plan.time_s,
        plan.w_tcp_part,
        plan.w_ahead_part,
        settings.smoothing,
        settings.pilot.threshold_n,
        settings.pilot.blend_s,
        robot_answer(settings)[1],
        most_s=2.0 * settings.pilot.blend_s,
    )


def _constants(settings: OnlineSettings, T_base_part: Float, plan: LoopPlan | None) -> Float:
    T, tuning = settings.period_s, settings.tuning
    out = np.zeros(at.CONSTANTS)

    def put(place: int, values: Sequence[float] | Float) -> None:
        out[place : place + len(values)] = values

    lead = _lead(settings, plan)
    put(at.C_PERIOD, [T, lead, settings.pilot.threshold_n, T / settings.pilot.blend_s])
    fused = settings.force == ForceMode.FUSED
    for place, name, factor in (
        (at.C_KP, "proportional", 1.0),
        (at.C_KI, "integral_per_s", T),
        (at.C_KD, "derivative_s", 1.0 / T),
    ):
        put(place, [factor * gain for gain in per_direction(name, getattr(settings, name))])
    put(at.C_WITHOUT, [float(settings.compensated), force_delay(settings) if plan is None else 0.0])
    out[at.C_FOLLOW] = settings.delays.follow_s if fused else 0.0
    put(at.C_FUSION, settings.fusion.packed(T))
    out[at.C_TRACKER_LATE] = settings.delays.tracker_s
    out[at.C_TORQUE] = settings.fusion.torque_nm**2 * _TORQUE_MEMORY_S / T
    put(at.C_TRANSLATION, settings.translation.packed())
    put(at.C_ROTATION, settings.rotation.packed())
    share = settings.ramp_m_s / settings.translation.speed
    put(at.C_RAMP, settings.translation.packed() * [1.0, share, 1.0])
    put(at.C_RAMP_ROTATION, settings.rotation.packed() * [1.0, share, 1.0])
    out[at.C_HARD] = settings.hard_factor
    drift = settings.scale_drift**2 * T
    put(at.C_SCALE, [settings.force_noise_n, settings.timing_s / T, drift, _SCALE_VARIANCE])
    put(at.C_GAIN, [tuning.gain, tuning.saturation_m, tuning.saturation_rad])
    put(at.C_DRIFT, [tuning.drift_m**2 * T, tuning.drift_rad**2 * T])
    put(at.C_NOISE, [tuning.noise_m**2, tuning.noise_rad**2])
    put(at.C_JUMP, [tuning.largest_jump_m, settings.off_path_m])
    put(at.C_ANSWER, robot_answer(settings)[1])
    put(at.C_SWING, settings.fusion.swing(T))
    put(at.C_INERTIA, inertia_smoothing(settings).coefficients())
    put(at.C_R_BASE_PART, T_base_part[:3, :3].reshape(-1))
    out[at.C_PROPORTIONAL] = tuning.proportional
    put(at.C_NOTCH, tuning.notch)
    put(at.C_LAG, [*tuning.lag_filter, tuning.lag_most_m])
    put(at.C_AHEAD, [settings.delays.dead_s, settings.delays.correction_s - settings.delays.dead_s])
    return out


def _choices(settings: OnlineSettings, plan: LoopPlan | None) -> Int:
    T, delays = settings.period_s, settings.delays
    tracker = round(delays.tracker_s / T)
    dead, _ = robot_answer(settings)
    ahead = settings.lead_s if settings.force == ForceMode.SCALE else -force_delay(settings)
    back = {
        at.W_NOMINAL_BACK: round((delays.follow_s + delays.tracker_s) / T),
        at.W_CORRECTION_BACK: dead + (0 if settings.force == ForceMode.FUSED else tracker),
        at.W_DEFLECTION_BACK: max(0, round((ahead + delays.tracker_s) / T)),
        at.W_REPORTED_BACK: round(delays.follow_s / T),
    }
    if max(back.values()) >= at.RING_ROWS:
        raise InputError(
            "the delays are longer than the loop remembers",
            value=f"{max(back.values())} cycles",
            limit=f"< {at.RING_ROWS}",
        )
    out = np.zeros(at.CHOICES, dtype=np.int64)
    out[at.W_FORCE], out[at.W_TRACKER] = settings.force, settings.tracker
    out[at.W_COMPENSATED], out[at.W_NORMAL] = settings.compensated, settings.normal_only
    out[at.W_ORIENTATION], out[at.W_PLAN] = settings.orientation, plan is not None
    out[at.W_STALE], out[at.W_LOST] = settings.stale_cycles, settings.lost_cycles
    out[at.W_WINDOW] = _WINDOW
    bridged = plan is not None and settings.force in (ForceMode.PILOT, ForceMode.SCALE)
    out[at.W_BRIDGE] = settings.stale_cycles + (round(settings.bridge_s / T) if bridged else 0)
    out[at.W_AHEAD] = PLAN_A if _shaped(settings, plan) else PLAN_W
    out[at.W_TRACKER_STALE] = max(1, round(settings.fusion.tracker_stale_s / T))
    out[at.W_DISBELIEVED] = settings.fusion.disbelieved
    designed = settings.tracker == TrackerMode.DESIGNED
    out[at.W_LAG] = designed and settings.tuning.undo_lag
    out[at.W_PLAY] = designed and settings.tuning.undo_play and plan is not None and not settings.compensated
    for place, value in back.items():
        out[place] = value
    return out
