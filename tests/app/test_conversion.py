"""Programs said in another language and back: the same path within 1 um, the same process words."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app import conversion
from counterflex.app.compensation.compensate import compensate
from counterflex.app.inputs import AS_IT_IS, Reading, machine_of
from counterflex.app.robot_programs import robot_cell
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, OutputError, ProgramError
from counterflex.core.units import UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.programs.convert.steps import MachineFunction, Move, steps
from counterflex.programs.program import Program
from counterflex.programs.reading import read_program_file
from counterflex.programs.rotary.fitted import fitted
from counterflex.programs.rotary.poses import RotaryWords, turned_path
from counterflex.programs.stated.two_readings import doubtful_readings

EXAMPLES = Path(__file__).parents[2] / "examples"
LANGUAGES = ("gcode", "sinumerik", "apt", "krl", "rapid", "fanuc", "val3", "inform")
ROBOTS = ("krl", "rapid", "fanuc", "val3", "inform")
LATER = ("fanuc", "val3", "inform")
"""Their conversion with every other language is not tried, only with these: one of machines, one of robots."""
PAIRS = [
    (there, back)
    for there in LANGUAGES
    for back in LANGUAGES
    if not {there, back} & set(LATER) or {there, back} - set(LATER) <= {"gcode", "rapid"}
]
KRL = """clockwise = ["$ANOUT[1]={s}/24000.0", "$OUT[17]=TRUE"]
counter_clockwise = ["$ANOUT[1]={s}/24000.0", "$OUT[16]=TRUE"]
off = ["$OUT[17]=FALSE"]
mist = ["$OUT[18]=TRUE"]
flood = ["$OUT[19]=TRUE"]
coolant_off = ["$OUT[18]=FALSE", "$OUT[19]=FALSE"]
tool_change = ["CHANGE({t})"]
m_codes.M52 = ["$OUT[20]=TRUE"]
"""
RAPID = """clockwise = ["SetAO aoSpeed,{s};", "Set doRun;"]
counter_clockwise = ["SetAO aoSpeed,{s};", "Set doBack;"]
off = ["Reset doRun;"]
mist = ["Set doMist;"]
flood = ["Set doFlood;"]
coolant_off = ["Reset doMist; Reset doFlood;"]
tool_change = ["ToolTo {t};"]
m_codes.M52 = ["Set doDust;"]
"""
FANUC = """clockwise = ["GO[1]={s}", "DO[17]=ON"]
counter_clockwise = ["GO[1]={s}", "DO[16]=ON"]
off = ["DO[17]=OFF"]
mist = ["DO[18]=ON"]
flood = ["DO[19]=ON"]
coolant_off = ["DO[18]=OFF", "DO[19]=OFF"]
tool_change = ["CALL CHANGE({t})"]
"""
VAL3 = """clockwise = ["aioSpeed={s}", "dioRun=true"]
counter_clockwise = ["aioSpeed={s}", "dioBack=true"]
off = ["dioRun=false"]
mist = ["dioMist=true"]
flood = ["dioFlood=true"]
coolant_off = ["dioMist=false", "dioFlood=false"]
tool_change = ["call change({t})"]
"""
INFORM = """clockwise = ["AOUT AO#(1) {s}", "DOUT OT#(17) ON"]
counter_clockwise = ["AOUT AO#(1) {s}", "DOUT OT#(16) ON"]
off = ["DOUT OT#(17) OFF"]
mist = ["DOUT OT#(18) ON"]
flood = ["DOUT OT#(19) ON"]
coolant_off = ["DOUT OT#(18) OFF", "DOUT OT#(19) OFF"]
tool_change = ["CALL JOB:TOOL{t}"]
"""
PROGRAM = """(all that languages share)
G21 G17 G90 G94 G54
T1 M6
S9000 M3
G0 Z60
G0 X-12 Y15
M8
G1 Z34 F3000
G1 X10.1234 Y-3.3333 F1500
G2 X30 Y16.5439 I19.8766 J0.0001
G3 X30 Y16.5439 I5 J0
G18
G3 X40 Z34 I5 K0
G17
G4 P0.5
G1 X20 Y20 Z30 F600
M9
G81 X25 Y25 Z20 R40 F300
X35
G80
G0 Z60
M5
M0
T2 M6
S4500 M4
G0 X0 Y0 Z60
G1 Z41 F500
G1 Y33.5 F800
G0 Z60
M5
M30
"""


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The cell of the examples with outputs for all machine functions, and the program in each language."""
    folder = tmp_path_factory.mktemp("shop")
    text = (EXAMPLES / "cells" / "kr300_d16_small.toml").read_text(encoding="utf-8")
    for language, table in (("krl", KRL), ("rapid", RAPID), ("fanuc", FANUC), ("val3", VAL3), ("inform", INFORM)):
        text = re.sub(rf"(\[controller\.spindle\.{language}\]\n)[^\[]*(?:\[\]\n[^\[]*)*", rf"\1{table}\n", text)
    for number in (1, 2):
        names = f'number = {number}\ntool_data = {number}\ntooldata = "tMill{number}"\n'
        text = text.replace(f"number = {number}\n", names)
    (folder / "cell.toml").write_text(text, encoding="utf-8")
    (folder / "part.ngc").write_text(PROGRAM, encoding="ascii")
    for language in LANGUAGES[1:]:
        conversion.run(folder / "part.ngc", folder / "cell.toml", folder / f"in-{language}", language)
    (folder / "in-gcode").mkdir()
    (folder / "in-gcode" / "part.ngc").write_text(PROGRAM, encoding="ascii")
    return folder


