"""Random programs of spindle, coolant, tools and stops: a robot program is in the state of RS274 at every point.

The reference below knows the rules of RS274 for eight words and shares no code with reader or writers.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from counterflex.integrations.abb.language.writer import RapidSettings, RapidWriter
from counterflex.integrations.kuka.language.writer import KrlSettings, KrlWriter
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.robot_writer.machine_functions import MachineFunctions

START = (0.0, -1.5, 1.6, 0.1, 0.5, -0.2)
SAID = {3: "ON {s}", 4: "BACK {s}", 5: "OFF", 6: "CHANGE {t}", 7: "MIST", 8: "FLOOD", 9: "DRY"}
WORDS = ("M3 S500", "M4 S700", "M5", "S0", "S900", "M7", "M8", "M9", "T1 M6", "T2 M6", "T0 M6", "M0", "move", "move M0")


@dataclass(frozen=True)
class State:
    """What a machine does while it moves."""

    rpm: int = 0
    tool: int = 0
    mist: bool = False
    flood: bool = False


def expected(words: list[str]) -> tuple[str, list[tuple[State, int]], State]:
    """Program, state of each move with the number of stops behind it, and state before the program ends."""
    state, way, speed, moves, lines = State(), 0, 0, [], ["G21 G90", "G0 X0 Y0 Z50"]
    moves.append((state, 0))
    for word in words:
        if word.startswith("move"):
            way += 1
            lines.append(f"G1 X{way} F600" + word[4:])
            moves.append((state, int(word.endswith("M0"))))
            continue
        lines.append(word)
        if word == "M0":
            moves[-1] = (moves[-1][0], moves[-1][1] + 1)
        elif word.startswith("T"):
            state = replace(state, rpm=0, tool=int(word[1]))
            speed = 0
        elif word[0] == "S" or word[:2] in ("M3", "M4"):
            rpm = int(word.split("S")[1])
            turning = -1 if word[:2] == "M4" else 1 if word[:2] == "M3" else speed
            state, speed = replace(state, rpm=turning * rpm), turning
        elif word == "M5":
            state, speed = replace(state, rpm=0), 0
        else:
            state = {
                "M7": replace(state, mist=True),
                "M8": replace(state, flood=True),
                "M9": replace(state, mist=False, flood=False),
            }[word]
    return "\n".join([*lines, "M2", ""]), moves, state


def seen(text: str, language: str) -> tuple[list[tuple[State, int]], State, list[tuple[str, str]]]:
    """The same, from a robot program; and each start of the spindle with the direction in which it turned before."""
    program = read_gcode(text, name="part.ngc")
    path = tool_path(program, step_m=1e-3)
    down = np.broadcast_to(np.diag([1.0, -1.0, -1.0]), (len(path), 3, 3))
    poses = CompensatedPath.nominal(path).poses(down)
    lines = MachineFunctions(language, {code: (f"DO {said}",) for code, said in SAID.items()}).lines
    if language == "krl":
        frames = KrlSettings(name="part", start_axes_rad=START, tool_data={1: 5, 2: 6})
        result, suffix = KrlWriter(program, path, poses, frames, block_lines=lines).text(), "src"
    else:
        base = RapidSettings(name="part", start_axes_rad=START, T_flange_tcp=np.eye(4), T_base_part=np.eye(4))
        named = replace(base, tool_data={1: "t5", 2: "t6"})
        result, suffix, move, stop = (
            RapidWriter(program, path, poses, named, block_lines=lines).text(),
            "mod",
            "MoveL",
            "Stop;",
        )
    move, stop = ("LIN", "HALT") if language == "krl" else ("MoveL", "Stop;")
    state, frame, place = State(), "", ""
    moves: list[tuple[State, int]] = []
    starts: list[tuple[str, str]] = []
    for line in _in_order(result.files, suffix):
        if match := re.fullmatch(r"DO (\w+) ?(\d*)", line):
            word, number = match[1], int(match[2] or 0)
            if word in ("ON", "BACK"):
                starts.append((word, "" if state.rpm == 0 else "ON" if state.rpm > 0 else "BACK"))
            state = {
                "ON": replace(state, rpm=number),
                "BACK": replace(state, rpm=-number),
                "OFF": replace(state, rpm=0),
                "CHANGE": replace(state, tool=number),
                "MIST": replace(state, mist=True),
                "FLOOD": replace(state, flood=True),
                "DRY": replace(state, mist=False, flood=False),
            }[word]
            place = "" if word == "CHANGE" else place
        elif match := re.match(r"\$TOOL=TOOL_DATA\[(\d)\]", line):
            frame = match[1]
        elif line.startswith(move):
            frame = re.findall(r",t(\d|_part)\\WObj", line)[0] if language == "rapid" else frame
            assert state.tool == 0 or frame == str(state.tool + 4)
            now = re.findall(r"-?\d+\.\d{4}", line)[0]
            if place == "" and moves:  # the way back from a change of tool
                assert now == f"{len(moves) - 1}.0000"
            else:
                moves.append((state, 0))
                assert now == f"{len(moves) - 1}.0000"
            place = now
        elif line == stop:
            moves[-1] = (moves[-1][0], moves[-1][1] + 1)
    return moves, state, starts


def _in_order(files: dict[str, str], suffix: str) -> list[str]:
    out: list[str] = []
    for line in map(str.strip, files[f"part.{suffix}"].splitlines()):
        called = re.fullmatch(r"(part_\d{3})(?:\( \)|;)", line)
        out += map(str.strip, files[f"{called[1]}.{suffix}"].splitlines()) if called else [line]
    return out


@pytest.mark.parametrize("language", ["krl", "rapid"])
@example(words=["M3 S500", "move", "S0", "move", "S900", "move"])
@example(words=["M4 S700", "S0"])
@example(words=["M3 S500", "move", "M4 S700", "move M0", "T0 M6", "move", "T2 M6"])
@settings(max_examples=60, deadline=None)
@given(words=st.lists(st.sampled_from(WORDS), min_size=1, max_size=14))
def test_every_move_is_made_in_the_state_of_rs274(language: str, words: list[str]) -> None:
    # A word before each move keeps moves apart: two in line with nothing between them may become one.
    apart = [item for word in words for item in (["M8", word] if word.startswith("move") else [word])]
    text, moves, last = expected(apart)
    robot, end, starts = seen(text, language)
    assert robot == moves
    assert (end.rpm, end.mist, end.flood) == (0, False, False)
    assert end.tool == last.tool
    assert all(before in ("", direction) for direction, before in starts), "turned round without a stop"
