"""The truth must not be the model: what the twin may not import."""

from __future__ import annotations

import ast
from pathlib import Path

import counterflex.integrations
import counterflex.twin

ROOM = Path(counterflex.twin.__file__).parent
MAKERS = Path(counterflex.integrations.__file__).parent
SHARED = (
    "counterflex.core",
    "counterflex.geometry",
    "counterflex.path",
    "counterflex.robot.model.controller_axes",
    "counterflex.robot.model.description",
    "counterflex.robot.model.opw",
    "counterflex.robot.model.opw_chain",
    "counterflex.cutting.cutter",
    "counterflex.cutting.stock",
    "counterflex.protocols.kuka_rsi.config",
    "counterflex.protocols.kuka_rsi.kernel",
    "counterflex.protocols.kuka_rsi.telegram",
    "counterflex.protocols.strain.telegram",
    "counterflex.protocols.tracker.telegram",
    "counterflex.protocols.wrench.telegram",
    "counterflex.twin",
)
"""All of the package that the twin may see: foundations, data, closed-form geometry, how makers count axes (judged by
models of its own in tests/references), shape of tool and stock, bytes."""
BYTES = ("telegram", "config", "kernel")
"""Modules of a maker's link that its simulated side may see: how a telegram is read and written."""


def imported(source: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def shared(name: str) -> bool:
    return any(name == room or name.startswith(f"{room}.") for room in SHARED)


def test_the_twin_knows_no_compensator() -> None:
    for source in ROOM.rglob("*.py"):
        for name in imported(source):
            if name.startswith("counterflex"):
                assert shared(name), f"{source.name} imports {name}"


def test_the_simulated_side_of_a_maker_shares_bytes_with_its_link_and_nothing_else() -> None:
    sources = [*MAKERS.glob("*/simulated.py"), *MAKERS.glob("*/simulated/**/*.py")]
    assert sources
    for source in sources:
        maker = f"counterflex.integrations.{source.relative_to(MAKERS).parts[0]}"
        own = (f"{maker}.simulated", *(f"{maker}.link.{module}" for module in BYTES))
        for name in imported(source):
            if name.startswith("counterflex"):
                known = shared(name) or any(name == one or name.startswith(f"{one}.") for one in own)
                assert known, f"{source} imports {name}"


def test_one_file_touches_the_physics_engine() -> None:
    users = [s.name for s in ROOM.rglob("*.py") if any(n.split(".")[0] == "mujoco" for n in imported(s))]
    assert users == ["plant.py"]
