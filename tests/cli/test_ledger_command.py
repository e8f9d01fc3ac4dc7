"""predict and reveal at the prompt: what is printed is what the files hold, and what is missing is one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
PULLS = str(EXAMPLES / "data" / "fanuc_r2000ic_stiffness" / "last_14.toml")
CELL = str(EXAMPLES / "cells" / "fanuc_r2000ic.toml")


@pytest.fixture
def sealed(counterflex: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """A prediction ``kept/pulls.json``."""
    monkeypatch.chdir(tmp_path)
    ended = counterflex("predict", PULLS, "--cell", CELL, "--out", "kept/pulls.json")
    assert ended.status == 0, ended.err
    made: dict[str, Any] = json.loads(Path("kept/pulls.json").read_text(encoding="utf-8"))
    assert made["sha256"] in ended.out.replace("\n", "")
    return made


def test_the_printed_pair_and_ledger_are_those_of_the_files(counterflex: Any, sealed: dict[str, Any]) -> None:
    waiting = counterflex("reveal", "--ledger", "kept")
    assert "not revealed: pulls.json" in waiting.out
    shown = counterflex("reveal", "kept/pulls.json", PULLS, "--out", "kept/pair.json")
    assert shown.status == 0, shown.err
    pair = json.loads(Path("kept/pair.json").read_text(encoding="utf-8"))
    assert pair["prediction"] == sealed
    assert "not looked at: when it was measured" in shown.out
    for row in pair["figures"]:
        (line,) = [line for line in shown.out.splitlines() if row["figure"] in line]
        assert f"{row['came']:g}" in line
        assert line.split()[-1] == ("yes" if row["inside"] else "no")
    ledger = json.loads(counterflex("reveal", "--ledger", "kept", "--json").out)
    assert [row["came"] for row in ledger["rows"]] == [row["came"] for row in pair["figures"]]
    (group,) = ledger["credibility"]
    assert (group["inside"], group["of"]) == (sum(row["inside"] for row in pair["figures"]), 14)
    assert ledger["not_revealed"] == []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("reveal",), "PREDICTION and CAME, or --ledger DIR alone"),
        (("reveal", "kept/pulls.json"), "PREDICTION and CAME"),
        (("reveal", "kept/pulls.json", PULLS, "--ledger", "kept"), "--ledger DIR alone"),
        (("reveal", PULLS, "kept"), "last_14.toml"),
        (("predict", PULLS, "--out", "new.json"), "needs --cell"),
        (("predict", PULLS, "--cell", CELL, "--out", "kept/pulls.json"), "never replaced"),
    ],
)
def test_bad_words_are_refused_in_one_line(
    counterflex: Any, sealed: dict[str, Any], words: tuple[str, ...], message: str
) -> None:
    ended = counterflex(*words)
    assert ended.status == 2
    assert ended.err.startswith("error: ")
    assert ended.err.count("\n") == 1
    assert message in ended.err
    assert json.loads(Path("kept/pulls.json").read_text(encoding="utf-8")) == sealed
    assert not Path("new.json").exists()
