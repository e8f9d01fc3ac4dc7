"""Time until RAMP OUT acts while strangers log in: a thousand at once, again and again, beside a loop that corrects.

``python benchmarks/panel_stop.py [--logins N] [--stops N] [--json FILE]``. A loop in a process of its own answers a
robot over sockets every 4 ms and corrects. The operator's page is a client of the panel's socket without a browser. In
a process of the lowest priority strangers post wrong passwords, ``--logins`` at a time over as many connections, and
begin anew at once.

Two times from the operator's press: until the loop has the request, and until it no longer corrects. Both are read in
the memory of the loop.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import html
import json
import multiprocessing
import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Final

from counterflex.app.environment import environment
from counterflex.files.panel_users import set_user
from counterflex.protocols.processes.actions import Actions, actions_path
from counterflex.protocols.processes.control_array import Life, Request, Shown
from counterflex.protocols.processes.operator_words import OperatorFile
from counterflex.protocols.processes.snapshot import SnapshotMemory
from counterflex.runtime.state.states import State
from counterflex_lab.faults.process_rig import ProcessRig

PASSWORD: Final = "four words and one"
PATIENCE_S: Final = 60.0
LIMIT_S: Final = 0.5


def strangers(port: int, logins: int, answers: Any, end: Any) -> None:
    """A process of strangers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(OSError, AttributeError):
        os.nice(19)  # they sit at other computers
    body = b"name=anna&password=a+wrong+guess"
    head = (
        f"POST /login HTTP/1.1\r\nHost: localhost:{port}\r\nContent-Type: application/x-www-form-urlencoded\r\n"
        f"Content-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    ).encode()

    async def one() -> None:
        while not end.is_set():
            try:
                reader, writer = await asyncio.open_connection("127.0.0.1", port)
                writer.write(head + body)
                answer = await reader.read()
                answers[0 if answer.startswith(b"HTTP") else 1] += 1
                writer.close()
            except OSError:
                answers[1] += 1
                await asyncio.sleep(0.01)

    async def all_of_them() -> None:
        await asyncio.gather(*(one() for _ in range(logins)))

    asyncio.run(all_of_them())


class Loop:
    """The loop, and its robot in a thread."""

    def __init__(self, folder: Path) -> None:
        self.rig = ProcessRig(folder)
        words = self.rig._words.path
        self._memory, self.actions = SnapshotMemory(words), Actions(actions_path(words), make=True)
        self.rig.start_loop()
        self.rig.control[Life.MAY_ARM] = 1
        self._file = OperatorFile(folder, words)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._go_on, daemon=True)
        self._thread.start()

    def _go_on(self) -> None:
        rig = self.rig
        while not self._end.wait(0.004):
            rig.robot.frees["Enable"] = float(rig.state in (State.ARMED, State.ACTIVE))
            rig.robot.stopped = ""
            rig.cycle(300.0 if rig.state == State.ACTIVE and not rig.robot.feed_hold else 0.0)

    async def correct(self) -> None:
        """Acknowledge, arm, and wait until it corrects."""
        control = self.rig.control
        end = time.monotonic() + PATIENCE_S
        while control[Shown.STATE] != State.ACTIVE:
            if time.monotonic() > end:
                raise RuntimeError(f"the loop does not correct: {State(control[Shown.STATE]).name}")
            state = control[Shown.STATE]
            control[Request.STOP] = 0
            control[Request.RESET if state not in (State.READY, State.ARMED) else Request.ARM] = 1
            await asyncio.sleep(0.2)
        await asyncio.sleep(0.5)

    def close(self) -> None:
        """End it."""
        self._end.set()
        self._thread.join()
        self._file.close()
        self._memory.close()
        self.actions.close()
        self.rig.__exit__()


