"""A certificate against the XML schema that PTB publishes; needs the extra ``dcc``."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

from counterflex.core import file_content
from counterflex.core.errors import FileFormatError, InputError


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
