"""A RAPID module through the commands: frames from the cell file, compensated in place, compared."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

EXAMPLES = Path(__file__).parents[2] / "examples"
REST = "[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]"
SOURCE = f"""MODULE part
  CONST robtarget pIn:=[[-12,15,17],{REST}];
  PROC main()
    TPWrite "change to tool T1, then press start";
    Stop;
    TPWrite "start the spindle, 13000 rpm, then press start";
    Stop;
    MoveJ Offs(pIn,0,0,5),v500,z1,tMill\\WObj:=wPart;
    slot;
    MoveL [[10,15,40],{REST}],v200,fine,tMill\\WObj:=wPart;
  ENDPROC
  PROC slot()
    MoveL pIn,v20\\V:=25,z0,tMill\\WObj:=wPart;
    MoveL [[10,15,17],{REST}],v20\\V:=25,fine,tMill\\WObj:=wPart; ! the slot
  ENDPROC
ENDMODULE
"""


def named(folder: Path) -> None:
    """Name the frames of the controller in the cell file."""
    cell = (folder / "cell.toml").read_text(encoding="utf-8")
    cell = cell.replace("[[tools]]\n", '[[tools]]\ntooldata = "tMill"\n', 1)
    cell = cell.replace("[controller]\n", '[controller]\nwork_object = "wPart"\n', 1)
    (folder / "cell.toml").write_text(cell, encoding="utf-8")


def test_the_same_language_comes_out(folder: Path, counterflex: Any) -> None:
    """Compensated in place, compared, and not compensated twice."""
    named(folder)
    (folder / "part.mod").write_text(SOURCE.replace("\n", "\r\n"), encoding="utf-8", newline="")
    made = counterflex("compensate", "part.mod", "--cell", "cell.toml", "--out", "out", "--no-report", "--no-predict")
    assert made.status == 0, made.err
    written = (folder / "out" / "part.mod").read_bytes()
    assert b"\n" not in written.replace(b"\r\n", b"")
    said = counterflex("diff", "part.mod", "out/part.mod", "--json")
    about = json.loads(said.out)
    assert about["points_added"] > 0
    assert about["largest_line"] == 14
    refused = counterflex("compensate", "out/part.mod", "--cell", "cell.toml", "--out", "again")
    assert refused.status == 2
    assert "compensated already" in refused.err


def test_frames_that_no_one_names_are_refused(folder: Path, counterflex: Any) -> None:
    (folder / "part.mod").write_text(SOURCE, encoding="utf-8")
    ended = counterflex("compensate", "part.mod", "--cell", "cell.toml", "--out", "out")
    assert ended.status == 2
    assert "part.mod:8" in ended.err
    assert "controller.work_object" in ended.err
    assert not (folder / "out").exists()


def test_the_same_groove_gives_the_same_path(counterflex: Any) -> None:
    """The example is the groove of the G-code: the same places, but for the way there."""
    programs = ("groove.ngc", "groove.mod")
    made = [json.loads(counterflex("path", str(EXAMPLES / "programs" / name), "--json").out) for name in programs]
    first, second = ([(m["x_mm"], m["y_mm"], m["z_mm"]) for m in one["motions"]] for one in made)
    assert first[-4:] == second[-4:]
