"""Flange sensor and strain-gauge holder in one run over sockets: one falls away in the cut, the force goes on."""

from __future__ import annotations

import socket
from concurrent.futures import ThreadPoolExecutor
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.app.run.test_holder_run import PROGRAM, write_cell

from counterflex.app.compensation.compensate import run as compensate
from counterflex.app.proof.truth import make_truth
from counterflex.app.run import session as online_session
from counterflex.app.run.pair import require_pair
from counterflex.app.simulated_cell import cell as live
from counterflex.core.errors import InputError
from counterflex.evaluate.run_record import RunRecord
from counterflex.files.cell.cell import read_cell
from counterflex.files.cell.online import OnlineTable
from counterflex.files.schema import read_toml, write_toml
from counterflex.protocols.processes.control_array import REQUESTS, Request
from counterflex.protocols.session.pair import PairSource
from counterflex.runtime.record_ring import RecordRing
from counterflex.runtime.sensing.pair_wrench import PairWrench
from counterflex.runtime.state.supervisor import State
from counterflex.twin.devices.robot_server import Timing
from counterflex.twin.network.faults import Fault
from counterflex.twin.plant.force_sensor import force_sensor
from counterflex_lab.reproduce.closed_loop import free_port

ONE_CUT = PROGRAM[: PROGRAM.index("M6 T2")] + "M30\n"
SENSOR = {"name": "sensor", "z_mm": 30.0, "mass_kg": 6.0, "rx_urad_per_knm": 303.0, "ry_urad_per_knm": 303.0}


def pair_cell(folder: Path) -> Path:
    """The holder's cell with a six-axis sensor at the flange, weights and biases identified without an error."""
    file = write_cell(folder)
    table: dict[str, Any] = read_toml(file, "counterflex cell")
    table["end_effector"] = [SENSOR, *table["end_effector"]]
    table["tools"] = table["tools"][:1]
    write_toml(file, table)
    truth = make_truth(read_cell(file), 3, folder / "truth.toml")
    weights = {body.name: body.mass_kg for body in truth.bodies}
    for body in table["end_effector"]:
        body["mass_kg"] = float(weights[body["name"]])
    bias = force_sensor(truth, 0, "sensor", hose_share=0.0).w_bias
    table["sensor"] = {
        "segment": "sensor",
        "protocol": "wrench",
        "bias_n": [float(v) for v in bias[:3]],
        "bias_nm": [float(v) for v in bias[3:]],
    }
    table["online"] = {"force_from": "both", "force": "measured", "correction_mm": 3.0, "speed_mm_s": 60.0}
    write_toml(file, table)
    return file


@pytest.mark.long
def test_the_holder_falls_away_in_the_cut(tmp_path: Path) -> None:
    cell, program = pair_cell(tmp_path), tmp_path / "edge.ngc"
    program.write_text(ONE_CUT, encoding="utf-8")
    compensate(program, cell, tmp_path / "plan", report=False, programmed_feed=True, predict=False)
    control, ring = np.zeros(REQUESTS, dtype=np.int64), RecordRing()
    control[Request.ARM] = 1
    force = free_port(socket.SOCK_DGRAM)
    with resources.as_file(resources.files("counterflex.app") / "demo" / "rsi.xml") as rsi:
        settings = online_session.RunSettings(
            cell,
            ("rsi", rsi),
            tmp_path / "plan" / "plan.parquet",
            compensated=False,
            port=0,
            force=("127.0.0.1", force),
            strain_port=0,
            arm=True,
            lockstep=True,
        )
        session = online_session.open_session(settings, control=control, ring=ring)
        source, wrench = session.force, session.wrench
        assert isinstance(source, PairSource)
        assert isinstance(wrench, PairWrench)
        twin = live.LiveSettings(
            program,
            cell,
            tmp_path / "truth.toml",
            ("rsi", rsi),
            peer=session.link.address,
            force_port=force,
            force_host="127.0.0.1",
            hose_share=0.0,
            strain_peer=source.second_source.address,  # type: ignore[attr-defined]
            strain_faults=tuple(Fault("nan", from_s=1.9, bridge=k) for k in range(1, 7)),
            timing=Timing(gate_s=0.8, patience_s=60.0),
        )
        record, gaps, forces, used, active = RunRecord(), [], [], [], []
        with ThreadPoolExecutor(1) as pool:
            milled = pool.submit(live.run, twin, tmp_path / "part")
            while not milled.done():
                if session.cycle(0.05):
                    active.append(session.loop.result.cut > 0.0 and session.loop.result.state == State.ACTIVE)
                    used.append(wrench.fresh)
                    gaps.append(wrench.gap_n)
                    forces.append(wrench.w_part[:3].copy())
                    record.add(ring.take())
            assert milled.result()["online"]["ended"] in ("finished", "no more answers from the sensor program")
    session.link.close()
    source.close()
    ring.close()
    acted, kinds = np.array(active), np.array(used)
    lost = int(np.flatnonzero((kinds == 1) & acted)[0])
    assert (kinds[acted] == 3).sum() > 50
    assert (kinds[acted] == 1).sum() > 50
    assert np.max(np.array(gaps)[acted]) < 60.0
    steps = np.linalg.norm(np.diff(np.array(forces), axis=0), axis=1)
    usual = np.quantile(steps[lost - 60 : lost - 2], 0.95)
    assert steps[lost - 1] < 3.0 * usual + 5.0
    changes = record.figures().pair_changes
    assert any((one.before, one.after) == (3, 1) for one in changes)


def test_what_it_does_not_go_with_is_refused(tmp_path: Path) -> None:
    cell = read_cell(pair_cell(tmp_path))
    with pytest.raises(InputError, match="inertia_hz"):
        require_pair(cell, OnlineTable(force_from="both", inertia_hz=25.0), None)
