"""The page of the cell: from the catalogue to a file, the file itself, what is not known, the cell in 3-D."""

from __future__ import annotations

import asyncio
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui

from counterflex.app.panel.cell_scene import CellScene
from counterflex.app.questions import check_cell
from counterflex.app.robot_list import robots
from counterflex.app.studio import texts
from counterflex.app.studio.cell_text import TOOL_KEYS, CellValues, line_of, with_values
from counterflex.app.studio.desk import Action, FaultBanner, SceneView, Workbench, command_text, table
from counterflex.app.studio.jobs import QueuedCommand
from counterflex.app.studio.tool_way import pushed
from counterflex.core import atomic, file_content
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, OutputError
from counterflex.core.next_command import next_command
from counterflex.core.units import DEG
from counterflex.cutting import material
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.set_up import POSE_KEYS
from counterflex.identify.recipes import RECIPES
from counterflex.robot.model.controller_axes import shown_limits


class CellPage:
    """Everything about the cell file that is chosen."""

    def __init__(self, desk: Workbench) -> None:
        self._desk = desk
        self._cell: Cell | None = None
        self._scene: CellScene | None = None
        self._shown = ""
        self._saved = ""
        with ui.element("div").classes("st-two"):
            with ui.element("div").classes("st-left"):
                self._view = SceneView(self._draw)
                self._sliders()
            with ui.element("div").classes("st-right"):
                self._new_cell()
                self.fault = FaultBanner("cell-fault")
                with ui.tabs().props("dense no-caps align=left") as self._tabs:
                    for name in (texts.SET, texts.FILE, texts.UNKNOWN):
                        ui.tab(name).props(f'data-test="tab-{name.split()[0].lower()}"')
                with ui.tab_panels(self._tabs, value=texts.SET, animated=False).props("keep-alive") as self._panels:
                    with ui.tab_panel(texts.SET):
                        self._form = ui.column().classes("st-form")
                    with ui.tab_panel(texts.FILE):
                        self._file()
                    with ui.tab_panel(texts.UNKNOWN):
                        self._unknown = ui.column().classes("st-form")
        self._panels.classes("st-panels")
        for element in (self._joints, self._tabs, self._panels):
            element.bind_visibility_from(desk, "cell", bool)
        desk.changed.append(self.refresh)

    def _new_cell(self) -> None:
        options = {
            row["name"]: texts.ROBOT_OPTION.format(
                model=row["model"], reach=_figure(row["reach_mm"]), payload=_figure(row["payload_kg"])
            )
            for row in robots()
        }
        with ui.expansion(texts.NEW_CELL, caption=texts.NEW_CELL_HELP).props('dense data-test="new-cell"') as self._new:
            self._new.value = not self._desk.project.cells()
            with ui.row().classes("st-row"):
                self._robot = ui.select(options, label=texts.ROBOT, with_input=True, value="kuka_kr300_r2500_ultra")
                self._robot.classes("st-wide").props('data-test="robot"')
                self._name = ui.input(texts.FILE_NAME, value="cell.toml").props('data-test="cell-name"')
            self._make = Action(
                self._desk, "make-cell", texts.MAKE_CELL, self._make_line,
                lambda: texts.NO_NAME.format(ending=".toml"), self._made,
            )  # fmt: skip
            for element in (self._robot, self._name):
                element.on_value_change(self._make.refresh)

    def _make_line(self) -> list[str]:
        name = str(self._name.value or "").strip()
        if not name.endswith(".toml") or Path(name).name != name or name.startswith((".", "-")):
            return []
        return [next_command("cell example", out=name, robot=self._robot.value)]

    async def _made(self, job: QueuedCommand) -> None:
        self.fault.show(job.error)
        if job.state == "done":
            self._new.value = False
            small = Path(str(self._name.value)).stem + "-small.toml"
            await self._desk.choose(cell=small, program="groove.ngc")

    def _sliders(self) -> None:
        self._pushed = ui.label("").classes("st-note").props('data-test="pushed"')
        self._push_warning = ui.label("").classes("st-warn").props('data-test="push-warning"')
        self._push_command = command_text("")
        self._axes: list[ui.number] = []
        self._slides: list[ui.slider] = []
        with ui.element("div").classes("st-joints") as self._joints:
            for k in range(1, 7):
                with ui.element("div"):
                    self._axes.append(ui.number(f"A{k}, deg", value=0.0, step=1.0, format="%.1f", on_change=self._move))
                    self._slides.append(ui.slider(min=-180, max=180, step=0.5, value=0.0).bind_value(self._axes[-1]))
                self._axes[-1].props("dense")
                self._slides[-1].props(f'aria-label="A{k}" data-test="a{k}"')

    def _file(self) -> None:
        self._editor = ui.codemirror("", language="TOML", on_change=self._edited).classes("st-editor")
        self._editor.props('data-test="editor"')
        with ui.row().classes("st-row"):
            ui.button(texts.SAVE, on_click=self._save).props('no-caps unelevated data-test="save"')
            ui.button(texts.REVERT, on_click=self._read_again).props("no-caps flat")
            self._state = ui.label("").classes("st-note").props('data-test="file-state"')
        self._check_command = command_text("")

    def _edited(self) -> None:
        if self._editor.value != self._saved:
            self._state.set_text(texts.UNSAVED)

    async def _read_again(self) -> None:
        self._shown = ""
        await self.refresh()

    async def refresh(self) -> None:
        """Show the cell file that is chosen, where it is another one than before."""
        self._make.refresh()
        path = self._desk.cell_file
        mark = f"{self._desk.cell} {path.stat().st_mtime_ns}" if self._desk.cell and path.is_file() else ""
        if mark and mark != self._shown:
            same = self._shown.rpartition(" ")[0] == self._desk.cell
            if same and self._editor.value != self._saved:  # what is typed is not thrown away
                return
            self._shown = mark
            self._saved = _text(path)
            self._editor.set_value(self._saved)
            await self._judge()

    async def _save(self) -> None:
        if not self._desk.cell:
            return
        if await self.fault.during(self._write) is None:
            return
        self._shown = f"{self._desk.cell} {self._desk.cell_file.stat().st_mtime_ns}"
        await self._judge()
        await self._desk.refresh()

    def _write(self) -> bool:
        """Write what is in the editor, where the file still is the one that was read."""
        path = self._desk.cell_file
        if path.is_file() and file_content.content(path).replace(b"\r\n", b"\n") != self._saved.encode():
            raise OutputError(texts.CHANGED, where=self._desk.cell, hint=texts.CHANGED_HINT)
        atomic.write_text(path, self._editor.value)
        self._saved = _text(path)
        return True

    async def _judge(self) -> None:
        """Read the file that is there and show what comes of it; a fault at its line."""
        self._check_command.set_text(next_command("cell check", self._desk.cell))
        self._editor.decorations = []
        self._fill_form()
        try:
            self._cell = await asyncio.to_thread(read_cell, self._desk.cell_file)
        except CounterflexError as fault:
            self._show_fault(fault)
            return
        self.fault.show("")
        self._state.set_text(texts.CELL_OK)
        self._draw()
        await self._show_unknown()

    def _show_fault(self, fault: CounterflexError) -> None:
        line = line_of(self._saved, fault)
        text = str(fault)
        self.fault.show(text if line is None else texts.AT_LINE.format(line=line, text=text))
        self._state.set_text("")
        if line is not None:
            self._editor.decorations = [{"kind": "line", "line": line, "class": "st-bad-line"}]
            self._editor.reveal_line(line)

    def _fill_form(self) -> None:
        """The form of what the file says."""
        self._form.clear()
        chosen = CellValues.of(self._saved)
        if chosen is None:
            return
        with self._form:
            names = {row["name"]: row["model"] for row in robots()}
            if chosen.robot in names:
                robot = ui.select(names, label=texts.ROBOT, value=chosen.robot, with_input=True).classes("st-full")
                robot.on_value_change(lambda event: self._enter(robot=event.value))
            here = texts.AS_IN_FILE.format(name=chosen.material_name or chosen.material)
            options = {"": here, **{name: _material(name) for name in material.names()}}
            value = chosen.material if chosen.material in options else ""
            select = ui.select(options, label=texts.MATERIAL, value=value, with_input=True).classes("st-full")
            select.props('data-test="material"').on_value_change(lambda event: self._enter(material=event.value or ""))
            for index, tool in enumerate(chosen.tools):
                self._tool_row(index, tool)
            if chosen.part is not None:
                self._part_row(dict(chosen.part))

    def _tool_row(self, index: int, tool: dict[str, Any]) -> None:
        ui.label(f"{texts.TOOL} {tool.get('number', index + 1)}: {tool.get('name', '')}")
        with ui.element("div").classes("st-fields st-three"):
            for key, title in zip(TOOL_KEYS, (texts.DIAMETER, texts.FLUTES, texts.OVERHANG), strict=True):
                field = ui.number(title, value=tool.get(key), min=0).props(f'dense data-test="tool-{key}"')
                field.on("change", lambda _, key=key, field=field: self._enter(tool=(index, {key: field.value})))

    def _part_row(self, part: dict[str, float]) -> None:
        ui.label(texts.PART)
        with ui.element("div").classes("st-fields"):
            for key in POSE_KEYS:
                field = ui.number(key[0].upper(), value=part[key]).props(f'dense data-test="part-{key}"')
                field.on("change", lambda _, key=key, field=field: self._enter(part={key: field.value or 0.0}))

    async def _enter(self, **values: Any) -> None:
        """Write values of the form into the file."""
        self._editor.set_value(with_values(self._editor.value, **values))
        await self._save()

    async def _show_unknown(self) -> None:
        """Rank what is not known, and stand where the cell is judged."""
        self._unknown.clear()
        answer = await self.fault.during(check_cell, str(self._desk.cell_file))
        if answer is None or self._cell is None:
            return
        corner = answer["at_corner"]
        limits = shown_limits(self._cell.controller_chain.axes, self._cell.controller_chain.joint_limits_rad) / DEG
        angles = corner["joints_deg"] if corner is not None else limits.mean(axis=1).tolist()
        for axis, slide, (low, high), angle in zip(self._axes, self._slides, limits, angles, strict=True):
            slide._props["min"], slide._props["max"] = round(float(low), 1), round(float(high), 1)
            slide.update()
            axis.set_value(round(angle, 1))
        with self._unknown:
            for warning in answer["warnings"]:
                ui.label(warning).classes("st-warn")
            if answer["unknowns"] is not None:
                self._unknown_table(answer["unknowns"])
        await self._move()

    def _unknown_table(self, unknowns: dict[str, Any]) -> None:
        ui.label(texts.UNKNOWN_OF.format(where=unknowns["where"]))
        rows = [
            [
                row["unknown"],
                row["known_from"],
                "" if row["leaves_mm"] is None else f"{row['leaves_mm']:.2f}",
                texts.NOT_AT_REST
                if row["of_90_percent_mm"] is None
                else "{:.2f} to {:.2f}".format(*row["of_90_percent_mm"]),
                row["measure"].removeprefix("identify "),
            ]
            for row in unknowns["rows"]
        ]
        table(texts.UNKNOWN_COLUMNS, rows, mark="unknowns")
        for recipe in dict.fromkeys(row["measure"].split()[1] for row in unknowns["rows"]):
            button = ui.button(f"{texts.MEASURE}: {recipe}", on_click=partial(self._measure, recipe))
            button.props(f'no-caps outline data-test="measure-{recipe}"').set_enabled(recipe in RECIPES)

    async def _measure(self, recipe: str) -> None:
        if self._desk.measure is not None:
            await self._desk.measure(recipe)

    def _draw(self) -> None:
        """Send the bodies of the cell to the browser."""
        if self._cell is None:
            return
        try:
            self._scene = CellScene(self._cell.path)
            self._view.show_cell(self._scene, self._model_angles(self._cell))
        except CounterflexError as fault:
            self._show_fault(fault)

    def _angles(self) -> list[float]:
        return [float(axis.value or 0.0) for axis in self._axes]

    def _model_angles(self, cell: Cell) -> Float:
        return cell.controller_chain.axes.model(np.array(self._angles()) * DEG)

    async def _move(self) -> None:
        """Stand at the angles of the sliders, and push the tool."""
        if self._cell is None or self._scene is None:
            return
        angles = self._angles()
        self._push_command.set_text(
            next_command(
                "deflection", self._desk.cell, joints_deg=",".join(f"{a:g}" for a in angles), force_n="100,0,0"
            )
        )
        answer = await self.fault.during(pushed, self._cell, angles)
        if answer is None:
            return
        self._push_warning.set_text(" ".join(answer["warnings"]))
        share = answer["share"]
        more = "" if share is None else texts.PUSHED_SHARE.format(share=100 * share["share"], segment=share["segment"])
        self._pushed.set_text(texts.PUSHED.format(*answer["along_um"], answer["softest_um"], more=more))
        self._view.stand(self._scene, self._model_angles(self._cell), answer["ellipsoid"])


def _text(path: Path) -> str:
    return file_content.content(path).decode("utf-8", "replace").replace("\r\n", "\n")


def _material(name: str) -> str:
    """Name of a material, and whether the file has to state ratios of its force."""
    row = material.load(name)
    return (row.name or name) + (texts.INCOMPLETE if row.radial is None or row.axial is None else "")


def _figure(value: float | None) -> str:
    return "?" if value is None else f"{value:g}"
