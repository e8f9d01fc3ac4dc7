"""Import: data of a controller and a robot of the catalogue as the start of a cell file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.controller_import.frames import DATA_KINDS, ControllerData
from counterflex.core import atomic
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError, ModelError
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import read_cell
from counterflex.files.cell.update import new_cell
from counterflex.files.small_table import rows_of
from counterflex.geometry import pose, rotation
from counterflex.programs.source_text import read_text
from counterflex.robot.elasticity.chain import ElasticChain, flange
from counterflex.robot.model import catalog
from counterflex.robot.model.controller_axes import shown_limits
from counterflex.robot.model.description import Robot

JOINTS: Final = tuple(f"q{i}_deg" for i in range(1, 7))
POSE: Final = ("x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg")
_MOST: Final = 10_000
_CONSTANT: Final = 0.2  # A difference counts as constant where its spread over the poses is below this share of it


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
    """Residual of forward kinematics against the poses of the controller, for one tool in one base."""

    tool: str
    base: str
    count: int
    rms_m: float
    largest_m: float  # Largest distance
    largest_rad: float  # Largest angle
    line: int  # Of the largest distance
    suspect: str  # ``tool``, ``base`` or empty: whose frame is off by the same in all poses

    def fits(self, tolerance_m: float, tolerance_rad: float) -> bool:
        """Return whether all poses are within both tolerances."""
        return self.largest_m <= tolerance_m and self.largest_rad <= tolerance_rad


def read_poses(text: str, where: str, tool: str, base: str) -> list[ShownPose]:
    """Poses of a table with columns q1_deg to q6_deg, x_mm y_mm z_mm, a_deg b_deg c_deg, and perhaps tool and base.

    Args:
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
    """Name the frame that is off by the same in all poses; empty where neither is, or with too few poses."""
    shares = {}
    for name, Ts in differences.items():
        moves = np.array([np.concatenate([T[:3, 3], 0.3 * rotation.log(T[:3, :3])]) for T in Ts])
        size = float(np.linalg.norm(moves.mean(axis=0)))
        spread = float(np.linalg.norm(moves - moves.mean(axis=0), axis=1).max())
        shares[name] = spread / size if size > 0.0 else np.inf
    best = min(shares, key=lambda name: shares[name])
    return best if len(next(iter(differences.values()))) >= 3 and shares[best] < _CONSTANT else ""


_SAME_LENGTH_M: Final = 0.5 * MM
_SAME_RAD: Final = 0.05 * DEG


def run(
    files: Sequence[Path],
    out: Path,
    robot: str,
    *,
    tool: str = "",
    base: str = "",
    poses: Path | None = None,
    tolerance_m: float = 0.5 * MM,
    tolerance_rad: float = 0.05 * DEG,
) -> dict[str, Any]:
    """Write a cell file from what a controller knows; nothing is written where the poses do not fit.

    Args:
        out: The cell file; must not exist.
        tool: Name of the tool; may be left out where there is one.
        base: Name of the base that is the part frame; likewise.
        poses: Table of joint angles and poses that the controller shows, see
            :func:`~counterflex.app.controller_import.job.read_poses`.
        tolerance_m: Largest distance of forward kinematics from a pose.
        tolerance_rad: Largest angle.

    Returns:
        What was imported and how the poses fit.

    Raises:
        InputError: A tool or base that is not there, or several and none is named.
        ModelError: The poses do not fit; names tool, base, distance and which of them is off.
    """
    if out.exists():
        raise InputError("this file is already there", where="--out", value=out, hint="Name a new cell file")
    model, data = catalog.load(robot), read_files(files)
    tool, base = _only(tool, data, "tool"), _only(base, data, "base")
    fits: list[Residual] = []
    if poses is not None:
        shown = read_poses(read_text(poses)[0], poses.name, tool, base)
        chain = ElasticChain.build(model)
        fits = residuals(shown, flange(chain, model.axes.model(np.array([one.q for one in shown]))), data)
        _refuse_misfit(fits, tolerance_m, tolerance_rad, poses.name)
    data.notes += [*_root_note(data), *machine_notes(data, model)]
    text = cell_text(data, robot, tool, base, [file.name for file in files], fits)
    with new_cell(out) as place:
        atomic.write_text(place, text)
        read_cell(place)
    return {
        "cell": str(out), "controller": data.kind, "robot": robot, "tool": tool, "base": base,
        "tools": list(data.tools), "bases": list(data.bases), "notes": data.notes,
        "poses": [
            {
                "tool": one.tool, "base": one.base, "poses": one.count, "rms_mm": round(one.rms_m / MM, 4),
                "largest_mm": round(one.largest_m / MM, 4), "largest_deg": round(one.largest_rad / DEG, 4),
                "line": one.line,
            }
            for one in fits
        ],
    }  # fmt: skip


