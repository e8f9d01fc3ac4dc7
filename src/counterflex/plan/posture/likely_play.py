"""A chain with the lost motion that its axes are likely to have, where nobody measured it."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.plan.posture.way import LOST_RAD
from counterflex.robot.elasticity import play
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.model.description import Play

LIKELY_RAD: Final = 0.5 * LOST_RAD
"""Lost motion of an axis of which nothing is known: the mean between none and what makers of gears guarantee."""


def with_likely_play(chain: ElasticChain) -> ElasticChain:
    """The chain with play and friction where none are known: :data:`LIKELY_RAD` at a reversal, half of it each.

    Args:
        chain: Its ``play``, where known, is kept.
    """
    known = chain.play or (None,) * 6
    soft = np.maximum(chain.compliance[chain.torsion, 5], play.STIFFEST_RAD_NM)
    quarter = 0.25 * LIKELY_RAD
    assumed = [Play(quarter, (quarter / float(c),), (LIKELY_RAD,)) for c in soft]
    return replace(chain, play=tuple(own or other for own, other in zip(known, assumed, strict=True)))
