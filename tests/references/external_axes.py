"""Rails and positioners as makers describe them, and points of programs with the values of external axes.

Nothing of the package is imported. An axis moves what it carries along a line, or about one, in the controller's world.
Lengths in mm, angles in deg.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from controller_arms import fixed_xyz, quaternion, shift, zyx

Matrix = NDArray[np.float64]
_N = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"


def along(direction: tuple[float, float, float], value: float) -> Matrix:
    """A rail at a value."""
    x, y, z = np.array(direction) * value
    return shift(x, y, z)


def about(direction: tuple[float, float, float], origin: tuple[float, float, float], value: float) -> Matrix:
    """A turntable at a value, by Rodrigues' formula."""
    k = np.array(direction)
    K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    a = np.radians(value)
    T = np.eye(4)
    T[:3, :3] = np.eye(3) + np.sin(a) * K + (1 - np.cos(a)) * K @ K
    T[:3, 3] = np.array(origin) - T[:3, :3] @ np.array(origin)
    return T


def krl_points(files: Mapping[str, str], axis: int = 1) -> list[tuple[Matrix, float]]:
    """Every LIN with the value of an external axis: what a point does not name stays."""
    value = float(re.search(rf"XSTART=\{{.*?E{axis} {_N}", "\n".join(files.values()))[1])  # type: ignore[index]
    out = []
    for match in re.finditer(r"^LIN \{(.*?)\}", "\n".join(files.values()), re.MULTILINE):
        words = {word.split()[0]: float(word.split()[1]) for word in match[1].split(",")}
        value = words.get(f"E{axis}", value)
        x, y, z, a, b, c = (words[letter] for letter in "XYZABC")
        out.append((shift(x, y, z) @ zyx(a, b, c), value))
    return out


def rapid_points(files: Mapping[str, str], axis: int = 1) -> list[tuple[Matrix, float]]:
    """Every MoveL with the value of an external axis."""
    form = r"MoveL \[" + ",".join(rf"\[{','.join([_N] * n)}\]" for n in (3, 4, 4, 6)) + r"\]"
    out = []
    for match in re.finditer(form, "\n".join(files.values())):
        v = [float(value) for value in match.groups()]
        out.append((shift(*v[:3]) @ quaternion(*v[3:7]), v[10 + axis]))
    return out


def fanuc_points(files: Mapping[str, str], axis: int = 1) -> list[tuple[Matrix, float]]:
    """Every Cartesian position in the order of its number, with the value of an external axis."""
    out = []
    for match in re.finditer(r"P\[\d+\]\{(.*?)\};", "\n".join(files.values()), re.DOTALL):
        words = dict(re.findall(rf"\b([XYZWPR]|E\d) = {_N}", match[1]))
        if "X" in words:
            x, y, z, w, p, r = (float(words[letter]) for letter in "XYZWPR")
            out.append((shift(x, y, z) @ fixed_xyz(w, p, r), float(words[f"E{axis}"])))
    return out
