"""Measure on the simulated cell what a proposal asks for, over files only.

A proposal goes in, a dataset comes out, as a laboratory would hand it over: a CSV file in shop units and its manifest.
Nothing of the truth gets into it but readings with their noise.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from counterflex.app.identification.controller_angles import model_columns, shown_channels
from counterflex.app.proof.simulate import check_same_cell
from counterflex.core.progress import Progress, silent
from counterflex.files.cell.cell import read_cell
from counterflex.files.dataset.proposal import read_proposal
from counterflex.files.dataset.writer import write_dataset
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.laboratory.measurements import measurement
from counterflex.twin.truth.file import read_truth


def measure(
    proposal_file: str | Path,
    cell_file: str | Path,
    truth_file: str | Path,
    out: str | Path,
    *,
    seed: int = 0,
    session: str | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Measure a proposal on the simulated cell and write the dataset.

    Args:
        proposal_file: What ``identify RECIPE --propose`` wrote.
        cell_file: Cell that the proposal was made for; checked against the truth, nothing else.
        out: Folder for ``RECIPE.csv`` and ``RECIPE.toml``.
        seed: Of the laboratory: where its instruments truly stand, and their noise.
        session: Measuring again in another session gives other noise; None is the name of the proposal's folder.

    Returns:
        ``recipe``, ``kind``, number of ``rows`` and ``channels``, path of the ``manifest``.

    Raises:
        FileFormatError: A file cannot be used, or the truth belongs to another cell.
        InputError: The laboratory cannot measure this kind, or the proposal lacks a column.
        SimulationError: The simulated cell left its physical range.
    """
    proposal = read_proposal(proposal_file)
    truth = read_truth(truth_file)
    cell = read_cell(cell_file)
    check_same_cell(cell, truth, str(truth_file))
    columns = model_columns(proposal.columns, cell.robot.axes)
    equipment = replace(
        laboratory(seed), session=Path(proposal_file).resolve().parent.name if session is None else session
    )
    measured = measurement(proposal.kind)(truth, equipment, columns, proposal.settings, progress)
    manifest = write_dataset(
        out,
        proposal.recipe,
        proposal.kind,
        shown_channels(measured.channels, cell.robot.axes),
        measured.sigma,
        group=measured.group,
        settings=measured.settings,
        sensors=measured.sensors,
    )
    return {
        "recipe": proposal.recipe,
        "kind": proposal.kind,
        "rows": len(measured.group),
        "channels": sorted(measured.channels),
        "manifest": str(manifest),
    }
