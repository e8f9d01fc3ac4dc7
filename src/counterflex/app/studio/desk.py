"""Parts that all pages of the studio share: what is chosen, actions with their command, faults, tables."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar
from urllib.parse import quote

from nicegui import Client, events, ui
from nicegui.element import Element

from counterflex.app.panel import cell_scene
from counterflex.app.panel.cell_scene import CellScene
from counterflex.app.studio import texts
from counterflex.app.studio.jobs import CommandQueue, QueuedCommand
from counterflex.app.studio.project import Project
from counterflex.app.studio.stock_film import StockFilm
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError
from counterflex.core.printable import printable
from counterflex.programs.language import LANGUAGES, at_prompt

UPLOAD: Final = 512 << 20
"""Bytes of a file that may be dropped into the project."""
_SHARED: Final = str(Path(cell_scene.__file__).with_name("cell_view"))
_Result = TypeVar("_Result")
Ended = Callable[[QueuedCommand], Awaitable[None]]
"""Called with a command when it has ended."""


class Workbench:
    """Choices of one page of a browser, and the queue of commands of all of them."""

    def __init__(self, client: Client, project: Project, queue: CommandQueue) -> None:
        self.client, self.project, self.queue = client, project, queue
        self.cell = self.program = ""
        self.changed: list[Callable[[], Awaitable[None]]] = []
        self.go: Callable[[str], None] = lambda _: None
        self.measure: Callable[[str], Awaitable[None]] | None = None
        self.at_line: Callable[[int], Awaitable[None]] | None = None
        self._seen = sum(job.ended for job in queue.jobs)
        self._ends: list[tuple[QueuedCommand, Ended]] = []

    @property
    def cell_file(self) -> Path:
        """The cell file that is chosen."""
        return self.project.folder / self.cell

    @property
    def program_file(self) -> Path:
        """The program that is chosen."""
        return self.project.folder / self.program

    def lacking(self) -> str:
        """Request for a choice that is missing before anything can be computed; empty where none is."""
        lack = [name for name, value in ((texts.CELL, self.cell), (texts.PROGRAM, self.program)) if not value]
        return texts.NEEDS.format(what=" + ".join(lack)) if lack else ""

    async def choose(self, cell: str | None = None, program: str | None = None) -> None:
        """Choose cell file, program or both, and show what follows from it."""
        self.cell = self.cell if cell is None else cell
        self.program = self.program if program is None else program
        await self.refresh()

    async def refresh(self) -> None:
        """Show what the folder holds now."""
        for one in self.changed:
            try:
                await one()
            except (AttributeError, KeyError, OSError, TypeError, ValueError) as fault:  # of another's making, or gone
                with self.client:
                    ui.notify(texts.NOT_SHOWN.format(fault=printable(repr(fault))), type="warning")

    def run(self, line: str, after: Ended | None = None) -> None:
        """CommandQueue a command; ``after`` is called when it has ended."""
        job = self.queue.add(line)
        if after is not None:
            self._ends.append((job, after))

    async def look(self) -> None:
        """Call what waits for commands that have ended; show what those of other pages have written."""
        ended = [pair for pair in self._ends if pair[0].ended]
        self._ends = [pair for pair in self._ends if not pair[0].ended]
        for job, after in ended:
            await after(job)
        count = sum(job.ended for job in self.queue.jobs)
        if count > self._seen and not ended:
            await self.refresh()
        self._seen = count


class FaultBanner:
    """A fault on a page; nothing where there is none."""

    def __init__(self, mark: str) -> None:
        self._label = ui.label("").classes("st-fault").props(f'role="alert" data-test="{mark}"')
        self.show("")

    @property
    def shown(self) -> bool:
        """A fault is shown."""
        return bool(self._label.text)

    def show(self, text: str) -> None:
        """Show a text; empty takes the last one away."""
        self._label.set_text(printable(text))
        self._label.set_visibility(bool(text))

    async def during(self, work: Callable[..., _Result], *arguments: Any) -> _Result | None:
        """Compute in a thread; a fault of the user's making is shown, and None returned."""
        self.show("")
        try:
            return await asyncio.to_thread(work, *arguments)
        except CounterflexError as fault:
            self.show(str(fault))
            return None


class Action:
    """A button and the command line that it runs; without one it says what is missing.

    Args:
        lines: Command lines by what is chosen; none: nothing can be run yet.
        lacking: What is missing then.
        after: Called when the command has ended.
    """

    def __init__(
        self, desk: Workbench, mark: str, title: str, lines: Callable[[], list[str]], lacking: Callable[[], str],
        after: Ended, *, main: bool = True,
    ) -> None:  # fmt: skip
        self._desk, self._lines, self._lacking, self._after = desk, lines, lacking, after
        with ui.row().classes("st-action"):
            self._button = ui.button(title, on_click=self._press)
            self._button.props(f'no-caps {"unelevated" if main else "outline"} data-test="{mark}"')
            self._text = command_text("")
        self.refresh()

    def refresh(self) -> None:
        """Show the command as it is now."""
        lines = self._lines()
        self._button.set_enabled(bool(lines))
        self._text.set_text("\n".join(lines) or self._lacking())

    def _press(self) -> None:
        for line in self._lines():
            self._desk.run(line, self._after)


def command_text(line: str) -> ui.label:
    """A command line that a click copies."""
    label = ui.label(line).classes("st-command").tooltip(texts.HELP_COMMAND)
    label.props("tabindex=0 role=button")
    for event in ("click", "keydown.enter"):
        label.on(event, lambda: (ui.clipboard.write(label.text), ui.notify(texts.COPIED, timeout=800)))
    return label


