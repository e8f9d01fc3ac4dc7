"""Backup of an ABB controller: tooldata and wobjdata of its modules, base frame of MOC.cfg."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from counterflex.app.controller_import.frames import ControllerData, DataKind, Load
from counterflex.core.errors import FileFormatError
from counterflex.core.units import MM
from counterflex.geometry import pose, rotation
from counterflex.integrations.abb.language.read.literals import AggregateLiteral, aggregate
from counterflex.integrations.abb.language.read.routines import DECLARATION, frame, truth
from counterflex.integrations.abb.language.read.scanner import RapidSource
from counterflex.programs.robot_text.process_words import NUMBER

_CFG: Final = re.compile(r"\s*MOC:CFG_", re.IGNORECASE)
_MODULE: Final = re.compile(r"^\s*MODULE\s+\w+", re.IGNORECASE | re.MULTILINE)
_SECTION: Final = re.compile(r"^([A-Z][A-Z0-9_]*):[^\S\r\n]*$", re.MULTILINE)
_KEY: Final = re.compile(r"-(\w+)\s+(\"[^\"]*\"|[^\s\\-]\S*|-[\d.]\S*)")
_AXIS: Final = re.compile(r"rob1_([1-6])", re.IGNORECASE)
_SECTIONS: Final = frozenset(("ROBOT", "ARM"))
_CALIBRATED: Final = re.compile(r"[\w-]*(?:absacc|abs_acc|_error_|arm_calib)\w*", re.IGNORECASE)


def read_module(text: str, where: str) -> ControllerData:
    """Tooldata and wobjdata of a module (``SYS.sys``, ``user.sys``, program modules).

    Tools that stand, work objects that the robot holds or that a mechanical unit moves are left out, with a note.

    Raises:
        FileFormatError: A declaration is damaged.
    """
    out = ControllerData("ABB")
    source = RapidSource(text, where)
    for statement in source.statements():
        match = DECLARATION.match(statement.code)
        if match is None or match[2].lower() not in ("tooldata", "wobjdata") or match[4] or not match[5]:
            continue
        start = statement.start + match.end()
        parts = aggregate(source.code, start, statement.end)
        if parts is None:
            raise FileFormatError(
                f"{match[3]} is no {match[2]} with its numbers", where=source.place(start),
                value=" ".join(statement.code[match.end() :].split())[:60], hint="Give the module of a backup",
            )  # fmt: skip
        (_tool if match[2].lower() == "tooldata" else _work_object)(out, match[3], parts, source.place(start))
    return out


def _tool(out: ControllerData, name: str, parts: AggregateLiteral, where: str) -> None:
    items = parts.items
    T = frame(items[1]) if len(items) == 3 else None
    if T is None or truth(items[0]) is None:
        raise FileFormatError(f"{name} is no tooldata that is read", where=where, value=name,
                              limit="[TRUE,[[x,y,z],[q1,q2,q3,q4]],[mass,[x,y,z],[q],ix,iy,iz]]")  # fmt: skip
    if not truth(items[0]):
        out.notes.append(f"{name} stands beside the robot (robhold FALSE) and is left out")
        return
    out.tools[name] = T
    load = items[2]
    if isinstance(load, AggregateLiteral) and len(load.items) >= 2 and isinstance(load.items[1], AggregateLiteral):
        com, mass = load.items[1].numbers((3,)), load.items[0]
        value = getattr(mass, "value", 0.0)
        if com is not None and value > 0.001:
            x, y, z = (part.value * MM for part in com)
            out.loads[name] = Load(value, (x, y, z))


def _work_object(out: ControllerData, name: str, parts: AggregateLiteral, where: str) -> None:
    items = parts.items
    user, of_object = (frame(items[3]), frame(items[4])) if len(items) == 5 else (None, None)
    if user is None or of_object is None:
        raise FileFormatError(f"{name} is no wobjdata that is read", where=where, value=name,
                              limit='[FALSE,TRUE,"",[[x,y,z],[q1,q2,q3,q4]],[[0,0,0],[1,0,0,0]]]')  # fmt: skip
    if truth(items[0]) or not truth(items[1]):
        out.notes.append(f"{name} is on the robot, or moved by a mechanical unit, and is left out")
        return
    out.bases[name] = user @ of_object


def read_configuration(text: str, where: str) -> ControllerData:
    """Base frame of the robot from ``MOC.cfg``, type ROBOT; positions there are in m.

    Raises:
        FileFormatError: The base frame is no pose.
    """
    out = ControllerData("ABB")
    sections = list(_SECTION.finditer(text))
    for match, end in zip(sections, [*(one.start() for one in sections[1:]), len(text)], strict=True):
        if match[1].upper() != "ROBOT":
            continue
        given: dict[str, str] = dict(_KEY.findall(text[match.end() : end]))
        p = np.array([_number(given, f"base_frame_pos_{axis}", 0.0, where) for axis in "xyz"])
        q = np.array([_number(given, f"base_frame_orient_u{i}", float(i == 0), where) for i in range(4)])
        if abs(float(np.linalg.norm(q)) - 1.0) > 1e-3:
            raise FileFormatError("the base frame of the robot is no rotation", where=where, value=q.tolist(),
                                  limit="base_frame_orient_u0 to u3 of length 1")  # fmt: skip
        out.T_world_base = pose.make(rotation.from_quat_wxyz(q / np.linalg.norm(q)), p)
        out.root_known = True
        break
    _bounds(out, text, sections, where)
    calibrated = sorted({match[0].lower() for match in _CALIBRATED.finditer(text)})
    if calibrated:
        out.notes.append(
            f"{where} holds calibrated kinematics (absolute accuracy: {', '.join(calibrated[:4])}). Their form is not "
            "published and they are not read: the robot is that of the catalogue; identify kinematics measures it"
        )
    rest = sorted({match[1].upper() for match in sections} - _SECTIONS)
    if rest:
        out.notes.append(f"{where}: other types are not read ({', '.join(rest[:5])}{' ...' if len(rest) > 5 else ''})")
    return out


def _bounds(out: ControllerData, text: str, sections: Sequence[re.Match[str]], where: str) -> None:
    """Software limits of the arm: type ARM, rad, of ``rob1_1`` to ``rob1_6``."""
    for match, end in zip(sections, [*(one.start() for one in sections[1:]), len(text)], strict=True):
        if match[1].upper() != "ARM":
            continue
        for entry in re.split(r"\n\s*\n|(?=-name)", text[match.end() : end].replace("\\\n", " ")):
            given: dict[str, str] = dict(_KEY.findall(entry))
            axis = _AXIS.fullmatch(given.get("name", "").strip('"'))
            if axis is not None and {"lower_joint_bound", "upper_joint_bound"} <= given.keys():
                low, high = (_number(given, f"{side}_joint_bound", 0.0, where) for side in ("lower", "upper"))
                out.limits_rad[int(axis[1]) - 1] = (low, high)


def _number(given: dict[str, str], key: str, default: float, where: str) -> float:
    text = given.get(key, f"{default}")
    if not re.fullmatch(NUMBER, text):
        raise FileFormatError(f"{key} is no number", where=where, value=text[:40])
    return float(text)


def read_data(text: str, where: str) -> ControllerData | None:
    """Data of a ``MOC.cfg`` or a module; None of another text."""
    if _CFG.match(text):
        return read_configuration(text, where)
    return read_module(text, where) if _MODULE.search(text) else None


DATA: Final = DataKind("modules and MOC.cfg (ABB)", read_data, "the base frame is in MOC.cfg")
