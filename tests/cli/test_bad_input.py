"""Bad input through the real command: one clear line that names place, value and way out; status 2; nothing written."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from counterflex.programs.gcode.read import reader as gcode_reader

HEAD = "G17 G54 G40 G49 G80 G90 G21\nM6 T1\nM3 S13000\nG0 Z40\nG0 X-12 Y15\nG0 Z22\n"
TAIL = "\nG0 Z40\nM2\n"
CUT = "G1 Z17 F3000\nG1 X10 F1500"
COMPENSATE = ("compensate", "bad.ngc", "--cell", "cell.toml", "--out", "out/deep", "--no-predict", "--no-report")

PROGRAMS: dict[str, tuple[str | bytes, list[str]]] = {
    "unknown word": (HEAD + "G1 X10 E5 F100" + TAIL, ["bad.ngc:7:8:", "word E", "got E5"]),
    "letter without number": (HEAD + "G1 X F100" + TAIL, ["bad.ngc:7:6:", "missing number"]),
    "two codes of one group": (HEAD + "G0 G1 X5 F100" + TAIL, ["bad.ngc:7:4:", "motion", "G0 and G1"]),
    "arc radii differ": (HEAD + "G1 X0 Y0 F1500\nG2 X10 Y0 I4 J0" + TAIL, ["bad.ngc:8:", "radius", "4", "6"]),
    "no feed": (HEAD + "G1 X10" + TAIL, ["bad.ngc:7:1:", "without a feed", "Write F"]),
    "feed of zero": (HEAD + "G1 X10 F0" + TAIL, ["bad.ngc:7:", "F0"]),
    "missing subroutine": (HEAD + "o<drill> call" + TAIL, ["bad.ngc:7:1:", "not defined", "Odrill"]),
    "radius compensation": (HEAD + "G41 D1" + TAIL, ["bad.ngc:7:", "G41", "tool table", "tool-centre path"]),
    "comment open": (HEAD + "G1 X10 (to the end" + TAIL, ["bad.ngc:7:8:", "not closed"]),
    "rotary axis A": (HEAD + "G1 A10 F100" + TAIL, ["bad.ngc:7:4:", "rotary axis", "A10", "a table [machine]"]),
    "rotary axis B": (HEAD + "G1 X5 B10 F100" + TAIL, ["bad.ngc:7:7:", "rotary axis", "three-axis"]),
    "division by zero": (HEAD + "G1 X[1/0] F100" + TAIL, ["bad.ngc:7:7:", "division by zero"]),
    "exponent notation": (HEAD + "G1 X1e5 F100" + TAIL, ["bad.ngc:7:6:", "word E"]),
    "binary file": (b"\x7fELF\0\0\1", ["bad.ngc:", "not a text file"]),
    "word processor file": (b"\xff\xfeG\x010 X1\n", ["bad.ngc:", "UTF-16", "Save it as"]),
    "empty program": ("", ["bad.ngc:1:1:", "empty"]),
    "blank program": (" \n\n", ["bad.ngc:1:1:", "empty"]),
    "no motion": ("G21 G90\nM3 S100\nM2\n", ["bad.ngc", "moves nothing"]),
    "cut off": (HEAD + "G1 X10 F1500\n", ["bad.ngc:7:", "M2, M30 or a closing %", "--without-end"]),
    "spindle stopped": (HEAD.replace("M3 S13000\n", "") + CUT + TAIL, ["bad.ngc:7", "spindle stopped", "M3 S"]),
    "spindle speed zero": (HEAD.replace("S13000", "S0") + CUT + TAIL, ["bad.ngc:8", "spindle stopped"]),
    "spindle backwards": (HEAD.replace("M3", "M4") + CUT + TAIL, ["bad.ngc:8", "clockwise", "M4", "M3"]),
    "tool not in the cell": (HEAD.replace("T1", "T7") + CUT + TAIL, ["bad.ngc:7:", "T7", "expected T1", "number = 7"]),
    "no tool": (HEAD.replace("M6 T1\n", "") + CUT + TAIL, ["bad.ngc:6:", "no tool", "M6 T"]),
    "out of reach": (
        HEAD + "G0 X3000" + TAIL,
        ["bad.ngc:7", "(3000.000, 15.000, 22.000) mm", "out of reach", "beyond"],
    ),
    "chips too thin": (
        HEAD + "G1 Z17 F3000\nG1 X10 F1" + TAIL,
        ["bad.ngc:8", "mean chip", "0.001 to 1 mm", "allow_ext"],
    ),
    # So slow a spindle that the controller, which has to speed up first, makes such chips
    "chips too thick": (
        HEAD + "G1 Z19.9 F3000\nS20 G1 X10 F600000" + TAIL,
        ["bad.ngc:8", "mean chip", "0.001 to 1 mm"],
    ),
    "correction beyond bound": (
        HEAD + "G1 Z-8 F3000\nG1 X20 F3000" + TAIL,
        ["bad.ngc:8", "beyond its bound", "expected <= 3 mm (limits.correction_mm)"],
    ),
}


@pytest.mark.parametrize(("text", "says"), PROGRAMS.values(), ids=PROGRAMS.keys())
def test_program(folder: Path, refused: Any, text: str | bytes, says: list[str]) -> None:
    (folder / "bad.ngc").write_bytes(text if isinstance(text, bytes) else text.encode())
    line = refused(*COMPENSATE)
    for part in says:
        assert part in line


ENDLESS = {
    "while true": "o1 while [1]\nG0 X1\no1 endwhile",
    "while true, nothing done": "o1 while [1 EQ 1]\no1 endwhile",
    "do while": "o1 do\n#1=1\no1 while [#1]",
    "to and fro": "#1=0\no1 while [#1 LT 2]\n#1=[1-#1]\nG1 X[#1] F1000\no1 endwhile",
    "nested": "#1=0\no1 while [#1 LT 9]\no2 repeat [3]\nG91 G1 X1 F500\nG1 X-1\no2 endrepeat\nG90\no1 endwhile",
    "in a subroutine": "o7 sub\no1 while [1]\nG0 X1\no1 endwhile\no7 endsub\no7 call",
    "subroutine in a loop": "o7 sub\nG0 X[#1]\no7 endsub\n#3=5\no1 while [#3 GT 0]\no7 call [#3]\no1 endwhile",
    "counter that grows": "#1=0\no1 while [#1 GE 0]\n#1=[#1+1]\no1 endwhile",
}


@pytest.mark.parametrize("body", ENDLESS.values(), ids=ENDLESS.keys())
def test_endless_program(folder: Path, refused: Any, body: str) -> None:
    (folder / "bad.ngc").write_text(HEAD + body + TAIL, encoding="ascii")
    line = refused(*COMPENSATE)
    assert re.search(r"bad\.ngc:\d+:1: the program (never ends|does not end)", line)
    assert "condition of the loop" in line


def test_rapid_through_material_is_a_warning(folder: Path, counterflex: Any) -> None:
    (folder / "bad.ngc").write_text(HEAD + "G0 Z17\nG0 X10" + TAIL, encoding="ascii")
    ended = counterflex(*COMPENSATE)
    assert ended.status == 0
    assert ended.err == ""
    assert re.search(r"warning: rapid in line 8 cuts \d+\.\d mm3 of material", ended.out)
    assert (folder / "out/deep/bad.ngc").is_file()


SENSOR = "rx_urad_per_knm = 303.0"
BOX = "box_min_mm = [0, 0, 0]\nbox_max_mm = [40, 30, 20]"
DATUM = "[[0, 0, 20], [40, 0, 20], [40, 30, 20], [0, 30, 20]]"
CATALOG = 'catalog = "kuka_kr300_r2500_ultra"'
LAW = 'law = "kienzle"\nkc11_n_mm2 = 780\nmc = 0.25\nkr_over_kc = 0.35\nmr = 0.25\nka_over_kc = 0.15\nma = 0.25\n'
GEOMETRY = """[robot.geometry]
a1_mm = 500
a2_mm = -55
c1_mm = 1045
c2_mm = 1300
c3_mm = 1025
c4_mm = 290
offsets_deg = [0, 0, -90, 0, 0, 0]
signs = [1, 1, 1, 1, 1, 1]
limits_deg = [[-185, 185], [-140, -5], [-120, 155], [-350, 350], [-125, 125], [-350, 350]]
"""
OWN = "[robot]\n" + CATALOG + "\n"

CELLS: dict[str, tuple[str, str, list[str]]] = {
    "not TOML": ("[robot]", "[robot", ["not valid TOML", "line 6"]),
    "key twice": ("flutes = 3", "flutes = 3\nflutes = 4", ["not valid TOML", "overwrite", "line"]),
    "wrong format": ("counterflex-cell", "counterflex-truth", ["got 'counterflex-truth'", '"counterflex-cell"']),
    "no format": ('format = "counterflex-cell"\n', "", ["'format' is missing", 'format = "counterflex-cell"']),
    "newer version": ("version = 1", "version = 9", ["newer", "version 9", "at most 1", "Update"]),
    "version as text": ("version = 1", 'version = "1"', ["version", "got '1'", "version = 1"]),
    "missing key": ("diameter_mm = 16\n", "", ["tools[1].diameter_mm", "'diameter_mm' is missing"]),
    "missing table": ("[tcp]\nx_mm = 240\nz_mm = 70\nb_deg = 90\n", "", ["tcp", "'tcp' is missing"]),
    "misspelt key": ("diameter_mm", "diamter_mm", ["unknown key 'diamter_mm'", "Did you mean 'diameter_mm'?"]),
    "misspelt table": ("[tcp]", "[tpc]", ["unknown key 'tpc'", "Did you mean 'tcp'?"]),
    "key without unit": ("diameter_mm", "diameter", ["unknown key 'diameter'", "diameter_mm"]),
    "key with another unit": ("diameter_mm", "diameter_m", ["'diameter_m'", "Its unit is another: diameter_mm"]),
    "stiffness in N mm/rad": (SENSOR, "stiffness = 3.3e9", ["compliance, never stiffness", "N mm/rad is 303 urad/kNm"]),
    "stiffness by axis": (SENSOR, "k_rx = 3.3e9", ["unknown key 'k_rx'", "3.3e+09 N mm/rad is 303 urad/kNm"]),
    "stiffness under the key of a compliance": (
        SENSOR,
        "rx_urad_per_knm = 3.3e9",
        ["end_effector[1]", "implausibly large: 3.3e+09", "Is it a stiffness?", "303 urad/kNm"],
    ),
    "compliance in rad/(N m)": (SENSOR, "rx_urad_per_knm = 3.03e-7", ["implausibly small", "multiplied by 1e9"]),
    "compliance in m/N": (SENSOR, "tx_um_per_kn = 1e-8", ["tx_um_per_kn", "implausibly small", "1e9"]),
    "absurd compliance": (SENSOR, "tx_um_per_kn = 1e9", ["tx_um_per_kn", "implausibly large: 1e+09", "100000"]),
    "negative compliance": (SENSOR, "rx_urad_per_knm = -303.0", ["end_effector[1]", "negative: -303"]),
    "negative mass": ("mass_kg = 11", "mass_kg = -11", ["end_effector[1].mass_kg", "got -11", "from 0 up"]),
    "mass in g": ("mass_kg = 11", "mass_kg = 11000", ["end_effector[1].mass_kg", "11000", "5000"]),
    "length in um": ("x_mm = 1350", "x_mm = 1350000", ["part.x_mm", "1350000", "20000"]),
    "datum point on the moon": (DATUM, DATUM.replace("30", "4e11"), ["part.datum_points_mm[3]", "20000"]),
    "diameter in um": ("diameter_mm = 16", "diameter_mm = 16000", ["tools[1].diameter_mm", "16000", "1000"]),
    "NaN": ("mass_kg = 11", "mass_kg = nan", ["end_effector[1].mass_kg", "got nan", "a finite number"]),
    "infinity": ("x_mm = 1350", "x_mm = inf", ["part.x_mm", "got inf", "a finite number"]),
    "text for a number": ("mass_kg = 11", 'mass_kg = "11"', ["end_effector[1].mass_kg", "got '11'", "a number"]),
    "truth value for a number": ("mass_kg = 11", "mass_kg = true", ["end_effector[1].mass_kg", "a number"]),
    "no name": ('name = "KR 300 R2500 ultra, spindle across the flange"', 'name = ""', ["name", "not empty"]),
    "robot unknown": (
        "kuka_kr300_r2500_ultra",
        "kuka_kr300_r2500",
        ["robot.catalog", "'kuka_kr300_r2500'", "kuka_kr300_r2500_ultra", "counterflex robots"],
    ),
    "robot by its model": ("kuka_kr300_r2500_ultra", "KR 300", ["'KR 300'", "kuka_kr300_r2500_ultra"]),
    "two robots": (CATALOG, CATALOG + '\nurdf = "a.urdf"', ["robot:", "exactly one", "catalog and urdf"]),
    "no robot": (CATALOG, "", ["robot:", "exactly one", "none of them"]),
    "URDF missing": (CATALOG, 'urdf = "arm.urdf"', ["robot.urdf", "arm.urdf", "no such file"]),
    "own geometry, sign": (
        OWN,
        GEOMETRY.replace("signs = [1", "signs = [2"),
        ["robot.geometry.signs[1]", "2", "-1 or 1"],
    ),
    "own geometry, five offsets": (
        OWN,
        GEOMETRY.replace("offsets_deg = [0, ", "offsets_deg = ["),
        ["robot.geometry.offsets_deg", "6 entries"],
    ),
    "own geometry, limits swapped": (
        OWN,
        GEOMETRY.replace("[-185, 185]", "[185, -185]"),
        ["robot.geometry", "axis 1", "[185.0, -185.0]", "lower < upper"],
    ),
    "own geometry in m": (
        OWN,
        GEOMETRY.replace("1300", "1.3").replace("1025", "1.025").replace("1045", "1.045"),
        ["cell.toml: part", "stock's corner", "out of reach", "mm"],
    ),
    "segment unknown": (
        "[[tools]]",
        '[[robot.elastic]]\nsegment = "axis9"\n\n[[tools]]',
        ["robot.elastic", "'axis9'", "axis1, axis2"],
    ),
    "two bodies of one name": ('name = "spindle"', 'name = "sensor"', ["'sensor'", "names must differ"]),
    "body named as an axis": ('name = "spindle"', 'name = "axis1"', ["end_effector", "axis1", "another name"]),
    "two tools of one number": (
        "[material]",
        "[[tools]]\nnumber = 1\ndiameter_mm = 8\nflutes = 2\nflute_length_mm = 20\n\n[material]",
        ["two tools", "number 1"],
    ),
    "one pair of brackets": ("[[tools]]", "[tools]", ["tools", "[[name]]"]),
    "two pairs of brackets": ("[tcp]", "[[tcp]]", ["tcp", "[name]"]),
    "diameter zero": ("diameter_mm = 16", "diameter_mm = 0", ["tools[1].diameter_mm", "got 0", "above 0"]),
    "corner radius too big": (
        "diameter_mm = 16",
        "diameter_mm = 16\ncorner_radius_mm = 9",
        ["tools[1]", "corner_radius_mm = 9", "at most 8"],
    ),
    "no flutes": ("flutes = 3", "flutes = 0", ["tools[1].flutes", "got 0", "from 1 up"]),
    "half a flute": ("flutes = 3", "flutes = 2.5", ["tools[1].flutes", "got 2.5", "a whole number"]),
    "runout in nm": ("flutes = 3", "flutes = 3\nrunout_um = 9000", ["tools[1]", "runout_um = 9000", "at most 800"]),
    "box upside down": ("box_min_mm = [0, 0, 0]", "box_min_mm = [0, 0, 50]", ["part.stock", "must lie below"]),
    "box with one corner": ("box_min_mm = [0, 0, 0]\n", "", ["part.stock", "box_min_mm and box_max_mm"]),
    "box in the plane": ("box_min_mm = [0, 0, 0]", "box_min_mm = [0, 0]", ["part.stock.box_min_mm", "too few", "3"]),
    "blank twice": (BOX, BOX + '\nstl = "blank.stl"', ["part.stock", "exactly one"]),
    "STL missing": (BOX, 'stl = "blank.stl"', ["part.stock", "blank.stl", "no such file"]),
    "result missing": (BOX, 'result = "run/surface.npz"', ["part.stock", "surface.npz", "no such file"]),
    "too many cells": ("cell_mm = 0.5", "cell_mm = 0.002", ["part.stock", "20000 x 15000 cells", "2e+08", "larger"]),
    "cells too coarse": ("cell_mm = 0.5", "cell_mm = 5", ["part.stock", "8 x 6 cells", "at least 16"]),
    "cell of zero": ("cell_mm = 0.5", "cell_mm = 0", ["part.stock.cell_mm", "got 0", "above 0.001"]),
    "two datum points": (DATUM, "[[0, 0, 20], [40, 0, 20]]", ["part:", "at least three datum_points_mm"]),
    "datum points on one line": (DATUM, "[[0, 0, 20], [20, 0, 20], [40, 0, 20]]", ["part:", "one line"]),
    "part out of reach": ("x_mm = 1350", "x_mm = 4350", ["cell.toml: part", "corner at (0.25, 0.25, 20) mm", "beyond"]),
    "part in m": (
        "x_mm = 1350\ny_mm = -75\nz_mm = 1000",
        "x_mm = 1.35\ny_mm = -0.075\nz_mm = 1.0",
        ["cell.toml: part", "joint limit", "axis 3", "Lengths are in mm"],
    ),
    "chip range upside down": ("ma = 0.25", "ma = 0.25\nchip_min_um = 50\nchip_max_um = 20", ["material", "50 and 20"]),
    "constant missing": ("kc11_n_mm2 = 780\n", "", ["material", "kienzle", "kc11_n_mm2"]),
    "constant in Pa": ("kc11_n_mm2 = 780", "kc11_n_mm2 = 780e6", ["material.kc11_n_mm2", "780000000.0", "20000"]),
    "law unknown": ('"kienzle"', '"kinzle"', ["material.law", "kinzle", "linear_edge", "Did you mean 'kienzle'?"]),
    "material unknown": (LAW, 'catalog = "en-aw-2017-vdi"\n', ["material.catalog", "Did you mean 'en-aw-2017-vdi22'"]),
    "material twice": ('law = "kienzle"\n', 'catalog = "c45-qt-vdi3"\n', ["material", "remove kc11_n_mm2"]),
    "posture unknown": ('elbow = "up"', 'elbow = "sideways"', ["posture.elbow", "'sideways'", "'up' or 'down'"]),
    "mode of zero": (
        "[limits]\n",
        "[dynamics]\nmode_hz = -8.5\n\n[limits]\n",
        ["dynamics.mode_hz", "got -", "above 0"],
    ),
}


@pytest.mark.parametrize(("old", "new", "says"), CELLS.values(), ids=CELLS.keys())
def test_cell_file(folder: Path, refused: Any, old: str, new: str, says: list[str]) -> None:
    path = folder / "cell.toml"
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    line = refused("cell", "check", "cell.toml")
    for part in ["cell.toml", *says]:
        assert part in line


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", ["cell.toml: the file is empty"]),
        (b"\n \n", ["cell.toml: the file is empty"]),
        ("name = 'M\xfcller'".encode("latin-1"), ["cell.toml: not a text file in UTF-8", "0xfc in line 1"]),
        (b"\0\1\2", ["cell.toml:1: not a text file: it contains zero bytes"]),
    ],
    ids=["empty", "blank", "latin-1", "binary"],
)
def test_cell_file_that_is_none(folder: Path, refused: Any, data: bytes, says: list[str]) -> None:
    (folder / "cell.toml").write_bytes(data)
    line = refused("compensate", "part.ngc", "--cell", "cell.toml", "--out", "out")
    for part in says:
        assert part in line


LIMITS: dict[str, tuple[str, str, list[str]]] = {
    "wrist near its singularity": (
        "b_deg = 90",
        "b_deg = 64",
        [
            "part.ngc:8, at (10.000, 15.000, 17.000) mm",
            "singularity",
            "axis 5 at 4.9",
            ">= 5 deg",
            "limits.wrist_singularity_deg",
        ],
    ),
    "joint near its limit": (
        "joint_margin_deg = 2",
        "joint_margin_deg = 40",
        ["part.ngc:", "mm", "too close to its limit", "deg left", ">= 40 deg (limits.joint_margin_deg)"],
    ),
    "joint beyond its limit": ("x_mm = 1350", "x_mm = 700", ["part.ngc:", "axis 3", "deg"]),
    "tool deeper than its flutes": (
        "flute_length_mm = 35",
        "flute_length_mm = 2",
        ["part.ngc:8", "deeper than the flutes", "at most 2 mm (tools.flute_length_mm)", "levels"],
    ),
    "linear-edge law incomplete": (LAW, 'law = "linear_edge"\n', ["material", "linear_edge", "ktc_n_mm2"]),
}


@pytest.mark.parametrize(("old", "new", "says"), LIMITS.values(), ids=LIMITS.keys())
def test_cell_that_cannot_run_the_program(folder: Path, refused: Any, old: str, new: str, says: list[str]) -> None:
    path = folder / "cell.toml"
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    line = refused("compensate", "part.ngc", "--cell", "cell.toml", "--out", "out", "--no-predict", "--no-report")
    for part in says:
        assert part in line


def _stl(path: Path, scale: float = 1.0, *, closed: bool = True) -> None:
    box = trimesh.creation.box(bounds=np.array([[0.0, 0.0, 0.0], [40.0, 30.0, 20.0]]) * scale)
    if not closed:
        box.update_faces(np.arange(len(box.faces)) > 0)
    path.write_bytes(trimesh.exchange.stl.export_stl(box))


@pytest.mark.parametrize(
    ("scale", "closed", "says"),
    [
        (0.001, True, ["part.stock", "blank.stl", "0.04 x 0.03 x 0.02 mm", "m or inch"]),
        (1e6, True, ["part.stock", "blank.stl", "implausibly large", "um"]),
        (1.0, False, ["part.stock", "blank.stl", "not watertight", "closed solid"]),
        (0.0, True, ["part.stock", "blank.stl", "STL", "0 triangles"]),
    ],
    ids=["in metres", "in nanometres", "with a hole", "no STL"],
)
def test_stl_blank(folder: Path, refused: Any, scale: float, closed: bool, says: list[str]) -> None:
    if scale:
        _stl(folder / "blank.stl", scale, closed=closed)
    else:
        (folder / "blank.stl").write_bytes(b"solid nothing at all")
    path = folder / "cell.toml"
    path.write_text(path.read_text(encoding="utf-8").replace(BOX, 'stl = "blank.stl"'), encoding="utf-8")
    line = refused("compensate", "part.ngc", "--cell", "cell.toml", "--out", "out")
    for part in says:
        assert part in line


MASS = r"\nmass_kg = [\d.]+"
TRUTHS: dict[str, tuple[str, str, list[str]]] = {
    "empty": (r"(?s).*", "", ["bad.toml: the file is empty"]),
    "not TOML": (r"\[cutting\]", "[cutting", ["bad.toml", "not readable as TOML", "line"]),
    "wrong format": ("counterflex-truth", "counterflex-cell", ["bad.toml", "got 'counterflex-cell'"]),
    "newer version": ("version = 1", "version = 4", ["newer", "version 4", "at most 1"]),
    "unknown key": (r"\[cutting\]", "[cutting]\nspeed = 3", ["bad.toml: cutting", "unknown key 'speed'"]),
    "missing key": (MASS, "", ["bad.toml: bodies[1]", "'mass_kg' is missing"]),
    "negative friction": (
        r"motor_friction_nm = [\d.]+",
        "motor_friction_nm = -3.0",
        ["motor_friction_nm", "-3.0", ">= 0"],
    ),
    "negative mass": (MASS, "\nmass_kg = -3.0", ["axis1", "mass_kg", "-3.0", ">= 0"]),
    "NaN": (MASS, "\nmass_kg = nan", ["bad.toml: bodies[1]: mass_kg", "not a finite number", "nan"]),
    "text for a number": (MASS, '\nmass_kg = "a"', ["bad.toml: bodies[1]: mass_kg", "'a'"]),
    "no bodies": (r"(?s)\[\[bodies\]\].*", "", ["bad.toml", "'bodies' is missing"]),
    "a body less": (
        r"(?s)\[\[bodies\]\](?:(?!\[\[bodies).)*$",
        "",
        ["another cell", "spindle", "counterflex truth CELL"],
    ),
}


@pytest.mark.parametrize(("old", "new", "says"), TRUTHS.values(), ids=TRUTHS.keys())
def test_truth_file(folder: Path, refused: Any, machined: Any, old: str, new: str, says: list[str]) -> None:
    text = (machined.folder / "truth.toml").read_text(encoding="utf-8")
    changed = re.sub(old, new, text, count=1)
    assert changed != text
    (folder / "bad.toml").write_text(changed, encoding="utf-8")
    line = refused("simulate", "part.ngc", "--cell", "cell.toml", "--truth", "bad.toml", "--out", "run")
    for part in says:
        assert part in line


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("kuka_kr300_r2500_ultra", "kuka_kr210_r2700_extra", ["another cell", "link_arm"]),
        ("x_mm = 240\n", "x_mm = 290\n", ["another cell", "'tcp'", "mm off", "at most 20 mm"]),
    ],
    ids=["another robot", "another tool"],
)
def test_truth_of_another_cell(folder: Path, refused: Any, machined: Any, old: str, new: str, says: list[str]) -> None:
    shutil.copy(machined.folder / "truth.toml", folder)
    path = folder / "cell.toml"
    path.write_text(path.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    line = refused("simulate", "part.ngc", "--cell", "cell.toml", "--truth", "truth.toml", "--out", "run")
    for part in ["truth.toml", *says]:
        assert part in line


JOINTS = "0,-90,90,0,30,0"
ROBOT = "kuka_kr300_r2500_ultra"
COMMANDS: dict[str, tuple[str, list[str]]] = {
    "no such command": ("compensat x", ["'compensat'", "Did you mean 'compensate'?", "--help"]),
    "no such option": ("compensate part.ngc --cel cell.toml", ["--cel", "--cell", "counterflex compensate --help"]),
    "argument missing": ("pose", ["ROBOT|CELL", "counterflex pose --help"]),
    "option missing": ("compensate part.ngc --cell cell.toml", ["--out", "counterflex compensate --help"]),
    "argument too many": ("demo part.ngc", ["part.ngc", "counterflex demo --help"]),
    "three joints": (f"pose {ROBOT} --joints-deg 1,2,3", ["--joints-deg", "3 numbers", "'1,2,3'", "6"]),
    "letters for joints": (f"pose {ROBOT} --joints-deg a,b,c,d,e,f", ["--joints-deg", "'a,b,c,d,e,f'", "6 numbers"]),
    "NaN for a joint": (f"pose {ROBOT} --joints-deg nan,-90,90,0,0,0", ["--joints-deg", "not finite", "nan"]),
    "joint beyond its limit": (f"pose {ROBOT} --joints-deg 0,-90,90,0,200,0", ["axis 5", "200 deg", "-122.5 to 122.5"]),
    "neither joints nor pose": (f"pose {ROBOT}", ["--joints-deg", "--xyz-mm", "neither"]),
    "both joints and pose": (
        f"pose {ROBOT} --joints-deg {JOINTS} --xyz-mm 1,2,3",
        ["--joints-deg", "--xyz-mm", "both"],
    ),
    "two coordinates": (f"pose {ROBOT} --xyz-mm 1,2", ["--xyz-mm", "2 numbers", "3"]),
    "pose out of reach": (f"pose {ROBOT} --xyz-mm 9000,0,0", ["out of reach", "mm beyond the arm"]),
    "pose at the column": (f"pose {ROBOT} --xyz-mm 0,0,1784", ["joint limit", "axis 3", "-120.000..155.000 deg"]),
    "letters for an angle": (f"pose {ROBOT} --xyz-mm 1,2,3 --abc-deg 0,x,0", ["--abc-deg", "'0,x,0'"]),
    "robot unknown": (f"pose kuka_kr300 --joints-deg {JOINTS}", ["'kuka_kr300'", "kuka_kr300_r2500_ultra"]),
    "robot nowhere near": ("robots nobody", ["'nobody'", "counterflex robots"]),
    "cell for pose missing": (f"pose cel.toml --joints-deg {JOINTS}", ["cel.toml", "Did you mean cell.toml?"]),
    "program as cell": (f"pose part.ngc --joints-deg {JOINTS}", ["part.ngc", "this is a G-code program", "TOML"]),
    "force of two": (f"deflection cell.toml --joints-deg {JOINTS} --force-n 1,2", ["--force-n", "2 numbers", "3"]),
    "infinite force": (f"deflection cell.toml --joints-deg {JOINTS} --force-n inf,0,0", ["--force-n", "not finite"]),
    "force of an asteroid": (
        f"deflection cell.toml --joints-deg {JOINTS} --force-n 1e9,0,0",
        ["beyond any elastic model", "1 m", "units"],
    ),
    "cell missing": ("cell check cel.toml", ["cel.toml", "no such file", "Did you mean cell.toml?"]),
    "cell's folder missing": ("cell check nowhere/cell.toml", ["nowhere/cell.toml", "folder nowhere does not exist"]),
    "cell is a folder": ("cell check temporary", ["temporary", "it is a folder"]),
    "cell example over a file": ("cell example --out cell.toml", ["cell.toml", "exists and is kept", "--out"]),
    "cell example below a file": (
        "cell example --out part.ngc/new/cell.toml",
        ["part.ngc/new/cell.toml", "cannot write"],
    ),
    "import of a program": (
        "cell import part.ngc --robot kuka_kr300_r2500_ultra --out new.toml",
        ["part.ngc", "no kind that is read", "$config.dat"],
    ),
    "import for no robot": ("cell import part.ngc --robot kr3000 --out new.toml", ["kr3000", "robot"]),
    "import over a file": (
        "cell import part.ngc --robot kuka_kr300_r2500_ultra --out cell.toml",
        ["cell.toml", "--out"],
    ),
    "program missing": ("path prt.ngc", ["prt.ngc", "no such file", "Did you mean part.ngc?"]),
    "program is a folder": ("path temporary", ["temporary", "it is a folder"]),
    "dialect unknown": ("path part.ngc --dialect okuma", ["dialect", "okuma", "linuxcnc"]),
    "table over the program": ("path part.ngc --csv part.ngc", ["--csv part.ngc", "replace part.ngc"]),
    "table over a folder": ("path part.ngc --csv temporary", ["temporary", "a folder has this name"]),
    "language unknown": (
        "compensate part.ngc --cell cell.toml --out out --as sinumerik",
        ["--as", "sinumerik", "expected gcode, rapid, fanuc, krl, val3"],
    ),
    "conversion to an unknown language": (
        "convert part.ngc --cell cell.toml --out out --to okuma",
        ["--to", "okuma", "krl", "rapid", "fanuc", "val3", "gcode", "heidenhain"],
    ),
    "conversion to its own language": (
        "convert part.ngc --cell cell.toml --out out --to gcode",
        ["part.ngc", "in that language already"],
    ),
    "conversion with no tolerance": (
        "convert part.ngc --cell cell.toml --out out --to krl --tolerance-um 0",
        ["--tolerance-um", "0.1"],
    ),
    "conversion over the program": (
        "convert part.ngc --cell cell.toml --out . --to krl",
        ["--out"],
    ),
    "tolerance zero": (
        "compensate part.ngc --cell cell.toml --out out -s compensation.tolerance_um=0",
        ["compensation.tolerance_um", "got 0", "from 0.1 up"],
    ),
    "tolerance negative": (
        "compensate part.ngc --cell cell.toml --out out -s compensation.tolerance_um=-5",
        ["compensation.tolerance_um", "got -5", "from 0.1 up"],
    ),
    "tolerance NaN": (
        "compensate part.ngc --cell cell.toml --out out -s compensation.tolerance_um=nan",
        ["compensation.tolerance_um", "finite number"],
    ),
    "out is the program's folder": (
        "compensate part.ngc --cell cell.toml --out .",
        ["--out .", "part.ngc lies in this folder", "another"],
    ),
    "out is a file": ("compensate part.ngc --cell cell.toml --out cell.toml", ["cell.toml", "a file has the name"]),
    "out is below a file": (
        "compensate part.ngc --cell cell.toml --out cell.toml/a/b",
        ["cell.toml/a/b", "cannot write", "--out"],
    ),
    "program as cell of compensate": (
        "compensate part.ngc --cell part.ngc --out out",
        ["part.ngc", "this is a G-code program"],
    ),
    "truth over its cell": ("truth cell.toml --out cell.toml", ["--out cell.toml", "replace cell.toml"]),
    "truth's seed negative": ("truth cell.toml --out t.toml --seed -1", ["--seed", "0", "counterflex truth --help"]),
    "truth missing": (
        "simulate part.ngc --cell cell.toml --truth trth.toml --out run",
        ["trth.toml", "no such file"],
    ),
    "cell as truth": ("simulate part.ngc --cell cell.toml --truth cell.toml --out run", ["cell.toml", "truth"]),
    "no seeds": ("prove part.ngc --cell cell.toml --out out --seeds 0", ["--seeds", "got 0", "1 to 100"]),
    "seeds in words": (
        "prove part.ngc --cell cell.toml --out out --seeds two",
        ["--seeds", "got two", "2001-2008,2011"],
    ),
    "one seed alone": ("prove part.ngc --cell cell.toml --out out --seeds 2011", ["--seeds", "2011-2011"]),
    "a seed twice": ("campaign --seeds 2001-2003,2002 --out out", ["--seeds", "2002", "twice"]),
    "no workers": ("prove part.ngc --cell cell.toml --out out --workers 0", ["--workers", "1"]),
    "prove into the program's folder": ("prove part.ngc --cell cell.toml --out .", ["--out .", "part.ngc lies in"]),
    "prove below a file": ("prove part.ngc --cell cell.toml --out part.ngc/a/b", ["part.ngc/a/b", "cannot write"]),
    "prove nothing": ("prove prt.ngc --cell cell.toml --out new/out", ["prt.ngc", "Did you mean part.ngc?"]),
    "demo without seeds": ("demo --seeds 0 --out out", ["--seeds", "1"]),
    "demo below a file": ("demo --out part.ngc/a", ["part.ngc/a", "cannot write"]),
    "evaluate nothing": ("evaluate", ["DIR", "counterflex evaluate --help"]),
    "evaluate a missing folder": ("evaluate nowhere", ["nowhere", "no such folder"]),
    "evaluate a folder without a run": ("evaluate temporary", ["temporary", "run.parquet", "counterflex simulate"]),
    "evaluate three folders": ("evaluate temporary temporary temporary", ["one or two runs", "got 3"]),
}


@pytest.mark.parametrize(("words", "says"), COMMANDS.values(), ids=COMMANDS.keys())
def test_command_line(refused: Any, words: str, says: list[str]) -> None:
    line = refused(*shlex.split(words))
    for part in says:
        assert part in line


def test_prove_names_the_line_too(folder: Path, refused: Any) -> None:
    (folder / "bad.ngc").write_text(HEAD.replace("M3 S13000\n", "") + CUT + TAIL, encoding="ascii")
    line = refused("prove", "bad.ngc", "--cell", "cell.toml", "--out", "new/out", "--workers", "1")
    assert "bad.ngc:7" in line
    assert "spindle stopped" in line


def test_law_without_a_twin(folder: Path, refused: Any) -> None:
    path = folder / "cell.toml"
    other = 'law = "linear_edge"\nktc_n_mm2 = 800\nkrc_n_mm2 = 300\n'
    path.write_text(path.read_text(encoding="utf-8").replace(LAW, other), encoding="utf-8")
    line = refused("prove", "part.ngc", "--cell", "cell.toml", "--out", "out", "--workers", "1")
    assert "Kienzle" in line
    assert "law = kienzle" in line


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("T1", "T9"), ["part.ngc:7", "T9", "expected T1"]),
        (("M3 S13000\n", ""), ["spindle off", "M3 S"]),
        (("G1 X10 ", "G1 X4000 "), ["does not reach", "Move the part"]),
        (("G1 Z17", "G1 Z-18"), ["deeper in the stock than its flutes"]),
    ],
    ids=["tool", "spindle", "reach", "flutes"],
)
def test_program_the_twin_refuses(
    folder: Path, refused: Any, machined: Any, change: tuple[str, str], says: list[str]
) -> None:
    shutil.copy(machined.folder / "truth.toml", folder)
    path = folder / "part.ngc"
    path.write_text(path.read_text(encoding="ascii").replace(*change), encoding="ascii")
    line = refused("simulate", "part.ngc", "--cell", "cell.toml", "--truth", "truth.toml", "--out", "new/run")
    for part in says:
        assert part in line


DAMAGED: dict[str, tuple[str, bytes | None, list[str]]] = {
    "run missing": ("run.parquet", None, ["run", "run.parquet", "counterflex simulate"]),
    "run damaged": ("run.parquet", b"damaged", ["run.parquet", "not readable as a Parquet file"]),
    "run empty": ("run.parquet", b"", ["run.parquet", "not readable as a Parquet file"]),
    "surface missing": ("surface.npz", None, ["surface.npz", "no such file"]),
    "surface damaged": ("surface.npz", b"damaged", ["surface.npz", "do not belong together"]),
    "surface cut off": ("surface.npz", b"PK\x03\x04-\x00\x00\x00\x08", ["surface.npz", "do not belong together"]),
    "surface empty": ("surface.npz", b"", ["surface.npz", "do not belong together"]),
    "cell missing": ("cell.toml", None, ["run/cell.toml", "missing"]),
    "cell damaged": ("cell.toml", b"format = 3", ["cell.toml", "counterflex-cell"]),
    "truth missing": ("truth.toml", None, ["run/truth.toml", "missing"]),
    "program missing": ("original.ngc", None, ["run/original.ngc", "missing"]),
}


@pytest.mark.parametrize(("name", "data", "says"), DAMAGED.values(), ids=DAMAGED.keys())
def test_damaged_run(folder: Path, refused: Any, machined: Any, name: str, data: bytes | None, says: list[str]) -> None:
    shutil.copytree(machined.folder / "run", folder / "run")
    if data is None:
        (folder / "run" / name).unlink()
    else:
        (folder / "run" / name).write_bytes(data)
    line = refused("evaluate", "run", "--out", "judged")
    for part in says:
        assert part in line


def test_runs_that_do_not_belong_together(folder: Path, refused: Any, machined: Any) -> None:
    for name in ("run", "other-run"):
        shutil.copytree(machined.folder / name, folder / name)
    line = refused("evaluate", "run", "other-run", "--out", "judged")
    assert "cannot be compared" in line
    assert "run, other-run" in line
    assert "--truth" in line


@pytest.mark.parametrize("words", ["evaluate run --out run", "report run run --out ./run"])
def test_results_never_replace_a_run(folder: Path, refused: Any, machined: Any, words: str) -> None:
    shutil.copytree(machined.folder / "run", folder / "run")
    line = refused(*words.split())
    assert "would replace the summary of the run" in line


def test_report_of_a_missing_run(folder: Path, refused: Any, machined: Any) -> None:
    shutil.copytree(machined.folder / "run", folder / "run")
    line = refused("report", "run", "nowhere", "--out", "new/out")
    assert "nowhere: no such folder" in line


def test_evaluation_below_a_file(folder: Path, refused: Any, machined: Any) -> None:
    shutil.copytree(machined.folder / "run", folder / "run")
    line = refused("evaluate", "run", "--out", "part.ngc/judged")
    assert "part.ngc/judged" in line
    assert "cannot write" in line


def test_a_fault_of_the_program_itself_is_not_hidden(
    folder: Path, counterflex: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(gcode_reader, "read_text", broken)
    with pytest.raises(ZeroDivisionError):
        counterflex("path", "part.ngc")
