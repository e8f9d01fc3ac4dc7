"""The program that turns reference files into the catalogue: what it takes, and that it says so."""

from __future__ import annotations

import importlib.util
import json
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from counterflex.robot.model import catalog

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("build_catalog", ROOT / "tools" / "build_catalog.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def reference(name: str, verification: str) -> dict[str, Any]:
    """A reference file with the numbers of a catalogue robot."""
    e = catalog.entry(name)
    g = e.geometry
    return {
        "id": name,
        "manufacturer": e.manufacturer,
        "model": e.model,
        "payload_kg": e.payload_kg,
        "reach_mm": None,
        "opw": {f"{k}_m": getattr(g, f"{k}_mm") / 1e3 for k in ("a1", "a2", "b", "c1", "c2", "c3", "c4")}
        | {"joint_offsets_deg": g.offsets_deg, "sign_corrections": g.signs},
        "joint_limits_deg": list(zip(e.limits.lower_deg, e.limits.upper_deg, strict=True)),
        "joint_speed_limits_deg_s": e.limits.speed_deg_s,
        "joint_accel_limits_deg_s2": [100, 50, 60, 70, 80, 90.5] if name == "abb_irb120" else None,
        "link_inertials": None,
        "fk_checks": [
            {
                "name": c.name,
                "q_deg": c.q_deg,
                "flange_position_mm": c.position_mm,
                "flange_rotation_rowmajor": c.rotation,
            }
            for c in e.checks
        ],
        "sources": ["a file", "another file (stored file id 123)"],
        "verification": verification,
        "notes": [],
    }  # fmt: skip


def test_only_confirmed_geometry_is_taken(tool: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "reference"
    (folder / "robots").mkdir(parents=True)
    for name, verification in (
        ("abb_irb120", "VERIFIED: two files agree"),
        ("abb_irb1600_6_120", "2 files, 0.5 mm apart"),
        ("kuka_kr150_2", "single source"),
        ("kuka_kr210_2", "UNVERIFIED (memory)"),
    ):
        (folder / "robots" / f"{name}.json").write_text(json.dumps(reference(name, verification)))
    table = ["robot,axis_or_element,quantity,component,value_Nm_per_rad,method,source"]
    for element in ("force sensor", "spindle and holder"):
        table += [f"KUKA KR 300 R2500 ultra,{element},s,{k} (about),{v},m,s" for k, v in (("k_C", 2e6), ("k_B", 4e6))]
        table.append(f"KUKA KR 300 R2500 ultra,{element},s,k_A (about),rigid,m,s")
    (folder / "stiffness.csv").write_text("\n".join(table))
    target = tmp_path / "out"
    monkeypatch.setattr(tool, "TARGET", target)
    tool.main(folder)
    assert sorted(p.stem for p in target.glob("*.toml")) == ["abb_irb120", "abb_irb1600_6_120"]
    made = {p.stem: tomllib.loads(p.read_text()) for p in target.glob("*.toml")}
    assert made["abb_irb120"]["sources"]["geometry"]["status"] == "VERIFIED"
    assert made["abb_irb1600_6_120"]["sources"]["geometry"]["status"] == "SECONDARY"
    assert made["abb_irb120"]["sources"]["masses"] == {"status": "not known", "source": ""}
    assert "stored file" not in made["abb_irb120"]["sources"]["geometry"]["source"]
    read = catalog.CatalogEntry.model_validate(made["abb_irb120"])
    assert read.geometry == catalog.entry("abb_irb120").geometry
    assert read.checks == catalog.entry("abb_irb120").checks
    assert read.limits.acceleration_deg_s2 == [100, 50, 60, 70, 80, 90.5]
    assert made["abb_irb120"]["sources"]["accelerations"]["status"] == "SECONDARY"
    assert made["abb_irb1600_6_120"]["sources"]["accelerations"]["status"] == "not known"
    quoted = tomllib.loads((target / "end_effectors" / "haehn2020.toml").read_text())
    assert quoted["elements"][0]["compliance_urad_per_knm"] == pytest.approx([500.0, 250.0, 0.0])
