"""Result of the online step in a cycle: the correction, and what it rests on."""

from __future__ import annotations

from typing import Final

from counterflex.core.records import record

RESULT: Final = record(
    correction=(float, 6),  # what to send, m and rotation vector, part axes
    axes=(float, 6),  # the same as change of the axis angles, rad
    wrench=(float, 6),  # force that the correction is computed from, part axes
    predicted=(float, 6),  # with lead
    measured=(float, 6),  # filtered
    deflection=(float, 6),  # part axes
    wanted=(float, 6),  # correction before limits
    deviation=(float, 6),  # of the tracker
    path_distance=float,  # m
    sigma=float,  # smallest singular value of the elastic step
    cut=float,  # 1 where the plan cuts
    factor=(float, 3),  # measured by predicted force
    model=(float, 3),  # share of the deflection that the force does not explain
    offset=(float, 6),  # deviation that does not go with the force, m and rad, part axes
    uncertain=float,  # standard deviation of the expected deviation
    surprise=(float, 3),  # largest innovation by its deviation: force, tracker, currents; 0 without a sample
    state=int,
    cause=int,
    feed_hold=int,
    stop=int,
    silent=int,
    limits=int,  # bits of the limiter: translation, then rotation shifted by 4
    elastic=int,  # bits of the elastic step
    soft=int,
    hard=int,
    sources=int,  # bits of Source: what the estimate rests on
    degraded=int,  # cause for which a source of the cell is missing, or 0
    doubt=int,  # bits of :mod:`counterflex.runtime.plausibility.kernel`
    rejected=int,  # samples of the tracker that were rejected, in all
)
"""Results of a cycle, SI, part axes."""
