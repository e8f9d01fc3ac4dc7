"""Where an operator's requests reach a run: a UDP port of this computer, and a file that says where it is.

Only programs of this computer are heard, and of them only those that can read the file: it holds a token that is made
anew for every run, and belongs to the user who runs the loop. Nothing here reaches the loop but numbers in the control
array: a request that is rubbish, or ten thousand a second, cannot disturb it.
"""

from __future__ import annotations

import json
import os
import secrets
import socket
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from counterflex.core.errors import FileFormatError, OutputError

FILE: Final = "operator.json"
_HOST: Final = "127.0.0.1"
_LARGEST: Final = 4096
_MOST_POLLED: Final = 20
WAIT_S: Final = 2.0


@dataclass(frozen=True)
class Asked:
    """A request that came.

    Attributes:
        action: What is asked for, a word.
        peer: Whom to answer.
        time_s: When it came, monotonic.
    """

    action: str
    peer: tuple[str, int]
    time_s: float


def read_request(data: bytes, token: str) -> str | None:
    """What a datagram asks for; None where it is no request, or has another token."""
    try:
        said = json.loads(data)
        given, action = said["token"], said["do"]
        fits = secrets.compare_digest(given.encode(), token.encode())
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return action if fits and isinstance(action, str) else None


class OperatorPort:
    """The run's side.

    Args:
        folder: Of the run; the file is written there, readable by its user only.

    Raises:
        OutputError: The file cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE
        self._token = secrets.token_hex(16)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((_HOST, 0))
        self._socket.setblocking(False)
        text = json.dumps({"port": self._socket.getsockname()[1], "token": self._token, "pid": os.getpid()})
        try:
            self.path.unlink(missing_ok=True)
            with os.fdopen(os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as stream:
                stream.write(text + "\n")
        except OSError as fault:
            self._socket.close()
            raise OutputError(f"cannot be written: {fault.strerror or fault}", where=str(self.path)) from fault

    def poll(self) -> list[Asked]:
        """Requests that came since the last call; what is no request, or has another token, is passed over."""
        found = []
        for _ in range(_MOST_POLLED):
            try:
                data, peer = self._socket.recvfrom(_LARGEST)
            except (BlockingIOError, ConnectionError):
                break
            action = read_request(data, self._token)
            if action is not None:
                found.append(Asked(action, peer, time.monotonic()))
        return found

    def answer(self, asked: Asked, said: dict[str, Any]) -> None:
        """Answer a request; who has gone is not waited for."""
        try:
            self._socket.sendto(json.dumps(said).encode(), asked.peer)
        except OSError:
            return

    def close(self) -> None:
        """Free the port; nobody finds it any more."""
        self._socket.close()
        self.path.unlink(missing_ok=True)


def ask(folder: Path, action: str, *, wait_s: float = WAIT_S) -> dict[str, Any]:
    """The operator's side: send a request to the run whose log lies in a folder, and wait for its answer.

    Args:
        folder: Of the run.
        action: A word.
        wait_s: How long.

    Raises:
        FileFormatError: No run goes on there, or its file is none.
        OutputError: It does not answer.
    """
    path = folder / FILE
    try:
        said = json.loads(path.read_text(encoding="utf-8"))
        port, token = int(said["port"]), str(said["token"])
    except FileNotFoundError as fault:
        raise FileFormatError(
            "no run goes on there", where=str(folder), hint="Give the folder that counterflex run was given with --out"
        ) from fault
    except OSError as fault:
        raise FileFormatError(f"cannot be read: {fault.strerror or fault}", where=str(path)) from fault
    except (ValueError, KeyError, TypeError) as fault:
        raise FileFormatError("is not the file of a run that goes on", where=str(path)) from fault
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.connect((_HOST, port))
        line.settimeout(wait_s)
        try:
            line.send(json.dumps({"token": token, "do": action}).encode())
            answer: dict[str, Any] = json.loads(line.recv(65536))
        except (TimeoutError, ConnectionError) as fault:
            raise OutputError(
                "the run does not answer",
                where=str(folder),
                hint="Its recorder has died or stands still. End the robot program; the loop then ends by itself",
            ) from fault
    return answer
