"""Data of the page of a corrected program."""

from __future__ import annotations

import datetime

import numpy as np

from counterflex.app.correction.result import Corrected
from counterflex.report import correction_page as page


def correction_page(result: Corrected) -> str:
    """The page, as HTML text."""
    nodes, last = result.measured[-1].estimate.nodes, result.measured[-1].estimate
    begin = np.diff(nodes.chain, prepend=-1) != 0
    way = np.cumsum(np.where(begin, 0.0, np.diff(nodes.station_m, prepend=0.0)))
    data = page.CorrectionData(
        title=f"{result.summary['program']}, corrected from {len(result.summary['correct']['parts'])} part(s)",
        subtitle=f"on {result.cell.name}",
        created=datetime.datetime.now(tz=datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        summary=result.summary["correct"],
        way_m=way,
        error_m=page.broken(last.error_m, nodes.chain),
        sigma_m=last.sigma_m,
        change_m=page.broken(result.change_m[nodes.row], nodes.chain),
    )
    return data.page()
