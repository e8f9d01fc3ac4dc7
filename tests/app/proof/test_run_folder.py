"""A folder that ``simulate`` wrote stands for itself: it is evaluated without the files it was made from."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh

from counterflex.app.proof import evaluate, simulate
from counterflex.app.proof.truth import make_truth
from counterflex.core.errors import InputError
from counterflex.files.cell.cell import read_cell

SHORT = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 X-12 Y15 Z42\nG0 Z38\nG1 X8 F1500\nG0 Z42\nM5\nM2\n"


def machined(folder: Path, small: Path, top_mm: float, out: str) -> Path:
    """Machine a short cut into a blank that the cell file names as a mesh beside it."""
    folder.mkdir()
    box = trimesh.creation.box(bounds=[[0, 0, 0], [40, 30, top_mm]])
    box.export(folder / "casting.stl")
    text = small.read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith(("box_min_mm", "box_max_mm"))]
    lines.insert(lines.index("[part.stock]") + 1, 'stl = "casting.stl"')
    (folder / "cell.toml").write_text("\n".join(lines), encoding="utf-8")
    (folder / "part.ngc").write_text(SHORT, encoding="ascii")
    make_truth(read_cell(folder / "cell.toml"), 1, folder / "truth.toml")
    simulate.run(folder / "part.ngc", folder / "cell.toml", folder / "truth.toml", folder.parent / out)
    for file in folder.iterdir():
        file.unlink()
    return folder.parent / out


def test_a_run_is_evaluated_when_its_sources_are_gone(tmp_path: Path, small: Path) -> None:
    run = machined(tmp_path / "source", small, 40.0, "run")
    found = evaluate.run([run], None)
    assert found["variants"]["nominal"]["surface"]["area_mm2"] > 100.0


def test_runs_on_different_blanks_are_not_compared(tmp_path: Path, small: Path) -> None:
    runs = [machined(tmp_path / f"source{top}", small, top, f"run{top}") for top in (40.0, 39.5)]
    with pytest.raises(InputError, match="blanks differ"):
        evaluate.run(runs, None)


@pytest.mark.parametrize(("seed", "level"), [(None, "exact"), (0, "catalogue")])
def test_truth_level_follows_from_the_truth(seed: int | None, level: str, small: Path, tmp_path: Path) -> None:
    (tmp_path / "part.ngc").write_text(SHORT, encoding="ascii")
    make_truth(read_cell(small), seed, tmp_path / "truth.toml")
    simulate.run(tmp_path / "part.ngc", small, tmp_path / "truth.toml", tmp_path / "run")
    found = evaluate.run([tmp_path / "run"], None)
    assert (found["truth_level"], found["seeds"][0]["seed"]) == (level, seed)
