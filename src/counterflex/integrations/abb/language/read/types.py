"""Data types of RAPID: components of records, initial values, data that the controller predefines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from counterflex.programs.unknown import Unknown

NUMERIC: Final = frozenset(
    ("num", "dnum", "byte", "errnum", "intnum", "stoppoint", "triggmode", "icondata", "buttondata")
)
_RECORDS: Final[dict[str, str]] = {
    "pos": "x num, y num, z num",
    "orient": "q1 num, q2 num, q3 num, q4 num",
    "pose": "trans pos, rot orient",
    "confdata": "cf1 num, cf4 num, cf6 num, cfx num",
    "extjoint": "eax_a num, eax_b num, eax_c num, eax_d num, eax_e num, eax_f num",
    "robjoint": "rax_1 num, rax_2 num, rax_3 num, rax_4 num, rax_5 num, rax_6 num",
    "robtarget": "trans pos, rot orient, robconf confdata, extax extjoint",
    "jointtarget": "robax robjoint, extax extjoint",
    "speeddata": "v_tcp num, v_ori num, v_leax num, v_reax num",
    "zonedata": "finep bool, pzone_tcp num, pzone_ori num, pzone_eax num, zone_ori num, zone_leax num, zone_reax num",
    "loaddata": "mass num, cog pos, aom orient, ix num, iy num, iz num",
    "tooldata": "robhold bool, tframe pose, tload loaddata",
    "wobjdata": "robhold bool, ufprog bool, ufmec string, uframe pose, oframe pose",
    "progdisp": "pdisp pose, eoffs extjoint",
    "motsetdata": "vel_oride num, vel_max num",
    "shapedata": "kind num",
}
_SPEEDS: Final = (
    5, 10, 20, 30, 40, 50, 60, 80, 100, 150, 200, 300, 400, 500, 600, 800, 1000, 1500, 2000, 2500, 3000, 4000, 5000,
    6000, 7000,
)  # fmt: skip
_ZONES: Final = {
    0: 0.3, 1: 1, 5: 5, 10: 10, 15: 15, 20: 20, 30: 30, 40: 40, 50: 50, 60: 60, 80: 80, 100: 100, 150: 150, 200: 200,
}  # fmt: skip
_FRAME: Final = [[0, 0, 0], [1, 0, 0, 0]]
_LOAD: Final = [0.001, [0, 0, 0.001], [1, 0, 0, 0], 0, 0, 0]
_ROBOT: Final = Unknown("the largest speed of the robot is not in the program")
PREDEFINED: Final[dict[str, tuple[str, object]]] = {
    **{f"V{v}": ("speeddata", [float(v), 500.0, 5000.0, 1000.0]) for v in _SPEEDS},
    "VMAX": ("speeddata", [_ROBOT, 500.0, 5000.0, 1000.0]),
    "FINE": ("zonedata", [True, 0, 0, 0, 0, 0, 0]),
    **{f"Z{name}": ("zonedata", [False, mm, mm, mm, 0, mm, 0]) for name, mm in _ZONES.items()},
    "TOOL0": ("tooldata", [True, _FRAME, _LOAD]),
    "WOBJ0": ("wobjdata", [False, True, "", _FRAME, _FRAME]),
    "LOAD0": ("loaddata", _LOAD),
    "PI": ("num", 3.1415926535897932),
    "STEMPTY": ("string", ""),
    "DISP0": ("pose", _FRAME),
    "XYZ": ("num", 1), "HIGH": ("num", 1), "LOW": ("num", 0),
}  # fmt: skip
"""Type and value of predefined data by name in capitals (RAPID reference, system data)."""


class Types:
    """Record and alias types of a program."""

    def __init__(self) -> None:
        # Components of each record, name and type, by the type's name; lower case
        self.records: dict[str, tuple[tuple[str, str], ...]] = {
            name: tuple((part.split()[0], part.split()[1]) for part in text.split(","))
            for name, text in _RECORDS.items()
        }
        self.aliases: dict[str, str] = {}  # Type that another name stands for

    def real(self, kind: str) -> str:
        """Return the type behind an alias."""
        for _ in range(10):
            if kind not in self.aliases:
                break
            kind = self.aliases[kind]
        return kind

    def component(self, kind: str, name: str) -> tuple[int, str] | None:
        """Return index and type of a component; None where the type has no such component."""
        parts = self.records.get(self.real(kind), ())
        for index, (part, its_kind) in enumerate(parts):
            if part == name.lower():
                return index, its_kind
        return None

    def known(self, kind: str) -> bool:
        """Return whether values of a type are numbers, truth values, strings or records of them."""
        kind = self.real(kind)
        return kind in NUMERIC or kind in ("bool", "string", "switch") or kind in self.records

    def initial(self, kind: str, dims: Sequence[int] = ()) -> object:
        """Return the value that data of a type has where its declaration gives none."""
        if dims:
            return [self.initial(kind, dims[1:]) for _ in range(dims[0])]
        kind = self.real(kind)
        if kind in self.records:
            return [self.initial(part) for _, part in self.records[kind]]
        if kind in NUMERIC:
            return 0
        if kind == "string":
            return ""
        return False if kind == "bool" else Unknown(f"data of type {kind} is not evaluated")

    def spread(self, kind: str, dims: Sequence[int], unknown: Unknown) -> object:
        """Return a value of a type with every number unknown."""
        if dims:
            return [self.spread(kind, dims[1:], unknown) for _ in range(dims[0])]
        kind = self.real(kind)
        if kind in self.records:
            return [self.spread(part, (), unknown) for _, part in self.records[kind]]
        return unknown


def copy_of(value: object) -> object:
    """Return a value whose parts are its own."""
    return [copy_of(item) for item in value] if isinstance(value, list) else value