def _kinds() -> str:
    return ", ".join(kind.title for _, kind in DATA_KINDS.items())


def read_files(files: Sequence[Path]) -> ControllerData:
    """Data of all files of a controller. Raises FileFormatError: a file is of no kind that is read."""
    out = ControllerData()
    for file in files:
        if file.suffix.lower() == ".rdk":
            raise FileFormatError(
                "a RoboDK station (.rdk) is a binary file and is not read", where=str(file), limit=_kinds(),
                hint="Write its tools and frames as JSON by the script of docs/cell-import.md",
            )  # fmt: skip
        text, _ = read_text(file)
        data = next((one for _, kind in DATA_KINDS.items() if (one := kind.read(text, file.name)) is not None), None)
        if data is None:
            first = text.strip().splitlines()[0][:60] if text.strip() else "empty"
            raise FileFormatError("a file of no kind that is read", where=str(file), value=first, limit=_kinds())
        out.merge(data)
    return out


def _root_note(data: ControllerData) -> list[str]:
    if data.root_known or not data.bases:
        return []
    missing = next((kind.root for name, kind in DATA_KINDS.items() if name == data.kind.lower()), "")
    return [
        f"bases of the controller are in its world, and no file says where the robot stands there ({missing}): it is "
        "taken to stand at the origin"
    ]


def _limits_off(limits: dict[int, tuple[float, float]], known: Float) -> list[str]:
    """Notes where software limits of the controller are not those of the catalogue, rad; ``known`` (6, 2)."""
    out = []
    for axis, (low, high) in sorted(limits.items()):
        if abs(low - known[axis, 0]) > _SAME_RAD or abs(high - known[axis, 1]) > _SAME_RAD:
            out.append(
                f"software limits of axis {axis + 1} are {low / DEG:g} to {high / DEG:g} deg, the catalogue has "
                f"{known[axis, 0] / DEG:g} to {known[axis, 1] / DEG:g}: they are not taken over"
            )
    return out


def machine_notes(data: ControllerData, model: Robot) -> list[str]:
    """Notes where machine data are not those of the robot of the catalogue."""
    out = _limits_off(data.limits_rad, shown_limits(model.axes, model.joint_limits_rad))
    opw = model.opw
    a1_m = data.lengths_m.get("a1")
    if opw is not None and a1_m is not None and abs(abs(a1_m) - abs(opw.a1_m)) > _SAME_LENGTH_M:
        out.append(
            f"$LENGTH_A is {a1_m / MM:g} mm, the catalogue has {opw.a1_m / MM:g} mm: the robot of the controller "
            f"({data.model or 'no name'}) is another one"
        )
    if data.model:
        out.append(f"the controller calls its robot {data.model}; the cell has {model.name}")
    return out


def _only(name: str, data: ControllerData, what: str) -> str:
    """The name as the controller spells it; the only one where none is given."""
    frames = data.tools if what == "tool" else data.bases
    if name:
        data.named(name, what)
        return next(key for key in frames if key.upper() == name.upper())
    if len(frames) != 1:
        named = [f"{key} ({data.titles[f'{what} {key}']})" if f"{what} {key}" in data.titles else key for key in frames]
        raise InputError(
            f"which {what} the cell has is not said" if frames else f"the files set no {what}",
            value=", ".join(named[:12]) or "none",
            hint=f"Name it with --{what}" if frames else f"Give the file with the {what} data",
        )  # fmt: skip
    return next(iter(frames))


