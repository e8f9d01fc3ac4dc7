"""Recipe holder: recovery from the frame of beams, new tools uncalibrated, the printed errors and better ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.progress import silent
from counterflex.files.cell.cell import read_cell
from counterflex.identify.data.changes import TableValues
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.identify.holder.proposal import SPACING_M, choose_gauges, places
from counterflex.identify.holder.recipe import RECIPE
from counterflex.identify.holder.residuals import parameters, readings
from counterflex.identify.recipe import Identification
from counterflex.sensing.force_filter import kalman_observer
from counterflex.sensing.strain_holder import Gauge, HolderBeam, StrainHolder, regressed_matrix, sight, tool_matrix
from counterflex.twin.laboratory.holder_loads import COLUMNS, cut_record, measure
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.plant.strain_holder import (
    NOISE,
    PAPER_GAUGES,
    PAPER_TCP_M,
    SAMPLE_S,
    WANDER,
    instrumented_holder,
)
from derivative_check import convergence_order

BEAM = HolderBeam(0.18, 0.16, 0.015, 0.118)
TCP = np.array(PAPER_TCP_M)
SEEDS = (0, 1)


@cache
def cell() -> Any:
    return read_cell("examples/cells/kr300_d16_small.toml")


@cache
def truth() -> Any:
    return truth_of(cell(), 1)


def designed(gauges: Any = PAPER_GAUGES) -> StrainHolder:
    items = tuple(Gauge((r[0], r[1], r[2]), r[3], r[4]) for r in gauges)
    return StrainHolder.designed(BEAM, items, TCP, NOISE)


def model(gauges: Any = PAPER_GAUGES) -> CellModel:
    return replace(model_of(cell()), tables={"holder": designed(gauges)})


@cache
def chosen() -> tuple[tuple[float, ...], ...]:
    return tuple((*g.p_holder_gauge, g.angle_rad, g.factor) for g in choose_gauges(BEAM, TCP))


def loaded(columns: Any, gauges: Any, seed: int, session: str = "") -> Dataset:
    day = replace(laboratory(seed), session=session)
    m = measure(truth(), day, columns, {"gauges": gauges}, silent)
    return of_arrays("loads", "holder_loads", m.channels, m.sigma, group=m.group)


def as_in_the_paper(p: Float, largest: float = 300.0, repeats: int = 3) -> dict[str, Float]:
    """Each direction of the machine alone, both ways in the plane, only towards the spindle along the axis."""
    directions = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, -1)]
    rows = [
        [*(share * largest * np.array(d)), *p]
        for _ in range(repeats)
        for d in directions
        for share in (0.33, 0.67, 1.0)
    ]
    return {name: np.array(rows)[:, i] for i, name in enumerate(COLUMNS)}


@cache
def proposed(gauges: str, count: int = 24) -> Any:
    return RECIPE.propose(model(chosen() if gauges == "chosen" else PAPER_GAUGES), count, {})


@cache
def identified(gauges: str, seed: int = 3) -> Identification:
    places_of = chosen() if gauges == "chosen" else PAPER_GAUGES
    data = loaded(proposed(gauges).columns, places_of, seed)
    return RECIPE.identify(model(places_of), [data], [], {}, silent)


def sensitivity(found: Identification) -> Float:
    return found.fits["holder"].values[:36].reshape(6, 6)


def test_derivatives_are_exact() -> None:
    data = loaded(proposed("paper", 8).columns, PAPER_GAUGES, 0)
    block = readings(data, designed(), reference_c=22.0)
    free = parameters(designed(), 0.3, temperature=True, drift=True)
    sizes = np.array([p.prior_sigma for p in free])
    assert np.all(convergence_order(block, free.nominal, sizes) > 1.9)


def test_sensitivities_of_the_frame_come_back() -> None:
    found = identified("chosen")
    true = instrumented_holder(chosen(), 3).sensitivity
    drawn = designed(chosen()).sensitivity
    for p in (TCP, TCP - [0.0, 0.0, 0.06]):
        K, K_true, K_drawn = (tool_matrix(S, p) for S in (sensitivity(found), true, drawn))
        assert np.linalg.norm(K - K_true) < 0.02 * np.linalg.norm(K_true)
        assert np.linalg.norm(K_drawn - K_true) > 3.0 * np.linalg.norm(K - K_true)
    first = found.headline[0]
    assert first.nominal is not None
    assert first.value < 0.2 * first.nominal
    assert first.value < 4.0


@pytest.mark.long
def test_intervals_cover_the_true_strain_of_a_load() -> None:
    inside = []
    for seed in range(5):
        found = identified("chosen", 20 + seed)
        fit = found.fits["holder"]
        true = instrumented_holder(chosen(), 20 + seed).sensitivity
        for axis, lever in ((0, 4), (1, 3)):
            for bridge in range(6):
                k = [6 * bridge + axis, 6 * bridge + lever]
                place = [int(np.flatnonzero(fit.free_index == i)[0]) for i in k]
                h = np.array([1.0, TCP[2] * (1.0 if lever == 4 else -1.0)])
                slope = fit.parameters.slope(fit.values)[k] * h
                sigma = np.sqrt(slope @ fit.covariance[np.ix_(place, place)] @ slope)
                inside.append(abs(h @ (fit.values[k] - true[bridge, [axis, lever]])) < 1.96 * sigma)
    assert np.mean(inside) > 0.85  # hysteresis is no white noise


def test_a_longer_tool_needs_no_calibration_of_its_own() -> None:
    """Calibrated at two points, used with a tool 60 mm longer; the old matrix is far off there."""
    found, p = identified("chosen"), TCP + np.array([0.0, 0.0, 0.06])
    true = instrumented_holder(chosen(), 3)
    forces = 200.0 * np.array([[1.0, 0, 0], [0, 1, 0], [0.6, -0.5, -0.6]])
    strain = true.still(forces, p)
    holder = replace(designed(chosen()), sensitivity=sensitivity(found))
    new = strain @ holder.matrix(p).T - forces
    old = strain @ holder.matrix(TCP).T - forces
    assert np.max(np.linalg.norm(new, axis=1)) < 0.03 * 200.0
    assert np.max(np.linalg.norm(old, axis=1)) > 0.10 * 200.0


@pytest.mark.long
def test_loads_at_one_point_leave_longer_tools_to_the_drawing_and_say_so() -> None:
    data = loaded(as_in_the_paper(TCP), PAPER_GAUGES, 1)
    found = RECIPE.identify(model(), [data], [], {}, silent)
    assert any("depends on the drawing" in r for r in found.remarks)
    assert not any("depends on the drawing" in r for r in identified("paper").remarks)
    fit = found.fits["holder"]
    assert fit.rank < len(fit.free_index)
    assert len(fit.hidden) > 0


@cache
def errors_in_the_cut(gauges: str, how: str) -> Float:
    """Half widths (3,) N that hold 95 % of the error of a revolution's mean force, over a cut; mean of seeds."""
    places_of = chosen() if gauges == "chosen" else PAPER_GAUGES
    out = []
    for seed in SEEDS:
        t, force, strain, warm = cut_record(instrumented_holder(places_of, seed), TCP, np.random.default_rng(seed))
        air = t < 0.4
        if how == "regression":
            data = loaded(as_in_the_paper(TCP), places_of, seed)
            M, _ = regressed_matrix(data.values("strain"), data.values("f_tcp_holder"))
            shown = (strain - strain[air].mean(axis=0)) @ M.T
        else:
            found = identified(gauges, seed)
            K = tool_matrix(sensitivity(found), TCP)
            s = strain - np.outer(warm - warm[0], found.fits["holder"].values[42:48])
            observer = kalman_observer(
                K,
                np.eye(6) * NOISE**2,
                step_s=SAMPLE_S,
                slew_n=np.array([1000.0, 1000.0, 30.0]),
                wander=np.full(6, WANDER),
            )
            assert np.all(observer.delay_s < 50e-3)
            shown = observer.run(s - s[air].mean(axis=0))
        one_turn = np.ones(5) / 5.0
        error = np.stack([np.convolve(shown[:, i] - force[:, i], one_turn, "valid") for i in range(3)], axis=1)
        out.append(np.quantile(np.abs(error), 0.95, axis=0))
    mean: Float = np.mean(out, axis=0)
    return mean


