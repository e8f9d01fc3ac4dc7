"""The drawing as PDF: a file that is whole, in true size, with the words of the SVG."""

from __future__ import annotations

import re

import pytest

from counterflex.app.benchmark_part.drawing_pdf import pdf_of
from counterflex.app.benchmark_part.part import drawing
from counterflex.core.errors import InputError

POINT_MM = 25.4 / 72.0
PAGE = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 210 297">{}</svg>'


def content(svg: str) -> str:
    return pdf_of(svg).split(b"\nstream\n")[1].split(b"\nendstream")[0].decode("cp1252")


def test_the_file_is_whole() -> None:
    """Every entry of the table leads to its object, the trailer to the table, the length is that of the stream."""
    data = pdf_of(drawing())
    table = int(data.split(b"startxref\n")[1].split(b"\n")[0])
    assert data[table:].startswith(b"xref\n0 6\n0000000000 65535 f \n")
    places = [int(line[:10]) for line in data[table:].split(b"\n")[3:8]]
    assert [data[place:].split(b" obj")[0] for place in places] == [b"1 0", b"2 0", b"3 0", b"4 0", b"5 0"]
    assert int(data.split(b"/Length ")[1].split(b" ")[0]) == len(data.split(b"\nstream\n")[1].split(b"\nendstream")[0])
    box = [float(word) for word in data.split(b"/MediaBox [")[1].split(b"]")[0].split()]
    assert [side * POINT_MM for side in box] == pytest.approx([0.0, 0.0, 210.0, 297.0], abs=1e-3)  # A4


def test_every_word_and_line_of_the_drawing_is_there() -> None:
    svg, made = drawing(), content(drawing())
    words = [
        re.sub(r"([\\()])", r"\\\1", text.replace("&#8960;", "Ø")) for text in re.findall(r">([^<>\n]+)</text>", svg)
    ]
    assert re.findall(r"\(((?:\\.|[^\\)])*)\) Tj", made) == words
    assert len(re.findall(r"^[\d.]+ [\d.]+ m [\d.]+ [\d.]+ l$", made, re.MULTILINE)) == svg.count("<line")
    assert made.count(" c\n") == 4 * svg.count("<circle")


def test_a_path_and_a_circle_where_they_belong() -> None:
    path = content(PAGE.format('<path d="M10 20 l2.5 -0.8 v1.6 z M3 4 h5" class="fill"/>'))
    assert "10.0000 20.0000 m\n12.5000 19.2000 l\n12.5000 20.8000 l\nh\n3.0000 4.0000 m\n8.0000 4.0000 l\nf" in path
    circle = content(PAGE.format('<circle cx="10" cy="20" r="5"/>'))
    ends = [tuple(map(float, line.split()[-3:-1])) for line in circle.split("\n") if line.endswith(" c")]
    assert ends == [(10.0, 25.0), (5.0, 20.0), (10.0, 15.0), (15.0, 20.0)]


def test_an_unknown_element_is_refused() -> None:
    with pytest.raises(InputError, match="ellipse"):
        pdf_of(PAGE.format("<ellipse/>"))
    with pytest.raises(InputError, match="step of a path"):
        pdf_of(PAGE.format('<path d="m1 2 3 4"/>'))
