"""Consistency of imported frames: joint angles and poses that the controller shows, against forward kinematics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.app.controller_import.frames import ControllerData
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.units import DEG, MM
from counterflex.files.small_table import rows_of
from counterflex.geometry import pose, rotation

JOINTS: Final = tuple(f"q{i}_deg" for i in range(1, 7))
POSE: Final = ("x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg")
_MOST: Final = 10_000
_CONSTANT: Final = 0.2
"""A difference counts as constant where its spread over the poses is below this share of it."""


@dataclass(frozen=True)
class ShownPose:
    """A pose of the tool as the controller shows it."""

    line: int
    q: Float  # (6,) rad, axes as the controller shows them
    T_base_tool: Float  # (4, 4) m, tool in the active base
    tool: str
    base: str


@dataclass(frozen=True)
class Residual:
    """How far forward kinematics is from what the controller shows, for one tool in one base."""

    tool: str
    base: str
    count: int
    rms_m: float
    largest_m: float  # Largest distance
    largest_rad: float  # Largest angle
    line: int  # Of the largest distance
    suspect: str  # ``tool``, ``base`` or empty: whose frame is off by the same in all poses

    def fits(self, tolerance_m: float, tolerance_rad: float) -> bool:
        """Whether all poses are within both tolerances."""
        return self.largest_m <= tolerance_m and self.largest_rad <= tolerance_rad


def read_poses(text: str, where: str, tool: str, base: str) -> list[ShownPose]:
    """Poses of a table with columns q1_deg to q6_deg, x_mm y_mm z_mm, a_deg b_deg c_deg, and perhaps tool and base.

    Args:
        text: A header and rows, see :mod:`counterflex.files.small_table`.
        tool: Taken where the file has no column ``tool``.
        base: The same of ``base``.

    Raises:
        FileFormatError: A column is missing, a value is no number, or there is no row.
    """
    rows = rows_of(text, where)
    names = rows[0][1] if rows else []
    missing = [name for name in (*JOINTS, *POSE) if name not in names]
    if missing:
        raise FileFormatError("columns are missing", where=where, value=", ".join(missing),
                              limit=", ".join((*JOINTS, *POSE)))  # fmt: skip
    out: list[ShownPose] = []
    for line, cells in rows[1:]:
        row = dict(zip(names, cells, strict=False))
        try:
            q = np.array([float(row[name]) for name in JOINTS]) * DEG
            values = np.array([float(row[name]) for name in POSE])
        except (KeyError, ValueError):
            q = values = np.full(6, np.nan)
        if not np.all(np.isfinite([*q, *values])) or len(out) >= _MOST:
            raise FileFormatError(
                "a row without its twelve numbers, or too many rows", where=f"{where}:{line}",
                limit=f"finite numbers, at most {_MOST} rows",
            )  # fmt: skip
        T = pose.make(rotation.from_zyx(values[3:] * DEG), values[:3] * MM)
        out.append(ShownPose(line, q, T, row.get("tool") or tool, row.get("base") or base))
    if not out:
        raise FileFormatError("the table has no row", where=where, limit="five poses or more, far apart")
    return out


def residuals(poses: Sequence[ShownPose], Ts_base_flange: Float, data: ControllerData) -> list[Residual]:
    """Compare the poses of each tool in each base with forward kinematics.

    Args:
        Ts_base_flange: (n, 4, 4) m, of their joint angles.

    Raises:
        InputError: A tool or base that the controller does not have.
    """
    groups: dict[tuple[str, str], list[int]] = {}
    for index, shown in enumerate(poses):
        groups.setdefault((shown.tool, shown.base), []).append(index)
    return [_residual(key, rows, poses, Ts_base_flange, data) for key, rows in groups.items()]


def _residual(
    key: tuple[str, str], rows: Sequence[int], poses: Sequence[ShownPose], Ts_base_flange: Float, data: ControllerData
) -> Residual:
    T_tool, T_base = data.named(key[0], "tool"), data.base_in_robot(key[1])
    by_tool, by_base, distances, angles = [], [], [], []
    for index in rows:
        computed = Ts_base_flange[index] @ T_tool
        shown = T_base @ poses[index].T_base_tool
        off = np.linalg.inv(computed) @ shown
        distances.append(float(np.linalg.norm(off[:3, 3])))
        angles.append(float(np.linalg.norm(rotation.log(off[:3, :3]))))
        by_tool.append(np.linalg.inv(Ts_base_flange[index]) @ shown @ np.linalg.inv(T_tool))
        by_base.append(computed @ np.linalg.inv(poses[index].T_base_tool) @ np.linalg.inv(T_base))
    worst = int(np.argmax(distances))
    return Residual(
        key[0], key[1], len(rows), float(np.sqrt(np.mean(np.square(distances)))), max(distances), max(angles),
        poses[rows[worst]].line, _suspect({"tool": by_tool, "base": by_base}),
    )  # fmt: skip


def _suspect(differences: Mapping[str, Sequence[Float]]) -> str:
    """Which frame is off by the same in all poses; empty where neither is, or there are too few poses to tell."""
    shares = {}
    for name, Ts in differences.items():
        moves = np.array([np.concatenate([T[:3, 3], 0.3 * rotation.log(T[:3, :3])]) for T in Ts])
        size = float(np.linalg.norm(moves.mean(axis=0)))
        spread = float(np.linalg.norm(moves - moves.mean(axis=0), axis=1).max())
        shares[name] = spread / size if size > 0.0 else np.inf
    best = min(shares, key=lambda name: shares[name])
    return best if len(next(iter(differences.values()))) >= 3 and shares[best] < _CONSTANT else ""
