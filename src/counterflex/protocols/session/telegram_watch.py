"""Watches the telegrams themselves: late ones in a row and in a window, clocks that part, answers that are not ours.

The controller is the judge of what it used: where it counts late answers (``Delay`` of RSI) that count is taken, else
the gaps in its counter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, attributes, record, records
from counterflex.protocols.robot.port import Counters
from counterflex.runtime.state.supervisor import Cause
from counterflex.runtime.step.place import FAULT_LOST

WINDOW: Final = 125
"""Cycles over which scattered losses are counted: 500 ms at 4 ms."""
UNKNOWN: Final = -1
"""In place of the controller's count where it sends none."""
_CLOCK_SPAN: Final = 250
_SETTLED: Final = 10
"""Telegrams of which the earliest tells the clocks' offset: a line that is late for longer has lost its controller."""
_CLOCK: Final = int(Cause.CLOCK)
_FOREIGN_PEER: Final = int(Cause.FOREIGN_PEER)
_TELEGRAMS_LATE: Final = int(Cause.TELEGRAMS_LATE)
_TELEGRAMS_SCATTERED: Final = int(Cause.TELEGRAMS_SCATTERED)
_TELEGRAM_MALFORMED: Final = int(Cause.TELEGRAM_MALFORMED)
_UNEXPLAINED: Final = 3
_NOBODY: Final = -1


