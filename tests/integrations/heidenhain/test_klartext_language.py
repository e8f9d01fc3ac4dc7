"""Klartext as a registered language: its table drives its reader, it is told by its first lines, it is converted."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.app import conversion
from counterflex.core.errors import CounterflexError, InputError, ProgramError
from counterflex.integrations.heidenhain.language.emitter import HeidenhainEmitter
from counterflex.integrations.heidenhain.language.reader import read_heidenhain, read_heidenhain_file
from counterflex.integrations.heidenhain.language.table import TABLE
from counterflex.programs.compensated import tool_path
from counterflex.programs.convert.steps import MachineFunction, steps
from counterflex.programs.foreign_language import foreign_language
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.program import Motion
from counterflex.programs.reading import dialect_of, read_program_file
from counterflex.programs.stated.two_readings import doubtful_readings
from counterflex.programs.statement_table import Statement, Treatment

EXAMPLES = Path(__file__).parents[3] / "examples"
CELL = EXAMPLES / "cells" / "kr300_d16_small.toml"
HOST = (
    "BEGIN PGM HOST MM\nTOOL CALL 1 Z S1000 F400\nM3\nL X+0 Y+0 Z+5 R0 FMAX\nL Z+0 F500\nL IX+4\nCC X+10 Y+0\n"
    "C X+16 Y+0 DR-\nLP PR+5 PA+30\nQ1 = 3 * 2\nLBL 1\nL IY+Q1\nCALL LBL 1 REP 2\nCYCL DEF 9.0 DWELL\n"
    "CYCL DEF 9.1 DWELL 0.5\nL Z+50 FMAX\nEND PGM HOST MM\n"
)
UNKNOWN = MillingMachine(known=False)


def numbers(motion: Motion) -> tuple[object, ...]:
    """What a motion is, without the block that it belongs to."""
    centre = None if motion.p_centre is None else motion.p_centre.tolist()
    return (motion.kind, motion.p_start.tolist(), motion.p_end.tolist(), motion.feed_m_s, motion.spindle_rad_s,
            motion.tool, motion.duration_s, motion.abc_end, centre, motion.turn_rad)  # fmt: skip


def samples(treatment: Treatment) -> list[tuple[Statement, str]]:
    return [(row, sample) for row in TABLE.of(treatment) for sample in row.samples]


@pytest.mark.parametrize(("row", "sample"), samples(Treatment.NEUTRAL), ids=lambda value: str(value)[:24])
def test_a_neutral_statement_changes_nothing_wherever_it_stands(row: Statement, sample: str) -> None:
    for text in (HOST, (EXAMPLES / "programs" / "groove.h").read_text()):
        lines, plain = text.splitlines(), [numbers(m) for m in read_heidenhain(text, machine=UNKNOWN).motions]
        for place in range(1, len(lines)):
            if "CYCL DEF 9.0" in lines[place - 1]:
                continue  # the lines of a cycle belong together
            inserted = "\n".join([*lines[:place], sample, *lines[place:]]) + "\n"
            made = read_heidenhain(inserted, machine=UNKNOWN)
            assert [numbers(m) for m in made.motions] == plain, (row.word, lines[place])


@pytest.mark.parametrize(("row", "sample"), samples(Treatment.REFUSED), ids=lambda value: str(value)[:24])
def test_a_refused_statement_is_refused_with_a_remedy(row: Statement, sample: str) -> None:
    lines = HOST.splitlines()
    with pytest.raises(ProgramError) as caught:
        read_heidenhain("\n".join([*lines[:5], sample, *lines[5:]]) + "\n")
    assert str(caught.value.where).startswith("program:6"), (row, str(caught.value))
    assert caught.value.hint, (row, str(caught.value))
    assert "unknown" not in str(caught.value), (row, str(caught.value))


@pytest.mark.parametrize(("row", "sample"), samples(Treatment.EVALUATED), ids=lambda value: str(value)[:24])
def test_an_evaluated_statement_is_no_unknown_word(row: Statement, sample: str) -> None:
    lines = HOST.splitlines()
    said = ""
    try:
        read_heidenhain("\n".join([*lines[:5], sample, *lines[5:]]) + "\n")
    except ProgramError as fault:
        said = str(fault)
    for text in ("an unknown", "is not read", "machine builder"):
        assert text not in said, (row, said)


def test_a_file_is_told_by_its_ending_and_by_its_first_lines() -> None:
    assert dialect_of("PART.H") == "heidenhain"
    found = foreign_language(("0 BEGIN PGM A MM", "1 TOOL CALL 1 Z S100"))
    assert found is not None
    assert "--dialect heidenhain" in found.hint


def test_hidden_blocks_are_said() -> None:
    lines = HOST.splitlines()
    lines[5] = "5 / L IX+4"
    (said,) = doubtful_readings(read_heidenhain("\n".join(lines)))
    assert said.startswith("line 6: a block with /")


@pytest.mark.parametrize(
    "name",
    [
        "groove.ngc",
        "tilted_groove.mpf",
        "groove.apt",
        "fc_grooves_pocket.ngc",
        "helix_ramp_return.ngc",
        "two_tools.ngc",
    ],
)
def test_programs_of_other_languages_are_said_in_klartext(tmp_path: Path, name: str) -> None:
    """``convert`` reads back what it writes, and refuses another path, feed or process word."""
    made = conversion.run(EXAMPLES / "programs" / name, CELL, tmp_path / "out", "heidenhain")
    (file,) = made["files"]
    assert made["read_back_um"] <= 1.0
    lines = (tmp_path / "out" / file).read_text().splitlines()
    assert [int(line.split()[0]) for line in lines] == list(range(len(lines)))
    again = conversion.run(tmp_path / "out" / file, CELL, tmp_path / "back", "gcode")
    assert again["motions_out"] == made["motions_out"]
    with pytest.raises(InputError, match="in that language already"):
        conversion.run(tmp_path / "out" / file, CELL, tmp_path / "same", "heidenhain")


def test_a_name_that_the_control_cannot_show_is_shortened(tmp_path: Path) -> None:
    source = tmp_path / "a part with a name that is too long.ngc"
    source.write_text((EXAMPLES / "programs" / "groove.ngc").read_text())
    made = conversion.run(source, CELL, tmp_path / "out", "heidenhain")
    assert made["files"] == ["a_part_with_a_name_that_.h"]
    assert any("does not take the name" in text for text in made["warnings"])


def test_a_reversed_spindle_at_another_speed_is_refused() -> None:
    program = read_gcode("G21 G90\nT1 M6\nM3 S1000\nG0 X0 Y0 Z0\nM4 S2000\nG0 X1\nM2\n")
    emitter = HeidenhainEmitter("a.ngc", "a", 1e-6)
    emitter.begin()
    from counterflex.programs.convert.steps import steps

    processes = [
        s
        for s in steps(program, lambda _: np.diag([1.0, -1.0, -1.0]), to_robot=False)
        if isinstance(s, MachineFunction)
    ]
    with pytest.raises(ProgramError, match="reversed"):
        for step in processes:
            emitter.process(step)


@given(st.lists(st.tuples(*[st.integers(-999_999, 999_999)] * 3, st.floats(1.0, 9000.0)), min_size=1, max_size=6))
@settings(max_examples=40, deadline=None)
def test_coordinates_survive_the_way_into_klartext(points: list[tuple[int, int, int, float]]) -> None:
    """Four decimals and three of the feed: 0.05 um and 1e-3 mm/min."""
    lines = [f"G1 X{x / 1e4} Y{y / 1e4} Z{z / 1e4} F{f:.3f}" for x, y, z, f in points]
    source = read_gcode("\n".join(["G21 G90 G94", "T1 M6", "M3 S1000", "G0 X0 Y0 Z0", *lines, "M2", ""]))
    sequence = list(steps(source, lambda _: np.diag([1.0, -1.0, -1.0]), to_robot=False))
    (text,) = HeidenhainEmitter("a.ngc", "a", 1e-6).write(sequence).files.values()
    back = read_heidenhain(text, complete=True)
    np.testing.assert_allclose(back.motions[-1].p_end, source.motions[-1].p_end, atol=1e-12)
    for a, b in zip(source.motions, back.motions, strict=True):
        assert math.isclose(a.feed_m_s, b.feed_m_s, rel_tol=1e-3, abs_tol=1e-9)


PIECES = ("", ";", "~", "[", "(", '"', ",", "=", "#", "/", ":", "\n", "\r\n", "\0", "9" * 400, "-", "1e999", "nan", ".",
          "LBL 1", "CALL LBL 1 REP 2", "Q1", "R0", "FMAX", "END PGM", "*", "\u00e9")  # fmt: skip


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_damage_is_read_or_refused(data: Any) -> None:
    text = (EXAMPLES / "programs" / "groove.h").read_text() if data.draw(st.booleans()) else HOST
    for _ in range(data.draw(st.integers(1, 4))):
        a = data.draw(st.integers(0, len(text)))
        b = min(len(text), a + data.draw(st.sampled_from([0, 0, 1, 1, 2, 7, 40, 400])))
        text = text[:a] + data.draw(st.sampled_from([*PIECES, text[a:b] * 2, text[a:b][::-1]])) + text[b:]
    said = "damaged"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            read_heidenhain(text, name="damaged", complete=True)
        except CounterflexError as fault:
            said = str(fault)
    assert said.startswith("damaged"), said
    assert "\n" not in said


def test_the_example_is_read_from_its_file(tmp_path: Path) -> None:
    made = read_program_file(EXAMPLES / "programs" / "groove.h", machine=UNKNOWN)
    assert made.dialect == "heidenhain"
    assert len(tool_path(made)) > 2
    file = tmp_path / "latin.h"
    file.write_bytes("BEGIN PGM A MM\n;gr\u00fcn\nL X+1 FMAX\nEND PGM A MM\n".encode("latin-1"))
    assert read_heidenhain_file(file).encoding == "latin-1"
    with pytest.raises(ProgramError, match="--parameters"):
        read_heidenhain_file(file, machine=MillingMachine(part_at_g54=True))
