"""Motor currents instead of a force sensor, over sockets: the same cell with and without them; what is refused."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import counterflex
from counterflex.app.compensation.compensate import run as compensate
from counterflex.app.proof import evaluate
from counterflex.app.proof.truth import make_truth
from counterflex.app.run import log as run_log, session as online_session
from counterflex.app.simulated_cell import cell as live
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.files.cell.cell import read_cell
from counterflex.files.logs.segments import read_log
from counterflex.integrations.kuka.link.config import parse_config
from counterflex.integrations.kuka.link.setup import RsiMakeSettings
from counterflex.runtime.estimator.fusion import Source
from counterflex.runtime.record_ring import COLUMNS
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.twin.network.faults import Fault
from counterflex.twin.plant.drives import DATA_SHEET_NM_A
from counterflex.twin.plant.force_sensor import force_sensor
from counterflex_lab.reproduce import closed_loop

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
RSI = Path(counterflex.__file__).parent / "app" / "demo" / "rsi.xml"
ONLINE = '\n[online]\nforce = "fused"\ncorrection_mm = 3\nspeed_mm_s = 40\nacceleration_mm_s2 = 2500\n'
CONSTANTS = f"torque_per_current_nm = {list(DATA_SHEET_NM_A)}\n"
SEED = 4


@dataclass(frozen=True)
class Place:
    """A cell with a force sensor, its truth, a groove with a long approach, and its plan."""

    cell: Path
    truth: Path
    program: Path
    rsi: Path
    plan: Path


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    folder = tmp_path_factory.mktemp("currents")
    text = (EXAMPLES / "cells" / "kr300_d16_small.toml").read_text(encoding="utf-8")
    bare, cell, program, rsi = (folder / name for name in ("bare.toml", "cell.toml", "groove.ngc", "rsi.xml"))
    bare.write_text(text, encoding="utf-8")
    truth = make_truth(read_cell(bare), SEED, folder / "truth.toml")
    bias = force_sensor(truth, 0, "sensor", hose_share=0.0).w_bias
    spindle = next(body.mass_kg for body in truth.bodies if body.name == "spindle")
    text = text.replace("mass_kg = 75", f"mass_kg = {spindle:.4f}")
    sensor = f'\n[sensor]\nsegment = "sensor"\nbias_n = {bias[:3].tolist()}\nbias_nm = {bias[3:].tolist()}\n'
    cell.write_text(text + sensor + ONLINE + CONSTANTS, encoding="utf-8")
    groove = (EXAMPLES / "programs" / "groove.ngc").read_text(encoding="utf-8")
    program.write_text(groove.replace("X-12 Y15", "X-52 Y15"), encoding="utf-8")
    delay = '<ELEMENT TAG="DEF_Delay"'
    currents = '<ELEMENT TAG="DEF_MACur" TYPE="DOUBLE" INDX="INTERNAL"/>\n      '
    rsi.write_text(RSI.read_text(encoding="utf-8").replace(delay, currents + delay), encoding="utf-8")
    compensate(program, cell, folder / "plan", report=False, programmed_feed=True, predict=False)
    return Place(cell, folder / "truth.toml", program, rsi, folder / "plan" / "plan.parquet")


def mill(place: Place, out: Path, *, currents: bool) -> tuple[dict[str, Any], dict[str, Float]]:
    """Mill with a force sensor that dies before the cut: figures of the part, columns of the log."""
    closed_loop.run(
        live.LiveSettings(
            place.program,
            place.cell,
            place.truth,
            ("rsi", place.rsi),
            hose_share=0.0,
            force_faults=(Fault("dying", from_s=1.1),),
        ),
        out / "part",
        online_session.RunSettings(
            place.cell, ("rsi", place.rsi), place.plan, compensated=False, arm=True, currents=currents
        ),
        out / "log",
        sensors=closed_loop.Sensors(force=True),
    )
    rows, _, cut = read_log(out / "log")
    assert cut == []
    return evaluate.run([out / "part"], None)["variants"]["nominal"], dict(zip(COLUMNS, rows.T, strict=True))


def test_a_dead_force_sensor_with_and_without_currents(place: Place, tmp_path: Path) -> None:
    """Truth 4 cuts with a fifth more force across than planned; the currents find most of it, and it is said."""
    before, blind = mill(place, tmp_path / "blind", currents=False)
    after, seeing = mill(place, tmp_path / "seeing", currents=True)
    for named, left in ((blind, Source.PLAN), (seeing, Source.PLAN | Source.CURRENTS)):
        cuts = (named["out_state"] == State.ACTIVE) & (named["cutting"] > 0.0)
        assert np.count_nonzero(cuts) > 500
        assert set(named["out_sources"][cuts].astype(int).tolist()) == {int(left)}
        assert set(named["out_degraded"][cuts].astype(int).tolist()) == {int(Cause.FORCE_STALE)}
        assert not np.any(named["out_state"] == State.FAULT)
    assert np.all(blind["factor_across"] == 1.0)
    again = run_log.replay(tmp_path / "seeing" / "log", place.cell, place.plan, compensated=False)
    assert again.proved
    last = np.flatnonzero(seeing["cutting"] > 0.0)[-1]
    assert seeing["factor_across"][last] > 1.1
    assert after["plateau"]["rms_mm"] < 0.8 * before["plateau"]["rms_mm"]


@pytest.mark.parametrize(
    ("old", "new", "planned", "rsi", "said"),
    [
        (CONSTANTS, "", True, "sends", "torque_per_current_nm"),
        ('force = "fused"', 'force = "scale"', True, "sends", 'force = "fused"'),
        ("", "", False, "sends", "--plan"),
        ("", "", True, "silent", "DEF_MACur"),
        (CONSTANTS, "torque_per_current_nm = [0, 1, 1, 1, 1, 1]\n", True, "sends", "not zero"),
    ],
)
def test_currents_that_cannot_be_used_are_refused(
    place: Place, tmp_path: Path, old: str, new: str, planned: bool, rsi: str, said: str
) -> None:
    cell = tmp_path / "cell.toml"
    cell.write_text(place.cell.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    settings = online_session.RunSettings(
        cell,
        ("rsi", place.rsi if rsi == "sends" else RSI),
        place.plan if planned else None,
        compensated=False,
        currents=True,
        tracker_port=None if planned else 0,
        force=None,
        port=0,
    )
    if not planned:
        text = cell.read_text(encoding="utf-8") + "along_feed = true\n"
        cell.write_text(text + "\n[tracker]\nx_mm = 4500\n", encoding="utf-8")
    with pytest.raises(InputError) as fault:
        online_session.open_session(settings)
    assert said in str(fault.value)


def test_rsi_make_asks_for_currents_where_their_constants_are_known(place: Place, tmp_path: Path) -> None:
    bare = tmp_path / "bare.toml"
    bare.write_text(place.cell.read_text(encoding="utf-8").replace(CONSTANTS, ""), encoding="utf-8")
    for cell, there in ((place.cell, True), (bare, False)):
        out = tmp_path / str(there)
        RsiMakeSettings(cell=cell).make(out)
        file = next(out.glob("*ethernet.xml"))
        names = [value.name for value in parse_config(file.read_bytes(), str(file)).sent()]
        assert ("MACur.A6" in names) == there
