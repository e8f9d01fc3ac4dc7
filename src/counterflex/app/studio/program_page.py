"""The page of the program: its way in 3-D with the robot along the time, coloured by what is known of it."""

from __future__ import annotations

import asyncio
import threading
from dataclasses import replace

import numpy as np
from nicegui import background_tasks, ui

from counterflex.app.panel.cell_scene import CellScene
from counterflex.app.studio import texts
from counterflex.app.studio.desk import Drop, FaultBanner, SceneView, Workbench, command_text
from counterflex.app.studio.stock_film import StockFilm
from counterflex.app.studio.tool_way import ToolWay
from counterflex.core.errors import CounterflexError
from counterflex.core.next_command import next_command
from counterflex.core.printable import printable
from counterflex.programs.source_text import read_text


class ProgramPage:
    """Everything about the program that is chosen, on the cell that is chosen."""

    def __init__(self, desk: Workbench) -> None:
        self._desk = desk
        self._way: ToolWay | None = None
        self._scene: CellScene | None = None
        self._shown = ""
        self._stop = threading.Event()  # Set where the stock that is being cut is no longer looked at
        desk.client.on_delete(lambda: self._stop.set())
        with ui.row().classes("st-row"):
            self._plan = ui.select({"": texts.NO_PLAN}, label=texts.PLAN, value="", on_change=self._show)
            self._plan.classes("st-pick").props('data-test="plan-of-path"')
            self._channel = ui.select({}, label=texts.PLAN_COLOUR, on_change=self._paint)
            self._channel.classes("st-pick").props('data-test="channel"')
            self._about = ui.label("").classes("st-note").props('data-test="about"')
            ui.space()
            Drop(desk, "drop-program", lambda name: desk.choose(program=name))
        self.fault = FaultBanner("program-fault")
        self._note = ui.label("").classes("st-note")
        self._view = SceneView(self._draw).classes("st-tall")
        self._command = command_text("")
        desk.changed.append(self.refresh)

    async def refresh(self) -> None:
        """Read the program again where it, the cell, or the plans are others than before."""
        desk = self._desk
        plans = desk.project.plans(desk.program) if desk.program else []
        options = {"": texts.NO_PLAN, **{name: name for name in plans}}
        if options != self._plan.options:
            new = [name for name in plans if name not in self._plan.options]
            here = self._plan.value if self._plan.value in options else ""
            self._plan.set_options(options, value=new[-1] if new else here)
        lack = desk.lacking()
        if lack:
            self.fault.show(lack)
            return
        files = (desk.cell_file, desk.program_file)
        mark = " ".join(f"{file} {file.stat().st_mtime_ns}" for file in files if file.is_file())
        if mark != self._shown:
            self._shown = mark
            self._command.set_text(next_command("path", desk.program, cell=desk.cell))
            self._way = await self.fault.during(ToolWay.of_program, desk.program_file, desk.cell_file)
            self._scene = None if self._way is None else CellScene(desk.cell_file)
            self._draw()

    async def to_line(self, number: int) -> None:
        """Select a line of the program."""
        self._view.run_method("toLine", number)

    async def _show(self) -> None:
        self._draw()

    def _planned(self) -> ToolWay | None:
        plan = self._desk.project.inside(f"{self._plan.value}/plan.parquet") if self._plan.value else None
        if self._way is None or plan is None:
            return self._way
        way = self._way.with_plan(plan, self._desk.cell_file)
        if self._desk.project.made_with(self._plan.value, self._desk.cell):
            return way
        return replace(way, q=None, why=f"{self._plan.value}: {texts.OTHER_CELL}")

    def _draw(self) -> None:
        """Send everything to the browser."""
        if self._way is None or self._scene is None:
            return
        self._stop.set()
        self._stop = threading.Event()
        background_tasks.create(self._send(self._scene, self._stop), name="draw the program")

    async def _send(self, scene: CellScene, stop: threading.Event) -> None:
        way = await self.fault.during(self._planned)
        if way is None:
            return
        drawn = await asyncio.to_thread(way.drawn, scene)
        with self._view.client:
            source = read_text(self._desk.program_file)[0].splitlines()
            self._view.show_cell(scene, np.zeros(6))
            self._view.show_way(drawn, source, near=True)
            names = {channel: texts.CHANNELS[channel][0] for channel in way.values}
            best = next(name for name in ("after", "before", "height") if name in names)
            value = self._channel.value if self._channel.value in names else best
            self._channel.set_options(names, value=best if "before" in names and value == "height" else value)
            self._paint()
            about = way.about
            self._about.set_text(texts.SUMMARY.format(**about))
            notes = [] if not way.why else [texts.NOT_REACHED.format(fault=way.why)]
            shown = len(way.drawn_rows)
            notes += [texts.THINNED.format(shown=shown, points=len(way.p_part))] if shown < len(way.p_part) else []
            self._note.set_text(" ".join(notes))
        try:
            film = await asyncio.to_thread(StockFilm.of, way, lambda: stop.is_set() or self._desk.queue.closed)
        except CounterflexError as fault:
            self._note.set_text(" ".join([*notes, texts.NOT_CUT.format(fault=printable(str(fault)))]))
            return
        if film is not None and not stop.is_set():
            with self._view.client:
                self._view.show_film(film)

    def _paint(self) -> None:
        if self._channel.value:
            self._view.paint(self._channel.value)
