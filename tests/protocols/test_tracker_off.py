"""What keeps a loop idle whose tracker sees the tool elsewhere: the distance, its limit and what to do are told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.run.end import End, ended_how
from counterflex.app.run.operator_requests import Clock, ask
from counterflex.cli.commands.operate import requests
from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.geometry.rotation import exp
from counterflex.protocols.processes.control_array import CONTROL
from counterflex.protocols.session.tracker_off import tracker_off
from counterflex.runtime.settings import ForceMode, OnlineSettings, TrackerMode
from counterflex.runtime.state.supervisor import State
from counterflex_lab.faults.rig import Rig

END = {
    "loop_ended": "as asked",
    "correction_ended": {"by": "never", "cause": "none"},
    "records_lost": 0,
    "log_trouble": "",
    "recorder_died": False,
    "cycles": 150,
}


def watched(shift_m: float, turn_rad: float = 0.0, limit_m: float = 2.0 * MM) -> Rig:
    """A robot that stands, seen from a frame that is off."""
    settings = OnlineSettings(force=ForceMode.MEASURED, tracker=TrackerMode.INTEGRATOR, normal_only=False)
    settings = replace(settings, plausibility=replace(settings.plausibility, frame_m=limit_m))
    rig = Rig(settings=settings, sensors="both")
    assert rig.tracker is not None

    def off(T: Float) -> Float:
        seen = T.copy()
        seen[0, 3] += shift_m
        seen[:3, :3] = exp(np.array([0.0, turn_rad, 0.0])) @ T[:3, :3]
        return seen

    rig.tracker.change = off
    for _ in range(150):
        rig.run_cycles -= 1
        rig.cycle()
    return rig


def looked(rig: Rig) -> dict[str, Any]:
    """What ``operator status`` finds."""

    def wait(_: float) -> None:
        rig.run_cycles -= 1
        rig.cycle()

    return ask(rig.control, "status", clock=Clock(rig.clock_ns, wait))


@pytest.mark.parametrize(
    ("shift_m", "turn_rad", "limit_m"), [(3.4 * MM, 0.0, 2.0 * MM), (0.0, 0.5 * DEG, 2.0 * MM), (1.5 * MM, 0.0, MM)]
)
def test_the_distance_the_limit_and_what_to_do(
    shift_m: float, turn_rad: float, limit_m: float, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with watched(shift_m, turn_rad, limit_m) as rig:
        assert rig.state == State.IDLE
        found = looked(rig)
        off = found["tracker_off"]
        assert off["distance_mm"] == pytest.approx(1e3 * shift_m, abs=0.1)
        assert off["turn_deg"] == pytest.approx(turn_rad / DEG, abs=0.02)
        assert (off["limit_mm"], off["limit_deg"]) == (1e3 * limit_m, 0.2)
    monkeypatch.setattr("counterflex.app.run.operator_requests.request", lambda *_: found)
    assert requests.send_request(Path("log"), "status", as_json=False) == 0
    told = ended_how(END | {"tracker_off": off}, arm=True)
    assert told["status"] == End.NEVER_ARMED
    for said in (capsys.readouterr().out, told["said"]):
        assert f"{off['distance_mm']:.2f} mm (limit {1e3 * limit_m:g} mm)" in said
        assert "fiducials at the part" in said


def test_nothing_is_told_of_a_tracker_that_agrees_or_of_which_nothing_is_known() -> None:
    assert tracker_off([0] * CONTROL) is None
    with watched(1.0 * MM) as rig:
        assert rig.state == State.READY
        assert looked(rig)["tracker_off"] is None
