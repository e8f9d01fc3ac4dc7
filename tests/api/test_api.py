"""The interface for scripts: it says what the commands say, and loads nothing before it is used."""

from __future__ import annotations

import inspect
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from hypothesis.extra.numpy import arrays

import counterflex as cf
from counterflex.app.proof import evaluate, prove, simulate
from counterflex.app.proof.truth import make_truth
from counterflex.core.errors import InputError
from counterflex.core.result import Result
from counterflex.files.cell.cell import read_cell
from counterflex.twin.truth.family import family_of

GROOVE = Path(__file__).parents[2] / "examples" / "programs" / "groove.ngc"
SHORT = "G21 G17 G90 G94\nM6 T1\nM3 S13000\nG0 Z60\nG0 X-12 Y15\nG0 Z38\nG1 X6 F1500\nG0 Z60\nM30\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("api")
    cf.examples(place)
    (place / "cell-small.toml").replace(place / "cell.toml")
    (place / "part.ngc").write_text(SHORT, encoding="utf-8")
    return place


@pytest.fixture(scope="module")
def plan(folder: Path) -> Any:
    return cf.compensate(folder / "part.ngc", folder / "cell.toml")


SIGNATURES = {
    "CounterflexError": "(what, *, where, value, limit, hint, **data)",
    "choose_posture": "(program, cell, *, surface, rotations, progress)",
    "compare": "(before, after)",
    "compensate": "(program, cell, *, language, dialect, tolerance_um, normal_only, predict, progress)",
    "compliance": "(cell, joints_deg)",
    "deflection": "(cell, at_mm, force_n, *, by_element)",
    "engagement": "(program, cell, *, every_mm)",
    "examples": "(folder)",
    "forces": "(cell, tool, *, depth_mm, feed_per_tooth_um, arc_deg, revolution, helix_deg, runout_um, trochoid)",
    "forward": "(cell, joints_deg)",
    "identify": "(recipe, data, cell, out, *, holdout, settings, progress)",
    "inspect": "(program, cell, scan, *, unit, before, progress)",
    "inverse": "(cell, at_mm, tool, *, rotation_about_tool_deg, branch)",
    "modes": "(cell, joints_deg, *, count)",
    "preflight": "(program, cell, *, progress)",
    "propose": "(recipe, count, cell, out, *, settings, seed)",
    "prove": "(program, cell, *, seeds, family, exact, workers, progress)",
    "read_cell": "(file, *, assume_class)",
    "read_program": "(file, cell, *, dialect)",
    "read_run": "(folder, number)",
    "simulate": "(program, cell, *, seed, family, original, progress)",
}
"""Functions of the interface: a name or an argument that goes away breaks the scripts of others."""
CLASSES = {"Cell", "Part", "Plan", "Program", "RunLog", "SimulatedCell"}


def test_names_and_signatures_are_kept() -> None:
    assert set(cf.__all__) == set(SIGNATURES) | CLASSES
    assert sorted(dir(cf)) == sorted([*cf.__all__, "__version__"])
    for name, expected in SIGNATURES.items():
        taken = [p for p in inspect.signature(getattr(cf, name)).parameters.values() if p.name != "self"]
        words = [p.name if p.kind is not p.VAR_KEYWORD else f"**{p.name}" for p in taken]
        first = next((k for k, p in enumerate(taken) if p.kind is p.KEYWORD_ONLY), None)
        if first is not None:
            words.insert(first, "*")
        assert f"({', '.join(words)})" == expected, name


@pytest.mark.parametrize("name", sorted(CLASSES))
def test_a_class_has_table_summary_plot_and_save(name: str) -> None:
    kind = getattr(cf, name)
    assert issubclass(kind, Result)
    for part in ("table", "summary", "plot"):
        assert hasattr(kind, part)
    assert hasattr(kind, "save") == (name != "SimulatedCell")  # its truth is not for files of the compensator


def test_the_function_identify_stays_beside_the_folder_of_the_recipes() -> None:
    import counterflex.identify.recipes  # noqa: F401  # binds the folder to its name in the package

    assert callable(cf.identify)


def test_importing_the_package_loads_nothing() -> None:
    program = "import sys, counterflex; print(*[n for n in ('numpy', 'numba', 'polars', 'plotly') if n in sys.modules])"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ended.stdout.split() == []


def test_unknown_names_are_said() -> None:
    name = "milling"
    with pytest.raises(AttributeError, match="no attribute 'milling'"):
        getattr(cf, name)


def test_a_compensation_has_the_table_of_its_plan_file(plan: Any, folder: Path) -> None:
    from counterflex.files.plan_file import write_plan

    write_plan(folder / "plan.parquet", plan.result.plan, {})
    assert plan.table.equals(pl.read_parquet(folder / "plan.parquet"))
    row = plan.table.sort("deflection_y_um").row(0, named=True)
    assert plan.table["correction_y_um"].max() > 0.5 * abs(row["deflection_y_um"])


