"""Commands of other packages: listed and run where the package is installed, named where the laboratory is not."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable

import pytest

from counterflex.cli.main import LAB, parsed
from counterflex.core import registry
from counterflex.core.errors import InputError

HELLO = """
import typer

def register(app):
    @app.command()
    def hello(name: str = "robot") -> None:
        '''Greet a robot.'''
        typer.echo(f"hello {name}")
"""
Put = Callable[[str, str, str], None]


def test_a_command_of_another_package_runs_and_is_listed(package: Put, capsys: pytest.CaptureFixture[str]) -> None:
    package("counterflex.commands", "hello = added:register", HELLO)
    parsed(["hello", "--name", "KR 300"])
    assert capsys.readouterr().out == "hello KR 300\n"
    parsed(["--help"])
    listed = capsys.readouterr().out
    assert "\nOther packages:\n  hello  Greet a robot." in listed
    assert listed.index("Tools:") < listed.index("  reproduce") < listed.index("Other packages:")


def test_a_broken_package_stops_its_own_command_alone(package: Put, capsys: pytest.CaptureFixture[str]) -> None:
    package("counterflex.commands", "hello = added:register", "raise RuntimeError('torn')")
    with pytest.raises(InputError, match=r"added 1\.0: entry point hello.*torn"):
        parsed(["hello"])
    parsed(["--help"])
    assert "hello" not in capsys.readouterr().out


def test_a_command_of_ours_is_not_taken_over(package: Put, capsys: pytest.CaptureFixture[str]) -> None:
    package("counterflex.commands", "robots = added:register", HELLO)
    parsed(["--help"])
    listed = capsys.readouterr().out
    assert listed.count("\n  robots ") == 1
    assert "Greet" not in listed


@pytest.mark.parametrize("name", LAB)
def test_without_the_laboratory_one_line_says_where_it_is(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_outside", lambda _group: {})
    with pytest.raises(InputError) as told:
        parsed([name, "--out", "x"])
    said = str(told.value)
    assert "counterflex-lab, which is not installed" in said
    assert said.endswith("python -m pip install -e lab")
    assert "\n" not in said


def test_without_the_laboratory_help_lists_what_is_there(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(registry, "_outside", lambda _group: {})
    parsed(["--help"])
    listed = capsys.readouterr().out
    assert "\n  extensions " in listed
    assert not [name for name in LAB if f"\n  {name} " in listed]


def test_a_command_of_ours_imports_nothing_of_the_laboratory() -> None:
    script = (
        "import sys; from counterflex.cli.main import parsed; parsed(['robots', '--json']); "
        "print([n for n in sys.modules if n.startswith('counterflex_lab')], file=sys.stderr)"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert ended.stderr.strip() == "[]"
