"""The robots of the catalogue, listed, and one robot as its maker's data sheet shows it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from counterflex.core.units import DEG, MM
from counterflex.robot.model import catalog
from counterflex.robot.model.controller_axes import MAKERS, shown_limits, turns_zyx
from counterflex.robot.model.description import Robot


def robots() -> list[dict[str, Any]]:
    """One row per catalogue robot: name, model, reach, payload, and the status of each group of numbers."""
    rows = []
    for name in catalog.names():
        entry = catalog.entry(name)
        rows.append(
            {
                "name": name,
                "model": f"{entry.manufacturer} {entry.model}",
                "reach_mm": entry.reach_mm,
                "payload_kg": entry.payload_kg,
                "status": {group: source.status for group, source in entry.sources.items()},
                "source": {group: source.source for group, source in entry.sources.items()},
            }
        )
    return rows


def robot_named(name_or_cell: str) -> Robot:
    """A robot of the catalogue, or the one of a cell file as its controller computes with it.

    Raises:
        InputError: No such robot; the nearest names are listed.
    """
    if Path(name_or_cell).suffix == ".toml" or Path(name_or_cell).is_file():
        from counterflex.files.cell.cell import read_cell  # half a second, which a bare robot does not need

        return read_cell(name_or_cell).nominal_robot
    return catalog.load(name_or_cell)


def data_sheet(robot: Robot) -> dict[str, Any]:
    """A robot in the form of its maker's data sheet, to be compared by a person.

    Returns:
        ``lengths_mm`` by what they measure, ``axes`` (name, limits and speed as the controller shows them), ``axis_3``
        (what it is counted from), ``world``, ``at_zero`` (flange in the controller's world with all axes at zero, in
        its own words).
    """
    axes = robot.axes
    maker = None if axes.maker is None else MAKERS[axes.maker]
    letter = "axis " if maker is None else maker.letter
    limits = shown_limits(axes, robot.joint_limits_rad) / DEG
    speeds = robot.joint_speeds_rad_s
    return {
        "controller": "not known" if maker is None else maker.title,
        "lengths_mm": _lengths(robot),
        "axes": [
            {
                "axis": f"{letter}{i + 1}",
                "low_deg": round(float(limits[i, 0]), 3),
                "high_deg": round(float(limits[i, 1]), 3),
                "speed_deg_s": None if speeds is None else round(float(speeds[i] / DEG), 3),
            }
            for i in range(6)
        ],
        "axis_3_against_upper_arm_deg": [round(float(v), 3) for v in robot.joint_limits_rad[2] / DEG]
        if axes.coupled and axes.between_known
        else None,
        "axis_3": "from the horizontal, whatever axis 2 does"
        if axes.coupled
        else "as the robot is described"
        if maker is None
        else "from the upper arm",
        "coupled": axes.coupled,
        "assumed": axes.assumed,
        "world": "not known"
        if maker is None
        else "on the base plate, on axis 1"
        if axes.world_m == 0.0
        else f"on axis 1, {axes.world_m / MM:g} mm above the base plate"
        + (" (height of axis 2)" if axes.world_m == axes.axis_2_m else ""),
        "at_zero": _at_zero(robot),
    }


def _lengths(robot: Robot) -> dict[str, float]:
    opw = robot.opw
    if opw is None:
        return {}
    lengths = {
        "base plate to axis 2, height": opw.c1_m,
        "axis 1 to axis 2, ahead": opw.a1_m,
        "axis 1 to the arm's plane, beside": opw.b_m,
        "axis 2 to axis 3 (upper arm)": opw.c2_m,
        "axis 3 to axis 4, height with the forearm level": -opw.a2_m,
        "axis 3 to the wrist centre, along the forearm": opw.c3_m,
        "wrist centre to the flange": opw.c4_m,
    }
    return {name: round(value / MM, 4) + 0.0 for name, value in lengths.items()}


def _at_zero(robot: Robot) -> dict[str, float]:
    from counterflex.robot.elasticity.chain import ElasticChain, flange

    T = robot.axes.in_world(flange(ElasticChain.build(robot), robot.axes.model(np.zeros(6))))
    maker = robot.axes.maker
    words = turns_zyx(T[:3, :3]) if maker is None else MAKERS[maker].orientation(T[:3, :3])
    place = {f"{name} mm": value / MM for name, value in zip("XYZ", T[:3, 3], strict=True)}
    return {name: round(float(value), 4) + 0.0 for name, value in (place | words).items()}
