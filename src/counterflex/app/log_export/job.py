"""The job ``log export --to``: a run of a log as a file of another viewer."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from counterflex.app.log_export import foxglove, rerun
from counterflex.app.log_export.content import content_of, plain
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent

VIEWERS: Final = {"foxglove": foxglove.write, "rerun": rerun.write}


def export_to(
    folder: Path, viewer: str, target: Path, *, number: int | None = None, range_m: float, progress: Progress = silent
) -> dict[str, Any]:
    """Write a run for another viewer.

    Args:
        viewer: One of :data:`VIEWERS`.
        target: File, whole or not at all.
        number: Of the run; None is the last.
        range_m: Deviation at which the colours of the cut end.

    Returns:
        What was written, plain values, with ``messages``.

    Raises:
        InputError: No such viewer or run, or its library is not installed.
        OutputError: The file cannot be written.
    """
    if viewer not in VIEWERS:
        raise InputError("no such viewer", where="--to", value=viewer, limit=", ".join(VIEWERS))
    if viewer == "rerun":
        rerun.require_rerun()
    content = content_of(folder, number)
    progress(0.2)
    messages = VIEWERS[viewer](content, target, range_m, progress)
    return {"viewer": viewer, "messages": messages, **plain(content)}
