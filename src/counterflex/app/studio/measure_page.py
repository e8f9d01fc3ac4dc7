"""The page that measures: one guide for all recipes, from the proposed poses to values with intervals."""

from __future__ import annotations

import asyncio
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from nicegui import background_tasks, events, ui
from nicegui.element import Element

from counterflex.app.panel.cell_scene import CellScene
from counterflex.app.studio import texts
from counterflex.app.studio.desk import Action, Drop, FaultBanner, SceneView, Workbench, table
from counterflex.app.studio.file_mapping import FileMapping
from counterflex.app.studio.identified_card import show_identification
from counterflex.app.studio.jobs import QueuedCommand
from counterflex.app.studio.measured_file import MeasuredFile
from counterflex.app.studio.measurement_form import MeasurementForm, ReadingCheck, Remark, check_readings
from counterflex.core.errors import CounterflexError
from counterflex.core.next_command import next_command
from counterflex.core.result import digits_of
from counterflex.core.units import DEG
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.dataset.proposal import PROPOSAL, form_names, read_proposal
from counterflex.files.shop_unit import shop
from counterflex.identify.recipes import RECIPES, own_title

_COUNT: Final = 20
_MOST: Final = 200
"""Measurements that can be asked for on the page; the command takes more."""
_FIRST: Final = "tracker-frame"


class FormTable(Element, component="form_table.js"):  # type: ignore[call-arg, misc]
    """Table of a form in the browser."""

    def __init__(self, entered: Any, pose: Any) -> None:
        super().__init__()
        self._props["words"] = texts.FORM
        self.on("enter", entered)
        self.on("pose", pose)

    def fill(self, form: MeasurementForm) -> None:
        """Show a form."""
        shown = [k for k, one in enumerate(form.columns) if one.shown]
        typed = [k for k, one in enumerate(form.columns) if not one.shown]
        columns = [{"name": form.columns[k].name, "title": _titled(form, k)} for k in typed]
        rows = [
            {"pose": "  ".join(f"{float(row[k]):.1f}" for k in shown if row[k]), "cells": [row[k] for k in typed]}
            for row in form.rows
        ]
        self.run_method("fill", columns, rows)

    def mark(self, remarks: list[Remark]) -> None:
        """Show what is to be said about each row, beside it."""
        self.run_method("mark", [{"state": one.state, "text": one.text} for one in remarks])


def _titled(form: MeasurementForm, place: int) -> str:
    one = form.columns[place]
    unit = "" if one.unit == "1" else f", {one.unit}"
    return f"{one.label or texts.channel(one.channel)}{unit}"


