"""Scripts with which other programs call counterflex: what a CAM system or a station hands over and takes back."""

from __future__ import annotations

import importlib.resources
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from counterflex.core.atomic import write_text
from counterflex.core.registry import Registry

_CALL: Final = 'COUNTERFLEX = ["counterflex"]'
"""Line of each script that names the program; the copy for this computer names it by its whole path."""


@dataclass(frozen=True)
class AddIn:
    """A script that runs inside another program, on that program's Python: it imports nothing of counterflex."""

    title: str
    package: str  # Python package that the script is kept in
    file: str  # Its name, by which the other program finds it
    place: str  # Folder that the other program looks in
    next_step: str

    def script(self, call: list[str]) -> str:
        """Text of the script.

        Args:
            call: Words that start counterflex.
        """
        text = importlib.resources.files(self.package).joinpath(self.file).read_text(encoding="utf-8")
        return text.replace(_CALL, f"COUNTERFLEX = {call!r}", 1)


ADD_INS: Final[Registry[AddIn]] = Registry(
    "counterflex.add_ins", "program to add counterflex to", "counterflex.app.add_ins:AddIn"
)


def write(add_in: AddIn, folder: Path) -> Path:
    """Write the script for this computer and return where it is.

    Args:
        folder: Where to; made when missing.

    Raises:
        OutputError: It cannot be written.
    """
    own = Path(sys.executable).with_name("counterflex")
    command = shutil.which(str(own)) or shutil.which("counterflex")
    call = [command] if command is not None else [sys.executable, "-m", "counterflex"]
    path = folder / add_in.file
    write_text(path, add_in.script(call))
    return path
