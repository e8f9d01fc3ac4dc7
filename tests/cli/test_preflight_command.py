"""``counterflex preflight``: table, JSON, page, exit status; nothing half-written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

KRL = """DEF part( )
$TOOL=TOOL_DATA[1]
$BASE=BASE_DATA[1]
$VEL.CP=0.02
PTP {X 0,Y 0,Z 60,A 180,B 0,C 180}
LIN {X 10,Y 0,Z 60,A 180,B 0,C 180}
END
"""


def test_table_and_page(folder: Path, counterflex: Any) -> None:
    ended = counterflex("preflight", "part.ngc", "--cell", "cell.toml", "--out", "out")
    assert ended.status == 0, ended.err
    for word in ("joint limits", "line", "  look-ahead: controller.look_ahead_blocks", "0 fail"):
        assert word in ended.out
    summary = json.loads((folder / "out" / "summary.json").read_text())
    assert (summary["format"], summary["failed"]) == ("counterflex-summary", False)
    page = (folder / "out" / "report.html").read_text()
    figures = json.loads(page.split('id="figures">')[1].split("</script>")[0])
    figure = figures["margins"]
    assert [trace["name"] for trace in figure["data"]] == [f"axis {n}" for n in range(1, 7)]
    assert any("joint limits" in note["text"] for note in figure["layout"]["annotations"])
    assert "[[cell.body]]" in page
    assert set(figures) == {"margins", "path_speed", "joint_speed", "joint_acceleration", "point_distance"}
    programmed, held, _ = (trace["y"] for trace in figures["path_speed"]["data"])
    both = [(a, b) for a, b in zip(programmed, held, strict=True) if a is not None and b is not None]
    assert both
    assert all(b <= a * 1.001 for a, b in both)
    assert figures["joint_speed"]["layout"]["yaxis"]["title"]["text"] == "joint speed, % of its limit"
    assert figures["joint_acceleration"]["layout"]["yaxis"]["title"]["text"] == "joint acceleration, deg/s2"
    for word in ("path speed held", "mm/min", "approximation to points", "program size"):
        assert word in ended.out


def test_a_check_that_fails_ends_with_one(folder: Path, counterflex: Any) -> None:
    """The pair: the same program on the same cell, 3 m farther away."""
    text = (folder / "cell.toml").read_text()
    assert "x_mm = 1350" in text
    (folder / "cell.toml").write_text(text.replace("x_mm = 1350", "x_mm = 4350"))
    ended = counterflex("preflight", "part.ngc", "--cell", "cell.toml", "--out", "out", "--json")
    assert ended.status == 1
    printed = json.loads(ended.out)
    assert printed["failed"]
    reach = next(row for row in printed["checks"] if row["check"] == "reach")
    assert (reach["verdict"], reach["line"], len(reach["at_mm"])) == ("fail", 4, 3)
    assert "No point of the program is reached" in (folder / "out" / "report.html").read_text()


def test_the_language_of_the_robot_can_be_named(folder: Path, counterflex: Any) -> None:
    ended = counterflex("preflight", "part.ngc", "--cell", "cell.toml", "--as", "fanuc", "--json")
    size = next(row for row in json.loads(ended.out)["checks"] if row["check"] == "program size")
    assert (size["limit"], size["what"]) == (1400.0, "motions in FANUC TP without corrections: one file, part")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("absent.ngc", "--cell", "cell.toml"), "no such file"),
        (("part.ngc", "--cell", "absent.toml"), "no such file"),
        (("cell.toml", "--cell", "part.ngc"), "part.ngc"),
        (("part.ngc", "--cell", "cell.toml", "--out", "cell.toml"), "a file has the name"),
        (("part.ngc", "--cell", "cell.toml", "--dialect", "siemens"), "linuxcnc"),
        (("part.ngc", "--cell", "cell.toml", "--as", "gcode"), "rapid, fanuc, krl, val3"),
        (("part.src", "--cell", "cell.toml", "--as", "fanuc"), "language of another robot"),
    ],
)
def test_bad_input_is_told_in_one_line(folder: Path, refused: Any, words: tuple[str, ...], told: str) -> None:
    if "part.src" in words:
        (folder / "part.src").write_text(KRL)
    before = sorted(folder.iterdir())
    assert told in refused("preflight", *words)
    assert sorted(folder.iterdir()) == before
