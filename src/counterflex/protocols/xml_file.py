"""XML files of a robot controller, read without trust: no entities, one clear fault."""

from __future__ import annotations

from typing import Final
from xml.etree.ElementTree import Element, ParseError

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import fromstring

from counterflex.core.errors import FileFormatError
from counterflex.core.file_content import readable

_HINT: Final = "Give the XML file as the maker's software writes it"


def xml_root(text: bytes, where: str) -> Element:
    """Root element of an XML text. Raises FileFormatError: not XML, or with entities."""
    with readable(where, "XML"):
        try:
            root: Element = fromstring(text)
        except (ParseError, DefusedXmlException, ValueError, LookupError) as fault:
            raise FileFormatError(f"not an XML file: {fault}", where=where, hint=_HINT) from fault
    return root
