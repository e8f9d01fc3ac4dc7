"""Pulls read by a measuring frame: the compliances are those of the displacements themselves, in whatever axes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.progress import silent
from counterflex.core.units import DEG, MM, UM
from counterflex.files.cell.cell import read_cell
from counterflex.files.dataset.reader import read_dataset
from counterflex.files.dataset.writer import write_dataset
from counterflex.geometry import pose, rotation
from counterflex.identify.data.changes import ElementCompliance
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.measuring_frame import SensorFrame, shown
from counterflex.identify.data.model import CellModel
from counterflex.identify.geometry.compliances import springs, with_compliance
from counterflex.identify.recipe import Identification
from counterflex.identify.stiffness import recipe as stiffness
from counterflex.identify.stiffness.frame_pulls import ALIGNMENT_RAD, summary, with_displacements
from counterflex.robot.elasticity.chain import ElasticChain, forward
from counterflex.robot.elasticity.compliance import deflection
from counterflex.twin.laboratory import distance_frame
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.laboratory.pulls import measure
from counterflex.twin.truth.nominal import nominal_truth
from counterflex.twin.truth.truth import CuttingTruth

PULLS = 30
SIGMA = 1.0 * UM
P_TCP = np.array([0.0, 0.0, 20.0 * MM])


@pytest.fixture(scope="module")
def cell() -> CellModel:
    known = model_of(read_cell(Path(__file__).parents[3] / "examples/cells/kr300_d16_flat.toml"))
    return replace(known, robot=replace(known.robot, play=None))


def experiment(cell: CellModel, seed: int = 0) -> tuple[ElasticChain, Float, Float, Float]:
    """A stiffer arm than the cell file's: poses, forces, and how the measured point moves, base axes (n, 6)."""
    rng = np.random.default_rng(seed)
    low, high = np.array([-60, -100, 60, -120, 25, -150]) * DEG, np.array([60, -40, 130, 120, 80, 150]) * DEG
    q = rng.uniform(low, high, (PULLS, 6))
    f = 750.0 * np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, -1]])[rng.integers(0, 3, PULLS)]
    known = springs(cell.chain, {})
    values = known.parameters.nominal * rng.uniform(0.8, 1.25, len(known))
    true = with_compliance(cell.chain, known.compliance(cell.chain, values))
    d = deflection(true, q, np.hstack([f, np.zeros((PULLS, 3))]), gravity=True, equilibrium=True)
    T = forward(cell.chain, q)
    lever = (T[:, :3, :3] @ P_TCP[:, None])[..., 0]
    d[:, :3] += (rotation.exp(d[:, 3:]) @ lever[..., None])[..., 0] - lever
    return cell.chain, q, f, d


def written(folder: Path, chain: ElasticChain, q: Float, f: Float, d: Float, axes: str, **more: Any) -> Path:
    """Readings of the frame in some axes, as a file; the frame stands on the cube, turned by 40 deg about its z."""
    T = forward(chain, q)
    turned = rotation.about_z(40.0 * DEG)
    R_base_cube = T[:, :3, :3] @ turned
    p_base = T[:, :3, 3] + (T[:, :3, :3] @ P_TCP[:, None])[..., 0]
    sensors = [dict(one) for one in distance_frame.described()]
    before = 40.0 * MM + np.random.default_rng(1).uniform(-0.5, 0.5, (len(q), len(sensors))) * MM
    twist = np.concatenate([(np.swapaxes(R_base_cube, 1, 2) @ d[:, i : i + 3, None])[..., 0] for i in (0, 3)], axis=1)

    def array(key: str) -> Float:
        return np.array([one[key] for one in sensors])

    frame = SensorFrame(
        tuple(one["name"] for one in sensors),
        array("position_m"),
        array("direction"),
        array("normal"),
        array("point_m"),
        "frame",
    )
    noise = SIGMA * np.random.default_rng(2).standard_normal((2, len(q), len(sensors)))
    s = shown(frame, before, twist, np.zeros((len(q), 3)))
    channels: dict[str, Float] = {"q": q, "f_tcp_base": f, "s_unloaded": before + noise[0], "s_loaded": s + noise[1]}
    place = pose.make(turned, P_TCP)
    if axes == "frame":
        channels |= {"R_base_frame": R_base_cube, "p_base_frame": p_base}
        place = np.eye(4)
    if axes == "base":
        place = pose.make(R_base_cube[0], p_base[0])
    for one in sensors:
        for key in ("position_m", "point_m"):
            one[key] = pose.transform(place, np.array(one[key])).tolist()
        for key in ("direction", "normal"):
            one[key] = (place[:3, :3] @ np.array(one[key])).tolist()
    return write_dataset(
        folder,
        axes,
        "pulls",
        channels,
        {"f_tcp_base": 0.5, "s_unloaded": SIGMA, "s_loaded": SIGMA},
        settings={"sensor_axes": axes, "p_tcp_measured_m": P_TCP.tolist(), **more},
        sensors=sensors,
    )


