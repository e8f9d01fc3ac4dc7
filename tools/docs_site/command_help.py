"""The page of every command's help in the documentation, taken from the command line itself.

A Sphinx extension with one directive, ``command-help``: a section for each heading of ``counterflex --help``, in it
one for each command with the text that ``counterflex COMMAND --help`` prints.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import typer
from docutils import nodes
from sphinx.util.docutils import SphinxDirective

from counterflex.cli.main import PANELS, whole

WIDTH: Final = 88
"""Characters of a line: what a page shows without scrolling."""


def texts(heading: str) -> Iterator[tuple[str, str]]:
    """Name and help of every command below a heading.

    Args:
        heading: One of those of ``counterflex --help``.
    """
    command = typer.main.get_command(whole())
    top = _context(command, "counterflex", None)
    for name in PANELS[heading]:
        yield from _below(getattr(command, "commands")[name], name, top)  # noqa: B009  # typer's classes do not state it


def _below(command: Any, name: str, parent: Any) -> Iterator[tuple[str, str]]:
    context = _context(command, name.rsplit(" ", maxsplit=1)[-1], parent)
    inner = getattr(command, "commands", {})
    if not inner:
        yield name, command.get_help(context).strip()
    for word, item in inner.items():
        yield from _below(item, f"{name} {word}", context)


def _context(command: Any, word: str, parent: Any) -> Any:
    return command.context_class(command, info_name=word, parent=parent, terminal_width=WIDTH, max_content_width=WIDTH)


class _CommandHelp(SphinxDirective):  # type: ignore[misc]
    """``command-help``: the help of every command."""

    has_content = False

    def run(self) -> list[nodes.Node]:
        return [self._heading(heading) for heading in PANELS]

    def _heading(self, heading: str) -> nodes.Node:
        section = _section(f"help-{heading.lower()}", nodes.Text(heading))
        for name, text in texts(heading):
            one = _section(f"help-{name.replace(' ', '-')}", nodes.literal(name, name))
            one += nodes.literal_block(text, text, language="text")
            section += one
        return section


def _section(name: str, title: nodes.Node) -> nodes.section:
    section = nodes.section(ids=[name], names=[name])
    section += nodes.title("", "", title)
    return section


def setup(sphinx: Any) -> dict[str, bool]:
    """Register the directive; called by Sphinx."""
    sphinx.add_directive("command-help", _CommandHelp)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