def main_file(folder: Path) -> Path:
    """The program in a folder."""
    beside = (".dat", ".dtx", ".pjx")
    return next(file for file in folder.iterdir() if file.suffix not in beside and file.stem not in ("start", "stop"))


def read(file: Path, cell: Cell) -> Program:
    """A program of the shop."""
    return AS_IT_IS.program(file, cell)


def polyline(program: Program) -> Float:
    """Points along all motions, behind the first place that is known."""
    points: list[Float] = []
    for step in steps(program, lambda _: np.eye(3), to_robot=False):
        if isinstance(step, Move) and len(step.named) == 3 and step.motion.kind != "dwell":
            count = 200 if step.motion.kind == "arc" else 12
            points += [step.at(share) for share in np.linspace(0.0, 1.0, count)[0 if points else -1 :]]
    return np.array(points)


def gap(points: Float, line: Float) -> float:
    """Largest distance of points from a polyline, m."""
    a, step = line[:-1], np.diff(line, axis=0)
    length2 = np.maximum(np.sum(step * step, axis=1), 1e-30)
    worst = 0.0
    for p in points:
        share = np.clip(np.sum((p - a) * step, axis=1) / length2, 0.0, 1.0)
        worst = max(worst, float(np.linalg.norm(p - a - share[:, None] * step, axis=1).min()))
    return worst


def words(program: Program) -> list[tuple[tuple[str, float], ...]]:
    """Process words in order."""
    return [s.words for s in steps(program, lambda _: np.eye(3), to_robot=False) if isinstance(s, MachineFunction)]


@pytest.mark.by_turn
@pytest.mark.parametrize(("there", "back"), PAIRS)
def test_there_and_back(there: str, back: str, shop: Path, tmp_path: Path) -> None:
    """The same path within 1 um and the same process words, between every two languages."""
    if there == back:
        with pytest.raises(InputError, match="in that language already"):
            conversion.run(main_file(shop / f"in-{there}"), shop / "cell.toml", tmp_path / "x", back)
        return
    cell = read_cell(shop / "cell.toml")
    source = main_file(shop / f"in-{back}")
    about = conversion.run(source, shop / "cell.toml", tmp_path / "there", there)
    assert about["read_back_um"] < 1.0
    conversion.run(main_file(tmp_path / "there"), shop / "cell.toml", tmp_path / "back", back)
    one, two = read(source, cell), read(main_file(tmp_path / "back"), cell)
    first, second = polyline(one), polyline(two)
    chord = 0.4 * UM  # of the samples
    assert gap(first[::3], second) < 1.0 * UM + chord
    assert gap(second[::3], first) < 1.0 * UM + chord
    robot = there in ROBOTS
    stops = [word for word in words(two) if word != (("M", 5.0),)]
    expected = [word for word in words(one) if word != (("M", 5.0),)]
    assert stops == expected
    assert len(words(two)) == len(words(one)) or (robot and back not in ROBOTS)