class Operator:
    """The page of an operator, without a browser."""

    def __init__(self, base: str) -> None:
        self._base = base

    async def open(self, session: Any) -> None:
        """Log in and open the page."""
        import socketio

        form = {"name": "anna", "password": PASSWORD}
        async with session.post(f"{self._base}/login", data=form, allow_redirects=False) as answer:
            if answer.status != 303:
                raise RuntimeError(f"the operator cannot log in: {answer.status}")
        async with session.get(self._base) as answer:
            text = await answer.text()
        raw = re.search(r"String\.raw`(.*?)`", text, re.DOTALL)
        client = re.search(r'client_id"?\'?: ?[\'"]([0-9a-f-]{36})', text)
        if raw is None or client is None:
            raise RuntimeError("the page of the panel looks otherwise than this benchmark expects")
        elements = json.loads(html.unescape(raw.group(1)))
        self._button, self._listener = next(
            (int(number), one["events"][0]["listener_id"])
            for number, one in elements.items()
            if one.get("props", {}).get("data-test") == "stop"
        )
        self._client = client.group(1)
        self._socket = socketio.AsyncClient(http_session=session, reconnection=False)
        await self._socket.connect(
            self._base, headers={"Origin": self._base}, socketio_path="/_nicegui_ws/socket.io", transports=["websocket"]
        )
        ids = {"client_id": self._client, "tab_id": "tab", "document_id": "document", "next_message_id": 0}
        await self._socket.call("handshake", ids)

    async def press(self) -> None:
        """Press RAMP OUT."""
        facts = {"id": self._button, "client_id": self._client, "listener_id": self._listener, "args": []}
        await self._socket.emit("event", facts)

    async def close(self) -> None:
        """Leave."""
        await self._socket.disconnect()


async def until(done: Any) -> float:
    """Time until something is true, s."""
    begin = time.perf_counter()
    while not done():
        if time.perf_counter() - begin > PATIENCE_S:
            return float("inf")
        await asyncio.sleep(0.0005)
    return time.perf_counter() - begin


async def measure(loop: Loop, base: str, logins: int, stops: int) -> dict[str, Any]:
    """Times of some stops without and with strangers."""
    import aiohttp

    context = multiprocessing.get_context("spawn")
    control, out = loop.rig.control, {}
    async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session:
        operator = Operator(base)
        await operator.open(session)
        for crowd in (0, logins):
            answers, end = context.Array("q", 2, lock=False), context.Event()
            process = None
            if crowd:
                port = int(base.rpartition(":")[2])
                process = context.Process(target=strangers, args=(port, crowd, answers, end), daemon=True)
                process.start()
                while sum(answers) <= crowd:
                    await asyncio.sleep(0.05)
            heard, ramped = [], []
            began = time.perf_counter()
            for _ in range(stops):
                await loop.correct()
                await operator.press()
                begin = time.perf_counter()
                await until(lambda: control[Request.STOP] == 1)
                heard.append(time.perf_counter() - begin)
                await until(lambda: control[Shown.STATE] != State.ACTIVE)
                ramped.append(time.perf_counter() - begin)
                await asyncio.sleep(0.5)
            out[f"{crowd} logins at once"] = {
                "stops": stops,
                "request_in_the_loop_s": figures(heard),
                "no_longer_correcting_s": figures(ramped),
                "refused_or_ended_per_s": round(sum(answers) / (time.perf_counter() - began)),
            }
            end.set()
            if process is not None:
                process.join(PATIENCE_S)
                process.kill()
        await operator.close()
    return out


def figures(times_s: list[float]) -> dict[str, float]:
    """Median and largest, s."""
    return {"median": round(statistics.median(times_s), 4), "largest": round(max(times_s), 4)}


def run(logins: int, stops: int) -> dict[str, Any]:
    """Times of the stop, and whether the goal is met."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        set_user(folder / "users.toml", "anna", "operator", PASSWORD)
        loop = Loop(folder)
        command = [
            sys.executable,
            "-m",
            "counterflex",
            "panel",
            name,
            "--port",
            "0",
            "--users",
            str(folder / "users.toml"),
        ]
        panel = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            line = "" if panel.stdout is None else panel.stdout.readline()
            out = asyncio.run(measure(loop, line.split(": ", 1)[1].strip().rstrip("/"), logins, stops))
            done = loop.actions.take()
            out["entries_of_refused_logins"] = sum(one["action"] == "log in" and not one["done"] for one in done)
        finally:
            panel.send_signal(signal.SIGINT)
            panel.wait()
            loop.close()
    largest = out[f"{logins} logins at once"]["request_in_the_loop_s"]["largest"]
    return {"limit_s": LIMIT_S, "met": largest <= LIMIT_S, **out, "environment": environment()}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="briefly")
    parser.add_argument("--logins", type=int, default=1000)
    parser.add_argument("--stops", type=int, default=20)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    result = run(100, 2) if options.quick else run(options.logins, options.stops)
    print(json.dumps(result, indent=2))
    if options.json is not None:
        with contextlib.suppress(FileExistsError):
            options.json.parent.mkdir(parents=True)
        options.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
