"""The reader against LinuxCNC's own interpreter: motions, feeds, spindle, tools and dwells of every corpus program."""

from __future__ import annotations

import importlib.util
import math
import re
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from counterflex.core.units import DEG, INCH, MM, MM_PER_MIN, RPM
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.program import Motion, Program

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "tests" / "data" / "gcode"
PROGRAMS = sorted(DATA.rglob("*.ngc"))
# LinuxCNC prints four decimals of the program's unit; half a digit of the target and half of each offset.
DIGIT = 0.6e-4


def golden_tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_rs274_golden", ROOT / "tools" / "make_rs274_golden.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


TOOL = golden_tool()


@dataclass
class Canon:
    """One motion as LinuxCNC sees it, in m, rad and s."""

    kind: str
    p_end: tuple[float, ...]
    abc_end: tuple[float, ...]
    feed_m_s: float
    spindle_rad_s: float
    tool: int
    duration_s: float = 0.0
    p_centre: tuple[float, float, float] | None = None
    turns: int = 0
    plane: int = 17
    digit_m: float = DIGIT * MM


PLANES = {"XY": (17, 0, 1, 2), "XZ": (18, 2, 0, 1), "YZ": (19, 1, 2, 0)}


class Canonical:
    """Interprets canonical calls: offsets are added, standing moves left out."""

    def __init__(self) -> None:
        self.unit, self.plane = MM, "XY"
        self.g5x, self.g92, self.place = [0.0] * 6, [0.0] * 6, [0.0] * 6
        self.length = [0.0] * 3
        self.feed = self.speed = 0.0
        self.turning = self.tool = self.selected = 0
        self.motions: list[Canon] = []

    def scale(self) -> list[float]:
        return [self.unit] * 3 + [DEG] * 3

    def scaled(self, values: list[float]) -> list[float]:
        return [value * factor for value, factor in zip(values, self.scale(), strict=True)]

    def to_part(self, values: list[float]) -> list[float]:
        return [sum(parts) for parts in zip(self.scaled(values), self.g5x, self.g92, strict=True)]

    def add(self, kind: str, end: list[float]) -> Canon:
        feed = self.feed if kind in ("feed", "arc") else 0.0
        spindle = self.turning * self.speed * RPM
        motion = Canon(kind, tuple(end[:3]), tuple(end[3:]), feed, spindle, self.tool, digit_m=DIGIT * self.unit)
        self.motions.append(motion)
        return motion

    def call(self, name: str, inside: str, numbers: list[float]) -> None:
        if name == "USE_LENGTH_UNITS":
            self.unit = INCH if "INCHES" in inside else MM
        elif name == "SET_G5X_OFFSET":
            self.g5x = self.scaled(numbers[1:])
        elif name == "SET_G92_OFFSET":
            self.g92 = self.scaled(numbers)
        elif name == "USE_TOOL_LENGTH_OFFSET":
            new = [value * self.unit for value in numbers[:3]]
            self.place[:3] = [p + old - now for p, old, now in zip(self.place[:3], self.length, new, strict=True)]
            self.length = new
        elif name == "SELECT_PLANE":
            self.plane = inside[-2:]
        elif name == "SET_FEED_RATE":
            self.feed = numbers[0] * self.unit / 60.0
        elif name == "SET_SPINDLE_SPEED":
            self.speed = numbers[1]
        elif name in ("START_SPINDLE_CLOCKWISE", "START_SPINDLE_COUNTERCLOCKWISE"):
            self.turning = 1 if name.endswith("E_CLOCKWISE") else -1
        elif name in ("STOP_SPINDLE_TURNING", "ORIENT_SPINDLE"):
            self.turning = 0
        elif name == "SELECT_TOOL":
            self.selected = int(numbers[0])
        elif name in ("CHANGE_TOOL", "CHANGE_TOOL_NUMBER"):
            self.tool = self.selected if name == "CHANGE_TOOL" else int(numbers[0])
        elif name == "DWELL":
            self.add("dwell", self.place).duration_s = numbers[0]
        elif name in ("STRAIGHT_TRAVERSE", "STRAIGHT_FEED"):
            end = self.to_part(numbers)
            if not np.allclose(end, self.place, rtol=0.0, atol=2.0 * DIGIT * self.unit):
                self.add("rapid" if name.endswith("TRAVERSE") else "feed", end)
            self.place = end
        elif name == "ARC_FEED":
            self.arc(numbers)

    def arc(self, numbers: list[float]) -> None:
        code, first, second, third = PLANES[self.plane]
        values, centre = [0.0, 0.0, 0.0, *numbers[6:9]], [0.0] * 6
        values[first], values[second], values[third] = numbers[0], numbers[1], numbers[5]
        centre[first], centre[second] = numbers[2], numbers[3]
        middle = self.to_part(centre)
        middle[third] = self.place[third]
        self.place = self.to_part(values)
        motion = self.add("arc", self.place)
        motion.p_centre = (middle[0], middle[1], middle[2])
        motion.turns, motion.plane = int(numbers[4]), code


