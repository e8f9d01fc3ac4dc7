"""ABB RAPID: compensated programs, and programs whose path EGM corrects or streams."""

from __future__ import annotations

import re
from typing import Final

from counterflex.programs.language import Language, Signs, StatementForms
from counterflex.programs.limits import Limits

LIMITS: Final = Limits(
    line_characters=255,
    name_characters=32,
    points_per_file=5_000,
    position_decimals=4,
    angle_decimals=8,
    source="identifiers: 32 characters (ABB RAPID manual); points per module: limited by program memory only "
    "(cautious)",
)
LANGUAGE: Final = Language(
    title="ABB RAPID",
    short="RAPID",
    work_object=True,
    endings=(".mod", ".modx", ".prg", ".sys", ".sysx", ".pgf"),
    signs=Signs(
        "ABB RAPID",
        (
            r"^%%%",
            r"^MODULE\s+\w+",
            r"^(LOCAL\s+)?PROC\s+\w+$",
            r"^Move(L|J|C|AbsJ)\s+[\[\w*]",
            r"^(LOCAL\s+|TASK\s+)?(PERS|CONST|VAR)\s+\w+\s+\w+",
        ),
        (r"^ENDPROC$", r"^ENDMODULE$", r"^WaitTime\b", r"^Set(DO|AO)\b"),
        "RAPID is read by its suffix: name the file NAME.mod",
    ),
    limits=LIMITS,
    forms=StatementForms(
        lambda why: [f'TPWrite "{why}";', "Stop;"], "WaitTime {};",
        lambda condition, limit_s, _: [f"WaitUntil {condition}\\MaxTime:={limit_s:g};"], (), "!",
        "SetDO doSpindle,1;", "SetDO do{p},1;", "tooldata", ";",
    ),
    waits=re.compile(
        r"\s*(?:\w+\s*:\s*)?(?:Wait(?:DI|DO|GI|GO|AI|AO|Until|SyncTask|Sensor|TestAndSet|Load)\b|(?:Stop|Break)\s*;)",
        re.IGNORECASE,
    ),
    read="counterflex.integrations.abb.language.read.reader:read_rapid_file",
    files="counterflex.integrations.abb.language.read.reader:companion_modules",
    table="counterflex.integrations.abb.language.table:TABLE",
    cell="counterflex.integrations.abb.language.job:cell_of",
    in_place="counterflex.integrations.abb.language.in_place:write_rapid_in_place",
    write="counterflex.integrations.abb.language.job:write",
    convert="counterflex.integrations.abb.language.job:convert",
    load="counterflex.integrations.abb.language.job:load",
)  # fmt: skip
