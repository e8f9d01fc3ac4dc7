"""The benchmark part: its program, what is measured on it, and its tolerances."""

from __future__ import annotations

import csv
import hashlib
import io
import math
import re
from importlib import resources
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element

from defusedxml.ElementTree import fromstring

from counterflex.core import atomic
from counterflex.core.errors import InputError
from counterflex.core.units import INCH, MM
from counterflex.files.benchmark_result import MEASURED, NAME
from counterflex.files.cell.cell import Cell

# The drawing as PDF: the same lines and words as the SVG, on a page of A4 in true size.
# PDF 1.4 (ISO 32000-1), one page, one of the fonts that every reader has; only the elements that
# :mod:`counterflex.app.benchmark_part.part` makes are known.

POINT_MM: Final = INCH / MM / 72.0
"""Unit of length of a PDF."""
_ROUND: Final = 0.5522847498  # Handles of a Bezier curve for a quarter of a circle of radius 1
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
    """The page. Raises InputError: an element that is not known here."""
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


_WIDE, _HIGH = 210.0, 297.0
_SCALE: Final = 1.6
_LEFT, _TOP = 45.0, 45.0
_SIDE: Final = 60.0


def _x(mm: float) -> float:
    return _LEFT + _SCALE * mm


def _y(mm: float) -> float:
    """Down the page: y of the part points up."""
    return _TOP + _SCALE * (_SIDE - mm)


def _text(x: float, y: float, words: str, size: float = 3.5, anchor: str = "middle") -> str:
    return f'<text x="{x:.2f}" y="{y:.2f}" font-size="{size}" text-anchor="{anchor}">{words}</text>'


def _line(x1: float, y1: float, x2: float, y2: float, kind: str = "") -> str:
    return f'<line x1="{x1:.2f}" y1="{y1:.2f}" x2="{x2:.2f}" y2="{y2:.2f}"{f" class={kind!r}" if kind else ""}/>'


def _across(a_mm: float, b_mm: float, y: float, words: str) -> list[str]:
    """A dimension along x, y being its place on the page."""
    a, b = _x(a_mm), _x(b_mm)
    arrows = f'<path d="M{a:.2f} {y:.2f} l2.5 -0.8 v1.6 z M{b:.2f} {y:.2f} l-2.5 -0.8 v1.6 z" class="fill"/>'
    return [_line(a, y, b, y, "thin"), arrows, _text(0.5 * (a + b), y - 1.2, words)]


def _upright(a_mm: float, b_mm: float, x: float, words: str) -> list[str]:
    """A dimension along y, x being its place on the page."""
    a, b = _y(a_mm), _y(b_mm)
    arrows = f'<path d="M{x:.2f} {a:.2f} l-0.8 -2.5 h1.6 z M{x:.2f} {b:.2f} l-0.8 2.5 h1.6 z" class="fill"/>'
    middle = 0.5 * (a + b)
    turned = f'<g transform="rotate(-90 {x - 1.2:.2f} {middle:.2f})">{_text(x - 1.2, middle, words)}</g>'
    return [_line(x, a, x, b, "thin"), arrows, turned]


def _extension(x1: float, y1: float, x2: float, y2: float) -> str:
    return _line(x1, y1, x2, y2, "hair")


