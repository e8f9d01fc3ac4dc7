"""The estimator over sockets: plan, force and a tracker joined while the simulated cell mills; replayed bit for bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import counterflex
from counterflex.app.compensation.compensate import run as compensate
from counterflex.app.proof import evaluate
from counterflex.app.proof.truth import make_truth
from counterflex.app.run import log as run_log, session as online_session
from counterflex.app.simulated_cell import cell as live
from counterflex.files.cell.cell import read_cell
from counterflex.files.logs.segments import read_log
from counterflex.runtime.estimator.fusion import Source
from counterflex.runtime.plausibility.kernel import DOUBT_STEP
from counterflex.runtime.record_ring import COLUMNS
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.twin.plant.force_sensor import force_sensor
from counterflex_lab.reproduce import closed_loop

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
RSI = Path(counterflex.__file__).parent / "app" / "demo" / "rsi.xml"
PROGRAM = EXAMPLES / "programs" / "groove.ngc"
ONLINE = '\n[online]\nforce = "fused"\ncorrection_mm = 3\nspeed_mm_s = 40\nacceleration_mm_s2 = 2500\n'


def test_fused_over_sockets_and_replayed(tmp_path: Path) -> None:
    """The loop corrects from the estimate of plan and force; a replay of its log gives the same numbers."""
    text = (EXAMPLES / "cells" / "kr300_d16_small.toml").read_text(encoding="utf-8")
    bare, cell = tmp_path / "bare.toml", tmp_path / "cell.toml"
    bare.write_text(text, encoding="utf-8")
    truth = make_truth(read_cell(bare), 2, tmp_path / "truth.toml")
    bias = force_sensor(truth, 0, "sensor", hose_share=0.0).w_bias
    spindle = next(body.mass_kg for body in truth.bodies if body.name == "spindle")
    text = text.replace("mass_kg = 75", f"mass_kg = {spindle:.4f}")
    sensor = f'\n[sensor]\nsegment = "sensor"\nbias_n = {bias[:3].tolist()}\nbias_nm = {bias[3:].tolist()}\n'
    cell.write_text(text + sensor + ONLINE, encoding="utf-8")
    compensate(PROGRAM, cell, tmp_path / "plan", report=False, programmed_feed=True, predict=False)
    plan = tmp_path / "plan" / "plan.parquet"
    summary = closed_loop.run(
        live.LiveSettings(PROGRAM, cell, tmp_path / "truth.toml", ("rsi", RSI), hose_share=0.0),
        tmp_path / "part",
        online_session.RunSettings(cell, ("rsi", RSI), plan, compensated=False, arm=True),
        tmp_path / "log",
        sensors=closed_loop.Sensors(force=True),
    )
    assert summary["states"]["active"] > 800
    assert "fault" not in summary["states"]
    rows, _, cut = read_log(tmp_path / "log")
    assert cut == []
    named = dict(zip(COLUMNS, rows.T, strict=True))
    active = named["out_state"] == State.ACTIVE
    assert not np.any(named["out_doubt"].astype(int) & DOUBT_STEP)
    assert Cause.FORCE_OFFSET not in named["out_cause"]
    sources = set(named["out_sources"][active].astype(int).tolist())
    assert int(Source.PLAN | Source.FORCE) in sources
    factors = np.stack([named[f"factor_{d}"][active][-1] for d in ("feed", "across", "axial")])
    assert np.all(np.isfinite(factors))
    assert np.all((factors > 0.5) & (factors < 2.0))
    assert np.any(named["factor_across"][active] != 1.0)
    figures = evaluate.run([tmp_path / "part"], None)["variants"]["nominal"]
    assert figures["plateau"]["rms_mm"] < 0.1
    again = run_log.replay(tmp_path / "log", cell, plan, compensated=False)
    assert again.proved
    assert again.compared == len(rows)
    late = run_log.replay(tmp_path / "log", cell, plan, compensated=False, from_s=1e6)
    assert late.proved
    assert late.begun == [len(rows) // 1000 * 1000]
    assert late.compared == len(rows) - late.begun[0]
