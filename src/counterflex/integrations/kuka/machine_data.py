"""Machine data of a KUKA controller (``$machine.dat``): where the robot stands, software limits, lengths, its name."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from counterflex.app.controller_import.frames import ControllerData, DataKind, Load
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose, rotation
from counterflex.programs.robot_text.process_words import NUMBER

_LINE: Final = re.compile(
    r"^\s*(TOOL|BASE|LOAD)_(DATA|NAME)\s*\[\s*(\d+)\s*,?\s*\]\s*=\s*(.*?)\s*(?:;.*)?$", re.IGNORECASE
)
_PART: Final = re.compile(rf"\b([XYZABC])\s+({NUMBER})", re.IGNORECASE)
_FRAME: Final = re.compile(
    rf"\{{\s*(?:\w+\s*:\s*)?[A-Z]\d?\s+{NUMBER}(?:\s*,\s*[A-Z]\d?\s+{NUMBER})*\s*\}}", re.IGNORECASE
)
"""Components with nothing between them: a decimal comma would leave half a number."""
_MASS: Final = re.compile(rf"\{{\s*M\s+({NUMBER})\s*,\s*CM\s*\{{([^{{}}]*)\}}", re.IGNORECASE)
_FRAME_HEAD: Final = re.compile(r"^\s*DEFDAT\s+\$CONFIG\b", re.IGNORECASE | re.MULTILINE)
_AS_SAVED: Final = "Give the file as the controller saved it"
_KINDS: Final = {"TOOL": "tool", "BASE": "base"}


def is_kuka(text: str) -> bool:
    """Return whether a text is a ``$config.dat``."""
    return _FRAME_HEAD.search(text) is not None


def read_kuka(text: str, where: str) -> ControllerData:
    """Frames of a ``$config.dat``; those that are all zeros were never set, and are left out.

    Raises:
        FileFormatError: A frame that is set is damaged, or there twice.
    """
    out = ControllerData("KUKA")
    seen: set[tuple[str, str, str]] = set()
    for line, content in enumerate(text.splitlines(), start=1):
        match = _LINE.match(content)
        if match is None:
            continue
        word, kind, number, value = match[1].upper(), match[2].upper(), match[3], match[4]
        place = f"{where}:{line}"
        if (word, kind, number) in seen:
            raise FileFormatError(f"{word}_{kind}[{number}] is there twice", where=place,
                                  hint="Give the file as the controller saved it")  # fmt: skip
        seen.add((word, kind, number))
        if kind == "NAME":
            name = value.strip().strip('"').strip()
            if name and word in _KINDS:
                out.titles[f"{_KINDS[word]} {number}"] = name
        elif word == "LOAD":
            _load(out, number, value, place)
        else:
            T = frame_of_text(value, place)
            if np.any(np.eye(4) != T):
                (out.tools if word == "TOOL" else out.bases)[number] = T
    return out


def frame_of_text(text: str, where: str) -> Float:
    """(4, 4) m of ``{X ..,Y ..,Z ..,A ..,B ..,C ..}``. Raises FileFormatError: it is something else."""
    parts = [(match[1].upper(), float(match[2])) for match in _PART.finditer(text)]
    values = dict(parts)
    if sorted(letter for letter, _ in parts) != sorted("XYZABC") or _FRAME.fullmatch(text) is None:
        raise FileFormatError("a frame is damaged", where=where, value=text[:60], hint=_AS_SAVED,
                              limit="{X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}")  # fmt: skip
    R = rotation.from_zyx(np.array([values[c] for c in "ABC"]) * DEG)
    return pose.make(R, np.array([values[c] for c in "XYZ"]) * MM)


def _load(out: ControllerData, number: str, text: str, where: str) -> None:
    match = _MASS.match(text)
    if match is None or _FRAME.fullmatch(f"{{{match[2]}}}") is None:
        raise FileFormatError("load data are damaged", where=where, value=text[:60], hint=_AS_SAVED,
                              limit="{M 86.0,CM {X 0.0,...},J {...}}")  # fmt: skip
    mass = float(match[1])
    if mass <= 0.0:
        return  # -1: the load on the plate is that of the machine data
    com = {part[1].upper(): float(part[2]) for part in _PART.finditer(match[2])}
    x, y, z = (com.get(letter, 0.0) * MM for letter in "XYZ")
    out.loads[number] = Load(mass, (x, y, z))


_HEAD: Final = re.compile(r"^\s*DEFDAT\s+\$MACHINE\b", re.IGNORECASE | re.MULTILINE)
_OTHER: Final = re.compile(
    r"^\s*DEFDAT\s+(\$(?:ROBCOR|CUSTOM|OPTION|ADVANCE|MSG_PAR)\w*)", re.IGNORECASE | re.MULTILINE
)
_ROOT: Final = re.compile(
    r"^\s*(?:(?:DECL\s+)?(?:GLOBAL\s+)?FRAME\s+)?\$ROBROOT\s*=\s*(\{[^}]*\})", re.IGNORECASE | re.MULTILINE
)
_END: Final = re.compile(r"^\s*\$SOFT([NP])_END\s*\[\s*([1-6])\s*\]\s*=\s*([^\s;]+)", re.IGNORECASE | re.MULTILINE)
_LENGTH: Final = re.compile(r"^\s*\$LENGTH_(A)\s*=\s*([^\s;]+)", re.IGNORECASE | re.MULTILINE)
_NAME: Final = re.compile(r"^\s*\$TRAFONAME\s*\[\s*\]\s*=\s*\"([^\"]*)\"", re.IGNORECASE | re.MULTILINE)
_ACCURATE: Final = re.compile(
    r"^\s*\$(ABS_ACCUR\w*|DEFLECT\w*|PRO_I_?DENT\w*)\s*=\s*(\S+)", re.IGNORECASE | re.MULTILINE
)


def is_kuka_machine(text: str) -> bool:
    """Return whether a text is a ``$machine.dat``."""
    return _HEAD.search(text) is not None


def other_kuka_data(text: str) -> str:
    """Return the name of a data list of the controller that holds nothing for a cell file; empty where it is none."""
    match = _OTHER.search(text)
    return "" if match is None else match[1]


def _number(text: str, where: str) -> float:
    if re.fullmatch(NUMBER, text) is None:
        raise FileFormatError("a number is damaged", where=where, value=text, limit="decimal points, as in -185.5",
                              hint="Give the file as the controller saved it")  # fmt: skip
    return float(text)


def read_kuka_machine(text: str, where: str) -> ControllerData:
    """Read ``$ROBROOT``, ``$SOFTN_END``, ``$SOFTP_END``, ``$LENGTH_A`` and ``$TRAFONAME``.

    Raises:
        FileFormatError: ``$ROBROOT`` is damaged, or there twice.
    """
    out = ControllerData("KUKA")
    roots = [match[1] for match in _ROOT.finditer(text)]
    if len(roots) > 1:
        raise FileFormatError("$ROBROOT is there twice", where=where, hint="Give the file as the controller saved it")
    if roots:
        out.T_world_base, out.root_known = frame_of_text(roots[0], f"{where}: $ROBROOT"), True
    ends = {(match[1].upper(), int(match[2])): _number(match[3], where) * DEG for match in _END.finditer(text)}
    for axis in range(1, 7):
        if ("N", axis) in ends and ("P", axis) in ends:
            out.limits_rad[axis - 1] = (ends["N", axis], ends["P", axis])
    lengths = {match[1].upper(): _number(match[2], where) * MM for match in _LENGTH.finditer(text)}
    if "A" in lengths:
        out.lengths_m["a1"] = lengths["A"]
    name = _NAME.search(text)
    if name is not None:
        out.model = name[1].strip().lstrip("#")
    for match in _ACCURATE.finditer(text):
        if match[2].upper() not in ("FALSE", "0", "0.0"):
            out.notes.append(
                f"${match[1]} is set: the arm is positively accurate by data on its RDC, which are not in these files "
                "and not read: the robot is that of the catalogue; identify kinematics measures it"
            )
    rest = sorted({word.upper() for word in re.findall(r"^\s*(\$[A-Za-z_]+)", text, re.MULTILINE)} - _READ)
    if rest:
        out.notes.append(f"{where}: {len(rest)} other machine data are not read ({', '.join(rest[:4])} ...)")
    return out


_READ: Final = frozenset(("$ROBROOT", "$SOFTN_END", "$SOFTP_END", "$LENGTH_A", "$TRAFONAME"))


def read_data(text: str, where: str) -> ControllerData | None:
    """Data of a ``$config.dat`` or ``$machine.dat``; None of another text."""
    if is_kuka(text):
        return read_kuka(text, where)
    if is_kuka_machine(text):
        return read_kuka_machine(text, where)
    other = other_kuka_data(text)
    note = f"{where} ({other}) holds nothing for a cell file and is not read"
    return ControllerData(notes=[note]) if other else None


DATA: Final = DataKind("$config.dat and $machine.dat (KUKA)", read_data, "$ROBROOT is in $machine.dat")
