"""Base of every counterflex file: strict tables, versions, and one clear line per fault."""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Self, TypeVar

import numpy as np
import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

from counterflex.core import atomic, file_content
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.similar import close_to
from counterflex.core.units import DEG, MM, UM_PER_KN, URAD_PER_KNM
from counterflex.geometry import pose

Model = TypeVar("Model", bound="Table")

_FORMATS: Final = {
    "counterflex-cell": "This is a cell file, as --cell reads it",
    "counterflex-truth": "This is a truth file, as --truth reads it",
    "counterflex-scenario": "This is a scenario file, as --scenario reads it",
    "counterflex-dataset": "This is a manifest of measured data, as identify and dataset check read it",
    "counterflex-proposal": "This is a proposal, as twin measure reads it",
}
_STIFFNESS = re.compile(r"stiff|^k_|^k[abc]$|_per_rad$|_n_per_", re.IGNORECASE)
SOFTEST_UM_PER_KN: Final = 1e5
"""Softest element that a file may hold, translation: 1e4 N/m."""
SOFTEST_URAD_PER_KNM: Final = 1e6
"""Softest element that a file may hold, rotation: 1000 N m/rad; the joints of milling robots have 1e5 to 1e7."""
STIFFEST: Final = 1e-3
"""Stiffest element that is not rigid, um/kN and urad/kNm: 1e12 N/m and 1e12 N m/rad."""
Length = Annotated[float, Field(ge=-20000.0, le=20000.0)]
"""A place in a cell, mm; what lies beyond is a unit mistake."""
Angle = Annotated[float, Field(ge=-720.0, le=720.0)]
"""An angle, deg."""


class Table(BaseModel):
    """A table of a file: unknown keys, NaN and infinity are refused, values cannot be changed after reading."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True, str_strip_whitespace=True)


class PoseTable(Table):
    """A pose in shop units: position and intrinsic z-y'-x'' angles (KUKA X Y Z A B C)."""

    x_mm: Length = 0.0
    y_mm: Length = 0.0
    z_mm: Length = 0.0
    a_deg: Angle = 0.0
    b_deg: Angle = 0.0
    c_deg: Angle = 0.0

    def matrix(self) -> Float:
        """The pose as (4, 4) in m."""
        return pose.from_xyz_zyx(
            np.array([self.x_mm, self.y_mm, self.z_mm]) * MM, np.array([self.a_deg, self.b_deg, self.c_deg]) * DEG
        )


class ComplianceTable(Table):
    """Compliance of an elastic element in its own axes; what is left out keeps its value (rigid by default).

    Translations in um/kN (the same number as 1e-9 m/N), rotations in urad/kNm (1e-9 rad/(N m)).
    A stiffness k in N mm/rad is ``1e12 / k`` urad/kNm; 1.2e10 N mm/rad is 83.3.
    """

    tx_um_per_kn: float | None = None
    ty_um_per_kn: float | None = None
    tz_um_per_kn: float | None = None
    rx_urad_per_knm: float | None = None
    ry_urad_per_knm: float | None = None
    rz_urad_per_knm: float | None = None

    @model_validator(mode="after")
    def _plausible(self) -> Self:
        for key, value in self._components():
            if value < 0.0:
                raise ValueError(f"{key} is negative: {value:g}; a compliance is at least 0")
            softest = SOFTEST_UM_PER_KN if key.startswith("t") else SOFTEST_URAD_PER_KNM
            if value > softest:
                is_stiffness = "" if key.startswith("t") else f". Is it a stiffness?{_as_compliance(value)[1:]}"
                raise ValueError(f"{key} is implausibly large: {value:g}; expected at most {softest:g}{is_stiffness}")
            if 0.0 < value < STIFFEST:
                raise ValueError(
                    f"{key} is implausibly small: {value:g}; expected 0 (rigid) or at least {STIFFEST:g}. "
                    "Values in m/N or rad/(N m) are multiplied by 1e9"
                )
        return self

    @property
    def states_compliance(self) -> bool:
        """True where a key of the table gives a compliance, 0 (rigid) included."""
        return bool(self._components())

    def _components(self) -> list[tuple[str, float]]:
        keys = [f"t{a}_um_per_kn" for a in "xyz"] + [f"r{a}_urad_per_knm" for a in "xyz"]
        return [(key, value) for key in keys if (value := getattr(self, key)) is not None]

    def over(self, base: Float) -> Float:
        """SI compliance (6,) with the given entries replacing those of ``base``."""
        out = np.array(base, dtype=np.float64)
        for i, name in enumerate(("tx", "ty", "tz")):
            value = getattr(self, f"{name}_um_per_kn")
            if value is not None:
                out[i] = value * UM_PER_KN
        for i, name in enumerate(("rx", "ry", "rz")):
            value = getattr(self, f"{name}_urad_per_knm")
            if value is not None:
                out[3 + i] = value * URAD_PER_KNM
        return out

    @classmethod
    def of(cls, compliance: Float) -> dict[str, float]:
        """Keys and shop values of the entries of an SI compliance (6,) that are not rigid."""
        names = [f"t{a}_um_per_kn" for a in "xyz"] + [f"r{a}_urad_per_knm" for a in "xyz"]
        return {
            name: float(f"{value / 1e-9:.6g}") for name, value in zip(names, compliance, strict=True) if value != 0.0
        }