def table(columns: Sequence[str], rows: Sequence[Sequence[str]], *, mark: str) -> Element:
    """A table of texts."""
    with ui.element("div").classes("st-scroll"), ui.element("table").classes("st-table") as made:
        made.props["data-test"] = mark
        with ui.element("tr"):
            for column in columns:
                with ui.element("th"):
                    ui.label(column)
        for row in rows:
            with ui.element("tr"):
                for cell in row:
                    with ui.element("td"):
                        ui.label(printable(cell))
    return made


def card(style: str, mark: str) -> Element:
    """A box; its mark may be the name of any file: it is not read as properties."""
    box = ui.element("div").classes(style)
    box.props["data-test"] = mark
    return box


class Drop:
    """A place to drop a file into the project.

    Args:
        taken: Called with its name when it is there.
    """

    def __init__(self, desk: Workbench, mark: str, taken: Callable[[str], Awaitable[None]]) -> None:
        self._desk, self._taken = desk, taken
        self.fault: FaultBanner
        with ui.element("div").props(f'data-test="{mark}"').classes("st-drop"):
            ui.upload(
                label=texts.UPLOAD, auto_upload=True, max_file_size=UPLOAD, on_upload=self._take,
                on_rejected=lambda: self.fault.show(texts.TOO_LARGE.format(limit=UPLOAD >> 20)),
            ).props("flat bordered")  # fmt: skip
            self.fault = FaultBanner(f"{mark}-fault")

    async def _take(self, event: events.UploadEventArguments) -> None:
        name = Path(event.file.name.replace("\\", "/")).name
        place = self._desk.project.folder / name
        event.sender.reset()
        if name.startswith("."):
            self.fault.show(texts.NO_NAME.format(ending="..."))
            return
        self.fault.show("")
        try:
            with place.open("xb") as file:  # neither through a link nor over a file that another page has just made
                async for chunk in event.file.iterate():
                    file.write(chunk)
        except FileExistsError:
            self.fault.show(texts.ALREADY.format(name=name))
            return
        except (OSError, ValueError) as fault:
            with contextlib.suppress(OSError, ValueError):  # nothing half-written stays
                place.unlink()
            self.fault.show(texts.NOT_TAKEN.format(name=name, fault=fault))
            return
        await self._taken(name)


def language(summary: dict[str, Any]) -> str:
    """Name of the language of a compensated program, as people call it."""
    word = str(summary.get("language", ""))
    dialect = at_prompt("write").get(word, word)
    return LANGUAGES[dialect].short if dialect in LANGUAGES else word


def result_links(desk: Workbench, folder: str) -> None:
    """Links to the files of a folder of results: the report first, programs to download."""
    summary = desk.project.summary(folder)
    report = f"{folder}/report.html"
    with ui.row().classes("st-links"):
        if desk.project.inside(report):
            link = ui.link(texts.REPORT, f"/files/{quote(report)}", new_tab=True)
            link.props["data-test"] = f"report-{folder}"
        for name in summary.get("files", []):
            link = ui.link(str(name), f"/files/{quote(f'{folder}/{name}')}?save")
            link.props["data-test"] = f"file-{name}"


def error_bars(title: str, before_mm: Sequence[float], after_mm: Sequence[float], *, mark: str) -> None:
    """Two bars, before and after, each (value, low, high) in mm; low and high are drawn where they differ."""
    most = max(*before_mm, *after_mm, 1e-9)
    with card("st-bars", mark):
        ui.label(title).classes("st-note")
        for word, kind, (value, low, high) in (
            (texts.BEFORE, "st-red", before_mm),
            (texts.AFTER, "st-green", after_mm),
        ):
            with ui.element("div").classes("st-bar"):
                ui.label(word)
                with ui.element("i"):
                    ui.element("b").classes(kind).style(f"width: {100.0 * value / most:.1f}%")
                    if high > low:
                        span = f"left: {100.0 * low / most:.1f}%; width: {100.0 * (high - low) / most:.1f}%"
                        ui.element("u").style(span)
                text = f"{value:.2f}" + (f" ({low:.2f} to {high:.2f})" if high > low else "")
                ui.label(text).classes("st-number")


class SceneView(Element, component="view.js", esm={"counterflex-cell-view": _SHARED}):  # type: ignore[call-arg, misc]
    """A cell, and the way of a tool on it.

    Args:
        ready: Called when the browser can draw.
    """

    def __init__(self, ready: Callable[[], Any]) -> None:
        super().__init__()
        self._props["words"] = texts.SCENE
        self.classes("st-view-box")
        self.on("ready", lambda: ready())

    def show_cell(self, scene: CellScene, q: Float) -> None:
        """Draw the bodies of a cell at angles of the axes, rad as the controller computes with them."""
        self.run_method("cell", scene.bodies, scene.frames(q))

    def stand(self, scene: CellScene, q: Float, compliance_um_per_n: list[float] | None) -> None:
        """Move the robot to angles; the ellipsoid, where there is one, is the deflection under 100 N."""
        self.run_method("pose", scene.frames(q), compliance_um_per_n)

    def show_way(self, drawn: dict[str, Any], source: list[str], *, near: bool) -> None:
        """Draw the way of the tool (:meth:`ToolWay.drawn`), with the text of its program."""
        self.run_method("path", drawn, source, near)

    def show_film(self, film: StockFilm) -> None:
        """Draw the stock in place of the blank, as it is cut along the way."""
        self.run_method("film", film.drawn())

    def paint(self, channel: str) -> None:
        """Colour the way by a channel."""
        self.run_method("paint", channel, *texts.CHANNELS[channel])
