"""Faces of a STEP file, measured on scans of simulated parts, have the figures that ``evaluate`` has of the same part.

Each part is machined on the simulated cell, its surface meshed from the path that the tool ran, sampled with 5 um of
noise, holes and outliers, and laid on faces of the blank. The solids are built from the drawing by Open CASCADE.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import trimesh

import scan
import step_parts
from counterflex.app.inputs import read_job
from counterflex.app.inspection.judging import How, inspect
from counterflex.app.proof import judge, simulate
from counterflex.app.proof.cut_logs import log_of_run, top_of
from counterflex.app.proof.truth import truth_of
from counterflex.core.remarks import collected
from counterflex.core.units import MM, UM
from counterflex.cutting.tridexel.columns import ColumnStock
from counterflex.cutting.tridexel.surface import surface as surface_of
from counterflex.evaluate.features import FeatureRow, Machined, measure_features, uncovered
from counterflex.evaluate.prismatic.finding import find_prismatic
from counterflex.files.cell.cell import read_cell
from counterflex.twin.truth.family import family_of

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CELL = EXAMPLES / "cells/kr300_d16_small.toml"
GOAL_UM = 10.0
POINTS = 500_000
box, cylinder, less = step_parts.box, step_parts.cylinder, step_parts.less


def blank() -> Any:
    return box((0, 0, 0), (60, 60, 40))


def grooved() -> Any:
    return less(blank(), box((-1, 7, 34), (61, 23, 41)))


def boss() -> Any:
    """A boss of 28 mm in a ring that the roughing cut made, with the ways in of both cuts."""
    ring = less(cylinder((30, 30, 32), 33.0, 10.0), cylinder((30, 30, 31), 14.0, 12.0))
    return less(blank(), ring, box((-3, -9, 32), (13, 30, 41)), box((-9, 22, 32), (8, 38, 41)))


@dataclass(frozen=True)
class Case:
    program: str
    solid: Callable[[], Any]
    unit: str
    names: dict[str, tuple[float, ...]]  # of faces, by kind of place: normal or axis, and place along it, mm
    pairs: tuple[
        tuple[str, str, str, str, float], ...
    ]  # face, quantity, feature and quantity of evaluate, sign: it counts walls and depths into the material


SIDES = (("right", "position", "groove 1", "wall right", -1.0), ("left", "position", "groove 1", "wall left", -1.0))
FLOOR = ("floor", "position", "groove 1", "depth", -1.0)
ROUND = ("diameter", "roundness", "centre")
CASES = {
    "groove": Case(
        "groove.ngc",
        grooved,
        "MM",
        {"right": (1, 7.0), "left": (1, 23.0), "floor": (2, 34.0)},
        (*SIDES, FLOOR),
    ),
    "free form": Case(
        "groove.ngc",
        lambda: step_parts.occ("BRepBuilderAPI_NurbsConvert")(grooved()).Shape(),
        "MM",
        {"right": (1, 7.0), "left": (1, 23.0), "floor": (2, 34.0)},
        tuple((face, "profile", feature, wall, sign) for face, _, feature, wall, sign in (*SIDES, FLOOR)),
    ),
    "pocket": Case(
        "pocket_grooves.ngc",
        lambda: less(
            blank(), box((-1, 3, 36), (61, 19, 41)), box((48, -1, 37), (58, 61, 41)), cylinder((30, 38, 37), 12.0, 10.0)
        ),
        "INCH",
        {"right": (1, 3.0), "left": (1, 19.0), "floor": (2, 36.0), "bore": (24.0,)},
        (*SIDES, FLOOR, *(("bore", name, "pocket 1", name, 1.0) for name in ROUND)),
    ),
    "boss": Case("boss.ngc", boss, "M", {"pin": (28.0,)}, tuple(("pin", name, "boss 1", name, 1.0) for name in ROUND)),
}


def named(case: Case, face: Any) -> str:
    """Name of a face: of a flat one by its axis and place, of a cylinder by its diameter."""
    surface = step_parts.occ("BRepAdaptor_Surface")(step_parts.occ("TopoDS").Face(face))
    kind = surface.GetType().name
    for name, key in case.names.items():
        if kind.endswith("_Cylinder") and len(key) == 1 and abs(2.0 * surface.Cylinder().Radius() - key[0]) < 1e-6:
            return name
        if not kind.endswith("_Cylinder") and len(key) == 2:
            axis = int(key[0])
            if abs(step_parts.centre(face)[axis] - key[1]) < 1e-6 and step_parts.thickness(face, axis) < 1e-3:
                return name
    return ""


def made(case: Case) -> tuple[trimesh.Trimesh, dict[tuple[str, str], FeatureRow]]:
    """The machined part, mm, and its features as ``evaluate`` measures them on the path that the tool ran."""
    cell = read_cell(CELL)
    job = read_job(EXAMPLES / "programs" / case.program, cell)
    run = simulate.machine(job, cell, truth_of(cell, 1001, family_of("mild")))
    reference = judge.reference_of(job, cell)
    judged = judge.judge(reference, run, run.stock)
    surface = reference.surface
    assert surface is not None
    path, candidates = job.path.p_part_tcp, judge.candidates_of(job.path, cell)
    parts = {"part": Machined(judged.actual, judged.deviation.p_part_actual, judged.joined,
                              reference.outline_at(judged.deviation.motion))}  # fmt: skip
    rows = measure_features(surface, path, candidates, parts, outline=reference.outline)
    found = find_prismatic(surface, *uncovered(surface, candidates, rows)[1:])
    rows += measure_features(surface, path, found, parts, outline=reference.outline)
    top = top_of(cell, path, run.p_part_tcp)
    whole = surface_of(ColumnStock.of(run.stock), log_of_run(run, job.path, cell, top))
    mesh = trimesh.Trimesh(whole.vertices / MM, whole.triangles, process=False)
    return mesh, {(row.feature, row.quantity): row for row in rows}


@pytest.mark.parametrize("name", ["groove", *(pytest.param(one, marks=pytest.mark.long) for one in list(CASES)[1:])])
def test_faces_have_the_figures_of_evaluate(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = CASES[name]
    monkeypatch.setattr(scan, "NOISE_MM", 0.005)
    mesh, true = made(case)
    points = scan.scan_of(mesh, POINTS)
    scan.write_ply(tmp_path / "scan.ply", [points], len(points))
    solid = case.solid()
    step_parts.write_step(
        tmp_path / "part.step",
        [solid],
        lambda face: named(case, face),
        unit=case.unit,
        zones=[("floor", "Flatness", 0.2), ("left", "Straightness", 0.1)] if name == "groove" else (),
    )
    with collected() as remarks:
        done = inspect(
            EXAMPLES / "programs" / case.program,
            CELL,
            tmp_path / "scan.ply",
            how=How(datum=scan.FACES),
            nominal=tmp_path / "part.step",
            tolerances_m={(case.pairs[0][0], case.pairs[0][1]): 0.7 * MM},
        )
    got = {(row.feature, row.quantity): row for row in done.features}
    for face, quantity, feature, other, sign in case.pairs:
        mine, its = got[face, quantity], true[feature, other]
        for ours, theirs in ((mine.mean_m, its.mean_m), (mine.worst_m, its.worst_m)):
            off = sign * (theirs["part"] - its.nominal_m)
            assert abs(ours["part"] - mine.nominal_m - off) < GOAL_UM * UM, (face, quantity, ours, theirs)
        assert mine.standard_deviation_m["part"] > 0.0
    assert got[case.pairs[0][:2]].tolerance_source == "given"
    if name == "groove":
        assert got["floor", "flatness"].tolerance_source == "PMI of part.step"
        assert got["floor", "flatness"].tolerance_m == pytest.approx(0.2 * MM)
        assert got["left", "position"].tolerance_source == "ISO 2768-1 m"
        assert any("Straightness" in text and "not looked at" in text for text in remarks)
        assert not any(row.feature.startswith("face") for row in done.features)  # faces that the program leaves alone
