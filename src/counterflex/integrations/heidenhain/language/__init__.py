"""Reads Klartext of the TNC 640, writes it back with only targets replaced, and writes it anew."""

from __future__ import annotations

import re
from typing import Final

from counterflex.programs.language import Language, Signs
from counterflex.programs.limits import Limits

LIMITS: Final = Limits(
    line_characters=255,
    name_characters=24,
    points_per_file=10_000_000,
    position_decimals=4,
    angle_decimals=4,
    source="names: 24 characters (TNC 640 34059x-05, User's Manual, File names); positions and angles: 4 decimals, "
    "components of vectors: 8 (there, Input format and unit of TNC functions); line length: no published figure "
    "(cautious)",
)
VECTOR_DECIMALS: Final = 8
LANGUAGE: Final = Language(
    title="Heidenhain Klartext (TNC 640)",
    short="Klartext",
    endings=(".h",),
    signs=Signs(
        "Heidenhain conversational",
        (r"^(\d+\s+)?(BEGIN|END) PGM\b", r"^\d+\s+(TOOL CALL|TOOL DEF|BLK FORM|CYCL DEF|CALL LBL|LBL)\b"),
        (r"^(\d+\s+)?L\s+[XYZ][+-]", r"^(\d+\s+)?CC\s+[XYZ]", r"\bFMAX\b", r"\bFN\s*\d+:"),
    ),
    limits=LIMITS,
    comment=re.compile(r"^[^~\n;]*;([^~\n]*)$|^\s*\d*\s*\*[ -]*(.*)$"),
    tool_stays=True,
    orientation=False,
    read="counterflex.integrations.heidenhain.language.reader:read_heidenhain_file",
    table="counterflex.integrations.heidenhain.language.table:TABLE",
    doubts="counterflex.integrations.heidenhain.language.reader:hidden_blocks",
    offsets="counterflex.programs.stated.offsets:ToolBoundOffsets",
    in_place="counterflex.integrations.heidenhain.language.in_place:write_heidenhain",
    convert="counterflex.integrations.heidenhain.language.emitter:convert",
)
