"""Records of options: what the parser sees of them, and what the command gets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer
from typer.testing import CliRunner

from counterflex.cli.arguments import between, option
from counterflex.cli.option_records import with_records


@dataclass(frozen=True)
class Cut:
    ae_mm: Annotated[float, option("--ae-mm", "Radial width.", between(0.1, 9.0))]
    up: Annotated[bool, option("--up/--down", "Milling.")] = True


@with_records
def job(
    first: Annotated[int, option("--first", "One.")] = 1,
    *,
    cut: Cut,
    last: Annotated[int, option("--last", "Two.")] = 2,
) -> None:
    """Print what came."""
    typer.echo(f"{first} {cut} {last}")


def _answer(*words: str) -> tuple[int, str]:
    app = typer.Typer(rich_markup_mode=None)
    app.command()(job)
    result = CliRunner().invoke(app, list(words))
    return result.exit_code, result.output


def test_the_fields_are_options_in_their_order() -> None:
    status, text = _answer("--help")
    names = ["--first", "--ae-mm", "--up", "--last"]
    assert status == 0
    assert sorted(names, key=text.index) == names


def test_the_command_gets_the_record() -> None:
    assert _answer("--ae-mm", "2.5", "--down", "--last", "7") == (0, "1 Cut(ae_mm=2.5, up=False) 7\n")


def test_a_field_without_default_is_required_and_its_check_runs() -> None:
    assert _answer()[0] == 2
    assert _answer("--ae-mm", "0.01")[0] != 0
