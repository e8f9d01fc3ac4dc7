"""The truth must not be the model: what the twin may not import."""

from __future__ import annotations

import ast
from pathlib import Path

import counterflex.twin

ROOM = Path(counterflex.twin.__file__).parent
FORBIDDEN = (
    "counterflex.robot.chain",
    "counterflex.robot.compliance",
    "counterflex.robot.kernels",
    "counterflex.robot.gravity",
    "counterflex.plan",
    "counterflex.cutting.force",
    "counterflex.cutting.mean_force",
    "counterflex.cutting.coefficients",
)


def imported(source: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def test_the_twin_knows_no_compensator() -> None:
    for source in ROOM.glob("*.py"):
        for name in imported(source):
            assert not name.startswith(FORBIDDEN), f"{source.name} imports {name}"


def test_one_file_touches_the_physics_engine() -> None:
    users = [s.name for s in ROOM.glob("*.py") if any(n.split(".")[0] == "mujoco" for n in imported(s))]
    assert users == ["plant.py"]
