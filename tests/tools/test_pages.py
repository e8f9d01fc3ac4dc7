"""Links and pictures of the pages lead somewhere, and source files that they name exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import typer

from counterflex.cli.main import whole

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    ROOT / "SECURITY.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
_LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")
_SOURCE = re.compile(r"`((?:[a-z_]+/)+[a-z_0-9]+\.(?:py|toml|ngc|csv|sh|txt))`")
_WRITTEN = re.compile(r"--out ([a-z_0-9-]+)")
_BASES = (ROOT, ROOT / "src" / "counterflex", ROOT / "lab", ROOT / "docs")


def _pages() -> list[Path]:
    return [page for page in PAGES if "_build" not in page.parts]


@pytest.mark.parametrize("page", _pages(), ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in _LINK.findall(page.read_text(encoding="utf-8")):
        if not target.startswith(("http://", "https://")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


@pytest.mark.parametrize("page", _pages(), ids=lambda page: page.name)
def test_named_sources_exist(page: Path) -> None:
    """But for those in folders that a command of the page writes."""
    text = page.read_text(encoding="utf-8")
    written = set(_WRITTEN.findall(text))
    for name in _SOURCE.findall(text):
        there = name.split("/")[0] in written or any((base / name).exists() for base in _BASES)
        assert there, f"{page.name}: {name}"


def _commands(group: typer.Typer, before: str = "") -> set[str]:
    found = {f"{before}{info.name or getattr(info.callback, '__name__', '')}" for info in group.registered_commands}
    for inner in group.registered_groups:
        assert inner.typer_instance is not None
        found |= _commands(inner.typer_instance, f"{before}{inner.name} ")
    return found


def test_every_command_has_a_row() -> None:
    text = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    commands = _commands(whole())
    assert {"compensate", "cell check"} <= commands
    assert {name for name in commands if f"| `{name}` |" not in text} == set()