def _view() -> list[str]:
    out = [f'<rect x="{_x(0):.2f}" y="{_y(60):.2f}" width="{_SCALE * 60:.2f}" height="{_SCALE * 60:.2f}"/>']
    out += [_line(_x(0), _y(y), _x(60), _y(y)) for y in (3.0, 19.0)]
    out += [_line(_x(x), _y(0), _x(x), _y(60)) for x in (48.0, 58.0)]
    out += [f'<circle cx="{_x(30):.2f}" cy="{_y(38):.2f}" r="{_SCALE * 12:.2f}"/>']
    out += [_line(_x(-4), _y(11), _x(64), _y(11), "axis"), _line(_x(53), _y(-4), _x(53), _y(64), "axis")]
    out += [_line(_x(16), _y(38), _x(44), _y(38), "axis"), _line(_x(30), _y(24), _x(30), _y(52), "axis")]
    out += [
        _text(_x(24), _y(12), "groove 1, 4 deep"),
        _text(_x(30), _y(41), "pocket 1"),
        _text(_x(30), _y(33), "3 deep"),
    ]
    out += [f'<g transform="rotate(-90 {_x(51.5):.2f} {_y(40):.2f})">{_text(_x(51.5), _y(40), "groove 2, 3 deep")}</g>']
    below, right, left, above = _y(0), _x(60), _x(0), _y(60)
    out += [_extension(_x(x), below, _x(x), below + 24) for x in (0.0, 60.0)] + _across(0, 60, below + 22, "60")
    out += [_extension(_x(30), below, _x(30), below + 14), *_across(0, 30, below + 12, "30")]
    out += [_extension(_x(x), above, _x(x), above - 10) for x in (48.0, 58.0)]
    out += [*_across(48, 58, above - 8, "10 ±0.1")]
    out += [_extension(_x(0), above, _x(0), above - 18), _extension(_x(53), above - 10, _x(53), above - 18)]
    out += [*_across(0, 53, above - 16, "53")]
    out += [_extension(left, _y(y), left - 14, _y(y)) for y in (3.0, 19.0)] + _upright(3, 19, left - 12, "16 ±0.1")
    out += [_extension(right, _y(y), right + 26, _y(y)) for y in (0.0, 60.0)] + _upright(0, 60, right + 24, "60")
    out += [_extension(right, _y(11), right + 14, _y(11)), *_upright(0, 11, right + 12, "11")]
    out += [_extension(_x(42), _y(38), right + 14, _y(38)), *_upright(11, 38, right + 12, "27")]
    out += [_line(_x(21.5), _y(46.5), _x(13), _y(54.5), "thin"), _text(_x(12), _y(55.2), "&#8960;24 ±0.1")]
    out += [f'<path d="M{_x(0):.2f} {_y(0):.2f} h14 m-2.5 -0.8 l2.5 0.8 l-2.5 0.8" class="frame"/>']
    out += [f'<path d="M{_x(0):.2f} {_y(0):.2f} v-14 m-0.8 2.5 l0.8 -2.5 l0.8 2.5" class="frame"/>']
    out += [_text(_x(0) + 16, _y(0) - 1.5, "x"), _text(_x(0) + 2, _y(0) - 15, "y")]
    return out


def _table(top: float) -> list[str]:
    columns = (25.0, 60.0, 100.0, 130.0)
    out = [
        _text(x, top, words, 3.6, "start")
        for x, words in zip(columns, ("feature", "quantity", "nominal mm", "tolerance mm"), strict=True)
    ]
    out.append(_line(25.0, top + 1.5, 185.0, top + 1.5, "thin"))
    for number, row in enumerate(MEASURED, start=1):
        y = top + 1.0 + 5.0 * number
        zone = f"{row.tolerance_mm:g}" if row.nominal_mm == 0.0 else f"±{row.tolerance_mm:g}"
        words = (row.feature, row.quantity, f"{row.nominal_mm:g}", zone)
        out += [_text(x, y, word, 3.4, "start") for x, word in zip(columns, words, strict=True)]
    return out


_STYLE: Final = (
    "text{font-family:sans-serif;fill:#111}line,rect,circle,path{fill:none;stroke:#111;stroke-width:.5}"
    ".thin{stroke-width:.25}.hair{stroke-width:.15}.axis{stroke-width:.2;stroke-dasharray:6 1.5 1 1.5}"
    ".fill{fill:#111;stroke:none}.frame{stroke:#06c}"
)


