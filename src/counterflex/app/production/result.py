"""Result of production identification, as figures, sentences, pictures and plain values."""

from __future__ import annotations

import importlib.metadata
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from counterflex import __version__
from counterflex.app.production.history import KeptRun
from counterflex.core.arrays import Float
from counterflex.core.units import MM, N_PER_MM, N_PER_MM2, UM, plain
from counterflex.files.cell.cell import Cell
from counterflex.files.identification_file import figure_rows, fit_table
from counterflex.identify.cutting.force_forms import DIRECTIONS, NAMES, constants
from counterflex.identify.data.changes import CuttingLaw
from counterflex.identify.data.model import CellModel
from counterflex.identify.production.constants import SIGNIFICANT, ConstantEstimate
from counterflex.identify.production.drift import LEVEL, ForceDrift, NamedEvents, RunFactor
from counterflex.identify.production.hypotheses import Kind
from counterflex.identify.recipe import Curve, Figure, Identification, Picture

SURE = 0.67
"""Probability from which on a new edge counts as seen."""
LIMIT = 5.0
"""Error of the mean force on runs not used that is aimed at, %."""


@dataclass(frozen=True, eq=False)
class Produced:
    """Everything that the job found."""

    cell: Cell  # Cell file as read
    model: CellModel  # As identification sees it
    tool: int  # Number of the tool
    material: str
    runs: Sequence[KeptRun]  # All of them in their order
    new: Sequence[KeptRun]  # Those that are not in the history yet
    estimate: ConstantEstimate
    factors: Sequence[RunFactor]  # Of each run
    drift: ForceDrift  # Over the runs
    known: Mapping[str, float]  # Standard deviations of constants that the cell file has identified
    options: Mapping[str, Any]
    remarks: tuple[str, ...]
    plans: tuple[Path, ...]
    title: str  # Of the job

    @property
    def is_better(self) -> bool:
        """Return whether what was found predicts stretches that were not used better than the cell file does."""
        mean, before = self.estimate.held_out.mean()
        return mean < before

    @property
    def is_proposed(self) -> bool:
        """Return whether the constants are proposed in place of the stated ones."""
        return self.estimate.difference.is_significant and self.is_better


def identification_of(p: Produced) -> Identification:
    """Figures, changes, remarks and pictures of the report."""
    estimate = p.estimate
    law = estimate.law(p.model.force_law, _source(p))
    return Identification(
        recipe="production",
        fits={"production": estimate.fit},
        headline=_headline(p),
        figures=_figures(p),
        changes=(CuttingLaw(law),) if p.is_proposed else (),
        remarks=tuple(_remarks(p)),
        pictures=_pictures(p),
    )


def _source(p: Produced) -> str:
    names = [kept.facts["run"] for kept in p.runs]
    return "production runs " + ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def _headline(p: Produced) -> tuple[Figure, ...]:
    held = p.estimate.held_out
    mean, before = held.mean()
    worst, worst_before = held.largest()
    return (
        Figure(
            "holdout_mean_percent", "mean error of the mean force on stretches held out, of the force",
            100.0 * mean, 100.0 * before, LIMIT,
        ),
        Figure(
            "holdout_worst_percent", "largest error of the mean force on stretches held out, of the force",
            100.0 * worst, 100.0 * worst_before,
        ),
    )  # fmt: skip


