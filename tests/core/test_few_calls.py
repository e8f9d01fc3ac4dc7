"""Small questions run their kernels as plain Python: no compiler is loaded, the numbers are the compiled ones."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app import pose_questions, questions
from counterflex.core.arrays import Float
from counterflex.core.errors import ReachError
from counterflex.core.jit import Kernel, few_calls, kernel
from counterflex.core.units import DEG
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.model.catalog import names
from counterflex.robot.model.controller_axes import shown_limits

CELLS = sorted((Path(__file__).resolve().parents[2] / "examples" / "cells").glob("*.toml"))
SMALL = str(next(cell for cell in CELLS if cell.stem == "kr300_d16_small"))
LOAD = [300.0, 500.0, -200.0], [1.0, 2.0, 3.0]
COMMANDS = (
    ["pose", "kuka_kr300_r2500_ultra", "--joints-deg", "0,-90,90,0,0,0"],
    ["pose", "kuka_kr300_r2500_ultra", "--xyz-mm", "1590,0,1784", "--abc-deg", "0,90,0"],
    ["deflection", SMALL, "--joints-deg", "0,-95,125,0,-30,0", "--force-n", "0,500,0"],
    ["cell", "check", SMALL],
)


@kernel("void(float64[::1], float64)")
def twice_and_divide(values: Float, by: float) -> None:
    """Change an array in place, then divide."""
    values *= 2.0
    values[0] = 1.0 / by


@pytest.fixture
def plain(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], Any]], Any]:
    """Call a function with kernels that nobody has compiled yet."""

    def call(ask: Callable[[], Any]) -> Any:
        with monkeypatch.context() as patch, few_calls():
            for one in [one for one in gc.get_objects() if type(one) is Kernel]:
                patch.setattr(one, "_made", None)
                patch.setattr(one, "_dispatcher", lambda: pytest.fail("the compiler is loaded"))
            return ask()

    return call


def posture(chain: ElasticChain) -> list[float]:
    """About the middle of what the axes can do, deg."""
    low, high = shown_limits(chain.axes, chain.joint_limits_rad).T / DEG
    q: list[float] = (low + [0.55, 0.5, 0.5, 0.5, 0.6, 0.5] * (high - low)).tolist()
    return q


def same(one: Any, other: Any) -> None:
    """Compare answers: texts alike, numbers within 1e-9 of their size."""
    if isinstance(one, dict):
        assert list(one) == list(other)
        one, other = list(one.values()), list(other.values())
    if isinstance(one, (list, tuple)):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            same(a, b)
    elif isinstance(one, float):
        assert one == pytest.approx(other, rel=1e-9, abs=1e-9)
    else:
        assert one == other


def test_no_compiler_is_loaded() -> None:
    text = (
        "import json, sys, contextlib\nfrom counterflex.cli.start import run\n"
        "for words in json.loads(sys.argv.pop()):\n"
        "    sys.argv[1:] = words\n    with contextlib.suppress(SystemExit): run()\n"
        "sys.exit('numba' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", text, json.dumps(COMMANDS)], stdout=subprocess.DEVNULL).returncode == 0


@pytest.mark.parametrize("name", names())
def test_poses_are_those_of_the_compiled_kernels(name: str, plain: Callable[[Callable[[], Any]], Any]) -> None:
    chain = pose_questions.chain_of(name)
    q = posture(chain)
    answer = pose_questions.pose_of_joints(chain, q)
    same(plain(lambda: pose_questions.pose_of_joints(chain, q)), answer)
    place = list(answer["tcp_in_base"].values())

    def back() -> Any:
        try:
            return pose_questions.joints_of_pose(chain, place[:3], place[3:])
        except ReachError as refusal:  # some arms are stretched there
            return str(refusal)

    same(plain(back), back())


@pytest.mark.parametrize("cell", CELLS, ids=lambda cell: cell.stem)
def test_deflections_and_checks_are_those_of_the_compiled_kernels(
    cell: Path, plain: Callable[[Callable[[], Any]], Any]
) -> None:
    chain, _ = questions.load_chain(str(cell))
    q = posture(chain)
    both: list[Callable[[], Any]] = [
        lambda: questions.deflection(chain, q, *LOAD),
        lambda: questions.check_cell(str(cell), None),
    ]
    for ask in both:
        same(plain(ask), ask())


def test_what_plain_python_cannot_divide_the_compiled_kernel_does() -> None:
    values = np.array([1.0, 3.0])
    with few_calls():
        twice_and_divide(values, 0.0)
    np.testing.assert_array_equal(values, [np.inf, 6.0])
