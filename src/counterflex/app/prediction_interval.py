"""Interval of the predicted path errors of a plan that nine of ten such cells lie in.

The error of the tool at a point is what the plan predicts there and what each unknown of the cell
(:mod:`counterflex.app.unknowns`) leaves there, drawn from what is known of it. Beside the unknown values there are two
errors of the form of the model, as isotropic parts of the deflection:

- :data:`STRUCTURE` of it everywhere: Haehn and Weigold 2020 leave 6 % of the deflection after identification;
- :data:`DRIVES` of it where the force changes, where nothing says how far a motor yields before its loop has answered.

Of loop gains that the robot's class gave, what they make the motors yield is drawn, with the spread of
:mod:`counterflex.robot.model.class_prior`, or what a first cut has left of it.

What the predicted tool swings is larger or smaller by a factor of its own (:data:`SWING`): its damping is assumed.

Of each draw the figure is taken as of the plan: 99.7 % of the path in the cut stay below it, square to the feed. Passes
that cut again what an earlier pass left belong to it (``Plan.judged``): at high feed they swing most. The
interval is of a plan's own figures, so it holds no error of the program, of the tool or of the part's clamping.

**Calibration.** Where the draws of a level of knowledge were compared with simulated cells
(:data:`CALIBRATION`), the distance of each end from the median is multiplied, in logarithms, by a factor: the smallest
with which at most one cell in twenty lies beyond that end (split conformal, with the correction for few cells).

Sharp corners in the cut are not covered (:func:`sharp_corners`): the model brakes as the feed and the acceleration of
the cell file say, a controller by rules of its own.
"""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib import resources
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from counterflex.app.cut_points import CutPoints, points_of_plan
from counterflex.app.inputs import setting_of
from counterflex.app.lowest_mode import at_largest_force
from counterflex.app.unknown_stiffness import ROBOTS, Expected, expected
from counterflex.app.unknowns import DisplacementSource, sources
from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import Cell
from counterflex.path.external_axes import ExternalPlaces
from counterflex.path.toolpath import FEED
from counterflex.plan.plan import Plan
from counterflex.plan.sag_and_play import play_deviation
from counterflex.plan.static_correction import lasting
from counterflex.robot.elasticity.compliance import shares
from counterflex.robot.model.class_prior import AXES

STRUCTURE: Final = 0.06
"""Of the deflection, in a direction of its own."""
DRIVES: Final = 0.10
"""The same near a change of force: a KR 300 with unknown drives left 0.255 instead of 0.114 mm of 1.65 mm."""
SWING: Final = 0.4
"""Of the logarithm of the size of what the predicted tool swings about its mean over a period of the lowest mode.
Damping within :data:`counterflex.plan.lowest_mode.DAMPING_INTERVAL` gives 0.2 of it, masses off by 15 % 0.1, the speeds
of the controller at corners the rest. With exact constants the swings of 24 tuning cells (`wide`, seeds 1 to 12, helix
and groove) had 0.55 to 1.8 times the predicted size; 0.4 leaves no helix above its range, 0.3 one in twelve."""
YIELD: Final = "drives.yield"
"""Name of the value of a first cut: what the drives yield, over what the class has them yield."""
CALIBRATION: Final = "interval_factors.toml"
"""Factors on the ends of intervals, with the command that wrote them, its seeds and its date."""
SHARP_RAD: Final = 30.0 * DEG
"""Turn of the path from which on a controller slows down or stops by rules of its own."""
SERVO: Final = "servo"
"""Recipe that measures how far the motors yield."""
MODEL: Final = "model"
"""In place of a recipe: the form of the model."""
Kept = Mapping[str, float]
_CHANGE_S: Final = 0.3  # So long before and after a row its force is compared with
_CHANGED: Final = 0.3  # Share of the largest deflection that counts as a change
_SEED: Final = 10
_SWING_SEED: Final = 11


@dataclass(frozen=True)
class Foreseen:
    """Path error of a plan over cells that differ by all that is not known of this one."""

    nominal: Expected  # 99.7 % of the path error across the feed, of the program as it is
    compensated: Expected  # The same of the compensated program
    # Share of the cells, 0 to 1, in which the compensated program leaves more than the program as it is
    worse_share: float


