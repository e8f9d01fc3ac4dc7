"""INFORM jobs and a cell to read them in, for tests."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from counterflex.geometry import pose
from counterflex.integrations.yaskawa.language.frames import InformCell
from counterflex.programs.robot_writer.machine_functions import MachineFunctions

DOWN = (180.0, 0.0, 180.0)
HEADER = ("///USER 1", "///TOOL 1", "///POSTYPE USER", "///RECTAN", "///RCONF 1,0,0,0,0,0,0,0")


def point(kind: str, index: int, xyz: Sequence[float], turn: Sequence[float] = DOWN) -> str:
    """An entry of //POS."""
    x, y, z = xyz
    a, b, c = turn
    return f"{kind}{index:05d}={x:.3f},{y:.3f},{z:.3f},{a:.4f},{b:.4f},{c:.4f}"


def points(*places: Sequence[float], turn: Sequence[float] = DOWN) -> list[str]:
    """Entries C00000 and on."""
    return [point("C", index, place, turn) for index, place in enumerate(places)]


def job(*lines: str, entries: Sequence[str] = (), header: Sequence[str] = HEADER, name: str = "PART") -> str:
    """A job."""
    count = sum(entry.startswith("C") for entry in entries)
    head = ["/JOB", f"//NAME {name}", "//POS", f"///NPOS {count},0,0,0,0,0", *header, *entries]
    about = ["//INST", "///DATE 2026/01/02 03:04", "///ATTR SC,RW", "///GROUP1 RB1", "NOP"]
    return "\n".join([*head, *about, *lines, "END", ""])


def cell(**changes: object) -> InformCell:
    """A cell with one tool and instructions for the spindle."""
    table = MachineFunctions("inform", {
        3: ["AOUT AO#(1) {s}", "DOUT OT#(1) ON"], 5: ["DOUT OT#(1) OFF"], 6: ["CALL JOB:TOOL{t}"],
    })  # fmt: skip
    about: dict[str, object] = {
        "where": "cell.toml", "tools": [4], "T_flange_tcp": pose.make(np.eye(3), np.array([0.0, 0.0, 0.1])),
        "T_base_part": np.eye(4), "functions": table, "tool_number": 1, "base_number": 1, "tool_of_data": {},
    }  # fmt: skip
    return InformCell(**(about | changes))  # type: ignore[arg-type]
