"""The simulated cell run one controller cycle at a time, so that something outside can correct it while it mills.

What a robot controller would report and what instruments would show is read off after every cycle; corrections enter
before the next. Nothing here knows a protocol: makers' simulated controllers put it on sockets.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.path.toolpath import ToolPath
from counterflex.twin.devices.commanded_motion import CommandedMotion, Report as Report
from counterflex.twin.devices.path_answer import PathAnswer
from counterflex.twin.plant import simulate as simulation
from counterflex.twin.plant.controller import Controller, as_it_is
from counterflex.twin.plant.drives import FollowingLag, following_gains
from counterflex.twin.plant.plant import STEP_S, Plant
from counterflex.twin.plant.process import StockCutting, as_ground
from counterflex.twin.plant.record import Record, SimulatedCycles
from counterflex.twin.truth.truth import Truth

CHANGE_S: Final = 2.0
"""How long the robot stands for a change of tools."""


def true_answer(answer: PathAnswer | None, truth: Truth, cycle_s: float) -> PathAnswer:
    """The response asked for, with the dead time that this controller has beside it."""
    requested = PathAnswer() if answer is None else answer
    kind = truth.other.controller
    return requested if kind is None else replace(requested, dead_s=requested.dead_s + kind.dead_cycles * cycle_s)


@dataclass(eq=False)
class _Log:
    k: list[int] = field(default_factory=list)
    p_base: list[Float] = field(default_factory=list)
    R_base: list[Float] = field(default_factory=list)
    q_ref: list[Float] = field(default_factory=list)
    q_motor: list[Float] = field(default_factory=list)
    sums: list[Float] = field(default_factory=list)
    time: list[float] = field(default_factory=list)


class LiveCell:
    """Robot, drives, process and stock, advanced by one cycle of the controller at a time.

    Args:
        path: Tool path of the program, part frame.
        truth: The cell as it really is.
        controller: What its controller believes.
        stock: Blank.
        cutter: Tool, or tools by their numbers: they are changed where the program says so.
        datum_points_part: (k, 3) m, see :func:`counterflex.twin.plant.simulate.simulate`; None: the part lies where the
            controller has it.
        answer: How the controller answers a correction.
        own_backlash: Share of the true play of its gears that the controller compensates itself, 0 .. 1.5.
        touched: The cell as it was when the robot touched the datum points, where it has drifted since; None: as now.
        step_s: Integration step.

    Attributes:
        plant: The robot in motion; instruments read it.
        T_base_part: (4, 4) where the part truly lies; where the robot holds it, it says nothing.
        period_s: Cycle.
        motion: What its controller commands.
    """

    def __init__(
        self,
        path: ToolPath,
        *,
        truth: Truth,
        controller: Controller,
        stock: HeightMap,
        cutter: Cutter | Mapping[int, Cutter],
        datum_points_part: Float | None = None,
        answer: PathAnswer | None = None,
        own_backlash: float = 0.0,
        touched: Truth | None = None,
        step_s: float = STEP_S,
    ) -> None:
        substeps = round(controller.cycle_s / step_s)
        if substeps < 1 or abs(substeps * step_s - controller.cycle_s) > 1e-9:
            raise InputError("integration step does not divide the controller's cycle", value=step_s)
        self.path, self.controller = path, controller
        if not 0.0 <= own_backlash <= 1.5:
            raise InputError("share of the play that the controller compensates", value=own_backlash, limit="0 .. 1.5")
        own = own_backlash * np.array([drive.dead_band_rad for drive in truth.drives])
        running = as_it_is(replace(controller, following_gain_per_s=None), truth.other.controller)
        self.motion = CommandedMotion(path, running, true_answer(answer, truth, controller.cycle_s), own)
        self.reference = self.motion.reference
        self.plant = Plant(truth, step_s=step_s)
        self.T_base_part, self._residual = as_float("T_base_part", controller.T_base_part, (4, 4)), np.zeros((0, 3))
        if datum_points_part is not None:
            then = self.plant if touched is None else Plant(touched, step_s=step_s)
            self.T_base_part, self._residual = simulation.touched_part_frame(then, controller, datum_points_part)
        blank = simulation.as_delivered(stock, truth.stock_top_offset_m)
        mounted = simulation.mounted_tools(path)
        self._tools: Int = mounted[self.reference.source]
        self._tool = int(self._tools[0])
        self._cutters = {
            int(number): as_ground(
                cutter if isinstance(cutter, Cutter) else cutter[int(number)], truth.other.tool(int(number))
            )
            for number in np.unique(mounted)
        }
        self._change_cycles, self._standing = max(1, round(CHANGE_S / controller.cycle_s)), 0
        self._process = StockCutting(blank, self._cutters[self._tool], truth.cutting, step_s, self.T_base_part)
        widest = max(one.radius_m for one in self._cutters.values())
        self._near = simulation.near_stock(self.reference.p_part_command, blank, widest)
        self._spindle = path.spindle_rad_s[self.reference.source]
        self.period_s, self._substeps = controller.cycle_s, substeps
        self._place, self._speed = simulation.hermite(substeps, controller.cycle_s)
        self._log = _Log()
        self._cycle = 0
        self._turning, self._was_near = np.nan, False
        self._q = self.reference.q_ref[0].copy()
        gains = following_gains(truth.drives, controller.following_gain_per_s)
        self._following = FollowingLag(gains, self.period_s, self._q)
        self._qd: Float = np.zeros(6)
        self._torque: Float = np.zeros(6)
        self.plant.program_time(0.0, self._tool)
        self.plant.reset(self._q, None, self._qd)

    def start(self) -> None:
        """Let the program run."""
        self.motion.running = True

    @property
    def time_s(self) -> float:
        """Simulated time."""
        return self._cycle * self.period_s

    @property
    def finished(self) -> bool:
        """Return whether the program has come to its end."""
        return self.motion.finished

    @property
    def cycles(self) -> int:
        """Cycles that the program takes at full speed."""
        return self.motion.cycles

    @property
    def changing(self) -> bool:
        """Return whether the robot stands for a change of tools; its program takes no correction meanwhile."""
        return self._standing > 0

    def _change(self) -> None:
        """Stand where the next tool of the program begins, and mount it at the end."""
        following = int(self._tools[min(int(self.motion.at) + 1, len(self._tools) - 1)])
        if following == self._tool or not self.motion.running:
            return
        self._standing += 1
        if self._standing > self._change_cycles:
            self._standing, self._tool = 0, following
            self._process.mount(self._cutters[following])
            self._was_near, self._turning = False, np.nan
            self.plant.program_time(int(self.motion.at) * self.period_s, following)

    def skip_to_contact(self, lead_s: float = 0.6) -> None:
        """Put the robot on its path shortly before the tool first comes near the stock (before :meth:`start`)."""
        first = int(np.argmax(self._near)) if self._near.any() else 0
        k = max(0, first - round(lead_s / self.period_s))
        self.motion.at = float(k)
        self._q = self.reference.q_ref[k].copy()
        self._following.reset(self._q)
        self.plant.program_time(k * self.period_s, self._tool)
        self.plant.reset(self._q, None, np.zeros(6))

    def advance(
        self, cartesian: Float, axes: Float | None = None, override: float = 1.0, T_part_guided: Float | None = None
    ) -> Report:
        """Run one cycle with a correction.

        Args:
            cartesian: (6,) correction of the pose, m and rotation vector, in part axes about the commanded tip.
            axes: (6,) rad added to the commanded angles, or None.
            override: Speed of the program, 0 .. 1.
            T_part_guided: (4, 4) where the tool is to be instead of where the program has it, or None.

        Returns:
            What the controller knows afterwards.

        Raises:
            ReachError: The corrected pose cannot be reached.
            SimulationError: The cell left its physical range.
        """
        self._change()
        override = 0.0 if self.changing else override
        before = self.motion.at
        q_nominal, T_part_nominal, q_reported = self.motion.advance(cartesian, axes, override, T_part_guided)
        q_next = self._following(q_reported)
        qd_next = (q_next - self._q) / self.period_s
        self._integrate(int(before), q_next, qd_next)
        self._q, self._qd = q_next, qd_next
        self._cycle += 1
        q_motor = self.plant.q_motor() - self.motion.own_backlash.value  # a controller does not show it
        return Report(
            time_s=self.time_s,
            T_part_nominal=T_part_nominal,
            T_part_actual=self.motion.forward(q_motor),
            q_command=q_nominal,
            q_actual=q_motor,
            cutting_program=self.motion.running and not self.finished,
            finished=self.finished,
            drive_torque=self._torque / self._substeps,
        )

    def record(self) -> Record:
        """Record of the machining so far, as :func:`counterflex.twin.plant.simulate.simulate` gives it."""
        log = self._log
        cycles = SimulatedCycles(
            np.array(log.k, dtype=np.int64),
            *map(np.array, (log.time, log.p_base, log.R_base)),
            *map(np.array, (log.q_ref, log.q_motor, log.sums)),
        )
        return cycles.record(
            self.path,
            self.reference,
            self.motion.poses[cycles.k, :3, :3],
            self._process.finish(),
            self.T_base_part,
            self._residual,
            T_base_tcp=self.controller.T_base_tcp,
        )

    def _integrate(self, k: int, q_next: Float, qd_next: Float) -> None:
        plant, process, fixed = self.plant, self._process, self.controller.T_base_tcp
        log = self._log
        log.k.append(k)
        log.time.append(self.time_s)
        log.p_base.append(plant.p_base_tcp.copy())
        log.R_base.append(plant.R_base_tcp.copy())
        log.q_ref.append(self._q.copy())
        log.q_motor.append(plant.q_motor())
        near = bool(self._near[k]) and self.motion.running
        if near:
            if not self._was_near:
                process.restart(simulation.tip_in_part(plant, process, fixed))
            if self._spindle[k] != self._turning:
                self._turning = self._spindle[k]
                process.spindle(float(self._turning))
            process.advance(simulation.tip_in_part(plant, process, fixed))
        self._was_near = near
        process.clear()
        knots = np.stack([self._q, self._qd, q_next, qd_next])
        q, qd = self._place @ knots, self._speed @ knots
        free = np.zeros(6)
        self._torque = np.zeros(6)
        for i in range(self._substeps):
            plant.step(q[i], qd[i], simulation.load_on_hand(plant, process, fixed) if near else free)
            self._torque += plant.drive_torque
            self.on_step(i)
        log.sums.append(process.sums.copy())
        plant.check()

    def on_step(self, i: int) -> None:
        """Called after integration step ``i`` of a cycle, for instruments that are faster than the controller."""
