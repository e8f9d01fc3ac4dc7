"""Offsets of the ROS 2 bridge beside a real loop: zero first, its correction then, nothing behind its end."""

from __future__ import annotations

import importlib.util
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from counterflex.app.opcua.server import ObservedRun
from counterflex.protocols.processes.control_array import Request
from counterflex.runtime.state.states import State
from loop_that_runs import Run

FILE = Path(__file__).resolve().parents[3] / "bridges" / "ros2_wrench" / "ros2_wrench_bridge" / "offsets.py"
PATIENCE = 3000


def bridge() -> ModuleType:
    spec = importlib.util.spec_from_file_location("ros2_offsets", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules["ros2_offsets"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_offsets_are_those_that_the_loop_sends_and_end_with_it(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    module, run = bridge(), Run(tmp_path / "run")
    observed, offsets = ObservedRun(run.folder), module.Offsets(max_age_s=5.0, max_gap_s=5.0)

    def until(wanted: Callable[[Any], bool]) -> Any:
        for _ in range(PATIENCE):
            observed.poll()
            offset = offsets.take(module.shot_of(observed), time.monotonic_ns())
            if wanted(offset):
                return offset
            run._end.wait(0.01)
        raise TimeoutError(observed.seen, run.rig.state)

    try:
        first = until(lambda offset: offset is not None)
        assert first.position_m == (0.0, 0.0, 0.0)
        assert first.orientation_xyzw == (0.0, 0.0, 0.0, 1.0)
        until(lambda _: run.rig.state == State.READY)
        run.want = True
        run.rig.control[Request.ARM] = 1
        moving = until(lambda offset: offset is not None and bool(np.linalg.norm(offset.position_m) > 1e-5))
        assert observed.last is not None
        assert moving.position_m == tuple(observed.last.correction[:3])
        assert moving.velocity_m_s is not None
        loop = run.rig.loop
        assert loop is not None
        assert loop.pid is not None
        os.kill(loop.pid, signal.SIGKILL)
        until(lambda _: module.shot_of(observed) is None)
        published = offsets.published
        for _ in range(20):
            observed.poll()
            assert offsets.take(module.shot_of(observed), time.monotonic_ns()) is None
        assert offsets.published == published
    finally:
        observed.close()
        run.close()
