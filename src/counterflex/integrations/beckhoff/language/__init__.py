"""Reads the G-code of TwinCAT NC I (DIN 66025)."""

from __future__ import annotations

import re
from typing import Final

from counterflex.programs.language import Language

LANGUAGE: Final = Language(
    title="TwinCAT NC I",
    comment=re.compile(r"\(([^()]*)\)"),
    orientation=False,
    read="counterflex.integrations.beckhoff.language.reader:read_twincat_file",
    table="counterflex.integrations.beckhoff.language.reader:TABLE",
    offsets="counterflex.programs.stated.offsets:SettableOffsets",
    spelling="counterflex.integrations.beckhoff.language.emitter:SPELLING",
    in_place="counterflex.programs.gcode.write.writer:write_gcode",
    convert="counterflex.integrations.beckhoff.language.emitter:convert",
)
"""Of its unit nothing is in doubt: G71 is active when a program begins."""
