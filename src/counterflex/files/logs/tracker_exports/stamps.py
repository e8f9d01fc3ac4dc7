"""Time stamps as programs of trackers write them, in ns."""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime
from typing import Final

from counterflex.core.errors import FileFormatError
from counterflex.core.units import MINUTE, NS

_HOUR_S: Final = 60.0 * MINUTE
_CLOCK: Final = re.compile(
    r"(?:(?P<date>\S+)[T ])?(?P<h>\d{1,2}):(?P<m>\d{2}):(?P<s>\d{2}(?:[.,]\d+)?)(?:Z|[+]00:?00)?"
)
_DATES: Final = ("%Y-%m-%d", "%Y/%m/%d", "%d.%m.%Y", "%m/%d/%Y", "%m/%d/%y")
"""Year first, German, American: the order that is not told apart by its marks is read as the American one."""


def stamp_ns(text: str, where: str) -> int:
    """Time of ``16:56:08.25`` (since midnight), or of ``02/12/25 16:56:08`` and other dates (since 1970, UTC).

    Raises:
        FileFormatError: It is neither.
    """
    match = _CLOCK.fullmatch(text.strip())
    if match is None or int(match["h"]) > 23 or int(match["m"]) > 59:
        raise FileFormatError("not a time stamp", where=where, value=repr(text.strip()), limit="[date] hh:mm:ss[.fff]")
    day_s = 0
    if match["date"]:
        day_s = _day(match["date"], where)
    seconds = int(match["h"]) * _HOUR_S + int(match["m"]) * MINUTE
    whole, _, rest = match["s"].replace(",", ".").partition(".")
    return round((day_s + seconds + int(whole)) / NS) + int(rest.ljust(9, "0")[:9] or 0)


def _day(text: str, where: str) -> int:
    for form in _DATES:
        try:
            return int(datetime.strptime(text, form).replace(tzinfo=UTC).timestamp())
        except ValueError:
            continue
    raise FileFormatError("not a date", where=where, value=repr(text), limit="2026-05-12, 12.05.2026 or 05/12/26")


def number(text: str, where: str, decimal: str = ".") -> float:
    """A finite number with a decimal point, or with a decimal comma where ``decimal`` says so."""
    try:
        value = float(text.strip().replace(decimal, ".") if decimal not in text or "." not in text else text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FileFormatError("not a finite number", where=where, value=repr(text.strip()))
    return value
