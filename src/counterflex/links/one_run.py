"""One run to a folder: two would share the file by which an operator finds the run, and a stop would reach one only."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Final

from counterflex.core.errors import InputError, OutputError
from counterflex.core.leftovers import process_lives
from counterflex.links.control_array import CONTROL, Life
from counterflex.links.operator_words import FILE
from counterflex.links.shared_words import SharedWords

_SILENT_NS: Final = 1_000_000_000
"""A loop that has said nothing for so long has ended, where the process that started it has, too."""


def require_free(folder: Path) -> None:
    """Check that no other run goes on in a folder. What a run that was killed has left there is no run.

    Args:
        folder: Of the run.

    Raises:
        OutputError: One does.
    """
    try:
        said = json.loads((folder / FILE).read_text(encoding="utf-8"))
        words, pid = Path(said["words"]), int(said["pid"])
        with SharedWords(CONTROL, words) as shared:
            told_ns = time.monotonic_ns() - shared.words[Life.LOOP_NS]
    except (OSError, ValueError, KeyError, TypeError, InputError):
        return
    if told_ns < _SILENT_NS or process_lives(pid):
        raise OutputError(
            "another run goes on in this folder",
            where=str(folder),
            value=f"process {pid}",
            hint="Give another folder with --out, or wait until that run has ended",
        )
