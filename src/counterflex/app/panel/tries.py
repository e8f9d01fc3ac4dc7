"""Tries to log in: counted before a password is hashed, bounded in number, summed up for the run log."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable
from typing import Any, Final

from counterflex.app.panel.door import network_of
from counterflex.core.printable import printable

TRIES: Final = 5
BLOCK_S: Final = 30.0
"""After so many wrong passwords for a name from an address, that name is not tried from there for so long."""
AT_ONCE: Final = 8
"""Passwords that are hashed, or wait for it; half of them from one address."""
PER_S: Final = 8
"""Passwords hashed in a second, of some 50 ms each; half of them from one address."""
REMEMBERED: Final = 1024
"""Names and addresses with wrong passwords. Only what is hashed is counted, so it takes 128 s to push one out."""
_NAME: Final = 24  # Characters of a name that are looked at
NOTE_S: Final = 30.0
"""Refused logins are written into the run log so often at most."""
TOO_MANY: Final = "Too many wrong passwords for this name: wait half a minute."
BUSY: Final = "Too many logins at the moment: try again."


class Tries:
    """Decides which passwords are looked at."""

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._clock_s = clock_s
        self._counted: dict[tuple[str, str], list[float]] = {}
        self._running: Counter[str] = Counter()
        self._recent: deque[tuple[float, str]] = deque()

    def begin(self, source: str, name: str) -> str:
        """Count a try before its password is hashed; :meth:`end` must follow where it may be.

        Returns:
            Empty, or why the password is not looked at.
        """
        now, network = self._clock_s(), network_of(source)
        key = network, name[:_NAME]
        times = [one for one in self._counted.pop(key, ()) if one > now - BLOCK_S]
        if times:
            self._counted[key] = times
        if len(times) >= TRIES:
            return TOO_MANY
        while self._recent and self._recent[0][0] <= now - 1.0:
            self._recent.popleft()
        of_it = sum(one == network for _, one in self._recent)
        if self._running.total() >= AT_ONCE or len(self._recent) >= PER_S:
            return BUSY
        if self._running[network] >= AT_ONCE // 2 or of_it >= PER_S // 2:
            return BUSY
        if len(self._counted) >= REMEMBERED:
            del self._counted[next(iter(self._counted))]
        self._counted[key] = [*times, now]
        self._running[network] += 1
        self._recent.append((now, network))
        return ""

    def end(self, source: str, name: str, *, right: bool) -> None:
        """Count a try as done; a right password is no wrong one."""
        network = network_of(source)
        self._running[network] -= 1
        if self._running[network] <= 0:
            del self._running[network]
        key = network, name[:_NAME]
        if right and key in self._counted:
            self._counted[key].pop()
            if not self._counted[key]:
                del self._counted[key]


class RefusedLogins:
    """Refused logins, summed up: the first at once, then one entry for all of :data:`NOTE_S`.

    Args:
        note: Writes an entry: who was the last, from where, how many.
    """

    def __init__(self, note: Callable[[dict[str, Any]], None], clock_s: Callable[[], float] = time.monotonic) -> None:
        self._note, self._clock_s = note, clock_s
        self._count = 0
        self._last: tuple[str, str] = ("", "")
        self._noted_s = -NOTE_S
        self.total = 0

    def add(self, name: str, source: str) -> None:
        """Count one."""
        self._count += 1
        self.total += 1
        self._last = printable(name[:_NAME]), source
        self.flush()

    def flush(self) -> None:
        """Write what has come together, where it is time."""
        now = self._clock_s()
        if self._count and now - self._noted_s >= NOTE_S:
            who, source = self._last
            text = f"{self._count} since the last entry" if self._count > 1 else "wrong, or too many"
            self._note({"who": who, "from": source, "action": "log in", "done": False, "refused": text})
            self._count, self._noted_s = 0, now
