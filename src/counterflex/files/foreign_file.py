"""Remedies for a file of counterflex that was given where another one is read."""

from __future__ import annotations

from typing import Final

_FORMATS: Final[dict[str, str]] = {
    "counterflex-cell": "This is a cell file, as --cell reads it",
    "counterflex-truth": "This is a truth file, as --truth reads it",
    "counterflex-scenario": "This is a scenario file, as --scenario reads it",
    "counterflex-dataset": "This is a manifest of measured data, as identify and dataset check read it",
    "counterflex-proposal": "This is a proposal, as twin measure reads it",
}


def of_format(name: object) -> str | None:
    """Return what a file of counterflex is by its key ``format``, and what reads it; None for an unknown format."""
    return _FORMATS.get(name) if isinstance(name, str) else None


def what_to_do(kind: str) -> str | None:
    """Return what to give instead, by the format that is wanted."""
    if kind == "counterflex-dataset":
        return (
            "Measured data are given by their manifest, a TOML file that names the data file and says what its columns "
            "are (docs/datasets.md); a workbook is saved as CSV first"
        )
    return f'Required is a TOML text file that begins with format = "{kind}"' if kind else None
