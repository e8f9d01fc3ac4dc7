"""The online loop of one cell: owns the arrays of the step and gives them names. Knows no socket, clock or file."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from counterflex.core.array_table import ArrayTable
from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.jit import compile_stated
from counterflex.core.records import Records, as_reals, as_words, attributes, reals_and_words, records
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.kernels.records import STEP, WORK
from counterflex.runtime.cycle import ARRAYS, cycle
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.estimator.fusion import Source
from counterflex.runtime.loop_constants import SCALE_VARIANCE, axis_pid, pack_limits, pack_settings
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.monitoring.monitor import Monitor
from counterflex.runtime.monitoring.override_settings import OverrideSettings
from counterflex.runtime.monitoring.settings import MonitorSettings, unwatched
from counterflex.runtime.primitives.hand import BACK, turned_load
from counterflex.runtime.settings import ForceMode, OnlineSettings, require_for_held_part
from counterflex.runtime.state.loop_record import LOOP
from counterflex.runtime.state.memory_layout import Layout, layout_before, layout_of, put_words
from counterflex.runtime.state.planned import PLAN
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.runtime.step.axis_pid_kernel import PID, PID_STATE
from counterflex.runtime.step.axis_play import PlayCompensation
from counterflex.runtime.step.axis_play_kernel import PLAY, PLAYED
from counterflex.signals.filters import Smoother

_NO_CURRENTS = 10_000
_STATE_S = 4.0
_OFFSET_M2 = (0.5e-3) ** 2
_OFFSET_RAD2 = (5e-3) ** 2


class Loop:
    """One online loop.

    Fill ``given`` (or use :meth:`feed`), call :meth:`run`, read ``result`` or ``correction``. Nothing is allocated in
    :meth:`run`, and nothing compiled: that is done when a loop is made. Not safe to share between threads.

    Args:
        chain: Elastic chain of the cell, calibrated.
        settings: What to do.
        T_base_part: (4, 4) part frame, the frame of all poses.
        plan: Or None: then only a measured force can be corrected, along the feed too.
        monitor: What of the process is watched; None watches all and reacts to nothing.
        override: How the program's speed may be changed; None leaves it alone.
        T_base_tcp: (4, 4) tool frame of a spindle that stands, where the robot holds the part; ``T_base_part`` is not
            looked at then. Forces come from the plan or the sensor, corrections go to the axes.

    Attributes:
        given: Inputs, :data:`counterflex.runtime.state.given.GIVEN`.
        result: Results, :data:`counterflex.runtime.state.result.RESULT`.
        quick_given: The inputs once more, read and written faster (:func:`counterflex.core.records.attributes`).
        quick_result: Likewise the results.
        quick_tests: Likewise what the tests remember.
        step_state: What the step remembers, :data:`counterflex.runtime.state.memory.STATE`.
        tests: What the plausibility tests remember, :data:`counterflex.runtime.state.doubts.MEMORY`.
        inputs: The inputs once more: (56,) numbers and (14,) whole numbers, as the run log has them.
        answers: Likewise the results: (67,) and (13,).
        correction: (6,) view: what to send, m and rotation vector, part axes.
        axes: (6,) view: the same as change of the axis angles, rad.
        monitor: Process monitoring and feed override.
        records: LOOP and PLAN, for a kernel that reads them; ``table``: arrays of a cycle beside them.
        memory: All that the loop remembers from one cycle to the next: its own arrays by name, in fixed order.
        cycles: (1,) view: cycles run so far; ``state_cycles`` is those from one snapshot of its memory to the next.

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
        T_base_tcp: Float | None = None,
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
        self._chain = chain.compact
        m = len(self._chain.stations) - 1
        self._plan = records(PLAN, 2) if plan is None else plan.packed()
        self._loop = loop = records(LOOP)
        self.records: tuple[Records, Records] = loop, self._plan
        self.given, self.result, self.step_state, self.tests = (
            loop[name][0] for name in ("given", "result", "state", "tests")
        )
        self._held = T_base_tcp is not None
        if T_base_tcp is not None:
            require_for_held_part(settings)
            T_base_tcp = as_float("T_base_tcp", T_base_tcp, (4, 4))
        pack_settings(loop["settings"][0], settings, as_float("T_base_part", T_base_part, (4, 4)), plan, T_base_tcp)
        loop["settings"][0].torsion[:] = chain.compliance[chain.torsion, 5]
        pack_limits(loop["limits"][0], settings)
        self.quick_given, self.quick_result, self.quick_tests = (
            attributes(loop[name]) for name in ("given", "result", "tests")
        )
        self.inputs = reals_and_words(loop["given"])
        self.answers = reals_and_words(loop["result"])
        self.correction: Float = self.result.correction
        self.axes: Float = self.result.axes
        self.measured_filter = Smoother(settings.smoothing, 6)
        self.predicted_filter = Smoother(settings.smoothing, 6)
        self._elastic = records(STEP)
        self._frame: Float = np.zeros((m + 1, 12))
        self._delta: Float = np.zeros((m, 6))
        self._work = records(WORK)
        self.monitor = _monitor(settings, self._plan, plan, monitor, override)
        self._axis_play: PlayCompensation | None = None
        if settings.axis_play:
            own = np.array(settings.own_play_rad)
            self._axis_play = PlayCompensation(chain, settings.period_s, contained=settings.compensated, own_rad=own)
        self._axis_pid = axis_pid(settings)
        self._place: Float = self.step_state.place
        self.cycles: Int = self._loop["state"]["cycles"]
        self.state_cycles = max(1, round(_STATE_S / settings.period_s))
        self.table = self._arrays()
        self.memory = self._memory()
        compile_stated("counterflex.runtime.cycle")
        self.reset()

    @property
    def rows(self) -> tuple[Records, Records]:
        """(1,) LOOP and (1,) ARRAYS of :func:`counterflex.runtime.cycle.cycle`, for a kernel that calls it."""
        return self._loop, self.table.rows

    @property
    def holds_part(self) -> bool:
        """Return whether the robot holds the part against a spindle that stands."""
        return self._held

    def on_tool(self, w: Float) -> None:
        """Turn a wrench on the hand about its origin into that on the tool about its tip, part axes, in place.

        Nothing where the robot holds the tool, which is the hand then.

        Args:
            w: (6,) N, N m; changed.
        """
        if self._held:
            turned_load(self._loop["settings"][0], self.given.nominal, w, 0, BACK)

    def reset(self) -> None:
        """Begin anew: IDLE, correction zero, nothing learnt, place on the path unknown; as a loop just made."""
        for array in (self._elastic, self._frame, self._delta, self._work):
            as_words(array)[:] = 0
        for name in ("given", "state", "ring", "result", "tests", "cycle", "work"):
            as_words(self._loop[name])[:] = 0
        state = self.step_state
        state.place[0] = -1.0
        state.scale[:] = 1.0
        state.speed = state.force_at_speed = 1.0
        state.scale_variance[:] = SCALE_VARIANCE
        state.offset_variance[:] = _OFFSET_M2, _OFFSET_RAD2
        self.settings.fusion.begin(state.fusion)
        self.measured_filter.reset(np.zeros(6))
        self.predicted_filter.reset(np.zeros(6))
        self.monitor.reset()
        if self._axis_play is not None:
            self._axis_play.reset()
        if self._axis_pid is not None:
            self._axis_pid.reset()

    def _arrays(self) -> ArrayTable:
        """Arrays of a cycle beside its record."""
        m, p = self.measured_filter, self.predicted_filter
        none = records(PLAY, 0), records(PLAYED, 0), np.zeros(1, dtype=np.int64)
        plays, played, begun = none if self._axis_play is None else self._axis_play.arrays()
        pid = self._axis_pid
        pids, kept = (records(PID, 0), records(PID_STATE, 0)) if pid is None else pid.arrays()
        watched_plan, monitor_settings, monitor_memory = self.monitor.records
        return ArrayTable(
            ARRAYS,
            plan=self._plan,
            stations=self._chain.stations,
            surroundings=self._chain.surroundings,
            regions=self._chain.regions,
            elastic=self._elastic,
            frame=self._frame,
            delta=self._delta,
            work=self._work,
            low_pass=m.coefficients,
            measured_memory=m.memory,
            measured_ring=m.ring,
            measured_place=m.place,
            predicted_memory=p.memory,
            predicted_ring=p.ring,
            predicted_place=p.place,
            plays=plays,
            played=played,
            play_begun=begun,
            pids=pids,
            pid_states=kept,
            watched_plan=watched_plan,
            monitor_settings=monitor_settings,
            monitor_memory=monitor_memory,
        )

    def _memory(self) -> dict[str, np.ndarray[Any, Any]]:
        m, p, play = self.measured_filter, self.predicted_filter, self._axis_play
        own: dict[str, np.ndarray[Any, Any]] = {
            "state": self._loop["state"],
            "ring": as_reals(self._loop["ring"]),
            "result": self._loop["result"],
            "measured.memory": m.memory,
            "measured.ring": m.ring,
            "measured.place": m.place,
            "predicted.memory": p.memory,
            "predicted.ring": p.ring,
            "predicted.place": p.place,
            "elastic": as_reals(self._elastic),
            "frame": self._frame,
            "delta": self._delta,
            "scratch": as_reals(self._work),
            "tests": self._loop["tests"],
        }
        if play is not None:
            own |= {"axis_play.memory": play.memory, "axis_play.begun": play.begun}
        if self._axis_pid is not None:
            own |= {"axis_pid.memory": self._axis_pid.memory}
        return own | self.monitor.memory()

    @property
    def layout(self) -> Layout:
        """Meaning of the words of :attr:`memory`, one array behind the other."""
        return layout_of(self.memory)

    def restore(self, words: Int, layout: Layout) -> None:
        """Remember again what :attr:`memory` held.

        Args:
            words: (n,) its numbers one behind the other, bit for bit as whole numbers of 64 bits.
            layout: What they mean, see :attr:`layout`; empty: as here, or where there are more of them as in logs
                that do not say it.

        Raises:
            InputError: Another loop's: not as many numbers, or others.
        """
        if not layout:
            own = self.layout
            layout = own if words.size == sum(count for _, _, count in own) else layout_before(own)
        put_words(self.memory, words, layout)

    def feed(self, inputs: CycleInputs) -> None:
        """Fill the inputs of a cycle; for tests, replays and experiments."""
        given = self.given
        _put_pose(given.nominal, inputs.T_part_tcp)
        given.q[:] = inputs.q
        if inputs.w_tcp_part is not None:
            given.wrench[:] = inputs.w_tcp_part
        if inputs.T_part_actual is not None:
            _put_pose(given.actual, inputs.T_part_actual)
        if inputs.T_part_reported is not None:
            _put_pose(given.reported, inputs.T_part_reported)
        new = int(inputs.T_part_actual is not None)
        given.tracker_late = -1.0 if inputs.tracker_late_s is None else inputs.tracker_late_s
        given.tracker_sigma = inputs.tracker_sigma_m
        if inputs.torque is not None:
            given.torque[:] = inputs.torque
        self.inputs[1][:] = (
            *(inputs.elapsed, inputs.force_age, new, inputs.tracker_age, inputs.healthy),
            *(inputs.arm, inputs.enable, inputs.stop, inputs.reset, inputs.soft, inputs.hard, inputs.sources),
            *(int(inputs.torque is None) * _NO_CURRENTS, int(inputs.T_part_reported is not None)),
        )

    def run(self) -> None:
        """One cycle."""
        cycle(self._loop, self.table.rows)

    @property
    def compliance(self) -> Float:
        """(36,) view: compliance of the arm at the tip in the last cycle, base axes, by rows."""
        out: Float = self._elastic["compliance"][0]
        return out

    @property
    def in_effect(self) -> Float:
        """(6,) view: correction that the robot has made of what was sent, m and rotation vector, part axes."""
        out: Float = self.step_state.in_effect
        return out

    @property
    def planned_force(self) -> Float:
        """(3,) view: force that the plan expects here, through the filters of the measured one, N, part axes."""
        out: Float = self.step_state.predicted_before[:3]
        return out

    @property
    def planned(self) -> bool:
        """Return whether there is a plan."""
        return bool(self._loop["settings"][0].has_plan)

    @property
    def plan_rows(self) -> int:
        """Rows of the plan; 2 without one."""
        return len(self._plan)

    @property
    def cycle(self) -> int:
        """Cycles run since the start or the last :meth:`reset`; after the first :meth:`run` it is 1."""
        return int(self.cycles[0])

    def sha256(self) -> str:
        """Hash over every number the step is given besides its inputs: two loops that agree in it compute the same."""
        digest = hashlib.sha256()
        m = self.measured_filter
        for array in (
            as_words(self._loop["settings"]),
            as_words(self._loop["limits"]),
            *(as_words(array) for array in (self._plan, *self._chain)),
            m.coefficients,
            np.array(m.ring.shape),
            *self.monitor.numbers(),
            *(() if self._axis_play is None else (as_words(self._axis_play.plays),)),
        ):
            digest.update(f"{array.dtype.str}{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    @property
    def state(self) -> State:
        """State of the supervisor."""
        return State(int(self.result.state))

    @property
    def cause(self) -> Cause:
        """Cause of that state."""
        return Cause(int(self.result.cause))

    @property
    def scale(self) -> Float:
        """(3,) learnt factors of the force: feed, across, along the tool."""
        if self.settings.force == ForceMode.FUSED:
            out: Float = self.step_state.fusion.estimate[:3].copy()
        else:
            out = self.step_state.scale.copy()
        return out

    @property
    def offset(self) -> Float:
        """(6,) deviation that force and plan do not explain, m and rad, part axes."""
        if self.settings.force == ForceMode.FUSED:
            out: Float = self.result.offset.copy()
        else:
            out = self.step_state.offset.copy()
        return out

    @property
    def sources(self) -> Source:
        """Sources of the estimate of the last cycle; none where the loop has no estimator."""
        return Source(int(self.result.sources))

    @property
    def place(self) -> float:
        """Row of the plan, with fraction; -1 unknown."""
        return float(self._place[0] + self._place[1])


def _put_pose(out: Float, T: Float) -> None:
    """Rotation by rows, then position, (12,) written."""
    out[:9] = T[:3, :3].reshape(-1)
    out[9:] = T[:3, 3]


def _monitor(
    settings: OnlineSettings,
    path: Records,
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
