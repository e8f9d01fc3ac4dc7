"""The manifest of a dataset (``counterflex-dataset``, version 1). docs/datasets.md explains every key."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field, field_validator, model_validator

from counterflex.core.errors import CounterflexError, FileFormatError
from counterflex.core.similar import close_to
from counterflex.files.dataset.units import settings_si
from counterflex.files.schema import Length, PoseTable, Table, Versioned
from counterflex.identify.data.channels import CHANNELS, KINDS, SETTINGS, channel_kind
from counterflex.identify.recipes import added_kinds

KIND: Final = "counterflex-dataset"
VERSION: Final = 1
REPEATS: Final = "repeats"
Rotation = Literal["xyz_fixed", "xyz_intrinsic", "zyx_intrinsic", "rotation_vector", "quat_wxyz", "quat_xyzw", "matrix"]
COLUMNS_OF: Final[dict[str, int]] = {"quat_wxyz": 4, "quat_xyzw": 4, "matrix": 9}
"""Number of columns of a rotation; three for the others."""
Name = Annotated[str, Field(min_length=1)]
Line = Annotated[int, Field(ge=0)]
LEAST_COSINE: Final = 0.2588
"""Between the beam of a sensor and the normal of its plane: 75 deg."""


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


class FileTable(Table):
    """One file of a dataset and how it is written."""

    path: Name
    separator: Name = ","
    decimal: Literal[".", ","] = "."
    thousands: Literal["", ".", ",", " ", "'"] = ""
    encoding: str = "utf-8"
    header_line: Line = 1
    skip_lines: tuple[Line, ...] = ()
    comment: str = ""
    missing: tuple[str, ...] = ()
    prefix: str = ""
    part: Name | Line | None = None
    header_units: Literal["check", "ignore"] = "check"

    @model_validator(mode="after")
    def _marks(self) -> FileTable:
        if self.decimal == self.thousands:
            raise ValueError(f"decimal and thousands are the same mark: {self.decimal!r}")
        if self.separator not in ("tab", "space") and len(self.separator) != 1:
            raise ValueError(f"separator = {self.separator!r}; expected one character, 'tab' or 'space'")
        if self.decimal == self.separator == ",":
            raise ValueError("decimal and separator are both a comma; most such files have separator = ';'")
        return self


class RowsTable(Table):
    """Rows that are taken."""

    first_line: Line = 0
    last_line: Annotated[int, Field(ge=1)] | None = None
    every: Annotated[int, Field(ge=1)] = 1
    drop_incomplete: bool = False


class ChannelTable(Table):
    """Place and meaning of one channel's numbers."""

    columns: tuple[Any, ...] = ()
    constant: tuple[float, ...] | None = None
    unit: tuple[str, ...] | None = None
    factor: tuple[float, ...] | None = None
    rotation: Rotation | None = None
    frame: str | None = None
    acts_on: Literal["tool", "surroundings"] = "tool"
    axes: Literal["sensor", "base"] = "sensor"
    sigma: tuple[float, ...] | Literal["repeats"] | None = None
    sigma_columns: tuple[Any, ...] = ()
    sigma_unit: str | None = None
    sigma_coverage: Annotated[float, Field(ge=0.5, le=10.0)] = 1.0
    signs: tuple[Literal[-1, 1], ...] = ()
    offsets_deg: tuple[float, ...] = ()
    coupling: tuple[tuple[float, ...], ...] = ()

    @field_validator("constant", "unit", mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        return (value,) if isinstance(value, int | float | str) else _tuple(value)

    @field_validator("factor", mode="before")
    @classmethod
    def _factor(cls, value: Any) -> Any:
        if value is None:
            return value
        entries = value if isinstance(value, list) else [value]
        if not all(isinstance(f, int | float) and not isinstance(f, bool) and 0.0 < abs(f) < math.inf for f in entries):
            raise ValueError(f"factor = {value!r}; expected finite numbers other than zero")
        return tuple(float(f) for f in entries)

    @field_validator("sigma", mode="before")
    @classmethod
    def _sigma(cls, value: Any) -> Any:
        if value is None or value == REPEATS:
            return value
        entries = value if isinstance(value, list) else [value]
        if not all(isinstance(s, int | float) and not isinstance(s, bool) and 0.0 < s < math.inf for s in entries):
            raise ValueError(f'sigma = {value!r}; expected finite standard deviations above zero, or "repeats"')
        return tuple(entries)

    @field_validator("columns", "sigma_columns", mode="before")
    @classmethod
    def _columns(cls, value: Any) -> Any:
        entries = value if isinstance(value, list) else [value]
        for column in entries:
            whole = isinstance(column, int) and not isinstance(column, bool)
            if not (whole and column >= 1) and not (isinstance(column, str) and column):
                raise ValueError(f"a column is {column!r}; expected the text of its header, or its number from 1")
        return tuple(entries)

    @field_validator("columns")
    @classmethod
    def _once(cls, value: tuple[Any, ...]) -> tuple[Any, ...]:
        twice = [column for column, count in Counter(value).items() if count > 1]
        if twice:
            raise ValueError(f"column {twice[0]!r} is named twice; every number of a channel has a column of its own")
        return value

    @model_validator(mode="after")
    def _one_source(self) -> ChannelTable:
        if bool(self.columns) == (self.constant is not None):
            raise ValueError("a channel has either columns or constant")
        if self.sigma == REPEATS and (self.sigma_columns or self.constant is not None):
            raise ValueError('sigma = "repeats" goes with neither sigma_columns nor constant')
        if self.sigma_coverage != 1.0 and not self.sigma_columns:
            raise ValueError(
                f"sigma_coverage = {self.sigma_coverage:g} belongs to sigma_columns, of which there are none; "
                "divide sigma by it instead"
            )
        if self.factor is not None and self.unit is None:
            raise ValueError("factor says how much of a unit one of the file's numbers is; unit is missing")
        if self.sigma_unit is not None and not self.sigma_columns and not isinstance(self.sigma, tuple):
            raise ValueError(f"sigma_unit = {self.sigma_unit!r} belongs to a sigma, which is not given")
        return self


Vector = tuple[float, float, float]


class DatasetSensorTable(Table):
    """One distance sensor of a measuring frame."""

    name: Name
    position_mm: tuple[Length, Length, Length]
    direction: Vector
    normal: Vector | None = None
    point_mm: tuple[Length, Length, Length] | None = None

    @field_validator("direction", "normal")
    @classmethod
    def _unit(cls, value: Vector | None) -> Vector | None:
        length = 1.0 if value is None else math.hypot(*value)
        if abs(length - 1.0) > 0.01:
            unit = [round(v / length, 4) for v in value or ()] if length > 0.0 else "none"
            raise ValueError(f"the vector has length {length:.4g}; expected a unit vector (length 1): {unit}")
        return value

    @model_validator(mode="after")
    def _meets(self) -> DatasetSensorTable:
        if self.normal is not None:
            cosine = abs(sum(a * b for a, b in zip(self.direction, self.normal, strict=True)))
            if cosine < LEAST_COSINE:
                angle = math.degrees(math.acos(min(1.0, cosine)))
                raise ValueError(
                    f"sensor '{self.name}' looks along its plane: {angle:.1f} deg between beam and normal; expected at "
                    "most 75 deg"
                )
        return self


class Manifest(Versioned):
    """A whole manifest."""

    name: Name
    kind: Name
    files: Annotated[tuple[FileTable, ...], Field(min_length=1)]
    join: tuple[str, ...] | None = None
    group: tuple[str, ...] = ()
    rows: RowsTable = RowsTable()
    channels: dict[str, ChannelTable]
    frames: dict[str, PoseTable] = Field(default={})
    settings: dict[str, Any] = Field(default={})
    sensors: tuple[DatasetSensorTable, ...] = ()

    @field_validator("join", "group", mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        return (value,) if isinstance(value, str) else _tuple(value)

    @model_validator(mode="after")
    def _used(self) -> Manifest:
        for name, table in self.channels.items():
            if table.frame is not None and table.frame not in self.frames:
                raise ValueError(
                    f"channel '{name}' is given in frame '{table.frame}', which no [frames.{table.frame}] describes"
                )
        unused = set(self.frames) - {table.frame for table in self.channels.values()}
        if unused:
            raise ValueError(f"no channel is given in frame '{min(unused)}'")
        if len(self.files) == 1 and self.join is not None:
            raise ValueError("join is for several files")
        twice = [path for path, count in Counter(file.path for file in self.files).items() if count > 1]
        if twice:
            raise ValueError(f"the file {twice[0]} is listed twice")
        return self


def read_manifest(path: Path) -> Manifest:
    """Read a manifest and check that kind, channels and settings are known.

    Raises:
        FileFormatError: In one line, with what to do.
    """
    manifest = Manifest.read(path, kind=KIND, version=VERSION)
    if manifest.kind not in KINDS:
        _known("kind of dataset", manifest.kind, KINDS | added_kinds(), f"{path}: kind")
    for name in manifest.channels:
        try:
            channel_kind(name)
        except CounterflexError as fault:
            raise FileFormatError(
                fault.what, where=f"{path}: channels.{name}", limit="a name of docs/datasets.md", hint=fault.hint
            ) from fault
    if not manifest.channels:
        raise FileFormatError("no channel is mapped", where=f"{path}: channels", hint=f"Known: {', '.join(CHANNELS)}")
    for key in manifest.settings:
        _known("setting", settings_si(key, 0.0)[0], SETTINGS, f"{path}: settings.{key}")
    return manifest


def _known(what: str, name: str, among: dict[str, str], where: str) -> None:
    if name not in among:
        close = close_to(name, sorted(among), 1)
        raise FileFormatError(
            f"there is no such {what}",
            where=where,
            value=name,
            hint=f"Did you mean '{close[0]}'?" if close else f"Known: {', '.join(among)}",
        )
