"""Cost of the operator panel: times to answer with and without it, in alternating blocks of one run.

``python benchmarks/panel.py [--quick] [--minutes M] [--json FILE]``. A loop in a process of its own answers a robot
over real sockets every 4 ms. In three of four blocks a panel serves four pages at 20 Hz; M minutes are with the panel.
The pages are clients of its sockets without a browser, in a process of lower priority: a browser belongs on the
computer that it is looked at with. They read all that is sent and acknowledge it as the page does, and one that has
lost its connection loads the page again, as a browser does; how often that was is printed.

Blocks come in groups: one without and three with panel, in turned order in every second group, so that a load that
grows or falls steadily cancels. Per group and percentile: mean of the blocks with panel less the block without. Over
all groups: mean, its 95 % interval (Student), and the p-value of turning the signs of the groups at random, which asks
for no distribution. ``like_us`` is the standard deviation of the difference of two neighbouring blocks of the same
kind: what a difference may be with nothing changed. Three percentiles are judged, so one counts as changed where its
p-value is below 0.05 / 3.

Two times: ``answer`` by the loop's own clock, from the telegram received to the answer sent; ``reply`` by the robot's,
from before it sends to having the answer, with what the scheduler adds. Robot and loop have real-time priority where
the system allows it.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import html
import itertools
import json
import math
import multiprocessing
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy import stats

from counterflex.app.environment import environment
from counterflex.core.arrays import Float
from counterflex.core.units import NS, UM
from counterflex.protocols.processes.actions import Actions, actions_path
from counterflex.protocols.processes.operator_words import OperatorFile
from counterflex.protocols.processes.snapshot import SnapshotMemory, SnapshotReader, snapshot_path
from counterflex.protocols.system.machine import processor_times
from counterflex.runtime.state.states import State
from counterflex_lab.faults.process_rig import ProcessRig

PERIOD_S: Final = 0.004
CLIENTS: Final = 4
WITH: Final = 3
"""Blocks with panel in a group; one is without."""
PERCENTILES: Final = {"p50": 0.5, "p99": 0.99, "p999": 0.999}
LEVEL: Final = 0.05 / len(PERCENTILES)
TURNS: Final = 20_000
PATIENCE_S: Final = 120.0
ROBOT_PRIORITY: Final = 70
"""Below the loop's."""


