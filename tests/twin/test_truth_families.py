"""Families of truths: the mild one is what it was, the wide one is as wide as stated, files say which they are."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given as for_all, strategies as st

from counterflex.app.proof.truth import make_truth, truth_of
from counterflex.cli import arguments
from counterflex.cli.arguments import MOST_SEEDS
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.twin.truth.family import FAMILIES, MILD, REPORTING_SEEDS, TUNING_SEEDS, WIDE, family_of
from counterflex.twin.truth.file import read_truth, to_dict
from counterflex.twin.truth.truth import Truth

CELL = Path(__file__).parents[2] / "examples" / "cells" / "kr300_d16_small.toml"
COUNT = 200


@pytest.fixture(scope="module")
def cell() -> Cell:
    return read_cell(CELL)


@pytest.fixture(scope="module")
def wide(cell: Cell) -> list[Truth]:
    return [truth_of(cell, seed, WIDE) for seed in range(COUNT)]


@pytest.mark.parametrize(
    ("seed", "digest"), [(0, "7f80a552764019bd"), (1, "f385431611b8c114"), (7, "3927afbf018cfc84")]
)
def test_the_mild_truths_are_those_of_before_there_were_families(cell: Cell, seed: int, digest: str) -> None:
    data = to_dict(truth_of(cell, seed))
    assert data.pop("family") == "mild"
    rounded = json.dumps(json.loads(json.dumps(data), parse_float=_rounded), sort_keys=True)
    assert hashlib.sha256(rounded.encode()).hexdigest()[:16] == digest


def _rounded(number: str) -> str:
    """Exponentials differ in their last digit from one processor to another."""
    return f"{float(number):.10g}"


def _logarithms(cell: Cell, truths: list[Truth]) -> dict[str, np.ndarray]:
    """(truths, elements) logarithms of compliance, force, gain and mass over those of the cell file."""
    nominal = truth_of(cell, None)
    elastic = [i for i, body in enumerate(nominal.bodies) if body.compliance.any()]
    heavy = [i for i, body in enumerate(nominal.bodies) if body.mass_kg > 0.0]
    return {
        "compliance": np.log(
            [[t.bodies[i].compliance.max() / nominal.bodies[i].compliance.max() for i in elastic] for t in truths]
        ),
        "force": np.log([np.divide(t.cutting.k_pa, nominal.cutting.k_pa) for t in truths]),
        "gain": np.log(
            [
                [d.position_gain_per_s / n.position_gain_per_s for d, n in zip(t.drives, nominal.drives, strict=True)]
                for t in truths
            ]
        ),
        "mass": np.log([[t.bodies[i].mass_kg / nominal.bodies[i].mass_kg for i in heavy] for t in truths]),
    }


@pytest.mark.parametrize(
    ("what", "each", "common"),
    [("compliance", 0.30, 0.20), ("force", 0.30, 0.20), ("gain", 0.30, 0.0), ("mass", 0.15, 0.0)],
)
def test_wide_truths_are_as_wide_as_stated(
    cell: Cell, wide: list[Truth], what: str, each: float, common: float
) -> None:
    """Variance is each^2 + common^2, the covariance of two elements common^2 (cut at 3 sigma: 1.3 % narrower)."""
    values = _logarithms(cell, wide)[what]
    covariance = np.cov(values.T)
    variances = np.diag(covariance)
    shared = (covariance.sum() - variances.sum()) / (len(variances) * (len(variances) - 1))
    assert variances.mean() == pytest.approx(each**2 + common**2, rel=0.2)
    assert shared == pytest.approx(common**2, abs=0.013)
    assert abs(values.mean()) < 0.06


def test_a_wide_truth_is_further_off_than_the_mild_one_of_its_seed(cell: Cell, wide: list[Truth]) -> None:
    mild = _logarithms(cell, [truth_of(cell, seed) for seed in range(COUNT)])
    for what, values in _logarithms(cell, wide).items():
        assert np.std(values) > 1.4 * np.std(mild[what])


def test_a_file_says_its_family_and_one_of_before_is_mild(cell: Cell, tmp_path: Path) -> None:
    file = tmp_path / "truth.toml"
    make_truth(cell, 3, file, WIDE)
    truth = read_truth(file)
    assert (truth.family, truth.seed, truth.name) == ("wide", 3, "wide, seed 3")
    file.write_text(file.read_text().replace('family = "wide"\n', ""))
    assert read_truth(file).family == "mild"
    make_truth(cell, None, file)
    assert read_truth(file).family == ""
    make_truth(cell, 3, file)
    file.write_text(file.read_text().replace('family = "mild"', 'family = "kind"'))
    with pytest.raises(FileFormatError, match="kind"):
        read_truth(file)


def test_no_seed_is_for_tuning_and_for_reporting() -> None:
    assert not set(TUNING_SEEDS) & set(REPORTING_SEEDS)
    assert len(REPORTING_SEEDS) >= 20
    assert family_of("mild") is MILD
    with pytest.raises(InputError, match=r"unknown family.*other-one"):
        family_of("other-one")
    assert set(FAMILIES) == {"mild", "wide", "other"}


@for_all(st.integers(0, 2**31 - 1), st.integers(1, MOST_SEEDS))
def test_seeds_are_a_number_a_range_or_a_list(first: int, count: int) -> None:
    assert arguments.seeds(str(count)) == list(range(1, count + 1))
    last = first + count - 1
    if last < 2**31 - 1:
        assert arguments.seeds(f"{first}-{last}") == list(range(first, last + 1))
        if count < MOST_SEEDS:
            assert arguments.seeds(f"{last + 1},{first}-{last}") == [last + 1, *range(first, last + 1)]


_NO_SEEDS = "0 -1 3-1 1-2-3 a 1.5 1-101 101 2147483647-2147483648 1, 2-1,5-9 1-60,101-160 2001-2003,2002"


@pytest.mark.parametrize("text", ["", "٣", "9" * 5000, *_NO_SEEDS.split()])
def test_what_are_no_seeds_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="seed"):
        arguments.seeds(text)
