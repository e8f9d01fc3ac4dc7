"""A form of measured values as files: typed values, the instrument's own file, and what of them looks wrong.

The form is what ``counterflex identify --propose`` writes: a table with the proposed poses, and the manifest that says
what its columns are. Both are written again at each entry, so that the command reads what the page shows.
"""

from __future__ import annotations

import csv
import io
import re
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
import tomlkit

from counterflex.app.identification.cell_model import model_of
from counterflex.app.identification.identify import prepare
from counterflex.app.studio import texts
from counterflex.core import atomic, file_content
from counterflex.core.errors import CounterflexError, FileFormatError, InputError, ModelError, OutputError
from counterflex.files.cell.document import new_table
from counterflex.files.dataset.proposal import ROWS, form_names, planned_for
from counterflex.files.dataset.writer import column_names
from counterflex.identify.data.channels import CHANNELS, ChannelKind

_NUMBER: Final = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?")
_UNIT_RATIO: Final = 200.0
"""Ratio to the median of the other rows above which a reading is in another unit: mm in place of m is 1000, and no pose
of an arm is 200 times farther away than the median one."""
_ENOUGH: Final = 4
"""Rows whose median says how large a reading is."""
_LINE: Final = re.compile(r":(\d+)(?::|$)")
_WITHOUT_SIGMA: Final = ("time_s", "temperature_c")


@dataclass(frozen=True)
class FormColumn:
    """A column of the table."""

    name: str
    channel: str
    label: str  # of its number within the channel: ``x``, ``fx``, ``1``
    unit: str
    planned: bool  # the proposal fills it
    shown: bool  # a pose that is gone to: shown, not typed

    @property
    def kind(self) -> ChannelKind:
        """Meaning of the channel."""
        return CHANNELS[self.channel]


class Remark(NamedTuple):
    """A finding on a row: ``todo`` (nothing measured), ``bad`` (cannot be used as it is), ``odd`` (look at it)."""

    state: str = "done"
    text: str = ""


