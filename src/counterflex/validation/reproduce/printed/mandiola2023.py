"""Figures of Mandiola and others 2023: gain, and square and circle with a tracker in the loop of the simulated cell."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from counterflex.validation.reproduce.printed.row import Printed

PAPER: Final = "mandiola2023"
GAIN: Final = 0.01
CYCLE_S: Final = 0.004
NOT_RUN: Final = "not run: counterflex reproduce all without --no-runs"
ANOTHER: Final = "a simulated KR 300 with drives that trail in the same way, not the paper's RX160; worst of the truths"


def rows(summary: Mapping[str, Any] | None = None) -> list[Printed]:
    """The table.

    Args:
        summary: Of ``counterflex reproduce mandiola2023``; without it the rows of square and circle cannot be checked.
    """

    def worst(variant: str, *keys: str) -> float | None:
        if summary is None:
            return None
        values: list[Any] = [row["variants"][variant] for row in summary["seeds"]]
        for key in keys:
            values = [value[key] for value in values]
        return max(float(value) for value in values)

    def taken(variant: str, key: str) -> float | None:
        return None if summary is None else 100.0 * min(float(item[variant][key]) for item in summary["reductions"])

    def row(
        place: str, what: str, unit: str, printed: str, ours: float | None, least: float, most: float, why: str
    ) -> Printed:
        return Printed(
            PAPER,
            place,
            what,
            unit,
            printed,
            ours,
            least,
            most,
            "as printed",
            NOT_RUN if ours is None else why,
            ANOTHER,
        )

    slower = "the published gain is half as fast as the errors of this circle; the designed one is in docs/tracker.md"
    return [
        Printed(
            PAPER,
            "section III",
            "K of 0.01 each 4 ms as an integrator: its crossover without delay",
            "rad/s",
            "0.01 per cycle",
            GAIN / CYCLE_S,
            2.45,
            2.55,
            "arithmetic",
        ),
        row(
            "figure 5a",
            "error in motion on the circle, uncompensated",
            "mm",
            "above 1",
            _mm(worst("off", "circle", "turn", "total", "max_um")),
            1.0,
            10.0,
            "the simulated drives trail less",
        ),
        row(
            "figure 6a",
            "contour error of the circle, uncompensated",
            "mm",
            "above 0.2",
            _mm(worst("off", "circle", "turn", "contour", "max_um")),
            0.2,
            10.0,
            "the simulated robots are more accurate",
        ),
        row(
            "figure 5b",
            "error left on the straights, rms, published gain",
            "um",
            "about 25",
            worst("published", "square", "straights", "total", "rms_um"),
            0.0,
            35.0,
            "an integrator without feed-forward leaves what trails, feed by feed",
        ),
        row(
            "figure 7",
            "contour error of the circle taken away, published gain",
            "%",
            "66",
            taken("published", "circle_contour_rms"),
            60.0,
            100.0,
            slower,
        ),
        row(
            "figure 7",
            "contour error of the circle taken away, designed gains",
            "%",
            "66",
            taken("designed", "circle_contour_rms"),
            66.0,
            100.0,
            "see docs/tracker.md",
        ),
        row(
            "conclusions",
            "error taken away over all, published gain",
            "%",
            "80 to 90",
            taken("published", "circle_total_rms"),
            80.0,
            100.0,
            slower,
        ),
    ]


def _mm(value_um: float | None) -> float | None:
    return None if value_um is None else value_um / 1000.0
