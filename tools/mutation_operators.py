"""Small changes of meaning at random places of Python source: the operators of mutation testing.

An operator exchanges one sign, comparison, bound, index or word for its neighbour. Docstrings, annotations, messages
and ``raise`` statements are left alone: no test should depend on them letter by letter.
"""

from __future__ import annotations

import ast
import random
import re
import subprocess
from pathlib import Path
from typing import NamedTuple

_SWAPS = {
    ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*",
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==",
    ast.And: "or", ast.Or: "and",
}  # fmt: skip
_NAMES = {
    "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all", "all": "any",
    "argmin": "argmax", "argmax": "argmin", "floor": "ceil", "ceil": "floor", "sin": "cos", "cos": "sin",
    "abs": "float", "mean": "max", "cumsum": "asarray", "deg2rad": "rad2deg", "rad2deg": "deg2rad",
}  # fmt: skip


class Change(NamedTuple):
    """One exchange in a source text: byte range, new text, line, words for a person."""

    start: int
    end: int
    new: str
    line: int
    words: str


def changed_lines(root: Path, since: str) -> dict[str, set[int]]:
    """Lines of ``src`` that differ from a commit, by file."""
    command = ["git", "diff", "-U0", since, "--", "src/*.py"]
    lines: dict[str, set[int]] = {}
    file = ""
    for line in subprocess.run(command, cwd=root, check=True, capture_output=True, text=True).stdout.splitlines():
        if line.startswith("+++ b/"):
            file = line.removeprefix("+++ b/")
        elif found := re.match(r"@@ -\S+ \+(\d+)(?:,(\d+))? @@", line):
            first, count = int(found[1]), int(found[2] or 1)
            lines.setdefault(file, set()).update(range(first, first + count))
    return lines


def _skipped(tree: ast.AST) -> set[int]:
    """Nodes below annotations, messages of errors and decorators, by identity."""
    skipped: set[int] = set()
    for node in ast.walk(tree):
        parts: list[ast.AST | None] = []
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            arguments = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
            parts = [node.returns, *node.decorator_list, *(one.annotation for one in arguments)]
        elif isinstance(node, ast.AnnAssign):
            parts = [node.annotation]
        elif isinstance(node, (ast.Raise, ast.Assert, ast.JoinedStr)):
            parts = [node]
        for part in parts:
            if part is not None:
                skipped.update(id(one) for one in ast.walk(part))
    return skipped


class _Source:
    """A source text whose nodes are found by their place in bytes."""

    def __init__(self, text: str) -> None:
        self.tree = ast.parse(text)
        self.data = text.encode()
        self.starts = [0]
        for line in self.data.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))

    def span(self, node: ast.expr) -> tuple[int, int]:
        """Begin and end of a node."""
        end_line, end = node.end_lineno or node.lineno, node.end_col_offset or 0
        return self.starts[node.lineno - 1] + node.col_offset, self.starts[end_line - 1] + end

    def between(self, left: ast.expr, right: ast.expr, kind: type[ast.AST]) -> list[Change]:
        """Exchange of the operator between two operands."""
        first, last = self.span(left)[1], self.span(right)[0]
        gap = self.data[first:last].decode()
        new = _SWAPS.get(kind)
        old = re.search(r"\*(?!\*)|/(?!/)|[+-]|<=?|>=?|==|!=|\band\b|\bor\b", gap)
        if not new or not old:
            return []
        at = first + len(gap[: old.start()].encode())
        return [Change(at, at + len(old[0]), new, left.end_lineno or left.lineno, f"{old[0]} -> {new}")]

    def pairs(self, node: ast.AST) -> list[Change]:
        """Exchanges of operators with two operands."""
        if isinstance(node, ast.BinOp) and not isinstance(node.left, ast.Constant | ast.JoinedStr):
            return self.between(node.left, node.right, type(node.op))
        if isinstance(node, ast.Compare):
            rows = zip([node.left, *node.comparators], node.comparators, node.ops, strict=False)
            return [one for left, right, kind in rows for one in self.between(left, right, type(kind))]
        if isinstance(node, ast.BoolOp):
            neighbours = zip(node.values, node.values[1:], strict=False)
            return [one for left, right in neighbours for one in self.between(left, right, type(node.op))]
        return []

    def single(self, node: ast.AST) -> list[Change]:
        """Signs and negations left out, functions and indices exchanged for their neighbours."""
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
            first, inner = self.span(node)[0], self.span(node.operand)[0]
            if isinstance(node.operand, ast.Constant) and node.operand.value == 1:  # most often an index or an exponent
                return []
            return [Change(first, inner, "", node.lineno, f"without {self.data[first:inner].decode().strip()}")]
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
            name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
            end, new = self.span(node.func)[1], _NAMES.get(name)
            return [] if new is None else [Change(end - len(name), end, new, node.lineno, f"{name} -> {new}")]
        if isinstance(node, ast.Subscript):
            first, last = self.span(node.slice)
            old = self.data[first:last].decode()
            new = {"0": "-1", "-1": "0", "1": "0", "2": "1"}.get(old)
            return [] if new is None else [Change(first, last, new, node.lineno, f"[{old}] -> [{new}]")]
        return []


def changes(text: str, lines: set[int] | None = None) -> list[Change]:
    """Every change that an operator can make in a source text.

    Args:
        text: Python source.
        lines: Line numbers, from 1, outside which nothing is changed; all lines if None.
    """
    source = _Source(text)
    skipped = _skipped(source.tree)
    nodes = [node for node in ast.walk(source.tree) if id(node) not in skipped]
    found = [change for node in nodes for change in (*source.pairs(node), *source.single(node))]
    return sorted(change for change in found if lines is None or change.line in lines)


def sample(root: Path, files: dict[str, set[int] | None], count: int, seed: int) -> list[tuple[str, Change]]:
    """Draw changes at random, each file with the same weight per possible change.

    Args:
        root: Folder of the tree.
        files: Lines that may change, by source file; None for every line.
        count: Number drawn; fewer if there are fewer.
        seed: Of the draw.
    """
    everything = [
        (file, change)
        for file, lines in sorted(files.items())
        if (root / file).is_file()
        for change in changes((root / file).read_text(encoding="utf-8"), lines)
    ]
    return random.Random(seed).sample(everything, min(count, len(everything)))
