"""A cell file with the part elsewhere, with another posture, or in another folder."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import tomlkit

from counterflex.core import file_content
from counterflex.core.units import DEG, MM
from counterflex.files.cell.document import FILES, Doc, move_paths, parsed, row_of, table_of
from counterflex.path.tool_rotation import ToolRotation

POSE_KEYS: Final = ("x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg")
"""Keys of a pose in a cell file."""


class AxisMove(NamedTuple):
    """An external axis goes to a value."""

    from_mm: float  # Place along the path of the program, from its first point, at which it begins to move
    to_mm: float  # Place at which it has arrived; the same where the tool stands meanwhile
    value: float  # mm or deg
    point_mm: Sequence[float]  # Tool tip at its arrival, part frame


def copied_text(path: Path, folder: Path) -> str:
    """Text of a cell file as it has to be in another folder: the files that it names are where they were."""
    doc = parsed(path)
    move_paths(doc, path.parent, folder)
    return tomlkit.dumps(doc)


def text_with_posture(
    path: Path, branch: str, rotation_deg: float, folder: Path, turning: ToolRotation | None = None
) -> str:
    """Text of a cell file with another posture; comments, order and everything else are kept.

    Args:
        branch: Such as ``front up noflip``.
        folder: Where the new file will lie; paths in it that are relative are made relative to there.
        turning: Rotation along the program, with its points; None where the tool does not turn about its axis.
    """
    doc = parsed(path)
    table = _with_posture(doc, branch, rotation_deg)
    if turning is not None:
        rows = zip(turning.length_m, turning.angle_rad, strict=True)
        table["turning_mm_deg"] = [[round(place / MM, 6), round(angle / DEG, 6)] for place, angle in rows]
        table["turning_at_mm"] = [[round(x / MM, 3) for x in point] for point in turning.p_part]
    move_paths(doc, path.parent, folder)
    return tomlkit.dumps(doc)


def _with_posture(doc: Doc, branch: str, rotation_deg: float) -> Doc:
    """Enter a posture that is held still; its table."""
    table = table_of(doc, "posture")
    for key, word in zip(("shoulder", "elbow", "wrist"), branch.split(), strict=True):
        table[key] = word
    table["rotation_about_tool_deg"] = round(rotation_deg, 6)
    for key in ("turning_mm_deg", "turning_at_mm"):
        table.pop(key, None)
    return table


def text_with_place(
    path: Path,
    pose: Mapping[str, float],
    branch: str,
    rotation_deg: float,
    folder: Path,
    mounted: tuple[str, str, float] | None = None,
    axes: Mapping[str, float] | None = None,
    moves: Mapping[str, Sequence[AxisMove]] | None = None,
) -> str:
    """Text of a cell file with the part (or the spindle that stands) elsewhere and a posture for it; all else is kept.

    Args:
        pose: Keys of ``[part]`` in shop units, of ``[tcp]`` where the robot holds the part; those that stay as they are
            do not appear anew.
        branch: Such as ``front up noflip``.
        folder: Where the new file will lie; paths in it that are relative are made relative to there.
        mounted: Body of the end effector or ``tcp``, its key, and the angle in deg that it gets.
        axes: Values that external axes get, by name, mm or deg.
        moves: Where they go along the program, by name; those of an axis that is not named are taken out.
    """
    doc = parsed(path)
    if mounted is not None:
        body, key, angle = mounted
        turned = table_of(doc, "tcp") if body == "tcp" else row_of(doc, "end_effector", "name", body)
        turned[key] = angle
    table = table_of(doc, "tcp" if doc.get("part_on") == "flange" else "part")
    for key, value in pose.items():
        if key in table or value != 0.0:
            table[key] = value
    for name, value in (axes or {}).items():
        row = row_of(doc, "external_axes", "name", name)
        unit = "mm" if "at_mm" in row else "deg"
        row[f"at_{unit}"] = value
        _enter_moves(row, f"moves_{unit}", (moves or {}).get(name, ()))
    _with_posture(doc, branch, rotation_deg)
    move_paths(doc, path.parent, folder)
    return tomlkit.dumps(doc)


def _enter_moves(row: Doc, key: str, moves: Sequence[AxisMove]) -> None:
    for name in (key, "moves_at_mm"):
        row.pop(name, None)
    if moves:
        row[key] = [[round(one.from_mm, 3), round(one.to_mm, 3), one.value] for one in moves]
        row["moves_at_mm"] = [[round(float(x), 3) for x in one.point_mm] for one in moves]


def text_with_part(path: Path, pose: Mapping[str, float], folder: Path) -> str:
    """Text of a cell file with the part elsewhere; comments, order and everything else are kept.

    Args:
        pose: Keys of ``[part]`` that change, in shop units: ``x_mm`` ... ``c_deg``.
        folder: Where the new file will lie; paths in it that are relative are made relative to there.
    """
    doc = parsed(path)
    table_of(doc, "part").update(pose)
    move_paths(doc, path.parent, folder)
    return tomlkit.dumps(doc)


def text_placed_as(path: Path, other: Path, folder: Path) -> str:
    """Text of a cell file with the pose of the part and the posture of another one.

    Args:
        folder: Where the new file will lie; paths in it that are relative are made relative to there.
    """
    doc, there = parsed(path), parsed(other)
    part, pose = table_of(doc, "part"), there.get("part", {})
    for key in POSE_KEYS:
        part.pop(key, None)
        if key in pose:
            part[key] = pose[key]
    doc.pop("posture", None)
    if "posture" in there:
        doc["posture"] = there["posture"]
    move_paths(doc, path.parent, folder)
    return tomlkit.dumps(doc)


def text_with_files(path: Path, folder: Path, inputs: Path) -> tuple[str, dict[Path, bytes]]:
    """Text of a cell file whose files lie in a folder of its own, so that the folder is all that it needs.

    Returns:
        The text, and the contents of these files by where they have to be written.
    """
    doc, files = parsed(path), {}
    for *keys, last in FILES:
        table: Any = doc
        for key in keys:
            table = table.get(key, {})
        if table.get(last) is None:
            continue
        source = path.parent / str(table[last])
        target = inputs / f"{'-'.join((*keys, last))}{source.suffix}"
        files[target] = file_content.content(source)
        table[last] = Path(os.path.relpath(target, folder)).as_posix()
    return tomlkit.dumps(doc), files
