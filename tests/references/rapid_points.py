"""Motions of a RAPID module, read in another way: routines inlined as text, targets evaluated as Python expressions."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

_SPEEDS = {f"v{n}": [float(n), 500, 5000, 1000] for n in (5, 10, 20, 50, 100, 200, 300, 500, 1000)}


@dataclass
class Point:
    """A motion of a module.

    Attributes:
        word: ``MoveJ MoveL MoveC``, lower case.
        points: Targets, mm.
        R: Orientation of the last one, (3, 3).
        speed: mm/s.
    """

    word: str
    points: list[NDArray[np.float64]]
    R: NDArray[np.float64]
    speed: float


def rapid_points(text: str, main: str = "main") -> list[Point]:
    """Motions in the order in which they are made; MoveAbsJ and everything else is passed over."""
    text = re.sub(r"![^\n]*", "", text.replace("\r\n", "\n"))
    names: dict[str, Any] = {**_SPEEDS, "fine": 0, **{f"z{n}": n for n in (0, 1, 5, 10, 50)}}
    names |= {"offs": _offs, "reltool": _rel_tool, "wobj0": 0, "tool0": 0, "true": True, "false": False}
    for name, value in re.findall(
        r"(?:CONST|PERS|VAR)\s+\w+\s+(\w+)(?:\{\d+\})?\s*:=(.*?);", text, re.DOTALL | re.IGNORECASE
    ):
        names[name.lower()] = eval(value.lower().replace("\n", " "), {}, dict(names))
    bodies = {n.lower(): b for n, b in re.findall(r"PROC\s+(\w+)\(\)(.*?)ENDPROC", text, re.DOTALL | re.IGNORECASE)}
    return list(_motions(_inlined(bodies, main.lower()), names))


def _inlined(bodies: dict[str, str], name: str) -> str:
    body = bodies[name]
    while True:
        called = re.search(r"(?m)(?:^|;)\s*(\w+)\s*;", body)
        while called and called[1].lower() not in bodies:
            called = re.compile(r"(?m)(?:^|;)\s*(\w+)\s*;").search(body, called.end() - 1)
        if called is None:
            return body
        body = body[: called.start(1)] + bodies[called[1].lower()] + ";" + body[called.end() :]


def _motions(body: str, names: dict[str, Any]) -> Any:
    for statement in re.sub(r"\bIF\b.*?\bTHEN\b|\bENDIF\b", ";", body).split(";"):
        match = re.match(r"\s*(Move[LJC])\b(.*)", statement, re.DOTALL | re.IGNORECASE)
        if match is None:
            continue
        arguments = re.sub(r"\\WObj\s*:=\s*\w+", "", match[2], flags=re.IGNORECASE).lower().replace("\n", " ")
        given = re.search(r"\\v\s*:=\s*([-+\d.e]+)", arguments)
        arguments = re.sub(r"\\v\s*:=\s*[-+\d.e]+", "", arguments)
        arguments = re.sub(r"\\(r[xyz])\s*:=", r",\1=", arguments)
        arguments = re.sub(r"(\w+)\{(\d+)\}", lambda m: f"{m[1]}[{int(m[2]) - 1}]", arguments)
        *targets, speed, _, _ = eval(f"[{arguments}]", {}, names)
        q = targets[-1][1]
        yield Point(
            match[1].lower(),
            [np.array(target[0], dtype=float) for target in targets],
            Rotation.from_quat([*q[1:], q[0]]).as_matrix(),
            float(given[1]) if given else speed[0],
        )


def _offs(p: Any, x: float, y: float, z: float) -> Any:
    return [[a + b for a, b in zip(p[0], (x, y, z), strict=True)], *p[1:]]


def _rel_tool(p: Any, x: float, y: float, z: float, rx: float = 0.0, ry: float = 0.0, rz: float = 0.0) -> Any:
    R = Rotation.from_quat([*p[1][1:], p[1][0]])
    turned = R * Rotation.from_euler("XYZ", [rx, ry, rz], degrees=True)
    q = turned.as_quat()
    return [list(np.array(p[0]) + R.apply([x, y, z])), [q[3], *q[:3]], *p[2:]]
