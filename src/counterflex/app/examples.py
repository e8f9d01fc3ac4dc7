"""The demonstration cell and part that ship with the package."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from counterflex.core import atomic
from counterflex.core.errors import OutputError


def text(name: str) -> str:
    """Text of a file of the demonstration: ``cell.toml`` or ``part.ngc``."""
    return (resources.files("counterflex.app") / "demo" / name).read_text(encoding="utf-8")


def write(cell: Path) -> list[Path]:
    """Write the demonstration cell to a path and its part beside it.

    Raises:
        OutputError: A file is there already, or the folder cannot be written.
    """
    targets = {cell: text("cell.toml"), cell.parent / "part.ngc": text("part.ngc")}
    for path in targets:
        if path.exists():
            raise OutputError("the file exists and is kept", where=str(path), hint="Choose another --out")
    for path, content in targets.items():
        atomic.write_text(path, content)
    return list(targets)