@dataclass
class MeasurementForm:
    """Table and manifest of a form."""

    folder: Path
    recipe: str
    columns: list[FormColumn]
    rows: list[list[str]]
    sigma: dict[tuple[str, str], float] = field(default_factory=dict)  # by channel and unit
    _seen: tuple[bytes, bytes] = (b"", b"")
    _saving: threading.Lock = field(default_factory=threading.Lock)  # entries come faster than a slow disk takes them

    @classmethod
    def read(cls, folder: Path, recipe: str) -> MeasurementForm:
        """Read the form of a folder. Raises FileFormatError: it is not there, or is no form."""
        form = cls(folder, recipe, [], [])
        seen = form._content()
        header, *rows = list(csv.reader(io.StringIO(seen[1].decode("utf-8", "replace")))) or [[]]
        if not header or any(len(row) != len(header) for row in rows):
            raise FileFormatError("not the table of a form", where=str(form.table))
        form.columns = _columns(header, _proposed(folder))
        form.rows = [[cell.strip() for cell in row] for row in rows]
        doc: Any = tomlkit.parse(seen[0].decode("utf-8", "replace")).unwrap()
        for channel, unit, place in form.spreads():
            given = doc.get("channels", {}).get(channel, {}).get("sigma")
            values = given if isinstance(given, list) else [given]
            if place < len(values) and isinstance(values[place], int | float):
                form.sigma[channel, unit] = float(values[place])
        form._seen = seen
        return form

    @property
    def manifest(self) -> Path:
        """The manifest."""
        return self.folder / form_names(self.recipe)[0]

    @property
    def table(self) -> Path:
        """The table."""
        return self.folder / form_names(self.recipe)[1]

    def spreads(self) -> list[tuple[str, str, int]]:
        """Quantities whose standard deviation is stated: channel, unit, place in ``sigma``."""
        out = []
        for channel, columns in _by_channel(self.columns).items():
            if not columns[0].shown and not columns[0].kind.whole and channel not in _WITHOUT_SIGMA:
                out += [(channel, unit, k) for k, unit in enumerate(dict.fromkeys(one.unit for one in columns))]
        return out

    def enter(self, row: int, column: int, text: str) -> None:
        """Take what was typed; a decimal comma is read as a point."""
        text = text.strip().replace("\u2212", "-")
        self.rows[row][column] = text.replace(",", ".") if _NUMBER.fullmatch(text) else text

    def used(self) -> list[FormColumn]:
        """Columns that hold something, and those without which they mean nothing."""
        out: list[FormColumn] = []
        for columns in _by_channel(self.columns).values():
            filled = [any(row[self.columns.index(one)] for row in self.rows) for one in columns]
            most = max((k + 1 for k, one in enumerate(filled) if one), default=0)
            counts = [count for count in columns[0].kind.allowed if count >= most]
            out += columns[: min(counts, default=len(columns))] if most else []
        return out

    def remarks(self) -> list[Remark]:
        """Remarks on each row by the numbers alone."""
        used = self.used()
        places = [self.columns.index(one) for one in used]
        odd = self._odd(used)
        measured = [k for k, one in zip(places, used, strict=True) if not one.planned]
        out: list[Remark] = []
        for number, row in enumerate(self.rows):
            wrong = [k for k in places if row[k] and not _NUMBER.fullmatch(row[k])]
            empty = ", ".join(self.columns[k].label for k in places if not row[k])
            if wrong:
                label = self.columns[wrong[0]].label
                out.append(Remark("bad", texts.ROW_NO_NUMBER.format(column=label, text=row[wrong[0]])))
            elif not any(row[k] for k in measured):
                out.append(Remark("todo", texts.ROW_TODO))
            elif empty:
                out.append(Remark("bad", texts.ROW_INCOMPLETE.format(columns=empty)))
            else:
                out.append(Remark("odd", odd[number]) if number in odd else Remark())
        return out

    def _odd(self, used: Sequence[FormColumn]) -> dict[int, str]:
        """Rows whose reading is of another size than that of the others, or the same again."""
        out: dict[int, str] = {}
        taken = [one for one in used if not (one.planned or one.kind.whole or one.channel in _WITHOUT_SIGMA)]
        for channel, unit in dict.fromkeys((one.channel, one.unit) for one in taken):
            readings = self._readings([one for one in taken if (one.channel, one.unit) == (channel, unit)])
            out |= _odd_readings(readings, unit) if len(readings) >= _ENOUGH else {}
        return out

    def _readings(self, columns: Sequence[FormColumn]) -> dict[int, tuple[float, ...]]:
        """Numbers of some columns, of the rows that have all of them."""
        places = [self.columns.index(one) for one in columns]
        return {
            number: tuple(float(row[k]) for k in places)
            for number, row in enumerate(self.rows)
            if all(_NUMBER.fullmatch(row[k]) for k in places)
        }

    def is_current(self) -> bool:
        """Return whether the files are as this form has read or written them."""
        with self._saving:
            return self._content() == self._seen

    def save(self) -> None:
        """Write table and manifest: columns that are empty throughout are left out of the manifest, and rows too.

        Raises:
            OutputError: Another program has changed a file since it was read.
        """
        with self._saving:
            self._save()

    def _save(self) -> None:
        if self._content() != self._seen:
            raise OutputError(texts.FORM_CHANGED, where=str(self.folder), hint=texts.FORM_CHANGED_HINT)
        doc: Any = tomlkit.parse(self._seen[0].decode("utf-8", "replace"))
        tables = doc["channels"]
        used = _by_channel(self.used())
        for channel in _by_channel(self.columns):
            if channel not in used:
                tables.pop(channel, None)
                continue
            if channel not in tables:
                tables[channel] = new_table()
            self._map(tables[channel], channel, used[channel])
        doc["rows"] = {"drop_incomplete": True}
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([[one.name for one in self.columns], *self.rows])
        atomic.write_text(self.table, text.getvalue())
        atomic.write_text(self.manifest, tomlkit.dumps(doc))
        self._seen = self._content()

    def _map(self, table: Any, channel: str, columns: Sequence[FormColumn]) -> None:
        units = list(dict.fromkeys(one.unit for one in columns))
        table["columns"] = [one.name for one in columns]
        if units != ["1"]:
            table["unit"] = units[0] if len(units) == 1 else units
        if columns[0].kind.nature == "rotation":
            table["rotation"] = "rotation_vector"
        spread = [self.sigma.get((channel, unit)) for unit in units]
        if all(one is not None for one in spread):
            table["sigma"] = spread[0] if len(spread) == 1 else spread
        else:
            table.pop("sigma", None)

    def _content(self) -> tuple[bytes, bytes]:
        return file_content.content(self.manifest), file_content.content(self.table)