def plain(folder: Path, q: Float, f: Float, d: Float) -> Dataset:
    rng = np.random.default_rng(3)
    sigma = np.r_[np.full(3, 1.0 * UM), np.full(3, 20e-6)]
    path = write_dataset(
        folder,
        "poses",
        "pulls",
        {"q": q, "f_tcp_base": f, "d_tcp_base": d + sigma * rng.standard_normal(d.shape)},
        {"f_tcp_base": 0.5, "d_tcp_base": sigma},
        settings={"p_tcp_measured_m": P_TCP.tolist()},
    )
    return read_dataset(path)


def found_by(cell: CellModel, data: Dataset) -> Identification:
    return stiffness.RECIPE.identify(cell, [data], [], {"regions": False, "folds": 3}, silent)


@pytest.mark.parametrize("axes", ["tcp", "frame"])
def test_raw_distances_give_the_displacement_in_base_axes(tmp_path: Path, cell: CellModel, axes: str) -> None:
    chain, q, f, d = experiment(cell)
    data, _ = with_displacements(chain, read_dataset(written(tmp_path, chain, q, f, d, axes)))
    off = (data.values("d_tcp_base") - d) / data.channel("d_tcp_base").need_sigma()
    assert np.sqrt(np.mean((data.values("d_tcp_base") - d)[:, :3] ** 2)) < 2.0 * SIGMA
    assert np.max(np.abs(off)) < 4.0


def test_a_frame_that_stays_is_given_in_base_axes(tmp_path: Path, cell: CellModel) -> None:
    chain, q, f, d = experiment(cell)
    q = np.repeat(q[:1], 3, axis=0)
    data, _ = with_displacements(chain, read_dataset(written(tmp_path, chain, q, f[:3], d[:3], "base")))
    np.testing.assert_allclose(data.values("d_tcp_base")[:, :3], d[:3, :3], atol=5.0 * SIGMA)


def test_identified_from_raw_distances_is_identified_from_poses(tmp_path: Path, cell: CellModel) -> None:
    chain, q, f, d = experiment(cell)
    raw = found_by(cell, read_dataset(written(tmp_path, chain, q, f, d, "tcp")))
    direct = found_by(cell, plain(tmp_path, q, f, d))
    a, b = raw.fits["stiffness"], direct.fits["stiffness"]
    apart = np.abs(np.log(a.values / b.values))[np.array(a.seen) == "determined"]
    spread = np.hypot(a.sigma / a.values, b.sigma / b.values)[np.array(a.seen) == "determined"]
    assert len(apart) > 5
    assert np.max(apart / spread) < 2.5
    assert raw.headline[0].value == pytest.approx(direct.headline[0].value, abs=0.3)
    assert raw.headline[0].nominal is not None
    assert raw.headline[0].value < 0.2 * raw.headline[0].nominal
    assert any("8 sensors, 2 more than are needed" in text for text in raw.remarks)
    assert any(isinstance(change, ElementCompliance) for change in raw.changes)


