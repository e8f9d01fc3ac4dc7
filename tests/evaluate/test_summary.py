"""The summary dictionary: layout, reduction, table rows, and what is refused."""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest

from counterflex.core.errors import FileFormatError, InputError
from counterflex.evaluate.figures import DeviationFigures
from counterflex.evaluate.path_deviation import PathFigures
from counterflex.evaluate.summary import SeedResult, Variant, check_summary, seed_rows, summary, table_rows


def path_figures(scale: float) -> PathFigures:
    def figures(size: float) -> DeviationFigures:
        return DeviationFigures(size * 1e-3 * scale, 0.9e-3 * size * scale, 0.5e-3 * size * scale, 0.25)

    return PathFigures(
        figures(1.4), figures(0.8), figures(1.2), figures(1.4), figures(0.1), figures(0.3), 1.5e-3 * scale
    )


def job() -> dict[str, Any]:
    results = [
        SeedResult(
            seed, "catalogue", {"nominal": Variant(path_figures(1.0)), "compensated": Variant(path_figures(share))}
        )
        for seed, share in ((1, 0.2), (2, 0.1), (3, 0.3))
    ]
    results.append(
        SeedResult(1, "exact", {"nominal": Variant(path_figures(1.0)), "compensated": Variant(path_figures(0.05))})
    )
    return summary(results, {"program": "grooves.ngc"})


def test_layout_and_units() -> None:
    data = json.loads(json.dumps(job()))
    assert data["format"] == "counterflex-summary"
    assert data["version"] == 2
    assert data["variants"]["nominal"]["path"]["max_mm"] == pytest.approx(1.4)
    assert data["variants"]["compensated"]["exit"]["max_mm"] == pytest.approx(0.24)
    assert data["variants"]["nominal"]["path"]["length_mm"] == pytest.approx(250.0)
    assert data["variants"]["nominal"]["path"]["at_p_mm"] == pytest.approx(1.5)
    assert data["program"] == "grooves.ngc"
    assert check_summary(data) is data


def test_reduction_is_of_the_same_figure_and_seed() -> None:
    data = job()
    assert data["reduction"]["path"]["p997_mm"] == pytest.approx(0.8)
    assert [seed["reduction"]["path"]["max_mm"] for seed in data["seeds"]] == pytest.approx([0.8, 0.9, 0.7, 0.95])
    assert data["over_seeds"]["catalogue"]["path"]["p997"] == {"median_remaining": 0.2, "worst_remaining": 0.3}
    assert data["over_seeds"]["exact"]["count"] == 1


def test_rows_show_the_summary() -> None:
    data = job()
    rows = {row[0]: row[1:] for row in table_rows(data)}
    assert rows["path.max_mm"] == ("1.400", "0.280", "80 %")
    assert "surface.max_mm" not in rows
    assert seed_rows(data)[1] == ("2", "catalogue", "1.260", "0.126", "10.0 %", "10.0 %")


def test_other_files_are_refused() -> None:
    data = job()
    with pytest.raises(FileFormatError, match="not a counterflex summary"):
        check_summary({"a": 1})
    newer = {**data, "version": 3}
    with pytest.raises(FileFormatError, match="another version"):
        check_summary(newer)
    holed = copy.deepcopy(data)
    del holed["variants"]["nominal"]["path"]["p997_mm"]
    with pytest.raises(FileFormatError, match=r"variants\.nominal\.path\.p997_mm"):
        check_summary(holed)
    with pytest.raises(InputError, match="at least one"):
        summary([])
    with pytest.raises(InputError, match="hide"):
        summary([SeedResult(1, "exact", {})], {"seeds": 3})


def test_quantile_is_a_value_that_was_met() -> None:
    import numpy as np

    value = np.array([3.0, 1.0, 2.0])
    assert DeviationFigures.weighted(value, np.array([0.003, 0.5, 0.497])).p997_m == 2.0
    assert DeviationFigures.weighted(value, np.array([0.004, 0.5, 0.496])).p997_m == 3.0
    assert DeviationFigures.weighted(np.zeros(0)).extent == 0.0
    with pytest.raises(InputError):
        DeviationFigures.weighted(value, -np.ones(3))
