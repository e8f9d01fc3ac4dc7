"""Reproduce how a plan fails and what corrects it: wrong plans by ways of correcting, over sockets in lockstep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Final

from counterflex.app.long_jobs.task import Task
from counterflex.core.errors import InputError
from counterflex_lab.reproduce import online_case, online_report
from counterflex_lab.reproduce.experiment import PLAN_FILE, PLANNED, Experiment, Run, mill, plan_task
from counterflex_lab.reproduce.online_case import WAYS
from counterflex_lab.reproduce.wrong_plans import WRONG

QUICK_ROWS: Final = ("as planned", "worn tool")


class WrongPlans(Experiment):
    """A groove whose plan is wrong; quick: a right plan and a worn tool only.

    Args:
        out: As for all.
        rows: Of :data:`~counterflex_lab.reproduce.wrong_plans.WRONG`; the right plan is always among them.
        given: As for all.

    Raises:
        InputError: An unknown row.
    """

    name = "online"
    recipes: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "catalogue": ("tracker-frame", "payload"),
        "identified": (
            "tracker-frame", "stiffness", "kinematics", "payload", "play", "servo", "timing", "cutting",
        ),
    }  # fmt: skip
    identifying = (1.0, 2.0)

    def __init__(self, out: str | Path, *, rows: Sequence[str] = tuple(WRONG), **given: Any) -> None:
        super().__init__(out, **given)
        for row in rows:
            if row not in WRONG:
                raise InputError("no such row", value=row, limit=", ".join(WRONG))
        right = next(iter(WRONG))
        self.rows = QUICK_ROWS if self.quick else tuple(row for row in WRONG if row in rows or row == right)

    def catalogue(self) -> Path:
        """Write program and cell before any measurement."""
        return online_case.catalogue_cell(self.folder)

    def tasks(self) -> list[Task]:
        """Every row on every truth; the plan is that of the cell as it was identified."""
        out, original = [], self.folder / online_case.PROGRAM
        for seed in self.seeds:
            base, planned = self.folder / f"seed-{seed}", f"{seed}: plan"
            places = {row: base / row.replace(" ", "-") for row in self.rows}
            for row, place in places.items():
                catalogue = self.folder / online_case.CATALOGUE
                online_case.write_case(place, row, self.cell(seed), self.truth(seed), catalogue, seed)
            out.append(plan_task(planned, base / PLANNED, original, places[next(iter(WRONG))] / "cell.toml"))
            for row, place in places.items():
                for name, way in WAYS.items():
                    run = Run(
                        _task(seed, row, name),
                        place / name,
                        place / online_case.cell_name(name),
                        place / online_case.TRUTH,
                        original,
                        base / PLANNED / PLAN_FILE if way.compensated else None,  # it is for its own program's feeds
                        way,
                        seed,
                        place / online_case.TOUCHED if WRONG[row].since_touched else None,
                    )
                    out.append(run.task(planned, mill))
        return out

    def summary(self, results: Mapping[str, Any]) -> dict[str, Any]:
        """Rows by truth and what is wrong, figures over truths, goals."""
        table = [
            {
                "seed": seed,
                "row": row,
                "truth_level": self.level,
                "variants": {way: results[_task(seed, row, way)] for way in WAYS},
            }
            for seed in self.seeds
            for row in self.rows
        ]
        total = online_report.over_seeds(table)
        return {"family": self.family.name, "seeds": table, "rows": total, "goals": online_report.goals(total)}

    def page(self, summary: Mapping[str, Any]) -> str:
        """Figures of the summary."""
        return online_report.page(summary)


def _task(seed: int, row: str, way: str) -> str:
    return f"{seed}: {row}: {way}"
