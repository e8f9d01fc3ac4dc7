"""Segments of a run log that were cut short or are damaged, written anew so that any MCAP reader takes them."""

from __future__ import annotations

import contextlib
import os
import shutil
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final

from counterflex.core import atomic
from counterflex.core.errors import FileFormatError, InputError, OutputError
from counterflex.core.held import boot_id, own
from counterflex.evaluate.missing_cycles import MissingFinder
from counterflex.evaluate.run_digest import DigestMaker
from counterflex.files.logs import segment as form
from counterflex.files.logs.run_log import BOOT_KEY
from counterflex.files.logs.segment import require_all
from counterflex.files.logs.segments import LogSegment, read_segment
from counterflex.runtime.record_ring import CYCLE

STILL_S: Final = 5.0
"""A file written to within this time is taken for one that is being written, where no lock tells."""
_BARE: Final = {"format": form.KIND, "version": form.VERSION}


@dataclass(frozen=True)
class Repaired:
    """Repair of a segment."""

    name: str
    kept: str  # Name under which the original is kept; empty where nothing was done
    records: int
    note: str  # Why nothing was done, or empty
    # Cycles that it should hold and does not: before its first record, between its records, and behind the last one by
    # its own index
    missing: int = 0
    damage: int = 0  # Stretches that could not be read


def repair_segment(
    path: str | Path, now_s: float | None = None, about: Mapping[str, Any] | None = None, cycle: int | None = None
) -> Repaired | None:
    """Write a segment anew, finished, with all records that can be read; the original keeps another name.

    At every moment there is a file of the segment's name: first the original gets its second name, then the new file
    takes the place of the first.

    Args:
        path: ``run-NNN.mcap``.
        now_s: Time by the wall clock; None is now. It counts only where no lock tells whether the file is written to:
            on a file system without locks, or a log that another computer, or this one before it was started, wrote.
        about: What the run was made of, where the segment itself no longer says it.
        cycle: Last cycle of its run that earlier segments account for; None where that is not known: then cycles before
            its first record are counted in the first segment of a run only, which begins with cycle 1.

    Returns:
        What was done; None where the segment is whole.

    Raises:
        FileFormatError: Not a run log, or of a newer version.
        InputError: The segment is being written.
        OutputError: The folder cannot be written.
    """
    file = Path(path)
    locked = _is_locked(file)  # before it is read: who is gone now has written his last
    try:
        result = read_segment(file)
    except FileFormatError as fault:
        if not fault.data.get("nothing"):
            raise
        return Repaired(file.name, "", 0, "not one record can be read: nothing to save")
    if result.whole:
        return None
    require_all(result.absent, result.about or about or {}, str(file), "written anew")
    _require_ended(file, result, locked, now_s)
    original = _free_name(file)
    rows = result.rows
    made_of = result.about or about or {}
    finder = MissingFinder(_begin(result, made_of) if cycle is None else cycle)
    finder.add(rows)
    finder.end(result.lost_at_end)
    missing = finder.total
    facts = {
        **_BARE,
        **made_of,
        "repaired": {
            "records": len(rows),
            "original": original.name,
            "missing": missing,
            "missing_at_end": result.lost_at_end,
            "damage": [[d.begin, d.end] for d in result.damage],
        },
    }
    with atomic.atomic_path(file) as part:
        with part.open("wb") as stream:
            _write(stream, result, facts)
            stream.flush()
            os.fsync(stream.fileno())
        _keep(file, original)
    return Repaired(file.name, original.name, len(rows), "", missing, len(result.damage))


def _write(stream: BinaryIO, segment: LogSegment, facts: Mapping[str, Any]) -> None:
    """Write all that could be read of a segment: records, states before the next record, actions, facts, digest."""
    states = sorted(segment.states, key=lambda state: state.cycle)
    writer, channel, state_channel = form.begin_segment(stream, facts)
    for row in segment.rows:
        while states and states[0].cycle < row[CYCLE]:  # also one whose own record is lost
            form.add_state(writer, state_channel, states.pop(0))
        form.add_record(writer, channel, row)
    for state in states:
        form.add_state(writer, state_channel, state)
    for action in segment.actions:
        form.add_action(writer, action)
    form.add_about(writer, facts)
    digests = DigestMaker()
    digests.add(segment.rows)
    digest = digests.digest()
    if digest is not None:
        form.add_digest(writer, digest.plain())
    writer.finish()


def _is_locked(file: Path) -> bool | None:
    """Return whether a process that lives holds the file; None: nobody can say."""
    try:
        handle = os.open(file, os.O_RDWR)
    except OSError:
        return None
    try:
        ours = own(handle)
    finally:
        os.close(handle)
    return None if ours is None else not ours


def _require_ended(file: Path, segment: LogSegment, locked: bool | None, now_s: float | None) -> None:
    """Who holds a segment decides; where it was held on this computer, the time of the file says nothing more."""
    context = {"where": str(file), "hint": "End the run first"}
    if locked:
        raise InputError("this segment is being written", value="a living process writes to it", **context)
    boot = boot_id()
    if segment.finished or (locked is False and boot and segment.about.get(BOOT_KEY) == boot):
        return
    age = (time.time() if now_s is None else now_s) - file.stat().st_mtime
    if abs(age) < STILL_S:
        raise InputError(
            "this segment may be being written",
            value=f"changed {max(age, 0.0):.1f} s ago, perhaps by another computer",
            limit=f">= {STILL_S:g} s",
            **context,
        )


def _begin(segment: LogSegment, about: Mapping[str, Any]) -> int | None:
    """Cycle before the first one of a segment by itself: 0 for the first segment of a run, else not known."""
    number = segment.name[4:].partition(".")[0]
    own = about.get("segment", int(number) if number.isdigit() else 0)
    return 0 if own == about.get("run", 0) else None


def _free_name(file: Path) -> Path:
    for number in range(1, 1000):
        name = file.with_name(f"{file.name}.cut" if number == 1 else f"{file.name}.cut-{number}")
        if not name.exists():
            return name
    raise OutputError("too many originals are stored here", where=str(file))


def _keep(file: Path, original: Path) -> None:
    """A second name for the original; a copy where the file system has no links."""
    try:
        original.hardlink_to(file)
    except FileExistsError:
        raise
    except OSError:
        try:
            shutil.copy2(file, original)
        except OSError:
            with contextlib.suppress(OSError):
                original.unlink()
            raise
