"""Kernels are compiled when they are first needed, for their stated types only, once for all processes."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import textwrap
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

import counterflex
from counterflex.core.jit import compile_stated, kernel

HEARING = """
from numba.core import event
import counterflex.core.compiled as compiled
import counterflex.core.jit as jit

begun = []


class Heard(event.Listener):
    def on_start(self, seen):
        function = seen.data["dispatcher"].py_func
        if function.__module__.startswith("counterflex."):
            begun.append(function.__name__)

    def on_end(self, seen):
        pass


event.register("numba:compile", Heard())
"""
"""Beginning of a program: ``begun`` lists the kernels that it compiles."""


def started(text: str, cache: Path | None = None, installed: Path | None = None) -> subprocess.Popen[str]:
    """A Python program that begins with :data:`HEARING`.

    ``cache``: an empty one, or None for that of the computer. ``installed``: folder that holds the package.
    """
    own = {} if cache is None else {"COUNTERFLEX_CACHE": str(cache)}
    own |= {} if installed is None else {"PYTHONPATH": str(installed)}
    words = [sys.executable, "-c", HEARING + textwrap.dedent(text)]
    return subprocess.Popen(words, env=os.environ | own, stdout=subprocess.PIPE, text=True)


def printed(program: subprocess.Popen[str]) -> list[str]:
    """What it prints, line by line."""
    out, _ = program.communicate()
    assert program.returncode == 0
    return out.splitlines()


def test_an_import_compiles_nothing_and_a_call_what_it_needs(tmp_path: Path) -> None:
    text = """
        import counterflex.app.run.session
        import counterflex.app.compensation.compensate
        from counterflex.plan.bending_kernels import oscillator
        print(begun)
        oscillator(0.0, 1.0, 0.1)
        print(begun)
        try:
            oscillator("0", 1.0, 0.1)
        except TypeError as fault:
            print(fault)
        print(begun)
    """
    again = """
        from counterflex.plan.bending_kernels import oscillator
        oscillator(0.0, 1.0, 0.1)
        print(begun)
    """
    assert printed(started(text, tmp_path)) == [
        "[]",
        "['oscillator']",
        "No matching definition for argument type(s) unicode_type, float64, float64",
        "['oscillator']",
    ]
    assert printed(started(again, tmp_path)) == ["[]"]  # read from the cache


def test_processes_that_need_the_same_kernel_compile_it_once(tmp_path: Path) -> None:
    text = """
        from counterflex.plan.bending_kernels import oscillator
        oscillator(0.0, 1.0, 0.1)
        print(*begun)
    """
    both = [started(text, tmp_path) for _ in range(2)]
    assert sorted(printed(one) for one in both) == [[""], ["oscillator"]]


def test_a_second_installation_reads_what_the_first_has_compiled(tmp_path: Path) -> None:
    """Another checkout, environment or copy with the same sources: its kernels are the same."""
    text = """
        import counterflex
        from counterflex.plan.bending_kernels import oscillator
        oscillator(0.0, 1.0, 0.1)
        print(counterflex.__file__)
        print(*begun)
    """
    package = tmp_path / "second" / "counterflex"
    package.parent.mkdir()
    package.symlink_to(Path(counterflex.__file__).parent)
    cache = tmp_path / "cache"
    assert printed(started(text, cache)) == [counterflex.__file__, "oscillator"]
    assert printed(started(text, cache, package.parent)) == [str(package / "__init__.py"), ""]


def test_no_kernel_of_a_session_is_left_to_be_compiled_in_a_cycle() -> None:
    """A whole session, its robot and sensor stood in for: what it calls is there before the first cycle."""
    text = f"""
        import sys
        sys.path.insert(0, {str(Path(__file__).parents[1] / "protocols")!r})
        import counterflex.app.run.session
        import test_session_axis_check as rig

        robot = rig._Robot(rig.nothing)
        session = rig.session(robot)
        rooms = tuple(f"counterflex.{{room}}." for room in ("runtime", "protocols", "sensing", "signals"))
        ours = [k for k in jit._ENTRIES if k.py_func.__module__.startswith(rooms)]
        print(len(ours) > 20, [k.py_func.__name__ for k in ours if k._stated])
        genuine, late = compiled.Dispatcher.compile, []

        def compile(self, signature):
            if self.py_func.__module__.startswith(rooms):  # the robot that is stood in for compiles its own
                late.append(self.py_func.__name__)
            return genuine(self, signature)

        compiled.Dispatcher.compile = compile
        while robot.cycle < rig.GATE + 20:
            session.cycle(0.0)
        print(session.loop.state.name, late)
    """
    assert printed(started(text)) == ["True []", "ACTIVE []"]


@pytest.mark.parametrize("wrong", [np.zeros((2, 2)), np.zeros(2, dtype=np.int64), np.zeros(4)[::2], None])
def test_a_wrong_type_is_refused_at_the_first_call_and_later(wrong: Any) -> None:
    @kernel("float64(float64[::1])")
    def fresh(x: Any) -> float:
        return float(x[0])

    for _ in range(2):
        with pytest.raises(TypeError):
            fresh(wrong)
        assert fresh(np.ones(2)) == 1.0


def test_threads_that_call_a_kernel_for_the_first_time_wait_for_it() -> None:
    @kernel("float64(float64)")
    def cube(x: float) -> float:
        return x * x * x

    begin = threading.Barrier(4)

    def call(x: float) -> float:
        begin.wait()
        return cube(x)

    with ThreadPoolExecutor(4) as threads:
        assert list(threads.map(call, (1.0, 2.0, 3.0, 4.0))) == [1.0, 8.0, 27.0, 64.0]


PAIR = """
from counterflex.core.jit import kernel