def pages(link: str, counts: Any, end: Any) -> None:
    """A process of pages without browsers: they read all that is sent and say that they have."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(OSError, AttributeError):
        os.nice(10)
    asyncio.run(_pages(link, counts, end))


async def _pages(link: str, counts: Any, end: Any) -> None:
    import aiohttp

    async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session:
        await asyncio.gather(*(_page(session, link, k, counts, end) for k in range(CLIENTS)))


async def _page(session: Any, link: str, k: int, counts: Any, end: Any) -> None:
    await _open_page(session, link, k, counts, end)
    while not end.is_set():
        counts[CLIENTS + k] += 1
        await _open_page(session, _base(link), k, counts, end)


def _base(link: str) -> str:
    return link.split("?")[0].rstrip("/")


async def _open_page(session: Any, link: str, k: int, counts: Any, end: Any) -> None:
    """Show the page until the end, or until its connection is lost."""
    import socketio

    base = _base(link)
    async with session.get(link) as answer:
        text = await answer.text()
    raw = re.search(r"String\.raw`(.*?)`", text, re.DOTALL)
    client = re.search(r'client_id"?\'?: ?[\'"]([0-9a-f-]{36})', text)
    if raw is None or client is None:
        raise RuntimeError("the page of the panel looks otherwise than this benchmark expects")
    elements = json.loads(html.unescape(raw.group(1)))
    live, listeners = next(
        (int(number), {one["type"]: one["listener_id"] for one in element["events"]})
        for number, element in elements.items()
        if {"ready", "seen"} <= {one["type"] for one in element.get("events", [])}
    )
    ids = {"client_id": client.group(1), "tab_id": f"tab{k}", "document_id": f"document{k}", "next_message_id": 0}
    client_socket = socketio.AsyncClient(http_session=session, reconnection=False)

    def event(kind: str, value: int) -> Any:
        facts = {"id": live, "client_id": ids["client_id"], "listener_id": listeners[kind], "args": [json.dumps(value)]}
        return client_socket.emit("event", facts)

    show = f'return runMethod({live}, "show", '

    async def called(data: Any) -> None:
        if data["code"].startswith(show):
            (message,) = json.loads(data["code"][len(show) : -1])
            counts[k] += 1
            await event("seen", int(message["number"]))

    client_socket.on("run_javascript", called)
    await client_socket.connect(
        base, headers={"Origin": base}, socketio_path="/_nicegui_ws/socket.io", transports=["websocket"]
    )
    await client_socket.call("handshake", ids)
    await event("ready", 0)
    while client_socket.connected and not end.is_set():
        await asyncio.sleep(0.05)
    await client_socket.disconnect()


class Watched:
    """A panel and its pages; they are opened while the robot goes on."""

    def __init__(self, folder: Path, robot: Robot) -> None:
        command = [sys.executable, "-m", "counterflex", "panel", str(folder), "--port", "0"]
        self._panel = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self._panel.stdout is not None
        lines: list[str] = []
        reader = threading.Thread(target=lambda: lines.extend(self._panel.stdout or ()), daemon=True)
        reader.start()
        while len(lines) < 2:  # it takes seconds to load; the robot does not wait
            robot.block(0.25)
            if self._panel.poll() is not None:
                raise RuntimeError("the panel ended")
        link = dict(line.strip().split(": ", 1) for line in lines)["viewer"]
        context = multiprocessing.get_context("spawn")
        self.counts, self._end = context.Array("q", 2 * CLIENTS, lock=False), context.Event()
        self._pages = context.Process(target=pages, args=(link, self.counts, self._end), daemon=True)
        self._pages.start()
        begin = time.monotonic()
        while min(self.counts[:CLIENTS]) < 5:
            robot.block(0.25)
            if time.monotonic() - begin > PATIENCE_S or not self._pages.is_alive():
                raise RuntimeError(f"the pages get nothing: {list(self.counts[:CLIENTS])} messages")

    def processor_s(self) -> float:
        """Processor time of the panel so far, s; not a number where the system does not say."""
        try:
            words = Path(f"/proc/{self._panel.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return math.nan
        return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")

    def close(self) -> None:
        """Close both."""
        self._end.set()
        self._pages.join(PATIENCE_S)
        self._panel.send_signal(signal.SIGINT)
        self._panel.wait()


class TimedSocket(socket.socket):
    """A socket that knows when it was last asked to send."""

    sent_ns = 0

    def sendto(self, *args: Any) -> int:
        """Send, and note when."""
        self.sent_ns = time.perf_counter_ns()
        return super().sendto(*args)


class TimedRig(ProcessRig):
    """A rig whose robot takes the time until it has its answer.

    Attributes:
        replies_ns: From before it sent to having the answer.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._socket.close()
        self._socket = self._timed = TimedSocket(socket.AF_INET, socket.SOCK_DGRAM)
        self._timed.bind(("127.0.0.1", 0))
        self.replies_ns: list[int] = []

    def _answer(self, patience_s: float) -> bytes | None:
        answer = super()._answer(patience_s)
        self.replies_ns.append(time.perf_counter_ns() - self._timed.sent_ns)
        return answer


