"""Figures of ISO 230-2: a test of ten targets computed by hand, and another arithmetic for tests at random."""

from __future__ import annotations

import math
import statistics
from pathlib import Path

import numpy as np
import pytest

from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import MM, UM
from counterflex.evaluate.iso230.positioning import DOWN, UP, Approaches
from counterflex.files.positioning_file import read_approaches

UP_UM = {
    0.0: (2, 4, 3, 1, 5),
    130.0: (6, 6, 8, 7, 8),
    270.0: (10, 12, 11, 9, 13),
    420.0: (7, 9, 8, 8, 8),
    600.0: (1, 0, 2, 1, 1),
}
DOWN_UM = {
    0.0: (-1, 1, 0, -2, 2),
    130.0: (2, 4, 3, 3, 3),
    270.0: (4, 6, 5, 5, 5),
    420.0: (3, 5, 4, 2, 6),
    600.0: (-3, -3, -1, -2, -1),
}
"""Deviations, um, of five approaches. Their means are 3 7 11 8 1 and 0 3 5 4 -2. The sums of squares about these are
10 4 10 2 2 and 10 2 2 10 4, so that the standard deviations are the roots of a quarter of it:
sqrt 2.5, 1, sqrt 2.5, sqrt 0.5, sqrt 0.5 and sqrt 2.5, sqrt 0.5, sqrt 0.5, sqrt 2.5, 1."""
WIDE, THIN = math.sqrt(2.5), math.sqrt(0.5)
EXPECTED_UM = {
    "reversal_m": 6.0,  # 3 4 6 4 3
    "mean_reversal_m": 4.0,
    "systematic_up_m": 10.0,  # 11 - 1
    "systematic_down_m": 7.0,  # 5 - -2
    "systematic_m": 13.0,  # 11 - -2
    "mean_deviation_m": 8.5,  # 1.5 5 8 6 -0.5
    "repeatability_up_m": 4.0 * WIDE,
    "repeatability_down_m": 4.0 * WIDE,
    "repeatability_m": 2.0 * WIDE + 2.0 * THIN + 6.0,  # at 270: 10.58; at 0: 9.32, at 420: 8.58
    "accuracy_up_m": (11.0 + 2.0 * WIDE) - min(3.0 - 2.0 * WIDE, 1.0 - 2.0 * THIN),
    "accuracy_down_m": (4.0 + 2.0 * WIDE) - (-2.0 - 2.0),
    "accuracy_m": (11.0 + 2.0 * WIDE) - (-2.0 - 2.0),
}


def of_tables() -> Approaches:
    """The test above."""
    rows = [(t, d, way) for table, way in ((UP_UM, UP), (DOWN_UM, DOWN)) for t, ds in table.items() for d in ds]
    target, deviation, way = (np.array(column) for column in zip(*rows, strict=True))
    return Approaches(target * MM, deviation * UM, way)


@pytest.mark.parametrize("name", EXPECTED_UM)
def test_a_test_computed_by_hand(name: str) -> None:
    assert getattr(of_tables().figures(), name) / UM == pytest.approx(EXPECTED_UM[name], abs=1e-9)


def test_a_whole_test_is_by_the_standard() -> None:
    assert of_tables().figures().not_by_standard == ()


@pytest.mark.parametrize("seed", range(4))
def test_another_arithmetic_agrees(seed: int) -> None:
    """The definitions with the standard library's statistics, target by target."""
    rng = np.random.default_rng(seed)
    places = np.sort(rng.uniform(0.0, 1.5, 9))
    runs = {w: {float(p): (rng.normal(size=6) * 5e-6 + w * 4e-6).tolist() for p in places} for w in (UP, DOWN)}
    rows = rng.permutation([(p, d, w) for w, table in runs.items() for p, ds in table.items() for d in ds])
    found = Approaches(rows[:, 0], rows[:, 1], rows[:, 2].astype(np.int64)).figures()
    mean = {w: [statistics.fmean(runs[w][p]) for p in sorted(runs[w])] for w in runs}
    s = {w: [statistics.stdev(runs[w][p]) for p in sorted(runs[w])] for w in runs}
    ends = [m + k * 2.0 * d for w in runs for m, d in zip(mean[w], s[w], strict=True) for k in (-1.0, 1.0)]
    assert found.accuracy_m == pytest.approx(max(ends) - min(ends), rel=1e-9)
    both = zip(mean[UP], mean[DOWN], s[UP], s[DOWN], strict=True)
    each = [max(2 * a + 2 * b + abs(u - d), 4 * a, 4 * b) for u, d, a, b in both]
    assert found.repeatability_m == pytest.approx(max(each), rel=1e-9)
    middle = [statistics.fmean(pair) for pair in zip(mean[UP], mean[DOWN], strict=True)]
    assert found.mean_deviation_m == pytest.approx(max(middle) - min(middle), rel=1e-9)
    assert found.systematic_m == pytest.approx(max(mean[UP] + mean[DOWN]) - min(mean[UP] + mean[DOWN]), rel=1e-9)


