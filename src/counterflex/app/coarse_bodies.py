"""Coarse bodies of a cell while a program runs: those of the cell file, and assumed ones for what it does not say."""

from __future__ import annotations

from dataclasses import replace

from counterflex.app.inputs import Job
from counterflex.core.arrays import Float
from counterflex.cutting.stock import HeightMap
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.plan.preflight.bodies import (
    CollisionBody,
    carried,
    held_part,
    holder,
    links,
    part_bodies,
    standing,
    turned_round,
    with_given,
)


def coarse_bodies(job: Job, cell: Cell, stock: HeightMap) -> list[CollisionBody]:
    """Links, spindle, every tool that the program has in it, blank and table; with those of the cell file.

    Where the robot holds the part, spindle and tools stand, and a gripper holds the blank: there is no table. Where the
    cell is seen along a tilted tool, bodies of the part stand as they do in the part frame, not in the working plane.

    Args:
        cell: The cell, perhaps in the working plane of a tilted tool.
    """
    R_part_plane = cell.R_part_plane
    if R_part_plane is not None:
        stock = replace(cell, R_part_plane=None).stock()
    known = {tool.number: tool for tool in cell.tables.tools}
    used = sorted(known.keys() & set(job.machined.tool.tolist()))
    overhang = {n: length for n in used if (length := known[n].overhang_m) is not None}
    chain = cell.controller_chain
    there, removed = cell.tables.cell.bodies(cell.path.parent)
    given = [_on_floor(body, cell.T_base_floor) for body in there]
    cutters = {n: cell.cutter(n) for n in used}
    holders = [body for n in used for body in holder(n, known[n].bounds.holder_m)]
    if cell.T_base_tcp is not None:
        T_base_tcp = cell.T_base_tcp
        given = [turned_round(body, T_base_tcp) for body in (*given, *holders)]
        assumed = [*links(chain), *held_part(chain, stock), *standing(chain, cutters, overhang, T_base_tcp)]
        return with_given(assumed, given, removed)
    assumed = [*links(chain), *carried(chain, cutters, overhang), *part_bodies(stock)]
    bodies = with_given(assumed, [*given, *holders], removed)
    if R_part_plane is None:
        return bodies
    T_plane_part = pose.make(R_part_plane.T)
    return [_in_plane(body, T_plane_part) if body.frame == "part" else body for body in bodies]


def _on_floor(body: CollisionBody, T_base_floor: Float) -> CollisionBody:
    """The body where it stands, seen from a robot that external axes have carried away."""
    if body.frame != "base" or not body.surrounds:
        return body
    T_floor_body = body.T_frame_body
    return replace(body, T_frame_body=T_base_floor @ T_floor_body)


def _in_plane(body: CollisionBody, T_plane_part: Float) -> CollisionBody:
    T_part_body = body.T_frame_body
    return replace(body, T_frame_body=T_plane_part @ T_part_body)
