"""Before every function of the machine the robot stands, in every language that is written.

Random programs of motions, functions, dwells and stops; the texts are read by a scanner of their own.
"""

from __future__ import annotations

import re
from typing import Any, Final

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.integrations.abb.language.writer import RapidSettings, RapidWriter
from counterflex.integrations.fanuc.language.writer import FanucSettings, FanucWriter
from counterflex.integrations.kuka.language.writer import KrlSettings, KrlWriter
from counterflex.integrations.staubli.language.job import Val3Settings, Val3Writer
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.robot_writer.machine_functions import MachineFunctions

ABOUT: Final[dict[str, Any]] = {"name": "part", "start_axes_rad": (0.0, -1.5, 1.6, 0.1, 0.5, -0.2)}
EYE = np.eye(4)
WRITERS: Final[dict[str, tuple[Any, Any, str]]] = {
    "krl": (KrlWriter, KrlSettings(**ABOUT), "src"),
    "rapid": (RapidWriter, RapidSettings(**ABOUT, T_flange_tcp=EYE, T_base_part=EYE), "mod"),
    "fanuc": (FanucWriter, FanucSettings(**ABOUT), "ls"),
    "val3": (Val3Writer, Val3Settings(**ABOUT, T_flange_tcp=EYE, T_world_part=EYE), "pgx"),
}
MOTION: Final = {"krl": r"LIN |PTP |CIRC ", "rapid": r"Move\w+ ", "fanuc": r"[LJC] P\[", "val3": r"move\w\("}
STANDS: Final = {
    "krl": lambda motion, behind: "C_DIS" not in motion and "WAIT SEC 0.0" in behind,
    "rapid": lambda motion, behind: ",fine," in motion,  # noqa: ARG005
    "fanuc": lambda motion, behind: "FINE" in motion and "CNT" not in motion,  # noqa: ARG005
    "val3": lambda motion, behind: "waitEndMove()" in behind,  # noqa: ARG005
}
"""By the motion before a function and the lines between: two controllers run ahead unless they are told to wait."""
OPS = st.lists(st.sampled_from(["move", "move", "move", "M8", "M9", "M7", "S900", "M5", "M3 S500", "M4 S300", "G4 P0.5",
                                "M0", "move M9"]), min_size=2, max_size=20)  # fmt: skip


def written(language: str, text: str) -> list[str]:
    program = read_gcode(text, name="part.ngc")
    path = tool_path(program, step_m=1.0)
    down = np.broadcast_to(np.diag([1.0, -1.0, -1.0]), (len(path), 3, 3))
    writer, about, suffix = WRITERS[language]
    said = {code: (f"DO M{code}",) for code in (3, 4, 5, 6, 7, 8, 9)}
    functions = MachineFunctions(language, said)
    poses = CompensatedPath.nominal(path).poses(down)
    made = writer(program, path, poses, about, block_lines=functions.lines).text()
    lines = made.files[f"part.{suffix}"].splitlines()
    return [re.sub(r"^\s*\d*:\s*", "", line).strip() for line in lines]


@pytest.mark.parametrize("language", WRITERS)
@settings(max_examples=25)
@given(ops=OPS)
def test_the_robot_stands_before_every_function_dwell_and_stop(language: str, ops: list[str]) -> None:
    way = 0
    text = ["G21 G90 F600", "G0 X0 Y0 Z50"]
    for op in ops:
        way += op.startswith("move")
        text.append(f"G1 X{way} Y{way % 3}{op[4:]}" if op.startswith("move") else op)
    lines = written(language, "\n".join([*text, "M2", ""]))
    motion, functions, moves = "", 0, 0
    behind: list[str] = []
    for line in lines:
        if re.match(MOTION[language], line):
            motion, behind, moves = line, [], moves + 1
        elif line.startswith("DO M"):
            functions += 1
            assert motion
            assert STANDS[language](motion, behind), (motion, behind, line)
            behind.append(line)
        elif re.match(r"HALT|Stop;|PAUSE|get\(\)|WaitTime|WAIT +0?\.5|WAIT SEC 0\.5|delay\(0\.5", line):
            assert STANDS[language](motion, [*behind, "WAIT SEC 0.0"]), (motion, behind, line)
            behind.append(line)
        else:
            behind.append(line)
    assert moves >= 2
    assert functions >= sum(op in ("M7", "M8") for op in ops)