def test_printed_layout_gives_the_printed_errors() -> None:
    """Feed and radial +-10 N, axial +-50 N, and rows x and z of the matrix that nearly repeat each other."""
    feed, radial, axial = errors_in_the_cut("paper", "regression")
    assert 6.0 < feed < 15.0
    assert 6.0 < radial < 15.0
    assert 35.0 < axial < 65.0
    data = loaded(as_in_the_paper(TCP), PAPER_GAUGES, 0)
    M, _ = regressed_matrix(data.values("strain"), data.values("f_tcp_holder"))
    x, z = M[0] / np.linalg.norm(M[0]), M[2] / np.linalg.norm(M[2])
    assert abs(x @ z) > 0.7


def test_better_places_and_an_observer_reach_ten_newtons_on_all_axes() -> None:
    assert np.all(errors_in_the_cut("chosen", "observer") <= 10.0)


@pytest.mark.long
def test_each_of_both_helps() -> None:
    printed = errors_in_the_cut("paper", "regression")
    assert errors_in_the_cut("chosen", "regression")[2] < 0.6 * printed[2]
    assert errors_in_the_cut("paper", "observer")[2] < 0.7 * printed[2]


def test_chosen_places_beat_chance_and_keep_apart() -> None:
    gauges = choose_gauges(BEAM, TCP)
    p = np.array([g.p_holder_gauge for g in gauges])
    distance = np.linalg.norm(p[:, None] - p[None], axis=2) + np.eye(6)
    assert distance.min() >= SPACING_M

    def volume(items: Any) -> float:
        K = tool_matrix(BEAM.sensitivity(items), TCP)
        return float(np.linalg.slogdet(K.T @ K)[1])

    found, rng = places(BEAM, 2.0), np.random.default_rng(0)
    others = [volume([found[i] for i in rng.choice(len(found), 6, replace=False)]) for _ in range(60)]
    assert volume(gauges) > max(others)
    with pytest.raises(InputError, match="bridges"):
        choose_gauges(BEAM, TCP, 2)


