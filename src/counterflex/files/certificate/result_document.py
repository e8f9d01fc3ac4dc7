"""Results of an identification in the form of a digital calibration certificate (DCC 3.3, D-SI 2.2 of PTB).

The form is that of a certificate, the content is not: a calibration certificate comes from a laboratory whose
competence somebody has assessed. The document says so in a statement of its own.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final
from xml.etree.ElementTree import Element, SubElement, indent, register_namespace, tostring

from counterflex.core.errors import FileFormatError
from counterflex.files.certificate.dsi_unit import dsi_of
from counterflex.files.certificate.quantities import DCC, SI

SCHEMA: Final = "3.3.0"
COVERAGE: Final = 0.95
DECLARATION: Final = (
    "This document has the form of a digital calibration certificate and is none: it states results of an "
    "identification from measured data, with intervals from the stated standard deviations of these data. No "
    "accredited laboratory stands behind it, and traceability is that of the instruments that measured."
)
_FORBIDDEN: Final = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 does not allow."""


@dataclass(frozen=True)
class About:
    """Who states the results, of what."""

    number: str
    laboratory: str
    person: str
    country: str  # Two letters, ISO 3166-1
    city: str
    begin: str  # First day of the measurements, ``2026-03-14``
    end: str
    item: str
    serial: str  # Its serial number, or another mark that its owner knows it by


def result_document(result: Mapping[str, Any], about: About, where: str) -> bytes:
    """The document as XML.

    Args:
        result: Content of ``result.json``, see :mod:`counterflex.files.identification_file`.
        where: The file that it is from, for messages.

    Raises:
        FileFormatError: A part is missing, or a unit has no D-SI form.
    """
    register_namespace("dcc", DCC)
    register_namespace("si", SI)
    root = Element(_dcc("digitalCalibrationCertificate"), {"schemaVersion": SCHEMA})
    try:
        _administrative(SubElement(root, _dcc("administrativeData")), result, about)
        _results(SubElement(root, _dcc("measurementResults")), result, where)
    except (KeyError, TypeError, AttributeError) as fault:
        raise FileFormatError("not a whole result of an identification", where=where, value=repr(fault)[:60]) from fault
    indent(root)
    text: bytes = tostring(root, encoding="utf-8", xml_declaration=True)
    return text + b"\n"


def _dcc(name: str) -> str:
    return f"{{{DCC}}}{name}"


def _si(name: str) -> str:
    return f"{{{SI}}}{name}"


def _add(parent: Element, name: str, text: str = "") -> Element:
    made = SubElement(parent, _dcc(name))
    if text:
        made.text = _FORBIDDEN.sub("?", text)
    return made


def _english(parent: Element, name: str, text: str) -> Element:
    """An element with a text in English."""
    made = _add(parent, name)
    _add(made, "content", text).set("lang", "en")
    return made


def _administrative(parent: Element, result: Mapping[str, Any], about: About) -> None:
    software = _add(_add(parent, "dccSoftware"), "software")
    _english(software, "name", "counterflex")
    _add(software, "release", str(result["versions"]["counterflex"]))
    core = _add(parent, "coreData")
    _add(core, "countryCodeISO3166_1", about.country)
    _add(core, "usedLangCodeISO639_1", "en")
    _add(core, "mandatoryLangCodeISO639_1", "en")
    _add(core, "uniqueIdentifier", about.number)
    _add(core, "beginPerformanceDate", about.begin)
    _add(core, "endPerformanceDate", about.end)
    _add(core, "performanceLocation", "laboratory")
    item = _add(_add(parent, "items"), "item")
    _english(item, "name", about.item)
    identification = _add(_add(item, "identifications"), "identification")
    _add(identification, "issuer", "owner")
    _add(identification, "value", about.serial)
    contact = _add(_add(parent, "calibrationLaboratory"), "contact")
    _english(contact, "name", about.laboratory)
    _place(contact, about)
    person = _add(_add(parent, "respPersons"), "respPerson")
    _english(_add(person, "person"), "name", about.person)
    _add(person, "mainSigner", "true")
    customer = _add(parent, "customer")
    _english(customer, "name", about.laboratory)
    _place(customer, about)
    statement = _add(_add(parent, "statements"), "statement")
    _english(statement, "name", "No calibration certificate")
    _english(statement, "declaration", DECLARATION)


def _place(parent: Element, about: About) -> None:
    place = _add(parent, "location")
    _add(place, "city", about.city)
    _add(place, "countryCode", about.country)


def _results(parent: Element, result: Mapping[str, Any], where: str) -> None:
    measurement = _add(parent, "measurementResult")
    _english(measurement, "name", str(result["title"]))
    method = _add(_add(measurement, "usedMethods"), "usedMethod")
    _english(method, "name", f"counterflex identify {result['recipe']}")
    named = "; ".join(f"{one['name']}, SHA-256 {one['sha256']}" for one in result["data"])
    _english(method, "description", f"Cell {result['cell']}, identified {result['date']} from the data {named}")
    results = _add(measurement, "results")
    count = 0
    for name, fit in result["fits"].items():
        identified = [row for row in fit["parameters"] if row["low"] is not None and row["high"] is not None]
        held = [row for row in fit["parameters"] if row["low"] is None or row["high"] is None]
        for text, rows in (
            (f"{name}: identified, 95 % intervals", identified),
            (f"{name}: held at the prior value", held),
        ):
            if rows:
                count = _result(results, text, rows, count, where)
    if not count:
        raise FileFormatError("the result has no parameters", where=where)


def _result(parent: Element, text: str, rows: Sequence[Mapping[str, Any]], count: int, where: str) -> int:
    result = _add(parent, "result")
    _english(result, "name", text)
    data = _add(result, "data")
    for row in rows:
        count += 1
        quantity = _add(data, "quantity")
        quantity.set("id", f"q{count}")
        label = "" if row["label"] == row["name"] else f" ({row['label']})"
        _english(quantity, "name", f"{row['name']}{label}")
        real = SubElement(quantity, _si("real"))
        place = f"{where}: {row['name']}"
        _number(real, "value", row["value"], place)
        SubElement(real, _si("unit")).text = dsi_of(str(row["unit"]), place)
        if row["low"] is None or row["high"] is None:
            continue
        form = SubElement(SubElement(real, _si("measurementUncertaintyUnivariate")), _si("coverageIntervalMU"))
        _number(form, "valueStandardMU", row["sigma"], place)
        _number(form, "intervalMin", row["low"], place)
        _number(form, "intervalMax", row["high"], place)
        _number(form, "coverageProbability", COVERAGE, place)
    return count


def _number(parent: Element, name: str, value: Any, where: str) -> None:
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise FileFormatError(f"{name} of a parameter is no number", where=where, value=value)
    SubElement(parent, _si(name)).text = repr(float(value))
