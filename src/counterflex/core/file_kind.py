"""Kind of a file by its first bytes or lines, for the message about a file of another kind."""

from __future__ import annotations

import re
from typing import Final

_BY_FIRST_BYTES: Final[tuple[tuple[bytes, str], ...]] = (
    (b"PK\x03\x04", "a spreadsheet workbook (.xlsx, .ods) or another zip archive"),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "a spreadsheet workbook (.xls) or another Office file"),
    (b"PAR1", "a Parquet table"),
    (b"\x89MCAP", "a run log (MCAP)"),
    (b"\x89HDF\r\n", "an HDF5 or MATLAB file"),
    (b"MATLAB 5.0 MAT-file", "a MATLAB file"),
    (b"TDSm", "a TDMS file of LabVIEW"),
    (b"LabVIEW Measurement", "a measurement file of LabVIEW (.lvm)"),
    (b"ASTM-E57", "a scan (E57)"),
    (b"LASF", "a scan (LAS)"),
    (b"ISO-10303-21", "a CAD model (STEP)"),
    (b"glTF", "a model (glTF)"),
    (b"OFF\n", "a mesh (OFF)"),
    (b"#VRML", "a model (VRML)"),
    (b"%PDF", "a PDF file"),
    (b"\x1f\x8b", "a gzip archive"),
)
_TABLE_MARKS: Final = (";", "\t", ",")
_GCODE: Final = re.compile(r"\s*(?:N\d+\s*)?[GMT]\d", re.IGNORECASE)
_TOML: Final = re.compile(r"\s*(?:(?:[A-Za-z0-9_.\-]+|\"[^\"]*\"|'[^']*')\s*=|\[\[?[^\[\]]+\]\]?\s*\Z)")


def of_bytes(data: bytes) -> str | None:
    """Return the kind of a binary file by its first bytes, or None where nothing is known about them."""
    return next((name for head, name in _BY_FIRST_BYTES if data.startswith(head)), None)


def of_text(text: str) -> str | None:
    """Return the kind of a text: table of data, G-code, JSON, XML; None where it looks like TOML with a mistake."""
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")][:5]
    if not lines:
        return None
    marked = {"<": "an XML file", "{": "a JSON file"}.get(lines[0].lstrip()[0])
    if marked is not None:
        return marked
    if any(map(_TOML.match, lines)):
        return None
    if any(map(_GCODE.match, lines)):
        return "a G-code program"
    separated = any(all(mark in line for line in lines) for mark in _TABLE_MARKS)
    return "a table of data (CSV)" if separated and len(lines) > 1 else None
