"""Tables of G-code, Sinumerik, TwinCAT and APT: neutral words change no motion, refused ones are refused.

A neutral statement is inserted between any two lines of valid programs; the motions stay bit for bit. A refused one
ends in an error with its line, its reason and its remedy, and no motion.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from counterflex.core.errors import ProgramError
from counterflex.integrations.beckhoff.language.reader import read_twincat
from counterflex.integrations.siemens.language.reader import read_sinumerik
from counterflex.programs.apt.reader import read_apt
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.program import Motion, Program
from counterflex.programs.reading import statement_tables
from counterflex.programs.statement_table import Treatment

UNKNOWN = MillingMachine(known=False)
READERS: dict[str, Callable[[str], Program]] = {
    "linuxcnc": lambda text: read_gcode(text, machine=UNKNOWN),
    "sinumerik": lambda text: read_sinumerik(text, machine=UNKNOWN),
    "twincat": lambda text: read_twincat(text, machine=UNKNOWN),
    "apt": lambda text: read_apt(text),
}
GROOVES = {"linuxcnc": "groove.ngc", "sinumerik": "groove.mpf", "apt": "groove.apt"}
HOSTS = {
    "linuxcnc": (
        "G21 G90 G17 G54\nT1 M6\nG43 H1\nM3 S9000\nG0 X0 Y0 Z5\nG1 Z-1 F300\nG91\nG1 X3\nG90\nG2 X8 Y5 I0 J5\n"
        "G0 Z5\nG99 G81 X1 Y1 Z-2 R2\nX4\nG80\nG16\nG0 X10 Y30\nG15\n"
        "G68 X0 Y0 R30\nG0 X1 Y2\nG3 X3 Y2 R1\nG69\nG0 X0 Y0\nM2\n"
    ),
    "sinumerik": (
        "G54 G17 G90 G71 G94\nT1\nM6\nM3 S9000\nG0 X0 Y0 Z5\nG1 Z-1 F300\nG91\nG1 X3\nG90\nG2 X8 Y5 I0 J5\nG0 Z5\n"
        "TRANS X5\nG0 X1 Y1\nMIRROR X0\nG1 X2 Y2\nG3 X4 Y2 CR=1\nTRANS\nG0 X0 Y0\nFOR R1=1 TO 3\nG1 X=R1*2\nENDFOR\n"
        "MCALL CYCLE81(5,0,2,-3)\nG0 X1\nMCALL\nM30\n"
    ),
    "twincat": "G71 G90 G54\nT1\nM6\nM3 S9000\nG0 X0 Y0 Z5\nG1 Z-1 F300\nG91\nG1 X3\nG90\nG2 X8 Y5 I0 J5\nG0 Z5\nM30\n",
    "apt": (
        "PARTNO HOST\nUNITS/MM\nLOADTL/1\nSPINDL/9000,CLW\nFEDRAT/600,MMPM\nRAPID\nGOTO/0,0,5\nGOTO/0,0,-1\n"
        "GODLTA/5,0,0\nCIRCLE/5,5,-1,0,0,1,5\nGOTO/10,5,-1\nDELAY/1\nRAPID\nGOTO/0,0,5\nFINI\n"
    ),
}
LANGUAGES = sorted(set(READERS) & set(statement_tables()))
ROWS = [(name, row) for name in LANGUAGES for row in statement_tables()[name].rows]
NEUTRAL = [(n, row.word, sample) for n, row in ROWS if row.treatment is Treatment.NEUTRAL for sample in row.samples]
REFUSED = [(n, row, sample) for n, row in ROWS if row.treatment is Treatment.REFUSED for sample in row.samples]
EVALUATED = [(n, row, sample) for n, row in ROWS if row.treatment is Treatment.EVALUATED for sample in row.samples]
EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "programs"


def numbers(motion: Motion) -> tuple[object, ...]:
    """What a motion is, without the block that it belongs to."""
    centre = None if motion.p_centre is None else motion.p_centre.tolist()
    return (
        motion.kind, motion.p_start.tolist(), motion.p_end.tolist(), motion.feed_m_s, motion.spindle_rad_s, motion.tool,
        motion.duration_s, motion.abc_start, motion.abc_end, centre, motion.turn_rad, motion.feed_rad_s,
    )  # fmt: skip


def motions(name: str, text: str) -> list[tuple[object, ...]]:
    return [numbers(motion) for motion in READERS[name](text).motions]


def hosts(name: str) -> list[str]:
    texts = [HOSTS[name]]
    if name in GROOVES:
        texts.append((EXAMPLES / GROOVES[name]).read_text())
    return texts


@pytest.mark.by_turn
@pytest.mark.parametrize(("name", "word", "sample"), NEUTRAL, ids=lambda value: str(value)[:24])
def test_a_neutral_statement_changes_nothing_wherever_it_stands(name: str, word: str, sample: str) -> None:
    for text in hosts(name):
        lines, plain = text.splitlines(), motions(name, text)
        for place in range(1, len(lines)):
            if name == "apt" and lines[place - 1].startswith("CIRCLE"):
                continue  # a circle and its end belong together
            inserted = "\n".join([*lines[:place], sample, *lines[place:]]) + "\n"
            assert motions(name, inserted) == plain, (word, place, lines[place])


@pytest.mark.parametrize(("name", "row", "sample"), REFUSED, ids=lambda value: str(value)[:24])
def test_a_refused_statement_is_refused_with_a_remedy(name: str, row: object, sample: str) -> None:
    lines = HOSTS[name].splitlines()
    at = next(index for index, line in enumerate(lines) if "G0 X0 Y0 Z5" in line or line == "GOTO/0,0,5") + 1
    with pytest.raises(ProgramError) as caught:
        READERS[name]("\n".join([*lines[:at], sample, *lines[at:]]) + "\n")
    assert str(caught.value.where).startswith(f"program:{at + 1}"), (row, str(caught.value))
    assert caught.value.hint, (row, str(caught.value))
    assert "unknown" not in str(caught.value), (row, str(caught.value))


@pytest.mark.parametrize(("name", "row", "sample"), EVALUATED, ids=lambda value: str(value)[:24])
def test_an_evaluated_statement_is_no_unknown_word(name: str, row: object, sample: str) -> None:
    lines = HOSTS[name].splitlines()
    at = next(index for index, line in enumerate(lines) if "G0 X0 Y0 Z5" in line or line == "GOTO/0,0,5") + 1
    said = ""
    try:
        READERS[name]("\n".join([*lines[:at], sample, *lines[at:]]) + "\n")
    except ProgramError as fault:
        said = str(fault)
    for text in ("unknown word", "unknown G code", "unknown M code", "no statement", "is not read:"):
        assert text not in said, (row, said)
