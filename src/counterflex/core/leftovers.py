"""Names of temporary files that tell who made them, so that what a killed process left is cleared by the next one."""

from __future__ import annotations

import contextlib
import os
import platform
import re
import shutil
from pathlib import Path
from typing import Final

SUFFIX: Final = ".part"
_HOST: Final = re.sub(r"[^A-Za-z0-9]", "", platform.node())[:24] or "here"


def part_prefix(name: str) -> str:
    """Beginning of the name of a temporary file or folder for an output: ``.NAME.HOST-PID-``."""
    return f".{name}.{_HOST}-{os.getpid()}-"


def clear_leftovers(folder: Path, name: str) -> None:
    """Remove temporary files and folders for an output whose process is gone: it was killed, or the computer stopped.

    Only what this program named for this output on this computer is touched, and never what belongs to a process that
    lives. Nothing is said, and nothing fails: what cannot be removed stays.

    Args:
        folder: Where temporary files for the output lie.
        name: Name of the output.
    """
    if os.name != "posix":  # elsewhere there is no harmless way to ask for a process
        return
    mine = re.compile(rf"\.{re.escape(name)}\.{re.escape(_HOST)}-(\d+)-\w+{re.escape(SUFFIX)}")
    with contextlib.suppress(OSError):
        for entry in list(os.scandir(folder)):
            match = mine.fullmatch(entry.name)
            if match is None or process_lives(int(match[1])):
                continue
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path, ignore_errors=True)
            else:
                with contextlib.suppress(OSError):
                    Path(entry.path).unlink()


def process_lives(process: int) -> bool:
    """Whether a process of this computer lives; one that only waits to be buried does not.

    Where the system has no harmless way to ask (other than POSIX) every process lives.
    """
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    try:
        said = Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return True
    return said.rpartition(")")[2].strip()[:1] not in ("Z", "X")
