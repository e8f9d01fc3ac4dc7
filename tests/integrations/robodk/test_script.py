"""RoboDK's script ``counterflex_compensate`` on RoboDK's own package, against a stand-in for RoboDK on a socket."""

from __future__ import annotations

import os
import socket
import struct
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from counterflex.app.add_ins import ADD_INS, write

EXAMPLES = Path(__file__).parents[3] / "examples"
CELL = EXAMPLES / "cells" / "kr300_d16_small.toml"
PROGRAM, ITEM = 8, 4711
"""Type of a program in the tree of a station; a pointer to it."""


class Station(threading.Thread):
    """A station with one program, as far as the script asks; each answer as the package ``robodk`` reads it.

    Args:
        parameters: Of the station.
        files: That its post-processor writes for the program.
        name: Of the program.
    """

    def __init__(self, parameters: dict[str, str], files: dict[str, bytes], name: str = "groove") -> None:
        super().__init__(daemon=True)
        self.parameters, self.files, self.program = parameters, files, name
        self.messages: list[str] = []
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]

    def run(self) -> None:
        connection, _ = self._listening.accept()
        with connection, connection.makefile("rwb") as self.stream:
            while line := self.stream.readline():
                getattr(self, f"answer_{line.decode().strip()}")()
                self.stream.flush()
        self._listening.close()

    def line(self) -> str:
        return self.stream.readline().decode().rstrip("\n")

    def numbers(self, form: str) -> tuple[int, ...]:
        return struct.unpack(">" + form, self.stream.read(struct.calcsize(">" + form)))

    def answer(self, *parts: int | str) -> None:
        for part in (*parts, 0):  # status: no fault
            self.stream.write(struct.pack(">i", part) if isinstance(part, int) else part.encode() + b"\n")

    def answer_RDK_API(self) -> None:
        (count,) = self.numbers("i")
        self.numbers(f"{count}d")
        self.answer("RDK_API", 1, 24000)

    def answer_PickItem(self) -> None:
        self.line()
        assert self.numbers("i") == (PROGRAM,)
        self.stream.write(struct.pack(">Qi", ITEM, PROGRAM))
        self.answer()

    def answer_G_Name(self) -> None:
        assert self.numbers("Q") == (ITEM,)
        self.answer(self.program)

    def answer_G_Param(self) -> None:
        name = self.line()
        self.answer(self.parameters.get(name, f"UNKNOWN {name}"))

    def answer_MakeProg2(self) -> None:
        assert self.numbers("Q") == (ITEM,)
        folder = Path(self.line())
        self.numbers("i")
        for name, content in self.files.items():
            (folder / name).write_bytes(content)
        self.answer(1, "", 0)

    def answer_ShowMessage(self) -> None:
        self.messages.append(self.line())
        self.answer()

    answer_ShowMessageStatus = answer_ShowMessage


@pytest.fixture
def script(tmp_path: Path) -> Path:
    """The script as `add-in` writes it."""
    return write(ADD_INS["robodk"], tmp_path)


def run(script: Path, station: Station) -> subprocess.CompletedProcess[str]:
    station.start()
    environment = {**os.environ, "ROBODK_API_PORT": str(station.port)}
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, env=environment, check=False)
    station.join(10.0)
    return done


def groove() -> dict[str, bytes]:
    folder = EXAMPLES / "programs"
    return {name: (folder / name).read_bytes() for name in ("groove.src", "groove.dat")}


@pytest.mark.long
def test_a_program_of_the_station_is_compensated(script: Path, tmp_path: Path) -> None:
    station = Station(
        {
            "PATH_OPENSTATION": str(tmp_path),
            "COUNTERFLEX_CELL": str(CELL),
            "COUNTERFLEX_ARGUMENTS": "--assume-class --no-predict --no-report",
        },
        groove(),
    )
    done = run(script, station)
    assert done.returncode == 0, done.stdout + done.stderr
    out = tmp_path / "groove-counterflex"
    assert station.messages == [f"counterflex: compensated program and report in {out}"]
    assert "DEF groove" in (out / "groove.src").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("files", "says"),
    [
        ({}, "none was made"),
        ({"a.src": b"", "b.src": b""}, "which of these files is the program 'groove'. a.src, b.src"),
        ({"groove.src": b"DEF groove( )\nLIN {X 1}\nEND\n"}, "the program 'groove' does not pass the check"),
    ],
)
def test_what_cannot_be_compensated_is_said_in_the_station(
    script: Path, tmp_path: Path, files: dict[str, bytes], says: str
) -> None:
    station = Station({"PATH_OPENSTATION": str(tmp_path), "COUNTERFLEX_CELL": str(CELL)}, files)
    done = run(script, station)
    assert done.returncode == 1
    (message,) = station.messages
    assert says.replace("'groove'.", "'groove'?") in message
    assert not (tmp_path / "groove-counterflex").exists()
