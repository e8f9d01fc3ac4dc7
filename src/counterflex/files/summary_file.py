"""``summary.json``: what a job did, in numbers, for people and programs.

The record of a machined program (``counterflex-run``, version 2): one row per controller cycle, Parquet.

Version 1 had no direction of the tool.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core import atomic, file_content
from counterflex.core.errors import FileFormatError
from counterflex.core.moving import settle
from counterflex.core.units import DEG, MM, URAD
from counterflex.evaluate.summary import FORMAT, VERSION
from counterflex.files.parquet_table import Column, columns, read, write
from counterflex.files.schema import check_header
from counterflex.path.toolpath import Run

SUMMARY: Final = "summary.json"
FILES: Final = "files_sha256"
"""Key of a summary: SHA-256 by name of the files that were written with it."""
SEAL: Final = "sha256"
"""Key of a sealed file: SHA-256 over everything else in it."""
_FORMER_LEVELS = {"same": "exact", "seeded": "catalogue"}  # Truth levels of version 1 and what they are called since


def write_summary(path: Path, data: Mapping[str, Any]) -> None:
    """Write a summary; format and version are put first, numbers that are not finite become null."""
    atomic.write_text(path, json.dumps({"format": FORMAT, "version": VERSION, **_plain(data)}, indent=2) + "\n")


def write_folder_summary(folder: Path, data: Mapping[str, Any]) -> None:
    """Write the summary of a folder, with the SHA-256 of each file that is in it: the files belong together.

    Args:
        folder: Staging folder in which all files that other commands read are written.
    """
    files = [file for file in sorted(folder.rglob("*")) if file.is_file() and file.name != SUMMARY]
    listed = {file.relative_to(folder).as_posix(): _sha256(file) for file in files}
    write_summary(folder / SUMMARY, {**data, FILES: listed})


def require_whole(folder: Path) -> bool:
    """Refuse a folder whose files were not written together.

    A command that was killed while it replaced the files of a folder leaves some of the former ones; a person may have
    copied a file of another cell or program to the name of one of these.

    Args:
        folder: Of the file that is read. Files that were deleted are not missed here.

    Returns:
        True: all files are those of the summary. False: not looked at, the folder has no summary that lists files.

    Raises:
        FileFormatError: A file is another one; names it.
    """
    settle(folder)
    path = folder / SUMMARY
    listed = read_summary(path).get(FILES) if path.is_file() else None
    if not isinstance(listed, dict):
        return False
    for name, digest in listed.items():
        file = folder / str(name)
        if file.is_file() and not _is_same(file, str(digest)):
            raise FileFormatError(
                "the files of this folder do not belong together: this one was not written with the others",
                where=str(file), value=f"SHA-256 {_sha256(file)[:12]}", limit=f"{str(digest)[:12]} ({SUMMARY})",
                hint="It was replaced or edited, or the command was killed while it wrote. Write the folder again; an "
                "edited file belongs into a folder of its own",
            )  # fmt: skip
    return True


def not_compared(folder: Path) -> str | None:
    """Return a sentence where nothing says that the files of a folder belong together."""
    if require_whole(folder):
        return None
    return f"not looked at: whether the files of {folder} belong together; it has no {SUMMARY} that lists them"


def _is_same(file: Path, digest: str) -> bool:
    """Return whether a file has the content of a digest; of a text the line ends may be others (a copy by FTP, git)."""
    content = file_content.content(file)
    forms = [content]
    if b"\0" not in content:
        lines = content.replace(b"\r\n", b"\n")
        forms += [lines, lines.replace(b"\n", b"\r\n")]
    return any(hashlib.sha256(form).hexdigest() == digest for form in forms)


def _sha256(file: Path) -> str:
    return hashlib.sha256(file_content.content(file)).hexdigest()


def read_summary(path: Path) -> dict[str, Any]:
    """Read a summary; the truth levels of version 1 get their present names.

    Raises:
        FileFormatError: Missing, not JSON, another format, or newer than this program.
    """
    data = file_content.json_value(path)
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise FileFormatError(f"not a {FORMAT} file", where=str(path))
    check_header(data, kind=FORMAT, version=VERSION, where=str(path))
    return _with_present_levels(data) if data["version"] == 1 else data


def write_sealed(path: Path, kind: str, data: Mapping[str, Any]) -> None:
    """Write values as JSON with a SHA-256 over all of them: a change of the file shows."""
    body = {"format": kind, "version": 1, **_plain(data)}
    atomic.write_text(path, json.dumps({**body, SEAL: _seal(body)}, indent=2) + "\n")


def read_sealed(path: Path, kind: str) -> dict[str, Any]:
    """Read what :func:`write_sealed` wrote.

    Raises:
        FileFormatError: Another format, newer than this program, or changed since.
    """
    data = file_content.json_value(path)
    if not isinstance(data, dict) or data.get("format") != kind:
        raise FileFormatError(f"not a {kind} file", where=str(path))
    check_header(data, kind=kind, version=1, where=str(path))
    seal = _seal({key: value for key, value in data.items() if key != SEAL})
    if data.get(SEAL) != seal:
        raise FileFormatError(
            "the file was changed after it was written", where=str(path), value=f"SHA-256 {seal[:12]}",
            limit=str(data.get(SEAL))[:12], hint="Take the file as it was committed",
        )  # fmt: skip
    return data


def _seal(body: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()


def _with_present_levels(data: dict[str, Any]) -> dict[str, Any]:
    """A summary of version 1 with the names of version 2 for its truth levels."""
    present = dict(_named(data))
    seeds, over = present.get("seeds"), present.get("over_seeds")
    if isinstance(seeds, list):
        present["seeds"] = [_named(entry) for entry in seeds]
    if isinstance(over, dict):
        present["over_seeds"] = {_FORMER_LEVELS.get(level, level): value for level, value in over.items()}
    return present


def _named(entry: Any) -> Any:
    level = entry.get("truth_level") if isinstance(entry, dict) else None
    return {**entry, "truth_level": _FORMER_LEVELS.get(level, level)} if isinstance(level, str) else entry


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


KIND = "counterflex-run"
RUN_VERSION = 2

LAYOUT = (
    Column("time_s", "time_s"),
    Column("motion", "motion", whole=True),
    Column("kind", "kind", whole=True),
    Column("progress", "progress"),
    *columns("command_x_mm command_y_mm command_z_mm", "p_part_command", MM),
    *columns("x_mm y_mm z_mm", "p_part_tcp", MM),
    *columns("tilt_rx_urad tilt_ry_urad tilt_rz_urad", "tilt_part", URAD),
    *columns("fx_n fy_n fz_n", "force_part"),
    *columns("mx_nm my_nm mz_nm", "moment_part"),
    Column("force_peak_n", "force_peak_n"),
    Column("axial_depth_mm", "depth_m", unit=MM),
    *columns("q1_deg q2_deg q3_deg q4_deg q5_deg q6_deg", "q_motor", DEG),
)
AXIS = columns("axis_x axis_y axis_z", "axis_part")
"""Direction of the tool, from the tip to the spindle: of runs that have it."""


def write_run(path: Path, run: Run, about: Mapping[str, Any]) -> None:
    """Write a run."""
    write(path, KIND, RUN_VERSION, LAYOUT if run.axis_part is None else LAYOUT + AXIS, run, about)


def read_run(path: Path) -> tuple[Run, dict[str, Any]]:
    """Read a run and its metadata; its folder must be whole."""
    data, about = read(path, KIND, RUN_VERSION, LAYOUT, AXIS)
    require_whole(path.parent)
    return Run(**data), about
