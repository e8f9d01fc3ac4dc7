"""Verdict of ``doctor`` on a machine, kept in the user's cache folder (``counterflex-machine``, version 1)."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Final

from counterflex.core import atomic, file_content
from counterflex.core.errors import FileFormatError, OutputError
from counterflex.core.units import plain
from counterflex.core.user_folder import made_own, require_own, user_folder

KIND: Final = "counterflex-machine"
VERSION: Final = 1
OLDEST: Final = timedelta(days=7)
"""A verdict is believed for a week: machines change by updates, and measuring again takes ten seconds."""


@dataclass(frozen=True)
class StoredVerdict:
    """A verdict on a machine."""

    host: str
    kernel: str
    date: datetime  # When it was measured, with time zone
    verdict: str
    fits: bool  # 99.9 % of the replies are in time
    p999_s: float | None  # What they take at most; None where some never came
    budget_s: float
    reasons: tuple[str, ...]

    @classmethod
    def of(cls, data: dict[str, Any]) -> StoredVerdict:
        """Build from what the file holds."""
        date = datetime.fromisoformat(str(data["date"]))
        if date.tzinfo is None or not isinstance(data["fits"], bool):
            raise ValueError("date")
        return cls(
            host=str(data["host"]),
            kernel=str(data["kernel"]),
            date=date,
            verdict=str(data["verdict"]),
            fits=data["fits"],
            p999_s=None if data["p999_s"] is None else float(data["p999_s"]),
            budget_s=float(data["budget_s"]),
            reasons=tuple(str(reason) for reason in data["reasons"]),
        )


def machine_file() -> Path:
    """Return where the verdict on this machine is kept: ``machine.json`` in the user's folder, beside the kernels."""
    return user_folder() / "machine.json"


def write_verdict(path: Path, stored: StoredVerdict) -> None:
    """Keep a verdict. Raises OutputError: the file cannot be written, or others can write into its folder."""
    try:
        made_own(path.parent)
    except OutputError:
        raise
    except OSError as fault:
        raise OutputError(f"cannot write: {fault.strerror or fault}", where=str(path)) from fault
    data = {
        "format": KIND,
        "version": VERSION,
        "host": stored.host,
        "kernel": stored.kernel,
        "date": stored.date.isoformat(),
        **plain(stored, "verdict fits p999_s budget_s"),
        "reasons": list(stored.reasons),
    }
    atomic.write_text(path, json.dumps(data, indent=2) + "\n")


def read_verdict(path: Path) -> StoredVerdict | None:
    """The verdict that is kept; None where there is none.

    Raises:
        FileFormatError: The file is not what it should be.
        OutputError: Others can write into its folder.
    """
    if not path.exists():
        return None
    require_own(path.parent)
    try:
        data = file_content.json_value(path)
    except FileFormatError as fault:
        raise _unusable(path) from fault
    if not isinstance(data, dict) or data.get("format") != KIND or data.get("version") != VERSION:
        raise _unusable(path)
    try:
        return StoredVerdict.of(data)
    except (KeyError, TypeError, ValueError) as fault:
        raise _unusable(path) from fault


def _unusable(path: Path) -> FileFormatError:
    return FileFormatError(
        "the stored verdict on this computer is not readable", where=str(path), hint="Run counterflex doctor again"
    )


def against(stored: StoredVerdict | None, *, host: str, kernel: str, now: datetime) -> str:
    """Return why a kept verdict does not allow arming on this machine now; empty where it does.

    Args:
        stored: Or None where there is none.
    """
    if stored is None:
        return "this computer has not been measured for the loop"
    if stored.host != host:
        return f"the stored verdict is of another computer ({stored.host})"
    if stored.kernel != kernel:
        return f"this computer was measured under another kernel ({stored.kernel})"
    age = now - stored.date
    if age > OLDEST:
        return f"this computer was measured {age.days} days ago"
    if age < timedelta(days=-1):
        return "the verdict on this machine is of the future: a clock was set"
    if not stored.fits:
        return "this machine does not keep time for the loop: " + (
            stored.reasons[0] if stored.reasons else stored.verdict
        )
    return ""