def test_twincat_there_and_back(shop: Path, tmp_path: Path) -> None:
    """Its files have no ending of their own: they are read by the name of the dialect."""
    conversion.run(shop / "part.ngc", shop / "cell.toml", tmp_path / "there", "twincat")
    file = tmp_path / "there" / "part.nc"
    conversion.run(file, shop / "cell.toml", tmp_path / "back", "gcode", reading=Reading("twincat"))
    cell = read_cell(shop / "cell.toml")
    one, two = read(shop / "part.ngc", cell), read(tmp_path / "back" / "part.ngc", cell)
    assert gap(polyline(one)[::3], polyline(two)) < 1.4 * UM
    assert words(one) == words(two)


def test_a_helix_becomes_straight_moves_for_robots(shop: Path, tmp_path: Path) -> None:
    helix = PROGRAM.replace("G1 X20 Y20 Z30 F600", "G3 X30 Z24 I-5 J0 P3 F600")
    (tmp_path / "helix.ngc").write_text(helix, encoding="ascii")
    about = conversion.run(tmp_path / "helix.ngc", shop / "cell.toml", tmp_path / "out", "rapid")
    assert any("straight moves within 1 um" in warning for warning in about["warnings"])
    about = conversion.run(tmp_path / "helix.ngc", shop / "cell.toml", tmp_path / "mpf", "sinumerik")
    assert not about["warnings"]
    assert "TURN=2" in (tmp_path / "mpf" / "helix.mpf").read_text()


TILTED = """DEF part( )
$TOOL=TOOL_DATA[1]
$BASE=BASE_DATA[1]
$VEL.CP=0.02
PTP {X 0,Y 0,Z 60,A 180,B 0,C 180}
LIN {X 10,Y 0,Z 60,A 180,B 10,C 180}
CIRC {X 20,Y 0,Z 70},{X 30,Y 0,Z 60}
END
"""


def test_what_a_language_cannot_say_is_refused_with_its_line(shop: Path, tmp_path: Path) -> None:
    """Functions and circles that the other language has not; statements that no table names; nothing is left behind."""
    cell = shop / "cell.toml"
    cases = {
        "m.ngc": (PROGRAM.replace("M8", "M52"), "sinumerik", r"m.ngc:7.*M52"),
        "p.ngc": (PROGRAM.replace("M8", "M62 P3"), "krl", r"p.ngc:7.*M62"),
        "a.ngc": (PROGRAM.replace("G0 X0 Y0 Z60", "G0 X0 Y0 Z60 A10"), "apt", r"a.ngc:26.*rotary words"),
        "c.src": (TILTED, "gcode", r"c.src:7.*the tool is not upright"),
        "o.src": (TILTED.replace("$VEL", "$OUT[99]=TRUE\n$VEL"), "rapid", r"o.src:4.*\$OUT\[99\]"),
    }
    for name, (text, language, match) in cases.items():
        (tmp_path / name).write_text(text, encoding="ascii")
        with pytest.raises(ProgramError, match=match):
            conversion.run(tmp_path / name, cell, tmp_path / "out", language)
        assert not (tmp_path / "out").exists()


ROTARY = """G21 G17 G90 G94 G54
T1 M6
S9000 M3
G0 X0 Y0 Z120 B0 C0
{0}
G0 X10 Y5 Z80 B10 C20
G1 X30 Y-5 Z70 B25 C60 F1200
G1 X40 Y10 Z70 F1500
G0 X40 Y10 Z150 B0 C0
{1}
M5
M30
"""