def _refuse_misfit(fits: Sequence[Residual], tolerance_m: float, tolerance_rad: float, where: str) -> None:
    bad = [one for one in fits if not one.fits(tolerance_m, tolerance_rad)]
    if not bad:
        return
    worst = max(bad, key=lambda one: one.largest_m / tolerance_m + one.largest_rad / tolerance_rad)
    good = [one for one in fits if one not in bad]
    tool_is_good = any(one.tool == worst.tool for one in good)
    base_is_good = any(one.base == worst.base for one in good)
    suspect = worst.suspect
    if not suspect and tool_is_good != base_is_good:
        suspect = "base" if tool_is_good else "tool"
    name = {"tool": f"tool {worst.tool}", "base": f"base {worst.base}"}.get(suspect, "")
    raise ModelError(
        f"{name or f'tool {worst.tool} in base {worst.base}'} does not fit the poses that the controller shows",
        where=f"{where}:{worst.line}", value=f"{worst.largest_m / MM:.3f} mm, {worst.largest_rad / DEG:.3f} deg off",
        limit=f"{tolerance_m / MM:g} mm, {tolerance_rad / DEG:g} deg",
        hint=(f"{name} is off by the same in all poses: its data are not those that were active" if worst.suspect else
              "Check the robot, the names of tool and base, and that angles and poses are of the same moment")
        + ". Nothing was written",
    )  # fmt: skip


def cell_text(
    data: ControllerData, robot: str, tool: str, base: str, files: Sequence[str], fits: Sequence[Residual]
) -> str:
    """Text of the cell file.

    Args:
        base: Name of the base.
    """
    source = ", ".join(files)
    load = data.loads.get(tool)
    source = "".join(c if c.isprintable() else "?" for c in source)
    lines = [
        f"# Start of a cell file, imported from {source} of a {data.kind} controller.",
        *(f"# Forward kinematics within {one.largest_m / MM:.3f} mm and {one.largest_rad / DEG:.4f} deg of {one.count} "
          f"poses of tool {one.tool} in base {one.base}.".replace("\n", " ") for one in fits),
        "# Add bodies with their compliance to [[end_effector]], the blank to [part], [[tools]] and [material]:",
        "# docs/cell-file.md.",
        'format = "counterflex-cell"', "version = 1", f"name = {json.dumps(f'{robot}, tool {tool}, base {base}')}", "",
        "[robot]", f'catalog = "{robot}"', "",
    ]  # fmt: skip
    lines += ["# Rigid until it is known how it bends.", "[[end_effector]]", 'name = "tool"']
    if load is not None:
        lines += [f"mass_kg = {_text(load.mass_kg)}"]
        lines += [f"com_{axis}_mm = {_text(value / MM)}" for axis, value in zip("xyz", load.p_flange_com, strict=True)]
    lines += [
        f'source = "load data of {source}"'
        if load is not None
        else f'source = "mass not known: {source} has no load data"'
    ]
    lines += ["", "[tcp]", *_pose_lines(data.named(tool, "tool")), ""]
    lines += ["# How the base was measured is not in the file: see measured_with in docs/cell-file.md.", "[part]"]
    lines += [*_pose_lines(data.base_in_robot(base)), 'measured_with = "external"', "", "[controller]"]
    if data.kind == "KUKA":
        lines += [f"tool_number = {tool}", f"base_number = {base}"]
    elif data.kind == "ABB" and base.isascii() and base.isidentifier():
        lines += [f'work_object = "{base}"']
    if not np.allclose(data.T_world_base, np.eye(4), rtol=0.0, atol=1e-9):
        lines += ["", "# Where the robot stands in the world of its controller.", "[controller.robot_in_world]"]
        lines += _pose_lines(data.T_world_base)
    return "\n".join([*lines, ""])


def _pose_lines(T: Float) -> list[str]:
    angles = rotation.to_zyx(T[:3, :3]) / DEG
    return [
        *(f"{axis}_mm = {_text(float(value) / MM)}" for axis, value in zip("xyz", T[:3, 3], strict=True)),
        *(f"{axis}_deg = {_text(float(value))}" for axis, value in zip("abc", angles, strict=True)),
    ]


def _text(value: float) -> str:
    """A number of TOML with six decimals at most."""
    return f"{round(value, 6) + 0.0!r}"
