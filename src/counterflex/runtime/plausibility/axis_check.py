"""Axis angles of a telegram held against its poses; see :mod:`.axis_check_kernel` for the law."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.array_table import ArrayTable
from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.records import Record, records
from counterflex.geometry import pose
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.runtime.plausibility import axis_check_kernel as ak
from counterflex.runtime.plausibility.limits import AxisTolerance

ABSENT: Final = ak.ABSENT
EXACT: Final = ak.EXACT
ABOUT: Final = ak.ABOUT
_TRAIL_S: Final = 0.4
"""Longest that a measured pose may trail the commanded one."""


class AxisCheck:
    """Holds the angles of each telegram against its poses, and keeps the last that agreed.

    Not part of the loop's memory: what it finds is an input of the cycle, as what other parts of the session find, and
    stands in the record.

    Args:
        chain: As the controller has it: nominal geometry.
        T_base_part: (4, 4) part frame, the frame of the poses.
        period_s: Cycle.
        tolerance: See :class:`AxisTolerance`.
        T_base_tcp: (4, 4) tool frame of a spindle that stands, where the robot holds the part: the chain ends in the
            part frame then, and ``T_base_part`` is not looked at. None: the robot holds the tool.

    Attributes:
        table: Arrays of :func:`.axis_check_kernel.angles_agree`, for a kernel that calls it.
    """

    def __init__(
        self,
        chain: ElasticChain,
        T_base_part: Float,
        period_s: float,
        tolerance: AxisTolerance | None = None,
        T_base_tcp: Float | None = None,
    ) -> None:
        chosen = AxisTolerance() if tolerance is None else tolerance
        compact = chain.compact
        T_part_base = pose.inverse(as_float("T_base_part", T_base_part, (4, 4)))
        rows = max(2, round(_TRAIL_S / as_positive("period_s", period_s)))
        checks = records(ak.CHECK)
        c = checks[0]
        c.T_part_base = np.concatenate([T_part_base[:3, :3].reshape(-1), T_part_base[:3, 3]])
        if T_base_tcp is not None:
            c.T_base_tcp = np.concatenate([T_base_tcp[:3, :3].reshape(-1), T_base_tcp[:3, 3]])
            c.holds_part = 1
        c.limit_m, c.limit_rad = chosen.position_m, chosen.rotation_rad
        c.offset_limit_m, c.offset_limit_rad = chosen.offset_m, chosen.offset_rad
        self._check: Record = c
        self.table = ArrayTable(
            ak.ARRAYS,
            stations=compact.stations,
            surroundings=compact.surroundings,
            regions=compact.regions,
            frame=np.zeros((len(compact.stations), 12)),
            trail=records(ak.TRAIL, rows),
            checks=checks,
        )

    def __call__(
        self,
        q: Float,
        commanded: Float,
        correction: Float,
        *,
        learn: bool,
        commanded_is: int = EXACT,
        measured: Float | None = None,
        measured_is: int = ABSENT,
    ) -> int:
        """Judge a telegram; angles that do not agree are replaced by the last that did.

        Args:
            q: (6,) rad; changed where they do not agree.
            commanded: (12,) commanded pose, rotation by rows and position m, part frame.
            correction: (6,) sent last, m and rotation vector, part axes.
            learn: The loop is not armed: the offset is learnt.
            commanded_is: EXACT: of the same instant as the angles; ABOUT: one is set, the other measured;
                ABSENT: not judged.
            measured: (12,) pose that the controller reports; None where it does not.
            measured_is: EXACT or ABOUT likewise; ABSENT.

        Returns:
            Cause of a hold, or 0.
        """
        reported, reported_is = (commanded, ABSENT) if measured is None else (measured, measured_is)
        return ak.angles_agree(self.table.rows, q, correction, commanded, reported, commanded_is, reported_is, learn)

    @property
    def offset(self) -> Float:
        """(6,) pose of the telegrams minus that of their angles, m and rotation vector, part axes: as learnt."""
        out: Float = self._check.offset.copy()
        return out

    @property
    def learnt(self) -> bool:
        """Return whether there is an offset."""
        return bool(self._check.learnt == 1)
