"""Watches the telegrams themselves: late ones in a row and in a window, clocks that part, answers that are not ours.

The controller is the judge of what it used: where it counts late answers (``Delay`` of RSI) that count is taken, else
the gaps in its counter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import InputError
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


class TelegramWatch:
    """Judges one session's telegrams, cycle by cycle.

    Args:
        period_s: Cycle of the controller.
        settings: See :class:`WatchSettings`.

    Attributes:
        good: Telegrams in a row without a gap.
        late_in_a_row: Answers that the controller did not get in time, up to the newest telegram.
        clock_jumps: How often the clocks parted.
        unexplained: Cycles that we did not answer and that the controller does not count as late.
    """

    def __init__(self, period_s: float, settings: WatchSettings | None = None) -> None:
        self.settings = settings if settings is not None else WatchSettings()
        self._period_ns = round(period_s * 1e9)
        self._late = [0] * WINDOW
        self._lates = 0
        self._place = 0
        self._recent = [0] * _SETTLED
        self._floors = [0] * _CLOCK_SPAN
        self._known = self._ahead = 0
        self._parted = False
        self._count = UNKNOWN
        self.good = self.late_in_a_row = self.clock_jumps = self.unexplained = 0

    @property
    def share_late(self) -> float:
        """Share 0..1 of late cycles within the window."""
        return self._lates / WINDOW

    def restart(self) -> None:
        """The controller began another session: its counts mean something else."""
        self._known, self._ahead, self._parted, self._count = 0, 0, False, UNKNOWN
        self.good = self.late_in_a_row = self.unexplained = 0

    def silent(self, malformed_in_a_row: int) -> tuple[int, int]:
        """A cycle without a telegram.

        Args:
            malformed_in_a_row: Unreadable ones since the last good one.

        Returns:
            Causes of a hold and of a fault, or 0.
        """
        self.good = 0
        return self._judge(malformed_in_a_row, 0, 0)

    def received(
        self,
        elapsed: int,
        counter_ms: int,
        now_ns: int,
        late_count: int,
        malformed_in_a_row: int,
        *,
        answered: bool = True,
        repeated: int = 0,
    ) -> tuple[int, int]:
        """A telegram came.

        Args:
            elapsed: Cycles since the one before, by the controller's counter; 1 when none was lost.
            counter_ms: The controller's counter.
            now_ns: This computer's monotonic clock when it was received.
            late_count: The controller's count of late answers, or :data:`UNKNOWN`.
            malformed_in_a_row: Unreadable ones since the last good one.
            answered: The telegram before was answered; where the loop keeps silent on purpose, nothing is late.
            repeated: Telegrams since the one before that could not be read and were answered all the same.

        Returns:
            Causes of a hold and of a fault, or 0.
        """
        lost = elapsed - 1
        late = lost
        soft = hard = 0
        if answered and late_count != UNKNOWN and self._count != UNKNOWN:
            risen = late_count - self._count
            late = min(elapsed, risen if risen >= 0 else late_count)
            if late < lost:
                self.unexplained += max(0, lost - late - repeated)
                late = lost
                if self.unexplained >= _UNEXPLAINED:
                    hard = _FOREIGN_PEER
            elif lost > 0:
                self.unexplained = 0
        self._count = late_count
        self.late_in_a_row = self.late_in_a_row + elapsed if late >= elapsed else late
        for k in range(min(WINDOW, elapsed)):
            now, place = int(k < late), self._place
            self._lates += now - self._late[place]
            self._late[place], self._place = now, (place + 1) % WINDOW
        self.good = self.good + 1 if lost == 0 else 0
        if self.settings.clock and self._clocks_part(now_ns - counter_ms * 1_000_000):
            soft = _CLOCK
        return self._judge(malformed_in_a_row, soft, hard)

    def _judge(self, malformed: int, soft: int, hard: int) -> tuple[int, int]:
        settings = self.settings
        if malformed >= settings.malformed_fault:
            hard = hard or _TELEGRAM_MALFORMED
        elif malformed >= settings.malformed_hold:
            soft = soft or _TELEGRAM_MALFORMED
        if self.late_in_a_row >= settings.fault_late:
            hard, soft = hard or _TELEGRAMS_LATE, soft or _TELEGRAMS_LATE
        elif self.late_in_a_row >= settings.hold_late:
            soft = soft or _TELEGRAMS_LATE
        if self._lates > settings.share_late * WINDOW:
            soft = soft or _TELEGRAMS_SCATTERED
        return soft, hard

    def _clocks_part(self, offset_ns: int) -> bool:
        """Return whether the clocks moved apart too far: at once, or against where they stood up to a second ago."""
        # A telegram can be late and never early. So the clocks' offset is the least ``clock - counter`` of the last ten
        # telegrams, and no late one is ever the reference. One that lies above it is told once; it is the clock and no
        # late telegram when ten in a row do. One that lies below it is the clock at once, after the first ten.
        most = self.settings.clock_cycles * self._period_ns
        known, recent, floors = self._known, self._recent, self._floors
        if known == 0:
            recent[:] = [offset_ns] * _SETTLED
            floors[0], self._known = offset_ns, 1
            return False
        floor = floors[(known - 1) % _CLOCK_SPAN]
        recent[known % _SETTLED] = offset_ns
        if offset_ns > floor + most:
            self._ahead += 1
            if self._ahead >= _SETTLED:
                self._anew(min(recent))
                self.clock_jumps += 1
                return False  # told when it began
        else:
            self._ahead = 0
            if offset_ns < floor - most and known >= _SETTLED:
                self._anew(offset_ns)
                self.clock_jumps += 1
                return True
        now = min(recent)
        if known < _SETTLED and offset_ns < floors[0] - most / 2.0:  # the first ones were late
            floors[:known] = [now] * known
        oldest = floors[known % _CLOCK_SPAN if known >= _CLOCK_SPAN else 0]
        parted = abs(now - oldest) > most
        self.clock_jumps += int(parted and not self._parted)
        self._parted = parted
        floors[known % _CLOCK_SPAN] = now
        self._known = known + 1
        return parted or self._ahead == 1

    def _anew(self, offset_ns: int) -> None:
        """Forget the drift of the clocks."""
        self._recent[:] = [offset_ns] * _SETTLED
        self._floors[:_SETTLED] = [offset_ns] * _SETTLED
        self._known, self._ahead, self._parted = _SETTLED, 0, False


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
