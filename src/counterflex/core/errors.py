"""Errors that carry data.

Every fault a user can cause or meet is a :class:`CounterflexError`. It says what is wrong, which value
broke which limit, where (file, line, key, path point), and what to do about it, and it prints as one line.
"""

from __future__ import annotations

import re
from typing import Any, Final

_NO_SUCH: Final = re.compile(r"\b(unknown|no such|is none of)\b|\bno (robot|material|row|recipe|tool|body)\b")
"""Return the hint of an error about an unknown name; ``limit`` then lists the names."""


class CounterflexError(Exception):
    """Base of all faults raised on purpose.

    Args:
        what: The fault in one sentence, without a full stop.
        where: Place of the fault, for example ``"part.ngc:12:5"`` or ``"cell.toml: robot.catalog"``.
        limit: The limit or the expectation that the value broke.
        hint: What the user can do about it.
        data: Further machine-readable facts (frames that exist, last samples, ...).
    """

    def __init__(
        self,
        what: str,
        *,
        where: str | None = None,
        value: object = None,
        limit: object = None,
        hint: str | None = None,
        **data: Any,
    ) -> None:
        self.what = what
        self.where = where
        self.value = value
        self.limit = limit
        self.hint = hint or _nearest(what, value, limit)
        self.data = data
        super().__init__(self._line())

    def _line(self) -> str:
        parts = [f"{self.where}: {self.what}" if self.where else self.what]
        if self.value is not None:
            parts.append(f"got {self.value}")
        if self.limit is not None:
            parts.append(f"expected {self.limit}")
        line = "; ".join(parts)
        if self.hint:
            line += f". {self.hint}"
        return " ".join(line.split())


def _nearest(what: str, value: object, limit: object) -> str | None:
    """Return a hint to the nearest of the names that are listed, for a name that is none of them."""
    if not (isinstance(value, str) and isinstance(limit, str) and _NO_SUCH.search(what)):
        return None
    from counterflex.core.similar import did_you_mean  # only where a name is wrong

    listed = limit.removeprefix("one of ")
    parts = re.split(r",\s*|\s+or\s+", listed) if "," in listed or " or " in listed else listed.split()
    return did_you_mean(value.strip("'"), [part.strip("'") for part in parts if part])


class InputError(CounterflexError, ValueError):
    """An argument or option is outside what the function can work with."""


class FileFormatError(CounterflexError, ValueError):
    """A file is not of the format, version or content it should be."""


class ProgramError(FileFormatError):
    """A milling program cannot be read exactly: unknown word, bad number, endless loop, unsafe construct."""


class ModelError(CounterflexError, ValueError):
    """A physical model is used outside its range of validity, or its numbers contradict each other."""


class ReachError(CounterflexError, ValueError):
    """A pose cannot be reached: distance, joint limit, wrist or arm singularity."""


class ProtocolError(CounterflexError, ValueError):
    """Bytes from the network are not what the protocol allows, or cannot be made."""


class OutputError(CounterflexError, OSError):
    """A result cannot be written: folder missing, not writable, disk full."""


class Interrupted(CounterflexError, RuntimeError):
    """The user stopped a long job; nothing half-written is left behind."""


class SimulationError(CounterflexError, RuntimeError):
    """The simulated cell left its physical range (instability, NaN, lost equilibrium)."""
