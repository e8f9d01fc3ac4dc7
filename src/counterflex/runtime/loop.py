"""The online loop of one cell: owns the arrays of the step and gives them names. Knows no socket, clock or file."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from counterflex.core.array_table import ArrayTable
from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.jit import compile_stated
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.kernels.step import OUT_C, OUT_SIZE, SCRATCH
from counterflex.runtime.cycle import cycle, take_fast
from counterflex.runtime.estimator import fusion_kernel as fk
from counterflex.runtime.estimator.fusion import Source
from counterflex.runtime.loop_constants import SCALE_VARIANCE, pack_choices, pack_constants
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.monitoring.monitor import Monitor
from counterflex.runtime.monitoring.override_settings import OverrideSettings
from counterflex.runtime.monitoring.settings import MonitorSettings, unwatched
from counterflex.runtime.plausibility_stage import PlausibilityStage
from counterflex.runtime.primitives.localize import PLAN_COLUMNS
from counterflex.runtime.settings import ForceMode, OnlineSettings
from counterflex.runtime.state import layout as at
from counterflex.runtime.state.memory_layout import Layout, layout_of, put_words
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.runtime.step.axis_play import AxisPlay
from counterflex.signals.filters import Smoother

_NO_CURRENTS = 10_000
_STATE_S = 4.0
_OFFSET_M2 = (0.5e-3) ** 2
_OFFSET_RAD2 = (5e-3) ** 2


class Loop:
    """One online loop.

    Fill ``given`` and ``flags`` (or use :meth:`feed`), call :meth:`run`, read ``correction``. Nothing is allocated in
    :meth:`run`, and nothing compiled: that is done when a loop is made. Not safe to share between threads.

    Args:
        chain: Elastic chain of the cell, calibrated.
        settings: What to do.
        T_base_part: (4, 4) part frame, the frame of all poses.
        plan: Or None: then only a measured force can be corrected, along the feed too.
        monitor: What of the process is watched; None watches all and reacts to nothing.
        override: How the program's speed may be changed; None leaves it alone.

    Attributes:
        given: (GIVEN,) inputs, see :mod:`counterflex.runtime.state.layout`.
        flags: (FLAGS,) inputs.
        results: (RESULTS,) results.
        outcome: (OUTCOME,) results.
        correction: (6,) view: what to send, m and rotation vector, part axes.
        axes: (6,) view: the same as change of the axis angles, rad.
        settings: As given.
        monitor: Process monitoring and feed override.
        memory: All that the loop remembers from one cycle to the next: its own arrays by name, in fixed order.
        state_cycles: Cycles from one snapshot of its memory to the next, for the record.

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
        monitor = unwatched(settings) if monitor is None else monitor
        if plan is not None and override is not None:
            plan = plan.at_speeds(settings, override, monitor.exponent)
        compact = chain.compact
        m = compact.stations
        self._real, self._kind = compact.real, compact.kind
        self._constants = pack_constants(settings, as_float("T_base_part", T_base_part, (4, 4)), plan)
        self._constants[at.C_TORSION : at.C_TORSION + 6] = chain.compliance[chain.torsion, 5]
        self._choices = pack_choices(settings, plan)
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
        self.plausibility = PlausibilityStage(settings)
        self._axis_play: AxisPlay | None = None
        if settings.axis_play:
            own = np.array(settings.own_play_rad)
            self._axis_play = AxisPlay(chain, settings.period_s, contained=settings.compensated, own_rad=own)
        self.state_cycles = max(1, round(_STATE_S / settings.period_s))
        self._table = self._arrays()
        self.memory = self._memory()
        compile_stated("counterflex.runtime.cycle")
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
        self._state[at.S_VARIANCE : at.S_VARIANCE + 3] = SCALE_VARIANCE
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

    def _arrays(self) -> ArrayTable:
        """All arrays of a cycle in the order of :mod:`counterflex.runtime.cycle`."""
        m, p, play = self.measured_filter, self.predicted_filter, self._axis_play
        none = np.zeros((0, 1)), np.zeros((0, 1)), np.zeros(1, dtype=np.int64)
        return ArrayTable(
            (
                *(self.given, self.flags, self._constants, self._choices, self._supervisor, self._plan),
                *(self._real, self._kind, self._state, self._whole, self._ring),
                *(m.coefficients, m.memory, m.ring, m.place, p.memory, p.ring, p.place),
                *(self._elastic, self._frame, self._delta, self._scratch, self._load),
                *(self.results, self.outcome, self._work),
                *self.plausibility.arrays(),
                *(none if play is None else play.arrays()),
                *self.monitor.records,
            )
        )

    def _memory(self) -> dict[str, np.ndarray[Any, Any]]:
        m, p, play = self.measured_filter, self.predicted_filter, self._axis_play
        own: dict[str, np.ndarray[Any, Any]] = {
            "state": self._state,
            "counts": self._whole,
            "ring": self._ring,
            "results": self.results,
            "outcome": self.outcome,
            "measured.memory": m.memory,
            "measured.ring": m.ring,
            "measured.place": m.place,
            "predicted.memory": p.memory,
            "predicted.ring": p.ring,
            "predicted.place": p.place,
            "elastic": self._elastic,
            "frame": self._frame,
            "delta": self._delta,
            "scratch": self._scratch,
            "load": self._load,
            "work": self._work,
            "plausibility.memory": self.plausibility.memory,
            "plausibility.counts": self.plausibility.counts,
        }
        if play is not None:
            own |= {"axis_play.memory": play.memory, "axis_play.begun": play.begun}
        return own | self.monitor.memory()

    @property
    def layout(self) -> Layout:
        """What the words of :attr:`memory` mean, one array behind the other."""
        return layout_of(self.memory)

    def restore(self, words: Int, layout: Layout) -> None:
        """Remember again what :attr:`memory` held.

        Args:
            words: (n,) its numbers one behind the other, bit for bit as whole numbers of 64 bits.
            layout: What they mean, see :attr:`layout`; empty: as in logs that do not say it.

        Raises:
            InputError: Another loop's: not as many numbers, or others.
        """
        put_words(self.memory, words, layout or self.layout)

    def take(self, samples: Float, count: int, number: int) -> None:
        """Hand over the force sensor's own samples of the cycle, see :meth:`Monitor.take`; before :meth:`run`."""
        take_fast(self._table.rows, samples, count, number)

    def feed(  # noqa: PLR0913 - a keyword for each field of the record that it fills
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
        cycle(self._table.rows)

    @property
    def compliance(self) -> Float:
        """(36,) view: compliance of the arm at the tip in the last cycle, base axes, by rows."""
        return self._elastic[OUT_C : OUT_C + 36]

    @property
    def in_effect(self) -> Float:
        """(6,) view: correction that the robot has made of what was sent, m and rotation vector, part axes."""
        return self._state[at.S_IN_FORCE : at.S_IN_FORCE + 6]

    @property
    def planned_force(self) -> Float:
        """(3,) view: force that the plan expects here, through the filters of the measured one, N, part axes."""
        return self._state[at.S_BEFORE : at.S_BEFORE + 3]

    @property
    def planned(self) -> bool:
        """Whether there is a plan."""
        return bool(self._choices[at.W_PLAN])

    @property
    def plan_rows(self) -> int:
        """Rows of the plan; 2 without one."""
        return len(self._plan)

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
    monitor: MonitorSettings,
    override: OverrideSettings | None,
) -> Monitor:
    if abs(monitor.period_s - settings.period_s) > 1e-9:
        raise InputError("the monitor has another cycle", value=monitor.period_s, limit=settings.period_s)
    watched = None if plan is None else plan.watched(monitor)
    if watched is not None and plan is not None and plan.speed is not None:
        watched["speed"] = plan.speed
    return Monitor(monitor, override, path, watched, settings.off_path_m, settings.translation.radius)