@pytest.mark.by_turn
@pytest.mark.parametrize(("on", "off"), [("G43.4 H1", "G49"), ("", "")])
@pytest.mark.parametrize("language", ["krl", "fanuc"])
def test_rotary_words_become_orientations(language: str, on: str, off: str, tmp_path: Path) -> None:
    """Tip and axis of the robot lie within 10 um, and 33 urad, of where the machine of the cell file has them."""
    bench = EXAMPLES / "cells" / "kr300_bc_table.toml"
    table = "" if language == "krl" else "\n[controller.spindle.fanuc]\nclockwise = []\noff = []\ntool_change = []\n"
    text = bench.read_text(encoding="utf-8").replace("[controller.spindle.krl]", f"{table}[controller.spindle.krl]")
    (tmp_path / "cell.toml").write_text(text, encoding="utf-8")
    (tmp_path / "part.ngc").write_text(ROTARY.format(on, off), encoding="ascii")
    conversion.run(tmp_path / "part.ngc", tmp_path / "cell.toml", tmp_path / "out", language, tolerance_m=10.0 * UM)
    cell = read_cell(tmp_path / "cell.toml")
    made = read(main_file(tmp_path / "out"), cell)
    source = fitted(read(tmp_path / "part.ngc", cell), machine_of(cell))
    truth = turned_path(source, RotaryWords.of(source, machine_of(cell)), step_m=0.3e-3, rapid_speed_m_s=0.2).path
    points = [np.asarray(motion.p_end) for motion in made.motions if motion.kind != "dwell"]
    axes = [np.asarray(motion.abc_end) for motion in made.motions if motion.kind != "dwell"]
    line = np.hstack([np.array(points), 0.3 * np.array(axes)])
    rows = np.hstack([truth.p_part_tcp, 0.3 * truth.axis_part])
    a, step = line[:-1], np.diff(line, axis=0)
    length2 = np.maximum(np.sum(step * step, axis=1), 1e-30)
    for row in rows[1::7]:
        share = np.clip(np.sum((row - a) * step, axis=1) / length2, 0.0, 1.0)
        assert np.linalg.norm(row - a - share[:, None] * step, axis=1).min() < 15.0 * UM
    feeds = [motion.feed_m_s for motion in made.motions]
    if on:  # F is that of the tip
        assert any(feed == pytest.approx(0.02, rel=1e-3) for feed in feeds)
        assert any(feed == pytest.approx(0.025, rel=1e-3) for feed in feeds)


def test_a_tilted_tool_travels(shop: Path, tmp_path: Path) -> None:
    """As a vector to the languages of machines, and back; the rotation about it is that of the cell then."""
    (tmp_path / "part.src").write_text(TILTED.replace("CIRC {X 20,Y 0,Z 70},{X 30", "LIN {X 30"), encoding="ascii")
    for language in ("gcode", "sinumerik", "apt"):
        about = conversion.run(tmp_path / "part.src", shop / "cell.toml", tmp_path / language, language)
        assert "rotation about the tool axis" in about["warnings"][0]
        conversion.run(main_file(tmp_path / language), shop / "cell.toml", tmp_path / f"{language}-krl", "krl")
        again = (tmp_path / f"{language}-krl" / "part.src").read_text()
        assert "A 180.00000,B 10.00000,C -180.00000" in again or "B 10.0000" in again


