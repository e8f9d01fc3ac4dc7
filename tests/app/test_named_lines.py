"""Lines of a job of several files are named with their file, in rows and in sentences."""

from __future__ import annotations

from pathlib import Path

from counterflex.app.robot_programs import with_files
from counterflex.programs.difference import differences, summary
from counterflex.programs.reading import read_program_file

MAIN = "DEF job( )\n$BASE=BASE_DATA[1]\n$VEL.CP=0.02\nLIN {X 0.0,Y 0.0,Z 5.0,A 0.0,B 0.0,C 180.0}\nCUT( )\nEND\n"
CUT = "DEF CUT( )\n; first\n; second\n; third\n; fourth\n; fifth\n; sixth\nLIN {X 20.0}\nLIN {X 40.0}\nEND\n"
DATA = {
    "worst": {"line": 8, "value": 1.0},
    "lines": [4, 9],
    "warnings": ["the arm swings in line 8, 9 and more", "lines 4 to 9: all, 3 mm", "outline 8", "line 8.5"],
    "rows": ({"line": None}, {"line": 4, "place": "own"}),
}


def test_of_several_files(tmp_path: Path) -> None:
    (tmp_path / "job.src").write_text(MAIN, encoding="utf-8")
    (tmp_path / "CUT.src").write_text(CUT, encoding="utf-8")
    named = with_files(DATA, read_program_file(tmp_path / "job.src"))
    assert named["worst"] == {"line": 8, "value": 1.0, "place": "CUT.src:8"}
    assert named["lines"] == [4, 9]
    assert named["places"] == ["job.src:4", "CUT.src:9"]
    assert named["warnings"] == [
        "the arm swings in CUT.src:8, CUT.src:9 and more", "job.src:4 to CUT.src:9: all, 3 mm", "outline 8", "line 8.5",
    ]  # fmt: skip
    assert named["rows"] == ({"line": None}, {"line": 4, "place": "own"})


def test_of_one_file(tmp_path: Path) -> None:
    (tmp_path / "job.src").write_text(MAIN.replace("CUT( )\n", "LIN {X 20.0}\n"), encoding="utf-8")
    assert with_files(DATA, read_program_file(tmp_path / "job.src")) is DATA


def test_a_difference_names_the_file_of_a_changed_line(tmp_path: Path) -> None:
    for name, x in (("old", "20.0"), ("new", "20.5")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "job.src").write_text(MAIN, encoding="utf-8")
        (tmp_path / name / "CUT.src").write_text(CUT.replace("X 20.0", f"X {x}"), encoding="utf-8")
    before, after = (read_program_file(tmp_path / name / "job.src") for name in ("old", "new"))
    changes = differences(before, after)
    (row,) = (change.shown() for change in changes if change.changed)
    assert (row["place_before"], row["place_after"], row["x_um"]) == ("CUT.src:8", "CUT.src:8", 500.0)
    assert summary(before, after, changes)["largest_place"] == "CUT.src:8"
