"""The stops that planning inserts where a cut ends: there the relieved tool comes back before it lifts."""

from __future__ import annotations

import dataclasses
from typing import Final

import numpy as np

from counterflex.path.toolpath import FEED, RAPID, ToolPath

SETTLING_S: Final = 0.05
"""Time the tool is given at the end of a cut to come back to its programmed place before it lifts."""


def with_settling(path: ToolPath) -> ToolPath:
    """Give the tool a stop at the end of every feed run that is followed by a rapid.

    There the feed ends and with it the force, while the tool still stands in the cut. A correction that stayed until
    the tool has left would push the relieved tool into the wall; the stop is the row at which it is taken back.
    Only planning knows it: no stop is written, and what is machined has none.
    """
    last = np.flatnonzero((path.kind[:-1] == FEED) & (path.kind[1:] == RAPID))
    if len(last) == 0:
        return path
    columns = {}
    for field in dataclasses.fields(ToolPath):
        values = getattr(path, field.name)
        columns[field.name] = np.insert(values, last + 1, values[last], axis=0)
    stops = last + 1 + np.arange(len(last))
    delay = np.zeros(len(columns["time_s"]))
    delay[stops] = SETTLING_S
    columns["time_s"] = columns["time_s"] + np.cumsum(delay)
    return ToolPath(**columns)
