"""The group ``reproduce``: figures of four papers, and their experiments on the simulated cell."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import typer

from counterflex_lab.commands.reproduce import experiments, papers

_reproduce = typer.Typer(
    no_args_is_help=True,
    help="Figures of four papers beside ours, and their experiments on the simulated cell over its real protocols.",
)
_COMMANDS: Final[dict[str, Callable[..., None]]] = {
    **{name: papers.of_paper(name) for name in papers.ABOUT},
    "all": papers.every_paper,
    "groove": experiments.groove,
    "paths": experiments.paths,
    "holder": experiments.holder,
    "online": experiments.online,
}
for _name, _command in _COMMANDS.items():
    _reproduce.command(_name)(_command)


def register(app: typer.Typer) -> None:
    """Add ``counterflex reproduce``: published figures and experiments again, each beside ours."""
    app.add_typer(_reproduce, name="reproduce")


@_reproduce.callback()
def _group() -> None:
    """Figures of four papers beside ours, and their experiments on the simulated cell over its real protocols."""
