"""Added words must not make a line longer than LinuxCNC's interpreter takes (252 characters, comments included)."""

from __future__ import annotations

import numpy as np

from counterflex.path.toolpath import FEED
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.gcode.write.writer import write_gcode


def test_comments_leave_a_line_that_grows_too_long() -> None:
    comment = f"({'x' * 230})"
    text = f"G21 G17 G90\nM6 T1\nM3 S13000\nG0 X0 Y0 Z5\nG1 X52 F1500 {comment}\nG0 Z42 {comment}\nM2\n"
    program = read_gcode(text, name="long.ngc")
    path = tool_path(program)
    shift = np.where((path.kind == FEED)[:, None], [0.0, 0.2e-3, 0.1e-3], 0.0)
    written = write_gcode(program, CompensatedPath.from_correction(path, shift)).text
    lines = written.splitlines()
    assert max(len(line) for line in lines) <= 252
    assert written.count(comment) == 2
    again = read_gcode(written, name="again.ngc")
    moved = [motion.p_end for motion in again.motions if motion.kind == "feed"]
    assert np.abs(moved[-1] - (path.p_part_tcp + shift)[path.kind == FEED][-1]).max() < 1e-7
