"""Still pictures: well-formed, marks where the values are, nothing outside the frame."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from counterflex.core.errors import InputError
from counterflex_lab.reproduce.papers.still import HEIGHT, WIDTH, Curve, Level, Still, svg

NAME = "{http://www.w3.org/2000/svg}"


def _picture(**changes: object) -> Still:
    x = np.linspace(0.0, 10.0, 11)
    given: dict[str, object] = {
        "name": "a",
        "title": "A & B",
        "caption": "c",
        "x": "time, s",
        "y": "error, um",
        "curves": (Curve("line", x, x**2), Curve("marks", x, 100.0 - x, "points")),
        "levels": (Level("printed", 25.0), Level("band", 40.0, 60.0)),
    }
    return Still(**(given | changes))  # type: ignore[arg-type]


def _marks(text: str) -> list[tuple[float, float]]:
    (group,) = ET.fromstring(text).iter(f"{NAME}g")
    return [(float(c.attrib["cx"]), float(c.attrib["cy"])) for c in group]


def test_it_is_well_formed_and_the_same_every_time() -> None:
    text = svg(_picture())
    assert text == svg(_picture())
    root = ET.fromstring(text)
    assert root.find(f"{NAME}title") is not None
    assert {t.text for t in root.iter(f"{NAME}text")} >= {"time, s", "error, um", "line", "marks", "printed", "band"}


def test_marks_lie_on_a_linear_scale_upward() -> None:
    marks = np.array(_marks(svg(_picture())))
    x = np.linspace(0.0, 10.0, 11)
    for measured, value in ((marks[:, 0], x), (marks[:, 1], 100.0 - x)):
        fit = np.polyfit(value, measured, 1)
        np.testing.assert_allclose(np.polyval(fit, value), measured, atol=0.06)
    assert np.all(np.diff(marks[:, 0]) > 0)
    assert np.all(np.diff(marks[:, 1]) > 0)  # values fall, pixels count downward


def test_marks_lie_on_a_logarithmic_scale() -> None:
    y = np.array([1.0, 10.0, 100.0, 1000.0])
    text = svg(_picture(curves=(Curve("m", np.arange(4.0), y, "points"),), levels=(), log=True))
    down = np.array(_marks(text))[:, 1]
    np.testing.assert_allclose(np.diff(down), np.diff(down)[0], atol=0.11)


def test_equal_scales_show_a_circle_round() -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 25)
    circle = Curve("c", np.cos(turn), np.sin(turn), "points")
    marks = np.array(_marks(svg(_picture(curves=(circle,), levels=(), equal=True))))
    assert np.ptp(marks[:, 0]) == pytest.approx(np.ptp(marks[:, 1]), abs=0.3)


def test_nothing_is_drawn_outside() -> None:
    still = _picture(levels=(Level("band", -1e6, 1e6),), curves=(Curve("l", np.arange(3.0), np.arange(3.0)),))
    for rect in ET.fromstring(svg(still)).iter(f"{NAME}rect"):
        top, height = float(rect.attrib.get("y", 0.0)), float(rect.attrib["height"])
        assert top >= 0.0
        assert top + height <= HEIGHT[still.shape]


def test_gaps_interrupt_a_line_and_long_legends_break() -> None:
    y = np.array([1.0, 2.0, np.nan, 4.0, 5.0])
    text = svg(_picture(curves=(Curve("gap", np.arange(5.0), y),), levels=()))
    (line,) = re.findall(r'<path d="([^"]+)" fill="none"', text)
    assert line.count("M") == 2
    names = [Curve(f"a long name of a curve {k}", np.arange(2.0), np.arange(2.0)) for k in range(8)]
    places = [
        (float(t.attrib["x"]), float(t.attrib["y"]))
        for t in ET.fromstring(svg(_picture(curves=names, levels=()))).iter(f"{NAME}text")
        if t.text is not None and t.text.startswith("a long")
    ]
    assert len({y for _, y in places}) > 1
    assert all(x < WIDTH - 100.0 for x, _ in places)


def test_nothing_to_draw_is_refused() -> None:
    with pytest.raises(InputError, match="nothing"):
        svg(_picture(curves=(Curve("nan", np.arange(2.0), np.full(2, np.nan)),), levels=()))