@pytest.mark.parametrize("language", ROBOTS)
def test_a_long_program_is_written_in_parts(language: str, shop: Path, tmp_path: Path) -> None:
    """A main program calls them, none has more motions than said, and together they are the same path."""
    about = conversion.run(shop / "part.ngc", shop / "cell.toml", tmp_path / "out", language, points_per_file=10)
    whole = conversion.run(shop / "part.ngc", shop / "cell.toml", tmp_path / "whole", language)
    assert about["motions_out"] == whole["motions_out"]
    parts = [file for file in about["files"] if not file.endswith((".dat", ".dtx", ".pjx"))]
    parts = [file for file in parts if file not in ("start.pgx", "stop.pgx")]
    words = r"PTP|LIN|CIRC|Move[JLC]|[JLC] P\[|move[jlc]\(|MOV[JL]|MOVC.* FPT"
    motion = re.compile(rf"^\s*(?:\d+:)?\s*(?:{words})", re.MULTILINE)
    texts = [(tmp_path / "out" / file).read_text(encoding="ascii") for file in parts]
    counts = [len(motion.findall(text)) for text in texts]
    assert counts[0] == 0
    assert len(parts) == 1 + -(-sum(counts) // 10)
    assert max(counts[1:]) <= 10
    names = [Path(file).stem for file in parts[1:]]
    calls = [re.search(rf"\b{name}\b", texts[0], re.IGNORECASE) for name in names]
    assert all(a is not None for a in calls)
    places = [a.start() for a in calls if a is not None]
    assert places == sorted(places)


def test_words_that_are_not_told_apart_are_not_written(shop: Path, tmp_path: Path) -> None:
    """A table that does not tell the speed: it would be lost, so nothing is written."""
    cell = (
        (shop / "cell.toml").read_text(encoding="utf-8").replace('"SetAO aoSpeed,{s};", "Set doRun;"', '"Set doRun;"')
    )
    (tmp_path / "cell.toml").write_text(cell, encoding="utf-8")
    with pytest.raises(OutputError, match=r"process word is not read back.*S9000"):
        conversion.run(shop / "part.ngc", tmp_path / "cell.toml", tmp_path / "out", "rapid")
    assert not (tmp_path / "out").exists()


def test_a_program_with_loops_is_written_out_in_its_own_language(shop: Path, tmp_path: Path) -> None:
    """Each motion of a loop once, so that each can have a correction of its own."""
    source = main_file(shop / "in-rapid").read_text()
    motion = next(line for line in source.splitlines() if line.strip().startswith("MoveL"))
    looped = source.replace(motion, f"FOR i FROM 1 TO 3 DO\n{motion}\nENDFOR", 1)
    file = tmp_path / "looped.mod"
    file.write_text(looped)
    about = conversion.run(file, shop / "cell.toml", tmp_path / "out", "rapid")
    assert about["read_back_um"] < 1.0
    cell = read_cell(shop / "cell.toml")
    made, wanted = read(main_file(tmp_path / "out"), cell), read(file, cell)
    assert made.straight
    assert not wanted.straight
    np.testing.assert_allclose([m.p_end for m in made.motions], [m.p_end for m in wanted.motions], atol=1e-7)


@pytest.mark.parametrize("language", sorted({*ROBOTS} - {"inform"}))  # INFORM begins at a point, its posture beside it
def test_start_postures_are_no_motions_of_the_path_and_are_named(language: str, tmp_path: Path) -> None:
    """What compensate writes begins by axes: read with the robot known and without, it is the same path."""
    cell_file = EXAMPLES / "cells" / "kr300_d16_small.toml"
    cell = read_cell(cell_file)
    made = compensate(EXAMPLES / "programs" / "groove.ngc", cell, language=language, predict=False)
    for name, text in made.files.items():
        (tmp_path / name).write_text(text, encoding="ascii")
    main = tmp_path / next(iter(made.files))
    held = robot_cell(cell, language)
    known, unknown = (read_program_file(main, cell=one) for one in (held, replace(held, tip_of_axes=None)))
    assert [motion.kind for motion in known.motions] == [motion.kind for motion in unknown.motions]
    for a, b in zip(known.motions, unknown.motions, strict=True):
        np.testing.assert_array_equal(a.p_end, b.p_end)
    about = conversion.run(main, cell_file, tmp_path / "out", "gcode")
    assert any("motions by axes before the path" in warning for warning in about["warnings"])


def test_a_conversion_says_what_the_program_leaves_unsaid(tmp_path: Path) -> None:
    source = (EXAMPLES / "programs" / "groove.ngc").read_text()
    file, cell = tmp_path / "groove.ngc", EXAMPLES / "cells" / "kr300_d16_small.toml"
    file.write_text(re.sub(r"\bG21\b", "", source))
    said = conversion.run(file, cell, tmp_path / "out", "krl")["warnings"]
    assert any("before it says the unit" in warning for warning in said)


@pytest.mark.parametrize(
    ("language", "name"), [("gcode", "groove.ngc"), ("sinumerik", "groove.mpf"), ("apt", "groove.apt")]
)
def test_what_is_written_leaves_nothing_unsaid(language: str, name: str, tmp_path: Path) -> None:
    cell = EXAMPLES / "cells" / "kr300_d16_small.toml"
    conversion.run(EXAMPLES / "programs" / "groove.ngc", cell, tmp_path / "krl", "krl")
    conversion.run(tmp_path / "krl" / "groove.src", cell, tmp_path / "out", language)
    assert doubtful_readings(read_program_file(tmp_path / "out" / name)) == []
