"""What is written is read back; rotations mean the same in every convention; damaged files end in one clear line."""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.dataset.reader import read_dataset
from counterflex.files.dataset.rotation import matrices, rotation_sigma
from counterflex.files.dataset.writer import write_dataset
from counterflex.geometry import rotation

POSES = ("q", "p_tracker_target", "R_tracker_target")
FILES = 'format = "counterflex-dataset"\nversion = 1\nname = "r"\nkind = "tracker_poses"\n[[files]]\npath = "r.csv"\n'


def numbers(size: float) -> st.SearchStrategy[float]:
    return st.floats(-size, size, allow_subnormal=False)


@settings(max_examples=40, deadline=None)
@given(
    rows=st.lists(st.tuples(*[numbers(6.0)] * 6, *[numbers(50.0)] * 3, *[numbers(1.7)] * 3), min_size=1, max_size=6),
    spread=st.floats(1e-7, 1e-2),
    by_row=st.booleans(),
)
def test_written_data_are_read_back(rows: list[tuple[float, ...]], spread: float, by_row: bool) -> None:
    table = np.array(rows)
    channels = {"q": table[:, :6], "p_tracker_target": table[:, 6:9], "R_tracker_target": rotation.exp(table[:, 9:])}
    sigma: dict[str, float | Float] = {
        "p_tracker_target": spread * (1.0 + np.abs(table[:, 6:9])) if by_row else spread,
        "R_tracker_target": np.array([1.0, 2.0, 3.0]) * spread,
    }
    with tempfile.TemporaryDirectory() as folder:
        group = np.arange(len(rows)) // 2
        path = write_dataset(folder, "poses", "tracker_poses", channels, sigma, group=group, settings={"payload_kg": 3})
        data = read_dataset(path)
        again = write_dataset(
            Path(folder) / "again",
            "poses",
            data.kind,
            {k: c.values for k, c in data.channels.items()},
            {k: c.sigma for k, c in data.channels.items() if c.sigma is not None},
            group=data.group,
            settings=data.settings,
        )
        back = read_dataset(again)
    assert data.settings == {"payload_kg": 3}
    for key in POSES:
        np.testing.assert_allclose(
            data.values(key), channels[key], rtol=1e-11, atol=1e-11
        )  # twelve digits of numbers below 10
        # Once printed, a number stays what it is: twelve digits in, the same twelve digits out.
        np.testing.assert_allclose(back.values(key), data.values(key), rtol=1e-14, atol=5e-12)
    assert data.channel("q").sigma is None
    expected = np.broadcast_to(sigma["p_tracker_target"], (len(rows), 3))
    np.testing.assert_allclose(data.channel("p_tracker_target").need_sigma(), expected, rtol=1e-11)
    np.testing.assert_array_equal(data.group, group)


@pytest.mark.parametrize(
    ("convention", "scipy_name"),
    [("xyz_fixed", "xyz"), ("xyz_intrinsic", "XYZ"), ("zyx_intrinsic", "ZYX")],
)
def test_angles_mean_what_another_library_says(convention: str, scipy_name: str) -> None:
    angles = np.random.default_rng(1).uniform(-3.0, 3.0, (50, 3))
    expected = Rotation.from_euler(scipy_name, angles).as_matrix()
    np.testing.assert_allclose(matrices(convention, angles), expected, atol=1e-14)


