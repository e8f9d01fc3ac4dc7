"""Files of ``reproduce online``: a truth for every way in which a plan is wrong, a cell file for every correction."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app import examples
from counterflex.app.proof import simulate
from counterflex.core.atomic import write_text
from counterflex.files.cell.cell import read_cell
from counterflex.files.schema import write_toml
from counterflex.geometry import pose
from counterflex.robot.elasticity.chain import forward
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.plant.plant import Plant
from counterflex.twin.plant.setup import touched_part_frame
from counterflex.twin.truth.file import read_truth, write_truth
from counterflex_lab.reproduce.fiducials import tracker_table
from counterflex_lab.reproduce.wrong_plans import WRONG, cell_table

PROGRAM: Final = "groove.ngc"
CATALOGUE: Final = "catalogue.toml"
"""Cell file before any measurement."""
TRUTH: Final = "truth.toml"
TOUCHED: Final = "touched.toml"
"""Truth at the time when the part was touched, where it has drifted since."""
_LIMITS: Final[dict[str, Any]] = {"correction_mm": 3.0, "speed_mm_s": 60.0, "acceleration_mm_s2": 4000.0}

_NO_PLAN: Final[dict[str, Any]] = {"force": "measured", "along_feed": True}
"""Only a plan tells the direction of the feed; a loop that watches needs none."""
_FUSED: Final[dict[str, Any]] = {"force": "fused", "noise_um": 200.0}
"""A tracker sees the arm swing about where it stands, for much longer than the cycle in which a sample comes. With the
noise of 60 um that is the default, the estimator follows the swing."""


@dataclass(frozen=True)
class Way:
    """One way of correcting.

    Attributes:
        title: For people.
        online: What stands in ``[online]`` beside the limits.
        compensated: The robot runs the compensated program.
        armed: The loop acts; else it only watches.
        force: The force sensor is wired.
        tracker: The tracker is wired.
    """

    title: str
    online: dict[str, Any]
    compensated: bool = True
    armed: bool = True
    force: bool = True
    tracker: bool = False


WAYS: Final[dict[str, Way]] = {
    "uncompensated": Way("original program, nothing corrected", _NO_PLAN, compensated=False, armed=False),
    "plan": Way("compensated program alone", {"force": "measured"}, armed=False),
    "force": Way("and the measured force, less the planned one", {"force": "measured"}),
    "pilot": Way("and the measured force with pilot control", {"force": "pilot"}),
    "hybrid": Way("and the planned force scaled by the measured one", {"force": "scale"}),
    "tracker": Way("and a tracker, without a force sensor", _FUSED, force=False, tracker=True),
    "all": Way("and force and tracker in one estimator", _FUSED, tracker=True),
}
"""Columns of the table. All but the first run the compensated program."""


def catalogue_cell(folder: Path) -> Path:
    """Write program and the cell file before any measurement: without play and drives, which no catalogue states."""
    table = tomllib.loads(examples.small())
    table["robot"] = {key: value for key, value in table["robot"].items() if key not in ("play", "servo")}
    write_text(folder / PROGRAM, examples.text(PROGRAM))
    write_toml(folder / CATALOGUE, table)
    return folder / CATALOGUE


def write_case(place: Path, row: str, identified: Path, truth: Path, catalogue: Path, seed: int) -> None:
    """Write the truth of a row and the cell files of all ways.

    Args:
        place: Folder of the row; made when missing.
        row: Of :data:`~counterflex_lab.reproduce.wrong_plans.WRONG`.
        identified: Cell file that the plan was made from.
        truth: Truth that it was identified on.
        catalogue: Cell file before any measurement.
        seed: Of the laboratory.
    """
    place.mkdir(parents=True, exist_ok=True)
    wrong, before = WRONG[row], read_truth(truth)
    now = wrong.truth(read_cell(catalogue), before)
    write_truth(place / TRUTH, now)
    touched = before if wrong.since_touched else now
    if wrong.since_touched:
        write_truth(place / TOUCHED, touched)
    base = cell_table(tomllib.loads(identified.read_text(encoding="utf-8")), wrong)
    bare = place / "cell.toml"
    write_toml(bare, {key: value for key, value in base.items() if key not in ("online", "tracker")})
    cell = read_cell(bare)
    plant, controller = Plant(touched), simulate.controller(cell)
    T_base_part, _ = touched_part_frame(plant, controller, cell.datum_points_part)
    lab = laboratory(seed)
    q = controller.joints(cell.datum_points_part[:1], np.array([[0.0, 0.0, 1.0]]))[0]
    shown = pose.inverse(cell.T_base_part) @ forward(cell.controller_chain, q)
    tilt = shown[:3, :3].T @ (pose.inverse(T_base_part) @ plant.equilibrium(q))[:3, :3]
    # The target's axes are calibrated where the robot stands at the part, its sag included.
    lab = replace(lab, T_tcp_target=pose.make(tilt) @ lab.T_tcp_target)
    seen = tracker_table(cell, lab, T_base_part)
    for name, way in WAYS.items():
        write_toml(place / cell_name(name), {**base, "tracker": seen, "online": {**_LIMITS, **way.online}})


def cell_name(way: str) -> str:
    """File name of the cell of a way of correcting."""
    return f"cell-{way}.toml"