@kernel("float64(float64)")
def half(x):
    return 0.5 * x

@kernel("float64(float64)")
def quarter(x):
    return half(half(x))
"""


def test_a_kernel_that_calls_another_compiles_it_unless_its_own_code_is_in_the_cache(tmp_path: Path) -> None:
    (tmp_path / "pair.py").write_text(PAIR)
    text = f"""
        import sys
        sys.path.insert(0, {str(tmp_path)!r})
        import pair
        print(pair.quarter(1.0), [len(one.signatures) for one in (pair.quarter, pair.half)])
    """
    assert printed(started(text, tmp_path / "cache")) == ["0.25 [1, 1]"]
    assert printed(started(text, tmp_path / "cache")) == ["0.25 [1, 0]"]


def test_kernels_are_compiled_before_they_are_called() -> None:
    @kernel("float64(float64)", entry=True)
    def square(x: float) -> float:
        return x * x

    @kernel("float64(float64)")
    def cube(x: float) -> float:
        return x * x * x

    compile_stated("counterflex.plan.nothing")
    assert not square.signatures  # type: ignore[attr-defined]
    compile_stated(__name__)
    assert len(square.signatures) == 1  # type: ignore[attr-defined]
    assert not cube.signatures  # type: ignore[attr-defined]


def kernels_in(tree: ast.Module) -> dict[str, ast.Call]:
    """Decorator of each kernel of a module."""
    return {
        node.name: mark
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        for mark in node.decorator_list
        if isinstance(mark, ast.Call) and isinstance(mark.func, ast.Name) and mark.func.id == "kernel"
    }


def named_in(tree: ast.Module, module: str, kernels: dict[str, dict[str, ast.Call]]) -> set[tuple[str, str]]:
    """Kernels, module and name, that a module names outside the code of kernels."""
    within = {
        id(part)
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and node.name in kernels.get(module, ())
        for part in ast.walk(node)
    }
    known = {name: (module, name) for name in kernels.get(module, ())}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            known |= {a.asname or a.name: (node.module, a.name) for a in node.names}
    found = set()
    for node in ast.walk(tree):
        if id(node) in within:
            continue
        if isinstance(node, ast.Name) and node.id in known:
            found.add(known[node.id])
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in known:
            found.add((".".join(known[node.value.id]), node.attr))
    return found


def test_what_python_calls_is_an_entry_point() -> None:
    """Any other kernel is not compiled beforehand, and comes with no package: somebody waits for the compiler."""
    root = Path(counterflex.__file__).parent
    files = {".".join(f.relative_to(root.parent).with_suffix("").parts): f for f in root.rglob("*.py")}
    trees = {module: ast.parse(file.read_text(encoding="utf-8")) for module, file in files.items()}
    kernels = {module: kernels_in(tree) for module, tree in trees.items()}
    named = {pair for module, tree in trees.items() for pair in named_in(tree, module, kernels)}
    called = {(m, name) for m, name in named if name in kernels.get(m, {})}
    marked = {pair for pair in called if any(k.arg == "entry" for k in kernels[pair[0]][pair[1]].keywords)}
    assert len(called) > 100
    assert called == marked


@pytest.mark.parametrize("disjoint", [False, True])
def test_a_disjoint_kernel_says_so_of_its_arrays(disjoint: bool) -> None:
    def nothing() -> None:
        pass

    made: Any = kernel(disjoint=disjoint)(nothing)
    made()
    flags = made._compiler._customize_flags(numba.core.compiler.Flags())
    assert bool(flags.noalias) is disjoint