@pytest.mark.parametrize("kind", ["along", "map", "remaining", "cell"])
def test_pictures_of_a_plan(plan: Any, kind: str) -> None:
    picture = plan.plot(kind)
    assert len(picture.data) >= 1
    assert json.loads(picture.to_json())["data"]


def test_a_picture_that_does_not_exist(plan: Any) -> None:
    with pytest.raises(InputError, match="no such picture.*along, map, remaining, cell"):
        plan.plot("pie")


def test_simulated_and_compared_as_by_the_commands(plan: Any, folder: Path) -> None:
    before = cf.simulate(folder / "part.ngc", folder / "cell.toml", seed=3, family="wide")
    after = cf.simulate(plan, folder / "cell.toml", seed=3, family="wide")
    found = cf.compare(before, after)

    (program,) = plan.save_program(folder / "out")
    make_truth(read_cell(folder / "cell.toml"), 3, folder / "truth.toml", family_of("wide"))
    for name, file in (("before", folder / "part.ngc"), ("after", program)):
        original = folder / "part.ngc"
        simulate.run(file, folder / "cell.toml", folder / "truth.toml", folder / name, original=original)
    expected = evaluate.run([folder / "before", folder / "after"], None)
    assert found.summary["variants"] == expected["variants"]
    figures = dict(found.table.select("figure", "nominal").iter_rows())
    assert figures["path.p997_mm"] == expected["variants"]["nominal"]["path"]["p997_mm"]
    assert found.table["compensated"].item(0) < found.table["nominal"].item(0)
    assert len(found.plot("map").data) > 0
    off = after.samples.select((pl.col("y_mm") - pl.col("command_y_mm")).abs().max()).item()
    assert 0.0 < off < 5.0
    with pytest.raises(InputError, match="different simulated cells"):
        cf.compare(before, cf.simulate(plan, folder / "cell.toml", seed=None))


def test_proof_is_that_of_the_command(folder: Path, tmp_path: Path) -> None:
    proof = cf.prove(folder / "part.ngc", folder / "cell.toml", seeds=[5], family="wide")
    expected = prove.prove(
        folder / "part.ngc",
        folder / "cell.toml",
        tmp_path,
        seeds=[5],
        family=family_of("wide"),
        exact=False,
        workers=1,
    )
    variants = expected.summary["seeds"][0]["variants"]
    row = proof.seeds.row(0, named=True)
    assert row["after_p997_mm"] == variants["compensated"]["path"]["p997_mm"]
    assert row["remains_percent"] == pytest.approx(
        100.0 * variants["compensated"]["path"]["p997_mm"] / variants["nominal"]["path"]["p997_mm"]
    )


def test_deflection_is_linear_and_along_the_force(folder: Path) -> None:
    one = cf.deflection(folder / "cell.toml", [20.0, 15.0, 38.0], [0.0, 100.0, 0.0])
    two = cf.deflection(folder / "cell.toml", [[20.0, 15.0, 38.0]] * 2, [[0.0, 100.0, 0.0], [0.0, 200.0, 0.0]])
    assert len(one) == 1
    assert one["deflection_y_um"][0] > 0.0
    assert two["deflection_y_um"][1] == pytest.approx(2.0 * one["deflection_y_um"][0], rel=1e-2)
    assert np.isfinite(one.to_numpy()).all()
    with pytest.raises(InputError, match="force_n"):
        cf.deflection(folder / "cell.toml", [[0.0, 0.0, 0.0]] * 3, [[1.0, 0.0, 0.0]] * 2)


def test_preflight_and_posture(folder: Path) -> None:
    checks = cf.preflight(folder / "part.ngc", folder / "cell.toml")
    assert len(checks) > 5
    chosen = cf.choose_posture(folder / "part.ngc", folder / "cell.toml", rotations=12)
    assert chosen.summary["chosen"]["deflection_um"] <= chosen.summary["present"]["deflection_um"]


def modules_loaded(text: str) -> set[str]:
    """Names of the modules that a script loads."""
    program = f"import sys\nimport counterflex as cf\n{text}\nprint(*sys.modules)"
    return set(
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    )


HEAVY = {
    "mujoco",
    "polars",
    "plotly",
    "jinja2",
    "pandas",
    "scipy.spatial",
    "scipy.stats",
    "scipy.optimize",
    "scipy.sparse",
}


