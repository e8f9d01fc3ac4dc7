"""The README's figures are rewritten from a summary and nothing else changes."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest


def _load() -> ModuleType:
    path = Path(__file__).parents[2] / "tools" / "refresh_figures.py"
    spec = importlib.util.spec_from_file_location("refresh_figures", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _summary() -> dict[str, Any]:
    def variant(scale: float) -> dict[str, Any]:
        return {part: {"max_mm": 2.0 * scale, "p997_mm": scale} for part in ("path", "entry", "exit", "surface")}

    over = {"median_remaining": 0.2, "worst_remaining": 0.25}
    variants = {"nominal": variant(1.5), "compensated": variant(0.3)}
    other = {"nominal": variant(1.5), "compensated": variant(0.9)}
    return {
        "format": "counterflex-summary",
        "version": 2,
        "counterflex": "1.2.3",
        "family": "wide",
        "truth_level": "catalogue",
        "seeds": [
            {"seed": 1001, "truth_level": "catalogue", "variants": other},
            {"seed": 1001, "truth_level": "identified", "variants": variants},
            {"seed": 1002, "truth_level": "identified", "variants": other},
        ],
        "variants": other,
        "over_seeds": {"identified": {"count": 2, "path": {"p997": over, "max": over}}},
        "prediction": {
            "peak_force_n": {"value": 546.2, "line": 14},
            "peak_deflection_um": {"value": 1400.0, "line": 14, "joints_deg": [1.0, -90.4, 120.0, 0.0, 30.0, 0.0]},
        },
    }


def test_the_block_says_command_figures_and_peak() -> None:
    text = _load().block(_summary())
    command = "counterflex campaign --family wide --seeds 1001-1002 --exact --out out/campaign"
    assert f"`{command}` (version 1.2.3). Identified cell, truth seed 1001" in text
    assert "| path | 1.50 | **0.30** | 3.00 | **0.60** |" in text
    assert "(`identified`) | 2 | 20 % | 25 % | 25 % |" in text
    assert "546 N in line 14 of the program, 1.40 mm in line 14 with the axes at 1, -90, 120, 0, 30, 0 deg" in text
    assert "the simulated cell's constants" not in text


def test_only_the_marked_block_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tool = _load()
    readme = tmp_path / "README.md"
    readme.write_text("before\n<!-- figures: begin; x -->\nold\n<!-- figures: end -->\nafter\n", encoding="utf-8")
    monkeypatch.setattr(tool, "README", readme)
    monkeypatch.setattr(tool, "STORED", tmp_path / "results" / "readme.json")
    monkeypatch.setattr(tool, "read_summary", lambda _: _summary())
    assert tool.main("summary.json") == 0
    lines = readme.read_text(encoding="utf-8").splitlines()
    assert lines[:2] == ["before", "<!-- figures: begin; x -->"]
    assert lines[-2:] == ["<!-- figures: end -->", "after"]
    assert "old" not in lines
    stored = json.loads((tmp_path / "results" / "readme.json").read_text(encoding="utf-8"))
    assert tool.block(stored) == tool.block(_summary())
    assert stored["commit"]
    readme.write_text("no block\n", encoding="utf-8")
    with pytest.raises(ValueError, match="no marked block"):
        tool.main("summary.json")
