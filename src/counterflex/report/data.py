"""Data of a report page: typed, free of files and of page layout."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import MM
from counterflex.evaluate.error_budget import BudgetLine
from counterflex.evaluate.features import FeatureRow
from counterflex.evaluate.path_deviation import PathDeviation
from counterflex.evaluate.surface import NominalSurface, SurfaceDeviation


@dataclass(frozen=True)
class Fact:
    """One line of a fact table."""

    name: str
    value: str  # With its unit, as printed
    source: str = ""  # Where the value comes from, or empty
    note: str = ""  # Anything the reader should know, or empty


@dataclass(frozen=True)
class ReportedDifference:
    """One constant that the truth has different from the model."""

    name: str
    model: str  # Value the planner used, with unit
    truth: str  # Value of the simulated cell, with unit
    change: str  # Difference as printed, for example ``+8.3 %``


@dataclass(frozen=True)
class ErrorCurve:
    """A series over time."""

    time_s: Float  # (n,) s
    value: Float  # (n,) in the unit of the plot


@dataclass(frozen=True)
class CellDrawing:
    """The robot in one posture, its reach and the blank: what the page draws from the side and from above."""

    robot: str
    caption: str  # What is special about the posture, for example the line and axes of the largest deflection
    links_m: Float  # (k, 3) m, base frame: foot of the robot, its axes from the foot outward, flange, tool tip
    flange: int  # Index of the flange in ``links_m``; what lies behind it is the tool
    # Curves (m, 2) m, horizontal distance from axis 1 and height of the flange with the wrist stretched: the border of
    # what the joint limits of axes 2 and 3 allow
    reach_m: tuple[Float, ...]
    blank_m: Float  # (8, 3) m, corners of the blank, base frame
    path_m: Float  # (n, 3) m, tool tip along the feed motions, base frame, thinned

    def from_side(self) -> list[Float]:
        """Border of the reach, horizontal distance and height, mm."""
        return [curve / MM for curve in self.reach_m]


@dataclass(frozen=True)
class VariantData:
    """One machining as the report shows it."""

    deviation: PathDeviation
    surface: SurfaceDeviation | None = None  # Surface deviation, or None where no part was simulated
    force_n: ErrorCurve | None = None  # Magnitude of the process force over time, or None

    def shades(self) -> list[dict[str, Any]]:
        """Grey bands over the entries and exits of the uncompensated run, at most 400 of them."""
        result = self.deviation
        shapes: list[dict[str, Any]] = []
        for mask, colour in ((result.entry, "rgba(90,120,160,0.16)"), (result.exit, "rgba(200,120,40,0.20)")):
            edge = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
            starts, ends = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1) - 1
            for a, b in list(zip(starts, ends, strict=True))[:200]:
                shapes.append(
                    {
                        "type": "rect",
                        "xref": "x",
                        "yref": "paper",
                        "x0": round(float(result.length_m[a]), 4),
                        "x1": round(float(result.length_m[b]), 4),
                        "y0": 0.0,
                        "y1": 1.0,
                        "fillcolor": colour,
                        "line": {"width": 0},
                        "layer": "below",
                    }
                )
        return shapes


@dataclass(frozen=True)
class Head:
    """Head of a page, and the foot of it."""

    title: str
    subtitle: str
    created: str = ""
    notes: Sequence[str] = ()
    timing: tuple[Fact, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class ReportData(Head):
    """Everything on the page that compares an uncompensated with a compensated machining."""

    # From :func:`counterflex.evaluate.summary`; all headline numbers and tables are read from it
    summary: Mapping[str, Any]
    nominal: VariantData  # The original program on the simulated cell
    compensated: VariantData  # The compensated program on the same cell
    facts: tuple[Fact, ...] = ()  # Part, robot, tool, material, program, truth seed
    # Floors and walls of the undisturbed part, or None where no part was simulated
    nominal_surface: NominalSurface | None = None
    engagement_label: str = "engagement"  # Name and unit of the engagement measure
    engagement_scale: float = 1.0  # Factor from the stations' engagement to that unit
    features: tuple[FeatureRow, ...] = ()  # Measured features; variants ``nominal`` and ``compensated``
    budget: tuple[BudgetLine, ...] = ()
    assumptions: tuple[Fact, ...] = ()  # Every assumption with value and source
    differences: tuple[ReportedDifference, ...] = ()  # How the truth differed from the model
    # Paragraphs below the headline that the reader must know (what was simulated, what was not)
    drawing: CellDrawing | None = None  # Robot, reach and blank, or None
    next_steps: tuple[str, ...] = ()  # What to do with the result, most important first
    expected: Headline | None = None  # What the plan expected of all such cells, or None where it was not predicted

    def tolerance(self) -> dict[str, Any] | None:
        """Count measured quantities out of tolerance after compensation and before; None where none was measured."""
        if not self.features:
            return None
        out = {
            variant: sum(variant not in row.worst_m or not row.ok(variant) for row in self.features)
            for variant in ("nominal", "compensated")
        }
        return {"count": len(self.features), "before": out["nominal"], "after": out["compensated"]}


@dataclass(frozen=True, eq=False)
class FeedData:
    """The feed of a program within limits."""

    way_m: Float  # (n,) m, along the program
    programmed_m_s: Float  # (n,) m/s
    feed_m_s: Float  # (n,) m/s, within the limits; nan in rapids
    binds: tuple[str, ...]  # (n,) name of the limit that binds, or empty


@dataclass(frozen=True)
class Headline:
    """99.7 % of the predicted path error, as in ``summary.json``."""

    model_mm: tuple[float, float]  # Before and after by the model without its unknowns
    # Median and ends of the 90 % interval over all that is not known; None where that was not counted
    before_mm: tuple[float, ...] | None = None
    after_mm: tuple[float, ...] | None = None  # The same with compensation
    worse: str = ""  # Probability that compensation makes it worse, as printed


@dataclass(frozen=True, kw_only=True)
class PredictionData(Head):
    """The page of a planned program: what is predicted and corrected, with no machining simulated."""

    time_s: Float  # (n,) s, at the programmed speed
    p_part_tcp: Float  # (n, 3) m, programmed tool tip
    deflection_m: Float  # (n, 3) m, predicted deflection in part axes, before compensation
    correction_m: Float  # (n, 3) m, correction added to the program
    force_n: Float  # (n,) N, magnitude of the predicted mean force
    cutting: Bool  # (n,) True where material is removed
    line: Int  # (n,) line of the program
    # (n,) m, predicted distance of the tool from the programmed path across the feed, without compensation; None where
    # it was not predicted
    error_before_m: Float | None = None
    error_after_m: Float | None = None  # (n,) m, the same with compensation, or None
    headline: Headline | None = None  # Figures that the page begins with; None where the error was not predicted
    drawing: CellDrawing | None = None  # Robot in the posture of the largest deflection, reach and blank, or None
    feed: FeedData | None = None  # What limits made of the feed, or None
    load: tuple[Fact, ...] = ()  # What to load on the controller, and what must be set there
    next_steps: tuple[str, ...] = ()  # What to do next, in order
    facts: tuple[Fact, ...] = ()
    assumptions: tuple[Fact, ...] = ()
