"""What the tests of the jobs share: the small cell, a rigid one, programs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

CELLS = Path(__file__).resolve().parents[1] / "data" / "cells"
GROOVE = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 Z60\nG0 X-12 Y15\nG0 Z36\nG1 X52 F1500\nG0 Z60\nM5\nM2\n"

ProgramFile = Callable[..., Path]


@pytest.fixture(scope="session")
def small() -> Path:
    """A robot that bends."""
    return CELLS / "small.toml"


@pytest.fixture(scope="session")
def stiff() -> Path:
    """A robot that does not."""
    return CELLS / "rigid.toml"


@pytest.fixture
def program(tmp_path: Path) -> ProgramFile:
    def write(text: str = GROOVE, name: str = "part.ngc") -> Path:
        file = tmp_path / "source" / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(text, encoding="ascii", newline="")
        return file

    return write
