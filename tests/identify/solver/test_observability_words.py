"""What the data cannot see is named, with what stands in for it, in words; what they can see is not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.identify.solver.observability import examine
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.identify.solver.solve import solve

OFFSET = Parameter("axis1.offset", "rad", 0.0, 2e-3, label="zero of axis 1")


def _examined(J: Float, parameters: Parameters) -> Any:
    known = np.array([p.has_prior for p in parameters])
    C = np.linalg.pinv(J.T @ J + np.diag(known.astype(float)), rcond=1e-14)
    return examine(parameters, np.arange(len(parameters)), J, np.sqrt(np.maximum(np.diag(C), 0.0)), known)


def _set(names: str, *, unknown: str = "", unit: str = "m", log: str = "") -> Parameters:
    return Parameters.of(
        Parameter(n, unit, 1.0, np.inf if n in unknown else 1e-3, scale=1e-3, log=n in log) for n in names
    )


def test_an_offset_behind_a_frame_is_named_with_sizes(arm: Any) -> None:
    rng = np.random.default_rng(0)
    parameters = arm.parameters(axis1_offset=OFFSET)
    fit = solve(parameters, [arm.points(parameters.nominal, rng)])
    assert len(fit.hidden) == 1
    assert fit.hidden[0] == (
        "zero of axis 1 cannot be separated from base.turn: 0.115 deg of one have the effect of 0.115 deg of "
        "the other; "
        "it keeps its former value"
    )
    assert fit.rank == len(fit.free_index) - 1
    assert fit.condition > 1e9
    assert fit.seen[parameters.index("axis1.offset")] == "prior"
    assert fit.sigma_of("axis1.offset") == pytest.approx(2e-3)


def test_without_prior_nothing_holds_it(arm: Any) -> None:
    rng = np.random.default_rng(1)
    loose = Parameter("axis1.offset", "rad", 0.0, np.inf, scale=1e-2, label="zero of axis 1")
    parameters = arm.parameters(axis1_offset=loose)
    points = arm.points(parameters.nominal, rng)
    fit = solve(parameters, [points])
    assert len(fit.hidden) == 1
    assert "zero of axis 1" in fit.hidden[0]
    assert "base.turn" in fit.hidden[0]
    assert "not determined" in fit.hidden[0]
    assert fit.sigma_of("axis1.offset") > 1e3
    # All others are as if one of the two were held.
    other = solve(arm.parameters(), [points])
    for name in ("link1.length", "axis2.offset", "base.x"):
        assert fit.value(name) == pytest.approx(other.value(name), abs=1e-3 * other.sigma_of(name))
        assert fit.sigma_of(name) == pytest.approx(other.sigma_of(name), rel=1e-3)


def test_without_loads_compliances_are_not_seen(arm: Any) -> None:
    rng = np.random.default_rng(2)
    parameters = arm.parameters()
    fit = solve(parameters, [arm.points(parameters.nominal, rng, load_n=0.0)])
    assert fit.hidden == (
        "not determined by these measurements: compliance of axis 1, compliance of axis 2 (they keep their former "
        "values)",
    )


def test_all_seen_is_silent(arm: Any) -> None:
    rng = np.random.default_rng(3)
    parameters = arm.parameters()
    fit = solve(parameters, [arm.points(parameters.nominal, rng, load_n=3000.0)])
    assert fit.hidden == ()
    assert all(fit.seen[i] == "determined" for i in fit.free_index)
    assert fit.rank == len(fit.free_index)
    assert fit.seen[parameters.index("axis1.offset")] == "held"


def test_several_stand_in_for_one() -> None:
    rng = np.random.default_rng(4)
    B = 100.0 * rng.standard_normal((30, 2))
    found = _examined(np.column_stack([B, B @ [1.0, 1.0]]), _set("abc"))
    assert len(found.hidden) == 1
    assert "only combinations are determined" in found.hidden[0]
    assert all(name in found.hidden[0] for name in ("a", "b", "c"))


def test_two_pairs_are_not_mixed() -> None:
    rng = np.random.default_rng(5)
    B = 100.0 * rng.standard_normal((30, 3))
    J = np.column_stack([B[:, 0], 2.0 * B[:, 0], B[:, 1], -B[:, 1], B[:, 2]])
    found = _examined(J, _set("abcde"))
    assert len(found.hidden) == 2
    pairs = [{name for name in "abcde" if f"{name} cannot" in s or f"separated from {name}" in s} for s in found.hidden]
    assert {frozenset(p) for p in pairs} == {frozenset("ab"), frozenset("cd")}
    first = next(s for s in found.hidden if "separated from a" in s or "a cannot" in s)
    assert "1 mm of one have the effect of 2 mm" in first or "1 mm of one have the effect of 0.5 mm" in first
    second = next(s for s in found.hidden if s != first)
    assert "1 mm of one have the effect of -1 mm" in second


def test_nearly_degenerate_pairs_are_named_where_noise_covers_the_difference() -> None:
    rng = np.random.default_rng(6)
    B = 100.0 * rng.standard_normal((30, 2))
    near = _examined(np.column_stack([B[:, 0], B[:, 0] + 1e-3 * B[:, 1]]), _set("ab"))
    assert near.rank == 2
    assert len(near.hidden) == 1
    apart = _examined(np.column_stack([B[:, 0], B[:, 0] + 0.1 * B[:, 1]]), _set("ab"))
    assert apart.hidden == ()


def test_logarithmic_parameters_change_in_percent() -> None:
    B = 1000.0 * np.random.default_rng(7).standard_normal((30, 1))
    (sentence,) = _examined(np.column_stack([B, B]), _set("ab", log="ab")).hidden
    assert "0.1 % of one have the effect of" in sentence


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), unknown=st.sampled_from(["", "a", "ab"]))
def test_named_directions_are_indeed_unseen(seed: int, unknown: str) -> None:
    """Holding every parameter that leads a sentence leaves nothing hidden."""
    rng = np.random.default_rng(seed)
    B = 100.0 * rng.standard_normal((20, 4))
    mix = rng.integers(-1, 2, (4, 6)).astype(np.float64)
    parameters = _set("abcdef", unknown=unknown)
    found = _examined(B @ mix, parameters)
    lost = 6 - np.linalg.matrix_rank(mix)
    assert found.rank == 6 - lost
    leads = [s.split(" cannot be separated")[0] for s in found.hidden if " cannot be separated" in s]
    blind = [s.split(": ")[1].split(" (")[0].split(", ") for s in found.hidden if s.startswith("not determined by")]
    named = {*leads, *(name for part in blind for name in part)}
    assert len(named) == lost
    keep = [i for i, name in enumerate("abcdef") if name not in named]
    assert np.linalg.matrix_rank(mix[:, keep]) == len(keep)