def _figures(p: Produced) -> tuple[Figure, ...]:
    estimate, fit, grown = p.estimate, p.estimate.fit, p.drift
    k, _, _ = constants(p.model.force_law, estimate.h_ref_m)
    out = [
        Figure("h_ref_um", "reference chip thickness, where the force of the cuts arises", estimate.h_ref_m / UM),
        Figure("h_least_um", "least mean chip thickness", estimate.range_m[0] / UM),
        Figure("h_largest_um", "largest mean chip thickness", estimate.range_m[1] / UM),
    ]
    for i, d in enumerate(DIRECTIONS):
        out.append(
            Figure(f"k{d}_ref_n_mm2", f"k{d} at the reference thickness", fit.values[i] / N_PER_MM2, k[i] / N_PER_MM2)
        )
        out.append(Figure(f"k{d}_ref_sigma_n_mm2", "its standard deviation", fit.sigma[i] / N_PER_MM2))
    for i, name in enumerate(NAMES[3:], 3):
        if fit.parameters.free[i]:
            unit = 1.0 if i < 6 else N_PER_MM
            label = name if i < 6 else f"edge_{name[1]}_n_mm"
            out.append(Figure(label, f"{name}", fit.values[i] / unit, fit.parameters.items[i].nominal / unit))
            out.append(Figure(f"{label}_sigma", "its standard deviation", fit.sigma[i] / unit))
    out.append(Figure("chance", "probability of such a difference from what is stated", estimate.difference.chance))
    if grown.is_known:
        out += [
            Figure("wear_percent_per_m", "growth of the force per length of cut, at the last run", 100.0 * grown.slope),
            Figure("wear_low_percent_per_m", f"lower end of its {100 * LEVEL:g} % interval", 100.0 * grown.low),
            Figure("wear_high_percent_per_m", f"upper end of its {100 * LEVEL:g} % interval", 100.0 * grown.high),
            Figure(
                "grown_percent", "growth of the force since the first run of the present edge",
                100.0 * grown.grown, None,
                100.0 * float(p.options["wear_limit"]),
            ),
            Figure("grown_low_percent", f"lower end of its {100 * LEVEL:g} % interval", 100.0 * grown.grown_low),
            Figure("grown_high_percent", f"upper end of its {100 * LEVEL:g} % interval", 100.0 * grown.grown_high),
        ]  # fmt: skip
    return tuple(out)


def wear_word(p: Produced) -> str:
    """Return the growth of the present edge beside its limit: ``beyond``, ``at``, ``within`` or ``unknown``."""
    grown, limit = p.drift, float(p.options["wear_limit"])
    if not grown.is_known:
        return "unknown"
    if grown.grown_low > limit:
        return "beyond"
    return "at" if grown.grown_high > limit else "within"


def _remarks(p: Produced) -> list[str]:
    estimate = p.estimate
    d = estimate.difference
    out = [*p.remarks]
    if p.is_proposed:
        out.append(
            f"The stated constants differ from what {len(p.runs)} run(s) show by more than chance (probability "
            f"{d.chance:.2g}): proposed, and written with --apply only"
        )
    elif d.is_significant:
        out.append(
            "The constants found differ from the stated ones, but predict stretches held out no better: nothing is "
            "proposed"
        )
    else:
        out.append(
            f"The runs do not contradict the stated constants (probability {d.chance:.2g}, called a difference below "
            f"{SIGNIFICANT:g}): nothing is proposed"
        )
    for condition in estimate.conditions:
        if not condition.is_enough:
            out.append(
                f"Not told apart (condition index {condition.index:.0f}): {', '.join(condition.alike)}; what is not "
                "freed keeps the value of the cell file. Runs with other feeds and widths tell them apart"
            )
            break
    out += _drift_remarks(p, p.drift)
    return out


_TEXT = {
    Kind.NEW_EDGE: "a new edge",
    Kind.CHIPPED: "a chipped edge",
    Kind.LOST_TOOTH: "a lost tooth",
    Kind.MATERIAL: "another material or blank from there on",
    Kind.PASSING: "another material or blank for these runs alone",
}


def _event_remark(p: Produced, event: NamedEvents) -> str:
    """Sentence on an event: where, how large, what it may be, and what follows."""
    run = p.runs[event.at].facts["run"]
    first = f"The force {'rises' if event.size > 0.0 else 'falls'} by {abs(100.0 * event.size):.1f} % at {run}"
    if event.until:
        first += f" and comes back at {p.runs[event.until].facts['run']}"
    may = ", ".join(f"{_TEXT[kind]} {100.0 * share:.0f} %" for kind, share in event.kinds if share > 0.02)
    odds = f"{event.odds:.2g}" if event.odds < 1e6 else "1e6 and more"
    then = ""
    if event.kind is Kind.NEW_EDGE:
        then = "; the growth is counted anew from there on. State it with --set new_tool=true"
    elif event.size > 0.0 and not event.until:
        then = "; it is counted as growth of the present edge. Look at the edge"
    elif event.kind is Kind.LOST_TOOTH:
        then = "; look at the tool"
    elif not event.until:
        then = "; it is not counted as growth. Look at the tool: the force alone does not tell these apart"
    return f"{first} (odds against none {odds} to 1): {may}{then}"