class Robot:
    """The loop, and its robot at 250 Hz."""

    def __init__(self, folder: Path) -> None:
        self.rig = TimedRig(folder)
        words = self.rig._words.path
        self._memory = SnapshotMemory(words)
        self._actions = Actions(actions_path(words), make=True)
        self.rig.start_loop()
        self._file = OperatorFile(folder, words)
        self._reader = SnapshotReader(snapshot_path(words))
        self.rig.activate()
        self.fifo = _real_time()
        self._due = time.monotonic()
        self.late = self.holds = 0

    def block(self, seconds: float) -> dict[str, Float]:
        """Times to answer of each cycle of a block, s."""
        rig, parts = self.rig, []
        rig.replies_ns.clear()
        self._reader.take()
        for _ in range(round(seconds / PERIOD_S)):
            rig.cycle(300.0 if rig.state == State.ACTIVE else 0.0)
            self.holds += rig.state != State.ACTIVE
            if (taken := self._reader.take()).size:
                parts.append(NS * taken["compute_ns"])
            self._due += PERIOD_S
            now = time.monotonic()
            if now > self._due:  # the machine stood still: go on from here
                self.late, self._due = self.late + 1, now
            time.sleep(self._due - now)
        return {"answer": np.concatenate(parts), "reply": NS * np.array(rig.replies_ns, dtype=np.float64)}

    def close(self) -> None:
        """End both."""
        self._reader.close()
        self._file.close()
        self.rig.__exit__()
        self._memory.close()
        self._actions.close()


def _real_time() -> bool:
    """Real-time priority for the robot; its children have none."""
    with contextlib.suppress(OSError, AttributeError):
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy, os.sched_param(ROBOT_PRIORITY))
        return True
    return False


def order(groups: int) -> Iterator[tuple[int, bool]]:
    """Group of each block, and whether it is with the panel: W PPP, PPP W, W PPP, ..."""
    for group in range(groups):
        blocks = [False] + [True] * WITH
        yield from ((group, one) for one in (blocks if group % 2 == 0 else blocks[::-1]))


def judge(values: Float, kinds: list[bool], groups: list[int], seed: int = 0) -> dict[str, Any]:
    """Return whether a percentile changes with the panel.

    Args:
        values: (n,) us, the percentile of each block.
        kinds: With the panel.
        groups: Group of each block.
        seed: Of the signs that are turned.
    """
    with_panel, of = np.array(kinds), np.array(groups)
    differences = np.array(
        [values[(of == g) & with_panel].mean() - values[(of == g) & ~with_panel].mean() for g in np.unique(of)]
    )
    like = [b - a for (a, x), (b, y) in itertools.pairwise(zip(values, kinds, strict=True)) if x == y]
    n, mean = len(differences), float(np.mean(differences))
    spread = float(np.std(differences, ddof=1)) / math.sqrt(n) if n > 1 else math.nan
    reach = float(stats.t.ppf(0.975, n - 1)) * spread if n > 1 else math.nan
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], size=(TURNS, n))
    p = (1 + int(np.sum(np.abs(signs @ differences) / n >= abs(mean) * (1.0 - 1e-12)))) / (1 + TURNS)
    return {
        "difference_us": round(mean, 2),
        "interval95_us": [round(mean - reach, 2), round(mean + reach, 2)] if n > 1 else None,
        "like_us": round(float(np.std(like)), 2) if like else None,
        "p_value": round(p, 4),
        "changed": p < LEVEL,
    }


