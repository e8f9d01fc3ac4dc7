"""Figures of the papers: rules and verdicts, every row has its function, ours against computations by hand."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.core.errors import FileFormatError, InputError
from counterflex.robot.elasticity.chain import frames
from counterflex_lab.reproduce.papers import berger2013, denkena2015, experiments, haehn2020, mandiola2023, table
from counterflex_lab.reproduce.papers.read import PAPERS, paper, stored
from counterflex_lab.reproduce.papers.row import Row, rule_of

ROOT = Path(__file__).parents[2]
ROW = Row("x", "eq. 1", "x", "2.0", "mm", rule_of({"between": [1.9, 2.1], "because": "rounding"}, "2.0", "x"), "why")


@pytest.mark.parametrize(
    ("value", "verdict"),
    [(1.9, "reproduced"), (2.1, "reproduced"), (2.11, "differs"), (None, "cannot be checked")],
)
def test_the_verdict_follows_from_the_number(value: float | None, verdict: str) -> None:
    assert ROW.verdict(value) == verdict
    assert replace(ROW, rule=None).verdict(2.0) == "cannot be checked"


@pytest.mark.parametrize(
    ("rule", "printed", "inside", "outside"),
    [
        ("digits", "5.5", (5.45, 5.55), (5.44, 5.56)),
        ("digits", "0.125", (0.1245, 0.1255), (0.124, 0.126)),
        ("digits", "2", (1.5, 2.5), (1.49, 2.51)),
        ("equal", "15", (15.0,), (14.0, 16.0)),
        ({"share": 0.35, "because": "b"}, "1.8", (1.1701, 2.4299), (1.16, 2.44)),
        ({"share": 0.1, "because": "b"}, "-2", (-2.19, -1.81), (-2.3, -1.7)),
        ({"between": [95, 155], "because": "b"}, "100 to 150", (95.0, 155.0), (94.9, 155.1)),
        ({"at_most": 10.0, "because": "b"}, "+-10", (-99.0, 10.0), (10.1,)),
        ({"at_least": 90.0, "because": "b"}, "all", (90.0, 1e6), (89.9,)),
    ],
)
def test_rules(rule: Any, printed: str, inside: tuple[float, ...], outside: tuple[float, ...]) -> None:
    made = rule_of(rule, printed, "here")
    assert all(made.holds(value) for value in inside)
    assert not any(made.holds(value) for value in outside)


@pytest.mark.parametrize(
    ("rule", "printed"),
    [
        ("digits", "about 5"),
        ("exact", "5"),
        ({"share": 0.1}, "5"),
        ({"share": 0.1, "because": ""}, "5"),
        ({"factor": 2.0, "because": "b"}, "5"),
    ],
)
def test_what_is_no_rule_is_refused(rule: Any, printed: str) -> None:
    with pytest.raises(FileFormatError, match="here"):
        rule_of(rule, printed, "here")


@pytest.mark.parametrize("name", PAPERS)
def test_every_row_has_its_function_and_no_function_is_left(name: str) -> None:
    at_once, measured = table.functions(name)
    rows = paper(name).rows
    assert {row.name for row in rows if row.rule is not None and not row.stored} == set(at_once)
    assert {row.name for row in rows if row.stored} == set(measured)
    assert all(row.reason for row in rows)


@pytest.mark.parametrize("name", PAPERS)
def test_every_assumption_and_experiment_is_used(name: str) -> None:
    item = paper(name)
    assert {key for row in item.rows for key in row.assumed} == set(item.assumptions)
    assert {row.stored for row in item.rows if row.stored} == set(item.experiments)
    assert set(item.experiments) <= {*experiments.EXPERIMENTS, *experiments.BENCHMARKS}
    assert len(item.left_open) >= 3


def test_stored_results_name_command_cells_and_version() -> None:
    names = {name for item in map(paper, PAPERS) for name in item.experiments}
    found = {name: data for name in names if (data := stored(name)) is not None}
    assert len(found) >= 5
    for data in found.values():
        assert set(data) == {"command", "cells", "version", "results"}
        assert data["command"].startswith(("counterflex ", "python benchmarks/"))


def test_drawings_of_holders_are_those_of_the_examples() -> None:
    folder = Path(experiments.__file__).parent / "data" / "holders"
    for name in ("bridged.toml", "across.toml"):
        assert (folder / name).read_text() == (ROOT / "examples" / "holders" / name).read_text()


def test_long_without_a_folder_is_refused() -> None:
    with pytest.raises(InputError, match="--out"):
        table.run(("berger2013",), long=True)


# --- ours by hand -----------------------------------------------------------------------------------------------------


def test_berger_formulas_by_hand() -> None:
    ours = berger2013.OURS
    assert ours["eq_1_slot"]() == pytest.approx(math.pi / 2.0, rel=1e-5)
    phi = math.acos(0.9)
    assert ours["eq_1_wall"]() == pytest.approx(phi / (1.0 - math.cos(phi)), rel=1e-12)
    assert ours["point_distance"]() == pytest.approx(2040.0 * 45.0 / 60.0 / 1000.0)
    assert ours["rpm_steel"]() == pytest.approx(84.0 / (math.pi * 0.006))
    assert ours["feed_aluminium"]() == pytest.approx(17000 * 4 * 0.03)
    # (2 phi - sin 2 phi) / (1 - cos 2 phi) = k_r / k_c without exponent (tool steel is not; with one it is near)
    width = ours["zero_normal_steel"]()
    phi = math.acos(1.0 - 2.0 * width)
    assert (2.0 * phi - math.sin(2.0 * phi)) / (1.0 - math.cos(2.0 * phi)) == pytest.approx(berger2013.RATIO, rel=0.1)


def test_chip_of_a_circle_against_the_trochoid_in_second_order() -> None:
    """Ratio of feed to circumference of a tooth, 0.03 * 4 / (2 pi * 3): the gap is of that order, %."""
    order = 100.0 * 0.03 * 4.0 / (2.0 * math.pi * 3.0)
    assert 0.2 * order < berger2013.OURS["circle_aluminium"]() < 2.0 * order


def test_compliance_of_the_printed_equations_is_that_of_unit_loads() -> None:
    """Eq. 3-6 against deflections under unit loads by the finite rotations of Haehn2020 eq. 1-9, small loads."""
    chain, q, _ = haehn2020.loaded_poses()
    soft = replace(chain, compliance=np.where(chain.compliance > 0.0, chain.compliance, 1e-14))
    R = frames(chain, q[7])[-1][:3, :3] @ chain.T_last_tcp[:3, :3]
    C = denkena2015.printed_compliance(soft, q[7])[:3, :3]
    for force in np.eye(3):
        moved = haehn2020.printed_deflection(chain, q[7], 1e-3 * force) * 1e3
        np.testing.assert_allclose(R @ C @ R.T @ force, moved, rtol=1e-4, atol=1e-10)


def test_denkena_matrix_by_hand() -> None:
    a, c = denkena2015.M[0], denkena2015.M[2]
    cosine = float(sum(x * y for x, y in zip(a, c, strict=True)) / math.sqrt((a @ a) * (c @ c)))
    assert denkena2015.OURS["independent_forces"]() == pytest.approx(cosine)
    assert denkena2015.OURS["determined"]() == 9.0
    # more loads at the same point determine no more
    loads = np.random.default_rng(1).normal(size=(1000, 3))
    assert np.linalg.matrix_rank(loads @ np.linalg.pinv(denkena2015.M).T) == 3


def test_fourteen_of_fifteen_terms_are_independent_however_many_orientations() -> None:
    assert haehn2020.independent_terms(27) == haehn2020.independent_terms(500) == 14


def test_eq_16_as_printed_and_as_meant() -> None:
    angles = np.radians([20.0, -35.0, 50.0])
    a, b, c = 0.5 * angles
    meant = np.array(
        [
            np.cos(a) * np.cos(b) * np.cos(c) + np.sin(a) * np.sin(b) * np.sin(c),
            np.sin(a) * np.cos(b) * np.cos(c) - np.cos(a) * np.sin(b) * np.sin(c),
            np.cos(a) * np.sin(b) * np.cos(c) + np.sin(a) * np.cos(b) * np.sin(c),
            np.cos(a) * np.cos(b) * np.sin(c) - np.sin(a) * np.sin(b) * np.cos(c),
        ]
    )
    assert np.linalg.norm(meant) == pytest.approx(1.0)
    assert np.linalg.norm(haehn2020.quaternion_as_printed(angles)) != pytest.approx(1.0, abs=0.1)


def test_signals_at_an_exit() -> None:
    """Before and after all signals agree; a prediction leads by the lead; with it the correction acts earlier."""
    s = haehn2020.exit_signals()
    for signal in (s.measured_n, s.predicted_n, s.blended_n, s.measured_acts_n, s.blended_acts_n):
        assert signal[0] == pytest.approx(haehn2020.FORCE_N)
        assert signal[-1] == pytest.approx(0.0, abs=1.0)
    shift = round(haehn2020.LEAD_S / haehn2020.PERIOD_S)
    np.testing.assert_allclose(s.predicted_n[:-shift], s.force_n[shift:], atol=1e-9)
    falls = {
        name: np.argmax(getattr(s, name) < 0.5 * haehn2020.FORCE_N) for name in ("measured_acts_n", "blended_acts_n")
    }
    assert falls["blended_acts_n"] < falls["measured_acts_n"]


def test_mandiola_by_hand() -> None:
    assert mandiola2023.OURS["gain"]() == pytest.approx(2.5)
    assert mandiola2023.OURS["trailing"]() == pytest.approx(700.0 / 60.0 / 11.0)
    # eq. 1 for a tracker that looks along its z axis with the target turned by 90 deg about it
    half = math.sqrt(0.5)
    T = mandiola2023.printed_pose(2.0, 0.0, 0.0, np.array([half, 0.0, 0.0, half]))
    np.testing.assert_allclose(T, [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]], atol=1e-12)


GROOVE: Mapping[str, Any] = {
    "table": {
        "uncompensated": {"straight": {"path": [1.5, 1.6], "exit": [1.2, 1.3]}},
        "force": {"straight": {"path": [1.4, 1.5], "exit": [0.7, 1.0]}, "oblique": {"path": [0.6, 0.7]}},
        "force_pilot": {"straight": {"path": [0.3, 0.4], "exit": [0.2, 0.3]}},
    }
}


def test_ours_of_the_groove_come_from_its_table() -> None:
    ours = {name: function(GROOVE) for name, function in haehn2020.MEASURED.items() if name not in _CUBES}
    assert ours["uncompensated"] == 1.5
    assert ours["at_exit"] == 0.5
    assert ours["cartesian_oblique"] == 0.6
    assert ours["reduction"] == pytest.approx(80.0)
    assert ours["pilot"] is None
    assert ours["axes"] is None


_CUBES = ("cubes", "determined")


def test_ours_of_the_holder_come_from_its_designs() -> None:
    bridged = {"compliance_um_per_kn": {"without_pockets": [90.0, 100.0, 10.0], "with_pockets": [100.0, 125.0, 20.0]}}
    run = experiments.design_results(bridged, {"bridges": [{"rib_gain": 2.0}, {"rib_gain": 2.2}]})
    names = ("holder_x", "lost_x", "lost_y", "lost_z", "stiffest_axis", "bridged_notch")
    ours = [denkena2015.MEASURED[name](run) for name in names]
    assert ours == pytest.approx([0.09, 10.0, 20.0, 50.0, 0.2, 2.2])


def test_table_of_the_groove_leaves_refused_runs_out() -> None:
    def run(size: float, state: str) -> dict[str, Any]:
        figures = {key: {"max_mm": size} for key in ("path", "exit")}
        return {**figures, "loop": {"states": ["armed", state], "causes": []}}

    rows = [
        {"edge": "straight", "variants": {"force": run(1.0, "active")}},
        {"edge": "straight", "variants": {"force": run(3.0, "active")}},
        {"edge": "straight", "variants": {"force": run(9.0, "faulted")}},
    ]
    assert experiments.groove_table(rows) == {"force": {"straight": {"path": [2.0, 3.0], "exit": [2.0, 3.0]}}}


def test_ours_of_the_paths_are_the_worst_of_the_truths() -> None:
    def variant(size: float) -> dict[str, Any]:
        figures = {"contour": {"max_um": size, "rms_um": size}, "total": {"max_um": 10.0 * size, "rms_um": size}}
        return {"circle": {"turn": figures}, "square": {"straights": figures, "corners": figures}}

    seeds = [{"variants": {name: variant(k * 100.0) for name in ("off", "published", "designed")}} for k in (1, 2)]
    run = {"seeds": seeds, "reductions": [{"published": {"circle_contour_rms": v}, "designed": {}} for v in (0.7, 0.6)]}
    ours = {name: function(run) for name, function in mandiola2023.MEASURED.items()}
    assert ours["moving"] == pytest.approx(2.0)
    assert ours["circle"] == pytest.approx(0.2)
    assert ours["corners"] == pytest.approx(10.0)
    assert ours["circle_published"] == pytest.approx(60.0)
    assert ours["circle_designed"] is None
    assert ours["static"] is None


def test_curves_keep_the_largest_error_of_each_stretch() -> None:
    x = np.linspace(0.0, 10.0, 5001)
    y = np.where(x == 5.0, -3.0, 0.1)
    y[:100] = np.nan
    curve = experiments._curve(x, y, 0.01)
    assert len(curve) == experiments.CURVE_POINTS
    assert [5.0, -3.0] in curve
    assert curve[0] == [0.0, None]


def test_rules_name_their_reason() -> None:
    for name in PAPERS:
        for row in paper(name).rows:
            assert row.rule is None or re.fullmatch(r"the printed digits|equal|.+: .+", row.rule.text)
