"""Arms as controllers compute them: a tiny model per maker, from conventions and published poses alone.

Nothing of the package is imported. An arm is a chain of turns about lines in space, in the maker's own zero posture, as
the maker's data sheet draws it: lengths of the dimension drawing, the positive direction of each axis, where axis 3 is
counted from, where the world lies. Programs are read by patterns of their own, too.

Lengths in mm, angles in deg: what a data sheet and a program say.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
_N = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"


def turn(axis: str, angle_deg: float) -> Matrix:
    """(4, 4) turn about x, y or z."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    T = np.eye(4)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    T[i, i] = T[j, j] = c
    T[i, j], T[j, i] = -s, s
    return T


def shift(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Matrix:
    """(4, 4) displacement."""
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


@dataclass(frozen=True)
class Arm:
    """Dimensions of an arm, mm.

    Attributes:
        base: Height of axis 2 above the plate.
        reach: Distance of axis 2 ahead of axis 1.
        side: Distance of the arm's plane beside axis 1, along y.
        upper: Length from axis 2 to axis 3.
        rise: Height of axis 4 above axis 3 with the forearm level.
        fore: Length from axis 3 to the wrist centre along the forearm.
        hand: Length from the wrist centre to the flange.
    """

    base: float
    reach: float
    side: float
    upper: float
    rise: float
    fore: float
    hand: float


def kuka(arm: Arm, axes: Matrix) -> Matrix:
    """Flange in the world of a KUKA controller: on the plate. A1 A2 A3 = 0 0 0 is the arm stretched forward, level.

    A1 turns clockwise seen from above; A2 and A3 downward; A4 and A6 clockwise seen along the forearm from behind its
    end (against x); A5 downward. The flange's z runs out of it, its x down where A2 = -90, A3 = 90.
    """
    a1, a2, a3, a4, a5, a6 = axes
    return (
        turn("z", -a1) @ shift(arm.reach, arm.side, arm.base) @ turn("y", a2) @ shift(x=arm.upper)
        @ turn("y", a3) @ shift(z=arm.rise) @ turn("x", -a4) @ shift(x=arm.fore) @ turn("y", a5) @ turn("x", -a6)
        @ shift(x=arm.hand) @ turn("y", 90.0)
    )  # fmt: skip


def abb(arm: Arm, axes: Matrix, *, rod: bool = False) -> Matrix:
    """Flange in the base of an ABB controller: on the plate. Zero is upper arm upright, forearm level.

    Axis 1 turns counter-clockwise from above, 2, 3 and 5 downward, 4 and 6 positive about the forearm's forward x. With
    a parallel rod axis 3 is the forearm against the horizontal, whatever axis 2 does.
    """
    a1, a2, a3, a4, a5, a6 = axes
    bend = a3 - a2 if rod else a3
    return (
        turn("z", a1) @ shift(arm.reach, arm.side, arm.base) @ turn("y", a2) @ shift(z=arm.upper)
        @ turn("y", bend) @ shift(z=arm.rise) @ turn("x", a4) @ shift(x=arm.fore) @ turn("y", a5) @ turn("x", a6)
        @ shift(x=arm.hand) @ turn("y", 90.0)
    )  # fmt: skip


def fanuc(arm: Arm, axes: Matrix) -> Matrix:
    """Flange in the world of a FANUC controller: on axis 1 at the height of axis 2.

    Zero is upper arm upright, forearm level, with the flange at W -180, P -90, R 0. J1 turns counter-clockwise from
    above, J2 forward and down, J3 lifts the forearm **against the horizontal** and keeps it there while J2 moves, J4
    and J6 are negative about the forearm's forward x, J5 lifts the hand.
    """
    j1, j2, j3, j4, j5, j6 = axes
    return (
        turn("z", j1) @ shift(arm.reach, arm.side) @ turn("y", j2) @ shift(z=arm.upper)
        @ turn("y", -j3 - j2) @ shift(z=arm.rise) @ turn("x", -j4) @ shift(x=arm.fore) @ turn("y", -j5)
        @ turn("x", -j6) @ shift(x=arm.hand) @ fixed_xyz(-180.0, -90.0, 0.0)
    )  # fmt: skip


def yaskawa(arm: Arm, axes: Matrix) -> Matrix:
    """Flange in the world of a Yaskawa controller: on axis S at the height of axis L.

    Zero is upper arm upright, forearm level, x of the flange up. S turns counter-clockwise from above, L forward and
    down, U lifts the forearm against the upper arm, R and T are negative about the forearm's forward x, B lifts the
    hand (urdf of GP25, ROS-Industrial).
    """
    s, low, u, r, b, t = axes
    return (
        turn("z", s) @ shift(arm.reach, arm.side) @ turn("y", low) @ shift(z=arm.upper) @ turn("y", -u)
        @ shift(z=arm.rise) @ turn("x", -r) @ shift(x=arm.fore) @ turn("y", -b) @ turn("x", -t) @ shift(x=arm.hand)
        @ fixed_xyz(180.0, -90.0, 0.0)
    )  # fmt: skip


def staubli(arm: Arm, axes: Matrix) -> Matrix:
    """Flange in the world of a Staubli controller: on axis 1 at the height of axis 2. Zero is the arm upright.

    J1 J4 J6 turn about z upward, J2 J3 J5 about y, forward.
    """
    j1, j2, j3, j4, j5, j6 = axes
    return (
        turn("z", j1) @ shift(arm.reach, arm.side) @ turn("y", j2) @ shift(z=arm.upper) @ turn("y", j3)
        @ shift(x=-arm.rise) @ turn("z", j4) @ shift(z=arm.fore) @ turn("y", j5) @ turn("z", j6) @ shift(z=arm.hand)
    )  # fmt: skip


def zyx(a: float, b: float, c: float) -> Matrix:
    """KUKA A B C: about z, the new y, the new x."""
    return turn("z", a) @ turn("y", b) @ turn("x", c)


def fixed_xyz(w: float, p: float, r: float) -> Matrix:
    """FANUC W P R: about the fixed x, then the fixed y, then the fixed z."""
    return turn("z", r) @ turn("y", p) @ turn("x", w)


def intrinsic_xyz(rx: float, ry: float, rz: float) -> Matrix:
    """Staubli rx ry rz: about x, the new y, the new z."""
    return turn("x", rx) @ turn("y", ry) @ turn("z", rz)


def quaternion(q1: float, q2: float, q3: float, q4: float) -> Matrix:
    """ABB q1 to q4, the scalar first."""
    w, x, y, z = np.array([q1, q2, q3, q4]) / np.linalg.norm([q1, q2, q3, q4])
    T = np.eye(4)
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return T


@dataclass(frozen=True)
class Start:
    """What a program says before and at its first path point.

    Attributes:
        axes: (6,) deg, of the first joint motion.
        T_part_tcp: (4, 4) mm, first point of the path.
        T_world_part: (4, 4) mm, frame of the path, where the program says it.
        T_flange_tool: (4, 4) mm, tool, where the program says it.
        points: (n, 4) quaternions of all points as written; RAPID only.
    """

    axes: Matrix
    T_part_tcp: Matrix
    T_world_part: Matrix | None = None
    T_flange_tool: Matrix | None = None
    points: Matrix | None = None


def krl_start(files: Mapping[str, str]) -> Start:
    """``PTP XSTART`` and the first LIN."""
    text = "\n".join(files.values())
    axes = re.search(r"XSTART=\{" + ",".join(rf"A{i} {_N}" for i in range(1, 7)), text)
    first = re.search(r"^LIN \{" + ",".join(rf"{c} {_N}" for c in "XYZABC"), text, re.MULTILINE)
    assert axes is not None
    assert first is not None
    x, y, z, a, b, c = map(float, first.groups())
    return Start(np.array(axes.groups(), dtype=float), shift(x, y, z) @ zyx(a, b, c))


def rapid_start(files: Mapping[str, str]) -> Start:
    """``MoveAbsJ``, tooldata, wobjdata and the first ``MoveL``."""
    text = "\n".join(files.values())
    pose = r"\[" + ",".join([_N] * 3) + r"\],\[" + ",".join([_N] * 4) + r"\]"
    axes = re.search(r"MoveAbsJ \[\[" + ",".join([_N] * 6) + r"\],", text)
    points = re.findall(r"MoveL \[" + pose, text)
    work = re.search(r"wobjdata \w+:=\[FALSE,TRUE,\"\",\[" + pose, text)
    tool = re.search(r"tooldata \w+:=\[TRUE,\[" + pose, text)
    assert axes is not None
    assert points

    def frame(values: tuple[str, ...]) -> Matrix:
        x, y, z, *q = map(float, values)
        return shift(x, y, z) @ quaternion(*q)

    return Start(
        np.array(axes.groups(), dtype=float),
        frame(points[0]),
        None if work is None else frame(work.groups()),
        None if tool is None else frame(tool.groups()),
        np.array([point[3:] for point in points], dtype=float),
    )


def fanuc_start(files: Mapping[str, str]) -> Start:
    """``J P[1]`` by axes and the first Cartesian position."""
    text = next(iter(files.values()))
    axes = re.search(r"^\s*\d+:J P\[(\d+)\]", text, re.MULTILINE)
    line = re.search(r"^\s*\d+:L P\[(\d+)\]", text, re.MULTILINE)
    if line is None:
        text = list(files.values())[1]
        line = re.search(r"^\s*\d+:L P\[(\d+)\]", text, re.MULTILINE)
    assert axes is not None
    assert line is not None
    held = re.search(rf"P\[{axes[1]}\]\{{([^}}]*)\}}", next(iter(files.values())))
    there = re.search(rf"P\[{line[1]}\]\{{([^}}]*)\}}", text)
    assert held is not None
    assert there is not None
    joints = [float(re.search(rf"J{i} = {_N} deg", held[1])[1]) for i in range(1, 7)]  # type: ignore[index]
    x, y, z = (float(re.search(rf"\b{c} = {_N} mm", there[1])[1]) for c in "XYZ")  # type: ignore[index]
    w, p, r = (float(re.search(rf"\b{c} = {_N} deg", there[1])[1]) for c in "WPR")  # type: ignore[index]
    remarks = " ".join(re.findall(r"^\s*\d+:\s*!(.*?) ;$", next(iter(files.values())), re.MULTILINE))
    stated = re.findall(" ".join(rf"{c} {_N}" for c in "XYZWPR"), remarks)
    frames = [shift(*map(float, one[:3])) @ fixed_xyz(*map(float, one[3:])) for one in stated]
    part, tool = frames if len(frames) == 2 else (None, None)
    return Start(np.array(joints), shift(x, y, z) @ fixed_xyz(w, p, r), part, tool)


def val3_start(files: Mapping[str, str]) -> Start:
    """``jStart``, ``fPart``, ``tPath`` and the first element of ``pPath``."""
    text = next(content for name, content in files.items() if name.endswith(".dtx"))

    def value(name: str, keys: tuple[str, ...]) -> list[float] | None:
        block = re.search(rf'name="{name}".*?<Value key="0" ([^/]*)/>', text, re.DOTALL)
        if block is None:
            return None
        return [float(re.search(rf'\b{key}="{_N}"', block[1])[1]) for key in keys]  # type: ignore[index]

    def frame(name: str) -> Matrix | None:
        given = value(name, ("x", "y", "z", "rx", "ry", "rz"))
        return None if given is None else shift(*given[:3]) @ intrinsic_xyz(*given[3:])

    axes, first = value("jStart", ("j1", "j2", "j3", "j4", "j5", "j6")), frame("pPath")
    assert axes is not None
    assert first is not None
    return Start(np.array(axes), first, frame("fPart"), frame("tPath"))
