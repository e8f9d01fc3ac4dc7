"""Columns of a run log: those that older code wrote placed by name among those of today, and the unit of each."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Schema

from counterflex import __version__
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.logs.mcap_salvage import Salvaged, parsed
from counterflex.files.logs.segment import CYCLES
from counterflex.runtime.record_ring import COLUMNS, is_whole

_NEEDED: Final = ("cycle", "received_ns", "sent_ns", "out_state", "out_cause", "out_feed_hold", "elapsed")
"""Columns without which nothing can be said about a run."""


def columns_of(readable: Salvaged, made_by: str, file: Path) -> tuple[str, ...]:
    """Columns that the records of a segment have: those of today, or fewer where older code wrote it.

    Columns have only ever been added, so that a name stands for the same number in all logs.

    Raises:
        FileFormatError: Columns that this program does not know, or without which nothing can be said.
    """
    records = (record for chunk in readable.chunks for record in chunk.records())
    schemas = (parsed(Schema, content) for opcode, content in records if opcode == Opcode.SCHEMA)
    schema = next((one for one in schemas if one is not None and one.name == CYCLES), None)
    if schema is None:
        return COLUMNS
    columns = tuple(str(name) for name in json.loads(schema.data)["columns"])
    unknown = [f"with '{name}'" for name in columns if name not in COLUMNS]
    lacking = [f"without '{name}'" for name in _NEEDED if name not in columns]
    if wrong := [*unknown, *lacking, *(("one twice",) * (len(set(columns)) < len(columns)))]:
        raise FileFormatError(
            "the run log was written by another version of this program, whose columns mean something else",
            where=str(file),
            value=f"{len(columns)} columns of counterflex {made_by}, {wrong[0]}",
            limit=f"columns of counterflex {__version__}",
            hint="Read it with the version that wrote it: its log export writes CSV",
        )
    return columns


def placed(rows: Float, columns: tuple[str, ...]) -> Float:
    """Records (n, WIDTH) with the columns of today; what was not recorded is 0 in counts and flags, else NaN.

    Args:
        rows: (n, k) as recorded.
    """
    if columns == COLUMNS:
        return rows
    out = np.array([0.0 if is_whole(name) else np.nan for name in COLUMNS]) * np.ones((len(rows), 1))
    out[:, [COLUMNS.index(name) for name in columns]] = rows
    return out


def require_all(absent: Sequence[str], about: Mapping[str, Any], where: str, what: str) -> None:
    """Refuse a log of older code for a job that needs everything that is recorded today.

    Args:
        what: What cannot be done with it, for the message: ``computed again``.

    Raises:
        FileFormatError: It lacks columns.
    """
    if absent:
        raise FileFormatError(
            f"the run log was written by older code and cannot be {what}: not all that this takes was recorded then",
            where=where,
            value=f"{len(COLUMNS) - len(absent)} columns of counterflex {about.get('counterflex', '(unknown)')}",
            limit=f"{len(COLUMNS)} columns of counterflex {__version__}",
            hint="log show and log export read it; for the rest use the version that wrote it",
        )


_UNITS: Final = (
    (r"counter_ms", "ms"),
    (r"(received|sent)_ns", "ns"),
    (r"fast_(residual|turn|tooth|slower|change)", "N"),
    (r"(sensor|wrench|used|predicted|filtered)_f[xyz]", "N"),
    (r"(sensor|wrench|used|predicted|filtered)_m[xyz]|torque_\d", "N m"),
    (r"second_[fs][xyz]|pair_gap", "N"),
    (r"(force|expected)_(feed|across|tool|size|least|most)", "N"),
    (r"(nominal|actual|reported|correction|deflection|wanted|deviation|offset)_[xyz]", "m"),
    (r"(correction|deflection|wanted|deviation|offset)_r[xyz]|q\d|axis_\d", "rad"),
    (r"tracker_late", "s"),
    (r"tracker_sigma|path_distance|uncertain|cut_m|path_m", "m"),
    (r"(value|limit)_missing_cut", "m"),
    (r"(value|limit)_(overload|chatter)", "N"),
    (r"wear_trend(_sigma)?", "1/m"),
    (r"flag_(elapsed|(force|tracker|current)_age)|elapsed", "cycles"),
)


def unit_of(column: str) -> str:
    """Unit of a column of :data:`counterflex.runtime.record_ring.COLUMNS`; empty for ratios, bits and states."""
    return next((unit for pattern, unit in _UNITS if re.fullmatch(pattern, column)), "")


def headings() -> list[str]:
    """The columns in order, each with its unit in brackets where it has one: ``correction_x [m]``."""
    return [f"{name} [{unit_of(name)}]" if unit_of(name) else name for name in COLUMNS]
