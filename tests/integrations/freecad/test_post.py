"""FreeCAD's post-processor ``counterflex``: with a stand-in for FreeCAD's modules, and in FreeCAD itself."""

from __future__ import annotations

import os
import runpy
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from counterflex.app.add_ins import ADD_INS, write
from counterflex.app.robot_programs import robot_cell
from counterflex.files.cell.cell import read_cell
from counterflex.programs.reading import read_program_file

EXAMPLES = Path(__file__).parents[3] / "examples"
CELL = EXAMPLES / "cells" / "kr300_d16_small.toml"
GCODE = (EXAMPLES / "programs" / "groove.ngc").read_text(encoding="utf-8")
FREECAD = shutil.which("freecadcmd") or shutil.which("FreeCADCmd")


@pytest.fixture
def export(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """``export`` of the script as `add-in` writes it, in a FreeCAD whose own post says the groove."""
    own = ModuleType("Path.Post.scripts.linuxcnc_post")
    own.export = lambda _objects, filename, _arguments: GCODE if filename == "-" else None  # type: ignore[attr-defined]
    for name in ("Path", "Path.Post", "Path.Post.scripts"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setitem(sys.modules, own.__name__, own)
    result: Callable[..., str] = runpy.run_path(str(write(ADD_INS["freecad"], tmp_path / "macro")))["export"]
    return result


def job(diameter_mm: float) -> list[Any]:
    """Tool controller and operation of a job."""
    tool = SimpleNamespace(Diameter=SimpleNamespace(Value=diameter_mm))  # a length of FreeCAD, mm inside
    return [SimpleNamespace(ToolNumber=1, Tool=tool), SimpleNamespace(Path=None)]


@pytest.mark.long
def test_a_job_comes_back_in_the_language_of_the_robot(export: Callable[..., str], tmp_path: Path) -> None:
    out = tmp_path / "part.src"
    arguments = f"--no-show-editor --cell {CELL} --as krl --assume-class --no-predict --no-report --without-preflight"
    text = export(job(16.0), str(out), arguments)
    assert out.read_text(encoding="utf-8") == text
    assert "DEF part(" in text
    assert "(T1 D=16 mm)" in text
    assert (tmp_path / "part.dat").is_file()
    assert (tmp_path / "part-counterflex" / "plan.parquet").is_file()


@pytest.mark.long
def test_a_tool_of_another_diameter_than_in_the_cell_stops_the_job(export: Callable[..., str], tmp_path: Path) -> None:
    out = tmp_path / "part.src"
    with pytest.raises(RuntimeError, match="another tool than the cell file: line 1 names 8 mm for T1, the cell 16 mm"):
        export(job(8.0), str(out), f"--cell={CELL} --as=krl")
    assert not list(tmp_path.glob("part*"))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("--as=krl", "names no cell file"),
        (f"--cell={CELL} --as=cobol --without-preflight", "cannot be compensated(.|\n)*cobol"),
        (r"--cell=C:\cells\arm.toml --without-preflight", r"C:\\cells\\arm\.toml"),
        (f"--cell={CELL} --unknown=1 --without-preflight", "cannot be compensated(.|\n)*--unknown"),
    ],
)
def test_what_the_job_asks_wrongly_is_refused(
    export: Callable[..., str], tmp_path: Path, arguments: str, says: str
) -> None:
    with pytest.raises(RuntimeError, match=says):
        export(job(16.0), str(tmp_path / "part.src"), arguments)
    assert not list(tmp_path.glob("part*"))


def in_freecad(folder: Path, cell: Path) -> subprocess.CompletedProcess[str]:
    """Run the example job in FreeCAD, with the post-processor in its macro folder."""
    write(ADD_INS["freecad"], folder / "FreeCAD" / "Macro")
    environment = {
        **os.environ,
        "XDG_DATA_HOME": str(folder),
        "XDG_CONFIG_HOME": str(folder),
        "PART_PROGRAM": str(folder / "pocket.src"),
        "PART_ARGUMENTS": f"--cell={cell} --as=krl --assume-class --no-predict --no-report",
    }
    call = [str(FREECAD), str(EXAMPLES / "freecad" / "pocket_job.py")]
    return subprocess.run(call, capture_output=True, text=True, env=environment, cwd=folder, check=False)


@pytest.mark.long
@pytest.mark.skipif(FREECAD is None, reason="FreeCAD is not installed")
def test_a_pocket_of_freecad_becomes_a_program_of_the_robot(tmp_path: Path) -> None:
    done = in_freecad(tmp_path, CELL)
    out = tmp_path / "pocket.src"
    assert out.is_file(), done.stdout + done.stderr
    program = read_program_file(out, cell=robot_cell(read_cell(CELL), "krl"))
    cut = [motion.p_end for motion in program.motions if motion.p_end[2] < 0.039]
    # Pocket 15 to 45, 15 to 41, floor at 34 mm, by a tool of 16 mm: its axis stays in 23 to 37, 23 to 33, but for the
    # correction, which preflight holds below 3 mm
    assert len(cut) > 10
    for axis, (low, high) in enumerate(((0.023, 0.037), (0.023, 0.033), (0.034, 0.039))):
        values = [point[axis] for point in cut]
        assert low - 0.003 < min(values) < low + 0.003
        assert high - 0.004 < max(values) < high + 0.003


@pytest.mark.long
@pytest.mark.skipif(FREECAD is None, reason="FreeCAD is not installed")
def test_freecad_says_why_a_job_is_refused(tmp_path: Path) -> None:
    cell = tmp_path / "cell.toml"
    text = CELL.read_text(encoding="utf-8")
    cell.write_text(text.replace("diameter_mm = 16", "diameter_mm = 12", 1), encoding="utf-8")
    done = in_freecad(tmp_path, cell)
    assert "another tool than the cell file: line 1 names 16 mm for T1, the cell 12 mm" in done.stdout + done.stderr
    assert not (tmp_path / "pocket.src").exists()
