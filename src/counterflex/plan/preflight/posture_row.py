"""Posture of the arm that the program states, against the one that everything else is checked in."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.path.toolpath import ToolPath
from counterflex.plan.preflight.row import NOT_LOOKED_AT, Row
from counterflex.programs.robot_text.stated import Stated

CHECK: Final = "posture of the program"
_WORDS: Final = "S of PTP targets, robconf under ConfJ or ConfL, CONFIG, or shoulder, elbow and wrist"


def posture_row(stated: dict[int, Stated] | None, branch: str, path: ToolPath) -> Row:
    """Row of the posture.

    Args:
        stated: By motion, of a program in a language of robots; None of other languages.
        branch: Posture that is checked, such as ``front up noflip``.
        path: The program.
    """
    if stated is None:
        return Row(CHECK, "ok", what=f"the program states none; checked in {branch}")
    if not stated:
        what = f"no target states a posture ({_WORDS}): it is that in which the robot comes; checked in {branch}"
        return Row(CHECK, NOT_LOOKED_AT, what=what)
    others = {index: words for index, (posture, words) in stated.items() if not posture.agrees(branch)}
    if not others:
        return Row(CHECK, "ok", float(0), float(0), what=f"{branch}, as {len(stated)} targets say")
    first = min(others)
    rows = np.flatnonzero(path.motion == first)
    return Row(
        CHECK, "fail", float(len(others)), float(0), "", int(rows[-1]) if rows.size else None,
        f"targets with another posture than {branch}, in which reach, axes and bodies are checked: {others[first]}",
        advice="Set shoulder, elbow and wrist of [posture] to those of the program, or post the program for these",
    )  # fmt: skip
