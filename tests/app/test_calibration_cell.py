"""A cell file without the tables of milling: calibration works as with them, milling names what is missing."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from counterflex.app.campaign.campaign import run as campaign
from counterflex.app.compensation.compensate import run as compensate
from counterflex.app.identification import identify
from counterflex.app.identification.cell_model import model_of
from counterflex.app.proof.prove import run as prove
from counterflex.app.questions import check_cell
from counterflex.core.errors import FileFormatError
from counterflex.files.cell.cell import read_cell

EXAMPLES = Path(__file__).parents[2] / "examples"
PULLS = EXAMPLES / "data" / "fanuc_r2000ic_stiffness" / "pulls.toml"
HAND_EYE = EXAMPLES / "data" / "ur10_ipa_tmac" / "hand_eye.toml"
FANUC, UR10 = (EXAMPLES / "cells" / name for name in ("fanuc_r2000ic.toml", "ur10_ipa_tmac.toml"))
PROGRAM = EXAMPLES / "programs" / "groove.ngc"
MILLING = ("part", "tools", "material")
RUNS: dict[str, tuple[Path, Path, dict[str, bool]]] = {
    "stiffness": (PULLS, FANUC, {"regions": False}),
    "tracker-frame": (HAND_EYE, UR10, {}),
}


def without(cell: Path, folder: Path, *tables: str) -> Path:
    """The cell file without these tables."""
    content = tomllib.loads(cell.read_text(encoding="utf-8"))
    for table in tables:
        content.pop(table)
    file = folder / "bare.toml"
    file.write_text(tomli_w.dumps(content), encoding="utf-8")
    return file


@pytest.mark.parametrize("recipe", RUNS)
def test_identification_needs_nothing_of_milling(recipe: str, tmp_path: Path) -> None:
    data, cell, settings = RUNS[recipe]
    bare = without(cell, tmp_path, *MILLING)
    whole = identify.run(recipe, [data], cell, tmp_path / "whole", settings=settings)
    found = identify.run(recipe, [data], bare, tmp_path / "bare", settings=settings)
    assert whole["headline"] == found["headline"]
    written = read_cell(tmp_path / "bare" / "cell.toml")
    assert [entry.recipe for entry in written.tables.identified] == [recipe]
    assert written.missing_for_milling() == ("[part]", "[[tools]]", "[material]")


def jobs(cell: Path, folder: Path) -> dict[str, Callable[[], Any]]:
    return {
        "compensate": lambda: compensate(PROGRAM, cell, folder / "out"),
        "prove": lambda: prove(PROGRAM, cell, folder / "out", seeds=[1]),
        "campaign": lambda: campaign(cell, folder / "out", seeds=[1]),
    }


@pytest.mark.parametrize("job", ["compensate", "prove", "campaign"])
def test_milling_names_every_missing_table_in_one_line_and_writes_nothing(job: str, tmp_path: Path) -> None:
    bare = without(EXAMPLES / "cells" / "kr300_d16_small.toml", tmp_path, *MILLING)
    with pytest.raises(
        FileFormatError, match=r"bare\.toml: the cell file has no \[part\], \[\[tools\]\], \[material\]"
    ):
        jobs(bare, tmp_path)[job]()
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("table", MILLING)
def test_one_missing_table_is_named_alone(table: str, tmp_path: Path) -> None:
    bare = without(EXAMPLES / "cells" / "kr300_d16_small.toml", tmp_path, table)
    named = {"part": r"\[part\]", "tools": r"\[\[tools\]\]", "material": r"\[material\]"}[table]
    with pytest.raises(FileFormatError, match=f"the cell file has no {named}, which this job needs"):
        jobs(bare, tmp_path)["compensate"]()


def test_part_without_blank_says_where_the_work_is_and_no_more(tmp_path: Path) -> None:
    content = tomllib.loads((EXAMPLES / "cells" / "kr300_d16_small.toml").read_text(encoding="utf-8"))
    del content["part"]["stock"]
    file = tmp_path / "cell.toml"
    file.write_text(tomli_w.dumps(content), encoding="utf-8")
    cell = read_cell(file)
    assert cell.missing_for_milling() == ("[part.stock]",)
    np.testing.assert_array_equal(model_of(cell).T_base_part, cell.T_base_part)
    with pytest.raises(FileFormatError, match=r"the cell file has no \[part\.stock\]"):
        cell.stock()


def test_each_reading_of_what_is_missing_says_so(tmp_path: Path) -> None:
    bare = without(EXAMPLES / "cells" / "kr300_d16_small.toml", tmp_path, *MILLING)
    model = model_of(read_cell(bare))
    reads: dict[str, Callable[[], object]] = {
        r"\[material\]": lambda: model.force_law,
        r"\[part\]": lambda: model.T_base_part,
        r"\[\[tools\]\]": lambda: model.cutter_of(1),
    }
    for table, read in reads.items():
        with pytest.raises(FileFormatError, match=f"has no {table}"):
            read()
    answer = check_cell(str(bare))
    assert answer["force_law"] is None
    assert answer["softness"] == answer["tools"] == []
    assert any("good for calibration" in line for line in answer["warnings"])
