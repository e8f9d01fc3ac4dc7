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

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from counterflex.programs.fanuc.program import FanucProgram
from counterflex.programs.krl.program import KrlMotion, KrlProgram
from counterflex.programs.program import Program
from counterflex.programs.rapid.program import RapidMotion, RapidProgram
from counterflex.programs.val3.program import Val3Program

_OFF: Final = re.compile(r"^(?:[^!\"]|\"[^\"]*\")*?\bConf([JL])\s*\\\s*Off\b", re.IGNORECASE)
_FANUC: Final = re.compile(r"\s*([NF])\s*([UD])\s*([TB])\b", re.IGNORECASE)


_VAL3: Final = (("righty", "lefty"), ("epositive", "enegative"), ("wpositive", "wnegative"))


@dataclass(frozen=True, slots=True)
class StatedPosture:
    """Posture as far as it is stated; None is not.

    Attributes:
        front: The wrist centre lies ahead of axis 1.
        bent: Axis 3 is beyond the angle at which the arm is straight, in the direction of elbow up of a front arm.
        noflip: Axis 5 is positive in the sense of the closed form.
    """

    front: bool | None = None
    bent: bool | None = None
    noflip: bool | None = None

    def agrees(self, branch: str) -> bool:
        """Return whether nothing of it contradicts a posture such as ``front up noflip``."""
        arm, elbow, wrist = branch.split()
        front = arm == "front"
        own = (front, (elbow == "up") == front, wrist == "noflip")
        stated = (self.front, self.bent, self.noflip)
        return all(a is None or a == b for a, b in zip(stated, own, strict=True))


Stated = tuple[StatedPosture, str]
"""A posture and the words that state it."""


def stated_postures(program: Program) -> dict[int, Stated]:
    """Return the posture that motions ask for, by index of the motion.

    Args:
        program: As read; of a language without such words nothing is stated.
    """
    given: dict[int, Stated | None] = {}
    if isinstance(program, KrlProgram):
        given = {index: _krl(move) for index, move in enumerate(program.moves)}
    elif isinstance(program, RapidProgram):
        on = supervised_words(program)
        given = {index: _rapid(move) for index, move in enumerate(program.moves)
                 if ("J" if move.word.upper().startswith("MOVEJ") else "L") in on}  # fmt: skip
    elif isinstance(program, FanucProgram):
        given = {index: _fanuc(move.config) for index, move in enumerate(program.moves)}
    elif isinstance(program, Val3Program):
        given = {index: _val3(move.attributes) for index, move in enumerate(program.moves)}
    return {index: stated for index, stated in given.items() if stated is not None}


def supervised_words(program: RapidProgram) -> set[str]:
    """Return which of MoveJ (``J``) and MoveL (``L``) hold their configuration all along a RAPID program."""
    off = {match[1].upper() for line in program.lines if (match := _OFF.match(line)) is not None}
    return {"J", "L"} - off


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


def _krl(move: KrlMotion) -> Stated | None:
    """S of a PTP; in other motions the controller ignores it."""
    status = None if move.target is None else move.target.components.get("S")
    if status is None or move.word not in ("PTP", "SPTP"):
        return None
    bits = round(status.value)
    return StatedPosture(not bits & 1, bool(bits & 2), not bits & 4), f"S {bits}"


def _rapid(move: RapidMotion) -> Stated | None:
    number = None if move.target is None else move.target.cfx
    if number is None or number not in range(8):
        return None
    front, behind, negative = number < 4, bool(number & 2), bool(number & 1)
    return StatedPosture(front, not behind if front else None, not negative), f"cfx {number}"


def _fanuc(text: str) -> Stated | None:
    match = _FANUC.match(text)
    if match is None:
        return None
    wrist, elbow, arm = match[1].upper(), match[2].upper(), match[3].upper()
    front = arm == "T"
    return StatedPosture(front, (elbow == "U") == front, wrist == "N"), f"CONFIG '{wrist} {elbow} {arm}'"


def _val3(attributes: Mapping[str, str]) -> Stated | None:
    words = [attributes.get(name, "") for name in ("shoulder", "elbow", "wrist")]
    front, bent, noflip = (
        {yes: True, no: False}.get(word)
        for word, (yes, no) in zip(words, _VAL3, strict=True)
    )  # fmt: skip
    if front is None and bent is None and noflip is None:
        return None
    return StatedPosture(front, bent, noflip), " ".join(word for word in words if word)
