"""A figure that a paper prints, beside ours, with a verdict that follows from both."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, Literal

Verdict = Literal["reproduced", "differs", "cannot be checked"]

ROUNDING: Final = "the paper's rounding"
PAPERS: Final = ("denkena2015", "haehn2020", "berger2013", "mandiola2023")


@dataclass(frozen=True)
class Printed:
    """One figure.

    Attributes:
        paper: One of :data:`PAPERS`.
        place: Where it stands there: table, equation, section.
        what: What it is.
        unit: Of all values; empty for ratios.
        printed: The value as printed, its text.
        value: Ours, computed by the model or met in the simulated cell; None where nothing can be.
        least: Smallest value that counts as reproduced, same unit.
        most: Largest.
        band: Where ``least`` and ``most`` come from.
        why: Why it differs, or cannot be checked; said only then.
        assumed: What the paper leaves out and was assumed.
    """

    paper: str
    place: str
    what: str
    unit: str
    printed: str
    value: float | None
    least: float = -math.inf
    most: float = math.inf
    band: str = ROUNDING
    why: str = ""
    assumed: str = ""

    @property
    def verdict(self) -> Verdict:
        """``reproduced`` where ours lies from ``least`` to ``most``."""
        if self.value is None:
            return "cannot be checked"
        return "reproduced" if self.least <= self.value <= self.most else "differs"

    @property
    def reason(self) -> str:
        """What stands behind the verdict: the band it lies in, or why it does not."""
        return self.band if self.verdict == "reproduced" else self.why

    def plain(self) -> dict[str, Any]:
        """Plain values for a summary."""
        return {
            "paper": self.paper,
            "place": self.place,
            "what": self.what,
            "unit": self.unit,
            "printed": self.printed,
            "ours": None if self.value is None else float(f"{self.value:.4g}"),
            "least": self.least if math.isfinite(self.least) else None,
            "most": self.most if math.isfinite(self.most) else None,
            "verdict": self.verdict,
            "reason": self.reason,
            "assumed": self.assumed,
        }


def around(value: float, share: float) -> tuple[float, float]:
    """Least and most: ``value`` less and more by a share of it."""
    return value * (1.0 - share), value * (1.0 + share)
