"""The frame-name check finds what it should and leaves alone what is right."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest


def _load() -> ModuleType:
    path = Path(__file__).parents[2] / "tools" / "check_frames.py"
    spec = importlib.util.spec_from_file_location("check_frames", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "line",
    [
        "T_base_tcp = T_base_flange @ T_flange_tcp",
        "T_base_tcp = T_base_flange @ T_flange_sensor @ T_sensor_tcp",
        "x = T_base_part @ Ts_part_tcp[3]",
        "T_part_tcp = pose.inverse(T_base_part) @ T_base_tcp",
        "R_part_tcp = R_base_part.T @ R_base_tcp",
        "p = pose.transform(T_base_part, p_part_tcp)",
        "unnamed = A @ T_base_tcp",
    ],
)
def test_right_products_pass(line: str) -> None:
    assert _load().check(line, "line").faults == []


@pytest.mark.parametrize(
    "line",
    [
        "T_base_tcp = T_base_flange @ T_tcp_flange",
        "T_tcp_base = T_base_flange @ T_flange_tcp",
        "x = f(T_base_flange @ T_flange_sensor @ T_tcp_sensor)",
        "R_base_tcp = R_base_part.T @ R_part_tcp",
        "p = pose.transform(T_base_part, p_base_tcp)",
    ],
)
def test_wrong_products_are_faults(line: str) -> None:
    assert len(_load().check(line, "line").faults) >= 1
