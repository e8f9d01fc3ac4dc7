"""Machine data of a KUKA controller (``$machine.dat``): where the robot stands, software limits, lengths, its name."""

from __future__ import annotations

import re
from typing import Final

from counterflex.app.controller_import.frames import ControllerData
from counterflex.app.controller_import.kinds import DataKind
from counterflex.core.errors import FileFormatError
from counterflex.core.units import DEG, MM
from counterflex.integrations.kuka.frame_data import frame_of_text, is_kuka, read_kuka
from counterflex.programs.robot_text.process_words import NUMBER

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

    Args:
        where: Its name, for errors.

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
    """Data of a ``$config.dat`` or ``$machine.dat``; None of another text.

    Args:
        where: Its name, for errors and notes.
    """
    if is_kuka(text):
        return read_kuka(text, where)
    if is_kuka_machine(text):
        return read_kuka_machine(text, where)
    other = other_kuka_data(text)
    note = f"{where} ({other}) holds nothing for a cell file and is not read"
    return ControllerData(notes=[note]) if other else None


DATA: Final = DataKind("$config.dat and $machine.dat (KUKA)", read_data, "$ROBROOT is in $machine.dat")
