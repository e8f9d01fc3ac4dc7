"""The job ``evaluate``: judge machined programs against the original one; summary and page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from counterflex.app.compensation.headline import error_rows
from counterflex.app.proof.judge import ProgramComparison
from counterflex.core import atomic
from counterflex.core.result import Parts, ShownTable, Summary, Warned
from counterflex.evaluate.summary import seed_rows, table_rows
from counterflex.files.summary_file import write_summary
from counterflex.report.glossary import line_of


class Evaluated(Summary):
    """Deviations of machined programs."""

    def _shown(self) -> Parts:
        yield ShownTable(
            f"{self['program']}: deviation from the nominal path and part, mm",
            ["figure", "nominal", "compensated", "reduction"],
            table_rows(self),
            "path, entry, exit: across the feed while cutting. surface: positive = material left. docs/summary.md",
        )


class ProofSummary(Evaluated):
    """A program proven on simulated cells."""

    def _shown(self) -> Parts:
        title = self.line("{program} on {cell}: expected of all such cells")
        yield ShownTable(title, ["", "value", ""], error_rows(self["prediction"]))
        yield from super()._shown()
        yield ShownTable(
            f"Per truth seed of the family {self.get('family', 'mild')} "
            "(catalogue: the planner knows what is published; exact: it knows the truth's constants)",
            ["seed", "truth", "p99.7 nominal mm", "p99.7 compensated mm", "p99.7 remains", "max remains"],
            seed_rows(self),
        )
        peaks = [self["prediction"][f"peak_{name}"] for name in ("force_n", "axial_depth_mm", "deflection_um")]
        force, depth, deflection = peaks
        yield (
            f"predicted peak force {force['value']:.0f} N in {line_of(force)}, axial depth {depth['value']:.1f} mm in "
            f"{line_of(depth)}, deflection {deflection['value'] / 1000:.2f} mm in {line_of(deflection)} with the axes "
            f"at {[round(v, 1) for v in deflection['joints_deg']]} deg"
        )
        yield from map(Warned, self.get("written", {}).get("warnings", ()))


def run(folders: Sequence[str | Path], out: str | Path | None) -> dict[str, Any]:
    """Do the job on files.

    Writes ``summary.json`` and, for two runs, ``report.html`` into ``out``, where it is given.
    """
    comparison = ProgramComparison.of(folders)
    if out is not None:
        from counterflex.app.proof.report import comparison_page
        from counterflex.report.page import write_page

        with atomic.atomic_folder(out) as staging:
            write_summary(staging / "summary.json", comparison.summary)
            if len(comparison.judged) == 2:
                write_page(comparison_page(comparison), staging / "report.html")
    return comparison.summary
