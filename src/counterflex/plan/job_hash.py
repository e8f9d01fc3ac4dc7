"""What ties a compensated program to its plan: a hash over the points that are commanded."""

from __future__ import annotations

import hashlib
from typing import Final

import numpy as np

from counterflex.plan.plan import Plan

DIGITS: Final = 16


def job_hash(plan: Plan) -> str:
    """Hash of what a plan commands: the first 16 hexadecimal digits of a SHA-256.

    It is over the nominal points, their corrections (position and orientation), the tools and the numbers of the
    source's lines, as little-endian numbers of 64 bits.

    Args:
        plan: As planned, not as read back: a plan file holds shop units, whose numbers are rounded in the last bit. Its
            metadata hold the hash.
    """
    digest = hashlib.sha256()
    for values in (plan.path.p_part_tcp, plan.correction_part, plan.rotvec_part):
        digest.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
    for whole in (plan.path.tool, plan.line):
        digest.update(np.ascontiguousarray(whole, dtype="<i8").tobytes())
    return digest.hexdigest()[:DIGITS]
