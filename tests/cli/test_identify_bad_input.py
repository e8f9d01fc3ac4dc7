"""Mistakes of a laboratory, through the real command: each is detected and named, none is fitted away or repaired."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np
import pytest

from counterflex.app.examples import text as demo
from counterflex.core.arrays import Float
from counterflex.core.units import MM, MRAD, UM, URAD
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.dataset.writer import write_dataset
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity import compliance
from counterflex.robot.elasticity.chain import ElasticChain, forward
from counterflex.robot.model.calibration import calibrated, places


class Ended(Protocol):
    """How a command ended."""

    status: int
    out: str
    err: str


Refused = Callable[..., str]
Change = Callable[[Path], None]
NOISE_M, NOISE_RAD = 20.0 * UM, 40.0 * URAD
T_BASE_TRACKER = pose.make(rotation.exp(np.array([0.02, -0.03, 3.1])), np.array([4.4, 0.45, 1.25]))
T_TCP_TARGET = pose.make(rotation.exp(np.array([0.03, 0.01, -0.02])), np.array([0.004, -0.006, 0.052]))


@pytest.fixture(scope="session")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Cell:
    path = tmp_path_factory.mktemp("identify") / "cell.toml"
    path.write_text(demo("cell.toml"), encoding="utf-8")
    return read_cell(path)


def postures(count: int, rng: np.random.Generator) -> Float:
    centre = np.radians([0.0, -90.0, 100.0, 0.0, 10.0, 0.0])
    out: Float = centre + np.radians([50.0, 25.0, 25.0, 60.0, 60.0, 120.0]) * rng.uniform(-1.0, 1.0, (count, 6))
    return out


def off(cell: Cell, rng: np.random.Generator) -> ElasticChain:
    """The arm as it truly is: displaced behind every segment by some tenths of a millimetre and milliradian."""
    size = np.array([0.3 * MM] * 3 + [0.3 * MRAD] * 3)
    names = places(cell.nominal_robot, cell.nominal_end_effector)[1:-1]
    robot, tool = calibrated(
        cell.nominal_robot, cell.nominal_end_effector, {name: size * rng.standard_normal(6) for name in names}
    )
    return ElasticChain.build(robot, tool)


def poses(cell: Cell, folder: Path, name: str = "data", count: int = 24) -> Path:
    rng = np.random.default_rng(5)
    q = postures(count, rng)
    Ts = pose.inverse(T_BASE_TRACKER) @ forward(off(cell, rng), q) @ T_TCP_TARGET
    p = Ts[:, :3, 3] + NOISE_M * rng.standard_normal((count, 3))
    R = Ts[:, :3, :3] @ rotation.exp(NOISE_RAD * rng.standard_normal((count, 3)))
    sigma = {"p_tracker_target": NOISE_M, "R_tracker_target": NOISE_RAD}
    return write_dataset(folder, name, "tracker_poses", {"q": q, "p_tracker_target": p, "R_tracker_target": R}, sigma)


def pulls(cell: Cell, folder: Path, name: str = "data", count: int = 20) -> Path:
    rng = np.random.default_rng(6)
    q = postures(count, rng)
    w = np.zeros((count, 6))
    w[:, :3] = rng.uniform(200.0, 800.0, (count, 1)) * rotation.exp(rng.uniform(-2.0, 2.0, (count, 3)))[:, :, 2]
    softer = np.exp(0.15 * rng.standard_normal(cell.chain.compliance.shape))
    true = replace(cell.chain, compliance=cell.chain.compliance * softer)
    d = np.stack([compliance.cartesian_compliance(true, row) @ load for row, load in zip(q, w, strict=True)])[:, :3]
    d += NOISE_M * rng.standard_normal((count, 3))
    channels = {"q": q, "w_tcp_base": w, "d_tcp_base": d}
    return write_dataset(
        folder, name, "pulls", channels, {"w_tcp_base": np.array([2.0] * 3 + [0.2] * 3), "d_tcp_base": NOISE_M}
    )


def fiducials(cell: Cell, folder: Path, name: str = "data", count: int = 8) -> Path:
    rng = np.random.default_rng(7)
    p = rng.uniform(-1.5, 1.5, (count, 3)) + np.array([0.0, 0.0, 0.5])
    seen = pose.transform(pose.inverse(T_BASE_TRACKER), p) + NOISE_M * rng.standard_normal((count, 3))
    sigma = {"p_base_fiducial": 20.0 * UM, "p_tracker_fiducial": NOISE_M}
    return write_dataset(folder, name, "fiducials", {"p_base_fiducial": p, "p_tracker_fiducial": seen}, sigma)


def readings(cell: Cell, folder: Path, name: str = "data", count: int = 20) -> Path:
    """A force sensor behind the flange: bias, 70 kg on its tool side, noise."""
    rng = np.random.default_rng(8)
    q = postures(count, rng)
    q[:, 3:] = np.radians([170.0, 110.0, 170.0]) * rng.uniform(-1.0, 1.0, (count, 3))
    R = forward(cell.chain, q)[:, :3, :3]
    T_sensor_tcp = cell.end_effector.segments[1].T_prev_seg @ cell.end_effector.T_last_tcp
    down = np.einsum("nji,j->ni", R @ T_sensor_tcp[:3, :3].T, np.array([0.0, 0.0, -9.80665]))
    mass, com = 76.0, np.array([0.11, 0.004, 0.12])
    f = mass * down
    w = np.hstack([f, np.cross(com, f)]) + np.array([12.0, -8.0, 30.0, 1.0, 2.0, -0.5])
    w += np.array([1.0] * 3 + [0.1] * 3) * rng.standard_normal((count, 6))
    return write_dataset(
        folder, name, "sensor_poses", {"q": q, "w_sensor": w}, {"w_sensor": np.array([1.0] * 3 + [0.1] * 3)}
    )


MAKE = {
    "kinematics": poses,
    "tracker-frame poses": poses,
    "stiffness": pulls,
    "tracker-frame": fiducials,
    "payload": readings,
}


def manifest(old: str, new: str) -> Change:
    def change(path: Path) -> None:
        before = path.read_text(encoding="utf-8")
        assert old in before
        path.write_text(before.replace(old, new), encoding="utf-8")

    return change


def table(edit: Callable[[dict[str, Float]], None]) -> Change:
    """Edit the numbers of the file, by column."""

    def change(path: Path) -> None:
        file = path.with_suffix(".csv")
        with file.open(encoding="utf-8") as stream:
            rows = list(csv.reader(stream))
        columns = {name: np.array(cells, dtype=np.float64) for name, *cells in zip(*rows, strict=True)}
        edit(columns)
        lines = [",".join(f"{v:.12g}" for v in row) for row in zip(*columns.values(), strict=True)]
        file.write_text("\n".join([",".join(columns), *lines]) + "\n", encoding="utf-8")

    return change


def scaled(prefix: str, factor: float) -> Change:
    def edit(columns: dict[str, Float]) -> None:
        for name in columns:
            if name.startswith(prefix):
                columns[name] = columns[name] * factor

    return table(edit)


def swapped(a: str, b: str) -> Change:
    def edit(columns: dict[str, Float]) -> None:
        columns[a], columns[b] = columns[b], columns[a]

    return table(edit)


def first(count: int) -> Change:
    def edit(columns: dict[str, Float]) -> None:
        for name in columns:
            columns[name] = columns[name][:count]

    return table(edit)


def same_pose(columns: dict[str, Float]) -> None:
    rng = np.random.default_rng(1)
    for name in columns:
        noise = 0.0 if name.startswith("q") else 1e-3
        columns[name] = columns[name][0] + noise * rng.standard_normal(len(columns[name]))


def on_a_line(columns: dict[str, Float]) -> None:
    t = np.linspace(-1000.0, 1000.0, len(columns["p_base_fiducial_x_mm"]))
    p = np.stack([t, 0.5 * t, 300.0 + 0.1 * t], axis=1)
    seen = pose.transform(pose.inverse(T_BASE_TRACKER), p * MM) / MM
    for i, axis in enumerate("xyz"):
        columns[f"p_base_fiducial_{axis}_mm"] = p[:, i]
        columns[f"p_tracker_fiducial_{axis}_mm"] = seen[:, i]


def with_nan(column: str) -> Change:
    def edit(columns: dict[str, Float]) -> None:
        columns[column][4] = np.nan

    return table(edit)


P, R = "p_tracker_target", "R_tracker_target"
CASES: dict[str, tuple[str, Change, list[str]]] = {
    "angles in degrees called rad": (
        "tracker-frame poses",
        manifest('"q6_deg",\n]\nunit = "deg"', '"q6_deg",\n]\nunit = "rad"'),
        ["q", "'rad'", "'deg' as in"],
    ),
    "angles in rad called degrees": ("kinematics", scaled("q", np.pi / 180.0), ["q"]),
    "metres called millimetres": ("tracker-frame poses", scaled(P, 1e-3), [P]),
    "millimetres called metres": ("tracker-frame poses", scaled(P, 1e3), [P, "too large for its unit", ".csv:2"]),
    "two joints swapped": ("tracker-frame poses", swapped("q4_deg", "q6_deg"), ["q"]),
    "y and z of the tracker swapped": ("tracker-frame poses", swapped(f"{P}_y_mm", f"{P}_z_mm"), [P]),
    "left-handed tracker": ("kinematics", scaled(f"{P}_y", -1.0), [P]),
    "one joint turns the other way": ("tracker-frame poses", scaled("q3", -1.0), ["q"]),
    "one pose measured again and again": ("kinematics", table(same_pose), ["data"]),
    "three poses": ("kinematics", first(3), ["too few different poses", "3"]),
    "a cell is not a number": ("tracker-frame poses", with_nan(f"{P}_x_mm"), [".csv:6", f"{P}_x_mm"]),
    "no standard deviation": ("tracker-frame poses", manifest("sigma = 0.02\n", ""), [f"[channels.{P}]: sigma"]),
    "fiducials on one line": ("tracker-frame", table(on_a_line), ["line"]),
    "two fiducials": ("tracker-frame", first(2), ["2"]),
    "left-handed fiducials": ("tracker-frame", scaled("p_base_fiducial_x", -1.0), ["left-handed"]),
    "fiducials in metres": ("tracker-frame", scaled("p_base_fiducial", 1e-3), ["fiducial"]),
    "forces with the other sign": ("stiffness", scaled("w_tcp_base", -1.0), ["against their loads", "acts_on"]),
    "kilonewtons called newtons": ("stiffness", scaled("w_tcp_base_f", 1e-3), ["have no load", "unit of the load"]),
    "displacement in metres": ("stiffness", scaled("d_tcp_base", 1e-3), ["1000 times"]),
    "forces x and y swapped": ("stiffness", swapped("w_tcp_base_fx_n", "w_tcp_base_fy_n"), ["w_tcp_base"]),
    "one pull": ("stiffness", first(1), ["1"]),
    "one pull again and again": ("stiffness", table(same_pose), ["data"]),
    "displacement empty": ("stiffness", with_nan("d_tcp_base_y_mm"), [".csv:6", "d_tcp_base_y_mm"]),
    "sensor with the other sign": ("payload", scaled("w_sensor", -1.0), ["w_sensor"]),
    "sensor in kilonewtons": ("payload", scaled("w_sensor", 1e-3), ["w_sensor"]),
    "one orientation only": ("payload", table(same_pose), ["orientation"]),
    "sensor axes swapped": ("payload", swapped("w_sensor_fx_n", "w_sensor_fz_n"), ["w_sensor"]),
}


@pytest.fixture
def lab(folder: Path) -> Path:
    (folder / "cell.toml").write_text(demo("cell.toml"), encoding="utf-8")
    return folder


@pytest.mark.by_turn
@pytest.mark.parametrize("case", CASES)
def test_a_mistake_is_named(case: str, lab: Path, cell: Cell, refused: Refused) -> None:
    recipe, change, wanted = CASES[case]
    change(MAKE[recipe](cell, lab))
    line = refused("identify", recipe.split()[0], "data.toml", "--cell", "cell.toml", "--out", "out")
    for text in wanted:
        assert text in line, line


@pytest.mark.parametrize("recipe", ["tracker-frame", "stiffness"])
def test_without_a_mistake_the_same_data_are_identified(
    recipe: str, lab: Path, cell: Cell, counterflex: Callable[..., Ended]
) -> None:
    MAKE[recipe](cell, lab)
    quick = ("--set", "regions=false") if recipe == "stiffness" else ()
    ended = counterflex("identify", recipe, "data.toml", "--cell", "cell.toml", "--out", "out", *quick)
    assert ended.status == 0, ended.err
    assert sorted(p.name for p in (lab / "out").iterdir()) == ["archive", "cell.toml", "report.html", "result.json"]


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("stifness data.toml --cell cell.toml --out out", "Did you mean 'stiffness'"),
        ("tracker-frame --cell cell.toml --out out", "no data are given"),
        ("tracker-frame data.toml --out out", "--cell is missing"),
        ("tracker-frame data.toml --cell cell.toml", "--out is missing"),
        ("tracker-frame data.toml --cell cell.toml --out .", "lies in this folder"),
        ("tracker-frame data.toml --cell cell.toml --out out --set folds", "not KEY=VALUE"),
        ("tracker-frame data.toml --cell cell.toml --out out --set seed=1 --set seed=2", "given twice"),
        ("tracker-frame data.toml --cell cell.toml --out out --set colour=red", "has no such setting"),
        ("tracker-frame data.tom --cell cell.toml --out out", "Did you mean data.toml"),
        ("tracker-frame data.toml data.toml --cell cell.toml --out out", "the same rows"),
        ("stiffness data.toml --cell cell.toml --out out", "does not use such data"),
        ("tracker-frame data.toml --propose 10 --cell cell.toml --out out", "takes no data"),
        ("tracker-frame --propose 2 --cell cell.toml --out out", "2"),
        ("history nowhere", "no such file or folder"),
        ("history .", "no identification is kept here"),
        ("history . .", "one folder"),
    ],
)
def test_options_that_make_no_sense(words: str, wanted: str, lab: Path, cell: Cell, refused: Refused) -> None:
    fiducials(cell, lab)
    assert wanted in refused("identify", *words.split())
