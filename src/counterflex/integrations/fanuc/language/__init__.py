"""FANUC TP programs in their listing form, LS."""

from __future__ import annotations

import re
from typing import Final

from counterflex.programs.language import Language, Signs, StatementForms
from counterflex.programs.limits import Limits

LIMITS: Final = Limits(
    line_characters=255,
    name_characters=36,
    points_per_file=1_400,
    position_decimals=4,
    angle_decimals=5,
    source="names: 36 characters (FANUC R-30iB, Operator's manual; 8 before R-30iA); position numbers of a program: "
    "1 to 1500 (there)",
)


def _remark(why: str) -> str:
    """A remark has 32 characters on a FANUC controller."""
    short = why.replace(", then press start", "").replace(" counter-clockwise", " (M4)")
    return short.replace("start the spindle", "start spindle")


LANGUAGE: Final = Language(
    title="FANUC TP listings",
    short="FANUC TP",
    endings=(".ls",),
    signs=Signs("a FANUC robot program (LS)", (r"^/(PROG|ATTR|APPL|MN|POS)\b",), (r"^\d+:\s*[JLC]\s+P\[",)),
    limits=LIMITS,
    forms=StatementForms(
        lambda why: [f"!{_remark(why)}", "PAUSE"], "WAIT {}(sec)",
        lambda condition, _limit_s, _fault: [f"WAIT {condition}"], (), "!",
        "DO[17]=ON", "DO[{p}]=ON", "tool_data",
    ),
    waits=re.compile(r"[\s\d:]*(?:WAIT\b(?!\s*[\d.]+\s*\(\s*sec)|PAUSE\b)", re.IGNORECASE),
    comment=re.compile(r"^[\s\d]*:\s*!([^;]*)"),
    read="counterflex.integrations.fanuc.language.read.reader:read_fanuc_file",
    files="counterflex.integrations.fanuc.language.read.routine:job_files",
    table="counterflex.integrations.fanuc.language.read.table:TABLE",
    doubts="counterflex.integrations.fanuc.language.read.reader:further_groups",
    cell="counterflex.integrations.fanuc.language.job:cell_of",
    in_place="counterflex.integrations.fanuc.language.in_place:write_fanuc_in_place",
    write="counterflex.integrations.fanuc.language.job:write",
    convert="counterflex.integrations.fanuc.language.job:convert",
    load="counterflex.integrations.fanuc.language.job:load",
)  # fmt: skip
"""It waits for a condition without a limit: ``controller.spindle.wait_s`` is not in it."""