def read_toml(path: str | Path, kind: str = "") -> dict[str, Any]:
    """Parse a TOML file.

    Args:
        kind: Its ``format``, for messages.

    Raises:
        FileFormatError: It does not exist, cannot be read, or is not TOML; with line and column.
    """
    file = Path(path)
    data = file_content.content(file)
    foreign = file_content.of_bytes(data)
    if foreign is not None:
        raise _foreign(file, foreign, kind)
    text = file_content.decoded(data, file)
    if not text.strip():
        raise FileFormatError("the file is empty", where=str(file), hint=_what_to_give(kind))
    with file_content.readable(file, "TOML", _what_to_give(kind) or "Correct it"):
        try:
            return tomllib.loads(text)
        except tomllib.TOMLDecodeError as fault:
            foreign = file_content.of_text(text)
            if foreign is not None:
                raise _foreign(file, foreign, kind) from fault
            raise FileFormatError(f"not valid TOML: {fault}", where=str(file)) from fault


def _foreign(file: Path, what: str, kind: str) -> FileFormatError:
    return FileFormatError(f"this is {what}", where=str(file), limit="a TOML file", hint=_what_to_give(kind))


def check_header(data: dict[str, Any], *, kind: str, version: int, where: str) -> None:
    """Check ``format`` and ``version`` of a file.

    Raises:
        FileFormatError: Another format, or a version newer than this program knows.
    """
    if "format" not in data:
        raise FileFormatError("the key 'format' is missing", where=where, limit=f'format = "{kind}"')
    if data["format"] != kind:
        raise FileFormatError(
            f"not a {kind} file", where=where, value=repr(data["format"]), limit=f'format = "{kind}"',
            hint=_FORMATS.get(str(data["format"])),
        )  # fmt: skip
    if "version" not in data:
        raise FileFormatError("the key 'version' is missing", where=where, limit=f"version = {version}")
    result = data["version"]
    if isinstance(result, bool) or not isinstance(result, int) or result < 1:
        raise FileFormatError(
            "the version is not a whole number", where=where, value=repr(result), limit=f"version = {version}"
        )
    if result > version:
        raise FileFormatError(
            "the file is newer than this counterflex reads",
            where=where,
            value=f"version {result}",
            limit=f"at most {version}",
            hint="Update counterflex",
        )


def parse(model: type[Model], data: dict[str, Any], *, where: str) -> Model:
    """Check a table against its model.

    Raises:
        FileFormatError: One line for the first fault (place, value, expectation, hint), and how many more there are.
    """
    try:
        # Through JSON, because only there a strict model takes a list for a tuple but no text for a number.
        return model.model_validate_json(json.dumps(data, default=str), strict=True)
    except ValidationError as fault:
        raise _explain(fault, model, where) from fault


_TELLING: Final = ("extra_forbidden", "missing")


def _explain(fault: ValidationError, model: type[Table], where: str) -> FileFormatError:
    faults = fault.errors(include_url=False)
    # An unknown key is most often a misspelt one and then says more than the key that is missing for it.
    first = min(faults, key=lambda item: _TELLING.index(item["type"]) if item["type"] in _TELLING else len(_TELLING))
    loc = list(first["loc"])
    what, details = _fault_text(first, loc, model)
    if first["type"] == "missing" and loc and isinstance(loc[-1], int):
        loc.pop()  # the list is what has too few
    place = ".".join(f"[{part + 1}]" if isinstance(part, int) else str(part) for part in loc).replace(".[", "[")
    if len(faults) > 1:
        what += f" ({len(faults) - 1} more fault{'s' if len(faults) > 2 else ''} in this file)"
    return FileFormatError(what, where=f"{where}: {place}" if place else where, **details)


