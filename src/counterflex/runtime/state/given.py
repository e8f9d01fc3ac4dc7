"""Inputs of the online step in a cycle: poses, force, torque, and what is known of them."""

from __future__ import annotations

from typing import Final

from counterflex.core.records import record

GIVEN: Final = record(
    nominal=(float, 12),  # rotation by rows, position m: commanded pose without correction, part frame
    q=(float, 6),  # axis angles, rad
    wrench=(float, 6),  # of the process on the tool about the TCP, part axes, unfiltered
    actual=(float, 12),  # measured pose of the tool, part frame
    tracker_late=float,  # s from the measurement of `actual` to now; below zero where not known
    tracker_sigma=float,  # m, of that measurement; 0 where not known
    torque=(float, 6),  # of the process about the axes, from motor currents, N m
    reported=(float, 12),  # pose that the controller itself reports, correction included, part frame
    elapsed=int,  # cycles since the last telegram, 1 when none was lost; 0 for no telegram
    force_age=int,  # cycles since the last good force
    tracker_new=int,  # 1: `actual` is new and good; 2: new, and not believed
    tracker_age=int,  # cycles since the last good tracker sample
    healthy=int,
    arm=int,
    enable=int,
    stop=int,
    reset=int,
    soft=int,  # cause of a hold found outside of the step, or 0
    hard=int,  # cause of a fault found outside of the step, or 0
    sources=int,  # bits of Source: what this cell has
    current_age=int,  # cycles since the last good motor currents
    is_reported=int,  # 1: there is a `reported`
)
"""Inputs of a cycle, SI."""
