"""`plan strategy`: a program is read back, its advice is better on a simulated cell, bad input is one line."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wall_finish as benchmark
from counterflex.app.strategy.advice import WallOperation, advise, doubt_of
from counterflex.cli import start
from counterflex.core.errors import InputError, ProgramError
from counterflex.core.units import MM, RPM
from counterflex.files.cell.cell import read_cell

CUT = {"milling": "down", "ae_mm": 1.5, "ap_mm": 5.0, "fz_mm": 0.03, "rpm": 17000.0}
TABLE = benchmark.MATERIALS["EN AW-7075"]["table"]


def job(folder: Path, **changes: Any) -> tuple[Path, Path]:
    return benchmark.files(folder, CUT | changes, TABLE)


def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    monkeypatch.setattr(sys, "argv", ["counterflex", *(str(word) for word in words)])
    with pytest.raises(SystemExit) as end:
        start.run()
    said = capsys.readouterr()
    return int(end.value.code or 0), said.out, said.err


@pytest.mark.parametrize("milling", ["down", "up"])
def test_what_the_program_does_is_read_back(milling: str, tmp_path: Path) -> None:
    program, cell = job(tmp_path, milling=milling)
    own = advise(read_cell(cell), WallOperation(ap_m=(5 * MM, 5 * MM), fz_m=(0.03 * MM, 0.03 * MM)), program).own
    assert own is not None
    assert bool(own.cuts.up[0]) == (milling == "up")
    assert own.cuts.ae_m[0] == pytest.approx(1.5 * MM, abs=0.05 * MM)
    assert own.cuts.ap_m[0] == pytest.approx(5 * MM, abs=1e-4 * MM)
    assert own.cuts.fz_m[0] == pytest.approx(0.03 * MM, rel=1e-3)
    assert own.spindle_rad_s == pytest.approx(17000.0 * RPM)
    assert own.normal_part == pytest.approx([0.0, 1.0, 0.0])


@pytest.mark.long
def test_advice_leaves_less_on_a_simulated_cell_and_takes_no_longer(tmp_path: Path) -> None:
    material = benchmark.MATERIALS["EN AW-7075"]
    cuts = benchmark.variants(tmp_path, material)
    before, advised = cuts["before"], cuts["advised"]
    assert advised["expected"]["time_s_per_m"] <= 1.002 * before["expected"]["time_s_per_m"]
    assert advised["expected"]["up_to_um"] < 0.5 * before["expected"]["up_to_um"]
    errors = [benchmark.machined(tmp_path / "run", cut, material["table"], 3, "wide") for cut in (before, advised)]
    assert errors[1] < 0.7 * errors[0]


def test_handbook_force_is_more_doubtful_than_an_identified_one(tmp_path: Path) -> None:
    cell = read_cell(job(tmp_path)[1])
    doubt = doubt_of(cell, WallOperation())
    assert doubt.wear_share > 0.0
    assert np.median(doubt.factors()) > 1.0


@pytest.mark.long
def test_the_command_prints_before_and_choices(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    program, cell = job(tmp_path)
    words = ("plan", "strategy", program, "--cell", cell, "--rows", 3, "--ap-mm", 5)
    status, out, _ = run(monkeypatch, capsys, *words, "--json")
    assert status == 0
    answer = json.loads(out)
    assert answer["before"]["milling"] == "down"
    assert answer["choices"][0]["milling"] == "up"
    assert answer["choices"][0]["up_to_um"] < answer["before"]["up_to_um"]
    assert len(answer["choices"]) == 3
    assert answer["zero"]["force_ae_mm"] < 0.8 * answer["zero"]["half_diameter_mm"]
    assert "process_limits.spindle_power_w" in answer["not_known"]
    status, out, _ = run(monkeypatch, capsys, *words, "--time-percent", 10)
    assert status == 0
    assert "none of" in out
    assert "time (" in out


def test_a_cut_is_stated_instead_of_a_program(tmp_path: Path) -> None:
    cell = read_cell(job(tmp_path)[1])
    stated = WallOperation(ap_m=(5 * MM, 5 * MM), fz_m=(0.03 * MM, 0.03 * MM), spindle_rad_s=(1e3, 1e3))
    advice = advise(cell, replace(stated, ae_m=(0.2 * MM, 4 * MM)))
    assert advice.before is None
    assert advice.choices.cuts.up[advice.best[0]]
    with pytest.raises(InputError, match="--ae-mm"):
        advise(cell, stated)
    with pytest.raises(InputError, match="no such material"):
        advise(cell, replace(stated, ae_m=(1 * MM, 2 * MM), material="unobtainium"))


def test_a_slot_is_no_wall(tmp_path: Path) -> None:
    program, cell = job(tmp_path)
    text = program.read_text(encoding="utf-8").replace("Y33", "Y15")
    program.write_text(text, encoding="utf-8")
    with pytest.raises(ProgramError, match=r"mills slots only.*trochoid"):
        advise(read_cell(cell), WallOperation(), program)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--ae-mm", "3:1"), ["--ae-mm", "empty range", "3:1"]),
        (("--fz-mm", "thin"), ["--fz-mm", "no range", "thin", "LOW:HIGH"]),
        (("--rpm", "0"), ["--rpm", "above 0"]),
        (("--ae-mm", "0.5:9"), ["--ae-mm", "9 mm", "at most 6 mm"]),
        (("--ap-mm", "20"), ["--ap-mm", "20 mm", "at most 16 mm"]),
        (("--material", "x37crmov5-1-qt-vdi11"), ["no radial force coefficient", "kr_over_kc"]),
        (("--tool", "7"), ["finishes no wall"]),
    ],
)
def test_bad_input_is_one_line(
    words: tuple[str, ...],
    said: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    program, cell = job(tmp_path)
    status, out, err = run(monkeypatch, capsys, "plan", "strategy", program, "--cell", cell, *words)
    assert status == 2
    assert out == ""
    last = err.strip().splitlines()[-1]
    for word in said:
        assert word in last