def test_three_sensors_give_displacements_and_say_so(tmp_path: Path, cell: CellModel) -> None:
    chain, q, f, d = experiment(cell)
    path = written(tmp_path, chain, q, f, d, "tcp")
    text = path.read_text()
    keep = [2, 5]  # X3 and Y3 look at their faces off the middle: the normals pass the centre by 35 mm
    head, *tables = text.split("[[sensors]]")
    for channel in ("s_unloaded", "s_loaded"):
        for k in range(8):
            if k not in (*keep, 6):
                head = head.replace(f'    "{channel}{k + 1}_mm",\n', "")
    path.write_text("[[sensors]]".join([head, *(tables[k] for k in (*keep, 6))]))
    data, said = with_displacements(chain, read_dataset(path))
    assert data.values("d_tcp_base").shape == (PULLS, 3)
    assert any("only the displacement is found" in text for text in said)
    off = np.abs(data.values("d_tcp_base") - d[:, :3]) / data.channel("d_tcp_base").need_sigma()
    assert np.mean(off < 2.0) > 0.9  # the turn that is not found is in the standard deviations
    assert np.median(data.channel("d_tcp_base").need_sigma()) > 10.0 * SIGMA


def test_the_way_over_the_simulated_cell(tmp_path: Path, cell: CellModel) -> None:
    """The same pulls of the simulated cell by tracker and by frame move its tool alike."""
    cutting = CuttingTruth(k_pa=(800e6, 280e6, 120e6), exponent=(0.25, 0.25, 0.25))
    truth = nominal_truth(cell.nominal_robot, cell.nominal_end_effector, cutting)
    chain, q, f, _ = experiment(cell)
    request = {f"q{i + 1}_rad": q[:6, i] for i in range(6)} | {f"f{c}_n": f[:6, i] for i, c in enumerate("xyz")}
    moved = []
    for wanted in ({"axes": "base"}, {"instrument": "frame"}):
        found = measure(truth, laboratory(3), request, {"history": "relaxed", "readings": 400, **wanted}, silent)
        path = write_dataset(
            tmp_path / "twin",
            "pulls",
            "pulls",
            found.channels,
            found.sigma,
            settings=found.settings,
            sensors=found.sensors,
        )
        data, _ = with_displacements(chain, read_dataset(path))
        moved.append(data.channel("d_tcp_base"))
    limit = 4.0 * np.hypot(moved[0].need_sigma(), moved[1].need_sigma())
    assert np.all(np.abs(moved[0].values - moved[1].values) < limit)
    assert np.min(np.linalg.norm(moved[1].values[:, :3], axis=1)) > 50.0 * np.max(limit[:, :3]) / 4.0


