"""The drawing as PDF: the same lines and words as the SVG, on a page of A4 in true size.

PDF 1.4 (ISO 32000-1), one page, one of the fonts that every reader has; only the elements that
:mod:`counterflex.app.benchmark_part.part` makes are known.
"""

from __future__ import annotations

import math
import re
from typing import Final
from xml.etree.ElementTree import Element

from defusedxml.ElementTree import fromstring

from counterflex.core.errors import InputError
from counterflex.core.units import INCH, MM

POINT_MM: Final = INCH / MM / 72.0
"""Unit of length of a PDF."""
_ROUND: Final = 0.5522847498
"""Handles of a Bezier curve for a quarter of a circle of radius 1."""
_STYLES: Final = {  # class: width, dashes, grey or colour, filled
    "": (0.5, "", "0.07 G", False),
    "thin": (0.25, "", "0.07 G", False),
    "hair": (0.15, "", "0.07 G", False),
    "axis": (0.2, "6 1.5 1 1.5", "0.07 G", False),
    "fill": (0.0, "", "0.07 g", True),
    "frame": (0.5, "", "0 0.4 0.8 RG", False),
}
_WIDE_LETTERS: Final = dict.fromkeys("tf,.:; I", 278) | dict.fromkeys("ilj", 222) | dict.fromkeys("r()-", 333)
_WIDE_LETTERS.update({"m": 833, "w": 722, "M": 833, "W": 944})
"""Widths of Helvetica in thousandths of its size; others are near 556."""
_STEP: Final = re.compile(r"([MLlmhvz])|(-?\d*\.?\d+)")


def pdf_of(svg: str) -> bytes:
    """The page.

    Args:
        svg: Of :func:`counterflex.app.benchmark_part.part.drawing`.

    Raises:
        InputError: An element that is not known here.
    """
    root: Element = fromstring(svg)
    _, _, wide, high = (float(word) for word in root.attrib["viewBox"].split())
    scale = 1.0 / POINT_MM
    content = [f"{scale:.6f} 0 0 {-scale:.6f} 0 {high * scale:.4f} cm", "1 J 1 j"]
    for element in root:
        content += _element(element, wide)
    stream = "\n".join(content).encode("cp1252")
    box = f"[0 0 {wide * scale:.4f} {high * scale:.4f}]"
    fonts = "<< /Font << /F 5 0 R >> >>"
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents 4 0 R /Resources {fonts} >>".encode(),
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(stream), stream),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
    ]
    return _file(objects)


def _file(objects: list[bytes]) -> bytes:
    """Objects one behind the other, and the table of where each begins."""
    out, places = b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n", []
    for number, body in enumerate(objects, start=1):
        places.append(len(out))
        out += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    size = len(objects) + 1
    return out + b"xref\n0 %d\n0000000000 65535 f \n%strailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (
        size, table, size, len(out)
    )  # fmt: skip


def _element(element: Element, page_wide: float) -> list[str]:
    name = element.tag.rpartition("}")[2]
    if name in ("title", "style") or (name == "rect" and float(element.attrib["width"]) == page_wide):
        return []
    if name == "g":
        return [
            "q",
            _turned(element.attrib["transform"]),
            *(line for one in element for line in _element(one, page_wide)),
            "Q",
        ]
    if name == "text":
        return _words(element)
    wide, dashes, colour, filled = _STYLES[element.get("class", "")]
    pen = f"{wide:g} w [{dashes}] 0 d {colour}"
    return ["q", pen, *_outline(name, element.attrib), "f" if filled else "S", "Q"]


def _outline(name: str, at: dict[str, str]) -> list[str]:
    if name == "line":
        return [f"{at['x1']} {at['y1']} m {at['x2']} {at['y2']} l"]
    if name == "rect":
        return [f"{at['x']} {at['y']} {at['width']} {at['height']} re"]
    if name == "circle":
        return _circle(float(at["cx"]), float(at["cy"]), float(at["r"]))
    if name == "path":
        return _path(at["d"])
    raise InputError("an element that the PDF does not know", value=name)


def _circle(x: float, y: float, r: float) -> list[str]:
    """Four Bezier curves, within 0.03 % of the radius."""
    out, k = [f"{x + r:.4f} {y:.4f} m"], _ROUND * r
    for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        points = ((r, k), (k, r), (0.0, r))
        out.append(" ".join(f"{x + c * a - s * b:.4f} {y + s * a + c * b:.4f}" for a, b in points) + " c")
    return out


def _path(steps: str) -> list[str]:
    """Moves and straight lines, absolute (M) and relative (l m h v), closed by z."""
    out: list[str] = []
    x = y = 0.0
    words = [match[0] for match in _STEP.finditer(steps)]
    while words:
        command = words.pop(0)
        if command == "z":
            out.append("h")
            continue
        if command == "h":
            x += float(words.pop(0))
        elif command == "v":
            y += float(words.pop(0))
        elif command in ("M", "m", "l"):
            a, b = float(words.pop(0)), float(words.pop(0))
            x, y = (a, b) if command == "M" else (x + a, y + b)
        else:
            raise InputError("a step of a path that the PDF does not know", value=command)
        out.append(f"{x:.4f} {y:.4f} {'m' if command in 'Mm' else 'l'}")
    return out


def _turned(transform: str) -> str:
    """Matrix of ``rotate(DEG X Y)``."""
    angle, x, y = (float(word) for word in re.findall(r"-?\d+(?:\.\d+)?", transform))
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    return f"{c:.6f} {s:.6f} {-s:.6f} {c:.6f} {x - c * x + s * y:.4f} {y - s * x - c * y:.4f} cm"


def _words(element: Element) -> list[str]:
    """A text, upright again although y points down."""
    text = (element.text or "").replace("\u2300", "\u00d8")  # no diameter sign in the font
    size, x = float(element.attrib["font-size"]), float(element.attrib["x"])
    if element.get("text-anchor") == "middle":
        x -= 0.5 * size * sum(_WIDE_LETTERS.get(letter, 556) for letter in text) / 1000.0
    escaped = re.sub(r"([\\()])", r"\\\1", text)
    return [f"BT /F {size:g} Tf 0.07 g 1 0 0 -1 {x:.3f} {element.attrib['y']} Tm ({escaped}) Tj ET"]
