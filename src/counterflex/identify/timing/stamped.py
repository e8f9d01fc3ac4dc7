"""Channels of a record with the clock that stamped each, checked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.units import MS
from counterflex.identify.data.dataset import Dataset

CLOCKS: Final = {"p_tracker_target": "tracker", "R_tracker_target": "tracker", "w_sensor": "force", "q_link": "link"}
"""Channels that may carry stamps of their own, ``time_<clock>_s``; all others are stamped by ``time_s``."""
FEWEST: Final = 50
"""Samples below which nothing is said about time."""
_GAP = 10.0


@dataclass(frozen=True, eq=False)
class Stamped:
    """A channel over time."""

    name: str  # canonical name of the channel
    time_s: Float  # (n,) s, rising
    values: Float  # (n, k) SI
    sigma: Float  # (n, k) SI
    clock: str  # name of the clock that stamped it
    remarks: tuple[str, ...]  # what was set right, in words
    where: str

    @property
    def step_s(self) -> float:
        """Median time between samples, s."""
        return float(np.median(np.diff(self.time_s)))


def stamped(dataset: Dataset, name: str) -> Stamped:
    """A channel of a record with its own time.

    ``dataset``: Of kind ``record``, ``reversals`` or ``servo_steps``.

    Returns:
        The channel; rows that repeat stamp and values of the row before (a buffer read twice) are left out with a
        remark. With the setting ``cycle_s``, time is the row number times that.

    Raises:
        FileFormatError: A value or stamp is not a number, time runs backwards, stamps repeat although values change,
            or the record is too short. The message names the line.
    """
    channel = dataset.channel(name)
    values, sigma = channel.values, channel.need_sigma()
    own = f"time_{CLOCKS[name]}_s" if name in CLOCKS else ""
    separate = bool(own) and dataset.has(own)
    column = own if separate else "time_s"
    key = f"clock_{CLOCKS[name]}" if separate else "clock"
    clock = str(dataset.settings.get(key, CLOCKS[name] if separate else "controller"))
    if len(dataset) < FEWEST:
        raise FileFormatError(
            "the record is too short", where=dataset.where, value=f"{len(dataset)} rows", limit=f">= {FEWEST}"
        )
    if "cycle_s" in dataset.settings:
        time = np.arange(len(dataset)) * float(dataset.settings["cycle_s"])
    else:
        time = dataset.values(column)[:, 0]
    for what, array in ((column, time[:, None]), (name, values)):
        bad = np.flatnonzero(~np.all(np.isfinite(array), axis=1))
        if len(bad):
            raise FileFormatError(
                f"channel '{what}' holds a value that is not a number",
                where=dataset.place(int(bad[0])),
                value=f"{len(bad)} such rows",
                hint="Leave out rows that were not measured",
            )
    step = np.diff(time)
    if np.any(step < 0.0):
        row = int(np.argmin(step))
        raise FileFormatError(
            f"time runs backwards in '{column}'",
            where=dataset.place(row + 1),
            value=f"{step[row] / MS:g} ms",
            limit="> 0",
            hint="If the stamps are damaged and the rows came at equal times, state settings.cycle_ms in the manifest",
        )
    remarks: list[str] = []
    keep = np.concatenate([[True], step > 0.0])
    again = np.flatnonzero(~keep)
    if len(again):
        changed = np.any(values[again] != values[again - 1], axis=1)
        if np.any(changed):
            raise FileFormatError(
                f"stamps of '{column}' repeat although '{name}' changes",
                where=dataset.place(int(again[int(np.argmax(changed))])),
                value=f"{int(changed.sum())} rows",
                hint="The file has rounded stamps: state settings.cycle_ms in the manifest if rows came at equal times",
            )
        remarks.append(f"{name}: {len(again)} rows repeat time stamp and values of the previous row and were skipped")
    time, values, sigma = time[keep], values[keep], sigma[keep]
    step = np.diff(time)
    gaps = int(np.sum(step > _GAP * np.median(step)))
    if gaps:
        remarks.append(f"{name}: {gaps} gaps longer than {_GAP:g} samples, the longest {step.max():.3g} s")
    return Stamped(name, time, values, sigma, clock, tuple(remarks), f"{dataset.where or dataset.name}: {name}")
