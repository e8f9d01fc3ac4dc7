"""Panel and OPC UA server beside a long run, as a person starts them, and a client that goes on reading both."""

from __future__ import annotations

import asyncio
import contextlib
import html
import json
import multiprocessing
import re
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from counterflex.core.errors import OutputError

READ_S: Final = 1.0
"""From one reading over OPC UA to the next."""
_NODES: Final = "urn:counterflex:opcua"
_NAMESPACE_FOLDERS: Final = ("Counterflex", "MotionDeviceSystem")
_ENDS_S: Final = 20.0


class Onlookers:
    """Panel, OPC UA server, and a process with a client of each.

    Args:
        log: Folder of the run log.

    Raises:
        OutputError: A server does not come up.
    """

    def __init__(self, log: Path) -> None:
        self._servers: dict[str, subprocess.Popen[str]] = {}
        self._client: Any = None
        context = multiprocessing.get_context("spawn")
        self._ended, self._counts = context.Event(), context.Array("q", 4, lock=False)
        try:
            page = self._serve("panel", log, "viewer: ")
            values = self._serve("opcua", log, "OPC UA: ")
        except BaseException:
            self.close()
            raise
        self._client = context.Process(target=_clients, args=(page, values, self._counts, self._ended), daemon=True)
        self._client.start()

    def _serve(self, name: str, log: Path, mark: str) -> str:
        command = [sys.executable, "-m", "counterflex", name, str(log), "--port", "0"]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self._servers[name] = server
        for line in server.stdout or ():
            if line.startswith(mark):
                return line.removeprefix(mark).strip()
        raise OutputError(f"{name} does not come up", value=f"exit status {server.wait()}")

    def pids(self) -> dict[str, int | None]:
        """Processes by name."""
        return {**{name: server.pid for name, server in self._servers.items()}, "clients": self._client.pid}

    def counts(self) -> dict[str, float]:
        """Counts since the start: pictures that the page got, times that it was opened, readings, failed readings."""
        names = ("pictures", "page_opened", "opcua_readings", "opcua_failed")
        return {name: float(value) for name, value in zip(names, self._counts, strict=True)}

    def close(self) -> dict[str, int | None]:
        """End them; returns the exit status of each server: 130 where it ended as it was asked to."""
        self._ended.set()
        if self._client is not None:
            self._client.join(_ENDS_S)
            self._client.terminate()
        out: dict[str, int | None] = {}
        for name, server in self._servers.items():
            if server.poll() is None:
                server.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                server.wait(_ENDS_S)
            out[name] = server.returncode
            server.kill()
            server.wait()
        return out


def _clients(page: str, values: str, counts: Any, ended: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    asyncio.run(_both(page, values, counts, ended))


async def _both(page: str, values: str, counts: Any, ended: Any) -> None:
    await asyncio.gather(_kept_page(page, counts, ended), _kept_readings(values, counts, ended))


async def _kept_page(link: str, counts: Any, ended: Any) -> None:
    """Keep a page open; one that has lost its connection is loaded again, as a browser does."""
    import aiohttp

    async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session:
        while not ended.is_set():
            counts[1] += 1
            with contextlib.suppress(Exception):  # counted: it is opened again
                await _show_page(session, link if counts[1] == 1 else _base_of(link), counts, ended)
            await asyncio.sleep(READ_S if not ended.is_set() else 0.0)


def _base_of(link: str) -> str:
    """Address of a page without its key: the session knows it by its cookie."""
    return link.split("?")[0].rstrip("/")


async def _show_page(session: Any, link: str, counts: Any, ended: Any) -> None:
    """Be a page of the panel without a browser, until ``ended``: read all that is sent, and say that it was.

    Raises:
        OutputError: The page looks otherwise than a page of the panel.
    """
    import socketio

    base = _base_of(link)
    async with session.get(link) as answer:
        text = await answer.text()
    raw = re.search(r"String\.raw`(.*?)`", text, re.DOTALL)
    client = re.search(r'client_id"?\'?: ?[\'"]([0-9a-f-]{36})', text)
    if raw is None or client is None:
        raise OutputError("the page of the panel has no elements or no client", where=base)
    elements = json.loads(html.unescape(raw.group(1)))
    live, listeners = next(
        (int(number), {one["type"]: one["listener_id"] for one in element["events"]})
        for number, element in elements.items()
        if {"ready", "seen"} <= {one["type"] for one in element.get("events", [])}
    )
    ids = {"client_id": client.group(1), "tab_id": "tab", "document_id": "tab 1", "next_message_id": 0}
    page = _Page(socketio.AsyncClient(http_session=session, reconnection=False), live, listeners, ids, counts)
    page.socket.on("run_javascript", page.called)
    await page.socket.connect(
        base, headers={"Origin": base}, socketio_path="/_nicegui_ws/socket.io", transports=["websocket"]
    )
    await page.socket.call("handshake", ids)
    await page.event("ready", 0)
    while page.socket.connected and not ended.is_set():
        await asyncio.sleep(0.05)
    await page.socket.disconnect()


@dataclass(frozen=True)
class _Page:
    """The live element of a page of the panel."""

    socket: Any
    element: int
    listeners: dict[str, str]
    ids: dict[str, Any]
    counts: Any

    async def event(self, kind: str, value: int) -> None:
        """Tell the server of an event of the element."""
        facts = {"id": self.element, "client_id": self.ids["client_id"], "listener_id": self.listeners[kind]}
        await self.socket.emit("event", {**facts, "args": [json.dumps(value)]})

    async def called(self, data: Any) -> None:
        """Count a picture that the server shows, and say that it was seen."""
        show = f'return runMethod({self.element}, "show", '
        if data["code"].startswith(show):
            (message,) = json.loads(data["code"][len(show) : -1])
            self.counts[0] += 1
            await self.event("seen", int(message["number"]))


async def _kept_readings(address: str, counts: Any, ended: Any) -> None:
    """Read every variable once a second; a connection that is lost is made again."""
    import asyncua

    while not ended.is_set():
        with contextlib.suppress(Exception):  # counted: the next connection goes on
            async with asyncua.Client(address, watchdog_intervall=60.0) as client:
                nodes = await _variables(client)
                while not ended.is_set():
                    await client.read_values(nodes)
                    counts[2] += 1
                    await asyncio.sleep(READ_S)
        if not ended.is_set():
            counts[3] += 1
            await asyncio.sleep(READ_S)


async def _variables(client: Any) -> list[Any]:
    """All variables of the server's own folders."""
    from asyncua import ua

    space = await client.get_namespace_index(_NODES)
    variables, rest = [], [client.get_node(ua.NodeId(name, space)) for name in _NAMESPACE_FOLDERS]
    while rest:
        one = rest.pop()
        if await one.read_node_class() == ua.NodeClass.Variable:
            variables.append(one)
        else:
            rest += await one.get_children()
    return variables
