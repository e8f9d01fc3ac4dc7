"""Compiled kernels with counters in every branch, so that a fuzzer can be guided by what it reaches at full speed.

The source of the kernels is taken as it is, a counter is put at the head of each branch and of each loop, and the
result is compiled again, or run as plain Python.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numba
import numpy as np

from counterflex.core.arrays import Bool, Int
from counterflex.core.jit import kernel

_CLASSES = 8


@dataclass(eq=False)
class Instrumented:
    """A kernel with counters."""

    run: Callable[..., Any]  # the kernel; its last argument is counts
    counts: Int  # (branches,) how often each was entered, to be set to zero by whoever runs it

    def __post_init__(self) -> None:
        """Nothing has been reached yet."""
        self._reached: Bool = np.zeros((len(self.counts), _CLASSES), dtype=np.bool_)

    def new(self) -> bool:
        """Return whether the last run entered a branch, or as often as no run before; forgets its counts."""
        return bool(novel(self.counts, self._reached))

    def signature(self) -> frozenset[tuple[int, int]]:
        """Branches of the last run, each with the class of how often it was entered; forgets its counts."""
        found = frozenset(
            (int(k), min(_CLASSES, int(self.counts[k]).bit_length()) - 1) for k in np.flatnonzero(self.counts)
        )
        self.counts[:] = 0
        return found

    @property
    def branches(self) -> tuple[int, int]:
        """Branches reached, and all there are."""
        return int(np.sum(self._reached.any(axis=1))), len(self.counts)


@kernel("boolean(int64[::1], boolean[:, ::1])")
def novel(counts: Int, reached: Bool) -> bool:
    """Enter counts into what was reached, by powers of two, and set them to zero; whether there was something new."""
    found = False
    for k in range(counts.shape[0]):
        n, size = counts[k], 0
        counts[k] = 0
        while n > 1 and size < reached.shape[1] - 1:
            n >>= 1
            size += 1
        if n > 0 and not reached[k, size]:
            reached[k, size] = True
            found = True
    return found


def instrument(module: ModuleType, name: str, *others: ModuleType, compiled: bool = True) -> Instrumented:
    """A kernel of a module and all kernels that it calls, with counters.

    Args:
        module: That holds it.
        name: Its name.
        others: Modules whose kernels it calls, each before those that use it.
        compiled: False gives plain Python.
    """
    space: dict[str, Any] = {}
    marker = _Marker()
    wanted = _called(name, (*others, module))
    for each in (*others, module):
        space = {**each.__dict__, **{k: v for k, v in space.items() if k in marker.known}}
        tree = ast.parse(inspect.getsource(each))
        for function in [node for node in tree.body if isinstance(node, ast.FunctionDef)]:
            decorated = [d for d in function.decorator_list if isinstance(d, ast.Call) and _names(d.func) == "kernel"]
            inline = bool(decorated) and any(k.arg == "inline" for k in decorated[0].keywords)
            if function.name not in wanted or not decorated or (compiled and inline):
                continue
            marker.known.add(function.name)
            marker.visit(function)
            code = ast.Module([ast.fix_missing_locations(function)], [])
            exec(compile(code, f"<{each.__name__} with counters>", "exec"), space)
            if compiled:
                space[function.name] = numba.njit(error_model="numpy")(space[function.name])
    return Instrumented(space[name], np.zeros(marker.count, dtype=np.int64))


def _called(name: str, modules: tuple[ModuleType, ...]) -> set[str]:
    """Names of the functions of some modules that one of them calls, and of those that these call; itself included."""
    bodies: dict[str, ast.FunctionDef] = {}
    for each in modules:
        bodies |= {n.name: n for n in ast.parse(inspect.getsource(each)).body if isinstance(n, ast.FunctionDef)}
    todo, seen = [name], set()
    while todo:
        one = todo.pop()
        if one in bodies and one not in seen:
            seen.add(one)
            todo += [_names(node.func) for node in ast.walk(bodies[one]) if isinstance(node, ast.Call)]
    return seen


def _names(node: ast.expr) -> str:
    return node.id if isinstance(node, ast.Name) else ""


class _Marker(ast.NodeTransformer):
    """Puts counters into functions, and hands them on to the functions that these call."""

    def __init__(self) -> None:
        self.known: set[str] = set()
        self.count = 0

    def _mark(self, body: list[ast.stmt]) -> list[ast.stmt]:
        mark = ast.parse(f"_counts[{self.count}] += 1").body
        self.count += 1
        return mark + body

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        self.generic_visit(node)
        node.decorator_list, node.returns = [], None
        for argument in node.args.args:
            argument.annotation = None
        node.args.args.append(ast.arg("_counts"))
        node.body = self._mark(node.body)
        return node

    def visit_If(self, node: ast.If) -> ast.AST:
        self.generic_visit(node)
        node.body, node.orelse = self._mark(node.body), self._mark(node.orelse)
        return node

    def visit_While(self, node: ast.While) -> ast.AST:
        self.generic_visit(node)
        node.body = self._mark(node.body)
        return node

    def visit_For(self, node: ast.For) -> ast.AST:
        self.generic_visit(node)
        node.body = self._mark(node.body)
        return node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        if _names(node.func) in self.known:
            node.args.append(ast.Name("_counts", ast.Load()))
        return node
