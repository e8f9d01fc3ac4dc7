"""XML files of a robot controller, read without trust: no entities, one clear fault."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import fromstring

from counterflex.core.errors import FileFormatError
from counterflex.core.similar import missing_file


def file_bytes(path: str | Path) -> bytes:
    """Content of a file.

    Raises:
        FileFormatError: It is missing or cannot be read.
    """
    file = Path(path)
    try:
        return file.read_bytes()
    except FileNotFoundError as fault:
        raise FileFormatError("no such file", where=str(file), hint=missing_file(file)) from fault
    except OSError as fault:
        raise FileFormatError(f"cannot be read: {fault.strerror or fault}", where=str(file)) from fault


def xml_root(text: bytes, where: str) -> Element:
    """Root element of an XML text.

    Raises:
        FileFormatError: Not XML, or with entities.
    """
    try:
        root: Element = fromstring(text)
    except (ParseError, DefusedXmlException, ValueError, LookupError) as fault:
        raise FileFormatError(f"not an XML file: {fault}", where=where) from fault
    return root
