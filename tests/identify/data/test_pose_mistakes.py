"""What manifests of hand-eye poses get wrong on real data (UR10): quaternion order, angles, units of the flange."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.core.errors import CounterflexError, FileFormatError, InputError
from counterflex.core.units import DEG
from counterflex.files.cell.cell import read_cell
from counterflex.files.dataset.reader import read_dataset
from counterflex.geometry import rotation
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.identify.geometry.tracker_data import _FORMS, check_tracker_data, euler_mistakes

EXAMPLES = Path(__file__).parents[3] / "examples"
UR10 = EXAMPLES / "data/ur10_ipa_tmac"


@pytest.fixture(scope="module")
def cell() -> CellModel:
    return model_of(read_cell(EXAMPLES / "cells/ur10_ipa_tmac.toml"))


def stated(folder: Path, *changes: tuple[str, str]) -> Dataset:
    shutil.copy(UR10 / "hand_eye.csv", folder)
    text = (UR10 / "hand_eye.toml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (folder / "m.toml").write_text(text)
    return read_dataset(folder / "m.toml")


def test_as_published_nothing_is_suspected(tmp_path: Path, cell: CellModel) -> None:
    assert check_tracker_data(cell, stated(tmp_path)) == ()


@pytest.mark.by_turn
@pytest.mark.parametrize(
    ("change", "channel", "says"),
    [
        (('"quat_xyzw"', '"quat_wxyz"'), "R_base_flange", "in the order xyzw, not wxyz"),
        (('"m"', '"mm"'), "p_base_flange", "not those of this robot"),
        (('"xyz_intrinsic"', '"xyz_fixed"'), "R_tracker_target", "angles about x, y', z''"),
    ],
)
def test_a_mistake_is_named_with_its_own_channel(
    tmp_path: Path, cell: CellModel, change: tuple[str, str], channel: str, says: str
) -> None:
    with pytest.raises(InputError) as fault:
        check_tracker_data(cell, stated(tmp_path, change))
    assert says in str(fault.value)
    assert f"channels.{channel}" in str(fault.value)


@pytest.mark.long
def test_a_transposed_flange_is_named(tmp_path: Path, cell: CellModel) -> None:
    data = stated(tmp_path)
    old = data.channel("R_base_flange")
    turned = of_arrays("a", "tracker_poses", {"R_base_flange": np.swapaxes(old.values, 1, 2)})
    channels = {**data.channels, "R_base_flange": turned.channel("R_base_flange")}
    with pytest.raises(InputError, match="'R_base_flange' are transposed"):
        check_tracker_data(
            cell, Dataset(data.name, data.kind, channels, data.group, data.line, data.settings, where="m.toml")
        )


def test_degrees_said_to_be_radians_are_refused_where_they_are_read(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"column 'measurement_rx': the value is too large for its unit"):
        stated(tmp_path, ('unit = "deg"', 'unit = "rad"'))


def test_radians_said_to_be_degrees_have_a_reading() -> None:
    angles = np.random.default_rng(1).uniform(-1.0, 1.0, (10, 3))
    meant, read = rotation.from_zyx(angles), rotation.from_zyx(angles * DEG)
    data = of_arrays("a", "tracker_poses", {"R_tracker_target": read})
    readings = [r for r in euler_mistakes("R_tracker_target") if "in rad, not in deg" in r.says]
    off = [float(np.max(np.abs(r.change(data).values("R_tracker_target") - meant))) for r in readings]
    assert min(off) < 1e-12
    assert all('unit = "rad"' in r.remedy for r in readings)


def test_every_form_of_three_numbers_goes_there_and_back() -> None:
    """What is read by one form and meant by another has a reading that finds it: R by the numbers of R is R."""
    meant = rotation.exp(np.random.default_rng(2).uniform(-1.0, 1.0, (10, 3)))
    for numbers, matrix in _FORMS.values():
        np.testing.assert_allclose(matrix(numbers(meant)), meant, atol=1e-12)


def test_every_mistake_is_one_line(tmp_path: Path, cell: CellModel) -> None:
    with pytest.raises(CounterflexError) as fault:
        check_tracker_data(cell, stated(tmp_path, ('"m"', '"um"')))
    assert "\n" not in str(fault.value)
