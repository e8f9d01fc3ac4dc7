"""The pages after the cut: inspect a part, correct the next one, and how a program runs."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, Final

from nicegui import ui

from counterflex.app.studio import texts
from counterflex.app.studio.desk import (
    Action,
    Drop,
    FaultBanner,
    Workbench,
    card,
    command_text,
    error_bars,
    language,
    result_links,
    table,
)
from counterflex.app.studio.jobs import QueuedCommand
from counterflex.core.next_command import next_command

_EXPECTED: Final = ("now_p997_um", "next_p997_um", "next_5_percent_um", "next_95_percent_um")

_STYLES: Final = {texts.WITHIN[True]: "st-ok", texts.WITHIN[False]: "st-fail"}


class InspectPage:
    """A scan of the part, its judgement, the program of the next part."""

    def __init__(self, desk: Workbench) -> None:
        self._desk = desk
        self.fault = FaultBanner("inspect-fault")
        with ui.element("div").classes("st-two st-even"):
            with ui.column().classes("st-block"):
                self._scan = ui.select([], label=texts.SCAN, on_change=self._refresh_actions).classes("st-full")
                self._scan.props('data-test="scan"')
                ui.label(texts.SCAN_HELP).classes("st-note")
                Drop(desk, "drop-scan", self._dropped)
                self._inspect = Action(
                    desk, "inspect", texts.INSPECT, self._inspect_line, lambda: self._lacking(texts.SCAN), self._ended
                )
                self._judged = ui.column().classes("st-form")
            with ui.column().classes("st-block"):
                self._plan = ui.select([], label=texts.MADE_BY, on_change=self._refresh_actions).classes("st-full")
                self._plan.props('data-test="made-by"')
                self._measured = ui.select([], label=texts.MEASURED_BY, on_change=self._refresh_actions)
                self._measured.classes("st-full").props('data-test="measured-by"')
                ui.label(texts.CORRECT_HELP).classes("st-note")
                self._correct = Action(
                    desk, "correct", texts.CORRECT, self._correct_line, self._lacking_for_correction, self._ended
                )
                self._next = ui.column().classes("st-form")
        self._history = ui.column().classes("st-form")
        desk.changed.append(self.refresh)

    def _lacking(self, what: str) -> str:
        return self._desk.lacking() or texts.NEEDS.format(what=what)

    def _used_before(self) -> bool:
        """The chosen plan has come of the chosen scan: it shows an earlier part."""
        if not self._plan.value or not self._measured.value:
            return False
        parts = self._desk.project.summary(self._plan.value).get("correct", {}).get("parts", [])
        judged = self._desk.project.summary(self._measured.value).get("parts", {}).values()
        return bool({part["source"] for part in parts} & {one["scan"]["file"] for one in judged if "scan" in one})

    def _lacking_for_correction(self) -> str:
        if self._used_before():
            return texts.SCAN_OF_EARLIER
        return self._lacking(texts.MADE_BY if not self._plan.value else texts.INSPECT)

    async def _dropped(self, name: str) -> None:
        await self._desk.refresh()
        self._scan.set_value(name)

    def _inspect_line(self) -> list[str]:
        if self._desk.lacking() or not self._scan.value:
            return []
        scan = str(self._scan.value)
        out = f"{Path(scan).stem}-inspected"
        return [next_command("inspect", self._desk.program, cell=self._desk.cell, scan=scan, out=out)]

    def _correct_line(self) -> list[str]:
        plan, scan = self._plan.value, self._measured.value
        if self._desk.lacking() or not scan or not plan or self._used_before():
            return []
        out = f"{plan}-next"
        return [next_command("correct", self._desk.program, cell=self._desk.cell, plan=plan, scan=scan, out=out)]

    def _refresh_actions(self) -> None:
        self._inspect.refresh()
        self._correct.refresh()

    async def _ended(self, job: QueuedCommand) -> None:
        self.fault.show(job.error if job.state == "failed" else "")
        await self._desk.refresh()

    async def refresh(self) -> None:
        """Show scans, plans and results of the folder."""
        project, program = self._desk.project, self._desk.program
        _offer(self._scan, project.scans())
        _offer(self._plan, project.plans(program))
        _offer(self._measured, project.results(program, "inspect"), newest=True)
        self._refresh_actions()
        self._judged.clear()
        with self._judged:
            for folder in project.results(program, "inspect"):
                self._show_features(folder, project.summary(folder))
        corrected = project.results(program, "correct")
        self._history.clear()
        with self._history:
            if corrected:
                self._show_history(project.summary(corrected[-1])["correct"])
        self._next.clear()
        with self._next:
            for folder in corrected:
                summary = project.summary(folder)
                with card("st-card", f"next-{folder}"):
                    ui.label(f"{folder}: {language(summary)}").classes("st-title")
                    expected = summary["correct"]["expected"]
                    now, *after = (expected[key] / 1000.0 for key in _EXPECTED)
                    error_bars(texts.CORRECTED, (now, now, now), after, mark=f"bars-{folder}")
                    result_links(self._desk, folder)
                    accept = ui.button(texts.ACCEPT, on_click=partial(self._plan.set_value, folder))
                    accept.props("no-caps outline").props["data-test"] = f"accept-{folder}"

    def _show_history(self, correct: dict[str, Any]) -> None:
        """Parts of the program one after the other, and what is expected of the next."""
        expected = correct["expected"]
        rows = [
            [
                str(part["part"]),
                str(part["source"]),
                f"{part['surface_p997_um'] / 1e3:.3f}",
                f"{part['error_rms_um'] / 1e3:.3f}",
                "" if part.get("changed_um") is None else f"{part['changed_um'] / 1e3:.3f}",
            ]
            for part in correct["parts"]
        ]
        low, high = (expected[key] / 1e3 for key in _EXPECTED[2:])
        value = f"{expected['next_p997_um'] / 1e3:.3f} ({low:.3f} to {high:.3f})"
        ui.label(texts.HISTORY).classes("st-title")
        table(texts.HISTORY_COLUMNS, [*rows, [str(len(rows) + 1), texts.EXPECTED_PART, value, "", ""]], mark="history")

    def _show_features(self, folder: str, summary: dict[str, Any]) -> None:
        ui.label(folder).classes("st-title")
        result_links(self._desk, folder)
        rows = feature_rows(summary["features"])
        made = table(texts.FEATURE_COLUMNS, rows, mark="features")
        for row, line in zip(rows, list(made)[1:], strict=True):
            line.classes(_STYLES.get(row[-1], ""))


def feature_rows(features: list[dict[str, Any]]) -> list[list[str]]:
    """Features of an inspected part as the page shows them; one that the scan does not hold is said to be so."""
    rows = []
    for one in features:
        part = one.get("part")
        measured = texts.NOT_FOUND if part is None else f"{part['worst_mm']:.3f}"
        within = None if part is None else part["within"]
        rows.append(
            [
                one["feature"],
                one["quantity"],
                f"{measured} ({one['nominal_mm']:g})",
                f"+- {one['tolerance_mm']:g}",
                texts.WITHIN[within],
            ]
        )
    return rows


class RunPage:
    """Commands that run the program with correction and open the panel."""

    def __init__(self, desk: Workbench) -> None:
        self._desk = desk
        ui.label(texts.NOT_AN_E_STOP).classes("st-warn")
        self._column = ui.column().classes("st-form")
        desk.changed.append(self.refresh)

    async def refresh(self) -> None:
        """Show the commands for what is chosen."""
        plans = self._desk.project.plans(self._desk.program) if self._desk.program else []
        plan = f"{plans[-1]}/plan.parquet" if plans else "PLAN"
        rsi = "rsi.xml" if self._desk.project.inside("rsi.xml") else None
        lines = (
            " ".join(self._desk.project.summary(plans[-1]).get("files", [])) if plans else "",
            next_command("run", cell=self._desk.cell or "CELL", rsi=rsi, plan=plan, out="log"),
            next_command("panel", "log"),
        )
        self._column.clear()
        with self._column:
            for (title, text), line in zip(texts.PANEL_STEPS, lines, strict=True):
                with ui.element("div").classes("st-card"):
                    ui.label(title).classes("st-title")
                    ui.label(text)
                    command_text(line)


def _offer(select: ui.select, names: list[str], *, newest: bool = False) -> None:
    """Offer names; the newest is chosen where none was, or with ``newest`` where there is a new one."""
    known = select.value in names and not (newest and names != select.options)
    value = select.value if known else (names[-1] if names else None)
    if names != select.options or value != select.value:
        select.set_options(names, value=value)
