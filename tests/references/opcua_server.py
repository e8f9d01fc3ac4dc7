"""The OPC UA server in a process of its own, for tests of its clients."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from counterflex.files.panel_users import set_user

PASSWORD = "four words and one"


class ServerProcess:
    """The server, as a person starts it."""

    def __init__(self, folder: Path, *options: str) -> None:
        command = [sys.executable, "-m", "counterflex", "opcua", str(folder), "--port", "0", *options]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line.startswith("OPC UA: "):
            raise AssertionError(self.process.communicate()[1])
        self.address = line.removeprefix("OPC UA: ").strip()

    def kill(self) -> None:
        """End it without asking."""
        self.process.kill()
        self.process.communicate()


def users(folder: Path) -> str:
    """A file of users: anna operates, ben looks."""
    set_user(folder / "users.toml", "anna", "operator", PASSWORD)
    set_user(folder / "users.toml", "ben", "viewer", PASSWORD)
    return str(folder / "users.toml")