def _drift_remarks(p: Produced, grown: ForceDrift) -> list[str]:
    limit = float(p.options["wear_limit"])
    out = [_event_remark(p, event) for event in grown.events]
    if not grown.is_known:
        return [*out, "Wear is not known: it takes two runs or more of one edge"]
    size = f"{100 * grown.grown:.1f} % ({100 * grown.grown_low:.1f} to {100 * grown.grown_high:.1f})"
    since = f"the force of the present edge has grown by {size} since its first run"
    word = wear_word(p)
    if word == "beyond":
        out.append(f"Worn: {since}, beyond the limit of {100 * limit:g} %")
    elif word == "at":
        out.append(f"Perhaps worn: {since}, and the limit is {100 * limit:g} %; more runs narrow it")
    else:
        out.append(f"{since[0].upper()}{since[1:]}, within the limit of {100 * limit:g} %")
    if grown.is_significant and grown.slope > 0.0 and word != "beyond":
        ends = [grown.length_to(limit, which) for which in ("early", "middle", "late")]
        late = "never" if math.isinf(ends[2]) else f"{ends[2]:.1f}"
        out.append(
            f"The limit is reached after {ends[1]:.1f} m of cut more ({ends[0]:.1f} to {late} m), if the force goes on "
            f"growing as at the last run ({grown.shape}, probability {grown.shape_chance:.2f})"
        )
    return out


def _pictures(p: Produced) -> tuple[Picture, ...]:
    grown, s = p.drift, np.array([f.factor for f in p.factors])
    sigma = np.array([f.sigma for f in p.factors])
    curves: list[Curve] = []
    for e in range(int(grown.edge[-1]) + 1):
        mine = grown.edge == e
        x: Float = grown.before_m[mine]
        curves.append(Curve(f"edge {e + 1}", x, s[mine]))
        for sign, name in ((2.0, "+"), (-2.0, "-")):
            curves.append(Curve(f"edge {e + 1} {name} 2 standard deviations", x, s[mine] + sign * sigma[mine]))
        if grown.is_known:
            curves.append(Curve(f"edge {e + 1}, expected", x, grown.factor[mine], line=True))
    limit = np.array([0.0, float(np.max(grown.before_m))])
    first = int(np.argmax(grown.edge == grown.edge[-1]))
    worn = float(grown.factor[first]) * (1.0 + float(p.options["wear_limit"]))
    curves.append(Curve("limit of wear", limit, np.full(2, worn), line=True))
    block, fit = p.estimate.block, p.estimate.fit
    rest = fit.residuals[0] * block.sigma / np.linalg.norm(block.pieces.force, axis=1, keepdims=True)
    number = np.arange(1, len(block.pieces) + 1, dtype=np.float64)
    return (
        Picture(
            "Force of the tool over its life", "length cut by the edge, m", "measured by expected force",
            tuple(curves), "Expected by one law for all runs; the height of the work in each run is found beside it.",
        ),
        Picture(
            "What the fit leaves", "stretch, in order", "measured less predicted, % of the force",
            tuple(Curve(name, number, 100.0 * rest[:, i]) for i, name in enumerate(("along", "left", "up"))),
        ),
    )  # fmt: skip


def new_edge_word(probability: float, stated: bool) -> str:
    """Return how a run came to be the first of an edge: ``stated``, ``seen``, ``perhaps``; empty where it is not."""
    if stated:
        return "stated"
    return "seen" if probability > SURE else "perhaps" if probability > 0.0 else ""