@dataclass(frozen=True)
class IntervalCalibration:
    """Factors on the ends of drawn intervals: lower and upper end, on the logarithmic distance from the median."""

    before: tuple[float, float]  # Of the program as it is
    after: tuple[float, float]  # Of the compensated program
    cells: int  # Simulated cells that were compared
    figures: int  # Path errors that each factor comes from
    family: str
    seeds: str
    date: str
    command: str  # That wrote the factors

    @property
    def shown(self) -> dict[str, Any]:
        """Plain values for a summary; ``text`` says which cells were compared."""
        text = f"{self.cells} simulated cells ({self.family}, seeds {self.seeds}, {self.date})"
        return asdict(self) | {"before": list(self.before), "after": list(self.after), "text": text}


def calibration_of(cell: Cell) -> IntervalCalibration | None:
    """Return the factors for what is known of a cell; None where no simulated cells were compared at that level.

    There are factors for the catalogue alone: nothing identified, stiffness stated, drives and play by the class.
    """
    given = cell.class_drives
    typical = given is not None and len(given.servo_axes) == len(given.play_axes) == AXES
    if cell.tables.identified or cell.class_stiffness is not None or not typical:
        return None
    return _calibrations().get("catalogue")


@functools.cache
def _calibrations() -> dict[str, IntervalCalibration]:
    data = tomllib.loads((resources.files("counterflex.app") / CALIBRATION).read_text(encoding="utf-8"))
    return {
        row.pop("level"): IntervalCalibration(tuple(row.pop("before")), tuple(row.pop("after")), **row)
        for row in data["levels"]
    }


def calibrated(drawn_m: Float, factors: tuple[float, float] | None) -> Float:
    """Return (draws,) lengths, below and above their median moved by factors of :class:`IntervalCalibration`."""
    median = float(np.median(drawn_m))
    if factors is None or median == 0.0:
        return drawn_m
    share = drawn_m / median
    out: Float = median * share ** np.where(share < 1.0, *factors)
    return out


def foreseen(
    plan: Plan, cell: Cell, places: ExternalPlaces | None = None, *, as_drawn: bool = False
) -> Foreseen | None:
    """Return the predicted path errors with what is not known, calibrated where there are factors for the cell.

    Args:
        as_drawn: Leave the factors out.

    Returns:
        The figures; None where nothing is cut, nothing was predicted, or the robot holds the part (which this does not
        count).
    """
    if cell.holds_part:
        return None
    points = points_of_plan(plan, cell, "the program", places)
    if points is None or np.all(np.isnan(plan.deviation_compensated_part)):
        return None
    off, R_base_part = _unknown_displacement(plan, cell, points, places), _part_axes(plan, cell, points, places)
    sizes = []
    for deviation in (plan.deviation_nominal_part, plan.deviation_compensated_part):
        swing, more = swings(plan, cell, deviation)
        predicted, swinging = (
            np.einsum("...ij,...j->...i", R_base_part, values[points.row]) for values in (deviation, swing)
        )
        sizes.append(points.sizes(predicted + more * swinging + off))
    worse = float(np.mean(sizes[1] > sizes[0]))
    factors = None if as_drawn else calibration_of(cell)
    each = (None, None) if factors is None else (factors.before, factors.after)
    nominal, compensated = (expected(calibrated(*pair), points.of) for pair in zip(sizes, each, strict=True))
    return Foreseen(nominal, compensated, worse)


def swings(plan: Plan, cell: Cell, deviation: Float) -> tuple[Float, Float]:
    """Swing (n, 3) m of a predicted deviation about its mean, and how much more of it each draw has (draws, 1, 1)."""
    swing: Float = deviation - lasting(deviation, plan.path.time_s, 1.0 / at_largest_force(cell, plan).mode.hz)
    more = np.exp(SWING * np.random.default_rng(_SWING_SEED).standard_normal((ROBOTS, 1, 1))) - 1.0
    return swing, more


