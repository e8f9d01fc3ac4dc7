"""Record that the stages of one cycle of the online step hand to each other; nothing of it is remembered."""

from __future__ import annotations

from typing import Final

from counterflex.core.records import record

CYCLE: Final = record(
    predicted=(float, 6),  # wrench that the plan expects now, N, N m, part axes; as the next four
    ahead=(float, 6),  # when a correction acts
    behind=(float, 6),  # when the robot was where it is commanded now
    late=(float, 6),  # the last through the filters of the measured force
    used=(float, 6),  # wrench that the correction is computed from
    contained=(float, 6),  # correction that the program contains here, m and rotation vector
    direction=(float, 9),  # rows: feed, across, along the tool
    deviation=(float, 6),  # of the tracker, m and rad
    innovation=(float, 6),  # of it that the observer did not expect
    R_base_part=(float, 9),  # part axes in the base, by rows
    load=(float, 12),  # axis angles, and wrench in base axes
    vector=(float, 6),  # work space, as the next two
    rows=(float, 12),
    zero=(float, 6),
    path_distance=float,  # m
    cut=float,  # 1 where the plan cuts
    forward_share=float,  # share of the lag behind the program that could be undone
    elapsed=int,  # cycles to move the correction for
    planned=int,  # 1: there is a plan, and the place on it is known
    row=int,  # of the plan
    moving=int,  # 1: the force of this cycle says something of the plan's
    active=int,  # 1: the correction acts
    held=int,  # 1: it was held
    soft=int,  # cause of a hold, or 0
    hard=int,  # cause of a fault, or 0
    sources=int,  # bits of Source in use
    degraded=int,  # cause for which one is missing, or 0
    elastic=int,  # bits of the elastic step
)
"""Intermediate results of a cycle, SI, part axes."""