def test_reading_a_cell_loads_no_plan_no_loop_and_no_simulation(folder: Path) -> None:
    loaded = modules_loaded(f"cf.read_cell({str(folder / 'cell.toml')!r})")
    assert not loaded & HEAVY
    rooms = ("twin", "evaluate", "identify", "report", "app", "protocols.session")
    assert not {name for name in loaded if name.startswith(tuple(f"counterflex.{room}" for room in rooms))}


@pytest.mark.long
def test_postures_load_no_rotations_of_scipy(folder: Path) -> None:
    """The closed form is compiled; its package loads SciPy's rotations, and can still be imported."""
    asks = f"cf.inverse(cf.read_cell({str(folder / 'cell.toml')!r}), [30.0, 20.0, 38.0], [0.0, 0.0, 1.0])"
    assert "scipy.spatial" not in modules_loaded(asks)
    assert "scipy.spatial" in modules_loaded(f"{asks}\nimport py_opw_kinematics\npy_opw_kinematics.Robot")


def test_results_are_said_in_five_lines(plan: Any, folder: Path) -> None:
    cell = cf.read_cell(folder / "cell.toml")
    results = [plan, cell, cf.read_program(folder / "part.ngc"), cf.SimulatedCell(cell, seed=3), cf.modes(cell)]
    for result in results:
        assert 1 <= len(repr(result).splitlines()) <= 5
        assert "<table" in result._repr_html_()
        assert result.table.height > 0


@given(q=arrays(np.float64, 6, elements=st.floats(-20.0, 20.0)))
@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_inverse_undoes_forward(q: Any, folder: Path) -> None:
    """Place and axis of the tool, found in the base, are those of the part frame that the angles were asked for."""
    cell = cf.read_cell(folder / "cell.toml")
    place, axis = np.array([30.0 + q[0], 20.0 + q[1], 38.0 + q[2]]), np.array([q[3] / 100.0, q[4] / 100.0, 1.0])
    axis = axis / np.linalg.norm(axis)
    there = cf.forward(cell, cf.inverse(cell, place, axis, rotation_about_tool_deg=180.0 + q[5]).to_numpy())
    T = cell.model.T_base_part
    tip_mm = there.select("x_mm", "y_mm", "z_mm").to_numpy()[0]
    assert np.allclose(tip_mm, T[:3, :3] @ place + 1000.0 * T[:3, 3], atol=1e-6)
    assert np.allclose(there.select("tool_i", "tool_j", "tool_k").to_numpy()[0], T[:3, :3] @ axis, atol=1e-9)


def test_compliance_is_the_slope_of_the_deflection(folder: Path) -> None:
    """Under 1 N the finite rotations vanish, so that both agree."""
    cell, place, force = cf.read_cell(folder / "cell.toml"), [20.0, 15.0, 38.0], np.array([0.3, -0.5, 0.8])
    C = cf.compliance(cell, cf.inverse(cell, place).to_numpy()[0])[:3, :3]
    R = cell.model.T_base_part[:3, :3]
    bent = cf.deflection(cell, place, force).select("^deflection_._um$").to_numpy()[0]
    assert np.allclose(bent, R.T @ C @ R @ force, rtol=1e-4)
    shares = cf.deflection(cell, place, force, by_element=True)
    assert shares["share"].sum() == pytest.approx(1.0)
    assert np.allclose(shares.select("^deflection_._um$").sum().to_numpy()[0], bent, rtol=1e-4)


def test_the_mean_of_a_revolution_is_the_closed_form(folder: Path) -> None:
    cut: dict[str, Any] = {"depth_mm": 3.0, "feed_per_tooth_um": 40.0, "arc_deg": (60.0, 180.0)}
    closed = cf.forces(folder / "cell.toml", **cut).row(0, named=True)
    teeth = cf.forces(folder / "cell.toml", **cut, revolution=True, runout_um=0.0, trochoid=False)
    for axis in ("along_n", "left_n", "up_n"):
        assert teeth[axis].mean() == pytest.approx(closed[axis], rel=2e-3, abs=0.05)
    with pytest.raises(cf.CounterflexError, match="a revolution is of one cut"):
        cf.forces(folder / "cell.toml", depth_mm=[1.0, 2.0], feed_per_tooth_um=40.0, revolution=True)
    for revolution in (False, True):  # a mean would go on with an edge where the tool has a shank
        with pytest.raises(cf.CounterflexError, match="deeper than the flutes"):
            cf.forces(folder / "cell.toml", depth_mm=400.0, feed_per_tooth_um=40.0, revolution=revolution)


def test_engagement_of_a_slot_is_its_depth_and_the_diameter(folder: Path) -> None:
    """In the middle of the slot: 2 mm deep by the tool's 16 mm."""
    rows = cf.engagement(folder / "part.ngc", folder / "cell.toml", every_mm=1.0)
    cut = rows.filter(pl.col("volume_mm3") > 0.0).sort("area_mm2").tail(3)
    assert cut["area_mm2"].mean() == pytest.approx(2.0 * 16.0, rel=0.05)
    assert cut["width_mm"].mean() == pytest.approx(16.0, abs=0.2)  # a cell of the blank: 0.1 mm at each side


