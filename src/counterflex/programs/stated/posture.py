"""Posture of the arm that a robot program asks for, by the words of its language.

A pose is reached with the wrist centre ahead of or behind axis 1, with the arm bent to either side of the straight
forearm, and with axis 5 to either side of zero. Words: ``S`` of KRL in PTP motions (bit 0: behind axis 1; bit 1: axis 3
above the angle at which the arm is straight; bit 2: axis 5 negative), ``cfx`` of RAPID while ConfJ or ConfL is on (0
to 7: behind axis 1, wrist behind the lower arm, axis 5 negative), CONFIG of FANUC (N F, U D, T B), shoulder, elbow and
wrist of VAL3.

Sources: KUKA System Software, Operating and programming instructions, "Status" and its poses (A1 0, A2 -90, A3 90 is S
2); ABB Technical reference manual, RAPID, ``confdata``; FANUC R-30iB, Operator's manual, "Position data"; Staubli, VAL3
Reference manual, type ``config``.
"""

from __future__ import annotations

from counterflex.programs.program import Program
from counterflex.programs.robot_text.program import RobotProgram
from counterflex.programs.robot_text.stated import Stated


def stated_postures(program: Program) -> dict[int, Stated]:
    """Return the posture that motions ask for, by index of the motion.

    Args:
        program: As read; of a language without such words nothing is stated.
    """
    return program.postures() if isinstance(program, RobotProgram) else {}


def other_postures(program: Program, branch: str) -> list[str]:
    """Return one sentence where motions ask for another posture than the one that is planned in, such as a ``flip``."""
    others = {i: words for i, (posture, words) in stated_postures(program).items() if not posture.agrees(branch)}
    if not others:
        return []
    first = min(others)
    place = program.blocks[program.motions[first].block].where(program.name)
    return [
        f"{place}: the program asks for another posture ({others[first]}; {len(others)} targets) than the one planned "
        f"in, {branch}: set shoulder, elbow and wrist of [posture] to those of the program"
    ]
