"""Fingerprint of a step of an experiment: what any long job counts, and the code of this package."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from counterflex.app.long_jobs.step_cache import Mark, fingerprint, program_files


def mark_of(*files: str | Path, **facts: Any) -> Mark:
    """Fingerprint of files, facts and code; see :func:`counterflex.app.long_jobs.step_cache.fingerprint`."""
    return (*fingerprint(*files, **facts), *program_files("counterflex_lab"))
