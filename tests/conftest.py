"""Tests depend on no machine's speed: hypothesis sets no deadline, small matrices are not shared between threads.

Tests marked ``long`` count rates over many seeds, enumerate, or repeat whole studies. ``--turn`` takes those of one
third of the files, and of the files that the last commit has changed (:mod:`thirds`). Of the cases of a test marked
``by_turn`` every third one runs at each commit, the next ones at the next; the others are long. Of the examples of
hypothesis a share is drawn where the long tests of a file are left out, all where they run.
"""

from __future__ import annotations

import functools
import gc
import os
import signal
import sys
from collections import Counter
from collections.abc import Generator
from pathlib import Path, PurePath
from typing import Any

import pytest
from hypothesis import is_hypothesis_test, settings

sys.path.append(str(Path(__file__).parents[1] / "tools"))
import thirds

gc.disable()  # until all tests are collected
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MUJOCO_GL", "disable")
os.environ.setdefault("COUNTERFLEX_PROGRESS_S", "0")  # how slow a machine is shows in no output
LONGEST = (
    "app/proof/test_accuracy_goals.py",
    "cutting/tridexel/test_columns.py",
    "lab/test_composed_stories.py",
    "identify/test_interval_coverage.py",
    "app/production/test_production_twin.py",
    "app/test_controller_axes_judged.py",
    "robot/test_compliance.py",
    "lab/test_fault_scenarios.py",
    "cli/test_help.py",
    "app/strategy/test_advice.py",
    "cli/test_bad_files.py",
    "app/run/test_online_run.py",
    "app/opcua/test_opcua_run.py",
    "app/panel/test_panel_page.py",
    "app/test_preflight_programs.py",
    "app/run/test_run_lost.py",
    "runtime/test_force_step.py",
    "runtime/test_step_explored.py",
    "runtime/test_supervisor_explored.py",
    "identify/kinematics/test_kinematics_recovery.py",
    "identify/payload/test_payload.py",
    "app/proof/test_turning_tool.py",
    "app/run/test_pair_run.py",
    "app/production/test_production_job.py",
)
"""Files that take half a minute and more: they begin first, so that none is left over when all others have ended."""
SHARE, FEWEST = 4, 10
"""Of the examples of a law one of so many is drawn in a sample, and no fewer than these if it states as many."""
settings.register_profile("counterflex", deadline=None)
settings.load_profile("counterflex")

# A shell that starts the suite in the background has it ignore Ctrl-C, and every process that a test starts inherits
# that: none could be interrupted, and what waits for it would wait for ever.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Options of the suite."""
    parser.addoption("--turn", action="store_true", help="of the long tests only the third of this commit")


@functools.cache
def _now() -> thirds.Turn:
    return thirds.turn()


def _fewer_examples(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Draw a share of the examples of hypothesis where the long tests of a file are left out."""
    laws: dict[int, Any] = {}
    for one in items:
        law = getattr(one, "obj", None)
        left_out = (
            not _now().takes(one.nodeid.partition("::")[0])
            if config.getoption("turn")
            else "not long" in config.getoption("markexpr")
        )
        if left_out and is_hypothesis_test(law):
            law = getattr(law, "__func__", law)
            laws[id(law)] = law
    for law in laws.values():
        whole = getattr(law, "_hypothesis_internal_use_settings", None) or settings()
        count = max(whole.max_examples // SHARE, min(whole.max_examples, FEWEST))
        law._hypothesis_internal_use_settings = settings(whole, max_examples=count)


@pytest.hookimpl(wrapper=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> Generator[None]:
    """Put the longest files first; `make test` deals files out in this order (`--no-loadscope-reorder`)."""
    _fewer_examples(config, items)
    laws: dict[str, list[pytest.Item]] = {}
    for one in items:
        if one.get_closest_marker("by_turn"):
            laws.setdefault(one.nodeid.partition("[")[0], []).append(one)
    for cases in laws.values():
        for number, one in enumerate(cases):
            if (number - _now().number) % min(thirds.COUNT, len(cases)):
                one.add_marker("long")
    yield
    root = Path(__file__).parent
    rank = {root / name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path, len(LONGEST)))
    if config.getoption("turn"):
        taken = [not one.get_closest_marker("long") or _now().takes(one.nodeid.partition("::")[0]) for one in items]
        config.hook.pytest_deselected(items=[one for one, is_taken in zip(items, taken, strict=True) if not is_taken])
        items[:] = [one for one, is_taken in zip(items, taken, strict=True) if is_taken]


def pytest_collection_finish() -> None:
    """Take libraries and collected tests from the garbage collector: going through them took a quarter of the time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000)
    gc.enable()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print how long each test room took, all its processes together, its slowest file, and the ten slowest of all."""
    if terminalreporter.config.getoption("turn"):
        terminalreporter.write_line(thirds.said(_now()))
    rooms: Counter[str] = Counter()
    files: dict[str, Counter[str]] = {}
    slowest: Counter[str] = Counter()
    for kind in ("passed", "failed", "error", ""):
        for report in terminalreporter.stats.get(kind, ()):
            path = PurePath(str(report.nodeid).split("::")[0])
            room = path.parts[1] if len(path.parts) > 2 else "."
            seconds = getattr(report, "duration", 0)  # a file that could not be collected has none
            rooms[room] += seconds
            files.setdefault(room, Counter())[path.name] += seconds
            slowest[path.as_posix()] += seconds
    if len(rooms) < 2:
        return
    terminalreporter.section("seconds per room")
    for room, seconds in rooms.most_common():
        name, longest = files[room].most_common(1)[0]
        terminalreporter.write_line(f"{seconds:8.1f} s  {room:<12} slowest: {name} {longest:.1f} s")
    terminalreporter.section("ten slowest files")
    for file, seconds in slowest.most_common(10):
        terminalreporter.write_line(f"{seconds:8.1f} s  {file}")
