"""Result of an identification as a card: values with intervals, readings that do not fit, what to measure next."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, Final

from nicegui import ui

from counterflex.app.questions import check_cell
from counterflex.app.studio import texts
from counterflex.app.studio.desk import FaultBanner, Workbench, card, result_links, table
from counterflex.core.result import digits_of
from counterflex.files.shop_unit import unit_of_name
from counterflex.identify.recipes import RECIPES

_NEXT: Final = 3
"""Unknowns of the new cell that are shown."""
_PARAMETERS: Final = 12
"""Parameters that are shown at once; the report has all."""
_SEEN: Final = {"partly": 1, "prior": 2}
"""Order of parameters: what the data determine, what they determine in part, what was known before."""
_NOTHING: Final = 1e-6
"""Share of the interval below which a value is rounding, and shown as 0."""
Choose = Callable[[str], Awaitable[None]]
"""Called with the recipe that is to be measured."""


async def show_identification(desk: Workbench, fault: FaultBanner, folder: str, choose: Choose) -> None:
    """Show what was identified in a folder."""
    result = desk.project.identification(folder)
    with card("st-card", f"identified-{folder}"):
        ui.label(texts.IDENTIFIED[result["outcome"]].format(folder=folder)).classes("st-title")
        for one in result["headline"][:2]:
            before = "" if one["nominal"] is None else texts.SO_FAR_BEFORE.format(value=f"{one['nominal']:.3g}")
            unit = unit_of_name(one["name"])
            ui.label(texts.SO_FAR.format(text=one["text"], value=f"{one['value']:.3g}", unit=unit, before=before))
        _show_values(result["fits"])
        for remark in result["remarks"]:
            ui.label(remark).classes("st-note")
        result_links(desk, folder)
        cell = f"{folder}/cell.toml"
        if desk.cell != cell:
            take = ui.button(texts.TAKE_CELL.format(cell=cell), on_click=lambda: desk.choose(cell=cell))
            take.props('no-caps unelevated data-test="take-cell"')
        await _show_next(desk, fault, cell, choose)


def _show_values(fits: dict[str, Any]) -> None:
    """Parameters with their intervals, and the readings that do not fit them."""
    free = [row for fit in fits.values() for row in fit["parameters"] if row["free"]]
    rows = [_parameter(row) for row in sorted(free, key=lambda row: _SEEN.get(row["seen"], 0))]
    table(texts.PARAMETER_COLUMNS, rows[:_PARAMETERS], mark="parameters")
    if len(rows) > _PARAMETERS:
        with ui.expansion(texts.ALL_PARAMETERS.format(count=len(rows))).props("dense"):
            table(texts.PARAMETER_COLUMNS, rows[_PARAMETERS:], mark="more-parameters")
    for fit in fits.values():
        for one in fit["outliers"]:
            ui.label(f"{one['where']}: {texts.ROW_OUTLIER.format(size=one['size'])}").classes("st-warn")


def _parameter(row: dict[str, Any]) -> list[str]:
    interval = texts.INTERVAL.format(low=digits_of(row["low"], 4), high=digits_of(row["high"], 4))
    before = "" if row["nominal"] is None else digits_of(row["nominal"], 4)
    value = row["value"] if abs(row["value"]) > _NOTHING * abs(row["high"] - row["low"]) else 0.0
    return [row["label"], digits_of(value, 4), interval, row["unit"], before, row["seen"]]


async def _show_next(desk: Workbench, fault: FaultBanner, cell: str, choose: Choose) -> None:
    """Show the unknowns of the new cell by their cost, each with its own guide."""
    answer = await fault.during(check_cell, str(desk.project.folder / cell))
    if answer is None or answer["unknowns"] is None:
        return
    ui.label(texts.NEXT_UNKNOWN).classes("st-title")
    with ui.row().classes("st-row").props('data-test="next"'):
        for row in answer["unknowns"]["rows"][:_NEXT]:
            recipe = row["measure"].split()[1]
            leaves = "" if row["leaves_mm"] is None else texts.LEAVES.format(leaves=row["leaves_mm"])
            button = ui.button(f"{row['unknown']}{leaves}: {recipe}", on_click=partial(choose, recipe))
            button.props("no-caps outline").set_enabled(recipe in RECIPES)
