"""Standard deviations of the force constants that proposed test cuts would give."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import UM
from counterflex.cutting.cutter import Cutter
from counterflex.identify.cutting.force_forms import FORMS
from counterflex.identify.cutting.pieces import Pieces
from counterflex.identify.cutting.residuals import SlotResiduals, geometry_parameters
from counterflex.identify.data.model import CellModel

FORCE_N = 0.5
"""Standard deviation of the mean of a settled piece that is assumed."""


GAUGE_M = 20.0 * UM
"""Standard deviation of a gauged depth that is assumed."""


class PlannedMove(Protocol):
    """What is used of a proposed motion; see :class:`counterflex.identify.cutting.proposal.Move`."""

    @property
    def blank(self) -> int:
        """Number of the blank."""

    @property
    def cut(self) -> int:
        """Number of the cut."""

    @property
    def depth_m(self) -> float:
        """Depth."""

    @property
    def width_m(self) -> float:
        """Signed width."""

    @property
    def feed_tooth_m(self) -> float:
        """Feed per tooth."""

    @property
    def piece(self) -> bool:
        """Whether it is a test piece."""


def planned_pieces(cutter: Cutter, moves: Sequence[PlannedMove], gauged: bool) -> Pieces:
    """Pieces of proposed motions, without forces."""
    own = [m for m in moves if m.piece]
    n, R = len(own), cutter.radius_m
    width = np.array([m.width_m for m in own])
    slot = np.abs(width) >= 2.0 * R * (1.0 - 1e-9)
    up, down = ~slot & (width > 0.0), ~slot & (width < 0.0)
    return Pieces(
        force=np.ones((n, 3)),
        sigma=np.full((n, 3), FORCE_N),
        depth_m=np.array([m.depth_m for m in own]),
        depth_sigma_m=np.full(n, GAUGE_M if gauged else 0.0),
        measured=np.full(n, gauged),
        left_m=np.where(down, -R - width, R),
        right_m=np.where(up, R - width, -R),
        left_wall=down,
        right_wall=up,
        feed_tooth_m=np.array([m.feed_tooth_m for m in own]),
        drop_tooth_m=np.zeros(n),
        drop_sigma_m=np.zeros(n),
        give_m=np.zeros((n, 3)),
        elastic=np.zeros(n, dtype=np.bool_),
        axes=np.tile(np.eye(3), (n, 1, 1)),
        turn_n=np.full(n, np.nan),
        cut=np.array([m.cut for m in own], dtype=np.int64),
        blank=np.array([m.blank for m in own], dtype=np.int64),
        run_m=np.zeros(n),
        session=np.zeros(n, dtype=np.int64),
        place=np.arange(n, dtype=np.int64),
    )


def expected_sigma(cell: CellModel, cutter: Cutter, moves: Sequence[PlannedMove], *, gauged: bool) -> dict[str, float]:
    """Standard deviation of each constant of the fullest form of the law and of the tops of the blanks, SI.

    The covariance of ``J^T J`` plus the priors at the law known so far; forces of :data:`FORCE_N`, depths and widths
    as uncertain as :mod:`counterflex.identify.cutting.residuals` takes them.
    """
    pieces, form = planned_pieces(cutter, moves, gauged), FORMS[-1]
    blanks = int(np.max(pieces.blank)) + 1
    rough = SlotResiduals(pieces, cutter, form, 50e-6, cell.force_law, blanks)
    h_ref = rough.reference_m()
    block = SlotResiduals(pieces, cutter, form, h_ref, cell.force_law, blanks)
    parameters = form.parameters(cell.force_law, h_ref) + geometry_parameters(pieces)
    x = parameters.nominal
    free = np.flatnonzero(parameters.free)
    J: Float = block.jacobian(x)[:, :, free].reshape(-1, len(free)) * parameters.slope(x)[free]
    known = np.array([parameters.items[i].has_prior for i in free], dtype=np.float64)
    covariance = np.linalg.inv(J.T @ J + np.diag(known))
    sigma = np.sqrt(np.diag(covariance)) * parameters.slope(x)[free]
    return {parameters.items[i].name: float(s) for i, s in zip(free, sigma, strict=True)}
