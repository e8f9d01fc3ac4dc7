"""The experiment of Mandiola2023 on the simulated cell: programs, cell file, truth, and where the tracker stands.

Square of 400 mm and circle of 150 mm radius at 700 mm/min in the plane, in the air. The robot is the one of the
demonstration cell with drives that trail their reference (Kv 11 1/s, chosen for the errors above 1 mm that the paper
reports in motion); its part frame is touched with the robot at one corner of the square, so that static errors of some
tenths grow away from there, and the tracker sees fiducials around the part.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app import examples
from counterflex.app.inputs import read_job
from counterflex.app.proof import simulate
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.atomic import write_text
from counterflex.core.units import MM, MS
from counterflex.files.cell.cell import read_cell
from counterflex.files.schema import write_toml
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.plant.plant import Plant
from counterflex.twin.plant.simulate import touched_part_frame
from counterflex.twin.truth.file import write_truth
from counterflex.twin.truth.perturb import perturbed
from counterflex_lab.reproduce.fiducials import tracker_table

SIDE_M: Final = 400.0 * MM
RADIUS_M: Final = 150.0 * MM
FEED_MM_MIN: Final = 700.0
KV_PER_S: Final = 11.0
PERIOD_S: Final = 4.0 * MS
DEAD_S: Final = 8.0 * MS
"""Two cycles until a set-point reaches the drives."""
RUN_IN_DEG: Final = 10.0
DWELL_S: Final = 4.0
_TOUCHED: Final = 0.5
"""Part of the square, at its first corner, where the robot touched the part: its error grows away from there."""

_COMMON: Final[dict[str, Any]] = {
    "force": "none",
    "along_feed": True,
    "orientation": True,
    "correction_mm": 4.0,
    "correction_deg": 0.6,
    "speed_mm_s": 80.0,
    "acceleration_mm_s2": 4000.0,
    "hard_factor": 1.5,
    "dead_ms": 10.0,
    "natural_hz": 8.2,
    "damping": 2.40,
    "tracker_age_ms": 0.0,
}
"""What the cell knows. Dead time: two cycles and half of one, over which a set-point is approached. Lag of a correction
93 ms, 4 % short of what 1/Kv and the speed loop of 150 1/s add up to, as an identification may be."""

VARIANTS: Final[dict[str, dict[str, Any]]] = {
    "off": {"tracker": "integrator"},
    "published": {"tracker": "integrator", "tracker_gain": 0.01, "tracker_step_um": 50.0},
    "designed": {
        "tracker": "designed",
        "tracker_age_ms": 1.5,
        "follow_ms": 97.2,
        "follow_lag_ms": 90.9,
        "undo_lag_mm": 2.5,
    },
}


@dataclass(frozen=True)
class Case:
    """Files of one truth."""

    folder: Path  # where they lie
    seed: int  # of truth and laboratory
    scale: float  # size of the paths, 1 is the paper's

    @property
    def truth(self) -> Path:
        """Truth file."""
        return self.folder / "truth.toml"

    def program(self, shape: str) -> Path:
        """G-code of ``square`` or ``circle``."""
        return self.folder / f"{shape}.ngc"

    def plan(self, shape: str) -> Path:
        """Plan file of a shape, in a folder of its own beside the truths: no truth shows in it."""
        return self.folder.parent / f"{shape}-plan" / "plan.parquet"

    @property
    def bare_cell(self) -> Path:
        """Cell file without tracker and loop: the same for every truth."""
        return self.folder / "cell-bare.toml"

    def cell(self, variant: str) -> Path:
        """Cell file of a variant."""
        return self.folder / f"cell-{variant}.toml"

    @property
    def corners(self) -> Float:
        """(7, 3) m, points of the square's program: four sides and a run-out along the first."""
        h = 0.5 * SIDE_M * self.scale
        out = 0.25 * h
        return np.array([[-h, -h, 0], [h, -h, 0], [h, h, 0], [-h, h, 0], [-h, -h, 0], [-h + out, -h, 0]])

    @property
    def radius_m(self) -> float:
        """Of the circle."""
        return RADIUS_M * self.scale


