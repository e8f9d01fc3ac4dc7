"""What a recorder says of a run at its end: holds and faults, with their causes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from counterflex.app.run.recorder import Recorder
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.protocols.processes.control_array import CONTROL
from counterflex.runtime import record_ring as record
from counterflex.runtime.record_ring import RecordRing
from counterflex.runtime.state.supervisor import Cause, State

STATES = [State.ACTIVE, State.HOLD, State.HOLD, State.ACTIVE, State.HOLD, State.FAULT, State.FAULT, State.IDLE]
CAUSES = [
    Cause.NONE,
    Cause.CLOCK,
    Cause.CLOCK,
    Cause.NONE,
    Cause.TELEGRAMS_LATE,
    Cause.TELEGRAMS_STOPPED,
    Cause.TELEGRAMS_STOPPED,
    Cause.NONE,
]


def test_holds_and_faults_are_counted_by_cause_and_listed(tmp_path: Path) -> None:
    ring, control = RecordRing(), np.zeros(CONTROL, dtype=np.int64)
    log = RunLogWriter(tmp_path, {})
    recorder = Recorder(ring.name, log, control)
    try:
        for lap in range(100):
            for k, (state, cause) in enumerate(zip(STATES, CAUSES, strict=True)):
                row = ring.row()
                row[:] = 0.0
                row[1] = 4e6 * (lap * len(STATES) + k)
                row[record.column("out_state")], row[record.column("out_cause")] = state, cause
                row[record.CYCLE] = lap * len(STATES) + k + 1
                ring.commit()
            recorder.take()
        summary = recorder.summary()
    finally:
        recorder.close()
        log.close()
        ring.close()
    assert summary["incidents_total"] == 300
    assert summary["incidents_by_cause"] == {
        "hold clock": 100,
        "hold telegrams_late": 100,
        "fault telegrams_stopped": 100,
    }
    assert len(summary["incidents"]) == 250
    assert [(one["cycle"], one["state"], one["before"]) for one in summary["incidents"][:4]] == [
        (2, "hold", "active"),
        (5, "hold", "active"),
        (6, "fault", "hold"),
        (10, "hold", "active"),
    ]
    assert summary["incidents"][3]["time_s"] == 0.036