def _odd_readings(readings: Mapping[int, tuple[float, ...]], unit: str) -> dict[int, str]:
    """Rows of one quantity whose size is another, or whose numbers were there before."""
    out: dict[int, str] = {}
    sizes = {number: float(np.linalg.norm(reading)) for number, reading in readings.items()}
    known: dict[tuple[float, ...], int] = {}
    for number, size in sizes.items():
        usual = float(np.median([one for k, one in sizes.items() if k != number]))
        first = known.setdefault(readings[number], number)
        if max(size, usual) > _UNIT_RATIO * min(size, usual) > 0.0:
            out[number] = texts.ROW_UNIT.format(size=f"{size:.4g}", usual=f"{usual:.4g}", unit=unit)
        elif size > 0.0 and first != number:
            out[number] = texts.ROW_TWICE.format(row=first + 1)
    return out


def _proposed(folder: Path) -> list[str]:
    """Columns of the proposal in a folder."""
    return file_content.content(folder / ROWS).decode("utf-8", "replace").split("\n", 1)[0].strip().split(",")


def _columns(header: Sequence[str], proposed: Sequence[str]) -> list[FormColumn]:
    """Columns of a table by their names."""
    known = {
        name: (channel, label, unit)
        for channel, kind in CHANNELS.items()
        for name, label, unit in zip(
            column_names(channel, kind, kind.allowed[-1]),
            kind.components,
            kind.file_units(kind.allowed[-1]),
            strict=False,
        )
    }
    out = []
    for name in header:
        if name not in known:
            raise FileFormatError("the form has a column of another name", value=name, limit="those it came with")
        channel, label, unit = known[name]
        planned = bool(planned_for(name, channel, proposed))
        out.append(FormColumn(name, channel, label, unit, planned, planned and CHANNELS[channel].nature == "joints"))
    return out


def _by_channel(columns: Sequence[FormColumn]) -> dict[str, list[FormColumn]]:
    out: dict[str, list[FormColumn]] = {}
    for column in columns:
        out.setdefault(column.channel, []).append(column)
    return out


class ReadingCheck(NamedTuple):
    """What a recipe says of readings."""

    fault: str = ""  # why it does not take them
    at_line: Mapping[int, str] = MappingProxyType({})  # by line of the file


def check_readings(recipe: str, manifest: Path, cell: Path) -> ReadingCheck:
    """Identify from the readings there are, write nothing, and return what the recipe says about them."""
    try:
        task = prepare(recipe, [manifest], cell)
        # Predicting the same readings spares the fits of the folds: their error says nothing, and is not shown.
        settings = {**task.settings, **task.recipe.quick}
        estimate = task.recipe.identify(model_of(task.cell), task.data, task.data, settings)
    except (FileFormatError, InputError, ModelError) as fault:
        return _refused(fault)
    except (ArithmeticError, np.linalg.LinAlgError) as fault:  # too few readings for the algebra
        return ReadingCheck(fault=str(fault))
    place = task.place_of(estimate)
    at_line = {}
    for fit in estimate.fits.values():
        for one in fit.outliers:
            match = _LINE.search(place(one.block, one.row))
            if match is not None:
                at_line[int(match[1])] = texts.ROW_OUTLIER.format(size=one.size)
    return ReadingCheck(at_line=at_line)


def _refused(fault: CounterflexError) -> ReadingCheck:
    match = _LINE.search(str(fault.where or ""))
    return ReadingCheck(str(fault), at_line={} if match is None else {int(match[1]): fault.what})
