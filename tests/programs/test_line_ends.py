"""Line ends and encodings of programs: read as they are, written back so, or named."""

from __future__ import annotations

from pathlib import Path

import pytest

from counterflex.core.errors import ProgramError
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.reader import read_gcode, read_gcode_file
from counterflex.programs.gcode.write.writer import write_gcode

TEXT = "G21 G90 F600\nG0 X1\nG0 Y2\nG1 Z-3\nM30\n"


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", "\n\r", "\r\r\n"])
def test_every_line_end_gives_the_same_motions(end: str) -> None:
    text = TEXT.replace("\n", end)
    program = read_gcode(text, complete=True)
    assert [motion.p_end.tolist() for motion in program.motions] == [
        motion.p_end.tolist() for motion in read_gcode(TEXT).motions
    ]
    assert write_gcode(program, CompensatedPath.nominal(tool_path(program))).text.rstrip() == text.rstrip()


def test_a_line_end_that_hides_within_a_line_is_refused() -> None:
    """Read as a blank it would make one diagonal move of two."""
    with pytest.raises(ProgramError, match="carriage return stands within a line") as caught:
        read_gcode("G21 G90\nG0 X1\rY2\nM30\n", name="a.ngc")
    assert caught.value.where == "a.ngc:2:6"


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (TEXT.encode("utf-16"), "UTF-16"),
        (TEXT.encode("utf-16-le"), "UTF-16"),
        (TEXT.encode("utf-16-be"), "UTF-16"),
        (TEXT.encode("utf-32"), "UTF-16"),
        (TEXT.encode() + b"\0\0\0", "zero bytes"),
        (TEXT.encode().replace(b"X1", b"X\x001"), "zero bytes"),
    ],
)
def test_what_is_no_text_is_named(tmp_path: Path, data: bytes, said: str) -> None:
    file = tmp_path / "a.ngc"
    file.write_bytes(data)
    with pytest.raises(ProgramError, match=said):
        read_gcode_file(file)
