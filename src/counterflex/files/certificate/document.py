"""A calibration certificate as read: who calibrated what and when, and its quantities."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from counterflex.core import file_content
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.certificate.quantities import DCC, Quantity, child, content, local, read_quantities, text_of
from counterflex.protocols.xml_file import xml_root


def require_library() -> None:
    """Refuse to go on without the library. Raises InputError: the extra ``dcc`` is not installed."""
    if importlib.util.find_spec("xmlschema") is None:
        raise InputError(
            "the library xmlschema is not installed", where="--schema", hint='pip install "counterflex[dcc]"'
        )


def require_valid(file: Path, schema: Path) -> None:
    """Check a certificate against a schema, whose imports are looked for beside it and nowhere else.

    Args:
        schema: ``dcc.xsd``; the schemas that it imports lie in the same folder.

    Raises:
        InputError: The certificate is not valid; names the first element that is not.
    """
    require_library()
    import xmlschema

    try:
        checked: Any = xmlschema.XMLSchema(
            str(schema), allow="local", defuse="always", locations=_schemas_beside(schema), use_fallback=False
        )
    except (xmlschema.XMLSchemaException, OSError, ValueError) as fault:
        raise FileFormatError("the schema cannot be read", where=str(schema), value=_line(fault)) from fault
    try:
        first = next(checked.iter_errors(str(file), use_location_hints=False), None)
    except (xmlschema.XMLSchemaException, OSError, ValueError) as fault:
        raise FileFormatError("cannot be checked", where=str(file), value=_line(fault)) from fault
    if first is not None:
        raise InputError(
            "not valid by the schema", where=f"{file.name}: {first.path}", value=_line(first.reason), limit=schema.name
        )


def _schemas_beside(schema: Path) -> list[tuple[str, str]]:
    """Schemas in the folder of a schema, by the namespace that they define."""
    from counterflex.protocols.xml_file import xml_root

    schemas = []
    for other in sorted(schema.parent.glob("*.xsd")):
        if other.resolve() != schema.resolve():
            space = xml_root(file_content.content(other), str(other)).get("targetNamespace", "")
            if space:
                schemas.append((space, str(other)))
    return schemas


def _line(fault: object) -> str:
    return " ".join(str(fault).split())[:160]


ROOT: Final = "digitalCalibrationCertificate"
VERSIONS: Final = ("3",)
_MOST_BYTES: Final = 64 * 2**20


@dataclass(frozen=True)
class MeasuredItem:
    """Item that was calibrated."""

    name: str
    identifications: tuple[str, ...]

    @classmethod
    def of(cls, element: Any) -> MeasuredItem:
        """Read an item of the certificate."""
        maker = content(child(child(element, "manufacturer"), "name"))
        parts = (maker, content(child(element, "name")), text_of(child(element, "model")))
        listed = child(element, "identifications")
        values = (
            [text_of(child(one, "value")) for one in listed if local(one) == "identification"]
            if listed is not None
            else []
        )
        return cls(" ".join(part for part in parts if part), tuple(value for value in values if value))


@dataclass(frozen=True)
class Certificate:
    """A digital calibration certificate."""

    file: str
    number: str
    version: str
    laboratory: str
    date: str  # Last day of the calibration, ``2026-03-14``
    items: tuple[MeasuredItem, ...]
    signed: bool  # A signature is there; it is not checked
    quantities: tuple[Quantity, ...]  # In their order

    @property
    def source(self) -> str:
        """The certificate in a few words, for the files into which its values go."""
        text = f"calibration certificate {self.number} of {self.laboratory}, {self.date}"
        return "".join(c for c in text if c.isprintable())


def read_certificate(path: Path) -> Certificate:
    """Read a digital calibration certificate, schema 3.x of PTB.

    Raises:
        FileFormatError: No XML, no certificate, another version, or a quantity that contradicts itself.
    """
    where, data = str(path), file_content.content(path)
    if len(data) > _MOST_BYTES:
        raise FileFormatError("the file is too large", where=where, value=f"{len(data)} bytes", limit=_MOST_BYTES)
    if data[:5] == b"%PDF-":
        raise FileFormatError(
            "this is a PDF", where=where, limit="the XML of the certificate",
            hint="Many PDF certificates carry it as an attachment: save that, or ask the laboratory for the DCC",
        )  # fmt: skip
    root = xml_root(data, where)
    if root.tag != f"{{{DCC}}}{ROOT}":
        raise FileFormatError(
            "the XML file is no digital calibration certificate",
            where=where,
            value=local(root)[:60],
            limit=f"dcc:{ROOT}",
        )
    version = root.get("schemaVersion", "")
    if version.partition(".")[0] not in VERSIONS:
        raise FileFormatError("another version of the schema", where=where, value=version or "none", limit="3.x")
    data_of, results = child(root, "administrativeData"), child(root, "measurementResults")
    if data_of is None or results is None:
        raise FileFormatError("a certificate without administrativeData or measurementResults", where=where)
    core = child(data_of, "coreData")
    laboratory = child(child(data_of, "calibrationLaboratory"), "contact")
    items = child(data_of, "items")
    return Certificate(
        file=path.name,
        number=text_of(child(core, "uniqueIdentifier")) or "without number",
        version=version,
        laboratory=content(child(laboratory, "name")) or "unnamed laboratory",
        date=text_of(child(core, "endPerformanceDate")) or "without date",
        items=tuple(MeasuredItem.of(one) for one in (items if items is not None else ()) if local(one) == "item"),
        signed=any(local(one) == "Signature" for one in root),
        quantities=read_quantities(results, where),
    )
