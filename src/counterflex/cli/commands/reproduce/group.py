"""The group ``reproduce``: figures of four papers, and their experiments on the simulated cell."""

from __future__ import annotations

from collections.abc import Callable

import typer

from counterflex.cli.commands.reproduce import experiments, papers

_reproduce = typer.Typer(
    no_args_is_help=True,
    help="Figures of four papers beside ours, and their experiments on the simulated cell over its real protocols.",
)


def register(app: typer.Typer) -> None:
    """Add these commands."""
    commands: dict[str, Callable[..., None]] = {
        **{name: papers.of_paper(name) for name in papers.ABOUT},
        "all": papers.every_paper,
        "groove": experiments.groove,
        "paths": experiments.paths,
        "holder": experiments.holder,
        "online": experiments.online,
    }
    for name, command in commands.items():
        _reproduce.command(name)(command)
    _reproduce.callback()(_group)
    app.add_typer(_reproduce, name="reproduce")


def _group() -> None:
    """Figures of four papers beside ours, and their experiments on the simulated cell over its real protocols."""
