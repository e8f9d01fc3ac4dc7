"""Listings of FANUC TP and a cell to read them in, for tests."""

from __future__ import annotations

import numpy as np

from counterflex.geometry import pose
from counterflex.programs.robot_text.cell import NumberedCell
from counterflex.programs.robot_writer.machine_functions import MachineFunctions

DOWN = (180.0, 0.0, 180.0)


def entry(number: int, x: float, y: float, z: float, wpr: tuple[float, float, float] = DOWN, more: str = "") -> str:
    """An entry of /POS."""
    w, p, r = wpr
    return (
        f"P[{number}]{{\n   GP1:\n\tUF : 1, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\n"
        f"\tX = {x:9.3f}  mm,\tY = {y:9.3f}  mm,\tZ = {z:9.3f}  mm,\n"
        f"\tW = {w:9.3f} deg,\tP = {p:9.3f} deg,\tR = {r:9.3f} deg{more}\n}};\n"
    )


def listing(*statements: str, entries: str = "") -> str:
    """A listing with numbered lines."""
    lines = "".join(f"{n:4d}:{statement} ;\n" for n, statement in enumerate(statements, start=1))
    return f"/PROG  PART\n/ATTR\nOWNER\t= MNEDITOR;\n/MN\n{lines}/POS\n{entries}/END\n"


def cell(**changes: object) -> NumberedCell:
    """A cell with one tool and statements for the spindle."""
    table = MachineFunctions("fanuc", {
        3: ["GO[1]={s}", "DO[1:spindle]=ON"], 5: ["DO[1:spindle]=OFF"], 6: ["CALL TOOLCHG({t})"],
    })  # fmt: skip
    about: dict[str, object] = {
        "where": "cell.toml", "tools": [4], "T_flange_tcp": pose.make(np.eye(3), np.array([0.0, 0.0, 0.1])),
        "T_base_part": np.eye(4), "functions": table, "tool_number": 1, "base_number": 1, "tool_of_data": {},
    }  # fmt: skip
    return NumberedCell(**(about | changes))  # type: ignore[arg-type]
