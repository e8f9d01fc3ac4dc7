"""The page that checks, plans and proves: commands in the order of the work, and what their results say."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

from nicegui import ui

from counterflex.app.studio import texts
from counterflex.app.studio.choices import choices
from counterflex.app.studio.desk import Action, FaultBanner, Workbench, card, error_bars, language, result_links, table
from counterflex.app.studio.jobs import QueuedCommand
from counterflex.core.next_command import next_command
from counterflex.programs.language import LANGUAGES, at_prompt

_WORST: Final = ("fail", "warning")
_FIRST: Final = "krl"
"""Language that is chosen at first."""


class PlanPage:
    """Everything that comes of the program on the cell."""

    def __init__(self, desk: Workbench) -> None:
        self._desk = desk
        self.fault = FaultBanner("plan-fault")
        words = at_prompt("write")
        with ui.element("div").classes("st-two st-even"):
            with ui.column().classes("st-block"):
                self._actions = [
                    self._action("check", texts.CHECK, self._check_line),
                    self._action("posture", texts.POSTURE, self._posture_line, main=False, tip=texts.POSTURE_HELP),
                    self._action("place", texts.PLACE, self._place_line, main=False, tip=texts.PLACE_HELP),
                    self._action("strategy", texts.STRATEGY, self._strategy_line, main=False, tip=texts.STRATEGY_HELP),
                ]
                self._checks = ui.column().classes("st-form")
            with ui.column().classes("st-block"):
                ui.label(texts.LANGUAGES)
                with ui.row().classes("st-row"):
                    self._languages = {
                        word: ui.checkbox(LANGUAGES[name].short, value=word == _FIRST).props(f'data-test="as-{word}"')
                        for word, name in words.items()
                    }
                for box in self._languages.values():
                    box.on_value_change(self._refresh_actions)
                self._assume = ui.checkbox(texts.ASSUME, on_change=self._refresh_actions).props('data-test="assume"')
                self._feed = ui.checkbox(texts.FEED, on_change=self._refresh_actions).props('data-test="feed"')
                self._actions += [
                    self._action("compensate", texts.COMPENSATE, self._compensate_lines),
                    self._action("prove", texts.PROVE, self._prove_line, tip=texts.PROVE_HELP),
                ]
                self._results = ui.column().classes("st-form")
        self._choices = ui.column().classes("st-form")
        desk.changed.append(self.refresh)

    def _action(
        self, mark: str, title: str, lines: Callable[[], list[str]], *, tip: str = "", main: bool = True
    ) -> Action:
        if tip:
            ui.label(tip).classes("st-note")
        lacking = self._desk.lacking
        return Action(self._desk, mark, title, lambda: [] if lacking() else lines(), lacking, self._ended, main=main)

    def _out(self, kind: str) -> str:
        return f"{Path(self._desk.program).stem}-{kind}"

    def _check_line(self) -> list[str]:
        desk = self._desk
        return [next_command("preflight", desk.program, cell=desk.cell, out=self._out("preflight"))]

    def _posture_line(self) -> list[str]:
        desk = self._desk
        return [next_command("plan posture", desk.program, cell=desk.cell, out=self._out("posture"))]

    def _place_line(self) -> list[str]:
        desk = self._desk
        return [next_command("plan placement", desk.program, cell=desk.cell, out=self._out("placed"))]

    def _strategy_line(self) -> list[str]:
        desk = self._desk
        return [next_command("plan strategy", desk.program, cell=desk.cell, out=self._out("strategy"))]

    def _prove_line(self) -> list[str]:
        desk = self._desk
        return [
            next_command(
                "prove",
                desk.program,
                cell=desk.cell,
                out=self._out("proof"),
                assume_class=self._assume.value is True,
            )
        ]

    def _compensate_lines(self) -> list[str]:
        desk, words = self._desk, [word for word, box in self._languages.items() if box.value]
        name = "{}-fast" if self._feed.value is True else "{}"
        return [
            next_command(
                "compensate", desk.program, cell=desk.cell, out=self._out(name.format(word)), as_=word,
                assume_class=self._assume.value is True, programmed_feed=self._feed.value is True,
            )
            for word in words
        ]  # fmt: skip

    def _refresh_actions(self) -> None:
        for action in self._actions:
            action.refresh()

    async def _ended(self, job: QueuedCommand) -> None:
        self.fault.show(job.error if job.state == "failed" else "")
        await self._desk.refresh()

    async def refresh(self) -> None:
        """Show the results that the folder holds."""
        self._refresh_actions()
        project, program = self._desk.project, self._desk.program
        self._checks.clear()
        with self._checks:
            for folder in project.results(program, "preflight")[-1:]:
                self._show_checks(folder)
        self._choices.clear()
        with self._choices:
            self._show_choices()
        self._results.clear()
        with self._results:
            plans = project.plans(program)
            for folder in plans:
                self._show_plan(folder)
            for folder in project.results(program, "prove"):
                self._show_proof(folder)
            if not plans:
                ui.label(texts.NO_RESULTS).classes("st-note")

    def _show_choices(self) -> None:
        """Choices side by side, the smallest error first, each with its gain and the cell file that makes it."""
        rows = choices(self._desk.project, self._desk.program) if self._desk.program else []
        if not rows:
            return
        ui.label(texts.CHOICES).classes("st-title")
        ui.label(texts.CHOICES_HELP).classes("st-note")
        made = table(texts.CHOICE_COLUMNS, [[*one.row(), ""] for one in rows], mark="choices")
        for one, line in zip(rows, list(made)[1:], strict=True):
            if one.cell and one.cell != self._desk.cell:
                with list(line)[-1]:
                    take = ui.button(texts.TAKE, on_click=partial(self._desk.choose, one.cell)).props(
                        "flat dense no-caps"
                    )
                    take.props["data-test"] = f"take-{one.folder}"
                    take.classes("st-jump")

    def _show_checks(self, folder: str) -> None:
        summary = self._desk.project.summary(folder)
        counts = ", ".join(f"{count} {verdict}" for verdict, count in summary["counts"].items())
        ui.label(texts.CHECK_HELP.format(counts=counts)).props('data-test="counts"')
        result_links(self._desk, folder)
        rows = sorted(summary["checks"], key=lambda row: (row["verdict"] not in _WORST, row["verdict"] != "fail"))
        seen = [row for row in rows if row["verdict"] in _WORST]
        self._rows(seen or rows[:6])
        rest = [row for row in rows if row not in (seen or rows[:6])]
        with ui.expansion(texts.ALL_ROWS.format(count=len(rows))).props("dense"):
            self._rows(rest)

    def _rows(self, rows: list[dict[str, Any]]) -> None:
        shown = [
            [
                row["check"],
                row["verdict"],
                _figure(row, "value"),
                _figure(row, "limit"),
                "",
                row["advice"] or row["what"],
            ]
            for row in rows
        ]
        made = table(texts.CHECK_COLUMNS, shown, mark="checks")
        for row, line in zip(rows, list(made)[1:], strict=True):
            line.classes(f"st-check-{row['verdict'].split()[0]}")
            if row["line"] is not None:
                with list(line)[4]:
                    button = ui.button(str(row["place"]), on_click=lambda row=row: self._jump(row["line"]))
                    button.props("flat dense no-caps").classes("st-jump")

    async def _jump(self, line: int) -> None:
        self._desk.go("program")
        if self._desk.at_line is not None:
            await self._desk.at_line(line)

    def _show_plan(self, folder: str) -> None:
        summary = self._desk.project.summary(folder)
        with card("st-card", f"plan-{folder}"):
            ui.label(f"{folder}: {language(summary)}").classes("st-title")
            self._show_other_cell(folder)
            headline = (summary.get("prediction") or {}).get("headline")
            if headline is not None:
                error_bars(texts.EXPECTED, headline["before_mm"], headline["after_mm"], mark=f"bars-{folder}")
                ui.label(texts.WORSE.format(percent=100.0 * headline["probability_of_worse"])).classes("st-note")
            assumed = (summary.get("assumed") or {}).get("stiffness")
            if assumed is not None:
                ui.label(texts.ASSUMED.format(source=assumed["from"])).classes("st-warn")
            warnings = (summary.get("written") or {}).get("warnings", [])
            if warnings:
                with ui.expansion(texts.WARNINGS.format(count=len(warnings))).props("dense").classes("st-warn"):
                    for warning in warnings:
                        ui.label(warning)
            result_links(self._desk, folder)

    def _show_other_cell(self, folder: str) -> None:
        if not self._desk.project.made_with(folder, self._desk.cell):
            ui.label(f"{folder}: {texts.OTHER_CELL}").classes("st-warn")

    def _show_proof(self, folder: str) -> None:
        variants = self._desk.project.summary(folder)["variants"]
        before, after = (variants[name]["path"]["p997_mm"] for name in ("nominal", "compensated"))
        with card("st-card", f"proof-{folder}"):
            ui.label(folder).classes("st-title")
            self._show_other_cell(folder)
            error_bars(texts.PROVED, (before, before, before), (after, after, after), mark=f"bars-{folder}")
            result_links(self._desk, folder)


def _figure(row: dict[str, Any], key: str) -> str:
    return "" if row[key] is None else f"{row[key]:.4g} {row['unit']}".strip()
