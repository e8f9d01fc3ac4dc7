"""Calibration certificates as plain values, and the result of an identification in their form."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from counterflex.core import atomic, file_content
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.result import Parts, ShownTable, Summary, fill
from counterflex.core.units import plain
from counterflex.files.certificate.document import read_certificate
from counterflex.files.certificate.dsi_unit import parse_unit
from counterflex.files.certificate.quantities import Quantity
from counterflex.files.certificate.result_document import About, result_document
from counterflex.files.identification_file import read_identification


def write_document(
    result_file: Path,
    out: Path,
    *,
    laboratory: str,
    person: str,
    country: str,
    city: str,
    serial: str,
    dates: tuple[str, str] | None = None,
    schema: Path | None = None,
) -> dict[str, Any]:
    """Write the document, and read it back before it takes its place.

    Args:
        result_file: ``result.json`` of an identification.
        country: Two letters, ISO 3166-1.
        serial: Serial number of the robot, or another mark.
        dates: First and last day of the measurements; None takes the day of the identification.
        schema: ``dcc.xsd`` of PTB, against which the document is checked; None does not check.

    Raises:
        FileFormatError: The result cannot be read, or has a unit without D-SI form.
        InputError: The schema refuses the document.
    """
    result = read_identification(result_file)
    digest = hashlib.sha256(file_content.content(result_file)).hexdigest()
    day = str(result.get("date", ""))[:10]
    begin, end = dates or (day, day)
    number = f"counterflex-{result.get('recipe')}-{day}-{digest[:12]}"
    about = About(number, laboratory, person, country, city, begin, end, str(result.get("cell")), serial)
    data = result_document(result, about, str(result_file))
    with atomic.atomic_path(out) as place:
        place.write_bytes(data)
        back = read_certificate(place)
        if schema is not None:
            from counterflex.files.certificate.document import require_valid

            require_valid(place, schema)
    if any(quantity.unread for quantity in back.quantities):
        raise InputError("the document is not read back whole", where=str(out))
    return {"file": str(out), "number": number, "quantities": len(back.quantities), "checked": schema is not None}


class CertificateSummary(Summary):
    """Laboratory, date, items and quantities of a certificate."""

    def _shown(self) -> Parts:
        items = "; ".join(" ".join([one["name"], *one["identifications"]]) for one in self["items"])
        signed = "Signed; the signature was not checked." if self["signed"] else "Not signed."
        rows = []
        for one in self["quantities"]:
            row = one | {"mark": one["id"] or " ".join(one["kinds"]), "sigma": "none stated", "unit": "", "k": ""}
            if one["values"] or not one["not_read"]:
                if one["standard_uncertainties"] is not None:
                    row["sigma"] = _several(one["standard_uncertainties"])
                unit = ", ".join(one["units"]) + fill("{not_read: (%s)}", one)
                row |= {"value": _several(one["values"]), "unit": unit}
                row["k"] = ", ".join(f"{k:g}" for k in one["coverage_factors"])
            else:
                row |= {"value": one["not_read"], "sigma": ""}
            rows.append(row)
        yield ShownTable.of(
            self.line("{number}, {laboratory}, {date}: ") + items,
            "quantity=number | name | id or kind=mark | value | standard uncertainty=sigma | unit | k",
            rows,
            self.line("DCC {schema}. ") + signed,
        )


def _several(values: list[float]) -> str:
    text = " ".join(f"{value:.6g}" for value in values[:6])
    return text if len(values) <= 6 else f"{text} ... ({len(values)})"


def described(file: Path) -> CertificateSummary:
    """Laboratory, date, items and quantities of a certificate."""
    certificate = read_certificate(file)
    answer = {
        **plain(certificate, "number laboratory date schema=version signed"),
        "items": [{"name": item.name, "identifications": list(item.identifications)} for item in certificate.items],
        "quantities": [_row(quantity, certificate.file) for quantity in certificate.quantities],
    }
    return CertificateSummary(answer)


def _row(quantity: Quantity, where: str) -> dict[str, Any]:
    unread = quantity.unread
    try:
        for text in quantity.units:
            parse_unit(text, f"{where}: quantity {quantity.number}")
    except FileFormatError as fault:
        unread = unread or f"{fault.what}: {fault.value}"
    return {
        **plain(quantity, "number name id=ident kinds=ref_types values"),
        "units": list(dict.fromkeys(quantity.units)),
        "standard_uncertainties": None if quantity.sigma is None else list(quantity.sigma),
        "coverage_factors": sorted(set(quantity.coverage)),
        "not_read": unread,
    }
