"""Acts of operators during a run, for the recorder, in shared memory: who, from where, what, and what came of it.

Two lanes, one for the panel and one for the command line, each written by one side. Needs no more than Python itself.
An entry is a short text with a check sum; what is not whole is not taken. Whoever writes waits for nobody.
"""

from __future__ import annotations

import contextlib
import json
import time
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from counterflex.core.errors import InputError
from counterflex.protocols.processes.shared_words import SharedWords

PANEL_LANE, COMMAND_LANE = range(2)
_LANES: Final = 2
_SUFFIX: Final = "-actions"
_ENTRIES: Final = 64
_TEXT: Final = 28
"""Numbers of 64 bits that hold the text: 224 bytes."""
_ENTRY: Final = 4 + _TEXT  # number, time, size, check
_LANE: Final = 1 + _ENTRIES * _ENTRY  # count
WORDS: Final = _LANES * _LANE
_LONGEST: Final = 8 * _TEXT
_KEPT: Final = 40
"""Characters of a value that is too long with the others."""


def actions_path(words: Path) -> Path:
    """Path of the actions of a run, by the path of its shared numbers."""
    return words.with_name(words.name + _SUFFIX)


class Actions:
    """Actions of one run.

    Args:
        path: Of the memory, see :func:`actions_path`.
        make: Make it; else it is joined.

    Raises:
        InputError: There is none.
        OutputError: There is no room for it.
    """

    def __init__(self, path: Path, *, make: bool = False) -> None:
        self._shared = SharedWords(WORDS, path, make=make)
        self._words = self._shared.words
        self._read = [0] * _LANES
        self._made = make

    def note(self, lane: int, facts: Mapping[str, Any], time_ns: int | None = None) -> None:
        """Write an action down.

        Args:
            lane: :data:`PANEL_LANE` or :data:`COMMAND_LANE`.
            facts: Plain values by short names; texts that are too long together are cut.
            time_ns: Monotonic; None is now.
        """
        text = json.dumps(facts, allow_nan=False).encode()
        if len(text) > _LONGEST:
            short = {key: value[:_KEPT] if isinstance(value, str) else value for key, value in facts.items()}
            text = json.dumps(short, allow_nan=False).encode()[:_LONGEST]
        words, first = self._words, lane * _LANE
        number = words[first] + 1
        at = first + 1 + number % _ENTRIES * _ENTRY
        padded = text.ljust(_LONGEST, b"\0")
        words[at] = 0
        words[at + 1] = time.monotonic_ns() if time_ns is None else time_ns
        words[at + 2], words[at + 3] = len(text), zlib.crc32(padded, number)
        words[at + 4 : at + _ENTRY] = memoryview(padded).cast("q")
        words[at] = number
        words[first] = number

    def take(self) -> list[dict[str, Any]]:
        """Actions that are new since the last call, with ``time_ns``, in the order of their times."""
        out: list[dict[str, Any]] = []
        for lane in range(_LANES):
            count = self._words[lane * _LANE]
            for number in range(max(self._read[lane], count - _ENTRIES) + 1, count + 1):
                out += self._entry(lane, number)
            self._read[lane] = count
        return sorted(out, key=lambda one: int(one["time_ns"]))

    def _entry(self, lane: int, number: int) -> list[dict[str, Any]]:
        words, at = self._words, lane * _LANE + 1 + number % _ENTRIES * _ENTRY
        entry = list(words[at : at + _ENTRY])
        text = b"".join(value.to_bytes(8, "little", signed=True) for value in entry[4:])
        if entry[0] != number or entry[3] != zlib.crc32(text, number) or not 0 <= entry[2] <= _LONGEST:
            return []
        try:
            facts = json.loads(text[: entry[2]])
        except ValueError:  # cut
            facts = {"text": text[: entry[2]].decode(errors="replace")}
        return [{"time_ns": entry[1], **facts}] if isinstance(facts, dict) else []

    def close(self) -> None:
        """Leave it; who made it removes it."""
        if self._made:
            self._shared.remove()
        self._words = memoryview(b"").cast("q")
        self._shared.close()


def note_command(words: Path, action: str, outcome: Mapping[str, Any]) -> None:
    """Note a request of the command line; a run of before that has no such memory takes none.

    Args:
        words: Where the run's shared numbers are.
        action: What was asked.
        outcome: ``done``, ``refused`` and ``state`` of :func:`counterflex.app.run.operator_requests.ask`.
    """
    with contextlib.suppress(InputError):
        actions = Actions(actions_path(words))
        facts = {"who": "command line", "action": action, "done": bool(outcome["done"]), "state": outcome["state"]}
        actions.note(COMMAND_LANE, facts | ({"refused": outcome["refused"]} if outcome["refused"] else {}))
        actions.close()
