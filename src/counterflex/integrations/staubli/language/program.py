"""A VAL3 program as read: its motions, and where in the data file the numbers of every point stand."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose, rotation
from counterflex.programs.robot_text.program import NamedPoint, RobotProgram, Span, Stated, StatedPosture

_NUMBER: Final = re.compile(r"[0-9]+(?:\.[0-9]*)?|\.[0-9]+")
_WORDS: Final = (("righty", "lefty"), ("epositive", "enegative"), ("wpositive", "wnegative"))
LETTERS: Final = ("x", "y", "z", "rx", "ry", "rz")
Key = tuple[str, int]
"""Name of a variable and index of the element: ``p`` and ``p[0]`` are the same."""


def frame_of(values: Mapping[str, float]) -> Float:
    """(4, 4) m of x y z (mm) and rx ry rz (deg): about x, then the new y, then the new z.

    ``R = Rx(rx) Ry(ry) Rz(rz)``. Source: Staubli VAL3 Reference manual, type ``trsf``: "rotation about the X axis, then
    about the new Y axis, then about the new Z axis"; RoboDK's post for VAL3 writes points so.
    """
    rx, ry, rz = (values[letter] * DEG for letter in LETTERS[3:])
    R: Float = rotation.about_x(rx) @ rotation.about_y(ry) @ rotation.about_z(rz)
    return pose.make(R, np.array([values[letter] for letter in LETTERS[:3]]) * MM)


def rotations_of(R: Float) -> tuple[float, float, float]:
    """rx, ry, rz in deg of an orientation (3, 3); the inverse of :func:`frame_of`."""
    rz, ry, rx = (float(angle) for angle in rotation.to_zyx(R.T) / DEG)
    return -rx, -ry, -rz


@dataclass(frozen=True, slots=True)
class Val3Value:
    """An element of a variable of the data file."""

    data: int  # Index in :attr:`Val3Program.data` of the ``<`` of its Value; -1 where the file does not write it
    end: int  # Index of the ``/>`` or ``>`` of that tag
    attributes: Mapping[str, str]  # Text by name of attribute
    spans: Mapping[str, Span]  # Where each text stands


@dataclass(frozen=True, slots=True)
class Val3Data:
    """A variable of the data file."""

    kind: str  # ``pointRx``, ``frame``, ``tool``, ``mdesc``, ..
    head: str  # Its opening tag
    values: Mapping[int, Val3Value]  # Elements by index
    size: int = 1  # Number of elements


@dataclass(frozen=True, slots=True, kw_only=True)
class Val3Motion(NamedPoint):
    """Text behind a motion of :attr:`Val3Program.motions`."""

    word: str  # ``movej movel movec``, or ``delay`` of a dwell, whose head is that of the ``waitEndMove()`` before it
    attributes: Mapping[str, str] = field(default_factory=dict)  # Of its end in the data file: configuration and father
    point: Key | None = None  # Its end, where it is a point of the data file as it stands there; else None
    auxiliary: Key | None = None  # Point on a circle, of the same kind as ``point``
    auxiliary_named: Span = (0, 0)  # Where that stands
    tool: str = ""  # As written
    speed: Mapping[str, str] = field(default_factory=dict)  # Attributes of its mdesc
    speed_named: Span = (0, 0)  # Where that stands
    exact: bool = False  # It stops at its end

    @property
    def moves(self) -> bool:
        """It is no wait."""
        return self.word != "delay"


@dataclass(frozen=True, slots=True)
class Val3Source:
    """A program file of a job."""

    text: str  # As read
    code: int  # Index of the first character behind ``begin``


@dataclass(frozen=True, slots=True)
class Val3Program(RobotProgram):
    """A program in VAL3, with the programs of its application that it calls."""

    sources: Mapping[str, Val3Source] = field(default_factory=dict)  # Program files by name, the main one first
    data: str = ""  # The data file
    data_name: str = ""  # Its name
    moves: tuple[Val3Motion, ...] = ()  # One for each of ``motions``
    variables: Mapping[str, Val3Data] = field(default_factory=dict)  # Of the data file, by name
    mentions: Mapping[Key, int] = field(default_factory=dict)  # How often the program uses each point
    datas_end: int = 0  # Index of ``</Datas>`` in the data file
    old: bool = False  # The data file is in the form of s6

    def stops(self) -> frozenset[int]:
        """Motions with blend off."""
        return frozenset(index for index, move in enumerate(self.moves) if move.exact)

    def roundings_m(self) -> list[float]:
        """The shorter one of ``leave`` and ``reach`` of the mdesc, mm."""
        return [0.0 if move.exact else _rounding_m(move.speed) for move in self.moves]

    def postures(self) -> dict[int, Stated]:
        """Shoulder, elbow and wrist."""
        return {index: one for index, move in enumerate(self.moves) if (one := _posture(move.attributes)) is not None}


def _rounding_m(attributes: Mapping[str, str]) -> float:
    matches = [_NUMBER.fullmatch(attributes.get(name, "").strip()) for name in ("leave", "reach")]
    return min((float(match[0]) * MM for match in matches if match is not None), default=float("nan"))


def _posture(attributes: Mapping[str, str]) -> Stated | None:
    words = [attributes.get(name, "") for name in ("shoulder", "elbow", "wrist")]
    front, bent, noflip = (
        {yes: True, no: False}.get(word)
        for word, (yes, no) in zip(words, _WORDS, strict=True)
    )  # fmt: skip
    if front is None and bent is None and noflip is None:
        return None
    return StatedPosture(front, bent, noflip), " ".join(word for word in words if word)
