"""What the main flows suggest is run as it is printed, from the folder where the user stands: nothing else is typed."""

from __future__ import annotations

import html
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from command_parser import commands_in
from counterflex.app.proof import prove
from counterflex.core.errors import InputError


@pytest.fixture
def below(folder: Path) -> Path:
    """The cell and its program in a folder of their own, with a blank in its name, while another cell lies here."""
    place = folder / "my cell"
    place.mkdir()
    for name in ("cell.toml", "part.ngc"):
        (folder / name).rename(place / name)
    (folder / "cell.toml").write_text("format = 'counterflex-cell'\n", encoding="utf-8")  # not to be taken
    return place


def _run(counterflex: Any, line: str, **placeholders: object) -> str:
    words = [str(placeholders.get(word, word)) for word in shlex.split(line)]
    assert words[0] == "counterflex"
    ended = counterflex(*words[1:])
    assert ended.status == 0, f"{line}\n{ended.err}"
    return str(ended.out)


def _suggested(text: str, command: str) -> str:
    found = [line for line in commands_in(text) if line.startswith(f"counterflex {command} ")]
    assert found, text
    return found[0]


def test_from_the_check_of_a_cell_to_what_is_measured_first(folder: Path, below: Path, counterflex: Any) -> None:
    said = _run(counterflex, "counterflex cell check 'my cell/cell.toml'")
    line = _suggested(said, "identify")
    assert "'my cell/cell.toml'" in line
    _run(counterflex, line)
    said = _run(counterflex, "counterflex identify payload --propose 12 --cell 'my cell/cell.toml' --out 'pro posal'")
    assert "'pro posal/payload.toml'" in _suggested(said, "identify")
    _run(counterflex, "counterflex truth 'my cell/cell.toml' --seed 1 --out truth.toml")
    measure = _suggested(said, "twin measure")
    said = _run(counterflex, measure, TRUTH="truth.toml", DATA="data")
    assert "'my cell/cell.toml'" in _suggested(said, "identify")


def test_from_a_plan_on_the_class_of_the_robot_to_its_proof(
    folder: Path, below: Path, counterflex: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (below / "cell.toml").read_text(encoding="utf-8")
    other = text.replace("kuka_kr300_r2500_ultra", "kuka_kr270_r2700_ultra")
    (below / "cell.toml").write_text(other, encoding="utf-8")
    given = "'my cell/part.ngc' --cell 'my cell/cell.toml'"
    refusal = counterflex("compensate", "my cell/part.ngc", "--cell", "my cell/cell.toml", "--out", "out")
    assert "--assume-class" in refusal.err
    assert "'my cell/cell.toml'" in _suggested(refusal.err, "identify stiffness")
    _run(counterflex, f"counterflex compensate {given} --out out --assume-class")
    page = html.unescape(re.sub(r"<[^>]+>", " ", (folder / "out" / "report.html").read_text(encoding="utf-8")))
    steps = re.findall(r"counterflex prove [^\n]*", page)
    assert steps
    line = _suggested(steps[0], "prove")
    assert "--assume-class" in line
    called: dict[str, Any] = {}

    def proof(program: Path, cell: Path, out: Path, **named: Any) -> None:
        called.update(program=program, cell=cell, out=out, **named)
        raise InputError("stopped here")

    monkeypatch.setattr(prove, "run", proof)  # it takes a minute; README's first steps run it
    assert "stopped here" in counterflex(*shlex.split(line)[1:]).err
    assert called["assume_class"] is True
    assert [called[name].is_file() for name in ("program", "cell")] == [True, True]
