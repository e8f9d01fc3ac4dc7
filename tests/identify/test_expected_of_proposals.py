"""What a proposal promises: standard deviations with their units, those that a fit then has."""

from __future__ import annotations

import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.app.proof.truth import truth_of
from counterflex.core.progress import silent
from counterflex.files.cell.cell import read_cell
from counterflex.identify.data.dataset import of_arrays
from counterflex.identify.recipes import RECIPES
from counterflex.identify.tracker_frame import recipe as tracker_frame
from counterflex.twin.laboratory import fiducials as measure_fiducials
from counterflex.twin.laboratory.laboratory import laboratory

FILE = read_cell("examples/cells/kr300_d16_small.toml")
CELL = model_of(FILE)


@pytest.mark.parametrize(
    "name", ["tracker-frame", "kinematics", "stiffness", "cubes", "play", "timing", "servo", "payload", "cutting"]
)
def test_every_expected_standard_deviation_has_a_unit(name: str) -> None:
    found = RECIPES[name]
    proposal = found.propose(CELL, 12, {**found.settings, "seed": 1})
    assert proposal.expected
    assert set(proposal.units) == set(proposal.expected)
    assert all(sigma > 0.0 for sigma in proposal.expected.values())


def test_frame_from_fiducials_is_known_as_well_as_promised() -> None:
    proposal = RECIPES["tracker-frame"].propose(CELL, 8, {"measure": "fiducials"})
    measured = measure_fiducials.measure(truth_of(FILE, 0), laboratory(1), proposal.columns, {}, silent)
    data = of_arrays("fiducials", "fiducials", measured.channels, measured.sigma, group=measured.group)
    fit = tracker_frame.RECIPE.identify(CELL, [data], [], {}, silent).fits["tracker-frame"]
    # The tracker stands at its own place, not at the robot's foot as foreseen: turns have the same standard
    # deviations, of which those about x, y and z swap with the tracker's heading.
    promised = sorted(proposal.expected[f"T_base_tracker.r{axis}"] for axis in "xyz")
    found = sorted(fit.sigma_of(f"T_base_tracker.r{axis}") for axis in "xyz")
    assert found == pytest.approx(promised, rel=0.5)
