"""Mapping of an instrument's file in the browser: a list of its columns for each number of each quantity."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial

from nicegui import events, ui

from counterflex.app.studio import texts
from counterflex.app.studio.desk import card
from counterflex.app.studio.measured_file import MeasuredFile, rotations, units_of
from counterflex.identify.data.channels import CHANNELS, KINDS
from counterflex.identify.recipe import Recipe


class FileMapping:
    """Choices of what the columns of a file are.

    Args:
        changed: Called when one of them is another.
    """

    def __init__(self, changed: Callable[[], Awaitable[None]]) -> None:
        self.file: MeasuredFile | None = None
        self._changed = changed
        self._kinds: dict[str, str] = {}
        self._column = ui.column().classes("st-form")

    def clear(self) -> None:
        """Show none."""
        self.file = None
        self._column.clear()

    def show(self, file: MeasuredFile, recipe: Recipe) -> None:
        """Show a file for a recipe."""
        self.file, self._kinds = file, {one: KINDS.get(one, one) for one in recipe.kinds}
        self._draw()

    def _draw(self) -> None:
        """The channels of the data, each with the columns of the file."""
        file = self.file
        assert file is not None
        none = {"": texts.NO_COLUMN, **{name: name for name in file.header}}
        self._column.clear()
        with self._column:
            with ui.row().classes("st-row"):
                kinds = ui.select(self._kinds, label=texts.KIND, value=file.kind).classes("st-pick")
                kinds.props('data-test="kind"').on_value_change(lambda event: self._rekind(event.value))
                group = ui.select(none, label=texts.GROUP, value=file.group).classes("st-pick")
                group.props('data-test="group"').on_value_change(lambda event: self._regroup(event.value))
                more = {name: f"{name}: {one.text}" for name, one in CHANNELS.items() if name not in file.channels}
                ui.select(more, label=texts.MORE_CHANNELS, with_input=True).classes("st-pick").on_value_change(
                    lambda event: self._add_channel(event.value)
                )
            for channel in file.channels:
                self._channel_row(channel, none)

    def _channel_row(self, channel: str, none: dict[str, str]) -> None:
        assert self.file is not None
        mapped, kind = self.file.channels[channel], CHANNELS[channel]
        with card("st-card", f"channel-{channel}"):
            ui.label(f"{channel}: {kind.text}").classes("st-title")
            with ui.element("div").classes("st-columns"):
                for k, name in enumerate(mapped.columns):
                    label = kind.components[k] if k < len(kind.components) else str(k + 1)
                    label = f"A{label}" if kind.nature == "joints" else label
                    pick = ui.select(none, label=label or channel, value=name if name in none else "")
                    pick.props(f'dense data-test="column-{channel}-{k + 1}"')
                    pick.on_value_change(partial(self._remap, mapped.columns, k))
                for k, units in enumerate(units_of(channel)):
                    self._quantity(channel, k, units)
                if rotations(channel):
                    turn = ui.select(list(rotations(channel)), label=texts.ROTATION, value=mapped.rotation)
                    turn.props("dense").on_value_change(lambda event: self._turn(channel, event.value))

    def _quantity(self, channel: str, place: int, units: list[str]) -> None:
        """Unit and standard deviation of one quantity of a channel."""
        assert self.file is not None
        mapped, kind = self.file.channels[channel], CHANNELS[channel]
        if units != ["1"]:
            here = mapped.units[place] if mapped.units[place] in units else units[0]
            pick = ui.select(units, label=texts.UNIT, value=here).props("dense")
            pick.on_value_change(partial(self._remap, mapped.units, place))
        if not kind.whole and kind.nature != "joints":
            field = ui.number(texts.SIGMA, value=mapped.sigma[place], min=0)
            field.props(f'dense debounce=600 data-test="sigma-{channel}-{place + 1}"')
            field.on_value_change(partial(self._respread, mapped.sigma, place))

    async def _rekind(self, kind: str) -> None:
        assert self.file is not None
        self.file.choose(kind)
        self._draw()
        await self._changed()

    async def _regroup(self, column: str) -> None:
        assert self.file is not None
        self.file.group = column or ""
        await self._changed()

    def _add_channel(self, channel: str) -> None:
        assert self.file is not None
        self.file.add(channel)
        self._draw()

    async def _turn(self, channel: str, rotation: str) -> None:
        assert self.file is not None
        self.file.channels[channel].turn(rotation)
        self._draw()
        await self._changed()

    async def _remap(self, texts_of: list[str], place: int, event: events.ValueChangeEventArguments) -> None:
        texts_of[place] = event.value or ""
        await self._changed()

    async def _respread(self, sigma: list[float | None], place: int, event: events.ValueChangeEventArguments) -> None:
        sigma[place] = event.value or None
        await self._changed()
