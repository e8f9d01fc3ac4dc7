"""Compensate a robot program whose loops need another target in each pass: write it out, then compensate that."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, Final

from counterflex.app import conversion
from counterflex.app.compensation import compensate
from counterflex.app.inputs import AS_IT_IS, Reading
from counterflex.core import atomic, file_content
from counterflex.core.errors import ProgramError
from counterflex.core.progress import Progress, share_of, silent
from counterflex.files.summary_file import write_folder_summary
from counterflex.programs.language import LANGUAGES
from counterflex.programs.reading import dialect_of

FOLDER: Final = "written-out"
"""Folder of the program with each motion once; lines in results are lines of it."""


def run(
    program: str | Path,
    cell_file: str | Path,
    out: str | Path,
    *,
    reading: Reading = AS_IT_IS,
    progress: Progress = silent,
    **options: Any,
) -> dict[str, Any]:
    """Compensate a program; one that cannot be written back in its loops is written out first.

    Args:
        out: Folder; of a program that was written out it also has that one, in :data:`FOLDER`.
    """
    try:
        return compensate.run(program, cell_file, out, reading=reading, progress=progress, **options)
    except ProgramError as fault:
        if not fault.data.get("each_pass"):
            raise
        place = fault.where
    dialect = dialect_of(program, reading.dialect)
    language = LANGUAGES[dialect].prompt or dialect
    with tempfile.TemporaryDirectory() as folder, atomic.atomic_folder(out) as staging:
        files = conversion.run(program, cell_file, folder, language, reading=reading)["files"]
        again = share_of(progress, 0.5, 1.0)
        place_of_it = Path(out) / FOLDER / files[0]
        summary = compensate.run(
            Path(folder) / files[0], cell_file, staging, shown=place_of_it, progress=again, **options
        )
        (staging / FOLDER).mkdir()
        for name in files:
            atomic.write_bytes(staging / FOLDER / name, file_content.content(Path(folder) / name))
        message = (
            f"{place} runs several times and each pass needs another correction: the program was written out, each "
            f"motion once, as counterflex convert does; lines are those of {FOLDER}/{files[0]}"
        )
        summary["written"]["warnings"] = [message, *summary["written"]["warnings"]]
        write_folder_summary(staging, summary)
    return summary
