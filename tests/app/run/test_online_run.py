"""Correcting over sockets: the loop and the simulated cell in processes of their own, joined by nothing else."""

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
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.cell.cell import read_cell
from counterflex.files.logs.segments import read_log
from counterflex.runtime.plausibility.kernel import DOUBT_STEP
from counterflex.runtime.record_ring import COLUMNS
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.twin.plant.force_sensor import force_sensor
from counterflex_lab.reproduce import closed_loop

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
RSI = Path(counterflex.__file__).parent / "app" / "demo" / "rsi.xml"
PROGRAM = EXAMPLES / "programs" / "groove.ngc"
ONLINE = '\n[online]\nforce = "scale"\ncorrection_mm = 3\nspeed_mm_s = 40\nacceleration_mm_s2 = 2500\n'


@dataclass(frozen=True)
class Place:
    """A cell whose force sensor has been identified, its truth and the plan of a groove."""

    folder: Path
    cell: Path
    truth: Path
    plan: Path


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    folder = tmp_path_factory.mktemp("online")
    text = (EXAMPLES / "cells" / "kr300_d16_small.toml").read_text(encoding="utf-8")
    bare = folder / "bare.toml"
    bare.write_text(text, encoding="utf-8")
    truth = make_truth(read_cell(bare), 1, folder / "truth.toml")
    bias = force_sensor(truth, 0, "sensor", hose_share=0.0).w_bias
    table = f'\n[sensor]\nsegment = "sensor"\nbias_n = {bias[:3].tolist()}\nbias_nm = {bias[3:].tolist()}\n'
    cell = folder / "cell.toml"
    weights = {b.name: b.mass_kg for b in truth.bodies}
    weighed = text.replace("mass_kg = 75", f"mass_kg = {weights['spindle']:.4f}")
    assert weighed != text
    cell.write_text(weighed + table + ONLINE, encoding="utf-8")
    compensate(PROGRAM, cell, folder / "plan", report=False, programmed_feed=True)
    return Place(folder, cell, folder / "truth.toml", folder / "plan" / "plan.parquet")


def mill(place: Place, name: str, *, arm: bool) -> tuple[dict[str, Any], dict[str, Any]]:
    """Run the groove with the loop watching or acting: its summary and the figures of the part."""
    twin = live.LiveSettings(PROGRAM, place.cell, place.truth, ("rsi", RSI), hose_share=0.0)
    loop = online_session.RunSettings(place.cell, ("rsi", RSI), place.plan, compensated=False, arm=arm)
    part, log = place.folder / name, place.folder / f"{name}-log"
    summary = closed_loop.run(twin, part, loop, log, sensors=closed_loop.Sensors())
    return summary, evaluate.run([part], None)["variants"]["nominal"]


def test_correcting_while_milling_pair(place: Place) -> None:
    """Same truth, same program: watched only, and corrected."""
    watched, before = mill(place, "watched", arm=False)
    acted, after = mill(place, "acted", arm=True)
    assert watched["largest_correction_um"] == 0.0
    assert "active" not in watched["states"]
    assert acted["states"]["active"] > 800
    assert "fault" not in acted["states"]
    assert acted["records_lost"] == watched["records_lost"] == 0
    assert before["path"]["max_mm"] > 0.6
    assert after["path"]["max_mm"] < 0.32 * before["path"]["max_mm"]  # 0.276
    assert after["plateau"]["rms_mm"] < 0.11 * before["plateau"]["rms_mm"]  # 0.090
    rows, about, cut = read_log(place.folder / "acted-log")
    assert cut == []
    assert about["files"]["cell"] == str(place.cell)
    assert len(rows) == acted["records"]
    named = dict(zip(COLUMNS, rows.T, strict=True))
    steps = np.diff(named["counter_ms"][named["elapsed"] > 0])
    assert np.all(steps >= 0)
    assert not np.any(named["out_doubt"].astype(int) & DOUBT_STEP)
    assert Cause.FORCE_OFFSET not in named["out_cause"]
    force = named["filtered_fy"][named["out_state"] == State.ACTIVE]
    assert np.max(np.abs(force)) > 200.0
    again = run_log.replay(place.folder / "acted-log", place.cell, place.plan, compensated=False)
    assert again.proved
    assert again.notes == []
    other = run_log.replay(place.folder / "acted-log", place.cell, place.plan, compensated=True)
    assert other.difference is not None
    assert len(other.notes) == 2


def test_what_is_missing_is_said(place: Place, tmp_path: Path) -> None:
    bare = online_session.RunSettings(place.folder / "bare.toml", ("rsi", RSI), place.plan)
    with pytest.raises(FileFormatError, match=r"\[online\]"):
        online_session.open_session(bare)
    blind = online_session.RunSettings(place.cell, ("rsi", RSI), place.plan)
    with pytest.raises(InputError, match="needs a force sensor"):
        online_session.open_session(blind)
    planless = online_session.RunSettings(place.cell, ("rsi", RSI), None, force=("127.0.0.1", 9))
    with pytest.raises(InputError, match="needs a plan"):
        online_session.open_session(planless)
