"""``inspect`` names what it did not see, and what all faces have in common: scale, ball, table and vice."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import trimesh

from counterflex.core.arrays import Float


def _sibling(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


made = _sibling("test_inspect_command")


@pytest.fixture
def work(folder: Path) -> Path:
    """A folder with the program beside the cell."""
    (folder / "groove.ngc").write_text(made.PROGRAM)
    return folder


def centres(count: int, radius_mm: float) -> Float:
    """Centres of a ball that touches the part as made, part frame, mm."""
    points, face = trimesh.sample.sample_surface(made.part_mesh(), count, seed=2)
    moved = points + radius_mm * made.part_mesh().face_normals[face]
    out: Float = moved[points[:, 2] > 0.3]
    return out


def write_table(path: Path, points: Float) -> None:
    """x, y, z with a header."""
    np.savetxt(path, points, delimiter=",", header="x,y,z", comments="", fmt="%.5f")


@pytest.mark.parametrize("end", [14.0, 18.0])
def test_half_a_scan_is_told_in_mm2(work: Path, counterflex: Callable[..., Any], end: float) -> None:
    """The groove is scanned up to x = end: its area beyond, by plain geometry, is not scanned."""
    points = made.measured()
    made.write(work / "s.ply", made.tilted(points[points[:, 0] < end]))
    ended = counterflex(*made.COMMAND, "--scan", "s.ply")
    assert ended.status == 0, ended.err
    summary = json.loads(Path("out/deep/summary.json").read_text())
    area = summary["parts"]["part"]["coverage"]
    radius, depth, middle = 8.0, 3.0, 22.0
    unseen = (middle - end) * (2.0 * radius + 2.0 * depth) + np.pi * radius * (0.5 * radius + depth)
    assert abs(area["unseen_mm2"] - unseen) < 0.05 * unseen
    assert area["features"]["groove 1"]["unseen_mm2"] == area["unseen_mm2"]
    assert abs(sum(area[f"{k}_mm2"] for k in ("judged", "unjudged", "unseen")) - area["machined_mm2"]) < 0.3
    assert "NOT SCANNED" in ended.out
    assert "% seen" in ended.out
    page = Path("out/deep/report.html").read_text()
    assert "measured in part only" in page or "out of tolerance" in page
    assert "not scanned at all" in page
    share = made.row(summary, "width")["measured_share"]
    assert share < 0.95 * end / middle + 0.1


def test_a_whole_scan_is_not_called_half(work: Path, counterflex: Callable[..., Any]) -> None:
    made.write(work / "s.ply", made.tilted(made.measured()))
    ended = counterflex(*made.COMMAND, "--scan", "s.ply")
    assert ended.status == 0, ended.err
    assert "% seen" not in ended.out
    assert "measured in part" not in ended.out


@pytest.mark.parametrize("scale", [1.0, 1.0002, 0.9994])
def test_the_scale_of_a_scan_is_estimated(work: Path, counterflex: Callable[..., Any], scale: float) -> None:
    made.write(work / "s.ply", made.tilted(made.measured() * scale))
    ended = counterflex(*made.COMMAND, "--scan", "s.ply")
    assert ended.status == 0, ended.err
    entry = json.loads(Path("out/deep/summary.json").read_text())["parts"]["part"]["scan"]["scale"]
    error = entry["percent"] - 100.0 * (scale - 1.0)
    assert abs(error) < 3.0 * entry["standard_deviation_percent"]
    assert entry["standard_deviation_percent"] < 0.004
    assert entry["directions_agree"] == ["x", "y"]
    assert ("um over 100 mm" in ended.out) == (scale != 1.0)


def test_a_long_blank_is_no_scale(work: Path, counterflex: Callable[..., Any]) -> None:
    """A blank sawn 0.04 mm too long in x, and right in y."""
    points = made.measured()
    points = np.where(points[:, :1] > 35.0, points + np.array([0.04, 0.0, 0.0]), points)
    made.write(work / "s.ply", made.tilted(points))
    ended = counterflex(*made.COMMAND, "--scan", "s.ply")
    assert ended.status == 0, ended.err
    assert "the blank is of another size" in ended.out
    assert "um over 100 mm" not in ended.out


@pytest.mark.parametrize("count", [400, 40_000])
@pytest.mark.parametrize("diameter", [2.0, 3.0])
def test_centres_of_a_ball_are_named_and_taken_off(
    work: Path, counterflex: Callable[..., Any], refused: Callable[..., str], count: int, diameter: float
) -> None:
    write_table(work / "ball.csv", centres(count, 0.5 * diameter))
    line = refused(*made.COMMAND, "--scan", "ball.csv", "--aligned")
    assert "every face of the scan lies outside" in line
    assert "--ball-diameter-mm" in line
    ended = counterflex(
        *made.COMMAND, "--scan", "ball.csv", "--aligned", "--ball-diameter-mm", f"{diameter:g}", "--json"
    )
    assert ended.status == 0, ended.err
    depth = made.row(json.loads(ended.out), "depth")["mean_mm"]
    assert abs(depth - made.DEPTH) < 0.005
    if count > 1000:
        made.expect_groove(json.loads(ended.out))


def test_centres_of_a_ball_laid_on_datum_faces_are_named(work: Path, refused: Callable[..., str]) -> None:
    made.write(work / "s.ply", made.tilted(centres(40_000, 0.5)))
    line = refused(*made.COMMAND, "--scan", "s.ply")
    assert "--ball-diameter-mm" in line


def on_a_table(vice: bool, seed: int = 3) -> Float:
    """The part on a table three times as large, between the jaws of a vice; where they touch nothing is seen."""
    rng = np.random.default_rng(seed)
    part = made.measured()
    flat = np.column_stack([rng.uniform(-60, 100, 40_000), rng.uniform(-50, 90, 40_000), np.zeros(40_000)])
    flat = flat[(flat[:, 0] < 0) | (flat[:, 0] > 40) | (flat[:, 1] < 0) | (flat[:, 1] > 30)]
    pieces = [flat + rng.normal(scale=0.01, size=flat.shape)]
    if vice:
        for low, high in ((30.02, 48.0), (-18.0, -0.02)):
            jaw = trimesh.creation.box(bounds=[[5.0, low, 0.0], [35.0, high, 12.0]])
            points = trimesh.sample.sample_surface(jaw, 12_000, seed=seed)[0]
            touching = np.minimum(np.abs(points[:, 1] - 30.02), np.abs(points[:, 1] + 0.02)) < 0.01
            pieces.append(points[(points[:, 2] > 0.3) & ~touching])
        held = (part[:, 0] > 5.0) & (part[:, 0] < 35.0) & (part[:, 2] < 12.0)
        part = part[~(held & ((part[:, 1] < 0.1) | (part[:, 1] > 29.9)))]
    return np.concatenate([part, *pieces])


@pytest.mark.long
@pytest.mark.parametrize("vice", [False, True])
def test_table_and_vice_are_cut_away(work: Path, counterflex: Callable[..., Any], vice: bool) -> None:
    made.write(work / "s.ply", made.tilted(on_a_table(vice)))
    ended = counterflex(*made.COMMAND, "--scan", "s.ply")
    assert ended.status == 0, ended.err
    assert "lie beside the blank and are cut away" in ended.out
    summary = json.loads(Path("out/deep/summary.json").read_text())
    made.expect_groove(summary, tolerance_mm=0.012)
    assert summary["parts"]["part"]["scan"]["unit"] == "mm"