def drawing() -> str:
    """SVG, A4, in mm."""
    notes = (
        "Blank 60 x 60 x 40 mm, faces flat and square within 0.02 mm. Zero: corner; underside z = 0, top face z = 40.",
        "Walls count from the centre line of their groove, left and right along the programmed motion. All in mm.",
        "Faces x-, x+, y-, y+ place the part, the top face its height; at least 10 points per mm², within 0.01 mm.",
        "Finished with T1 D16 (groove 1) and T2 D10 in one cut each. No deburring beyond the edges.",
    )
    body = [
        _text(25.0, 20.0, f"Benchmark part {NAME}, version 1", 6.0, "start"),
        *_view(),
        *_table(185.0),
        *(_text(25.0, 272.0 + 4.5 * k, note, 2.9, "start") for k, note in enumerate(notes)),
    ]
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_WIDE:g}mm" height="{_HIGH:g}mm" '
        f'viewBox="0 0 {_WIDE:g} {_HIGH:g}"><title>Benchmark part {NAME}</title><style>{_STYLE}</style>'
        f'<rect x="0" y="0" width="{_WIDE:g}" height="{_HIGH:g}" style="fill:#fff;stroke:none"/>'
    )
    return "\n".join([head, *body, "</svg>", ""])


PROGRAM: Final = "cf1.ngc"
DRAWING: Final = "cf1.svg"
PRINTED: Final = "cf1.pdf"
TOLERANCES: Final = "cf1-tolerances.csv"
BLANK_M: Final = (60.0 * MM, 60.0 * MM, 40.0 * MM)
DIAMETERS_M: Final = {1: 16.0 * MM, 2: 10.0 * MM}
_CLOSE_M: Final = 0.01 * MM


def program_text() -> str:
    """The program, G-code."""
    return (resources.files("counterflex.app.benchmark_part") / PROGRAM).read_text(encoding="utf-8")


def program_sha256(text: str | None = None) -> str:
    """SHA-256 of a program without comments, speeds, feeds and blank lines: of what it moves, and with what.

    Args:
        text: G-code; None: the program of the benchmark part.
    """
    kept = []
    for line in (program_text() if text is None else text).splitlines():
        words = line.partition("(")[0].upper().split()
        motion = [word for word in words if word[0] not in "FSN"]
        if motion:
            kept.append(" ".join(motion))
    return hashlib.sha256("\n".join(kept).encode()).hexdigest()


def tolerances_m() -> dict[tuple[str, str], float]:
    """Feature and quantity to permitted deviation, +- m (a one-sided zone where the nominal value is 0)."""
    return {(row.feature, row.quantity): row.tolerance_mm * MM for row in MEASURED}


def tolerances_text() -> str:
    """The tolerances as CSV, as ``inspect --tolerances`` reads them."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("feature", "quantity", "tolerance_mm"))
    writer.writerows((row.feature, row.quantity, f"{row.tolerance_mm:g}") for row in MEASURED)
    return text.getvalue()


def write(out: Path) -> list[str]:
    """Write program, drawing and tolerances into a folder, all or none.

    Raises:
        OutputError: The folder cannot be written.
    """
    sheet = drawing()
    files = {
        PROGRAM: program_text().encode(),
        DRAWING: sheet.encode(),
        PRINTED: pdf_of(sheet),
        TOLERANCES: tolerances_text().encode(),
    }
    with atomic.atomic_folder(out) as staging:
        for name, content in files.items():
            atomic.write_bytes(staging / name, content)
    return list(files)


def require_cell(cell: Cell) -> None:
    """Refuse a cell that has another blank or other tools than the benchmark part.

    Raises:
        InputError: What is different.
    """
    where = cell.path.name
    stock = cell.part.stock
    low, high = (None, None) if stock is None else (stock.box_min_mm, stock.box_max_mm)
    expected = (0.0, 0.0, 0.0, *(size / MM for size in BLANK_M))
    given = () if low is None or high is None else (*low, *high)
    if len(given) != len(expected) or any(abs(a - b) * MM > _CLOSE_M for a, b in zip(given, expected, strict=True)):
        raise InputError(
            f"the blank is not that of {NAME}", where=f"{where}: part.stock", value=f"{low}, {high}",
            limit="box_min_mm = [0, 0, 0], box_max_mm = [60, 60, 40]",
        )  # fmt: skip
    for number, diameter in DIAMETERS_M.items():
        mounted = cell.cutter(number).diameter_m
        if abs(mounted - diameter) > _CLOSE_M:
            raise InputError(
                f"tool T{number} is not that of {NAME}", where=f"{where}: tools",
                value=f"{mounted / MM:g} mm", limit=f"{diameter / MM:g} mm",
            )  # fmt: skip