def unknown_in_part(plan: Plan, cell: Cell, points: CutPoints, kept: Kept) -> Float:
    """(draws, n, 3) m, part axes: what all unknowns together leave at points of a plan.

    Args:
        kept: Share of each unknown that counts, by the word of its recipe; 1 where it is not listed.
    """
    R_base_part = _part_axes(plan, cell, points, None)
    out: Float = _unknown_displacement(plan, cell, points, kept=kept) @ R_base_part
    return out


def with_intervals(
    figures: dict[str, Any], plan: Plan, cell: Cell, places: ExternalPlaces | None = None
) -> dict[str, Any]:
    """Return the figures of a plan with what is not known: the figures to plan with come first.

    Args:
        figures: With ``predicted_nominal`` and ``predicted_compensated`` where they were predicted; left as it is.

    Returns:
        The same with ``headline`` in front (``before_mm`` and ``after_mm``: median, lower and upper end of the 90 %
        interval; ``probability_of_worse``; ``sharp_corners`` that it does not cover; ``calibration``), the interval
        ``p997_90_mm`` and the median ``p997_median_mm`` in each predicted error, and the lowest mode that was taken.
    """
    out = dict(figures) | {"lowest_mode": at_largest_force(cell, plan).shown}
    errors = foreseen(plan, cell, places)
    if errors is None:
        return out
    headline: dict[str, Any] = {}
    for name, key, one in (("nominal", "before_mm", errors.nominal), ("compensated", "after_mm", errors.compensated)):
        median, low, high = (round(value / MM, 4) for value in (one.median_m, one.low_m, one.high_m))
        headline[key] = [median, low, high]
        error = {"p997_median_mm": median, "p997_90_mm": [low, high]}
        out[f"predicted_{name}"] = figures[f"predicted_{name}"] | error
    headline |= {"probability_of_worse": round(errors.worse_share, 4), "sharp_corners": sharp_corners(plan)}
    factors = calibration_of(cell)
    headline["calibration"] = None if factors is None else factors.shown
    return {"headline": headline, **out}


def sharp_corners(plan: Plan) -> int:
    """Return how often the path turns by :data:`SHARP_RAD` or more in the cut: the speed there is not drawn."""
    step = np.diff(plan.path.p_part_tcp, axis=0, prepend=plan.path.p_part_tcp[:1])
    length = np.linalg.norm(step, axis=1)
    moves = np.flatnonzero((plan.path.kind == FEED) & (length > 0.0))
    first, second = moves[:-1], moves[1:]
    cosine = np.sum(step[first] * step[second], axis=1) / (length[first] * length[second])
    run = np.cumsum(plan.path.kind != FEED)
    at = (cosine <= np.cos(SHARP_RAD)) & (run[first] == run[second]) & plan.cutting[first] & plan.cutting[second]
    return int(np.count_nonzero(at))


def expected_deflection(cell: Cell, points: CutPoints, known: str = "") -> Expected:
    """Return the deflection of the tool at rest, nothing compensated, over cells that differ by what is not known.

    Args:
        known: Recipe whose unknowns do not count: ``cutting`` where the load was measured.
    """
    whole = shares(cell.chain, points.q, points.w_tcp_base)[..., :3].sum(axis=1)
    unknown = [one for one in sources(cell, points, planned=False) if one.recipe.split()[0] != known]
    off = _left_open(unknown, whole, np.random.default_rng(_SEED))
    return expected(points.sizes(whole + off), points.of)


def headline_text(ends_mm: Sequence[float]) -> str:
    """``0.45 mm (0.26 to 1.52 mm in nine of ten such cells)`` of a median and the ends of its interval."""
    median, low, high = ends_mm
    return f"{median:.2f} mm ({low:.2f} to {high:.2f} mm in nine of ten such cells)"


def worse_text(share: float) -> str:
    """``17 %`` of a probability; one that no draw or every draw shows is said as a bound."""
    least = 1.0 / ROBOTS
    if share < least:
        return f"below {100.0 * least:g} %"
    return f"above {100.0 * (1.0 - least):g} %" if share > 1.0 - least else f"{100.0 * share:.2g} %"