def canonical_motions(calls: list[str]) -> list[Canon]:
    reader = Canonical()
    for call in calls:
        name, inside = call[:-1].split("(", 1)
        reader.call(name, inside, [float(value) for value in re.findall(r"-?\d+(?:\.\d+)?", inside)])
    return reader.motions


def moving(program: Program) -> list[Motion]:
    return [
        motion
        for motion in program.motions
        if motion.kind in ("arc", "dwell")
        or float(np.abs(motion.p_end - motion.p_start).max()) > 2.0 * DIGIT * MM
        or motion.abc_end != motion.abc_start
    ]


def read(path: Path, plain: bool = True) -> Program:
    return read_gcode(
        path.read_text(encoding="utf-8"),
        name=path.name,
        machine=MillingMachine(
            TOOL.PARAMETERS, tool_lengths={number: length * MM for number, length in TOOL.TOOL_LENGTHS_MM.items()}
        ),
        complete=True,
        plain_lines=plain,
    )


def compare(program: Program, canon: list[Canon]) -> None:
    ours = moving(program)
    for number, (motion, truth) in enumerate(zip(ours, canon, strict=False)):
        where = f"motion {number}, line {program.blocks[motion.block].line}: {program.blocks[motion.block].text}"
        tolerance = 4.0 * truth.digit_m
        assert motion.kind == truth.kind, where
        assert motion.p_end == pytest.approx(truth.p_end, abs=tolerance), where
        assert motion.abc_end == pytest.approx(truth.abc_end, abs=2e-6), where
        assert motion.tool == truth.tool, where
        assert motion.duration_s == pytest.approx(truth.duration_s, abs=1e-4), where
        if motion.kind != "dwell" and program.blocks[motion.block].modal.feed_mode == 94 and motion.feed_rad_s == 0.0:
            assert motion.feed_m_s == pytest.approx(truth.feed_m_s, abs=1e-4 * MM_PER_MIN * 30.0), where
        if motion.kind in ("feed", "arc"):
            assert motion.spindle_rad_s == pytest.approx(truth.spindle_rad_s, abs=1e-3), where
        if motion.kind == "arc":
            assert motion.p_centre is not None
            assert motion.p_centre == pytest.approx(truth.p_centre, abs=tolerance), where
            assert math.copysign(1.0, motion.turn_rad) == math.copysign(1.0, truth.turns), where
            assert math.ceil(abs(motion.turn_rad) / (2.0 * math.pi) - 1e-6) == abs(truth.turns), where
            assert program.blocks[motion.block].modal.plane == truth.plane, where
    assert len(ours) == len(canon)


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: path.stem)
def test_motions_are_those_of_linuxcnc(path: Path) -> None:
    calls = path.with_suffix(".canon").read_text(encoding="ascii").splitlines()
    compare(read(path), canonical_motions(calls))


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: path.stem)
def test_short_way_gives_the_same_program(path: Path) -> None:
    short, full = read(path), read(path, plain=False)
    assert short.blocks == full.blocks
    assert short.straight == full.straight
    assert len(short.motions) == len(full.motions)
    for one, other in zip(short.motions, full.motions, strict=True):
        assert repr(one) == repr(other)


def test_corpus_is_all_there() -> None:
    assert len(PROGRAMS) >= 22
    assert all(path.with_suffix(".canon").is_file() for path in PROGRAMS)


def test_golden_files_are_what_the_interpreter_says_now() -> None:
    """Runs LinuxCNC where tools/fetch_rs274.sh has fetched it; the golden files stand for it elsewhere."""
    for path in PROGRAMS if TOOL.RS274.exists() else []:
        golden = path.with_suffix(".canon").read_text(encoding="ascii").splitlines()
        assert TOOL.canonical_calls(path) == golden, path.name


def test_generated_surface_of_many_lines_matches_linuxcnc(tmp_path: Path) -> None:
    """A ball-end surface as CAM systems write it: the targets are known in closed form, and LinuxCNC agrees."""
    lines = ["G17 G21 G90 G40 G49 G80", "T1 M6", "S13000 M3", "G0 Z50", "G0 X0 Y0"]
    expected = []
    for row in range(30):
        for step in range(100):
            x = step * 0.5 if row % 2 == 0 else (99 - step) * 0.5
            y = row * 0.8
            z = 30.0 + 3.0 * math.sin(x / 9.0) * math.cos(y / 7.0)
            lines.append(f"G1 X{x:.4f} Y{y:.4f} Z{z:.4f} F1500.0000 ")
            expected.append((round(x, 4), round(y, 4), round(z, 4)))
    lines += ["G0 Z50", "M5", "M2"]
    path = tmp_path / "surface.ngc"
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    program = read(path)
    feeds = [motion for motion in program.motions if motion.kind == "feed"]
    assert len(feeds) == 3000
    assert program.straight
    assert np.array([motion.p_end for motion in feeds]) / MM == pytest.approx(np.array(expected), abs=1e-9)
    if TOOL.RS274.exists():
        compare(program, canonical_motions(TOOL.canonical_calls(path)))