def test_arrays_are_identified_as_their_files(folder: Path, tmp_path: Path) -> None:
    """A compliance 20 % larger than the cell file says, in arrays; the same numbers in other units give the same."""
    cell, rng = cf.read_cell(folder / "cell.toml"), np.random.default_rng(2)
    q_deg = rng.uniform([-20, -110, 90, -30, 20, -30], [20, -80, 120, 30, 60, 30], (18, 6))
    force_n = 300.0 * np.tile(np.eye(3), (6, 1))
    bent_um = 1.2 * np.stack([cf.compliance(cell, q)[:3, :3] @ f for q, f in zip(q_deg, force_n, strict=True)])
    bent_um += rng.normal(0.0, 3.0, bent_um.shape)
    one: dict[str, Any] = {
        "kind": "pulls",
        "q_deg": q_deg,
        "f_tcp_base_n": force_n,
        "d_tcp_base_um": bent_um,
        "sigma_d_tcp_base_um": 3.0,
    }
    two: dict[str, Any] = {
        "kind": "pulls", "q_rad": np.deg2rad(q_deg), "f_tcp_base_kn": force_n / 1e3, "d_tcp_base_mm": bent_um / 1e3,
        "sigma_d_tcp_base_mm": [3e-3] * 3,
    }  # fmt: skip
    found = [
        cf.identify("stiffness", data, cell, tmp_path / str(k), settings={"regions": False})
        for k, data in enumerate((one, two))
    ]
    head = found[0].summary["headline"][0]
    assert head["value"] < 0.2 * head["nominal"]
    assert np.allclose(found[0].table["value"], found[1].table["value"], rtol=1e-5)
    assert found[0].cell.table.height >= cell.table.height
    with pytest.raises(cf.CounterflexError, match="no such channel"):
        cf.identify("stiffness", one | {"d_tool_um": bent_um}, cell, tmp_path / "wrong")
    with pytest.raises(cf.CounterflexError, match="no such recipe"):
        cf.identify("stifness", one, cell, tmp_path / "wrong")


def test_a_plan_is_saved_as_the_command_writes_it(plan: Any, folder: Path, tmp_path: Path) -> None:
    from counterflex.app.compensation import compensate

    compensate.run(folder / "part.ngc", folder / "cell.toml", tmp_path / "command")
    plan.save(tmp_path / "script")
    names = {file.name for file in (tmp_path / "command").iterdir()}
    assert {file.name for file in (tmp_path / "script").iterdir()} == names
    for name in names - {"summary.json", "report.html"}:  # they hold the seconds that it took
        assert (tmp_path / "script" / name).read_bytes() == (tmp_path / "command" / name).read_bytes(), name


def test_one_part_is_drawn_as_one(folder: Path) -> None:
    """Its picture shows no second curve that would pass for the compensated part."""
    picture = cf.simulate(folder / "part.ngc", folder / "cell.toml", seed=3).plot("path")
    assert {trace.name for trace in picture.data} == {"as machined"}


def test_a_cell_that_is_saved_elsewhere_still_finds_its_blank(folder: Path, tmp_path: Path) -> None:
    stock = cf.read_cell(folder / "cell.toml").model.stock()
    stock.save(folder / "blank.npz")
    text = (folder / "cell.toml").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith(("box_min_mm", "box_max_mm"))]
    at = lines.index("[part.stock]")
    (folder / "resumed.toml").write_text("\n".join([*lines[: at + 1], 'result = "blank.npz"', *lines[at + 1 :]]) + "\n")
    saved = cf.read_cell(folder / "resumed.toml").save(tmp_path / "deep" / "cell.toml")
    assert np.array_equal(cf.read_cell(saved).model.stock().z, stock.z)


def test_a_program_is_saved_with_the_files_that_it_calls(tmp_path: Path) -> None:
    main = "DEF job( )\n$BASE=BASE_DATA[1]\n$VEL.CP=0.02\nLIN {X 0.0,Y 0.0,Z 5.0,A 0.0,B 0.0,C 180.0}\nCUT( )\nEND\n"
    (tmp_path / "job.src").write_text(main, encoding="utf-8")
    (tmp_path / "CUT.src").write_text("DEF CUT( )\nLIN {X 20.0}\nEND\n", encoding="utf-8")
    program = cf.read_program(tmp_path / "job.src")
    assert cf.read_program(program.save(tmp_path / "copy")).table.equals(program.table)
