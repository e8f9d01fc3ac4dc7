"""Commands dcc: what they print, and bad input in one line."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples" / "certificates"


@pytest.fixture(autouse=True)
def certificate(folder: Path) -> None:
    shutil.copy(EXAMPLES / "force_sensor.xml", folder / "sensor.xml")


def test_show(counterflex: Any) -> None:
    ended = counterflex("dcc", "show", "sensor.xml")
    assert ended.status == 0
    assert "EX-2026-0412" in ended.out
    assert "Not signed" in ended.out
    answer = json.loads(counterflex("dcc", "show", "sensor.xml", "--json").out)
    assert answer["quantities"][9]["coverage_factors"] == [2.0]
    assert answer["quantities"][10]["not_read"] == "text, no number"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--set", "sensor.rangen", "--cell", "cell.toml"], "not a key that a certificate fills"),
        (["--set", "sensor.range_n=", "--cell", "cell.toml"], "which quantity is not said"),
        (["--set", "sensor.range_n", "--set", "sensor.range_n=1", "--cell", "cell.toml"], "given twice"),
        (["--set", "sensor.range_n"], "one file takes the values"),
        (["--set", "sensor.range_n", "--cell", "cell.toml", "--channel", "mV"], "the unit is not understood"),
        (["--set", "sensor.range_n", "--cell", "cell.toml"], "there is no table [sensor]"),
        (["--set", "end_effector.nose.mass_kg=1", "--cell", "cell.toml"], "the unit is"),
    ],
)
def test_bad_input_is_one_line(counterflex: Any, folder: Path, words: list[str], says: str) -> None:
    ended = counterflex("dcc", "apply", "sensor.xml", *words, "--out", "new.toml")
    assert ended.status == 2
    assert says in ended.err
    assert ended.err.count("\n") == 1
    assert not (folder / "new.toml").exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--country", "Germany"], "no country"),
        (["--country", "DE", "--measured", "14.3.2026"], "not the days of a measurement"),
        (["--country", "DE", "--measured", "2026-03-14,2026-03-13"], "not the days of a measurement"),
        (["--country", "DE"], "not readable as JSON"),
    ],
)
def test_bad_input_of_a_document_is_one_line(counterflex: Any, words: list[str], says: str) -> None:
    about = ("--laboratory", "A", "--person", "B", "--city", "Ulm", "--serial", "7")
    ended = counterflex("dcc", "write", "sensor.xml", *about, *words, "--out", "found.xml")
    assert ended.status == 2
    assert says in ended.err
    assert ended.err.count("\n") == 1
