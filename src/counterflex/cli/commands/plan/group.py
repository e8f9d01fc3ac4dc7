"""The group ``plan``: what is chosen before a program is compensated."""

from __future__ import annotations

import typer

from counterflex.cli.commands.plan import entry, placement, posture, stability, strategy, trochoid, working_space

_plan = typer.Typer(
    no_args_is_help=True,
    help="Choose what leaves little to compensate: how the robot holds the tool, how the cutter moves.",
)


def register(app: typer.Typer) -> None:
    """Add these commands."""
    placement.register(_plan)
    working_space.register(_plan)
    posture.register(_plan)
    strategy.register(_plan)
    trochoid.register(_plan)
    entry.register(_plan)
    stability.register(_plan)
    _plan.callback()(_group)
    app.add_typer(_plan, name="plan")


def _group() -> None:
    """Choose what leaves little to compensate: how the robot holds the tool, how the cutter moves."""
