"""The group ``plan``: what is chosen before a program is compensated."""

from __future__ import annotations

import typer

from counterflex.cli.commands.plan.entry import entry
from counterflex.cli.commands.plan.placement import placement
from counterflex.cli.commands.plan.posture import posture
from counterflex.cli.commands.plan.stability import stability
from counterflex.cli.commands.plan.strategy import strategy
from counterflex.cli.commands.plan.trochoid import trochoid
from counterflex.cli.commands.plan.working_space import working_space

plan = typer.Typer(
    no_args_is_help=True,
    help="Choose what leaves little to compensate: how the robot holds the tool, how the cutter moves.",
)


plan.command()(placement)
plan.command("map")(working_space)
for command in (posture, strategy, trochoid, entry, stability):
    plan.command()(command)
