"""DMIS output of a coordinate measuring machine: the measured points in it (ISO 22093)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.errors import FileFormatError
from counterflex.files.scan.number_lines import text_stream
from counterflex.files.scan.scan import UNITS, PointStore, Scan

_POINT: Final = re.compile(r"FA\s*\(([^)]*)\)\s*=\s*FEAT\s*/\s*POINT\s*,\s*(\w+)\s*,(.*)", re.IGNORECASE)
_UNITS: Final = re.compile(r"UNITS\s*/\s*(\w+)", re.IGNORECASE)
_NAMES: Final = {"MM": "mm", "CM": "cm", "M": "m", "INCH": "inch"}


def is_dmis(head: bytes) -> bool:
    """Whether a text begins like DMIS: its words stand before a slash."""
    return (
        re.search(rb"^\s*(DMISMN|DMISMD|FILNAM|UNITS|FA\s*\(|F\s*\()[^\n]*[/=]", head, re.MULTILINE | re.IGNORECASE)
        is not None
    )


def read_dmis(path: Path) -> Scan:
    """Read the measured points (``FA(name)=FEAT/POINT,CART,x,y,z,i,j,k``); ``F(...)`` are nominal and left out.

    Raises:
        FileFormatError: No measured points, polar coordinates, an unknown unit, or a word in place of a number.
    """
    with text_stream(path) as stream:
        text = stream.read().decode("utf-8", "replace").replace("\r", "")
    # a line that ends with $ goes on in the next one
    lines, start = [], 1
    for number, line in enumerate(text.split("\n"), 1):
        lines.append((start, line.rstrip().removesuffix("$")))
        if not line.rstrip().endswith("$") or line.lstrip().startswith("$$"):
            start = number + 1
    joined: dict[int, str] = {}
    for number, line in lines:
        joined[number] = joined.get(number, "") + line
    points, unit, nominal = [], None, 0
    for number, line in joined.items():
        if line.lstrip().startswith("$$"):
            continue
        unit = _unit(line, f"{path}:{number}", unit)
        nominal += re.match(r"\s*F\s*\([^)]*\)\s*=\s*FEAT\s*/\s*POINT", line, re.IGNORECASE) is not None
        match = _POINT.match(line.strip())
        if match:
            points.append(_point(match, f"{path}:{number}"))
    if not points:
        raise FileFormatError(
            "the DMIS file holds no measured points",
            where=str(path),
            value=f"{nominal} nominal points F(...)" if nominal else None,
            limit="FA(name)=FEAT/POINT,CART,x,y,z,i,j,k",
            hint="Give the output of the measurement, not its program",
        )
    store = PointStore(path, f"DMIS output, {len(points)} points")
    store.add(np.array(points))
    return store.scan(unit)


def _unit(line: str, where: str, unit: float | None) -> float | None:
    match = _UNITS.match(line.strip())
    if not match:
        return unit
    name = _NAMES.get(match[1].upper())
    if name is None:
        raise FileFormatError("unknown unit", where=where, value=match[1], limit=", ".join(_NAMES))
    return UNITS[name]


def _point(match: re.Match[str], where: str) -> list[float]:
    if match[2].upper() != "CART":
        raise FileFormatError("the point is not given in x, y, z", where=where, value=match[2], limit="CART")
    words = [word.strip() for word in match[3].split(",")]
    try:
        return [float(words[k]) for k in range(3)]
    except (ValueError, IndexError) as fault:
        raise FileFormatError(
            f"the point {match[1]} has no three numbers", where=where, value=",".join(words)[:60]
        ) from fault
