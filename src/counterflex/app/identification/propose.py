"""The job ``identify --propose``: what to measure, and how well the parameters will be known from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from counterflex.app.identification.cell_model import Setting, model_of, read_settings, shown_columns, starting_cell
from counterflex.core import atomic
from counterflex.core.errors import InputError
from counterflex.core.result import Parts, Summary
from counterflex.files.dataset.proposal import PROPOSAL, ROWS, form_names, write_proposal
from counterflex.files.shop_unit import shop
from counterflex.identify.data.channels import CHANNELS_OF
from counterflex.identify.recipe import Proposal, Recipe
from counterflex.identify.recipes import RECIPES


class ProposalSummary(Summary):
    """Measurements that are proposed."""

    def _shown(self) -> Parts:
        if self["expected"]:
            columns = "parameter=name | standard deviation=sigma:D3 | unit"
            yield self.rows("expected", "Expected from {rows} measurements", columns)
        yield from self.each("remarks", "note: {}")


def propose(
    name: str, count: int, cell: str | Path, out: str | Path, *, settings: Mapping[str, Setting], seed: int = 0
) -> Path:
    """Write a proposal.

    ``out``: Folder for ``proposal.csv``, ``proposal.toml`` and, where the kind of data has one, a form to fill.
    ``settings``: Of the recipe, as text or as values; ``seed`` is allowed. Returns path of ``proposal.toml``.
    """
    _write(name, count, Path(cell), Path(out), settings, seed)
    return Path(out) / PROPOSAL


def run(
    name: str, count: int, cell: str | Path, out: str | Path, *, settings: Mapping[str, Setting], seed: int = 0
) -> ProposalSummary:
    """Write a proposal and say what is in it; arguments as for :func:`propose`.

    Returns ``recipe``, ``kind``, ``rows``, ``expected`` (name, unit, standard deviation), ``remarks``, ``files``.
    """
    proposal = _write(name, count, Path(cell), Path(out), settings, seed)
    rows = []
    for key, sigma in proposal.expected.items():
        unit, factor = shop(proposal.units.get(key, "SI"))
        rows.append({"name": key, "unit": unit, "sigma": float(f"{sigma / factor:.6g}")})
    form = list(form_names(proposal.recipe)) if proposal.kind in CHANNELS_OF else []
    answer = {
        "recipe": proposal.recipe,
        "kind": proposal.kind,
        "rows": len(next(iter(proposal.columns.values()))),
        "expected": rows,
        "remarks": list(proposal.remarks),
        "files": [ROWS, PROPOSAL, *proposal.files, *form],
    }
    return ProposalSummary(answer)


def _write(name: str, count: int, cell: Path, out: Path, settings: Mapping[str, Setting], seed: int) -> Proposal:
    if count < 1:
        raise InputError("the number of measurements is below 1", value=count)
    recipe: Recipe = RECIPES[name]
    chosen = read_settings(recipe, settings, seed)
    known, chosen, remark = starting_cell(cell, recipe, chosen)
    model = model_of(known)
    with atomic.atomic_folder(out) as staging:
        proposal = recipe.propose(model, count, chosen)
        proposal = replace(proposal, remarks=(*proposal.remarks, *([remark] if remark else [])))
        write_proposal(staging, replace(proposal, columns=shown_columns(proposal.columns, known.robot.axes)))
    return proposal