@dataclass(frozen=True)
class WatchSettings:
    """Limits beyond which telegrams are no longer good enough."""

    hold_late: int = 3  # answers in a row that the controller did not get in time, for a hold
    fault_late: int = 10  # likewise, for a fault
    share_late: float = 0.10  # share of late ones within WINDOW above which it holds
    malformed_hold: int = 3  # unreadable telegrams in a row for a hold
    malformed_fault: int = 10  # likewise, for a fault
    # cycles by which this computer's clock and the controller's counter may part within a second
    clock_cycles: float = 2.0
    clock: bool = True  # compare them; off where the controller waits for every answer

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            InputError: A number is out of range.
        """
        if not 1 <= self.hold_late <= self.fault_late or not 1 <= self.malformed_hold <= self.malformed_fault:
            raise InputError("cycles of a hold and of a fault", limit="1 <= hold <= fault")
        if not 0.0 < self.share_late < 1.0 or not self.clock_cycles > 0.0:
            raise InputError("share of late answers, or parting of clocks", value=(self.share_late, self.clock_cycles))


WATCH: Final = record(
    share_late=float,
    clock_ns=float,  # by which clock and counter may part
    count=float,  # the controller's, of late answers
    recent=(float, _SETTLED),  # ns, clock less counter
    floors=(float, _CLOCK_SPAN),  # ns, least of the recent ones
    hold_late=int,
    fault_late=int,
    malformed_hold=int,
    malformed_fault=int,
    clock=int,  # 1: compare them
    good=int,  # telegrams in a row without a gap
    late_in_a_row=int,  # answers that the controller did not get in time, up to the newest telegram
    clock_jumps=int,  # how often the clocks parted
    unexplained=int,  # cycles that we did not answer and that the controller does not count as late
    lates=int,  # late cycles within the window
    place=int,
    late=(int, WINDOW),
    known=int,  # telegrams whose clocks were compared
    ahead=int,  # of them in a row, late against all before
    parted=int,
)
"""Settings, and what is known of the telegrams. Numbers that a telegram says are floats: a damaged one says any."""


@kernel("void(Watch, float64)", Watch=WATCH)
def _anew(w: Record, offset_ns: float) -> None:
    """Forget the drift of the clocks."""
    w.recent[:] = offset_ns
    w.floors[:_SETTLED] = offset_ns
    w.known, w.ahead, w.parted = _SETTLED, 0, 0


@kernel("boolean(Watch, float64)", Watch=WATCH)
def _clocks_part(w: Record, offset_ns: float) -> bool:
    """Return whether the clocks moved apart too far: at once, or against where they stood up to a second ago."""
    # A telegram can be late and never early. So the clocks' offset is the least ``clock - counter`` of the last ten
    # telegrams, and no late one is ever the reference. One that lies above it is told once; it is the clock and no
    # late telegram when ten in a row do. One that lies below it is the clock at once, after the first ten.
    most, known = w.clock_ns, w.known
    if known == 0:
        w.recent[:] = offset_ns
        w.floors[0], w.known = offset_ns, 1
        return False
    floor = w.floors[(known - 1) % _CLOCK_SPAN]
    w.recent[known % _SETTLED] = offset_ns
    now = offset_ns
    for recent in w.recent:
        now = min(now, recent)
    if offset_ns > floor + most:
        w.ahead += 1
        if w.ahead >= _SETTLED:
            _anew(w, now)
            w.clock_jumps += 1
            return False  # told when it began
    else:
        w.ahead = 0
        if offset_ns < floor - most and known >= _SETTLED:
            _anew(w, offset_ns)
            w.clock_jumps += 1
            return True
    if known < _SETTLED and offset_ns < w.floors[0] - most / 2.0:  # the first ones were late
        w.floors[:known] = now
    oldest = w.floors[known % _CLOCK_SPAN if known >= _CLOCK_SPAN else 0]
    parted = abs(now - oldest) > most
    w.clock_jumps += int(parted and w.parted == 0)
    w.parted = int(parted)
    w.floors[known % _CLOCK_SPAN] = now
    w.known = known + 1
    return bool(parted or w.ahead == 1)


@kernel("UniTuple(int64, 2)(Watch, int64, int64, int64)", Watch=WATCH)
def _judge(w: Record, malformed: int, soft: int, hard: int) -> tuple[int, int]:
    if malformed >= w.malformed_fault:
        hard = hard or _TELEGRAM_MALFORMED
    elif malformed >= w.malformed_hold:
        soft = soft or _TELEGRAM_MALFORMED
    if w.late_in_a_row >= w.fault_late:
        hard, soft = hard or _TELEGRAMS_LATE, soft or _TELEGRAMS_LATE
    elif w.late_in_a_row >= w.hold_late:
        soft = soft or _TELEGRAMS_LATE
    if w.lates > w.share_late * WINDOW:
        soft = soft or _TELEGRAMS_SCATTERED
    return soft, hard


@kernel("UniTuple(int64, 2)(Watch[::1], int64)", Watch=WATCH, entry=True)
def silent(watches: Records, malformed: int) -> tuple[int, int]:
    """Judge a cycle without a telegram.

    Args:
        watches: (1,) :data:`WATCH`.
        malformed: Unreadable ones since the last good one.

    Returns:
        Causes of a hold and of a fault, or 0.
    """
    w = watches[0]
    w.good = 0
    return _judge(w, malformed, 0, 0)


@kernel("UniTuple(int64, 2)(Watch[::1], int64, float64, float64, int64, boolean, int64)", Watch=WATCH, entry=True)
def received(
    watches: Records, elapsed: int, offset_ns: float, count: float, malformed: int, answered: bool, repeated: int
) -> tuple[int, int]:
    """Judge a telegram that came.

    Args:
        watches: (1,) :data:`WATCH`.
        elapsed: Cycles since the one before, by the controller's counter; 1 when none was lost.
        offset_ns: This computer's monotonic clock when it was received, less the controller's counter.
        count: The controller's count of late answers, or :data:`UNKNOWN`.
        malformed: Unreadable ones since the last good one.
        answered: The telegram before was answered; where the loop keeps silent on purpose, nothing is late.
        repeated: Telegrams since the one before that could not be read and were answered all the same.

    Returns:
        Causes of a hold and of a fault, or 0.
    """
    w, lost = watches[0], elapsed - 1
    late = lost
    soft = hard = 0
    if answered and count != UNKNOWN and w.count != UNKNOWN:
        risen = count - w.count
        late = int(min(float(elapsed), risen if risen >= 0.0 else count))
        if late < lost:
            w.unexplained += max(0, lost - late - repeated)
            late = lost
            if w.unexplained >= _UNEXPLAINED:
                hard = _FOREIGN_PEER
        elif lost > 0:
            w.unexplained = 0
    w.count = count
    w.late_in_a_row = w.late_in_a_row + elapsed if late >= elapsed else late
    for k in range(min(WINDOW, elapsed)):
        now, place = int(k < late), w.place
        w.lates += now - w.late[place]
        w.late[place], w.place = now, (place + 1) % WINDOW
    w.good = w.good + 1 if lost == 0 else 0
    if w.clock == 1 and _clocks_part(w, offset_ns):
        soft = _CLOCK
    return _judge(w, malformed, soft, hard)


@kernel("void(Watch)", Watch=WATCH)
def restart(w: Record) -> None:
    """The controller began another session: its counts mean something else."""
    w.known = w.ahead = w.parted = w.good = w.late_in_a_row = w.unexplained = 0
    w.count = UNKNOWN


class TelegramWatch:
    """What is known of one session's telegrams, for :func:`silent` and :func:`received`.

    Args:
        period_s: Cycle of the controller.
        settings: See :class:`WatchSettings`.

    Attributes:
        records: (1,) :data:`WATCH`; ``now`` are the same numbers, read and written faster.
    """

    def __init__(self, period_s: float, settings: WatchSettings | None = None) -> None:
        chosen = settings if settings is not None else WatchSettings()
        self.records = records(WATCH)
        self.now: Any = attributes(self.records)
        self.now.clock_ns = chosen.clock_cycles * round(period_s * 1e9)
        for name in ("share_late", "hold_late", "fault_late", "malformed_hold", "malformed_fault", "clock"):
            setattr(self.now, name, getattr(chosen, name))
        self.now.count = UNKNOWN

    @property
    def share_late(self) -> float:
        """Share 0..1 of late cycles within the window."""
        return float(self.now.lates / WINDOW)


class AnotherSession:
    """Sees that the controller's computer sends from another port, others or not, while the answered session is silent.

    Args:
        counters: Of the robot's link.
    """

    def __init__(self, counters: Counters) -> None:
        self._counters, self._before = counters, counters.moved

    def heard(self) -> None:
        """The session that is answered still sends."""
        self._before = self._counters.moved

    def port(self, silent_cycles: int) -> int:
        """Its port; 0: there is none.

        Args:
            silent_cycles: Cycles without a telegram of the session that is answered.
        """
        counters = self._counters
        if silent_cycles < FAULT_LOST or counters.moved - self._before < FAULT_LOST:
            return 0
        known = counters.sender != _NOBODY and counters.sender & 0xFFFF != counters.moved_port
        return counters.moved_port if known else 0
