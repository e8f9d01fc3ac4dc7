"""The page of the studio: what is chosen on top, steps on the left, the commands below."""

from __future__ import annotations

from typing import Any, Final

from nicegui import Client, ui

from counterflex.app.studio import texts
from counterflex.app.studio.cell_page import CellPage
from counterflex.app.studio.desk import Workbench, command_text
from counterflex.app.studio.inspect_page import InspectPage, RunPage
from counterflex.app.studio.jobs import CommandQueue, QueuedCommand
from counterflex.app.studio.measure_page import MeasurePage
from counterflex.app.studio.plan_page import PlanPage
from counterflex.app.studio.program_page import ProgramPage
from counterflex.app.studio.project import Project

_TICK_S: Final = 0.4
_PAGES: Final[dict[str, Any]] = {
    "cell": CellPage,
    "measure": MeasurePage,
    "program": ProgramPage,
    "plan": PlanPage,
    "inspect": InspectPage,
    "run": RunPage,
}
_COLOURS: Final = {"waiting": "primary", "running": "primary", "failed": "negative", "interrupted": "warning"}
_SHOWN: Final = 30
"""Commands that are listed."""


class Shell:
    """One page in one browser."""

    def __init__(self, client: Client, project: Project, queue: CommandQueue, title: str) -> None:
        self._desk = desk = Workbench(client, project, queue)
        self._version = -1
        self._dark = ui.dark_mode(None)
        with ui.element("header").classes("st-head"):
            ui.label(title).classes("st-brand")
            self._cell = ui.select([], label=texts.CELL, on_change=self._choose).props('dense data-test="cell"')
            self._program = ui.select([], label=texts.PROGRAM, on_change=self._choose)
            self._program.props('dense data-test="program"')
            dark = ui.button(icon="contrast", on_click=self._toggle_dark).props("flat dense round")
            dark.props(f'aria-label="{texts.DARK}" data-test="dark"')
        with ui.element("main").classes("st-main"):
            with ui.element("nav").classes("st-steps"):
                self._steps = {name: self._step(name, text) for name, text in texts.STEPS.items()}
            self._sections: dict[str, ui.element] = {}
            self.pages: dict[str, Any] = {}
            for name, page in _PAGES.items():
                with ui.element("section").classes("st-page") as section:
                    section.props(f'data-test="page-{name}"')
                    ui.label(texts.INTRO[name]).classes("st-intro")
                    self.pages[name] = page(desk)
                self._sections[name] = section
        self._commands()
        desk.changed.append(self._offer)
        desk.go, desk.at_line = self._go, self.pages["program"].to_line
        self._go("cell")
        ui.timer(0.0, self._begin, once=True)
        ui.timer(_TICK_S, self._tick)

    def _step(self, name: str, text: str) -> ui.button:
        return ui.button(text, on_click=lambda: self._go(name), color=None).props(f'flat no-caps data-test="go-{name}"')

    def _go(self, name: str) -> None:
        for key, section in self._sections.items():
            section.set_visibility(key == name)
            self._steps[key].classes(add="st-here" if key == name else "", remove="" if key == name else "st-here")
            self._steps[key].props(f"aria-current={'step' if key == name else 'false'}")

    def _toggle_dark(self) -> None:
        self._dark.value = not self._dark.value

    async def _begin(self) -> None:
        project = self._desk.project
        cells, programs = project.cells(), project.programs()
        small = [name for name in cells if name.endswith("-small.toml")]
        cell = (small or cells or [""])[0]
        program = "groove.ngc" if small and "groove.ngc" in programs else (programs or [""])[0]
        await self._desk.choose(cell=cell, program=program)

    async def _offer(self) -> None:
        """Offer the files that the folder holds."""
        for select, names, value in (
            (self._cell, self._desk.project.cells(), self._desk.cell),
            (self._program, self._desk.project.programs(), self._desk.program),
        ):
            if names != select.options or value != (select.value or ""):
                select.set_options(names, value=value if value in names else None)

    async def _choose(self) -> None:
        cell, program = str(self._cell.value or ""), str(self._program.value or "")
        if (cell, program) != (self._desk.cell, self._desk.program):
            await self._desk.choose(cell=cell, program=program)

    def _commands(self) -> None:
        """The strip of the queue: the command that runs, or ran last, and the list of all."""
        with ui.element("footer").classes("st-foot"), ui.expansion(texts.COMMANDS) as expansion:
            expansion.props('dense expand-icon-toggle data-test="commands"')
            with expansion.add_slot("header"), ui.element("div").classes("st-now"):
                self._now = ui.label(texts.NO_COMMANDS).classes("st-command").props('data-test="now"')
                self._bar = ui.linear_progress(0.0, show_value=False).props("instant-feedback")
                self._what = ui.label("").classes("st-note").props('data-test="what"')
                self._cancel = ui.button(texts.CANCEL, on_click=self._cancel_now).props("no-caps flat dense")
                self._cancel.props('data-test="cancel"')
                self._resume = ui.button(texts.RESUME, on_click=self._resume_all).props("no-caps flat dense")
                self._resume.props('data-test="resume"')
            self._list = ui.column().classes("st-jobs")

    def _cancel_now(self) -> None:
        for job in self._desk.queue.jobs:
            if job.state == "running":
                self._desk.queue.cancel(job)

    def _resume_all(self) -> None:
        for job in self._desk.queue.jobs:
            if job.state == "interrupted":
                self._desk.queue.add(job.line)

    async def _tick(self) -> None:
        queue = self._desk.queue
        current = next((job for job in queue.jobs if not job.ended), queue.jobs[-1] if queue.jobs else None)
        self._cancel.set_visibility(current is not None and current.state == "running")
        self._resume.set_visibility(current is not None and current.state == "interrupted")
        self._bar.set_visibility(current is not None)
        if current is not None:
            self._show_now(current, sum(job.state == "waiting" for job in queue.jobs))
        if queue.version != self._version:
            self._version = queue.version
            self._show_list(queue.jobs)
            await self._desk.look()

    def _show_now(self, job: QueuedCommand, waiting: int) -> None:
        """Show a command: what it does, or how it ended."""
        running = job.state == "running"
        self._now.set_text(job.line)
        text = (running and job.what) or (job.state == "failed" and job.error) or texts.STATES[job.state]
        text = texts.INTERRUPTED if job.state == "interrupted" else text
        self._what.set_text(text + (f" (+{waiting})" if running and waiting else ""))
        unknown = running and job.fraction == 0.0
        self._bar.set_value(1.0 if job.ended else job.fraction)
        self._bar.props(f"color={_COLOURS.get(job.state, 'positive')}")
        self._bar.props(add="indeterminate" if unknown else "", remove="" if unknown else "indeterminate")

    def _show_list(self, jobs: list[QueuedCommand]) -> None:
        self._list.clear()
        with self._list:
            for job in reversed(jobs[-_SHOWN:]):
                with ui.expansion().props("dense") as expansion:
                    with expansion.add_slot("header"), ui.row().classes("st-row"):
                        ui.label(texts.STATES[job.state]).classes(f"st-state st-{job.state}")
                        command_text(job.line)
                    ui.label("\n".join(job.lines)).classes("st-output")
