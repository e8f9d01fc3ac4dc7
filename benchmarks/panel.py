"""What the operator panel costs the loop: times to answer with and without panel, in turns within one run.

A loop in a process of its own answers a robot every 4 ms. In every second turn a panel serves four pages at 20 Hz. The
pages are clients of its sockets without a browser: a browser belongs on the computer that it is looked at with.

Run: python benchmarks/panel.py [--quick] [--minutes 30]
"""

from __future__ import annotations

import argparse
import asyncio
import html
import json
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.protocols.processes.actions import Actions, actions_path
from counterflex.protocols.processes.operator_words import OperatorFile
from counterflex.protocols.processes.snapshot import SnapshotMemory, SnapshotReader, snapshot_path
from counterflex.runtime.state.states import State
from counterflex.validation.faults.process_rig import ProcessRig

PERIOD_S: Final = 0.004
CLIENTS: Final = 4
QUANTILES: Final = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999, "max": 1.0}


class Pages:
    """Pages of a panel without browsers: they read all that is sent and say that they have."""

    def __init__(self, link: str, count: int) -> None:
        self._link, self._count = link, count
        self.messages = [0] * count
        self._end = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._run()), daemon=True)
        self._thread.start()

    async def _run(self) -> None:
        import aiohttp

        jar = aiohttp.CookieJar(unsafe=True)
        async with aiohttp.ClientSession(cookie_jar=jar) as session:
            await asyncio.gather(*(self._page(session, k) for k in range(self._count)))

    async def _page(self, session: Any, k: int) -> None:
        import socketio

        base = self._link.split("?")[0].rstrip("/")
        async with session.get(self._link) as answer:
            text = await answer.text()
        raw = re.search(r"String\.raw`(.*?)`", text, re.DOTALL)
        client = re.search(r'client_id"?\'?: ?[\'"]([0-9a-f-]{36})', text)
        assert raw is not None
        assert client is not None
        elements = json.loads(html.unescape(raw.group(1)))
        live, listeners = next(
            (int(number), {one["type"]: one["listener_id"] for one in element["events"]})
            for number, element in elements.items()
            if {"ready", "seen"} <= {one["type"] for one in element.get("events", [])}
        )
        ids = {"client_id": client.group(1), "tab_id": f"tab{k}", "document_id": f"document{k}", "next_message_id": 0}
        socket = socketio.AsyncClient(http_session=session, reconnection=False)

        def event(kind: str, value: int) -> Any:
            facts = {"id": live, "client_id": ids["client_id"], "listener_id": listeners[kind], "args": value}
            return socket.emit("event", facts)

        async def called(data: Any) -> None:
            if isinstance(data, dict) and data.get("name") == "show":
                self.messages[k] += 1
                await event("seen", int(data["args"][0]["number"]))

        socket.on("run_method", called)
        await socket.connect(
            base, headers={"Origin": base}, socketio_path="/_nicegui_ws/socket.io", transports=["websocket"]
        )
        await socket.call("handshake", ids)
        await event("ready", 0)
        while not self._end.is_set():
            await asyncio.sleep(0.05)
        await socket.disconnect()

    def close(self) -> None:
        """Leave."""
        self._end.set()
        self._thread.join()


class Watched:
    """A panel and its pages."""

    def __init__(self, folder: Path) -> None:
        command = [sys.executable, "-m", "counterflex", "panel", str(folder), "--port", "0"]
        self._panel = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self._panel.stdout is not None
        links = dict(self._panel.stdout.readline().strip().split(": ", 1) for _ in range(2))
        self.pages = Pages(links["viewer"], CLIENTS)

    def close(self) -> None:
        """Close both."""
        self.pages.close()
        self._panel.send_signal(signal.SIGINT)
        self._panel.wait()


class Robot:
    """The loop, and its robot at 250 Hz."""

    def __init__(self, folder: Path) -> None:
        self.rig = ProcessRig(folder)
        words = self.rig._words.path
        self._memory = SnapshotMemory(words)
        self._actions = Actions(actions_path(words), make=True)
        self.rig.start_loop()
        self._file = OperatorFile(folder, words)
        self._reader = SnapshotReader(snapshot_path(words))
        self.rig.activate()

    def turn(self, seconds: float) -> Float:
        """(n,) s, time to answer in each cycle of a turn, by the loop's own clock."""
        parts: list[Float] = []
        due, end = time.monotonic(), time.monotonic() + seconds
        self._reader.take()
        while time.monotonic() < end:
            self.rig.cycle(300.0 if self.rig.state == State.ACTIVE else 0.0)
            due = max(due + PERIOD_S, time.monotonic() - PERIOD_S)
            if (taken := self._reader.take()).size:
                parts.append(1e-9 * taken["compute_ns"])
            time.sleep(max(0.0, due - time.monotonic()))
        return np.concatenate(parts) if parts else np.zeros(0)

    def close(self) -> None:
        """End both."""
        self._reader.close()
        self._file.close()
        self.rig.__exit__()
        self._memory.close()
        self._actions.close()


def run(minutes: float, turns: int) -> dict[str, Any]:
    """Time to answer without and with the panel, us, in turns of the same run."""
    times: dict[str, list[Float]] = {"without": [], "with": []}
    rates: list[float] = []
    with tempfile.TemporaryDirectory() as name:
        robot = Robot(Path(name))
        seconds = 60.0 * minutes / turns
        try:
            for k in range(turns):
                if k % 2 == 0:
                    times["without"].append(robot.turn(seconds))
                    continue
                watched = Watched(Path(name))
                robot.turn(min(5.0, seconds))  # the pages are opened meanwhile
                before = list(watched.pages.messages)
                times["with"].append(robot.turn(seconds))
                rates += [(b - a) / seconds for a, b in zip(before, watched.pages.messages, strict=True)]
                watched.close()
        finally:
            robot.close()
    figures = {
        kind: {
            name: round(1e6 * float(np.quantile(np.concatenate(rows), share)), 1) for name, share in QUANTILES.items()
        }
        for kind, rows in times.items()
    }
    halves = [np.concatenate(times["without"][k::2]) for k in range(2) if times["without"][k::2]]
    noise = [round(1e6 * float(np.quantile(half, 0.99)), 1) for half in halves]
    return {
        "cycles": {kind: int(sum(len(one) for one in rows)) for kind, rows in times.items()},
        "answer_us": figures,
        "p99_us_of_turns_without": noise,
        "messages_per_second_and_page": [round(rate, 1) for rate in rates],
    }


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="some seconds, to see that it runs")
    parser.add_argument("--minutes", type=float, default=30.0)
    given = parser.parse_args()
    print(json.dumps(run(0.5 if given.quick else given.minutes, 4), indent=2))


if __name__ == "__main__":
    main()
