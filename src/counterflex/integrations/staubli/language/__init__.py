"""Staubli VAL3: programs (.pgx) with the data file (.dtx) of their application."""

from __future__ import annotations

import re
from typing import Final

from counterflex.programs.language import Language, Signs, StatementForms
from counterflex.programs.limits import Limits

LIMITS: Final = Limits(
    line_characters=255,
    name_characters=24,
    points_per_file=3_000,
    position_decimals=4,
    angle_decimals=5,
    source="no published figures for names and sizes: memory of the controller (cautious)",
)
LANGUAGE: Final = Language(
    title="Staubli VAL3",
    short="VAL3",
    endings=(".pgx",),
    signs=Signs(
        "Staubli VAL 3",
        (r"staubli\.com/robotics/VAL3", r"^(movel|movej|movec)\s*\(\s*\w+\s*,\s*\w+\s*,\s*\w+\s*\)"),
        (r"^begin$", r"^waitEndMove\b"),
    ),
    limits=LIMITS,
    forms=StatementForms(
        lambda why: ["userPage()", f'putln("{why}")', "get()"], "delay({})",
        lambda condition, _limit_s, _fault: [f"wait({condition})"], ("waitEndMove()",), "//",
        "dioSpindle=true", "dio{p}=true", "tooldata",
    ),
    waits=re.compile(r"\s*(?:wait|watch|get|popUpMsg)\s*\(", re.IGNORECASE),
    comment=re.compile(r"^\s*//(.*)"),
    read="counterflex.integrations.staubli.language.read.reader:read_val3_file",
    files="counterflex.integrations.staubli.language.read.branches:job_files",
    table="counterflex.integrations.staubli.language.read.table:TABLE",
    cell="counterflex.integrations.staubli.language.job:cell_of",
    in_place="counterflex.integrations.staubli.language.in_place:write_val3_in_place",
    write="counterflex.integrations.staubli.language.job:write",
    convert="counterflex.integrations.staubli.language.job:convert",
    load="counterflex.integrations.staubli.language.job:load",
)  # fmt: skip
"""It waits for a condition without a limit: ``controller.spindle.wait_s`` is not in it."""