def test_proposal_says_what_to_expect() -> None:
    proposal = RECIPE.propose(model(), 24, {"gauges": "choose"})
    assert proposal.kind == "holder_loads"
    assert np.all(proposal.columns["fz_n"] <= 0.0)
    assert len({float(z) for z in proposal.columns["pz_m"]}) == 2
    gauges = np.array(proposal.settings["gauges"]).reshape(6, 5)
    assert not np.allclose(gauges, np.array(PAPER_GAUGES))
    fit = identified("chosen").fits["holder"]
    for name in ("bridge1.fx", "bridge3.my"):
        stated = proposed("chosen").expected[name]
        assert 0.2 < fit.sigma_of(name) / stated < 6.0
    with pytest.raises(InputError, match="loads to propose"):
        RECIPE.propose(model(), 3, {})
    with pytest.raises(InputError, match="gauges"):
        RECIPE.propose(model(), 12, {"gauges": "anywhere"})


def test_figures_name_condition_cross_talk_and_hysteresis() -> None:
    found = RECIPE.identify(model(), [loaded(as_in_the_paper(TCP), PAPER_GAUGES, 1)], [], {}, silent)
    figures = {f.name: f.value for f in found.figures}
    assert figures["condition"] > 3.0
    for name in ("cross_talk_x_share", "cross_talk_y_share", "hysteresis_share"):
        assert abs(figures[name]) < 0.1
    for name in ("holdout_ordinary_n", "holdout_ridge_n", "holdout_weighted_n"):
        assert 0.0 < figures[name] < 60.0
    seen = sight(tool_matrix(sensitivity(found), TCP), np.eye(6) * NOISE**2)
    assert abs(seen.directions[2] @ [0.0, 0.0, 1.0]) > 0.9


def test_the_table_of_the_cell_file_keeps_what_was_found() -> None:
    found = identified("chosen")
    change = found.changes[0]
    assert isinstance(change, TableValues)
    rows = np.array(change.values["sensitivity_um_m_per_kn"])
    np.testing.assert_allclose(rows * 1e-9, sensitivity(found), rtol=1e-4, atol=1e-15)


@pytest.mark.parametrize(
    ("what", "change"),
    [
        ("sign", lambda f: -f),
        ("kN", lambda f: 1e-3 * f),
        ("swapped", lambda f: f[:, [1, 0, 2]]),
    ],
)
def test_mistakes_in_the_forces_are_named(what: str, change: Callable[[Float], Float]) -> None:
    data = loaded(proposed("chosen").columns, chosen(), 3)
    old = data.channels["f_tcp_holder"]
    wrong = replace(data, channels={**data.channels, "f_tcp_holder": replace(old, values=change(old.values))})
    with pytest.raises(InputError, match=what):
        RECIPE.identify(model(chosen()), [wrong], [], {}, silent)


def test_poor_loads_are_named() -> None:
    columns = as_in_the_paper(TCP)
    flat = {**columns, "fz_n": np.zeros_like(columns["fz_n"])}
    keep = np.abs(flat["fx_n"]) + np.abs(flat["fy_n"]) > 1.0
    with pytest.raises(InputError, match=r"one plane.*along"):
        RECIPE.identify(model(), [loaded({k: v[keep] for k, v in flat.items()}, PAPER_GAUGES, 0)], [], {}, silent)
    few = {k: v[:4] for k, v in columns.items()}
    with pytest.raises(InputError, match="too few loads"):
        RECIPE.identify(model(), [loaded(few, PAPER_GAUGES, 0)], [], {}, silent)


def test_not_a_number_and_other_bridges_are_named() -> None:
    data = loaded(as_in_the_paper(TCP), PAPER_GAUGES, 0)
    data.channels["strain"].values[3, 2] = np.nan
    with pytest.raises(FileFormatError, match=r":4: .*'strain'.*not a number"):
        RECIPE.identify(model(), [data], [], {}, silent)
    with pytest.raises(InputError, match="number of bridges"):
        RECIPE.identify(model(PAPER_GAUGES[:5]), [loaded(as_in_the_paper(TCP), PAPER_GAUGES, 0)], [], {}, silent)
    with pytest.raises(InputError, match=r"no instrumented spindle holder.*\[holder\]"):
        RECIPE.propose(replace(model(), tables={}), 12, {})