def run(seconds: float, groups: int) -> dict[str, Any]:
    """Times to answer without and with the panel in alternating blocks, and the verdicts.

    Args:
        seconds: Of a block.
        groups: Of one block without and three with the panel.
    """
    blocks: list[tuple[int, bool, dict[str, Float]]] = []
    loads, rates, used, again = [], [], 0.0, 0
    with tempfile.TemporaryDirectory() as name:
        robot, watched = Robot(Path(name)), None
        before = processor_times()
        try:
            robot.block(min(2.0, seconds))
            for group, with_panel in order(groups):
                if not with_panel and watched is not None:
                    watched.close()
                    watched = None
                    robot.block(0.5)
                if with_panel and watched is None:
                    watched = Watched(Path(name), robot)
                at = (0.0, [0] * 2 * CLIENTS) if watched is None else (watched.processor_s(), list(watched.counts))
                blocks.append((group, with_panel, robot.block(seconds)))
                loads.append(os.getloadavg()[0])
                _say(len(blocks), with_panel, blocks[-1][2], loads[-1])
                if watched is not None:
                    used += watched.processor_s() - at[0]
                    grown = [b - a for a, b in zip(at[1], watched.counts, strict=True)]
                    rates += [count / seconds for count in grown[:CLIENTS]]
                    again += sum(grown[CLIENTS:])
        finally:
            if watched is not None:
                watched.close()
            robot.close()
    after = processor_times()
    groups_of, kinds = [group for group, _, _ in blocks], [kind for _, kind, _ in blocks]
    shown: dict[str, Any] = {}
    for time_name in ("answer", "reply"):
        all_of = {kind: np.concatenate([t[time_name] for _, k, t in blocks if k == kind]) for kind in (False, True)}
        shown[time_name] = {
            "without_us": _micro(all_of[False]),
            "with_us": _micro(all_of[True]),
            "blocks": {
                name: judge(np.array([np.quantile(t[time_name], share) / UM for _, _, t in blocks]), kinds, groups_of)
                for name, share in PERCENTILES.items()
            },
        }
    return {
        **shown,
        "changed": sorted(f"{t} {n}" for t in shown for n, one in shown[t]["blocks"].items() if one["changed"]),
        "block_s": seconds,
        "blocks_without": kinds.count(False),
        "blocks_with": kinds.count(True),
        "minutes_with_panel": round(kinds.count(True) * seconds / 60.0, 2),
        "cycles_late": robot.late,
        "cycles_not_active": robot.holds,
        "messages_per_second_and_page": {
            "least": round(min(rates), 1),
            "median": round(float(np.median(rates)), 1),
            "largest": round(max(rates), 1),
            "below_10": sum(rate < 10.0 for rate in rates),
            "of": len(rates),
            "pages_loaded_again": again,
        },
        "panel_cores": round(used / (kinds.count(True) * seconds), 3),
        "robot_real_time": robot.fifo,
        "load": {"least": min(loads), "median": round(float(np.median(loads)), 2), "largest": max(loads)},
        "load_of_blocks": loads,
        "stolen": round((after[1] - before[1]) / max(1, after[0] - before[0]), 4),
        "environment": environment(),
    }


def _say(number: int, with_panel: bool, times: dict[str, Float], load: float) -> None:
    """A line for each block, so that a run that is ended early has said something."""
    shown = {name: _micro(values) for name, values in times.items()}
    print(f"block {number} {'with' if with_panel else 'without'} panel, load {load:.2f}: {shown}", file=sys.stderr)


def _micro(times: Float) -> dict[str, float]:
    shares = {**PERCENTILES, "max": 1.0}
    out: dict[str, float] = {name: round(float(np.quantile(times, share)) / UM, 1) for name, share in shares.items()}
    return {**out, "n": len(times)}


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="some seconds, to see that it runs")
    parser.add_argument("--minutes", type=float, default=30.0, help="minutes with the panel")
    parser.add_argument("--block", type=float, default=30.0, help="seconds of a block")
    parser.add_argument("--json", type=Path, help="file of the figures")
    given = parser.parse_args()
    seconds = 1.0 if given.quick else given.block
    groups = 2 if given.quick else max(2, round(60.0 * given.minutes / (WITH * seconds)))
    figures = run(seconds, groups)
    text = json.dumps(figures, indent=2)
    if given.json is not None:
        given.json.write_text(text + "\n", encoding="utf-8")
    print(text)
    messages = figures["messages_per_second_and_page"]
    if messages["least"] <= 0.0 and messages["pages_loaded_again"] == 0:
        sys.exit("error: a page that was connected got no messages")


if __name__ == "__main__":
    main()
