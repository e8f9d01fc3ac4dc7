"""The reference of rooms in the documentation, from their docstrings.

A Sphinx extension with one directive, ``room``: a section for each public module of a package, in it what
``automodule`` says. Modules of kernels are left out: their arguments are those of the functions that call them.

    .. room:: counterflex.geometry
    .. room:: counterflex.robot
       :only: elasticity.chain kinematics.inverse
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from pathlib import Path
from typing import Any, Final

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.util.docutils import SphinxDirective

from counterflex.core.jit import Kernel

SOURCES: Final = Path(__file__).resolve().parents[2] / "src"


def modules(package: str) -> list[str]:
    """Public modules of a package by dotted name; those of kernels are left out.

    Args:
        package: Dotted name.
    """
    folder = SOURCES / package.replace(".", "/")
    if not folder.is_dir():
        return [package]
    names = [".".join(file.relative_to(SOURCES).with_suffix("").parts) for file in sorted(folder.rglob("*.py"))]
    return [name for name in names if "kernel" not in name and not any(part[0] == "_" for part in name.split("."))]


def chosen(package: str, only: list[str]) -> list[str]:
    """Public modules of a package, all or some in the order in which they are named.

    Args:
        package: Dotted name.
        only: Names below the package; empty: all.

    Raises:
        ValueError: The package has no such public module.
    """
    known = modules(package)
    names = [f"{package}.{name}" for name in only] or known
    missing = sorted(set(names) - set(known))
    if missing:
        raise ValueError(f"no public module: {', '.join(missing)}")
    return names


class _Room(SphinxDirective):  # type: ignore[misc]
    """``room``: the modules of a package."""

    required_arguments = 1
    option_spec = {"only": directives.unchanged}  # noqa: RUF012  # as docutils has it

    def run(self) -> list[nodes.Node]:
        try:
            names = chosen(self.arguments[0], self.options.get("only", "").split())
        except ValueError as fault:
            raise self.error(str(fault)) from fault
        return [self._module(name) for name in names]

    def _module(self, name: str) -> nodes.Node:
        section = nodes.section(ids=[f"module-of-{name.replace('.', '-')}"], names=[name])
        short = name.removeprefix("counterflex.")
        section += nodes.title("", "", nodes.literal(short, short))
        section += self.parse_text_to_nodes(f".. automodule:: {name}\n   :members:\n")
        return section


def with_formulas(lines: list[str]) -> list[str]:
    """Lines of a docstring in which indented formulas are literal blocks of reStructuredText.

    A formula stands behind a blank line, indented, below a paragraph that is not; the lines of a section (``Args:``)
    follow it at once.

    Args:
        lines: Of the docstring.
    """
    out: list[str] = []
    above = ""
    for number, line in enumerate(lines):
        begins = line.startswith("    ") and line.strip() and number > 0 and not lines[number - 1].strip()
        if begins and above and not above.startswith((" ", "- ")) and not above.endswith("::"):
            out += ["::", ""]
        out.append(line)
        above = line if line.strip() else above
    return out


def without_substitutions(line: str) -> str:
    """A line in which bars are bars and names no substitutions, and no literal has blanks at its ends.

    Args:
        line: Of a docstring, outside of its literal blocks.
    """
    parts = re.split(r"(``.+?``)", line)
    return "".join(f"``{part[2:-2].strip()}``" if k % 2 else part.replace("|", r"\|") for k, part in enumerate(parts))


def fields(source: str) -> list[tuple[str, str]]:
    """Public fields of a class with the comment that stands beside them, or above where it is long.

    Args:
        source: Of the class.
    """
    lines = textwrap.dedent(source).splitlines()
    out = []
    for node in getattr(ast.parse("\n".join(lines)).body[0], "body", ()):
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name) or node.target.id[0] == "_":
            continue
        first = node.lineno - 1
        while lines[first - 1].strip().startswith("# "):
            first -= 1
        own = lines[node.end_lineno - 1].encode()[node.end_col_offset :].decode().strip() if node.end_lineno else ""
        comments = [line.strip() for line in lines[first : node.lineno - 1]] + ([own] if own.startswith("#") else [])
        if text := " ".join(comment.lstrip("#: ") for comment in comments):
            out.append((node.target.id, text.replace("`", "``")))
    return out


def _with_fields(item: Any, lines: list[str]) -> None:
    """Name the fields of a class that say what they hold in a comment."""
    try:
        named = [f"    {name}: {text}" for name, text in fields(inspect.getsource(item))]
    except (OSError, TypeError):
        return
    if not named:
        return
    if "Attributes:" not in lines:
        lines += ["", "Attributes:", ""]
    at = lines.index("Attributes:") + 1
    lines[at:at] = named


def _docstring(_app: Any, what: str, _name: str, item: Any, _options: Any, lines: list[str]) -> None:
    if what == "class":
        _with_fields(item, lines)
    formula = False
    for number, line in enumerate(shown := with_formulas(lines)):
        formula = line == "::" or (formula and (not line or line.startswith("    ")))
        shown[number] = line if formula else without_substitutions(line)
    lines[:] = shown


def with_aliases(text: str) -> str:
    """A signature in which names of array types stand as they are written, also within other types."""
    return re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text)


def _signature(
    _app: Any, _what: str, _name: str, _item: Any, _options: Any, signature: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    return signature and with_aliases(signature), returned and with_aliases(returned)


def _skip(_app: Any, _what: str, _name: str, item: Any, skip: bool, _options: Any) -> bool | None:
    return True if isinstance(item, Kernel) else None if not skip else True


def setup(sphinx: Any) -> dict[str, bool]:
    """Register the directive; called by Sphinx."""
    sphinx.add_directive("room", _Room)
    sphinx.connect("autodoc-process-docstring", _docstring, priority=400)  # before napoleon reads its sections
    sphinx.connect("autodoc-process-signature", _signature)
    sphinx.connect("autodoc-skip-member", _skip)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
