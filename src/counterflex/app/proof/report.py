"""Fill the report page from what the jobs found."""

from __future__ import annotations

import datetime
import importlib.metadata
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from counterflex import __version__
from counterflex.app.compensation.cell_facts import assumptions, drawing, robot_name
from counterflex.app.compensation.headline import headline_of
from counterflex.app.compensation.next_steps import after_proof
from counterflex.app.compensation.prediction import figures
from counterflex.app.inputs import setting_of
from counterflex.app.proof import simulate
from counterflex.app.proof.judge import JudgedRun, ProgramComparison, ProofResult, features
from counterflex.app.proof.truth import truth_of
from counterflex.app.unknown_stiffness import unknown_stiffness
from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.evaluate.error_budget import BudgetLine, error_budget
from counterflex.evaluate.path_deviation import PathDeviation
from counterflex.files.cell.cell import Cell
from counterflex.plan.compensate import plan as make_plan
from counterflex.plan.plan import Plan
from counterflex.report.data import ErrorCurve, Fact, ReportData, ReportedDifference, VariantData
from counterflex.report.page import report_page
from counterflex.robot.elasticity import compliance
from counterflex.twin.truth.perturb import differences

_LIBRARIES = ("numpy", "scipy", "numba", "mujoco", "polars", "plotly")


def proof_page(proof: ProofResult) -> str:
    """The page of a proven compensation, as HTML."""
    judged = {name: proof.judged[proof.first_seed, name] for name in ("nominal", "compensated")}
    comparison = ProgramComparison(proof.reference, judged, proof.truths[proof.first_seed], proof.summary)
    return _page(comparison, proof.plan, proof.summary["prediction"], proof.timing)


def comparison_page(comparison: ProgramComparison) -> str:
    """The page of two machined programs, as HTML; what the model says about the first is planned anew."""
    job, cell = comparison.reference.job, comparison.reference.cell
    setting = setting_of(
        cell, chain=cell.chain, part_may_be_held=True
    )  # what was machined is judged, also where the stiffness is unknown
    plan = make_plan(job.path, job.line_of_motion, cell.stock(), setting, predict=False)
    return _page(comparison, plan, figures(plan), {})


def _page(comparison: ProgramComparison, plan: Plan, identified: Mapping[str, Any], timing: Mapping[str, float]) -> str:
    cell, truth = comparison.reference.cell, comparison.truth
    before, after = comparison.judged["nominal"], comparison.judged["compensated"]
    measured = features(comparison.reference, comparison.judged)
    return report_page(
        ReportData(
            title=Path(comparison.reference.job.program.name).name,
            subtitle=f"{comparison.summary['program']}, machined before and after on a simulated {robot_name(cell)}",
            created=datetime.datetime.now(tz=datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
            summary=comparison.summary,
            nominal=_variant(before),
            compensated=_variant(after),
            facts=_facts(comparison, identified),
            nominal_surface=comparison.reference.surface,
            engagement_label="axial depth, mm",
            engagement_scale=1.0 / MM,
            features=measured,
            drawing=drawing(plan, cell),
            next_steps=after_proof(measured, comparison.summary),
            expected=headline_of(identified) if "predicted_compensated" in identified else None,
            budget=budget(plan, before.deviation, cell),
            assumptions=assumptions(cell, plan),
            differences=tuple(
                ReportedDifference(
                    f"{row.group}: {row.name}",
                    f"{row.known:.4g} {row.unit}",
                    f"{row.true:.4g} {row.unit}",
                    f"{row.true - row.known:+.3g}",
                )
                for row in differences(truth_of(cell, None), truth)
            ),
            timing=tuple(Fact(name, f"{value:.1f} s") for name, value in timing.items()),
            versions={
                "counterflex": __version__,
                "Python": platform.python_version(),
                **{name: importlib.metadata.version(name) for name in _LIBRARIES},
            },
            notes=(
                "The part was machined on a simulated cell with friction, play, drives, gravity and its own cutting "
                "process. The planner knew what the cell file states; below is how the simulated cell differs from it.",
                *(f"{text[0].upper()}{text[1:]}." for text in unknown_stiffness(cell)),
            ),
        )
    )


def _variant(item: JudgedRun) -> VariantData:
    force: Float = np.linalg.norm(item.run.force_part, axis=1)
    return VariantData(item.deviation, item.surface, ErrorCurve(item.run.time_s, force))


def _facts(comparison: ProgramComparison, identified: Mapping[str, Any]) -> tuple[Fact, ...]:
    cell, truth = comparison.reference.cell, comparison.truth
    numbers = simulate.tools_of(comparison.reference.job.path)
    tools = [table for table in cell.tables.tools if table.number in numbers]
    return (
        Fact("Part", str(comparison.summary["program"]), "", f"{identified['removed_mm3'] / 1000:.1f} cm³ removed"),
        Fact("Robot", robot_name(cell)),
        Fact("Cell", cell.name),
        *(Fact("Tool", tool.name or f"D{tool.diameter_mm:g}", "", f"{tool.flutes} flutes") for tool in tools),
        Fact("Material", cell.material.name or str(cell.material.catalog)),
        Fact(
            "Peak force",
            f"{identified['peak_force_n']['value']:.0f} N predicted",
            "",
            f"line {identified['peak_force_n']['line']}, depth {identified['peak_axial_depth_mm']['value']:.1f} mm",
        ),
        Fact(
            "Peak deflection",
            f"{identified['peak_deflection_um']['value'] / 1000:.2f} mm predicted",
            "",
            f"at joints {', '.join(f'{v:.0f}' for v in identified['peak_deflection_um']['joints_deg'])} deg",
        ),
        Fact(
            "Simulated cell",
            truth.name,
            "",
            "as the cell file says" if truth.seed is None else f"truth seed {truth.seed}, family {truth.family}",
        ),
    )


def budget(plan: Plan, deviation: PathDeviation, cell: Cell) -> tuple[BudgetLine, ...]:
    """Return what the model says causes the deviation that was met: each elastic segment, own weight, and the rest."""
    cutting = deviation.cutting
    if not np.any(deviation.across[cutting]):
        return ()
    place = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(plan.path.p_part_tcp, axis=0), axis=1))])
    at = deviation.length_m[cutting]
    direction = deviation.feed_direction[cutting]
    relative = setting_of(cell, chain=cell.chain, part_may_be_held=True).relative_motion(plan.path)
    parts = compliance.shares(cell.chain, plan.q, relative.load(plan.w_tcp_part))
    contributions = {
        name: _across(at, place, direction, relative.displacement(parts[:, i]))
        for i, name in enumerate(cell.chain.names)
        if np.any(parts[:, i] != 0.0)
    }
    contributions["own weight"] = _across(at, place, direction, plan.sag_part)
    if np.any(plan.play_part != 0.0):
        contributions["play and friction"] = _across(at, place, direction, plan.play_part)
    return error_budget(deviation.across[cutting], contributions)


def _across(at: Float, place: Float, direction: Float, values: Float) -> Float:
    """Displacements at places of the path, without their part along the feed."""
    there = np.stack([np.interp(at, place, values[:, k]) for k in range(3)], axis=1)
    out: Float = there - np.sum(there * direction, axis=1, keepdims=True) * direction
    return out
