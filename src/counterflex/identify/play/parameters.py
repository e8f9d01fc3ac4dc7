"""Constants of play and friction of one axis, with what the cell file or experience says beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from counterflex.core.units import MS, URAD
from counterflex.identify.data.model import CellModel
from counterflex.identify.play.residuals import PlayPlaces, ReversalResiduals
from counterflex.identify.reversals.data import Motion
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.robot.model.description import Play

USUAL: Final = Play(30.0 * URAD, (100.0, 100.0, 100.0), (8.0 * URAD, 28.0 * URAD, 100.0 * URAD))
"""Where the cell file has nothing: equal shares of friction, angles evenly spaced in logarithm over what encoders and
trackers resolve. Friction is scaled so that it turns the axis by :data:`USUAL_TURN_RAD`."""
USUAL_TURN_RAD: Final = 30.0 * URAD
KNOWN: Final = (40.0 * URAD, 0.3, 0.3)
"""Prior sigma of half band, friction (log) and slip (log) where the cell file has them."""
GUESSED: Final = (60.0 * URAD, 1.0, 0.5)
COMPLIANCE: Final = 0.1
DELAY_S: Final = 20.0 * MS
_STIFFEST = 1e-12


def axis_play(cell: CellModel, axis: int) -> tuple[Play, bool]:
    """Play known beforehand, and whether the cell file has it."""
    known = (cell.robot.play or (None,) * 6)[axis]
    if known is not None and known.friction_nm:
        return known, True
    soft = compliance(cell, axis)
    scale = USUAL_TURN_RAD / soft / sum(USUAL.friction_nm)
    band = USUAL.half_band_rad if known is None else known.half_band_rad
    return Play(band, tuple(f * scale for f in USUAL.friction_nm), USUAL.slip_rad), False


def compliance(cell: CellModel, axis: int) -> float:
    """Torsion compliance of an axis, rad/(N m)."""
    return max(float(cell.chain.compliance[cell.chain.torsion[axis], 5]), _STIFFEST)


def parameters(cell: CellModel, axis: int, *, free_compliance: bool, delay: bool) -> tuple[Parameters, PlayPlaces]:
    """Parameters of an axis.

    ``axis``: 0..5. ``free_compliance``: The data see elastic torsion (encoders over large motions); else it is held.
    """
    play, known = axis_play(cell, axis)
    band, dry, slip = KNOWN if known else GUESSED
    name = f"axis{axis + 1}"
    items = [
        Parameter(
            f"{name}.compliance", "rad/(N m)", compliance(cell, axis), COMPLIANCE, free=free_compliance, log=True
        ),
        Parameter(f"{name}.half_band", "rad", play.half_band_rad, band, lower=0.0, upper=5e-3),
    ]
    count = len(play.friction_nm)
    items += [
        Parameter(f"{name}.friction{e + 1}", "N m", max(f, 1e-3), dry, log=True) for e, f in enumerate(play.friction_nm)
    ]
    items += [Parameter(f"{name}.slip{e + 1}", "rad", d, slip, log=True) for e, d in enumerate(play.slip_rad)]
    if delay:
        items.append(Parameter(f"{name}.delay", "s", 0.0, DELAY_S))
    places = PlayPlaces(
        0,
        1,
        tuple(range(2, 2 + count)),
        tuple(range(2 + count, 2 + 2 * count)),
        len(items) - 1 if delay else -1,
        len(items),
    )
    return Parameters.of(items), places


def blocks(motions: Sequence[Motion], places: PlayPlaces) -> list[ReversalResiduals]:
    """Residuals of motions of one axis."""
    return [
        ReversalResiduals(
            name=f"motion {m.run + 1}, axis {m.axis + 1}",
            group=np.full(len(m.q), m.run, dtype=np.int64),
            components=(("link minus motor rad",) if m.by == "encoder" else ("along the motion m",)),
            sigma=m.sigma[:, None],
            axis=m.axis,
            by=m.by,
            q=np.ascontiguousarray(m.q),
            torque=np.ascontiguousarray(m.torque),
            time_s=m.time_s,
            measured=m.measured,
            places=places,
        )
        for m in motions
    ]
