"""The option that describes a trial: a file, a scenario that comes with counterflex, single keys."""

from __future__ import annotations

from typing import Annotated

from counterflex.cli.arguments import address, option

Layers = Annotated[
    list[str] | None,
    option(
        "--scenario -s",
        "What is set once for a trial, repeatable, the later one wins: a file, a name out of `twin scenarios`, or "
        "TABLE.KEY=VALUE.",
        metavar="SCENARIO",
    ),
]


def host_port(text: str | None) -> tuple[str, int] | None:
    """Host and port of an address of the scenario, or None."""
    return None if text is None else address(text, "--scenario")
