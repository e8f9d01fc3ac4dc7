"""Spelling of remarks and positions in a FANUC listing."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.integrations.fanuc.language import LIMITS
from counterflex.integrations.fanuc.language.program import wpr_of
from counterflex.programs.gcode.write.written_line import number

REMARK: Final = 32
"""Characters of a remark (FANUC Operator's manual, "Remark"): the mark of a job fits exactly."""


def remarks(messages: Iterable[str]) -> Iterator[str]:
    """Comments as remarks, each cut between words; without the semicolons that end statements."""
    for message in messages:
        yield from textwrap.wrap(message.replace(";", ","), REMARK) or [""]


def short(value: float) -> str:
    """A number with four decimals at most, without trailing zeros."""
    return number(value, 4).rstrip("0").rstrip(".")


def values_text(T_user_tool: Float) -> str:
    """X Y Z in mm and W P R in deg of a pose (4, 4) m, as they stand in an entry of /POS."""
    p = T_user_tool[:3, 3] / MM
    texts = [f"{c} = {number(float(v), LIMITS.position_decimals)} mm" for c, v in zip("XYZ", p, strict=True)]
    angles = np.array(wpr_of(T_user_tool[:3, :3]))
    turns = [f"{c} = {number(float(v), LIMITS.angle_decimals)} deg" for c, v in zip("WPR", angles, strict=True)]
    return f"\t{', '.join(texts)},\n\t{', '.join(turns)}"
