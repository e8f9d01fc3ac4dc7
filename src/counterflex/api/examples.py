"""Example files: the demonstration cell and programs that go with it."""

from __future__ import annotations

from pathlib import Path

from counterflex.app.examples import write_all


def examples(folder: str | Path) -> Path:
    """Write the example files into a folder: ``cell.toml``, ``cell-small.toml``, ``part.ngc``, ``groove.ngc`` ...

    Args:
        folder: Made when missing.

    Returns:
        The folder.
    """
    write_all(Path(folder) / "cell.toml")
    return Path(folder)
