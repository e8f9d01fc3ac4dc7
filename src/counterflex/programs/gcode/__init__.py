"""G-code (RS274/NGC): reading it, and writing it back with other targets."""

from __future__ import annotations

import re
from typing import Final

from counterflex.programs.language import Language, UnitWords

LANGUAGE: Final = Language(
    title="the language of the program itself",
    prompt="gcode",
    comment=re.compile(r"\(([^()]*)\)|;(.*)"),
    orientation=False,
    read="counterflex.programs.gcode.read.reader:read_gcode_file",
    table="counterflex.programs.gcode.read.code_table:TABLE",
    units=UnitWords(frozenset({20.0, 21.0}), "G20, G21"),
    offsets="counterflex.programs.stated.offsets:IsoOffsets",
    spelling="counterflex.programs.gcode.write.written_line:RS274",
    in_place="counterflex.programs.gcode.write.writer:write_gcode",
    write="counterflex.app.compensation.languages:refuse_robot_program",
    convert="counterflex.programs.convert.machine_languages:gcode",
)
