"""Names of users' files on the panel, in its report and over OPC UA: text, without what steers or hides."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from counterflex.app.panel.page import report_html
from counterflex.app.panel.tries import RefusedLogins
from counterflex.app.panel.watched_run import Seen
from counterflex.app.run.recorder import SUMMARY

NAME = "cell\x1b]0;PWN\x07\u202egnp <script>alert(1)</script> <b>b</b> [/3]"
STEERS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def test_the_report_of_a_run_shows_text(tmp_path: Path) -> None:
    incident = {"number": 1, "state": NAME, "cause": NAME, "time_s": 1.0}
    action = {"who": NAME, "from": NAME, "action": NAME, "done": False, "refused": NAME}
    run = {"job": "run", "cell": NAME, "incidents": [incident], "operator_actions": [action], "causes": [NAME]}
    (tmp_path / SUMMARY).write_text(json.dumps(run))
    page = report_html(tmp_path)
    assert page.count("\\x1b]0;PWN\\x07") == 8
    assert STEERS.search(page) is None
    assert "<script" not in page
    assert "<b>b" not in page


def test_a_name_that_was_tried_is_noted_as_text() -> None:
    notes: list[Any] = []
    RefusedLogins(notes.append, lambda: 100.0).add(NAME, "10.0.0.66")
    assert STEERS.search(notes[0]["who"]) is None


def test_values_over_opc_ua_are_text() -> None:
    pytest.importorskip("asyncua", reason="the extra opcua is not installed")
    from counterflex.app.opcua.nodes import NODES, View

    about = {"files": {"program": f"/jobs/{NAME}.ngc\udcff", "cell": ""}, "folder": NAME, "counterflex": NAME}
    incident = {"cause": NAME, "state": NAME, "over": True}
    view = View(Seen.RUNNING, about, {"state": NAME, "cause": NAME, "incident": incident}, None, NAME)
    shown = [node.value(view)[0] for node in NODES if isinstance(node.default, str)]
    named = [text for text in shown if "PWN" in text]
    assert len(named) >= 5
    for text in named:
        assert STEERS.search(text) is None
        text.encode()