def test_quaternions_and_matrices_mean_what_another_library_says() -> None:
    R = Rotation.random(20, rng=np.random.default_rng(2))
    np.testing.assert_allclose(matrices("quat_xyzw", R.as_quat()), R.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(matrices("quat_wxyz", R.as_quat(scalar_first=True)), R.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(matrices("matrix", R.as_matrix().reshape(-1, 9)), R.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(matrices("rotation_vector", R.as_rotvec()), R.as_matrix(), atol=1e-14)


@pytest.mark.parametrize("convention", ["xyz_fixed", "xyz_intrinsic", "zyx_intrinsic"])
def test_standard_deviations_of_angles_become_those_of_the_rotation(convention: str) -> None:
    rng = np.random.default_rng(3)
    angles, sigma = np.array([[0.7, -0.5, 1.9]]), np.array([[1e-4, 2e-4, 5e-4]])
    count = 40_000
    noisy = matrices(convention, angles + sigma * rng.standard_normal((count, 3)))
    off = rotation.log(noisy @ matrices(convention, angles)[0].T)
    # Four standard errors of a standard deviation.
    np.testing.assert_allclose(
        rotation_sigma(convention, angles, sigma)[0], off.std(axis=0), rtol=4.0 / np.sqrt(2.0 * count)
    )


def test_left_handed_and_skewed_rotations_are_named(tmp_path: Path) -> None:
    columns = [f"m{i}" for i in range(9)]
    manifest = f'{FILES}[channels.R_tracker_target]\ncolumns = {columns}\nrotation = "matrix"\n'.replace("'", '"')
    (tmp_path / "r.toml").write_text(manifest)

    def line(*matrices: Float) -> str:
        rows = [",".join(f"{v:.6f}" for v in m.ravel()) for m in matrices]
        (tmp_path / "r.csv").write_text("\n".join([",".join(columns), *rows]) + "\n")
        with pytest.raises(FileFormatError) as found:
            read_dataset(tmp_path / "r.toml")
        return str(found.value)

    R = rotation.exp(np.array([0.3, 0.4, -0.5]))
    assert "left-handed" in line(R, R @ np.diag([1.0, -1.0, 1.0]))
    assert "r.csv:3" in line(R, R @ np.diag([1.0, -1.0, 1.0]))
    assert "no rotation" in line(1.01 * R)


def test_quaternions_that_are_none_are_named(tmp_path: Path) -> None:
    manifest = f'{FILES}[channels.R_tracker_target]\ncolumns = [1, 2, 3, 4]\nrotation = "quat_xyzw"\n'
    (tmp_path / "r.toml").write_text(manifest)
    (tmp_path / "r.csv").write_text("a,b,c,d\n0,0,0,1\n0,0,1,1\n")
    with pytest.raises(FileFormatError, match=r"r\.csv:3.*length 1"):
        read_dataset(tmp_path / "r.toml")


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    q = np.zeros((3, 6))
    with pytest.raises(InputError, match="kind"):
        write_dataset(tmp_path, "a", "poses", {"q": q}, {})
    with pytest.raises(InputError, match="channel"):
        write_dataset(tmp_path, "a", "pulls", {"joints": q}, {})
    with pytest.raises(InputError, match="shape"):
        write_dataset(tmp_path, "a", "pulls", {"q": q[:, :5]}, {})
    with pytest.raises(InputError, match="finite"):
        write_dataset(tmp_path, "a", "pulls", {"q": q * np.nan}, {})
    with pytest.raises(InputError, match="lengths"):
        write_dataset(tmp_path, "a", "pulls", {"q": q, "f_tcp_base": np.zeros((2, 3))}, {})
    with pytest.raises(InputError, match="setting"):
        write_dataset(tmp_path, "a", "pulls", {"q": q}, {}, settings={"colour": "red"})
    with pytest.raises(InputError, match="not"):
        write_dataset(tmp_path, "a", "pulls", {"q": q}, {"d_tcp_base": 1.0})
    assert not list(tmp_path.iterdir())


@settings(max_examples=150, deadline=None)
@given(cut=st.integers(0, 400), junk=st.binary(max_size=6), what=st.sampled_from(["csv", "toml"]))
def test_damaged_files_are_read_or_refused_in_one_line(cut: int, junk: bytes, what: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        pull = {"f_tcp_base": np.arange(12.0).reshape(4, 3), "q": np.ones((4, 6))}
        path = write_dataset(folder, "d", "pulls", pull, {"f_tcp_base": 1.0})
        target = path.with_suffix(f".{what}")
        data = target.read_bytes()
        target.write_bytes(data[:cut] + junk + data[cut + len(junk) :])
        with contextlib.suppress(FileFormatError):
            found = read_dataset(path)
            assert all(np.all(np.isfinite(c.values)) for c in found.channels.values())
