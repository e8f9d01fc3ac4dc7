"""The loop's side of a story: settings, session and log."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MS
from counterflex.files.cell.online import OnlineTable
from counterflex.files.logs.place import trouble_message
from counterflex.protocols.session.senses import Sensing
from counterflex.protocols.session.session import OnlineSession, SessionChecks
from counterflex.protocols.tracker.link import TrackerLink
from counterflex.runtime.loop import Loop
from counterflex.runtime.plausibility.axis_check import AxisCheck
from counterflex.runtime.record_ring import RecordRing
from counterflex.runtime.replay import Replay
from counterflex.runtime.settings import Delays, ForceMode, ForceOffset, Lost, OnlineSettings, Output, TrackerMode
from counterflex.runtime.state_slots import LoopState
from counterflex_lab.composed import bench, holder, motors
from counterflex_lab.composed.controllers import GUIDED, JOB, Controller
from counterflex_lab.composed.story import Active, Story
from counterflex_lab.composed.wires import VirtualInbox, VirtualWire
from counterflex_lab.devices import COUNTS, EgmForce, EgmLink, NetftLink, Scaling
from counterflex_lab.faults.demonstration import demo_cell

OWN_RANGE_N: Final = 2000.0
"""Of the robot's own force sensor."""
_NO_SPACE: Final = 28
_FORCES: Final = {
    "measured": ForceMode.MEASURED,
    "measured-plan": ForceMode.MEASURED,
    "measured-axes": ForceMode.MEASURED,
    "measured-integrator": ForceMode.MEASURED,
    "pilot": ForceMode.PILOT,
    "pilot-observer": ForceMode.PILOT,
    "scale": ForceMode.SCALE,
    "integrator": ForceMode.NONE,
    "fused": ForceMode.FUSED,
    "fused-tracker": ForceMode.FUSED,
}
_TRACKERS: Final = {
    "measured-integrator": TrackerMode.INTEGRATOR,
    "pilot-observer": TrackerMode.OBSERVER,
    "integrator": TrackerMode.INTEGRATOR,
}


def settings_of(story: Story) -> OnlineSettings:
    """Settings of the loop, of its cycle as a cell file has them."""
    period_ms: Any = round(story.period_s / MS)
    of_cycle = OnlineTable(period_ms=period_ms).settings(None, compensated=False)
    settings = OnlineSettings(
        period_s=of_cycle.period_s,
        smoothing=of_cycle.smoothing,
        supervisor=of_cycle.supervisor,
        delays=GUIDED if story.link == "egm-pose" else Delays(),
        force=_FORCES[story.mode],
        tracker=_TRACKERS.get(story.mode, TrackerMode.NONE),
        normal_only=story.planned,
        tracker_lost=Lost[story.tracker_lost.upper()],
        force_offset=ForceOffset[story.force_offset.upper()],
        output=Output.AXES if story.mode.endswith("axes") else Output.CARTESIAN,
    )
    return holder.with_uncertainty(settings, story.seed) if story.has("strain-silent") else settings


def loop_of(story: Story) -> Loop:
    """The loop of a story."""
    deeper = next((fault.size for fault in story.faults if fault.kind == "plan-deeper"), 0.0)
    plan = bench.plan(round(deeper, 6)) if story.planned else None
    return Loop(demo_cell().chain, settings_of(story), bench.program().T_base_part, plan)


def opened(
    story: Story,
    controller: Controller,
    wire: VirtualWire,
    force: VirtualInbox,
    tracker: VirtualInbox,
    ring: RecordRing,
    control: Int,
    clock_ns: Callable[[], int],
) -> OnlineSession:
    """A session, its loop at the beginning."""
    loop = loop_of(story)
    link = controller.link(wire, clock_ns)
    angles = AxisCheck(
        demo_cell().controller_chain, bench.program().T_base_part, loop.settings.period_s, OnlineTable().axis_tolerance
    )
    checks = SessionChecks(
        hold_without_log=story.without_log == "hold", hold_without_panel=story.without_panel == "hold", job=JOB
    )
    senses: dict[str, Any] = {"angles": angles}
    if story.has("strain-silent"):
        senses |= holder.opened(story.seed, force, checks)
    elif story.has("force-short") and isinstance(link, EgmLink):
        senses |= {"force": EgmForce(link, range_n=OWN_RANGE_N), "wrench": bench.wrench()}
    elif story.forced:
        scaling = Scaling(1.0 / COUNTS, 1.0 / COUNTS, 1000, "Net F/T")
        senses |= {"force": NetftLink(("192.168.0.20", 49152), scaling, inbox=force), "wrench": bench.wrench()}
    if story.currents:
        senses["currents"] = motors.read_back()
    if story.tracked:
        senses |= {
            "tracker": TrackerLink("192.168.0.1", 5000, inbox=tracker),
            "T_part_tracker": np.eye(4),
            "T_target_tcp": np.eye(4),
        }
    session = OnlineSession(
        link, loop, sensing=Sensing(**senses), ring=ring, control=control, checks=checks, clock_ns=clock_ns
    )
    loop.run()
    loop.reset()
    return session


class Others:
    """The other processes of the run, as :class:`counterflex.protocols.processes.living.Living` sees them."""

    def __init__(self) -> None:
        self.dead = False

    def gone(self) -> bool:
        """Return whether one of them has died."""
        return self.dead


class KeptLog:
    """A log on a disk that may be full: what it takes is computed again at once and compared.

    Args:
        story: Of the cell.
        active: Faults that act.

    Attributes:
        written: Records.
        lost: Records that were not.
        trouble_number: Of the disk.
        replay: What came of computing them again.
    """

    def __init__(self, story: Story, active: Active) -> None:
        self._active = active
        self.written = self.lost = self.trouble_number = 0
        self.replay = Replay(loop_of(story))
        self._states: list[LoopState] = []

    @property
    def trouble(self) -> str:
        """In words."""
        return trouble_message(self.trouble_number)

    def add(self, rows: Float, *, state: LoopState | None = None) -> None:
        """Take records."""
        full = "disk-full" in self._active.now
        self.trouble_number = _NO_SPACE if full else 0
        if full:
            self.lost += len(rows)
            return
        self.written += len(rows)
        if len(rows) or state is not None:
            self.replay(rows, () if state is None else (state,))

    def note(self, facts: Mapping[str, Any]) -> None:
        """Nothing is noted."""

    def close(self) -> None:
        """All was computed again as it came."""

    def leave(self) -> None:
        """Nothing stays of it."""
