"""What all test cuts share: the force sensor as stated, and what it does to the constants."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.core.errors import InputError
from counterflex.core.progress import silent
from counterflex.core.units import DEG, MM, UM
from counterflex.files.dataset.reader import read_dataset
from counterflex.identify.counted_coverage import COUNTED
from counterflex.identify.cutting.considered import SensorAccuracy, force_sensor, moved_by, runout_force
from counterflex.identify.cutting.force_forms import FORMS
from counterflex.identify.cutting.recipe import RECIPE
from counterflex.identify.cutting.residuals import SlotResiduals, geometry_parameters
from counterflex.identify.cutting.steady_cuts import pieces_of
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.recipe import Identification
from coverage_cases import slots

PERFECT = SensorAccuracy(0.0, 0.0, 0.0)
LAW = slots.law(0, known=True)


def cuts(settings: dict[str, float] | None = None, *, both_ways: bool = False) -> Dataset:
    """Slots along x, every other one along -x where asked for."""
    feed, depth = np.tile([16.0, 24.0, 36.0, 54.0, 80.0], 2) * UM, np.repeat([2.0, 3.0], 5) * MM
    n = len(feed)
    way = np.where(np.arange(n) % 2 == 1, -1.0, 1.0) if both_ways else np.ones(n)
    force = np.array([slots.force(slots.CUTTER, LAW, f / UM, d / MM, 0.0) for f, d in zip(feed, depth, strict=True)])
    arrays: dict[str, Any] = {
        "f_tcp_base": np.stack([way * force[:, 0], way * force[:, 1], force[:, 2]], axis=1),
        "feed_direction": np.stack([way, 0.0 * way, 0.0 * way], axis=1),
        "feed_rate": feed * slots.SPEED / (2.0 * np.pi) * slots.CUTTER.flutes,
        "spindle_speed": np.full(n, slots.SPEED),
        "depth": depth,
    }
    return of_arrays("cuts", "slots", arrays, {"f_tcp_base": 0.01 * np.abs(force).max()}, settings=settings)


def block_of(data: Dataset) -> tuple[SlotResiduals, np.ndarray]:
    found = pieces_of(slots.cell(), [data])
    block = SlotResiduals(found.pieces, found.cutter, FORMS[1], 30.0 * UM, LAW, 1)
    return block, (FORMS[1].parameters(LAW, 30.0 * UM) + geometry_parameters(found.pieces)).nominal


def identified(data: Dataset) -> Identification:
    settings = {"form": "kienzle-3", "folds": 2, "as_stated": True, "wear_sigma": 0.0, "runout_sigma_m": 0.0}
    return RECIPE.identify(slots.cell(), [data], [], settings, silent)


def test_a_sensor_moves_forces_in_its_own_axes() -> None:
    """Law: the columns are what a sensor that turns, mixes and scales the force does to it, seen in the feed frame."""
    data = cuts(both_ways=True)
    block, x = block_of(data)
    one = moved_by(block, x, LAW, SensorAccuracy(0.01, 0.02, 0.03), 0.0, 0.0)
    felt, way = data.values("f_tcp_base"), data.values("feed_direction")[:, 0]
    for i in range(3):
        for j in range(3):
            wrong = np.zeros_like(felt)
            wrong[:, i] = (0.01 if i == j else 0.02) * felt[:, j]
            seen = wrong * np.stack([way, way, np.ones_like(way)], axis=1)
            assert np.allclose(one[:, :, 3 * i + j], seen, atol=1e-12)
    turned = 0.03 * np.cross([0.0, 0.0, 1.0], felt) * np.stack([way, way, np.ones_like(way)], axis=1)
    assert np.allclose(one[:, :, 11], turned, atol=1e-12)


def test_wear_grows_from_the_first_piece_to_the_last_and_runout_lowers_thin_chips_most() -> None:
    block, x = block_of(cuts())
    moved = moved_by(block, x, LAW, PERFECT, 0.03, 5.0 * UM)
    assert np.all(moved[0, :, 12] == 0.0)
    assert np.allclose(moved[-1, :, 12], 0.03 * block.pieces.force[-1])
    across = runout_force(block, x, LAW, 5.0 * UM)[:5, 1] / block.pieces.force[:5, 1]
    assert np.all(across < 0.0)
    assert np.all(np.diff(across) > 0.0)
    assert across[0] == pytest.approx(-0.03, abs=0.01)  # as docs/identify/cutting.md says of 16 um
    assert np.all(runout_force(block, x, LAW, 0.0) == 0.0)


def test_what_the_manifest_states_is_taken_and_the_rest_is_called_usual(tmp_path: Path) -> None:
    sensor = force_sensor([cuts(), cuts({"force_cross_talk_sigma": 0.03})])
    assert (sensor.cross_talk, sensor.scale) == (0.03, 0.01)
    assert "cross-talk 3 % (as stated)" in sensor.text
    assert "scale 1 % per axis (usual)" in sensor.text
    in_newton = force_sensor([cuts({"force_accuracy_n": 10.0})])
    assert in_newton.shares(500.0) == (0.01, 0.01)
    assert "uncertainty 10 N (95 %) per axis (as stated)" in in_newton.text
    (tmp_path / "f.csv").write_text("Fx,Fy,Fz,dx,dy,dz,F,S,ap\n1,2,3,1,0,0,900,9000,2\n")
    channels = 'f_tcp_base={columns=["Fx","Fy","Fz"],unit="N",sigma=1.0}\nfeed_direction={columns=["dx","dy","dz"]}\n'
    channels += 'feed_rate={columns=["F"],unit="mm/min"}\nspindle_speed={columns=["S"],unit="rpm"}\n'
    channels += 'depth={columns=["ap"],unit="mm"}\n'
    head = 'format="counterflex-dataset"\nversion=1\nname="a"\nkind="slots"\nfiles=[{path="f.csv"}]\n'
    (tmp_path / "m.toml").write_text(f"{head}[settings]\nforce_alignment_deg = 0.5\n[channels]\n{channels}")
    assert force_sensor([read_dataset(tmp_path / "m.toml")]).alignment_rad == pytest.approx(0.5 * DEG)


@pytest.mark.parametrize(
    "settings",
    [
        {"force_scale_sigma": 2.0},
        {"force_cross_talk_sigma": -0.01},
        {"force_alignment_rad": float("nan")},
        {"force_accuracy_n": True},
        {"force_accuracy_n": 10.0, "force_scale_sigma": 0.01},
    ],
)
def test_a_sensor_that_cannot_be_is_refused(settings: dict[str, float]) -> None:
    with pytest.raises(InputError, match="force_|stated twice"):
        force_sensor([cuts(settings)])


def test_cutting_the_opposite_way_takes_the_cross_talk_out_and_the_report_says_so() -> None:
    one, two = (identified(cuts(both_ways=both)) for both in (False, True))
    narrow, wide = (found.fits["cutting"].sigma_of("ka") for found in (two, one))
    assert narrow < 0.6 * wide
    told = "the opposite way"
    assert any(told in r and "ka" in r for r in one.remarks)
    assert not any(told in r for r in two.remarks)
    assert COUNTED["cutting"].text in one.remarks
    assert any("alignment 1 deg per axis (usual)" in r and "force_alignment_deg" in r for r in one.remarks)