def _part_axes(plan: Plan, cell: Cell, points: CutPoints, places: ExternalPlaces | None) -> Float:
    """(3, 3) or (n, 3, 3) axes of the part at the points, base axes."""
    out: Float = (cell.T_base_part if places is None else places.Ts_base_part(plan.path.place[points.row]))[..., :3, :3]
    return out


def _unknown_displacement(
    plan: Plan,
    cell: Cell,
    points: CutPoints,
    places: ExternalPlaces | None = None,
    kept: Kept = MappingProxyType({}),
) -> Float:
    """(draws, n, 3) m, base axes: what all unknowns together leave."""
    bend = shares(cell.chain, points.q, points.w_tcp_base)[..., :3].sum(axis=1)
    rng = np.random.default_rng(_SEED)
    out = _left_open(sources(cell, points), bend, rng, kept)
    yielding = kept.get(SERVO, 1.0)
    sigma = yield_sigma(cell)  # about the mean, which the plan takes
    if sigma > 0.0:
        softer = np.exp(sigma * rng.standard_normal((ROBOTS, 1, 1)) - 0.5 * sigma**2) - 1.0
        R_base_part = _part_axes(plan, cell, points, places)
        yields = yielding * drives_yield(plan, cell)[points.row]
        out = out + softer * np.einsum("...ij,...j->...i", R_base_part, yields)
    elif cell.chain.servo is None:
        changing = np.linalg.norm(bend, axis=1) * _changing(plan, points)
        out = out + yielding * DRIVES * changing[:, None] * rng.standard_normal((ROBOTS, 1, 3))
    return out


def yield_sigma(cell: Cell) -> float:
    """Standard deviation of the logarithm of how far the motors yield: by the class, else by a first cut; else 0."""
    given = cell.class_drives
    if given is not None and given.servo_axes:
        return given.prior.yield_log_sigma
    sigma = 0.0
    for entry in cell.tables.identified:
        if entry.recipe == "servo":  # each loop has been measured since
            sigma = 0.0
        for one in entry.values:
            sigma = one.sigma / one.value if one.name == YIELD else sigma
    return sigma


def drives_yield(plan: Plan, cell: Cell) -> Float:
    """(n, 3) m, part axes: how far the motors yield of which :func:`yield_sigma` tells."""
    given, chain = cell.class_drives, replace(cell.chain, play=None)
    if given is not None and given.servo_axes:
        chain = given.given_to(replace(chain, servo=None), play=False)
    relative = setting_of(cell, chain=chain, part_may_be_held=True).relative_motion(plan.path)
    path, mode = plan.path, at_largest_force(cell, plan).mode
    return play_deviation(chain, relative, path.p_part_tcp, plan.q, plan.w_tcp_part, path.time_s, None, mode)


def _left_open(
    unknown: Sequence[DisplacementSource], bend: Float, rng: np.random.Generator, kept: Kept = MappingProxyType({})
) -> Float:
    """(draws, n, 3) m, base axes: what the form of the model and all unknown values leave of a deflection (n, 3)."""
    structure = kept.get(MODEL, 1.0) * STRUCTURE
    out: Float = structure * np.linalg.norm(bend, axis=1)[:, None] * rng.standard_normal((ROBOTS, 1, 3))
    for one in unknown:
        if one.displacements is not None:
            out = out + kept.get(one.recipe.split()[0], 1.0) * one.displacements
    return out


def _changing(plan: Plan, points: CutPoints) -> Float:
    """(n,) 1 where the force changes within :data:`_CHANGE_S`, else 0."""
    size, time = np.linalg.norm(plan.deflection_part[:, :3], axis=1), plan.path.time_s
    begin = np.searchsorted(time, time[points.row] - _CHANGE_S)
    end = np.searchsorted(time, time[points.row] + _CHANGE_S, side="right")
    most = float(size.max(initial=0.0))
    return np.array(
        [float(np.ptp(size[a:b]) > _CHANGED * most) for a, b in zip(begin.tolist(), end.tolist(), strict=True)]
    )