def _fault_text(fault: ErrorDetails, loc: Sequence[int | str], model: type[Table]) -> tuple[str, dict[str, Any]]:
    """Return the text of a fault, with value, limit and hint as far as they help."""
    key = next((part for part in reversed(loc) if isinstance(part, str)), "")
    match fault["type"]:
        case "extra_forbidden":
            return f"unknown key '{key}'", {"hint": _unknown_key_hint(list(loc), fault.get("input"), model)}
        case "missing" if loc and isinstance(loc[-1], int):
            return f"'{key}' has too few numbers", {"value": f"{loc[-1]} numbers", "limit": f"at least {loc[-1] + 1}"}
        case "missing":
            return f"the key '{key}' is missing", {}
        case "value_error":
            return str(fault["ctx"]["error"]), {}
    context, value = fault.get("ctx", {}), fault.get("input")
    too_long = isinstance(value, dict | list) or (isinstance(value, str) and len(value) > 60)
    shown = None if value is None or too_long else repr(value)
    if "actual_length" in context:
        shown = f"{context['actual_length']} entries"
    return f"'{key}' cannot be used", {"value": shown, "limit": _expected(str(fault["type"]), context, fault["msg"])}


_EXPECTED: Final = {
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "a number from {ge:g} up",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "a number of {le:g} at most",
    "finite_number": "a finite number",
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a text in quotes",
    "bool_type": "true or false",
    "literal_error": "{expected}",
    "too_short": "{min_length} entries or more",
    "too_long": "{max_length} entries at most",
    "string_too_short": "a text that is not empty",
    "list_type": "a list (for tables: double brackets, [[name]])",
    "tuple_type": "a list (for tables: double brackets, [[name]])",
    "model_type": "one table (single brackets, [name])",
}
"""What a value should have been, by the kind of fault."""


def _expected(kind: str, context: dict[str, Any], message: str) -> str:
    if kind in _EXPECTED:
        return _EXPECTED[kind].format(**context)
    return message[:1].lower() + message[1:]


def _table_at(model: type[BaseModel], loc: Sequence[int | str]) -> type[BaseModel]:
    """The model of the table at a place."""
    table = model
    for part in loc:
        info = table.model_fields.get(str(part))
        todo: list[Any] = [] if info is None else [info.annotation]
        while todo:
            item = todo.pop()
            if isinstance(item, type) and issubclass(item, BaseModel):
                table = item
                break
            todo.extend(getattr(item, "__args__", ()))
    return table


def _unknown_key_hint(loc: Sequence[int | str], value: object, model: type[BaseModel]) -> str:
    key, table = str(loc[-1]), _table_at(model, loc[:-1])
    if _STIFFNESS.search(key) and issubclass(table, ComplianceTable):
        hint = "Elastic elements hold compliance, never stiffness: rx_urad_per_knm = 1e12 / (stiffness in N mm/rad)"
        return hint + _as_compliance(value)
    known = sorted(table.model_fields)
    stem = key.rsplit("_", 1)[0]
    for name in known:
        if name.startswith(key + "_"):
            return f"Write the unit into the key: {name}"
        if "_" in key and "_" in name and name.rsplit("_", 1)[0] == stem:
            return f"Its unit is another: {name}"
    close = close_to(key, known, 1)
    return f"Did you mean '{close[0]}'?" if close else f"The keys of this table: {', '.join(known)}"


def _as_compliance(value: object) -> str:
    if not isinstance(value, int | float) or not 0.0 < value < math.inf:
        return ""
    return f"; {value:g} N mm/rad is {1e12 / value:.4g} urad/kNm, {value:g} N m/rad is {1e9 / value:.4g} urad/kNm"


def write_toml(path: str | Path, data: dict[str, Any], *, comment: str = "") -> None:
    """Write a table as TOML, whole or not at all, with an optional comment on top."""
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    atomic.write_text(path, head + tomli_w.dumps(data))


class Versioned(Table):
    """A whole file: format and version first."""

    format: str
    version: int

    @classmethod
    def read(cls, path: str | Path, *, kind: str, version: int) -> Self:
        """Read, check the header, check every key."""
        data = read_toml(path, kind)
        check_header(data, kind=kind, version=version, where=str(path))
        return parse(cls, data, where=str(path))


def _what_to_give(kind: str) -> str | None:
    """Advice where a file has another format."""
    if kind == "counterflex-dataset":
        return (
            "Measured data are given by their manifest, a TOML file that names the data file and says what its columns "
            "are (docs/datasets.md); a workbook is saved as CSV first"
        )
    return f'Required is a TOML text file that begins with format = "{kind}"' if kind else None
