"""The group ``reproduce``: figures of four papers, and their experiments on the simulated cell."""

from __future__ import annotations

import typer

from counterflex.cli.commands.reproduce import experiments, papers

_reproduce = typer.Typer(
    no_args_is_help=True,
    help="Figures of four papers beside ours, and their experiments on the simulated cell over its real protocols.",
)


def register(app: typer.Typer) -> None:
    """Add these commands."""
    for name, command in (
        ("denkena2015", papers.denkena2015),
        ("haehn2020", papers.haehn2020),
        ("berger2013", papers.berger2013),
        ("mandiola2023", papers.mandiola2023),
        ("all", papers.every_paper),
        ("groove", experiments.groove),
        ("paths", experiments.paths),
        ("holder", experiments.holder),
        ("online", experiments.online),
    ):
        _reproduce.command(name)(command)
    _reproduce.callback()(_group)
    app.add_typer(_reproduce, name="reproduce")


def _group() -> None:
    """Figures of four papers beside ours, and their experiments on the simulated cell over its real protocols."""
