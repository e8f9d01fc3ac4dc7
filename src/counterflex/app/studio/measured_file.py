"""The file of an instrument, as it is: how it is written, and which of its columns is which quantity."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.studio import texts
from counterflex.core.errors import CounterflexError, FileFormatError
from counterflex.files.dataset.manifest import COLUMNS_OF, KIND, VERSION, FileTable
from counterflex.files.dataset.proposal import ROWS, planned_for, read_proposal
from counterflex.files.dataset.table import TextTable, read_table
from counterflex.files.dataset.units import UNITS, in_header, settings_shop
from counterflex.files.dataset.writer import column_names
from counterflex.files.schema import write_toml
from counterflex.identify.data.channels import CHANNELS, CHANNELS_OF, ChannelKind

_MARKS: Final = ((",", "."), (";", ","), (";", "."), ("tab", "."), ("tab", ","), ("space", "."))
"""Separators and decimal marks that are tried: those of spreadsheets in English and in German, and of instruments."""
_HEADER_LINES: Final = (1, 2, 3)
"""Lines that may hold the names of the columns; a title or a date often stands above them."""
_ROTATIONS: Final = (
    "rotation_vector",
    "xyz_fixed",
    "xyz_intrinsic",
    "zyx_intrinsic",
    "quat_wxyz",
    "quat_xyzw",
    "matrix",
)
_PLANNED: Final = "proposal."
_UNIT: Final = re.compile(r"[\[(].*?[\])]|_(mm|um|deg|rad|n|nm|s|ms)$")
_WORDS: Final[Mapping[str, tuple[str, ...]]] = {
    "joints": ("{label}", "a{label}", "j{label}", "q{label}", "axis{label}", "joint{label}"),
    "time_s": ("t", "time", "zeit", "timestamp"),
    "temperature_c": ("temp", "temperature", "temperatur"),
}
"""Names that instruments and controllers give to a number, by nature or name of its channel."""


@dataclass
class MappedChannel:
    """Columns of a channel in a file; empty names: not there."""

    columns: list[str]
    units: list[str]  # of each quantity of the channel
    sigma: list[float | None]  # of each quantity
    rotation: str = "rotation_vector"

    @classmethod
    def empty(cls, channel: str) -> MappedChannel:
        """Return a channel of which no column is known."""
        kind = CHANNELS[channel]
        count = kind.allowed[-1]
        units = list(dict.fromkeys(kind.file_units(count)))
        return cls([""] * count, units, [None] * len(units))

    def turn(self, rotation: str) -> None:
        """Take the columns for another convention of the rotation."""
        count = COLUMNS_OF.get(rotation, 3)
        self.rotation, self.columns = rotation, [*self.columns, *[""] * count][:count]

    def table(self, kind: ChannelKind) -> dict[str, Any]:
        """Table of the channel in a manifest."""
        columns = self.columns[: max(k + 1 for k, name in enumerate(self.columns) if name)]
        quantities = len(dict.fromkeys(kind.file_units(len(columns)))) if kind.nature != "rotation" else 1
        out: dict[str, Any] = {"columns": columns}
        units, sigma = self.units[:quantities], self.sigma[:quantities]
        if units != ["1"] and self.rotation not in COLUMNS_OF:
            out["unit"] = units[0] if len(units) == 1 else units
        if kind.nature == "rotation":
            out["rotation"] = self.rotation
        if all(sigma):
            out["sigma"] = sigma[0] if len(sigma) == 1 else sigma
        return out


@dataclass
class MeasuredFile:
    """A file with its columns and the channels that they are mapped to."""

    path: Path
    how: FileTable
    header: list[str]
    count: int
    folder: Path  # of the form that the file belongs to
    kind: str
    channels: dict[str, MappedChannel] = field(default_factory=dict)
    group: str = ""  # column whose equal values are repeats or one motion
    settings: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path, folder: Path) -> MeasuredFile:
        """Read a file, and guess what its columns are.

        Raises:
            FileFormatError: It is no table, or its proposal cannot be read.
        """
        proposal = read_proposal(folder / "proposal.toml")
        how, table = _sniffed(path)
        rows = len(next(iter(proposal.columns.values())))
        settings = dict(settings_shop(key, value) for key, value in proposal.settings.items())
        header = list(table.header)
        if rows == len(table):  # row for row the proposal: what is not in the file is as it was proposed
            header += [_PLANNED + name for name in _proposed(folder)]
        file = cls(path, how, header, len(table), folder, "", settings=settings)
        file.choose(proposal.kind)
        return file

    def choose(self, kind: str) -> None:
        """Take the data for a kind, and guess the columns of its channels."""
        self.kind, free = kind, [name for name in self.header if not name.startswith(_PLANNED)]
        planned = [name.removeprefix(_PLANNED) for name in self.header if name.startswith(_PLANNED)]
        self.channels = {}
        for channel in CHANNELS_OF.get(kind, ()):
            mapped = self.channels[channel] = MappedChannel.empty(channel)
            own = CHANNELS[channel]
            names = column_names(channel, own, own.allowed[-1])
            for k, name in enumerate(names):
                match = next((one for one in free if _alike(one, name, channel, own, k)), None)
                if match is not None:
                    free.remove(match)
                    mapped.columns[k] = match
            if not any(mapped.columns):
                as_planned = [planned_for(name, channel, planned) for name in names]
                mapped.columns = [_PLANNED + one if one else "" for one in as_planned]
            _take_units(mapped, own)

    def add(self, channel: str) -> None:
        """Take a further channel, of which no column is known."""
        self.channels.setdefault(channel, MappedChannel.empty(channel))

    def write(self, manifest: Path) -> None:
        """Write the manifest of the file. Raises FileFormatError: no column is chosen."""
        used = {name: one for name, one in self.channels.items() if any(one.columns)}
        if not used:
            raise FileFormatError(texts.NOTHING_MAPPED, where=str(self.path))
        path = Path(os.path.relpath(self.path, self.folder)).as_posix()
        files = [{**self.how.model_dump(exclude_defaults=True), "path": path}]
        names = [name for one in used.values() for name in one.columns]
        files += [{"path": ROWS, "prefix": _PLANNED}] if any(name.startswith(_PLANNED) for name in names) else []
        group = {"group": [self.group]} if self.group else {}
        known = {key: value for key, value in self.settings.items() if key in _STATED}
        data = {
            "format": KIND,
            "version": VERSION,
            "name": self.path.stem,
            "kind": self.kind,
            **group,
            **({"settings": known} if known else {}),
            "files": files,
            "rows": {"drop_incomplete": True},
            "channels": {name: one.table(CHANNELS[name]) for name, one in used.items()},
        }
        write_toml(manifest, data)


_STATED: Final = ("history", "approach", "pairs")
"""Settings of a proposal that hold for its data, however they were read."""


def _proposed(folder: Path) -> list[str]:
    return list(read_table(folder / ROWS, FileTable(path=ROWS)).header)


def _sniffed(path: Path) -> tuple[FileTable, TextTable]:
    """Form of a file: of all readings the one with the most columns of numbers."""
    best: tuple[int, FileTable, TextTable] | None = None
    refused: CounterflexError | None = None
    for line in _HEADER_LINES:
        for separator, decimal in _MARKS:
            how = FileTable(path=path.name, separator=separator, decimal=decimal, header_line=line)  # type: ignore[arg-type]
            try:
                table = read_table(path, how)
                if len(table) > 1 and not _numbers(table, 0, 1) and _numbers(table, 1, 2):  # a row of units
                    how = how.model_copy(update={"skip_lines": (int(table.lines[0]),)})
                    table = read_table(path, how)
            except CounterflexError as fault:
                refused = refused or fault
                continue
            count = _numbers(table, 0, len(table))
            if best is None or count > best[0]:
                best = (count, how, table)
    if best is None or best[0] == 0:
        raise refused or FileFormatError(texts.NO_COLUMNS, where=str(path))
    return best[1], best[2]


def _numbers(table: TextTable, begin: int, end: int) -> int:
    """Columns whose cells in some rows all are numbers or empty, and not all empty."""
    rows = slice(begin, end)
    part = replace(table, columns=tuple(cells[rows] for cells in table.columns), lines=table.lines[rows])
    count = 0
    for k in range(len(part.header)):
        try:
            count += not bool(np.all(part.numbers(k)[1]))
        except FileFormatError:
            continue
    return count


def _alike(header: str, name: str, channel: str, kind: ChannelKind, component: int) -> bool:
    """Return whether a header names a number of a channel."""
    bare = re.sub(r"[^a-z0-9]", "", _UNIT.sub("", header.lower()))
    if header == name or bare == re.sub(r"[^a-z0-9]", "", _UNIT.sub("", name.lower())):
        return True
    label = kind.components[component]
    patterns = _WORDS.get(channel) or _WORDS.get(kind.nature, ("{label}",))
    unit = in_header(header)
    fits = unit is None or unit in UNITS.get(kind.si_units(component + 1)[component], {})
    return fits and bare in {one.format(label=label) for one in patterns} - {""}


def _take_units(mapped: MappedChannel, kind: ChannelKind) -> None:
    """Take the units that the headers state."""
    si = kind.si_units(len(mapped.columns))
    for k, quantity in enumerate(dict.fromkeys(si)):
        stated = [in_header(one) for one, unit in zip(mapped.columns, si, strict=True) if one and unit == quantity]
        if stated and stated[0] in UNITS.get(quantity, {}):
            mapped.units[k] = str(stated[0])


def units_of(channel: str) -> list[list[str]]:
    """Units that each quantity of a channel may be written in."""
    kind = CHANNELS[channel]
    return [list(UNITS.get(si, {si: 1.0})) for si in dict.fromkeys(kind.si_units(kind.allowed[-1]))]


def rotations(channel: str) -> Sequence[str]:
    """Conventions of a rotation; none for other channels."""
    return _ROTATIONS if CHANNELS[channel].nature == "rotation" else ()