def write_case(folder: Path, seed: int, *, scale: float = 1.0) -> Case:
    """Write programs, truth and the cell files of all variants.

    Args:
        folder: Made when missing.
        seed: Of truth and laboratory.
        scale: Size of the paths.
    """
    folder.mkdir(parents=True, exist_ok=True)
    case = Case(folder, seed, scale)
    write_text(case.program("square"), _square(case.corners / MM))
    write_text(case.program("circle"), _circle(case.radius_m / MM))
    bare = _cell_table(scale)
    write_toml(case.bare_cell, bare)
    cell = read_cell(case.bare_cell)
    nominal = truth_of(cell, None)
    drives = tuple(replace(d, following_gain_per_s=KV_PER_S) for d in nominal.drives)
    truth = perturbed(replace(nominal, drives=drives), seed)
    write_truth(case.truth, truth)
    lab = laboratory(seed)
    read_job(case.program("square"), cell)
    controller = simulate.controller(cell)
    T_base_part, _ = touched_part_frame(Plant(truth), controller, cell.datum_points_part)
    tracker = tracker_table(cell, lab, T_base_part)
    for name, online in VARIANTS.items():
        write_toml(case.cell(name), {**bare, "tracker": tracker, "online": {**_COMMON, **online}})
    return case


def known_cell(variant: str) -> dict[str, Any]:
    """Tables of a cell file with what the loop knows of the robot, without a tracker that any truth has placed.

    Args:
        variant: Of :data:`VARIANTS`.
    """
    return {**_cell_table(1.0), "online": {**_COMMON, **VARIANTS[variant]}}


def _cell_table(scale: float) -> dict[str, Any]:
    data = tomllib.loads(examples.text("cell.toml"))
    h = 0.5 * SIDE_M / MM * scale
    t = 2.0 * h * _TOUCHED
    data["name"] = "KR 300 R2500 ultra with trailing drives, tracker beside it"
    data["part"] = {
        "x_mm": 1450.0,
        "y_mm": 0.0,
        "z_mm": 1000.0,
        "measured_with": "robot",
        "datum_points_mm": [[-h, -h, 0.0], [-h + t, -h, 0.0], [-h + t, -h + t, 0.0], [-h, -h + t, 0.0]],
        "stock": {"box_min_mm": [-10.0, -10.0, -80.0], "box_max_mm": [10.0, 10.0, -60.0], "cell_mm": 1.0},
    }
    data["controller"] = {"cycle_ms": 4.0, "blending_mm": 0.0, "acceleration_mm_s2": 250.0, "rapid_mm_s": 250.0}
    return data


def _square(corners_mm: Float) -> str:
    first, *rest = corners_mm
    lines = [_HEAD, f"G0 X{first[0]:.4f} Y{first[1]:.4f} Z0", f"G4 P{DWELL_S:g}"]
    lines += [f"G1 X{x:.4f} Y{y:.4f} F{FEED_MM_MIN:g}" for x, y, _ in rest]
    return "\n".join([*lines, "M30", ""])


def _circle(radius_mm: float) -> str:
    end = np.deg2rad(2.0 * RUN_IN_DEG)
    x, y = radius_mm * np.cos(end), radius_mm * np.sin(end)
    return "\n".join(
        [
            _HEAD,
            f"G0 X{radius_mm:.4f} Y0 Z0",
            f"G4 P{DWELL_S:g}",
            f"G3 X{-radius_mm:.4f} Y0 I{-radius_mm:.4f} J0 F{FEED_MM_MIN:g}",
            f"G3 X{radius_mm:.4f} Y0 I{radius_mm:.4f} J0",
            f"G3 X{x:.6f} Y{y:.6f} I{-radius_mm:.4f} J0",
            "M30",
            "",
        ]
    )


_HEAD: Final = "(path in the air after Mandiola 2023)\nG21 G17 G90 G54\nM6 T1\nM3 S1000"
