"""Corrections that a simulated controller applied, cycle by cycle: the judge of a compensator, on the robot's side."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field
from typing import Final, TextIO

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, US
from counterflex.geometry import rotation
from counterflex.twin.devices.robot_server import CycleSeen

COLUMNS: Final = (
    "cycle",
    "time_s",
    "counter_ms",
    "sent",
    "accepted",
    "refused",
    "late",
    "age_cycles",
    "stat",
    "reply_us",
    *(f"{a}_{'mm' if a in 'xyz' else 'deg'}" for a in "xyzabc"),
    *(f"a{i}_deg" for i in range(1, 7)),
    *(f"shift_{a}_mm" for a in "xyz"),
)
"""Of the record: correction in force (x .. c, a1 .. a6), and what the path had shown of it at the end of the cycle."""


@dataclass
class Applied:
    """Follows the cycles of a controller.

    Args:
        stream: Where every cycle is written as CSV, or None.
    """

    stream: TextIO | None = None
    correction_m: float = 0.0  # largest correction in force, its length
    correction_rad: float = 0.0  # largest angle of its rotation
    axes_rad: float = 0.0  # largest correction of an axis
    step_m: float = 0.0  # largest change of the correction from one cycle to the next, its length
    step_rad: float = 0.0  # likewise, of its rotation
    step_axes_rad: float = 0.0  # likewise, of an axis
    clamped: int = 0  # cycles in which POSCORR or AXISCORR clamped
    # reasons for which answers were not accepted, with their number
    refused: dict[str, int] = field(default_factory=dict)
    # how many cycles each age of the correction in force was met: 0 is an answer in time
    ages: dict[int, int] = field(default_factory=dict)
    reply_s: array[float] = field(default_factory=lambda: array("f"))  # times from a telegram to its answer
    _before: Float = field(default_factory=lambda: np.zeros(12))
    _age: int = 0

    def __post_init__(self) -> None:
        """Write the head of the record."""
        if self.stream is not None:
            self.stream.write(",".join(COLUMNS) + "\n")

    def see(self, seen: CycleSeen) -> None:
        """Take a cycle."""
        now = np.concatenate([seen.correction, seen.axes])
        step = now - self._before
        self._before = now
        self.correction_m = max(self.correction_m, float(np.linalg.norm(now[:3])))
        self.correction_rad = max(self.correction_rad, _angle(now[3:6]))
        self.axes_rad = max(self.axes_rad, float(np.max(np.abs(now[6:]))))
        self.step_m = max(self.step_m, float(np.linalg.norm(step[:3])))
        self.step_rad = max(self.step_rad, _angle(step[3:6]))
        self.step_axes_rad = max(self.step_axes_rad, float(np.max(np.abs(step[6:]))))
        self.clamped += int(seen.stat == 2)
        self._age = self._age + 1 if seen.refused else 0
        self.ages[self._age] = self.ages.get(self._age, 0) + 1
        if seen.refused:
            self.refused[seen.refused] = self.refused.get(seen.refused, 0) + 1
        if math.isfinite(seen.reply_s):
            self.reply_s.append(seen.reply_s)
        if self.stream is not None:
            self.stream.write(self._line(seen, now) + "\n")

    def _line(self, seen: CycleSeen, now: Float) -> str:
        shift = (seen.report.T_part_actual[:3, 3] - seen.report.T_part_nominal[:3, 3]) / MM
        numbers = np.concatenate([now[:3] / MM, now[3:] / DEG, shift])
        reply = f"{seen.reply_s / US:.1f}" if math.isfinite(seen.reply_s) else ""
        head = (
            str(seen.cycle),
            f"{seen.report.time_s:.3f}",
            str(seen.counter),
            str(int(seen.sent)),
            str(int(not seen.refused)),
            seen.refused,
            str(seen.late),
            str(self._age),
            str(seen.stat),
            reply,
        )
        return ",".join((*head, *(f"{value:.6f}" for value in numbers)))

    def young(self, cycles: int) -> float:
        """Share of the cycles in which the correction in force was at most so many cycles old."""
        total = sum(self.ages.values())
        return sum(n for age, n in self.ages.items() if age <= cycles) / total if total else 1.0


def _angle(abc: Float) -> float:
    """Angle of the rotation ``Rz(A) Ry(B) Rx(C)``, rad."""
    return float(np.linalg.norm(rotation.log(rotation.from_zyx(abc))))
