"""Build of this counterflex: version, commit, interpreter, platform; read without running anything."""

from __future__ import annotations

import platform
from importlib import resources
from pathlib import Path
from typing import Final

_BUILT: Final = "commit.txt"  # Written into wheel and source distribution by ``tools/build_commit.py``
_DIGITS: Final = 12


def commit() -> str | None:
    """Commit that the package was built from, or that is checked out around it; None where neither is known."""
    built = resources.files("counterflex") / _BUILT
    try:
        if built.is_file():
            return built.read_text(encoding="utf-8").strip() or None
        return commit_of(Path(__file__).resolve().parents[3])
    except (OSError, UnicodeDecodeError):
        return None


def commit_of(root: Path) -> str | None:
    """Commit that is checked out in a folder; None where it is no work tree of git."""
    entry = root / ".git"
    if not (root / "pyproject.toml").is_file() or not entry.exists():
        return None
    folder = entry if entry.is_dir() else (root / entry.read_text(encoding="utf-8").partition(": ")[2].strip())
    common = folder / "commondir"
    shared = (folder / common.read_text(encoding="utf-8").strip()) if common.is_file() else folder
    head = (folder / "HEAD").read_text(encoding="utf-8").strip()
    if not head.startswith("ref: "):
        return head[:_DIGITS]
    name = head.removeprefix("ref: ")
    for place in (folder, shared):
        if (place / name).is_file():
            return (place / name).read_text(encoding="utf-8").strip()[:_DIGITS]
    packed = shared / "packed-refs"
    lines = packed.read_text(encoding="utf-8").splitlines() if packed.is_file() else []
    return next((line.split()[0][:_DIGITS] for line in lines if line.endswith(f" {name}")), None)


def sentence(version: str) -> str:
    """Version and build data in one line, for reports of faults."""
    known = commit()
    made = "commit not known" if known is None else f"commit {known}"
    return (
        f"counterflex {version} ({made}, Python {platform.python_version()}, {platform.system()} {platform.machine()})"
    )
