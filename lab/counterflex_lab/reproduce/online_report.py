"""Tables and page of ``reproduce online``: what each way of correcting leaves of each wrong plan."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from typing import Any, Final

from counterflex import __version__
from counterflex_lab.reproduce.online_case import WAYS
from counterflex_lab.reproduce.way import REFUSED, worst_and_median
from counterflex_lab.reproduce.wrong_plans import WRONG
from counterflex_lab.reproduce.wrong_plans_page import Mark, WrongPlansData, wrong_plans_page

RIGHT: Final = next(iter(WRONG))
"""Row of the right plan."""
PLAN: Final = "plan"
LEAST_LOSS_MM: Final = 0.03
"""Loss of a wrong plan below which no share of it is stated: it would be one of noise."""
RESTORED: Final = 0.7
WORSE_MM: Final = 0.010
LEFT_MM: Final = 0.15


def restored(left_mm: float, plan_mm: float, right_mm: float) -> float | None:
    """Share of what a wrong plan loses that a way of correcting brings back: ``(plan - left) / (plan - right)``.

    Args:
        left_mm: What the way leaves, where the plan is wrong.
        plan_mm: What the wrong plan alone leaves.
        right_mm: What the right plan alone leaves.

    Returns:
        1 where all is brought back, below 0 where the error became larger; None where the wrong plan loses less than
        :data:`LEAST_LOSS_MM`.
    """
    loss = plan_mm - right_mm
    return None if loss < LEAST_LOSS_MM else (plan_mm - left_mm) / loss


def over_seeds(table: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Figures by row and way: ``p997_mm``, ``max_mm`` (worst), medians, ``restored`` and ``worse_mm`` than the plan.

    Args:
        table: ``seeds`` of the summary: ``seed``, ``row``, ``variants``.
    """
    right = {item["seed"]: item["variants"][PLAN]["path"]["p997_mm"] for item in table if item["row"] == RIGHT}
    out: dict[str, dict[str, Any]] = {}
    for row in dict.fromkeys(item["row"] for item in table):
        here = [item for item in table if item["row"] == row]
        out[row] = {way: _figures(way, here, right) for way in here[0]["variants"]}
    return out


def _figures(way: str, here: Sequence[Mapping[str, Any]], right: Mapping[int, float]) -> dict[str, Any]:
    runs, out = WAYS[way].counted([item["variants"][way] for item in here])
    if not runs:
        return out
    for key in ("p997_mm", "max_mm"):
        out |= worst_and_median(key, [run["path"][key] for run in runs])
    counted = [item for item in here if WAYS[way].acted(item["variants"][way])]
    pairs = [
        (item["variants"][way]["path"]["p997_mm"], item["variants"][PLAN]["path"]["p997_mm"], right[item["seed"]])
        for item in counted
    ]
    shares = [share for pair in pairs if (share := restored(*pair)) is not None]
    out["worse_mm"] = round(max(left - plan for left, plan, _ in pairs), 6)
    if shares:
        out |= {"restored": round(min(shares), 4), "median_restored": round(statistics.median(shares), 4)}
    return out


def goals(total: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Goals with the worst figure of each and whether it is kept; never kept where a run was refused.

    Args:
        total: Of :func:`over_seeds`.
    """
    felt = [row for row in total if WRONG[row].seen_by_force]
    shares = {
        "hybrid_restores": [total[row]["hybrid"] for row in felt],
        "all_restores": [total[row]["all"] for row in total],
    }
    out = {
        name: _goal([i["restored"] for i in items if "restored" in i], RESTORED, least=True, of=items)
        for name, items in shares.items()
    }
    for way in ("hybrid", "all"):
        items = [total[row][way] for row in total]
        out[f"{way}_not_worse_mm"] = _goal([i["worse_mm"] for i in items if "worse_mm" in i], WORSE_MM, of=items)
    first = [total[RIGHT]["hybrid"]]
    out["hybrid_mm"] = _goal([i["p997_mm"] for i in first if "p997_mm" in i], LEFT_MM, of=first)
    return out


def _goal(
    values: Sequence[float], limit: float, *, least: bool = False, of: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    worst = (min(values) if least else max(values)) if values else None
    kept = worst is not None and (worst >= limit if least else worst <= limit)
    return {"limit": limit, "worst": worst, "met": kept and not any(item["refused"] for item in of)}


def table_rows(summary: Mapping[str, Any], kind: str = "p997_mm") -> list[list[str]]:
    """Rows of the table that is printed: what is wrong, and for every way the median and worst figure.

    Args:
        summary: Of the job.
        kind: ``p997_mm``, ``max_mm`` or ``restored``.
    """
    return [
        [WRONG[row].title, *(_spread(total[way], kind) for way in WAYS if way in total)]
        for row, total in summary["rows"].items()
    ]


def _spread(figures: Mapping[str, Any], kind: str) -> str:
    if kind not in figures:
        return "-"
    if kind == "restored":
        return f"{100 * figures['median_restored']:.0f} / {100 * figures['restored']:.0f}"
    return f"{figures[f'median_{kind}']:.3f} / {figures[kind]:.3f}"


def verdict(summary: Mapping[str, Any]) -> str:
    """The goals in one sentence, nothing rounded in favour of a method."""
    goals = (
        ("hybrid_restores", "hybrid restores of what wrong forces cost", "%"),
        ("all_restores", "all sources of what any wrong plan costs", "%"),
        ("hybrid_not_worse_mm", "hybrid is worse than the plan by", "mm"),
        ("all_not_worse_mm", "all sources by", "mm"),
        ("hybrid_mm", "hybrid with a right plan leaves", "mm"),
    )
    return f"Worst of all runs: {'; '.join(_outcome(summary['goals'][name], *words) for name, *words in goals)}."


def _outcome(goal: Mapping[str, Any], text: str, unit: str) -> str:
    if goal["worst"] is None:
        return f"{text}: no run counts"
    value = f"{100 * goal['worst']:.0f} %" if unit == "%" else f"{goal['worst']:.3f} mm"
    return f"{text} {value} ({'kept' if goal['met'] else 'missed'})"


def page(summary: Mapping[str, Any]) -> str:
    """The page, as HTML text."""
    seeds = sorted({item["seed"] for item in summary["seeds"]})
    marks = [
        Mark(WRONG[item["row"]].title, way, item["seed"], figures["path"]["p997_mm"])
        for item in summary["seeds"]
        for way, figures in item["variants"].items()
        if WAYS[way].acted(figures)
    ]
    data = WrongPlansData(
        title="Where online correction pays",
        subtitle=f"a groove with wrong plans on {len(seeds)} simulated cells ({summary['family']}, "
        f"{summary['truth_level']}), seeds {', '.join(map(str, seeds))}",
        verdict=verdict(summary),
        ways=list(WAYS),
        about=[(name, way.title) for name, way in WAYS.items()],
        tables=[
            ("Path error, 99.7 %, mm: median / worst", table_rows(summary)),
            ("Largest path error, mm: median / worst", table_rows(summary, "max_mm")),
            ("Restored of what the wrong plan loses, %: median / worst", table_rows(summary, "restored")),
        ],
        refused=REFUSED if any(i["refused"] for t in summary["rows"].values() for i in t.values()) else "",
        marks=marks,
        versions={"counterflex": __version__},
    )
    return wrong_plans_page(data)
