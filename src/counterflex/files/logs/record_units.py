"""Units of the columns of a run log's records."""

from __future__ import annotations

import re
from typing import Final

from counterflex.runtime.record_ring import COLUMNS

_UNITS: Final = (
    (r"counter_ms", "ms"),
    (r"(received|sent)_ns", "ns"),
    (r"fast_(residual|turn|tooth)", "N"),
    (r"(sensor|wrench|used|predicted|filtered)_f[xyz]", "N"),
    (r"(sensor|wrench|used|predicted|filtered)_m[xyz]|torque_\d", "N m"),
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
