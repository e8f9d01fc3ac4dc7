"""Row of process monitoring: whether one broken tooth shows in the force signal at the speeds of the cut."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool
from counterflex.cutting.cutter import Cutter
from counterflex.path.toolpath import ToolPath
from counterflex.plan.preflight.row import NOT_LOOKED_AT, Row, Verdict
from counterflex.runtime.monitoring.hidden_tooth import hidden_tooth

BROKEN_TOOTH: Final = "broken tooth in the force signal"
KEY: Final = "monitor"


def tooth_row(path: ToolPath, cuts: Bool, cutter_of: Callable[[int], Cutter], sample_s: float | None) -> Row:
    """Return the cut in which one broken tooth shows least: speed, teeth and sampling rate say it before the cut.

    Args:
        path: n rows.
        cuts: (n,) segments that remove material with the spindle on.
        cutter_of: Cutter of a tool number.
        sample_s: Period of the force sensor; None where the process is not monitored.
    """
    if sample_s is None:
        return Row(BROKEN_TOOTH, NOT_LOOKED_AT, missing=KEY)
    rows = np.flatnonzero(cuts)
    pairs, first = np.unique(np.stack([path.spindle_rad_s[rows], path.tool[rows]], axis=1), axis=0, return_index=True)
    hidden = [
        (one, int(rows[at]))
        for (speed_rad_s, tool), at in zip(pairs.tolist(), first.tolist(), strict=True)
        if (one := hidden_tooth(speed_rad_s / (2.0 * np.pi), cutter_of(int(tool)).flutes, sample_s)) is not None
    ]
    if not hidden:
        return Row(BROKEN_TOOTH, "ok", what="it shows at every spindle speed of the cut" if len(rows) else "no cut")
    worst, row = max(hidden, key=lambda pair: len(pair[0].slips))
    verdict: Verdict = NOT_LOOKED_AT if worst.mostly else "warning"
    text = "it does not show" if worst.mostly else "it shows, but not"
    return Row(
        BROKEN_TOOTH,
        verdict,
        point=row,
        what=f"{text} {worst.where}; it does with {worst.remedy}",
        advice=f"Cut with {worst.remedy}",
    )
