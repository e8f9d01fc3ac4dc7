"""The cut of the undisturbed tool: what it meets along the nominal path, and the force that decides the correction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import ModelError
from counterflex.core.progress import Progress
from counterflex.core.units import MM
from counterflex.path.toolpath import FEED
from counterflex.plan.cut import Cut, at_points, cut
from counterflex.plan.flute_length import check_flutes
from counterflex.plan.inputs import Inputs, place
from counterflex.plan.plan import impulse_share

EXTRAPOLATED_SHARE = 0.02
"""Share of the force impulse that may come from chips outside the law's range before planning refuses."""
_CONTACT_M3 = 1e-12


@dataclass(frozen=True, eq=False)
class UndisturbedCut:
    """What the tool meets where it runs along the nominal path.

    Attributes:
        cut: Engagement, chips and force of each row.
        contact: (n,) rows at feed that take material.
        extrapolated: (n,) rows whose mean chip is outside the range of the force law.
        w_tcp_part: (n, 6) N, N m at the points, about the tip, part axes.
    """

    cut: Cut
    contact: Bool
    extrapolated: Bool
    w_tcp_part: Float


def undisturbed_cut(inputs: Inputs, progress: Progress) -> UndisturbedCut:
    """Cut along the nominal path with a tool that does not yield.

    Args:
        inputs: Path, blank, tools and law.
        progress: Progress callback, fraction 0 to 1.

    Raises:
        ModelError: Force comes from chips outside the law's range, or a cut is deeper than the flutes are long.
        ProgramError: Material is cut with the spindle stopped.
    """
    path, setting = inputs.path, inputs.setting
    result = cut(path, path.p_part_tcp, inputs.stock.copy(), setting.cutter_of, setting.law, progress=progress)
    contact = (path.kind == FEED) & (result.volume_m3 > _CONTACT_M3)
    check_flutes(path, result.volume_m3, setting.cutter_of, lambda row: place(path, inputs.line, row))
    extrapolated = _check_chips(result, contact, inputs)
    return UndisturbedCut(result, contact, extrapolated, at_points(result.w_tcp_part, contact))


def _check_chips(result: Cut, contact: Bool, inputs: Inputs) -> Bool:
    """Rows cut with a mean chip outside the law's range; refused where too much of the force comes from them."""
    path, line, setting = inputs.path, inputs.line, inputs.setting
    law = setting.law
    outside = contact & ((result.chip_m < law.h_min_m) | (result.chip_m > law.h_max_m))
    share = impulse_share(np.where(contact[:, None], result.w_tcp_part, 0.0), path.time_s, outside)
    if share > EXTRAPOLATED_SHARE and not setting.allow_extrapolation:
        row = int(np.argmax(np.where(outside, np.linalg.norm(result.w_tcp_part[:, :3], axis=1), -1.0)))
        raise ModelError(
            "force would come from chips outside the range of the cutting constants",
            where=place(path, line, row),
            value=f"mean chip {result.chip_m[row] / MM:.3g} mm, {100 * share:.0f} % of the force",
            limit=f"{law.h_min_m / MM:g} to {law.h_max_m / MM:g} mm, at most {100 * EXTRAPOLATED_SHARE:g} %",
            hint="Use constants measured at this feed, or set material.allow_extrapolation = true",
            share=share,
        )
    return outside
