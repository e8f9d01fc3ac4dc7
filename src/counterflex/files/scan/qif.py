"""QIF results (ISO 23952): the measured points in them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from counterflex.core import file_content
from counterflex.core.errors import FileFormatError
from counterflex.files.scan.scan import PointStore, Scan


def read_qif(path: Path) -> Scan:
    """Read the measured point sets of a QIF document, or where there are none its measured point features.

    Sets that are not compensated hold the centres of the probe's ball; its radius then comes with the scan.

    Raises:
        FileFormatError: No XML, no QIF, no measured points, a wrong number of coordinates, balls of different radius,
            or points of both kinds.
    """
    from defusedxml.common import DefusedXmlException
    from defusedxml.ElementTree import parse

    with file_content.readable(path, "XML", "Export the results as QIF again"):
        try:
            root = parse(path).getroot()
        except DefusedXmlException as fault:
            raise FileFormatError("the XML holds what is not read here", where=str(path), value=str(fault)) from fault
    if root is None or _name(root) != "QIFDocument":
        raise FileFormatError(
            "the XML file is no QIF document", where=str(path), value=None if root is None else _name(root)
        )
    unit = _unit(root, str(path))
    parts, balls = [], []
    for element in root.iter():
        if _name(element) == "MeasuredPointSet":
            parts.append(_points(_child(element, "Points"), element.get("count"), f"{path}: {element.get('id')}"))
            centres = _text(_child(element, "Compensated")).strip() in ("false", "0")
            balls.append(float(_text(_child(element, "ProbeRadius")) or 0.0) if centres else 0.0)
    if not parts:
        for element in root.iter():
            if _name(element) == "PointFeatureMeasurement":
                parts.append(_points(_child(element, "Location"), "1", f"{path}: {element.get('id')}"))
                balls.append(0.0)
    if not parts:
        raise FileFormatError(
            "the QIF document holds no measured points",
            where=str(path),
            limit="MeasuredPointSet or PointFeatureMeasurement",
            hint="Give the results, not the plan",
        )
    if max(balls) - min(balls) > 1e-9:
        raise FileFormatError(
            "points of probes with different balls are mixed",
            where=str(path),
            value=f"radius {min(balls):g} to {max(balls):g}",
            limit="one radius, or compensated points",
        )
    store = PointStore(path, f"QIF results, {len(parts)} sets of points")
    return store.extend(parts).scan(unit, balls[0])


def _name(element: Any) -> str:
    """Name of an element without its namespace; empty for comments."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def _child(element: Any, name: str) -> Any:
    return next((child for child in element if _name(child) == name), None)


def _text(element: Any) -> str:
    """All text of an element, comments inside it left out."""
    if element is None:
        return ""
    return (element.text or "") + "".join(child.tail or "" for child in element)


def _points(element: Any, count: str | None, where: str) -> Any:
    words = _text(element).split()
    try:
        values = np.array([float(word) for word in words])
    except ValueError as fault:
        raise FileFormatError("a coordinate is no number", where=where, value=str(fault)[:60]) from fault
    if len(values) == 0 or len(values) % 3 or (count is not None and 3 * int(count) != len(values)):
        raise FileFormatError(
            "wrong number of coordinates", where=where, value=len(values), limit=f"3 for each of {count} points"
        )
    return values.reshape(-1, 3)


def _unit(root: Any, where: str) -> float | None:
    """SI value of the unit of lengths, or None where the document states none."""
    for element in root.iter():
        if _name(element) == "LinearUnit":
            factor = next((one for one in element.iter() if _name(one) == "Factor"), None)
            if factor is None:
                return 1.0 if _text(_child(element, "UnitName")) in ("m", "meter", "metre") else None
            try:
                return float(_text(factor))
            except ValueError as fault:
                raise FileFormatError("the factor of the unit is no number", where=where) from fault
    return None
