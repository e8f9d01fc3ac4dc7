"""Read a dataset: a manifest and the files it maps, as they are."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core import file_content
from counterflex.core.arrays import Bool, Int
from counterflex.core.errors import FileFormatError
from counterflex.core.similar import twice
from counterflex.core.units import MM
from counterflex.files.dataset.cells import Cells
from counterflex.files.dataset.channel import Raw, build
from counterflex.files.dataset.manifest import Manifest, read_manifest
from counterflex.files.dataset.table import Reference, TextTable, read_table
from counterflex.files.dataset.units import in_header, settings_si
from counterflex.identify.data.channels import CHANNELS
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.measuring_frame import SensorFrame

AXES: Final = ("tcp", "base", "frame")
KIND: Final = "pulls"
_CHANNELS: Final = ("s_unloaded", "s_loaded")


def sensor_frame(manifest: Manifest, where: str) -> SensorFrame | None:
    """Sensors that a manifest describes, or None where it has none.

    Raises:
        FileFormatError: Sensors without readings or readings without sensors, another number of them, a name twice,
            axes that are not said, another kind of dataset.
    """
    read = [name for name in _CHANNELS if name in manifest.channels]
    tables = manifest.sensors
    if not tables and not read:
        return None
    _require_described(manifest, read, where)
    direction = np.array([t.direction for t in tables], dtype=np.float64)
    normal = np.array([t.normal if t.normal is not None else [-v for v in t.direction] for t in tables])
    point = np.array([t.point_mm if t.point_mm is not None else (np.nan,) * 3 for t in tables])
    return SensorFrame(
        names=tuple(t.name for t in tables),
        position=np.array([t.position_mm for t in tables], dtype=np.float64) * MM,
        direction=direction / np.linalg.norm(direction, axis=1, keepdims=True),
        normal=normal / np.linalg.norm(normal, axis=1, keepdims=True),
        point=point * MM,
        axes=str(manifest.settings["sensor_axes"]),
        where=f"{where}: sensors",
    )


def _require_described(manifest: Manifest, read: Sequence[str], where: str) -> None:
    tables = manifest.sensors
    if manifest.kind != KIND:
        raise FileFormatError(
            "sensors of a measuring frame are read in pulls only",
            where=f"{where}: kind",
            value=manifest.kind,
            limit=KIND,
        )
    if not tables:
        raise FileFormatError(
            "the sensors of these distances are not described",
            where=f"{where}: channels.{read[0]}",
            hint="Describe each in a table [[sensors]]: name, position_mm, direction; say sensor_axes in [settings]",
        )
    for name in _CHANNELS:
        if name not in manifest.channels:
            raise FileFormatError(
                f"the dataset has no channel '{name}'",
                where=where,
                hint=f"Map it: [channels.{name}] columns = [...]; gauges set to zero before the load: s_unloaded with "
                "constant = [0, ...]",
            )
        table = manifest.channels[name]
        count = len(table.columns) if table.constant is None else len(table.constant)
        if count != len(tables):
            raise FileFormatError(
                "every sensor has one column, in the order of [[sensors]]",
                where=f"{where}: channels.{name}",
                value=f"{count} columns",
                limit=f"{len(tables)} ({', '.join(t.name for t in tables)})",
            )
    if (same := twice([t.name for t in tables])) is not None:
        raise FileFormatError("two sensors have the same name", where=f"{where}: sensors", value=same)
    axes = manifest.settings.get("sensor_axes")
    if axes not in AXES:
        raise FileFormatError(
            "the axes of the sensor positions are not stated" if axes is None else "there are no such axes",
            where=f"{where}: settings.sensor_axes",
            value=None if axes is None else repr(axes),
            limit=", ".join(AXES),
            hint='"tcp": those of the unloaded tool, from its tip (the frame is put up anew at each pose); "base": '
            'those of the robot base; "frame": its own, with channels p_base_frame and R_base_frame',
        )


@dataclass(frozen=True, eq=False)
class _Joined:
    """Files side by side: row i of the dataset is row ``rows[f][i]`` of file f."""

    tables: tuple[TextTable, ...]
    rows: tuple[Int, ...]

    def find(self, reference: Reference, where: str) -> tuple[int, int]:
        """File and column of a reference."""
        if len(self.tables) == 1:
            return 0, self.tables[0].find(reference, where)
        if isinstance(reference, int):
            raise FileFormatError(
                "a column of several files is named by its header", where=where, value=reference, limit="a text"
            )
        having = [
            i
            for i, table in enumerate(self.tables)
            if reference.startswith(table.how.prefix) and reference.removeprefix(table.how.prefix) in table.header
        ]
        if len(having) == 1:
            return having[0], self.tables[having[0]].find(reference, where)
        if having:
            names = " and ".join(self.tables[i].path.name for i in having)
            raise FileFormatError(
                "two files have a column of this name",
                where=where,
                value=f"{reference!r} in {names}",
                hint='Give one of them a prefix: [[files]] prefix = "a.", and write a.NAME for its columns',
            )
        nearest = next((t for t in self.tables if t.how.prefix and reference.startswith(t.how.prefix)), self.tables[0])
        return 0, nearest.find(reference, where)

    def cells(self, references: Sequence[Reference], where: str) -> Cells:
        """Numbers of some columns."""
        places = [self.find(reference, where) for reference in references]
        values = np.stack([self.tables[f].numbers(c)[0][self.rows[f]] for f, c in places], axis=1)
        names = tuple(self.tables[f].header[c] for f, c in places)
        ignored = {f for f, table in enumerate(self.tables) if table.how.header_units == "ignore"}
        stated = tuple(None if f in ignored else in_header(self.tables[f].header[c]) for f, c in places)
        return Cells(values, names, stated, lambda row, k: self._place(places, row, k), tuple(places))

    def _place(self, places: Sequence[tuple[int, int]], row: int, k: int) -> str:
        f, c = places[min(k, len(places) - 1)]
        return self.tables[f].place_of(c, int(self.rows[f][row]))


def read_dataset(path: str | Path) -> Dataset:
    """Read a dataset.

    Args:
        path: Manifest (docs/datasets.md); the files it names are relative to its folder.

    Returns:
        Channels in SI. Channels without a stated standard deviation have none; who needs it says so.

    Raises:
        FileFormatError: In one line: file, line, column, value, what was expected, what to do.
    """
    file = Path(path)
    manifest = read_manifest(file)
    tables = tuple(read_table(file.parent / how.path, how) for how in manifest.files)
    joined = _taken(_join(tables, manifest, str(file)), manifest, str(file))
    n = len(joined.rows[0])
    raws = [
        build(name, CHANNELS[name], table, manifest, joined.cells, n, f"{file}: channels.{name}")
        for name, table in manifest.channels.items()
    ]
    _require_columns_once(raws, str(file))
    turned = [name for name, table in manifest.channels.items() if table.axes != "sensor"]
    if turned and manifest.kind not in ("sensor_poses", "sensor_motion"):
        raise FileFormatError(
            "such data need the wrench in the axes of the sensor",
            where=f"{file}: channels.{turned[0]}.axes",
            value="base",
            limit="kind sensor_poses or sensor_motion",
        )
    keep: Bool = np.ones(n, dtype=np.bool_)
    for raw in raws:
        gap = raw.missing
        if np.any(gap) and not manifest.rows.drop_incomplete:
            row = int(np.argmax(gap))
            raise FileFormatError(
                f"the cell is empty or not a number ({int(np.count_nonzero(gap))} such row"
                f"{'s' if np.count_nonzero(gap) > 1 else ''})",
                where=raw.place_of_missing(row),
                hint="Repair it, or leave such rows out: [rows] drop_incomplete = true",
            )
        keep &= ~gap
    if not np.any(keep):
        raise FileFormatError("no row is complete", where=str(file), hint="Check the columns of [channels.*]")
    group = _groups(joined, manifest, str(file))[keep]
    return Dataset(
        name=manifest.name,
        kind=manifest.kind,
        channels={raw.name: raw.channel(keep, group) for raw in raws},
        group=group,
        line=tables[0].lines[joined.rows[0]][keep],
        settings={
            **dict(settings_si(key, value) for key, value in manifest.settings.items()),
            **{f"{name}_axes": manifest.channels[name].axes for name in turned},
        },
        fingerprint=_fingerprint(file, tables),
        where=str(file),
        file=str(tables[0].path),
        sensors=sensor_frame(manifest, str(file)),
    )


def _require_columns_once(raws: Sequence[Raw], where: str) -> None:
    """Refuse a column that two channels take for different quantities: one of them has a wrong name or number."""
    used: dict[tuple[int, int], tuple[str, str]] = {}
    for raw in raws:
        if raw.table.constant is not None:
            continue
        count = raw.cells.values.shape[1]
        units = raw.kind.si_units(count) if raw.kind.nature != "rotation" else ("a rotation",) * count
        for name, place, unit in zip(raw.cells.names, raw.cells.places, units, strict=True):
            other, before = used.setdefault(place, (raw.name, unit))
            if before != unit:
                raise FileFormatError(
                    "one column is taken for two different quantities",
                    where=f"{where}: channels.{raw.name}.columns",
                    value=f"'{name}'",
                    limit=f"columns that channels.{other} does not use",
                    hint=f"Check columns of {other} and {raw.name}",
                )


def _join(tables: tuple[TextTable, ...], manifest: Manifest, where: str) -> _Joined:
    first = tables[0]
    if manifest.join is None:
        for table in tables[1:]:
            if len(table) != len(first):
                raise FileFormatError(
                    "files that are joined row by row have different numbers of rows",
                    where=where,
                    value=f"{len(first)} in {first.path.name}, {len(table)} in {table.path.name}",
                    hint='Name the columns whose values tell which rows belong together: join = ["..."]',
                )
        return _Joined(tables, tuple(np.arange(len(first), dtype=np.int64) for _ in tables))
    rows = [np.arange(len(first), dtype=np.int64)]
    for table in tables[1:]:
        by_key: dict[tuple[str, ...], int] = {}
        for i, key in enumerate(_keys(table, manifest.join, where)):
            if key in by_key:
                raise FileFormatError(
                    "two rows have the same join key",
                    where=f"{table.path}:{int(table.lines[i])}",
                    value=", ".join(key),
                    hint=f"Line {int(table.lines[by_key[key]])} has it already; only the first file may repeat keys",
                )
            by_key[key] = i
        places = []
        for i, key in enumerate(_keys(first, manifest.join, where)):
            if key not in by_key:
                raise FileFormatError(
                    f"{table.path.name} has no row with this join key",
                    where=f"{first.path}:{int(first.lines[i])}",
                    value=", ".join(key),
                )
            places.append(by_key[key])
        rows.append(np.array(places, dtype=np.int64))
    return _Joined(tables, tuple(rows))


def _keys(table: TextTable, names: Sequence[str], where: str) -> list[tuple[str, ...]]:
    columns = [table.words(table.find(table.how.prefix + name, f"{where}: join")) for name in names]
    return list(zip(*columns, strict=True))


def _taken(joined: _Joined, manifest: Manifest, where: str) -> _Joined:
    """The rows that the manifest wants."""
    rows = manifest.rows
    lines = joined.tables[0].lines[joined.rows[0]]
    last = rows.last_line if rows.last_line is not None else int(lines[-1])
    picked = np.flatnonzero((lines >= rows.first_line) & (lines <= last))[:: rows.every]
    if len(picked) == 0:
        raise FileFormatError(
            "no row is taken", where=f"{where}: rows", value=f"lines {rows.first_line}..{last}", limit=f"1..{lines[-1]}"
        )
    return _Joined(joined.tables, tuple(r[picked] for r in joined.rows))


def _groups(joined: _Joined, manifest: Manifest, where: str) -> Int:
    n = len(joined.rows[0])
    if not manifest.group:
        return np.arange(n, dtype=np.int64)
    ids: dict[tuple[str, ...], int] = {}
    columns = []
    for name in manifest.group:
        f, c = joined.find(name, f"{where}: group")
        words = joined.tables[f].words(c)
        columns.append([words[i] for i in joined.rows[f]])
    return np.array([ids.setdefault(key, len(ids)) for key in zip(*columns, strict=True)], dtype=np.int64)


def _fingerprint(manifest: Path, tables: Sequence[TextTable]) -> str:
    """SHA-256 over manifest and files: each by its length and its bytes, in the manifest's order."""
    digest = hashlib.sha256()
    for data in (file_content.content(manifest), *(table.data for table in tables)):
        digest.update(str(len(data)).encode() + b"\n" + data)
    return digest.hexdigest()