def run_rows(p: Produced) -> list[dict[str, Any]]:
    """The table over runs: length, volume, factor with its standard deviation, delay."""
    rows = []
    events = {e.at: f"{100.0 * e.size:+.1f} % {e.kind.value}" for e in p.drift.events}
    total = volume = 0.0
    for i, kept in enumerate(p.runs):
        if i and p.drift.edge[i] != p.drift.edge[i - 1]:
            total = volume = 0.0
        total += kept.facts["cut_mm"] * MM
        volume += kept.facts["removed_cm3"]
        rows.append(
            {
                **{key: kept.facts[key] for key in ("run", "plan", "stretches", "cut_mm", "removed_cm3", "sha256")},
                "edge": int(p.drift.edge[i]) + 1,
                "edge_cut_m": round(total, 4),
                "edge_removed_cm3": round(volume, 3),
                "factor": round(p.factors[i].factor, 5),
                "factor_sigma": round(p.factors[i].sigma, 5),
                "delay_ms": kept.facts.get("delay_ms"),
                "delay_sigma_ms": kept.facts.get("delay_sigma_ms"),
                "new_edge": new_edge_word(p.drift.seen.get(i, 0.0), bool(kept.facts["new_tool"])),
                "event": events.get(i, ""),
            }
        )
    return rows


def _place(runs: Sequence[KeptRun], row: int) -> str:
    """Name the run and the row of its plan that a row of the fit comes from."""
    first = 0
    for kept in runs:
        if row < first + len(kept.stretches):
            return f"{kept.facts['run']}: row {int(kept.stretches.row[row - first])} of the plan"
        first += len(kept.stretches)
    return f"stretch {row + 1}"


def _drift(p: Produced) -> dict[str, Any]:
    grown = p.drift
    return {
        **plain(grown, "known=is_known significant=is_significant scatter:5 shape shape_chance:4"),
        "expected": [round(float(v), 5) for v in grown.factor],
        "level_percent": 100.0 * LEVEL,
        "events": [
            {
                "run": p.runs[e.at].facts["run"],
                "until": p.runs[e.until].facts["run"] if e.until else None,
                "size_percent": round(100.0 * e.size, 2),
                "odds": float(f"{e.odds:.3g}"),
                "kinds": {kind.value: round(share, 4) for kind, share in e.kinds},
            }
            for e in grown.events
        ],
    }


def result_of(p: Produced, identification: Identification, date: str) -> dict[str, Any]:
    """Everything that was estimate, as plain values."""
    estimate = p.estimate
    return {
        "recipe": "production",
        "title": p.title,
        "date": date,
        "cell": p.cell.name,
        "cell_file": p.cell.path.name,
        "tool": p.tool,
        "material": p.material,
        "data": [
            {
                "manifest": kept.facts["run"],
                "name": kept.facts["run"],
                "kind": "run log",
                "rows": len(kept.stretches),
                "groups": len(np.unique(kept.stretches.cut)),
                "sha256": kept.facts["sha256"],
            }
            for kept in p.runs
        ],
        "holdout_data": [],
        "holdout": "whole runs in turn" if len(p.runs) >= 3 else "parts of the runs in turn",
        "headline": figure_rows(identification.headline),
        "figures": figure_rows(identification.figures),
        "fits": {name: fit_table(fit, lambda _, row: _place(p.runs, row)) for name, fit in identification.fits.items()},
        "constants": estimate.level,
        "conditions": [
            {"constants": c.level, "index": round(c.index, 2), "alike": list(c.alike)} for c in estimate.conditions
        ],
        "difference": {
            **plain(estimate.difference, "chance chance_in_prior chi_square=statistic:3 constants=count"),
        },
        "proposed": p.is_proposed,
        "runs": run_rows(p),
        "wear": wear_word(p),
        "drift": _drift(p),
        "remarks": list(identification.remarks),
        "settings": dict(p.options),
        "versions": {
            "counterflex": __version__,
            "Python": platform.python_version(),
            **{library: importlib.metadata.version(library) for library in ("numpy", "scipy", "numba")},
        },
    }