class MeasurePage:
    """Proposal of a recipe, its readings, and its result."""

    def __init__(self, desk: Workbench) -> None:
        self._desk = desk
        self._form: MeasurementForm | None = None
        self._cell: Cell | None = None
        self._scene: CellScene | None = None
        self._posed = ""
        self._remarks: list[Remark] = []
        self._checking = self._again = False
        with ui.element("div").classes("st-two st-even"):
            with ui.column().classes("st-block"):
                self._choice()
            self._view = SceneView(self._draw).classes("st-pose-view")
        self.fault = FaultBanner("measure-fault")
        with ui.column().classes("st-block") as self._readings:
            self._source = ui.toggle(texts.SOURCES, value="typed", on_change=self._show_source)
            self._source.props('no-caps data-test="source"')
            self._typed = ui.column().classes("st-block")
            self._from_file = ui.column().classes("st-block")
            self._checked = ui.label("").classes("st-note").props('data-test="checked" aria-live="polite"')
            self._identify = Action(
                desk, "identify", texts.IDENTIFY, self._identify_lines, self._lacking, self._identified
            )
        self._fill_sources()
        self._results = ui.column().classes("st-form")
        desk.changed.append(self.refresh)
        desk.measure = self.choose

    def _choice(self) -> None:
        options = {name: f"{name}: {_title(name)}" for name in RECIPES}
        self._recipe = ui.select(options, label=texts.RECIPE, value=_FIRST, on_change=self._rechosen)
        self._recipe.classes("st-full").props('data-test="recipe"')
        self._count = ui.number(texts.COUNT, value=_COUNT, min=1, max=_MOST, precision=0)
        self._count.props('dense data-test="count"').on_value_change(self._recount)
        self._propose = Action(
            self._desk, "propose", texts.PROPOSE, self._propose_lines, self._lacking_cell, self._proposed, main=False
        )
        self._folder = ui.select([], label=texts.FORM_FOLDER, on_change=self.refresh).classes("st-full")
        self._folder.props('data-test="form-folder"')
        self._how = ui.column().classes("st-form")

    def _recount(self) -> None:
        self._propose.refresh()

    def _fill_sources(self) -> None:
        with self._typed:
            ui.label(texts.TYPED_HELP).classes("st-note")
            self._spreads = ui.row().classes("st-row")
            self._table = FormTable(self._entered, self._to_pose)
        with self._from_file:
            ui.label(texts.MEASURED_FILE_HELP).classes("st-note")
            Drop(self._desk, "drop-readings", self._dropped)
            self._mapping = FileMapping(self._map)
        self._from_file.set_visibility(False)

    async def choose(self, recipe: str) -> None:
        """Guide through a recipe."""
        self._recipe.set_value(recipe)
        self._desk.go("measure")

    async def _rechosen(self) -> None:
        self._folder.set_options([], value=None)
        self._source.set_value("typed")
        await self.refresh()

    def _lacking_cell(self) -> str:
        return texts.NEEDS.format(what=texts.CELL)

    def _propose_lines(self) -> list[str]:
        count = self._count.value
        if not self._desk.cell or not count or not 1 <= count <= _MOST:
            return []
        taken = self._desk.project.forms(self._recipe.value)
        out = f"measure-{self._recipe.value}" + (f"-{len(taken) + 1}" if taken else "")  # what is typed stays
        return [next_command(f"identify {self._recipe.value}", propose=int(count), cell=self._desk.cell, out=out)]

    async def _proposed(self, job: QueuedCommand) -> None:
        self.fault.show(job.error)
        if job.state == "done":
            self._folder.set_options([], value=None)  # the newest is the one that was asked for
        await self._desk.refresh()

    @property
    def _manifest(self) -> Path | None:
        """Manifest of what is typed, or of the file."""
        if self._form is None:
            return None
        typed = self._source.value == "typed"
        return self._form.manifest if typed else self._form.folder / f"{self._recipe.value}-file.toml"

    def _lacking(self) -> str:
        if any(one.state == "bad" for one in self._remarks):
            return texts.ROWS_WRONG
        return texts.NEEDS.format(what=texts.READINGS if self._desk.cell else texts.CELL)

    def _identify_lines(self) -> list[str]:
        manifest, recipe = self._manifest, self._recipe.value
        typed = self._source.value == "typed"
        ready = any(one.state in ("done", "odd") for one in self._remarks) if typed else self._mapping.file is not None
        if manifest is None or not self._desk.cell or not ready or (typed and self._lacking() == texts.ROWS_WRONG):
            return []
        name = self._desk.project.name(manifest)
        return [next_command(f"identify {recipe}", name, cell=self._desk.cell, out=f"{recipe}-identified")]

    async def _identified(self, job: QueuedCommand) -> None:
        self.fault.show(job.error if job.state == "failed" else "")
        await self._desk.refresh()

    async def refresh(self) -> None:
        """Show the form and the results that the folder holds."""
        project, recipe = self._desk.project, self._recipe.value
        folders = project.forms(recipe)
        value = self._folder.value if self._folder.value in folders else (folders[-1] if folders else None)
        if folders != self._folder.options or value != self._folder.value:
            self._folder.set_options(folders, value=value)
        self._folder.set_visibility(len(folders) > 1)
        self._readings.set_visibility(bool(folders))
        self._propose.refresh()
        await self._show_form(None if value is None else project.folder / value)
        self._identify.refresh()
        self._results.clear()
        with self._results:
            for folder in project.identified(recipe)[-1:]:
                await show_identification(self._desk, self.fault, folder, self.choose)
        await self._show_cell()

    async def _show_cell(self) -> None:
        path = self._desk.cell_file
        mark = f"{self._desk.cell} {path.stat().st_mtime_ns}" if self._desk.cell and path.is_file() else ""
        if mark and mark != self._posed:
            self._posed = mark
            try:
                self._cell = await asyncio.to_thread(read_cell, path)
                self._scene = CellScene(path)
            except CounterflexError as fault:
                self._cell = self._scene = None
                self.fault.show(str(fault))
            self._draw()

    async def _show_form(self, folder: Path | None) -> None:
        """Show a form where it is another one than before."""
        if folder is None:
            self._form, self._remarks = None, []
            self._how.clear()
            return
        names = [PROPOSAL, *form_names(self._recipe.value)]
        if not all((folder / name).is_file() for name in names):
            self._form, self._remarks = None, []
            self._readings.set_visibility(False)
            self.fault.show(texts.NO_FORM.format(folder=self._desk.project.name(folder)))
            self._show_how(folder)
            return
        if self._form is not None and self._form.folder == folder and await asyncio.to_thread(self._form.is_current):
            return
        form = self._form = await self.fault.during(MeasurementForm.read, folder, self._recipe.value)
        self._mapping.clear()
        self._show_how(folder)
        if form is None:
            return
        if not form.rows:
            self._source.set_value("file")
        self._spreads.clear()
        with self._spreads:
            for channel, unit, _ in form.spreads():
                title = texts.SPREAD.format(channel=texts.channel(channel), unit=unit)
                field = ui.number(title, value=form.sigma.get((channel, unit)), min=0)
                field.props(f'dense data-test="sigma-{channel}-{unit.replace(" ", "")}"').classes("st-spread")
                field.on("change", partial(self._spread, (channel, unit), field))
        self._table.fill(form)
        await self._judge()

    def _show_how(self, folder: Path) -> None:
        """Show what the proposal says about measuring, and what it is good for."""
        proposal = read_proposal(folder / PROPOSAL)
        self._how.clear()
        with self._how:
            for remark in proposal.remarks:
                ui.label(remark).classes("st-note")
            rows = []
            for name, sigma in proposal.expected.items():
                unit, factor = shop(proposal.units.get(name, "SI"))
                rows.append([name, digits_of(sigma / factor, 3), unit])
            with ui.expansion(texts.WILL_FIND.format(count=len(rows))).props("dense"):
                table(texts.EXPECTED_COLUMNS, rows, mark="expected")

    async def _spread(self, key: tuple[str, str], field: ui.number) -> None:
        if self._form is not None:
            self._form.sigma.pop(key, None)
            if field.value:
                self._form.sigma[key] = float(field.value)
            await self._save()

    async def _entered(self, event: events.GenericEventArguments) -> None:
        form = self._form
        if form is None:
            return
        typed = [k for k, one in enumerate(form.columns) if not one.shown]
        for row, column, text in event.args:
            form.enter(int(row), typed[int(column)], str(text))
        await self._save()

    async def _save(self) -> None:
        form = self._form
        assert form is not None
        await self.fault.during(form.save)
        if self.fault.shown:
            return
        await self._judge()

    async def _judge(self) -> None:
        """Say at once what the numbers alone show, and let the recipe judge them meanwhile."""
        form = self._form
        if form is None:
            return
        self._remarks = form.remarks()
        self._table.mark(self._remarks)
        done = sum(one.state in ("done", "odd") for one in self._remarks)
        self._checked.set_text(texts.COMPLETE.format(done=done, count=len(form.rows)))
        self._identify.refresh()
        self._check()

    def _check(self) -> None:
        """Have the readings judged; those that come meanwhile, after that."""
        self._again = True
        if not self._checking and self._identify_lines():
            self._checking = True
            background_tasks.create(self._check_all(), name="check the readings")

    async def _check_all(self) -> None:
        try:
            while self._again and (manifest := self._manifest) is not None and not self._desk.queue.closed:
                self._again, form = False, self._form
                check = await asyncio.to_thread(check_readings, self._recipe.value, manifest, self._desk.cell_file)
                if form is self._form and not self._again:
                    with self._view.client:
                        self._show_check(check)
        finally:
            self._checking = False

    def _show_check(self, check: ReadingCheck) -> None:
        form = self._form
        if form is None:
            return
        if self._source.value == "typed":
            remarks = [
                Remark("odd", check.at_line[k + 2]) if k + 2 in check.at_line and one.state == "done" else one
                for k, one in enumerate(self._remarks)
            ]
            self._table.mark(remarks)
            done = sum(one.state in ("done", "odd") for one in remarks)
            text = texts.COMPLETE.format(done=done, count=len(form.rows))
        else:
            if self._mapping.file is None:
                return
            lines = ", ".join(str(line) for line in sorted(check.at_line)[:20])
            text = texts.ROWS_READ.format(count=self._mapping.file.count, name=self._mapping.file.path.name)
            text += texts.LINES_ODD.format(lines=lines) if lines else ""
        odd = len(check.at_line)
        self._checked.set_text(f"{text} {check.fault or texts.JUDGED.format(count=odd)}")

    async def _show_source(self) -> None:
        typed = self._source.value == "typed"
        self._typed.set_visibility(typed)
        self._from_file.set_visibility(not typed)
        self._checked.set_text("")
        self._identify.refresh()
        if typed:
            await self._judge()

    async def _dropped(self, name: str) -> None:
        if self._form is None:
            return
        file = await self.fault.during(MeasuredFile.read, self._desk.project.folder / name, self._form.folder)
        if file is not None:
            self._mapping.show(file, RECIPES[self._recipe.value])
            await self._map()

    async def _map(self) -> None:
        """Write the manifest of the file, and have it judged."""
        manifest = self._manifest
        if self._mapping.file is not None and manifest is not None:
            self._checked.set_text(
                texts.ROWS_READ.format(count=self._mapping.file.count, name=self._mapping.file.path.name)
            )
            await self.fault.during(self._mapping.file.write, manifest)
            self._identify.refresh()
            if not self.fault.shown:
                self._check()

    def _draw(self) -> None:
        """Send the bodies of the cell to the browser, at the first pose."""
        if self._scene is not None and self._cell is not None:
            limits = self._cell.controller_chain.joint_limits_rad
            self._view.show_cell(self._scene, limits.mean(axis=1))
            self._at(0)

    def _to_pose(self, event: events.GenericEventArguments) -> None:
        self._at(int(event.args))

    def _at(self, row: int) -> None:
        """Stand where a row of the form is measured."""
        form = self._form
        if form is None or self._scene is None or self._cell is None or row >= len(form.rows):
            return
        places = [k for k, one in enumerate(form.columns) if one.channel == "q" and one.shown]
        if len(places) == len(self._cell.controller_chain.joint_limits_rad):
            shown = np.array([float(form.rows[row][k]) for k in places]) * DEG
            self._view.stand(self._scene, self._cell.controller_chain.axes.model(shown), None)


def _title(name: str) -> str:
    return own_title(name) if name in RECIPES.own else str(RECIPES[name].title)
