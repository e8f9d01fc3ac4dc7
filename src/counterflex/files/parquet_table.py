"""Tables as Parquet files: a format name and a version in the metadata, a unit in every column name."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from counterflex.core import atomic, file_content
from counterflex.core.errors import FileFormatError
from counterflex.files.schema import check_header

_KEY = "counterflex"


@dataclass(frozen=True)
class Column:
    """A column of a file and where its values live in memory."""

    name: str  # In the file, with unit suffix
    field: str  # Attribute of the object, dotted for a part of it
    index: int | None = None  # Component of that attribute, or None
    unit: float = 1.0  # SI value of one file unit
    whole: bool = False

    def values(self, data: Any) -> Any:
        """Values of an object in the unit of the file."""
        values = data
        for name in self.field.split("."):
            values = getattr(values, name)
        if self.index is not None:
            values = values[:, self.index]
        return np.asarray(values, dtype=np.int64) if self.whole else np.asarray(values, dtype=np.float64) / self.unit


def columns(names: str, field: str, unit: float = 1.0) -> tuple[Column, ...]:
    """Columns for the components of one attribute, names separated by spaces."""
    return tuple(Column(name, field, i, unit) for i, name in enumerate(names.split()))


def write(path: Path, kind: str, version: int, layout: tuple[Column, ...], data: Any, about: Mapping[str, Any]) -> None:
    """Write the attributes of ``data`` as a table, whole or not at all."""
    frame = table(layout, data)
    meta = json.dumps({"format": kind, "version": version, **about}, allow_nan=False)
    atomic.write_made(path, lambda stream: frame.write_parquet(stream, compression="zstd", metadata={_KEY: meta}))


def table(layout: tuple[Column, ...], data: Any) -> pl.DataFrame:
    """The attributes of ``data`` as a table in shop units, one column each as ``layout`` names them."""
    return pl.DataFrame({column.name: column.values(data) for column in layout})


def read(
    path: Path, kind: str, version: int, layout: tuple[Column, ...], optional: tuple[Column, ...] = ()
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read a table back as attributes.

    Args:
        optional: Further columns, all of them or none.

    Returns:
        Arrays by attribute name (components joined along the last axis), SI; and the metadata.

    Raises:
        FileFormatError: Missing or damaged file, another format, newer version, missing or unknown columns.
    """
    data = file_content.content(path)
    with file_content.readable(path, "a Parquet file"):
        meta = json.loads(pl.read_parquet_metadata(io.BytesIO(data)).get(_KEY, "{}"))
    frame = file_content.parquet(path, data)
    if not isinstance(meta, dict) or "format" not in meta:
        raise FileFormatError(f"not a {kind} file", where=str(path), hint="It was not written by counterflex")
    check_header(meta, kind=kind, version=version, where=str(path))
    if any(column.name in frame.columns for column in optional):
        layout = layout + optional
    names = [column.name for column in layout]
    wrong = sorted(set(names) ^ set(frame.columns))
    if wrong:
        raise FileFormatError("columns are missing or unknown", where=str(path), value=", ".join(wrong[:5]))
    for name, kind_of in frame.schema.items():
        if not kind_of.is_numeric() or frame[name].null_count():
            raise FileFormatError(f"the column {name} contains a value that is not a number", where=str(path))
    return _arrays(frame, layout), meta


def _arrays(frame: pl.DataFrame, layout: tuple[Column, ...]) -> dict[str, Any]:
    parts: dict[str, list[Any]] = {}
    for column in layout:
        values = frame[column.name].to_numpy()
        parts.setdefault(column.field, []).append(
            np.asarray(values, dtype=np.int64) if column.whole else np.asarray(values, dtype=np.float64) * column.unit
        )
    single = {column.field for column in layout if column.index is None}
    return {name: (p[0] if name in single else np.stack(p, axis=-1)) for name, p in parts.items()}
