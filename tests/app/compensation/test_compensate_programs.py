"""The programs that come with the package, end to end: LinuxCNC's verdict, and nothing changed where no force acts."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from counterflex.app.compensation.compensate import compensate
from counterflex.app.inputs import read_job
from counterflex.core.units import MM
from counterflex.files.cell.cell import read_cell
from counterflex.path.toolpath import FEED
from counterflex.programs.compensated import tool_path
from counterflex.programs.gcode.read.reader import read_gcode_file

ROOT = Path(__file__).resolve().parents[3]


def _bench() -> ModuleType:
    spec = importlib.util.spec_from_file_location("benchmark_compensate", ROOT / "benchmarks" / "compensate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["benchmark_compensate"] = module
    spec.loader.exec_module(module)
    return module


BENCH = _bench()
PROGRAMS = BENCH.upright_programs(ROOT / "examples" / "programs")
"""tests/app/proof/test_tilted_cut.py has the tilted one."""


@pytest.mark.by_turn
@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.stem)
def test_shipped_program(program: Path, tmp_path: Path) -> None:
    cell = read_cell(BENCH.cell_for(program, tmp_path))
    found = compensate(program, cell)
    result = tmp_path / program.name
    result.write_text(found.files[program.name], encoding="ascii", newline="")
    job = read_job(program, cell)
    back = read_gcode_file(result)
    assert BENCH.untouched_faults(job, found.plan, back) == []
    if BENCH.RS274.exists():
        assert BENCH.linuxcnc_fault(result) is None

    # The written path runs through the planned points.
    feed = found.plan.path.kind == FEED
    planned = (found.plan.path.p_part_tcp + found.plan.correction_part)[feed]
    written = tool_path(back, step_m=0.2 * MM, chord_m=1e-7).p_part_tcp
    a, d = written[:-1], np.diff(written, axis=0)
    length2 = np.maximum(np.sum(d * d, axis=1), 1e-30)
    for q in planned[:: max(1, len(planned) // 300)]:
        t = np.clip(np.sum((q - a) * d, axis=1) / length2, 0.0, 1.0)
        assert np.sqrt(np.min(np.sum((a + t[:, None] * d - q) ** 2, axis=1))) <= 5.2e-6

    prediction = found.summary["prediction"]
    assert prediction["collisions"] == []
    assert 10.0 < prediction["peak_force_n"]["value"] < 600.0
    before, after = prediction["predicted_nominal"], prediction["predicted_compensated"]
    assert after["rms_mm"] < 0.5 * before["rms_mm"]


def test_untouched_faults_are_found(tmp_path: Path) -> None:
    """The judge itself: a line changed where nothing was corrected does not escape it."""
    program = next(file for file in PROGRAMS if file.stem == "groove")
    cell = read_cell(BENCH.cell_for(program, tmp_path))
    found = compensate(program, cell, predict=False)
    text = found.files[program.name]
    result = tmp_path / "changed.ngc"
    for old, new in (("G0 X-12 Y15", "G0 X-12.1 Y15"), ("M5", "M9")):
        assert old in text
        result.write_text(text.replace(old, new), encoding="ascii", newline="")
        assert BENCH.untouched_faults(read_job(program, cell), found.plan, read_gcode_file(result)) != []
