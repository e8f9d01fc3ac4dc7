"""A robot description of ROS (URDF text) as the robot of a counterflex cell file. No ROS here."""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

URDF_NAME, TABLE_NAME = "robot.urdf", "robot.toml"
_TURNING = ("revolute", "continuous")
_AXES = 6
_TIPS = ("tool0", "flange")


def checked(text: str, tip: str = "") -> tuple[str, str]:
    """What is known of a description without a library.

    Args:
        text: URDF.
        tip: Link that is the flange; empty: ``tool0`` or ``flange`` where there is one.

    Returns:
        Name of the robot and of the flange link; the latter is empty where counterflex shall choose it.

    Raises:
        ValueError: Not a URDF, xacro that was not expanded, no six turning joints, or no such link.
    """
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as fault:
        raise ValueError(f"robot_description is not well-formed XML: {fault}") from fault
    if root.tag != "robot":
        raise ValueError(f"robot_description is no URDF: its root is <{root.tag}>, expected <robot>")
    if "xacro" in text and any("xacro" in item.tag for item in root.iter()):
        raise ValueError("robot_description holds xacro elements: expand it first (xacro robot.xacro)")
    turning = [joint for joint in root.findall("joint") if joint.get("type") in _TURNING]
    if len(turning) < _AXES:
        raise ValueError(f"robot_description has {len(turning)} turning joints, expected {_AXES} or more")
    links = [link.get("name", "") for link in root.findall("link")]
    if tip and tip not in links:
        raise ValueError(f"robot_description has no link '{tip}'; it has {', '.join(links)}")
    return root.get("name", "robot"), tip or next((name for name in _TIPS if name in links), "")


def table(name: str, tip: str) -> str:
    """The table ``[robot]`` of a cell file; the URDF lies beside it."""
    lines = [
        f"# Robot {json.dumps(name)} from robot_description. Put this table into a cell file beside {URDF_NAME}, and",
        "# compare a pose with the controller's display: a URDF may have another zero pose or sense of rotation.",
        "# It holds no compliance: add [[robot.elastic]], or let counterflex cell check name what is missing.",
        "[robot]",
        f"urdf = {json.dumps(URDF_NAME)}",
    ]
    return "\n".join([*lines, *([f"urdf_tip = {json.dumps(tip)}"] if tip else [])]) + "\n"


def save(text: str, folder: Path, tip: str = "") -> tuple[Path, Path]:
    """Write the description and its table: each file whole or not at all, none where the text cannot be used.

    Args:
        text: URDF.
        folder: Made when missing.
        tip: Link that is the flange, or empty.

    Returns:
        Both files.

    Raises:
        ValueError: The text cannot be used.
        OSError: The folder cannot be written.
    """
    name, flange = checked(text, tip)
    folder.mkdir(parents=True, exist_ok=True)
    out = folder / URDF_NAME, folder / TABLE_NAME
    for file, content in zip(out, (text, table(name, flange)), strict=True):
        _write(file, content)
    return out


def _write(file: Path, content: str) -> None:
    handle, temporary = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(content)
        Path(temporary).replace(file)
    except BaseException:
        with contextlib.suppress(OSError):
            Path(temporary).unlink()
        raise
