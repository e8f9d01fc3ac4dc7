"""The one call of a cycle, for a session whose link and sensors are compiled: what it is set to, and what it leaves."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

import numpy as np

from counterflex.core.array_table import ArrayTable
from counterflex.core.entry_calls import address_of
from counterflex.core.records import Records, attributes, records
from counterflex.protocols.processes.last_answer import LastAnswer, fill_answer
from counterflex.protocols.robot.compiled_link import DRAINED, CompiledForce, CompiledLink
from counterflex.protocols.robot.link import RobotLink
from counterflex.protocols.robot.wire import UdpWire
from counterflex.protocols.session import whole_kernel as own
from counterflex.protocols.session.senses import Sensing
from counterflex.protocols.system.datagrams import INBOX
from counterflex.protocols.tracker.drain_kernel import ARRAYS as TRACKER_ARRAYS
from counterflex.protocols.tracker.link import TrackerLink
from counterflex.runtime.plausibility.axis_check import ABSENT

_NOT_CHANGED: Final = ("plan", "watched_plan", "samples", "control", *INBOX)
"""Large arrays that a cycle only reads, and those that other processes see."""


class WholeCycle:
    """Calls the kernel, see :mod:`.whole_kernel`.

    Args:
        link: The robot's.
        robot: Its compiled side.
        force: Likewise of the force sensor, or None: there is none.
        tables: Of the kernels of a cycle and of the senses, then those whose arrays they change.
        axes: The correction goes to the axes.

    Attributes:
        link: As given, and force: with what the one call needs of them.
        now: Numbers of the call, :data:`.whole_kernel.WHOLE`.
        drained: What the force sensor's drain has found, :data:`.compiled_link.DRAINED`.
    """

    def __init__(
        self,
        link: RobotLink,
        robot: CompiledLink,
        sensing: Sensing,
        force: CompiledForce | None,
        tables: Sequence[ArrayTable],
        *,
        axes: bool,
    ) -> None:
        whole, drained = records(own.WHOLE), records(DRAINED)
        self.now: Any = attributes(whole)
        self.drained: Any = attributes(drained)
        self.link: Any = link
        self.force: Any = sensing.force
        self._port = robot.port
        wire, tracker, now = robot.port.wire, sensing.tracker, self.now
        assert isinstance(wire, UdpWire)
        now.fd, now.force_fd, now.tracker_fd = wire.target, -1, -1
        now.read, now.read_table = robot.read, robot.read_table.rows.ctypes.data
        now.answer, now.answer_table = robot.answer, robot.answer_table.rows.ctypes.data
        now.fill_kept, now.reports, now.axes = address_of(fill_answer), int(robot.reports), int(axes and robot.axes)
        now.commanded_is = link.commanded_is
        now.measured_is = ABSENT if sensing.angles is None else link.measured_is
        tables = [*tables, robot.read_table, robot.answer_table, *self._sensors(force, tracker)]
        poses = records(TRACKER_ARRAYS) if tracker is None else tables[-1].rows
        self._arrays: dict[str, np.ndarray[Any, Any]] = {
            "whole": whole,
            "cycle": tables[0].rows,
            "senses": tables[1].rows,
            "telegram": robot.telegram,
            "drained": drained,
            "tracker": poses,
            "kept": np.zeros((0, 0)),
            "kept_number": np.zeros(1, dtype=np.int64),
            **wire.arrays(),
        }
        self._window: Any = attributes(wire.window)
        self._held: tuple[Any, ...] = tuple(tables)  # stay where they are
        self._blocks(tables)
        self._table = ArrayTable(own.ARRAYS, **self._arrays)
        self._rehearsal = self._of_rehearsal()

    def _sensors(self, force: CompiledForce | None, tracker: TrackerLink | None) -> list[ArrayTable]:
        """Tables of the sensors' drains; their sockets are written."""
        now, tables = self.now, []
        if force is not None:
            now.drain, now.drain_table, now.force_fd = force.drain, force.table.rows.ctypes.data, force.fd
            tables.append(force.table)
        if tracker is not None:
            now.tracker_fd, table = tracker.compiled()
            tables.append(table)
        return tables

    def _blocks(self, tables: Iterable[ArrayTable]) -> None:
        """List all memory that a cycle changes."""
        changed = [self._arrays[name] for name in ("telegram", "drained")]
        for table in tables:
            changed += [array for name, array in table.arrays.items() if name not in _NOT_CHANGED]
        blocks: dict[int, int] = {}
        for array in changed:
            if array.nbytes and array.itemsize % 8 == 0:
                blocks[array.ctypes.data] = max(array.nbytes // 8, blocks.get(array.ctypes.data, 0))
        self._arrays["blocks"] = np.array(sorted(blocks.items()), dtype=np.int64)
        self._arrays["undone"] = np.zeros(sum(blocks.values()), dtype=np.int64)

    def _of_rehearsal(self) -> ArrayTable:
        """Table of a rehearsal: without what other processes see."""
        cycle = self._arrays["cycle"].copy()
        control = np.zeros(int(cycle["control"]["rows"][0]), dtype=np.int64)
        cycle["control"]["place"] = control.ctypes.data
        self._held = *self._held, control
        whole = records(own.WHOLE)
        return ArrayTable(own.ARRAYS, **self._arrays | {"whole": whole, "cycle": cycle})

    def rehearse(self) -> None:
        """Make the last cycle once more, and undo it."""
        own.rehearse(self._table.rows, self._rehearsed())

    def _rehearsed(self) -> Records:
        """(1,) table of a rehearsal, with the numbers of the last cycle."""
        arrays = self._rehearsal.arrays
        arrays["whole"][:] = self._arrays["whole"]
        for name, value in (("taken", 1), ("fd", -1), ("keeps", 0)):
            arrays["whole"][name] = value
        return self._rehearsal.rows

    def keep(self, last: LastAnswer) -> None:
        """Keep each answer for the next loop."""
        self.now.keeps = 1
        self._arrays |= {"kept": last.memory, "kept_number": last.number}
        self._table = ArrayTable(own.ARRAYS, **self._arrays)

    def run(self, timeout_s: float) -> int:
        """Wait and answer; returns as :func:`.whole_kernel.await_and_answer`."""
        self.now.timeout_ns, self.now.sender = int(timeout_s * 1e9), self._port.sender
        rehearsal = self._rehearsed() if self._window.most_ns else self._rehearsal.rows  # else there is none
        return int(own.await_and_answer(self._table.rows, rehearsal))


def whole_cycle(
    link: RobotLink,
    sensing: Sensing,
    tables: Sequence[ArrayTable],
    clock_ns: Callable[[], int],
    *,
    direct: bool,
    axes: bool,
) -> WholeCycle | None:
    """The one call of a session's cycle; None where part of the cycle needs Python.

    Args:
        tables: See :class:`WholeCycle`, and ``axes``.
        clock_ns: Of the session: the call reads the monotonic clock itself.
        direct: The force sensor's reading becomes the wrench in compiled code.
    """
    robot = getattr(link, "compiled", lambda: None)()
    force = None if sensing.force is None else getattr(sensing.force, "compiled", lambda: None)()
    if robot is None or clock_ns is not time.monotonic_ns:
        return None
    if not isinstance(robot.port.wire, UdpWire) or robot.port.wire.target < 0:
        return None
    if sensing.tools is not None or sensing.currents is not None:
        return None
    if sensing.force is not None and (force is None or not direct):
        return None
    if sensing.tracker is not None and sensing.tracker.compiled()[0] < 0:
        return None
    return WholeCycle(link, robot, sensing, force, tables, axes=axes)
