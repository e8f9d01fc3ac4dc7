"""Several datasets on one file: other measurements of the same rows are taken, the same one twice is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.app.identification.identify import prepare
from counterflex.core.errors import InputError
from counterflex.files.dataset.reader import read_dataset
from counterflex.identify.data.data_checks import joined, joined_by_rows, require_disjoint
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.solver.holdout import fold_of_groups

CELL = Path(__file__).parents[3] / "examples" / "cells" / "kr300_d16_small.toml"
ROWS = 30
JOINTS = ", ".join(f'"q{i}"' for i in range(1, 7))
Q = f'[channels.q]\ncolumns = [{JOINTS}]\nunit = "deg"\n'
MEASURED = {
    "points": (
        "tracker_points",
        Q + '[channels.p_tracker_target]\ncolumns = ["x", "y", "z"]\nunit = "mm"\nsigma = 0.01',
    ),
    "second": (
        "tracker_points",
        Q + '[channels.p_tracker_target]\ncolumns = ["u", "v", "w"]\nunit = "mm"\nsigma = 0.01',
    ),
    "bar": ("distances", Q + '[channels.distance]\ncolumns = ["bar"]\nunit = "mm"\nsigma = 0.01'),
    "poses": (
        "tracker_poses",
        Q
        + '[channels.p_tracker_target]\ncolumns = ["x", "y", "z"]\nunit = "mm"\nsigma = 0.01\n'
        + '[channels.R_tracker_target]\ncolumns = ["rx", "ry", "rz"]\nunit = "deg"\n'
        + 'rotation = "xyz_intrinsic"\nsigma = 0.01',
    ),
    "links": (
        "record",
        '[channels.time_s]\ncolumns = ["t"]\nunit = "s"\n'
        '[channels.q_motor]\ncolumns = ["q1"]\nunit = "deg"\n[channels.q_link]\ncolumns = ["q2"]\nunit = "deg"',
    ),
    "drives": (
        "record",
        '[channels.time_s]\ncolumns = ["t"]\nunit = "s"\n'
        '[channels.q_command]\ncolumns = ["q3"]\nunit = "deg"\n[channels.q_motor]\ncolumns = ["q1"]\nunit = "deg"',
    ),
    "motors": (
        "record",
        '[channels.time_s]\ncolumns = ["t"]\nunit = "s"\n[channels.q_motor]\ncolumns = ["q1"]\nunit = "deg"',
    ),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("rows")
    rng = np.random.default_rng(1)
    names = ["t", *(f"q{i}" for i in range(1, 7)), *"xyzuvw", "rx", "ry", "rz", "bar"]
    table = rng.uniform(1.0, 80.0, (ROWS, len(names)))
    table[:, 0] = 0.01 * np.arange(ROWS)
    np.savetxt(place / "all.csv", table, fmt="%.9g", delimiter=",", header=",".join(names), comments="")
    return place


def manifest(folder: Path, what: str, rows: str = "") -> Path:
    kind, channels = MEASURED[what]
    file = folder / f"{what}{''.join(c for c in rows if c.isalnum())}.toml"
    part = f"[rows]\n{rows}\n" if rows else ""
    file.write_text(
        f'format = "counterflex-dataset"\nversion = 1\nname = "{what}"\nkind = "{kind}"\n'
        f'[[files]]\npath = "all.csv"\n{part}{channels}\n'
    )
    return file


def read(folder: Path, *what: str) -> list[Dataset]:
    return [read_dataset(manifest(folder, one)) for one in what]


@pytest.mark.parametrize("pair", [("points", "bar"), ("poses", "bar"), ("points", "second"), ("links", "drives")])
def test_other_measurements_of_the_same_rows_are_taken(folder: Path, pair: tuple[str, str]) -> None:
    require_disjoint(read(folder, *pair), [])
    require_disjoint(read(folder, *reversed(pair)), [])


@pytest.mark.parametrize(
    ("pair", "columns"),
    [
        (("points", "points"), "x, y, z"),
        (("points", "poses"), "x, y, z"),
        (("links", "motors"), "q1"),
        (("bar", "bar"), "bar"),
    ],
)
def test_the_same_measurement_twice_is_refused_with_row_and_columns(
    folder: Path, pair: tuple[str, str], columns: str
) -> None:
    for order in (pair, pair[::-1]):
        with pytest.raises(InputError, match=rf"all\.csv:2: two datasets hold the same rows .*{columns}\)"):
            require_disjoint(read(folder, *order), [])
        with pytest.raises(InputError, match="two datasets hold the same rows"):
            require_disjoint([], read(folder, *order))


@pytest.mark.parametrize("pair", [("points", "bar"), ("points", "points"), ("links", "drives")])
def test_data_and_hold_out_share_no_row_whatever_the_columns(folder: Path, pair: tuple[str, str]) -> None:
    one, other = read(folder, *pair)
    with pytest.raises(InputError, match="one as data and one as hold-out"):
        require_disjoint([one], [other])
    half, rest = manifest(folder, pair[0], "last_line = 16"), manifest(folder, pair[1], "first_line = 17")
    require_disjoint([read_dataset(half)], [read_dataset(rest)])


def test_measurements_of_one_row_are_held_out_together(folder: Path) -> None:
    """A fold that holds out a row holds out all that was measured in it; without joining, rows would be dealt apart."""
    (links,) = read(folder, "links")
    drives = read_dataset(manifest(folder, "drives", "first_line = 9"))
    apart = fold_of_groups([links.group, drives.group], seed=3)
    together = fold_of_groups([d.group for d in joined_by_rows([links, drives])], seed=3)
    line = {int(n): int(f) for n, f in zip(links.line, together[0], strict=True)}
    assert all(line[int(n)] == f for n, f in zip(drives.line, together[1], strict=True))
    before = {int(n): int(f) for n, f in zip(links.line, apart[0], strict=True)}
    assert not all(before[int(n)] == f for n, f in zip(drives.line, apart[1], strict=True))
    assert len(np.unique(np.concatenate(together))) == 5


def test_datasets_that_share_no_row_keep_their_groups(folder: Path) -> None:
    one = read_dataset(manifest(folder, "points", "last_line = 16"))
    other = read_dataset(manifest(folder, "bar", "first_line = 17"))
    for before, after in zip((one, other), joined_by_rows((one, other)), strict=True):
        assert after is before
    points, bar = joined_by_rows(joined(read(folder, "points", "bar")))
    np.testing.assert_array_equal(points.group, bar.group)
    assert len(np.unique(points.group)) == ROWS


def test_the_job_takes_points_and_distances_of_one_table(folder: Path) -> None:
    task = prepare("kinematics", [manifest(folder, "points"), manifest(folder, "bar")], CELL)
    assert [len(d) for d in task.data] == [ROWS, ROWS]
