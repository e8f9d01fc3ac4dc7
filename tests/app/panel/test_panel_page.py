"""The page in a real browser, beside a real loop: what it shows, who may do what, and a panel that is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from browser import Browser, chromium
from counterflex.protocols.processes.control_array import Panel
from counterflex.protocols.processes.snapshot import SnapshotReader, snapshot_path
from counterflex.runtime.state.states import State
from loop_that_runs import Run

pytest.importorskip("nicegui", reason="the extra panel is not installed")
pytestmark = [
    pytest.mark.skipif(chromium() is None, reason="no Chromium on this computer"),
    pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="processes cannot be stopped here"),
]


class PanelProcess:
    """The panel, as a person starts it."""

    def __init__(self, folder: Path) -> None:
        command = [sys.executable, "-m", "counterflex", "panel", str(folder), "--port", "0"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        lines = [self.process.stdout.readline() for _ in range(2)]
        self.links = dict(line.strip().split(": ", 1) for line in lines)

    def send(self, number: int) -> None:
        os.kill(self.process.pid, number)

    def kill(self) -> None:
        self.process.kill()
        self.process.communicate()


@pytest.fixture
def panels() -> Iterator[list[PanelProcess]]:
    """Panels of a test: those that it leaves behind are killed."""
    made: list[PanelProcess] = []
    yield made
    for one in made:
        if one.process.poll() is None:
            one.kill()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    made = Run(tmp_path_factory.mktemp("panel"))
    yield made
    made.close()


def test_a_run_with_two_people_and_a_panel_that_dies(run: Run, panels: list[PanelProcess]) -> None:
    """One story, because a browser and a loop are slow to start."""
    panels.append(panel := PanelProcess(run.folder))
    with Browser(draws=False) as browser:
        anna = browser.page()
        anna.open(panel.links["operator"])
        anna.wait_text("state", "READY")
        assert "key=" not in str(anna.value("location.href"))
        ben = browser.page()
        ben.open(panel.links["viewer"])
        ben.wait_text("state", "READY")
        assert not ben.there("stop")
        assert not ben.there("arm")

        run.want = True
        anna.click("arm")
        anna.wait("!!document.querySelector('[data-test=\"yes\"]')", "arming is asked for twice")
        anna.click("yes")
        anna.wait_text("state", "CORRECTING")
        ben.wait_text("state", "CORRECTING")
        assert run.rig.control[Panel.CLIENTS] == 2
        assert float(anna.text("correction")) >= 0.0

        panel.send(signal.SIGSTOP)  # the connection is lost
        anna.wait_text("lost", "NO CONNECTION")
        before = run.answered
        while run.answered < before + 50:
            run._end.wait(0.01)
        assert run.rig.state == State.ACTIVE
        panel.send(signal.SIGCONT)
        anna.wait("!document.querySelector('[data-test=\"lost\"]')", "the connection is back")

        panel.kill()
        ben.wait_text("lost", "NO CONNECTION")
        before = run.answered
        while run.answered < before + 50:
            run._end.wait(0.01)
        assert run.rig.state == State.ACTIVE  # nothing else happens

        reader = SnapshotReader(snapshot_path(run.rig._words.path))
        while reader.latest()[0].panel != 2:
            run._end.wait(0.05)
        reader.close()

        panels.append(panel := PanelProcess(run.folder))
        anna.open(panel.links["operator"])
        anna.wait_text("state", "CORRECTING")
        other = browser.page()
        other.open(panel.links["operator"])  # a second operator
        other.wait_text("state", "CORRECTING")
        other.click("arm")
        other.wait("!!document.querySelector('[data-test=\"no\"]')", "the second operator is asked, too")
        other.click("no")
        other.tab_to("arm")  # a button has the focus
        other.press("S")  # Caps Lock is on
        anna.wait_text("incident", "operator")
        other.wait_text("incident", "operator")
    panel.send(signal.SIGINT)
    panel.process.communicate()
    assert run.rig.control[Panel.NS] == 0  # it has said goodbye
    done = [(one["who"], one["action"], one["done"]) for one in run.actions.take()]
    assert ("operator", "arm", True) in done
    assert ("operator", "stop", True) in done
    assert ("viewer", "link opened as viewer", True) in done
    assert [what for _, what, _ in done].count("panel opened") == 2
    assert done[-1][1] == "panel closed"
