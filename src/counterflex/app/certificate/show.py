"""What a calibration certificate holds, as plain values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from counterflex.core.errors import FileFormatError
from counterflex.files.certificate.document import read_certificate
from counterflex.files.certificate.dsi_unit import parse_unit
from counterflex.files.certificate.quantities import Quantity


def described(file: Path) -> dict[str, Any]:
    """Laboratory, date, items and quantities of a certificate."""
    certificate = read_certificate(file)
    return {
        "number": certificate.number,
        "laboratory": certificate.laboratory,
        "date": certificate.date,
        "schema": certificate.version,
        "signed": certificate.signed,
        "items": [{"name": item.name, "identifications": list(item.identifications)} for item in certificate.items],
        "quantities": [_row(quantity, certificate.file) for quantity in certificate.quantities],
    }


def _row(quantity: Quantity, where: str) -> dict[str, Any]:
    unread = quantity.unread
    try:
        for text in quantity.units:
            parse_unit(text, f"{where}: quantity {quantity.number}")
    except FileFormatError as fault:
        unread = unread or f"{fault.what}: {fault.value}"
    return {
        "number": quantity.number,
        "name": quantity.name,
        "id": quantity.ident,
        "kinds": list(quantity.ref_types),
        "values": list(quantity.values),
        "units": list(dict.fromkeys(quantity.units)),
        "standard_uncertainties": None if quantity.sigma is None else list(quantity.sigma),
        "coverage_factors": sorted(set(quantity.coverage)),
        "not_read": unread,
    }