def test_one_direction_gives_no_figure_of_both() -> None:
    whole = of_tables()
    some = whole.direction == UP
    found = Approaches(whole.target_m[some], whole.deviation_m[some], whole.direction[some]).figures()
    assert found.accuracy_up_m is not None
    assert (found.accuracy_m, found.repeatability_m, found.reversal_m, found.mean_deviation_m) == (None,) * 4
    assert "both directions" in found.not_by_standard[0]


def test_one_approach_gives_no_repeatability() -> None:
    target = np.array([0.0, 0.1, 0.2, 0.2, 0.1, 0.0])
    found = Approaches(target, 1e-5 * target, np.array([1, 1, 1, -1, -1, -1])).figures()
    assert found.accuracy_m is None
    assert found.repeatability_m is None
    assert found.systematic_m == pytest.approx(2e-6)
    assert any("1 approaches" in line for line in found.not_by_standard)


def test_directions_follow_from_the_order_of_the_test(tmp_path: Path) -> None:
    """Up to 300 and back, twice; the ends are overrun and approached again."""
    file = tmp_path / "axis.csv"
    places = [0, 100, 300, 300, 100, 0, 0, 100, 300, 300, 100, 0]
    file.write_text("target_mm,position_mm\n" + "".join(f"{p},{p + 0.01}\n" for p in places))
    read = read_approaches(file)
    assert read.direction.tolist() == [1, 1, 1, -1, -1, -1, 1, 1, 1, -1, -1, -1]
    np.testing.assert_allclose(read.deviation_m, 1e-5, atol=1e-12)
    file.write_text("target_mm;deviation_um;direction\n" + "".join(f"{p};10,0;+\n" for p in places))
    np.testing.assert_allclose(read_approaches(file).deviation_m, 1e-5)
    assert set(read_approaches(file).direction.tolist()) == {1}


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("target_mm,x\n1,2\n", "other columns"),
        ("target_mm,deviation_um\n1,a\n2,3\n", "no number"),
        ("target_mm,deviation_um,direction\n1,1,left\n2,3,+\n", "no direction"),
        ("target_mm,deviation_um\n1,1,3\n", "another length|more cells"),
        ("target_mm,deviation_um\n", "no approaches"),
    ],
)
def test_a_bad_table_is_named(tmp_path: Path, text: str, word: str) -> None:
    file = tmp_path / "axis.csv"
    file.write_text(text)
    with pytest.raises(FileFormatError, match=word):
        read_approaches(file)


def test_one_target_is_no_axis() -> None:
    with pytest.raises(InputError, match="needs targets"):
        Approaches(np.zeros(4), np.zeros(4), np.array([1, -1, 1, -1])).figures()


def test_a_target_approached_from_one_side_has_that_sides_repeatability() -> None:
    """It was not-a-number: the largest of three, of which the first was unknown."""
    deviation = 1e-6 * np.array([1.0, 3.0, 2.0, 0.0, 2.0, 5.0])
    target, up = np.repeat([0.0, 0.1], 3), np.ones(6, dtype=np.int64)
    one = Approaches(target, deviation, up).figures()
    for k, figures in enumerate(one.targets):
        assert figures.repeatability_m == pytest.approx(4.0 * np.std(deviation[3 * k : 3 * k + 3], ddof=1))
    assert one.repeatability_m is None
    single = Approaches(np.append(target, 0.0), np.append(deviation, 0.0), np.append(up, -1)).figures()
    assert np.isnan(single.targets[0].repeatability_m)
