"""What a report page is made from: typed, free of files and of page layout."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from counterflex.core.arrays import Bool, Float, Int
from counterflex.evaluate.error_budget import BudgetLine
from counterflex.evaluate.features import FeatureRow
from counterflex.evaluate.path_deviation import PathDeviation
from counterflex.evaluate.surface import NominalSurface, SurfaceDeviation


@dataclass(frozen=True)
class Fact:
    """One line of a fact table.

    Attributes:
        value: With its unit, as printed.
        source: Where the value comes from, or empty.
        note: Anything the reader should know, or empty.
    """

    name: str
    value: str
    source: str = ""
    note: str = ""


@dataclass(frozen=True)
class Difference:
    """One constant that the truth has different from the model.

    Attributes:
        model: Value the planner used, with unit.
        truth: Value of the simulated cell, with unit.
        change: Difference as printed, for example ``+8.3 %``.
    """

    name: str
    model: str
    truth: str
    change: str


@dataclass(frozen=True)
class Curve:
    """A series over time.

    Attributes:
        time_s: (n,) s.
        value: (n,) in the unit of the plot.
    """

    time_s: Float
    value: Float


@dataclass(frozen=True)
class CellDrawing:
    """The robot in one posture, its reach and the blank: what the page draws from the side and from above.

    Attributes:
        caption: What is special about the posture, for example the line and axes of the largest deflection.
        links_m: (k, 3) m, base frame: foot of the robot, its axes from the foot outward, flange, tool tip.
        flange: Index of the flange in ``links_m``; what lies behind it is the tool.
        reach_m: Curves (m, 2) m, horizontal distance from axis 1 and height of the flange with the wrist stretched:
            the border of what the joint limits of axes 2 and 3 allow.
        blank_m: (8, 3) m, corners of the blank, base frame.
        path_m: (n, 3) m, tool tip along the feed motions, base frame, thinned.
    """

    robot: str
    caption: str
    links_m: Float
    flange: int
    reach_m: tuple[Float, ...]
    blank_m: Float
    path_m: Float


@dataclass(frozen=True)
class VariantData:
    """One machining as the report shows it.

    Attributes:
        surface: Surface deviation, or None where no part was simulated.
        force_n: Magnitude of the process force over time, or None.
    """

    deviation: PathDeviation
    surface: SurfaceDeviation | None = None
    force_n: Curve | None = None


@dataclass(frozen=True)
class ReportData:
    """Everything on the page that compares an uncompensated with a compensated machining.

    Attributes:
        title: Headline, for example the part's name.
        summary: From :func:`counterflex.evaluate.summary`; all headline numbers and tables are read from it.
        nominal: The original program on the simulated cell.
        compensated: The compensated program on the same cell.
        facts: Part, robot, tool, material, program, truth seed.
        nominal_surface: Floors and walls of the undisturbed part, or None where no part was simulated.
        engagement_label: Name and unit of the engagement measure.
        engagement_scale: Factor from the stations' engagement to that unit.
        features: Measured features; variants ``nominal`` and ``compensated``.
        assumptions: Every assumption with value and source.
        differences: How the truth differed from the model.
        timing: Steps of the job and what they took.
        notes: Paragraphs below the headline that the reader must know (what was simulated, what was not).
        drawing: Robot, reach and blank, or None.
        next_steps: What to do with the result, most important first.
        expected: What the plan expected of all such cells, or None where it was not predicted.
    """

    title: str
    subtitle: str
    created: str
    summary: Mapping[str, Any]
    nominal: VariantData
    compensated: VariantData
    facts: tuple[Fact, ...] = ()
    nominal_surface: NominalSurface | None = None
    engagement_label: str = "engagement"
    engagement_scale: float = 1.0
    features: tuple[FeatureRow, ...] = ()
    budget: tuple[BudgetLine, ...] = ()
    assumptions: tuple[Fact, ...] = ()
    differences: tuple[Difference, ...] = ()
    timing: tuple[Fact, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    drawing: CellDrawing | None = None
    next_steps: tuple[str, ...] = ()
    expected: Headline | None = None


@dataclass(frozen=True, eq=False)
class FeedData:
    """The feed of a program within limits.

    Attributes:
        way_m: (n,) m, along the program.
        programmed_m_s: (n,) m/s.
        feed_m_s: (n,) m/s, within the limits; nan in rapids.
        binds: (n,) name of the limit that binds, or empty.
    """

    way_m: Float
    programmed_m_s: Float
    feed_m_s: Float
    binds: tuple[str, ...]


@dataclass(frozen=True)
class Headline:
    """99.7 % of the predicted path error, as in ``summary.json``.

    Attributes:
        model_mm: Before and after by the model without its unknowns.
        before_mm: Median and ends of the 90 % interval over all that is not known; None where that was not counted.
        after_mm: The same with compensation.
        worse: Probability that compensation makes it worse, as printed.
    """

    model_mm: tuple[float, float]
    before_mm: tuple[float, ...] | None = None
    after_mm: tuple[float, ...] | None = None
    worse: str = ""


@dataclass(frozen=True)
class PredictionData:
    """The page of a planned program: what is predicted and corrected, with no machining simulated.

    Attributes:
        time_s: (n,) s, at the programmed speed.
        p_part_tcp: (n, 3) m, programmed tool tip.
        deflection_m: (n, 3) m, predicted deflection in part axes, before compensation.
        correction_m: (n, 3) m, correction added to the program.
        force_n: (n,) N, magnitude of the predicted mean force.
        cutting: (n,) True where material is removed.
        line: (n,) line of the program.
        error_before_m: (n,) m, predicted distance of the tool from the programmed path across the feed, without
            compensation; None where it was not predicted.
        error_after_m: (n,) m, the same with compensation, or None.
        headline: Figures that the page begins with; None where the error was not predicted.
        drawing: Robot in the posture of the largest deflection, reach and blank, or None.
        feed: What limits made of the feed, or None.
        load: What to load on the controller, and what must be set there.
        next_steps: What to do next, in order.
    """

    title: str
    subtitle: str
    created: str
    time_s: Float
    p_part_tcp: Float
    deflection_m: Float
    correction_m: Float
    force_n: Float
    cutting: Bool
    line: Int
    error_before_m: Float | None = None
    error_after_m: Float | None = None
    headline: Headline | None = None
    drawing: CellDrawing | None = None
    feed: FeedData | None = None
    load: tuple[Fact, ...] = ()
    next_steps: tuple[str, ...] = ()
    facts: tuple[Fact, ...] = ()
    assumptions: tuple[Fact, ...] = ()
    timing: tuple[Fact, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
