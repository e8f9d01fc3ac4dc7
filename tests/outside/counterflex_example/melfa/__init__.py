"""A maker of robots in one folder: axes of the arms, programs in MELFA-BASIC read, converted to and written."""

from __future__ import annotations

import re
from typing import Final

from counterflex.programs.language import Language, Signs, StatementForms
from counterflex.programs.limits import Limits
from counterflex.robot.model.controller_axes import Maker

LIMITS: Final = Limits(
    line_characters=240,
    name_characters=12,
    points_per_file=10_000,
    position_decimals=4,
    angle_decimals=5,
    source="set for this example",
)
LANGUAGE: Final = Language(
    title="Mitsubishi MELFA-BASIC",
    short="MELFA-BASIC",
    endings=(".prg",),
    signs=Signs("Mitsubishi MELFA BASIC", (r"^(\d+\s+)?Mv[sr]\s+P", r"^(\d+\s+)?(Ovrd|Spd|Servo)\s+\w+")),
    limits=LIMITS,
    forms=StatementForms(
        lambda why: [f"' {why}", "Hlt"], "Dly {}", lambda condition, _limit_s, _fault: [f"Wait {condition}"], (), "'",
        "M_Out(17)=1", "M_Out({p})=1", "tool_data",
    ),
    waits=re.compile(r"\s*(?:Hlt|Wait)\b", re.IGNORECASE),
    comment=re.compile(r"^\s*'(.*)"),
    read="counterflex_example.melfa.read:read_file",
    cell="counterflex_example.melfa.write:cell_of",
    write="counterflex_example.melfa.write:write",
    convert="counterflex_example.melfa.write:convert",
)  # fmt: skip
AXES: Final = Maker(
    "Mitsubishi", "melfa", (1,) * 6, (0.0,) * 6, "upper_arm", "floor", "all axes zero is the arm stretched upward", "J"
)