def edited(path: Path, *pairs: tuple[str, str]) -> Path:
    text = path.read_text()
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new, 1)
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('sensor_axes = "tcp"', 'sensor_axes = "tool"', "there are no such axes"),
        ('sensor_axes = "tcp"\n', "", "axes of the sensor positions are not stated"),
        ('    "s_loaded8_mm",\n', "", "7 columns"),
        ("[channels.s_unloaded]", "[channels.s_loded]", "s_loded"),
        ('kind = "pulls"', 'kind = "cubes"', "pulls only"),
        ('name = "X2"', 'name = "X1"', "two sensors have the same name"),
        ('unit = "mm"\nsigma = 0.001', 'unit = "um"\nsigma = 0.001', "header"),
    ],
)
def test_manifest_mistakes_are_one_clear_error(tmp_path: Path, cell: CellModel, old: str, new: str, said: str) -> None:
    chain, q, f, d = experiment(cell)
    path = edited(written(tmp_path, chain, q, f, d, "tcp"), (old, new))
    with pytest.raises((FileFormatError, InputError)) as fault:
        read_dataset(path)
    assert said in str(fault.value)
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("direction = [1.0, 1.0, 0.0]", "expected a unit vector (length 1): [0.7071, 0.7071, 0.0]"),
        ("direction = [0.0, 0.0, 0.0]", "length 0"),
        ("direction = [1.0, 0.0]", "got 2 numbers"),
        ("direction = [1.0, 0.0, 0.0]\nnormal = [0.0, 1.0, 0.0]", "looks along its plane"),
        ("direction = [1.0, 0.0, 0.0]\nposition = [0, 0, 0]", "position_mm"),
    ],
)
def test_a_sensor_that_cannot_be_is_refused(tmp_path: Path, table: str, said: str) -> None:
    path = tmp_path / "m.toml"
    path.write_text(
        'format = "counterflex-dataset"\nversion = 1\nname = "a"\nkind = "pulls"\n[[files]]\npath = "a.csv"\n'
        f'[channels.q]\ncolumns = ["a"]\n[[sensors]]\nname = "S"\nposition_mm = [0, 0, 0]\n{table}\n'
    )
    with pytest.raises(FileFormatError) as fault:
        read_dataset(path)
    assert said in str(fault.value)


def test_a_reading_that_is_no_number_is_named(tmp_path: Path, cell: CellModel) -> None:
    """An empty cell of the table ended in a LinAlgError: SVD did not converge."""
    chain, q, f, d = experiment(cell)
    data = read_dataset(written(tmp_path, chain, q, f, d, "tcp"))
    readings = data.channel("s_loaded")
    values = readings.values.copy()
    values[3, 2] = np.nan
    gap = replace(data, channels={**data.channels, "s_loaded": replace(readings, values=values)})
    for look in (lambda: with_displacements(chain, gap), lambda: summary(gap)):
        with pytest.raises(FileFormatError, match="'s_loaded' holds a value that is not a number"):
            look()


def test_wrong_sensors_stop_the_identification_and_the_check(tmp_path: Path, cell: CellModel) -> None:
    chain, q, f, d = experiment(cell)
    path = written(tmp_path, chain, q, f, d, "tcp")
    names = [f'"s_loaded{k}_mm"' for k in (1, 4)]
    before = [f'"s_unloaded{k}_mm"' for k in (1, 4)]
    for a, b in (names, before):
        edited(path, (a, "@"), (b, a), ("@", b))
    data = read_dataset(path)
    with pytest.raises(InputError, match="sensors 'X1' and 'Y1' are exchanged"):
        found_by(cell, data)
    with pytest.raises(InputError, match="'X1' and 'Y1' are exchanged"):
        summary(data)
    _, said = with_displacements(chain, data, as_stated=True)
    assert any("as requested" in text for text in said)


def test_loaded_and_unloaded_exchanged_are_told_by_the_work(tmp_path: Path, cell: CellModel) -> None:
    chain, q, f, d = experiment(cell)
    data = read_dataset(written(tmp_path, chain, q, f, d, "tcp"))
    channels = dict(data.channels)
    channels["s_loaded"], channels["s_unloaded"] = channels["s_unloaded"], channels["s_loaded"]
    with pytest.raises(InputError, match="negative work|reversed"):
        found_by(cell, replace(data, channels=channels))


def test_the_check_says_what_the_sensors_say(tmp_path: Path, cell: CellModel) -> None:
    chain, q, f, d = experiment(cell)
    data = read_dataset(written(tmp_path, chain, q, f, d, "tcp"))
    found = summary(data)
    assert found is not None
    assert found["spare"] == 2
    assert found["condition"] < 5.0
    assert found["left_um"] < 2.0
    assert found["largest_mm"] == pytest.approx(float(np.max(np.linalg.norm(d[:, :3], axis=1))) / MM, rel=1e-2)
    assert ALIGNMENT_RAD < 0.2 * DEG
