"""Sinumerik: its dialect of G-code, read, converted to and written."""

from __future__ import annotations

import re
from typing import Final

from counterflex.programs.gcode.sinumerik import LIMITS
from counterflex.programs.language import Language, Signs, UnitWords

LANGUAGE: Final = Language(
    title="Sinumerik",
    short="Sinumerik",
    endings=(".mpf", ".spf"),
    signs=Signs(
        "Sinumerik",
        (
            r"^;\$PATH=",
            r"^%_N_",
            r"\bCYCLE\d{2,4}\b",
            r"\bT\s*=\s*\"",
            r"\b(TRAORI|TRANSMIT|TRACYL|TRAFOOF|SUPA|STOPRE|FFWON|COMPCAD|COMPCURV)\b",
            r"\bWORKPIECE\b",
            r"^(N\d+\s*)?A?(TRANS|ROT|MIRROR|SCALE)(\s|$)",
            r"^(N\d+\s*)?DEF\s+(REAL|INT|BOOL|STRING|AXIS|CHAR|FRAME)\b",
            r"^(N\d+\s*)?MSG$",
            r"\bCR\s*=",
            r"^(N\d+\s*)?PROC\s+\w+.*(SAVE|DISPLOF|SBLOF)",
        ),
        (
            r"\b[XYZABCIJKFSR]\s*=",
            r"\bR\d+\s*=",
            r"\bGOTO[FB]\b",
            r"^(N\d+\s*)?(IF|ENDIF|ELSE|FOR|ENDFOR|WHILE|ENDWHILE)\b",
        ),
    ),
    limits=LIMITS,
    comment=re.compile(r";(?!\$PATH)(.*)"),
    tool_stays=True,
    orientation=False,
    read="counterflex.integrations.siemens.language.reader:read_sinumerik_file",
    table="counterflex.programs.gcode.sinumerik.words:TABLE",
    units=UnitWords(frozenset({70.0, 71.0, 700.0, 710.0}), "G70, G71, G700, G710"),
    offsets="counterflex.programs.stated.offsets:ToolBoundOffsets",
    spelling="counterflex.integrations.siemens.language.emitter:SPELLING",
    in_place="counterflex.programs.gcode.write.writer:write_gcode",
    convert="counterflex.integrations.siemens.language.emitter:convert",
)
