"""Datasets and proposals hold axes as the controller shows them, the model its own angles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.identification.cell_model import (
    in_model_angles,
    model_columns,
    shown_channels,
    shown_columns,
)
from counterflex.app.identification.propose import propose
from counterflex.core.errors import FileFormatError
from counterflex.core.units import DEG
from counterflex.files.cell.cell import read_cell
from counterflex.files.dataset.reader import read_dataset
from counterflex.robot.model.controller_axes import ControllerAxes, room

FANUC = Path("examples/cells/fanuc_r2000ic.toml")


def fanuc() -> ControllerAxes:
    return read_cell(FANUC).robot.axes


def dataset(folder: Path, lines: str = "", count: int = 6) -> Path:
    """One pull at axes as a FANUC shows them."""
    names = [f"j{i}" for i in range(1, count + 1)]
    (folder / "d.csv").write_text(
        ",".join([*names, "fx", "fy", "fz", "dx", "dy", "dz"]) + "\n"
        + ",".join([*["0", "-20", "-36", "0", "-50", "0"][:count], "0", "0", "100", "0", "0", "0.1"]) + "\n",
        encoding="ascii",
    )  # fmt: skip
    (folder / "d.toml").write_text(
        'format = "counterflex-dataset"\nversion = 1\nname = "d"\nkind = "pulls"\n[[files]]\npath = "d.csv"\n'
        f'[channels.q]\ncolumns = {names}\nunit = "deg"\nsigma = 0.1\n{lines}'
        '[channels.f_tcp_base]\ncolumns = ["fx", "fy", "fz"]\nunit = "N"\n'
        '[channels.d_tcp_base]\ncolumns = ["dx", "dy", "dz"]\nunit = "mm"\n',
        encoding="ascii",
    )
    return folder / "d.toml"


def test_axes_of_a_dataset_become_angles_of_the_model(tmp_path: Path) -> None:
    data = in_model_angles(read_dataset(dataset(tmp_path)), fanuc())
    np.testing.assert_allclose(data.values("q")[0] / DEG, [0.0, -20.0, -56.0, 0.0, -50.0, 0.0], atol=1e-9)
    sigma = data.channel("q").sigma
    assert sigma is not None
    np.testing.assert_allclose(sigma[0] / DEG, [0.1, 0.1, 0.1 * np.sqrt(2.0), 0.1, 0.1, 0.1])


def test_a_manifest_that_says_the_coupling_is_left_as_it_is(tmp_path: Path) -> None:
    rows = np.eye(6, dtype=int)
    rows[2, 1] = 1
    data = read_dataset(dataset(tmp_path, f"coupling = {rows.tolist()}\n"))
    np.testing.assert_array_equal(in_model_angles(data, fanuc()).values("q"), data.values("q"))
    assert data.values("q")[0, 2] / DEG == pytest.approx(-56.0)


def test_columns_and_channels_go_there_and_back() -> None:
    axes = fanuc()
    q = np.random.default_rng(1).normal(size=(5, 6))
    columns = {f"q{i + 1}_rad": q[:, i] for i in range(6)} | {"force_n": np.ones(5)}
    shown = shown_columns(columns, axes)
    np.testing.assert_allclose(shown["q3_rad"], q[:, 2] - q[:, 1])
    back = model_columns(shown, axes)
    for name, values in columns.items():
        np.testing.assert_allclose(back[name], values, atol=1e-12)
    np.testing.assert_allclose(shown_channels({"q": q, "w": q}, axes)["q"], axes.shown(q))
    np.testing.assert_array_equal(shown_channels({"w": q}, axes)["w"], q)


def test_a_proposal_asks_for_axes_within_the_controllers_limits(tmp_path: Path) -> None:
    cell = read_cell(FANUC)
    file = propose("stiffness", 6, FANUC, tmp_path / "p", settings={})
    rows = (file.parent / "proposal.csv").read_text(encoding="utf-8").splitlines()
    names = rows[0].split(",")
    at = [names.index(f"q{i}_deg") for i in range(1, 7)]
    shown = np.array([[float(row.split(",")[k]) for k in at] for row in rows[1:]]) * DEG
    limits = cell.robot.axes.limits_rad
    assert limits is not None
    assert np.all(shown > limits[:, 0])
    assert np.all(shown < limits[:, 1])
    assert np.all(room(cell.robot.axes, cell.robot.joint_limits_rad, cell.robot.axes.model(shown)) > 0.0)


def test_too_few_axes_of_a_coupled_arm_are_refused(tmp_path: Path) -> None:
    data = read_dataset(dataset(tmp_path))
    channel = data.channel("q")
    short = replace(data, channels={**data.channels, "q": replace(channel, values=channel.values[:, :3], sigma=None)})
    with pytest.raises(FileFormatError, match=r"axes of this robot depend on each other"):
        in_model_angles(short, fanuc())
