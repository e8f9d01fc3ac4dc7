"""A package adds a robot maker in one folder: its language is read, converted to and written by every command."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
PROGRAMS = ROOT / "examples" / "programs"
SPINDLE = """
[controller.spindle.melfa]
clockwise = ["M_Out(1)=1", "M_DOut(2)={s}"]
off = ["M_Out(1)=0"]
tool_change = ["M_Tool={t}"]
"""
JOB = """
import json, sys
from pathlib import Path
import numpy as np
from counterflex.app import conversion
from counterflex.app.compensation.compensate import compensate
from counterflex.app.inputs import Reading
from counterflex.core.errors import CounterflexError
from counterflex.files.cell.cell import read_cell
from counterflex.programs.language import at_prompt, dialects
from counterflex.programs.reading import dialect_of, read_program_file

programs, cell_file, out = Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3])
cell = read_cell(cell_file)
said = {"dialects": list(dialects()), "to": list(at_prompt("convert")), "as": list(at_prompt("write"))}
converted = conversion.run(programs / "corner.ngc", cell_file, out / "converted", "melfa")
(name,) = converted["files"]
said["converted"] = {"off_um": converted["read_back_um"], "told": dialect_of(out / "converted" / name)}
back = conversion.run(out / "converted" / name, cell_file, out / "back", "gcode")
said["back"] = {"off_um": back["read_back_um"], "from": back["from"]}
one, two = (read_program_file(file) for file in (programs / "corner.ngc", out / "back" / back["files"][0]))
said["ends"] = [[m.p_end.tolist() for m in p.motions if m.kind != "rapid"] for p in (one, two)]
found = compensate(programs / "corner.ngc", cell, language="melfa", predict=False)
(out / "written").mkdir()
(name, text), = found.files.items()
(out / "written" / name).write_text(text)
program = Reading().program(out / "written" / name, cell)
wanted = found.plan.path.p_part_tcp + found.plan.correction_part
ends = np.array([m.p_end for m in program.motions])
begin, way = wanted[:-1], np.diff(wanted, axis=0)  # a point may lie between two rows of the plan
share = np.einsum("pnk,nk->pn", ends[:, None] - begin, way) / np.maximum(np.sum(way**2, axis=1), 1e-30)
nearest = begin + np.clip(share, 0.0, 1.0)[..., None] * way
said["written_off_m"] = float(np.linalg.norm(nearest - ends[:, None], axis=2).min(axis=1).max())
said["written"] = {"dialect": program.dialect, "speeds": sorted({m.spindle_rad_s for m in program.motions})}
again = compensate(out / "converted" / converted["files"][0], cell, predict=False)
said["again"] = {"language": again.summary["language"], "files": list(again.files)}
(out / "odd.prg").write_text("Mov P1\\nEnd\\n")
try:
    read_program_file(out / "odd.prg")
except CounterflexError as fault:
    said["fault"] = str(fault)
(out / "abb.prg").write_text((programs / "groove.mod").read_text())
said["abb"] = dialect_of(out / "abb.prg")
print(json.dumps(said))
"""


@pytest.fixture(scope="module")
def said(installed: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    """What a process says in which the package is installed from the start."""
    folder = tmp_path_factory.mktemp("melfa")
    text = (ROOT / "examples" / "cells" / "kr300_d16_small.toml").read_text(encoding="utf-8")
    (folder / "cell.toml").write_text(text + SPINDLE, encoding="utf-8")
    path = os.pathsep.join([str(installed), *sys.path])
    done = subprocess.run(
        [sys.executable, "-c", JOB, PROGRAMS, folder / "cell.toml", folder],
        capture_output=True, text=True, timeout=600, env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    result: dict[str, object] = json.loads(done.stdout)
    return result


@pytest.mark.long
def test_every_list_of_languages_has_it(said: dict[str, list[str]]) -> None:
    assert all("melfa" in said[key] for key in ("dialects", "to", "as"))


def test_a_conversion_and_the_way_back_keep_every_point(said: dict[str, dict[str, object]]) -> None:
    assert said["converted"]["told"] == said["back"]["from"] == "melfa"
    assert max(float(str(said[key]["off_um"])) for key in ("converted", "back")) < 0.1
    one, two = said["ends"]
    rest = iter(two)  # rapids are straight at the rapid speed there, and feeds on the way back
    assert len(one) > 1
    assert all(any(a == pytest.approx(b, abs=1e-7) for b in rest) for a in one)


def test_a_compensated_program_is_read_back_where_it_was_planned(said: dict[str, float]) -> None:
    assert said["written_off_m"] < 1e-7


def test_its_spindle_statements_are_read_by_the_table_of_the_cell_file(said: dict[str, Any]) -> None:
    assert said["written"]["dialect"] == "melfa"
    assert max(said["written"]["speeds"]) > 0.0


def test_its_own_programs_come_out_in_their_language(said: dict[str, dict[str, object]]) -> None:
    assert said["again"]["language"] == "melfa"


def test_what_cannot_be_read_is_refused_with_its_line(said: dict[str, str]) -> None:
    assert "odd.prg:1" in said["fault"]


def test_two_languages_with_one_ending_are_told_apart_by_their_first_lines(said: dict[str, str]) -> None:
    assert said["abb"] == "rapid"


def test_the_page_for_newcomers_quotes_the_registration() -> None:
    page = (ROOT / "docs" / "extend.md").read_text(encoding="utf-8")
    code = (Path(__file__).parent / "counterflex_example" / "melfa" / "__init__.py").read_text(encoding="utf-8")
    assert f"```python\n{code[code.index('LANGUAGE: Final') :]}```" in page
