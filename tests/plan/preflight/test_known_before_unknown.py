"""The row of a check is its worst verdict: what is known to be beyond its limit is told beside what is not known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.units import MM, UM
from counterflex.cutting.cutter import Cutter
from counterflex.path.toolpath import FEED, RAPID, ToolPath
from counterflex.plan.feed_limits import CutDemand
from counterflex.plan.preflight.process.demands import LIMITS, correction_row, demand_rows
from counterflex.plan.preflight.process.tool_bounds import ToolBounds
from counterflex.plan.preflight.process.tool_use import coolant_row, feed_row, speed_row
from counterflex.plan.preflight.row import NOT_LOOKED_AT, CheckLimits, Row
from counterflex.plan.process_limits import ProcessLimits

N = 4
CUTS = np.array([False, True, True, True])
PATH = ToolPath(
    np.array([[10.0 * MM * k, 0.0, 0.0] for k in range(N)]),
    np.tile([0.0, 0.0, 1.0], (N, 1)),
    np.array([RAPID, FEED, FEED, FEED]),
    np.full(N, 0.01),
    np.full(N, 1000.0),
    np.arange(N, dtype=float),
    np.arange(N),
    np.array([1, 1, 2, 2]),
    np.zeros(N),
)
"""Tool 1 cuts at row 1, tool 2 at rows 2 and 3."""
BOUNDS = CheckLimits(0.0, 0.0, 1.0, 0.012, 0.0, correction_m=1.0 * MM)


def cutter_of(_: int) -> Cutter:
    return Cutter(10.0 * MM)


def cutting_speed(tools: dict[int, ToolBounds]) -> Row:
    return speed_row(PATH, CUTS, cutter_of, tools)


def coolant(tools: dict[int, ToolBounds]) -> Row:
    return coolant_row(PATH, CUTS, np.zeros(N, dtype=np.int64), tools)


@pytest.mark.parametrize("known", [1, 2])
@pytest.mark.parametrize(
    ("check", "beyond", "within"),
    [
        (cutting_speed, ToolBounds(cutting_speed_m_s=(1.0, 2.0)), ToolBounds(cutting_speed_m_s=(1.0, 10.0))),
        (coolant, ToolBounds(coolant=True), ToolBounds(coolant=False)),
    ],
)
def test_a_tool_that_says_nothing_hides_none_that_is_beyond(
    check: type, beyond: ToolBounds, within: ToolBounds, known: int
) -> None:
    row = check({known: beyond})
    assert row.verdict == "warning"
    assert f"T{known}" in row.what
    assert check({known: within}).verdict == NOT_LOOKED_AT
    assert check({1: within, 2: within}).verdict == "ok"


def test_an_assumed_range_that_is_left_by_more_hides_no_stated_one() -> None:
    fz = np.array([0.0, 1.0, 0.2, 0.2]) * MM  # 4 times what is assumed for tool 1, twice what is stated for tool 2
    stated = {2: ToolBounds(feed_per_tooth_m=(0.01 * MM, 0.1 * MM))}
    row = feed_row(PATH, fz, CUTS, cutter_of, stated)
    assert (row.verdict, row.limit) == ("fail", 0.1 * MM)
    assert feed_row(PATH, fz, CUTS, cutter_of, {}).verdict == "warning"


def demand(bending_m: float = 0.0, deflection_m: float = 0.0) -> CutDemand:
    values = {name: np.zeros(N) for limit in LIMITS for name in limit.names}
    values["tool bending"], values["deflection"] = np.array([0.0, bending_m, 0.0, 0.0]), np.full(N, deflection_m)
    bent = np.zeros((N, 6))
    bent[:, 0] = deflection_m
    return CutDemand(values, bent)


def rows_of(asked: CutDemand, limits: dict[int, ProcessLimits], rigid: str = "") -> dict[str, Row]:
    rows = demand_rows(asked, PATH.tool, PATH.spindle_rad_s, lambda n: limits[n], rigid)
    return {row.check: row for row in [*rows, correction_row(asked, BOUNDS, rigid)]}


def test_a_tool_of_unknown_overhang_hides_none_that_bends_too_far() -> None:
    known = ProcessLimits(bending_m=10.0 * UM, overhang_m=50.0 * MM)
    limits = {1: known, 2: replace(known, overhang_m=None)}
    assert rows_of(demand(bending_m=50.0 * UM), limits)["tool bending"].verdict == "warning"
    assert rows_of(demand(bending_m=5.0 * UM), limits)["tool bending"].verdict == NOT_LOOKED_AT


@pytest.mark.parametrize("check", ["deflection", "correction"])
def test_springs_that_are_not_known_hide_no_deflection_of_those_that_are(check: str) -> None:
    """An axis without a stiffness counts as rigid: what it yields besides is not known, what the others do is."""
    limits = dict.fromkeys((1, 2), ProcessLimits(deflection_m=1.0 * MM))
    assert rows_of(demand(deflection_m=2.0 * MM), limits, "axis 3")[check].verdict == "warning"
    assert rows_of(demand(deflection_m=0.5 * MM), limits, "axis 3")[check].verdict == NOT_LOOKED_AT
    assert rows_of(demand(deflection_m=0.5 * MM), limits)[check].verdict == "ok"
