"""The strain-gauge holder drives the loop over sockets, through a change of tools; a bridge that dies is outlived."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.compensation.compensate import run as compensate
from counterflex.app.proof.truth import make_truth
from counterflex.app.run import session as online_session
from counterflex.app.simulated_cell import cell as live
from counterflex.core.arrays import Float
from counterflex.core.units import KN, MICRO, MM
from counterflex.files.cell.cell import read_cell
from counterflex.files.schema import write_toml
from counterflex.protocols.processes.control_array import REQUESTS, Request
from counterflex.protocols.strain.link import StrainLink
from counterflex.runtime.sensing.strain_wrench import StrainWrench
from counterflex.runtime.state.supervisor import State
from counterflex.twin.devices.robot_server import Timing
from counterflex.twin.network.faults import Fault
from counterflex.twin.plant.strain_holder import REFERENCE_C, instrumented_holder
from counterflex_lab.reproduce import holder_case

PROGRAM = """G17 G54 G40 G49 G80 G90
G21
M6 T1
M3 S12000
G43 H1
G0 X40 Y-5 Z33
G1 Z20 F3000
G1 X-8 F3000
G0 Z33
M5
M6 T2
M3 S12000
G43 H2
G0 X40 Y-4
G1 Z20 F3000
G1 X-8 F3000
G0 Z33
M5
M30
"""


def write_cell(folder: Path) -> Path:
    """A small blank, two tools, and a holder calibrated without an error."""
    table = holder_case.cell_table()
    table["part"]["stock"] |= {"box_max_mm": [30.0, 30.0, 30.0], "cell_mm": 0.4}
    table["part"]["datum_points_mm"] = [[0.0, 0.0, 30.0], [30.0, 0.0, 30.0], [30.0, 30.0, 30.0], [0.0, 30.0, 30.0]]
    table["tools"].append({**table["tools"][0], "number": 2, "flutes": 2})
    places = [
        (*(g[f"{a}_mm"] * MM for a in "xyz"), np.radians(g["angle_deg"]), g["factor"])
        for g in table["holder"]["gauges"]
    ]
    true = instrumented_holder(np.array(places), 0)
    table["holder"] |= {
        "sensitivity_um_m_per_kn": [[float(v / (MICRO / KN)) for v in row] for row in true.sensitivity],
        "bias_um_m": [float(v / MICRO) for v in true.zero],
        "temperature_um_m_per_k": [float(v / MICRO) for v in true.per_kelvin],
        "reference_c": REFERENCE_C,
    }
    table["online"] = {"force_from": "holder", "force": "measured", "correction_mm": 3.0, "speed_mm_s": 60.0}
    write_toml(folder / "cell.toml", table)
    return folder / "cell.toml"


@dataclass
class Cycles:
    """What the loop did, one row per telegram."""

    state: list[int] = field(default_factory=list)
    cutting: list[float] = field(default_factory=list)
    correction: list[Float] = field(default_factory=list)
    tool: list[int | None] = field(default_factory=list)


@pytest.mark.long
def test_holder_force_through_a_tool_change(tmp_path: Path) -> None:
    """Active in both cuts, with zero correction and a new zero between them, the next tool's matrix in the second.

    A bridge dies on the way and is left out. Over sockets, cell and loop in two threads.
    """
    cell, program, truth = write_cell(tmp_path), tmp_path / "edge.ngc", tmp_path / "truth.toml"
    program.write_text(PROGRAM, encoding="utf-8")
    make_truth(read_cell(cell), 3, truth)
    compensate(program, cell, tmp_path / "plan", report=False, programmed_feed=True, predict=False)
    plan = tmp_path / "plan" / "plan.parquet"
    control, seen = np.zeros(REQUESTS, dtype=np.int64), Cycles()
    control[Request.ARM] = 1
    with resources.as_file(resources.files("counterflex.app") / "demo" / "rsi.xml") as rsi:
        settings = online_session.RunSettings(
            cell, ("rsi", rsi), plan, compensated=False, port=0, strain_port=0, arm=True, lockstep=True
        )
        session = online_session.open_session(settings, control=control)
        link, wrench = session.force, session.wrench
        assert isinstance(link, StrainLink)
        assert isinstance(wrench, StrainWrench)
        twin = live.LiveSettings(
            program,
            cell,
            truth,
            ("rsi", rsi),
            peer=session.link.address,
            force_port=None,
            strain_peer=link.address,
            strain_faults=(Fault("nan", from_s=1.6, bridge=3),),
            timing=Timing(gate_s=0.8, patience_s=60.0),
        )
        with ThreadPoolExecutor(1) as pool:
            milled = pool.submit(live.run, twin, tmp_path / "part")
            while not milled.done():
                if session.cycle(0.05):
                    seen.state.append(int(session.loop.result.state))
                    seen.cutting.append(float(session.loop.result.cut))
                    seen.correction.append(session.loop.correction.copy())
                    seen.tool.append(wrench.tool)
            assert milled.result()["online"]["ended"] in ("finished", "no more answers from the sensor program")
    session.link.close()
    link.close()
    state, cut = np.array(seen.state), np.array(seen.cutting) > 0.0
    assert np.all(state[cut] == State.ACTIVE)
    changes = np.flatnonzero(np.diff(state == State.ACTIVE))
    assert len(changes) == 4  # on and off, twice
    between = slice(changes[1] + 100, changes[2])
    assert set(state[between].tolist()) <= {State.IDLE, State.READY, State.ARMED}
    assert np.max(np.abs(np.array(seen.correction)[between])) < 1e-8
    assert {seen.tool[k] for k in np.flatnonzero(cut[: changes[1]])} == {1}
    assert {seen.tool[changes[2] + k] for k in np.flatnonzero(cut[changes[2] :])} == {2}
