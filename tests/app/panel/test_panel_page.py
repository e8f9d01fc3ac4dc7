"""The page in a real browser, beside a real loop: what it shows, who may do what, and a panel that is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from browser import Browser, chromium
from counterflex.protocols.processes.actions import Actions, actions_path
from counterflex.protocols.processes.control_array import Life, Panel
from counterflex.protocols.processes.operator_words import OperatorFile
from counterflex.protocols.processes.snapshot import SnapshotMemory, SnapshotReader, snapshot_path
from counterflex.runtime.state.states import State
from counterflex.validation.faults.process_rig import ProcessRig

pytest.importorskip("nicegui", reason="the extra panel is not installed")
pytestmark = [
    pytest.mark.skipif(chromium() is None, reason="no Chromium on this computer"),
    pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="processes cannot be stopped here"),
]


class Run:
    """A loop in a process of its own, as ``run`` starts it; its robot goes on in a thread here."""

    def __init__(self, folder: Path) -> None:
        self.rig = ProcessRig(folder)
        self.folder = folder
        words = self.rig._words.path
        self._memory = SnapshotMemory(words)
        self.actions = Actions(actions_path(words), make=True)
        self.rig.start_loop()
        self.rig.control[Life.MAY_ARM] = 1
        self._file = OperatorFile(folder, words)
        self._end = threading.Event()
        self.want = False
        self.answered = 0
        self._thread = threading.Thread(target=self._go_on, daemon=True)
        self._thread.start()

    def _go_on(self) -> None:
        rig = self.rig
        while not self._end.wait(0.004):
            rig.robot.frees["Enable"] = float(self.want and rig.state in (State.ARMED, State.ACTIVE))
            if not rig.robot.stopped:
                force = 300.0 if rig.state == State.ACTIVE and not rig.robot.feed_hold else 0.0
                self.answered += rig.cycle(force)

    def close(self) -> None:
        self._end.set()
        self._thread.join()
        self._file.close()
        self._memory.close()
        self.actions.close()
        self.rig.__exit__()


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
    with Browser() as browser:
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
        other.press("s")
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
