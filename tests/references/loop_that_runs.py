"""A loop in a process of its own with its snapshots, for tests of what watches it."""

from __future__ import annotations

import threading
from pathlib import Path

from counterflex.protocols.processes.actions import Actions, actions_path
from counterflex.protocols.processes.control_array import Life
from counterflex.protocols.processes.operator_words import OperatorFile
from counterflex.protocols.processes.snapshot import SnapshotMemory
from counterflex.runtime.state.states import State
from counterflex_lab.faults.process_rig import ProcessRig


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
