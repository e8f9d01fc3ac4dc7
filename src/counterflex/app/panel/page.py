"""The page of the panel: what is live, the buttons of an operator, the report of the run when it has ended."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from html import escape
from pathlib import Path
from typing import Any, Final, Literal

from nicegui import Client, background_tasks, ui
from nicegui.element import Element
from nicegui.elements.scene import Scene
from nicegui.events import GenericEventArguments, KeyEventArguments

from counterflex.app.panel.access import PanelSession
from counterflex.app.panel.watched_run import WatchedRun
from counterflex.app.run.recorder import SUMMARY
from counterflex.core import file_content
from counterflex.core.errors import CounterflexError, FileFormatError
from counterflex.core.printable import printable

_SHOWN: Final = 50


def read_run(folder: Path) -> dict[str, Any]:
    """Summary of the last run of a folder; empty where there is none that can be read."""
    try:
        content = file_content.json_value(folder / SUMMARY)
    except FileFormatError:
        return {}
    return content if isinstance(content, dict) and content.get("job") == "run" else {}


def report_html(folder: Path) -> str:
    """The report of the last run of a folder; empty where it is not written yet."""
    run = read_run(folder)
    if not run:
        return ""
    ended = run.get("ended", {})
    reply = run.get("compute_us", {})
    figures = [
        ("ended", ended.get("said", run.get("loop_ended", ""))),
        ("cell", run.get("cell", "")),
        ("cycles", run.get("cycles", "")),
        ("time, s", run.get("seconds", "")),
        ("largest correction, µm", run.get("largest_correction_um", "")),
        ("answer, µm: p50, p99, p99.9, max".replace("µm", "µs"), ", ".join(str(v) for v in reply.values())),
        ("records lost", run.get("records_lost", "")),
        ("states, cycles", ", ".join(f"{_words(k)} {v}" for k, v in run.get("states", {}).items())),
        ("causes", ", ".join(_words(cause) for cause in run.get("causes", [])) or "none"),
        ("log", str(folder)),
    ]
    parts = ["<h2>Report of the run</h2>", _table((), figures)]
    incidents = [
        (one.get("number", ""), _words(one.get("state", "")), _words(one.get("cause", "")), one.get("time_s", ""))
        for one in run.get("incidents", [])[:_SHOWN]
    ]
    if incidents:
        parts += ["<h2>Holds and faults</h2>", _table(("number", "state", "cause", "time, s"), incidents)]
    actions = [
        (
            one.get("who", ""),
            one.get("from", ""),
            one.get("action", ""),
            "done" if one.get("done") else one.get("refused"),
        )
        for one in run.get("operator_actions", [])[-_SHOWN:]
    ]
    if actions:
        parts += ["<h2>Operators</h2>", _table(("who", "from", "action", "outcome"), actions)]
    return "".join(parts)


def _table(heads: tuple[str, ...], rows: list[tuple[Any, ...]]) -> str:
    head = "".join(f"<th>{escape(one)}</th>" for one in heads)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(printable(str(cell)))}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table>{f'<tr>{head}</tr>' if head else ''}{body}</table>"


def _words(name: object) -> str:
    return str(name).replace("_", " ")


Action = Literal["stop", "reset", "arm"]
IGNORED_IN: Final = ("input", "textarea")
"""Elements that take text: a key pressed there is text. A button that has the focus takes no key away."""
_LETTERS: Final[dict[str, Action]] = {"s": "stop", "r": "reset", "a": "arm"}
_PLACES: Final[dict[str, Action]] = {"KeyS": "stop", "KeyR": "reset", "KeyA": "arm"}


def action_of(name: str, code: str, *, shortcut: bool = False) -> Action | None:
    """Return what a key asks for.

    Escape, the letter S and the place of S on a keyboard of Latin letters all ramp out: of several readings of a key
    the one that stops is taken. The others go by the letter that is written on the key, and by the place where the
    layout has no Latin letters.

    Args:
        name: What the key writes, as the browser says it: ``s``, ``S``, ``Escape``.
        code: Where the key is: ``KeyS``, ``Escape``.
        shortcut: It is pressed together with Ctrl, Alt or Meta, which browsers have meanings for: only a stop counts.
    """
    letter = name.lower()
    if letter == "escape" or code == "Escape" or "stop" in (_LETTERS.get(letter), _PLACES.get(code)):
        return "stop"
    if shortcut:
        return None
    return _LETTERS.get(letter) if letter.isascii() else _PLACES.get(code)


BEHIND: Final = 20
"""Messages that a page may be behind, a second; then it gets none until it has caught up."""
_SCENE: Final = Scene  # Brings the library that the page draws with
_QUESTIONS: Final = {
    "reset": "Acknowledge the incident? The feed hold is released: a program that was not stopped goes on WITHOUT"
    " correction.",
    "arm": "Arm the correction? The robot program may then switch it on.",
}
ASKERS: Final = ThreadPoolExecutor(4, "asks")
"""Threads that wait for answers of the loop, 0.3 s at most each. Nothing else runs in them."""
_TITLES: Final = {"stop": "RAMP OUT", "reset": "ACKNOWLEDGE", "arm": "ARM"}


class Live(Element, component="live.js", esm={"counterflex-cell-view": "cell_view"}):  # type: ignore[call-arg, misc]
    """Figures, charts and the cell, drawn by the browser from one message per tick."""

    def __init__(self, session: PanelSession, range_um: float) -> None:
        super().__init__()
        self._props["role"], self._props["user"], self._props["range"] = session.role, session.name, range_um


class PanelPage:
    """One page in one browser.

    Args:
        report_action: Told in words what the operator did, for all pages.
    """

    def __init__(
        self,
        client: Client,
        session: PanelSession,
        run: WatchedRun,
        range_um: float,
        *,
        valid: Callable[[], bool],
        report_action: Callable[[str], None],
    ) -> None:
        self.client, self.session, self._run, self._valid = client, session, run, valid
        self._report_action = report_action
        self._ready = False
        self._sent = self._seen = 0
        self._trail, self._generation, self._scene = 0, (-1, -1), -1
        ui.dark_mode(True)
        with Live(session, range_um) as self._live, ui.element("div").classes("cf-buttons"):
            self._buttons()
        self._live.on("ready", self._begin)
        self._live.on("seen", self._heard)
        self._report = ui.html("", sanitize=False).classes("cf-report")
        self._reported = 0

    def _buttons(self) -> None:
        if self.session.operates:
            self._button("stop", "cf-stop")
            self._button("reset", "cf-button")
            self._button("arm", "cf-button")
            ui.keyboard(on_key=self._key, ignore=list(IGNORED_IN))
        else:
            ui.html("viewer: watches only", sanitize=False).classes("cf-viewer")
        with ui.element("div").classes("cf-foot").style("grid-column: 1 / 3"):
            ui.label(f"{self.session.name} ({self.session.role})")
            ui.link("log out", "/logout")

    def _button(self, action: str, kind: str) -> None:
        ui.button(_TITLES[action], on_click=lambda: self._press(action), color=None).classes(kind).props(
            f'no-caps data-test="{action}"'
        )

    async def _key(self, event: KeyEventArguments) -> None:
        """S or Escape ramps out at once; R and A ask first."""
        if not event.action.keydown or event.action.repeat:
            return
        held = event.modifiers
        action = action_of(event.key.name, event.key.code, shortcut=held.ctrl or held.alt or held.meta)
        if action is not None:
            await self._press(action)

    async def _press(self, action: str) -> None:
        if action in _QUESTIONS:
            # seamless: the page behind it, and the button that ramps out, stay usable
            with self.client, ui.dialog().props("seamless position=top") as dialog, ui.card():
                ui.label(_QUESTIONS[action])
                with ui.row():
                    ui.button(_TITLES[action], on_click=lambda: dialog.submit(True)).props('data-test="yes"')
                    ui.button("BACK", on_click=lambda: dialog.submit(False)).props('data-test="no"')
            sure = await dialog
            dialog.delete()
            if not sure:
                return
        await self._ask(action)

    async def _ask(self, action: str) -> None:
        if not (self.session.operates and self._valid()):
            self._tell("Log in again as an operator.", "negative")
            return
        if action == "stop":
            self._run.stop_now()  # here, and not in a thread: it waits for nothing
        who, source = self.session.name, self.session.source
        try:
            answer = await asyncio.get_running_loop().run_in_executor(ASKERS, self._run.request, action, who, source)
        except CounterflexError as fault:
            self._tell(f"{_TITLES[action]}: {fault}", "negative")
            self._report_action(f"{self.session.name} {_TITLES[action]}: FAILED")
            return
        done = answer["done"]
        text = f"{_TITLES[action]}: {'done' if done else answer['refused']} ({answer['state'].replace('_', ' ')})"
        self._tell(text, "positive" if done else "warning")
        self._report_action(f"{self.session.name} {text}")

    def _tell(self, text: str, kind: Any) -> None:
        if self.client.has_socket_connection:
            with self.client:
                ui.notify(printable(text), type=kind, position="top", timeout=6000, classes="text-h5")

    def _begin(self) -> None:
        self._ready = True
        self._sent = self._seen = self._trail = 0
        self._generation, self._scene = (-1, -1), -1

    def _heard(self, event: GenericEventArguments) -> None:
        if isinstance(event.args, int):
            self._seen = event.args

    def show(self, message: dict[str, Any], last: dict[str, Any], scene: list[dict[str, Any]]) -> None:
        """Send what is new, unless the page is behind.

        Args:
            last: What was last new, for a page that has just begun.
        """
        if not self._ready or not self.client.has_socket_connection or self._sent - self._seen > BEHIND:
            return
        if self._scene != self._run.runs:
            self._scene = self._run.runs
            self._live.run_method("bodies", scene)
        self._sent += 1
        trail = self._run.trail
        generation = (self._run.runs, trail.generation)
        if generation != self._generation:
            self._generation, self._trail = generation, 0
        points = trail.after(self._trail)
        self._trail += len(points)
        part = {"trail": {"generation": 1000 * generation[0] + generation[1], "points": points}}
        first = last if self._sent == 1 else {}
        self._live.run_method("show", {**first, **message, "number": self._sent, **part})
        if self._reported != self._run.runs and message["seen"] == "ended":
            self._reported = self._run.runs
            background_tasks.create(self._show_report())

    async def _show_report(self) -> None:
        """The report, as soon as the recorder has written its summary; it may take some seconds."""
        for _ in range(60):
            html = await asyncio.to_thread(report_html, self._run.folder)
            if html:
                with self.client:
                    self._report.set_content(html)
                return
            await asyncio.sleep(0.5)
