"""INFORM III jobs (JBI): read, executed, edited in place, written."""

from __future__ import annotations

import re
from typing import Final

from counterflex.programs.language import Language, Signs, StatementForms
from counterflex.programs.limits import Limits

LIMITS: Final = Limits(
    line_characters=255,
    name_characters=32,
    points_per_file=5_000,
    position_decimals=3,
    angle_decimals=4,
    source="names: 32 characters (DX100 and later; NX100 8), positions in 0.001 mm and 0.0001 deg (DX200, YRC1000: "
    "job data format); positions per job: no published figure, steps are shown with four digits (cautious)",
)


def _comment(why: str) -> str:
    """A comment has 32 characters."""
    short = why.replace(", then press start", "").replace(" counter-clockwise", " (M4)")
    return short.replace("start the spindle", "start spindle")


LANGUAGE: Final = Language(
    title="Yaskawa INFORM jobs",
    short="INFORM",
    endings=(".jbi",),
    signs=Signs("Yaskawa INFORM", (r"^/JOB$", r"^//(NAME|POS|INST)\b"), (r"^MOV[JLC]\s+C\d+", r"^NOP$")),
    limits=LIMITS,
    forms=StatementForms(
        lambda why: [f"'{_comment(why)}", "PAUSE"], "TIMER T={}",
        lambda condition, _limit_s, _fault: [f"WAIT {condition}"], (), "'",
        "DOUT OT#(17) ON", "DOUT OT#({p}) ON", "tool_data",
    ),
    waits=re.compile(r"\s*(?:WAIT|PAUSE)\b", re.IGNORECASE),
    comment=re.compile(r"^\s*'(.*)"),
    read="counterflex.integrations.yaskawa.language.reader:read_inform_file",
    files="counterflex.integrations.yaskawa.language.source:job_files",
    table="counterflex.integrations.yaskawa.language.table:TABLE",
    doubts="counterflex.integrations.yaskawa.language.program:doubts",
    cell="counterflex.integrations.yaskawa.language.job:cell_of",
    in_place="counterflex.integrations.yaskawa.language.in_place:write_inform_in_place",
    write="counterflex.integrations.yaskawa.language.job:write",
    convert="counterflex.integrations.yaskawa.language.job:convert",
    load="counterflex.integrations.yaskawa.language.job:load",
)  # fmt: skip
"""It waits for a condition without a limit: ``controller.spindle.wait_s`` is not in it."""
