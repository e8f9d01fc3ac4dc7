"""Tables and pictures of a machined part hold what its record and its judgement hold, in millimetres, each in place."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.api.part import AFTER, BEFORE, Comparison, Part
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import UM

seed = st.integers(0, 2**31)


@settings(max_examples=10)
@given(seed)
def test_samples_are_those_of_the_record(number: int) -> None:
    """As commanded and as it was stand apart; lengths in mm, forces in N, time in s."""
    rng = np.random.default_rng(number)
    record: Any = SimpleNamespace(
        time_s=np.cumsum(rng.uniform(0.0, 0.1, 9)), p_part_command=rng.normal(size=(9, 3)),
        p_part_tcp=rng.normal(size=(9, 3)), force_part=rng.normal(size=(9, 3)), depth_m=rng.uniform(0.0, 0.01, 9),
    )  # fmt: skip
    none: Any = None
    found = Part(Path("part.ngc"), none, none, none, record).samples
    assert found["time_s"].to_list() == record.time_s.tolist()
    for i, axis in enumerate("xyz"):
        for name, values in (("command_", record.p_part_command), ("", record.p_part_tcp)):
            np.testing.assert_allclose(found[f"{name}{axis}_mm"].to_numpy(), 1000.0 * values[:, i], rtol=1e-12)
        np.testing.assert_array_equal(found[f"f{axis}_n"].to_numpy(), record.force_part[:, i])
    np.testing.assert_allclose(found["axial_depth_mm"].to_numpy(), 1000.0 * record.depth_m, rtol=1e-12)
    assert len(found.columns) == 11


def deviation(left_m: Float, up_m: Float, along_m: Float) -> Any:
    n = len(left_m)
    return SimpleNamespace(
        cutting=np.ones(n, np.bool_), broken=np.zeros(n, np.bool_), length_m=np.arange(n) * 1e-3,
        across_left_m=left_m, across_axis_m=up_m, along_m=along_m,
    )  # fmt: skip


@settings(max_examples=10)
@given(seed)
def test_the_path_of_two_parts_is_drawn_before_and_after_each_in_its_row(number: int) -> None:
    """To the left of the feed, out of the part, along the feed: signed, each curve that of its own part."""
    rng = np.random.default_rng(number)
    values = {name: rng.normal(size=(3, 40)) * 100.0 * UM for name in (AFTER, BEFORE)}
    judged: Any = {name: SimpleNamespace(deviation=deviation(*v), surface=None) for name, v in values.items()}
    reference: Any = SimpleNamespace(surface=None)
    picture = Comparison(reference, judged, {}).plot("path")
    for name, title in ((BEFORE, "before"), (AFTER, "after")):
        rows = [trace for trace in picture.data if trace.name == title]
        assert len(rows) == 3
        for trace, row in zip(rows, values[name], strict=True):
            np.testing.assert_allclose(np.array(trace.y, dtype=float), row / UM, atol=0.06)
    with pytest.raises(InputError, match="compare two parts"):
        Comparison(reference, {BEFORE: judged[BEFORE]}, {}).plot()


@pytest.mark.parametrize("names", [(BEFORE,), (BEFORE, AFTER)])
def test_a_comparison_has_a_column_for_each_program(names: tuple[str, ...]) -> None:
    """Each figure stands in the column of its program; a part without one has no row."""
    figure = {
        name: {"path": {"p997_mm": k + 0.5, "max_mm": k + 2.0, "rms_mm": k + 0.1}} for k, name in enumerate(names)
    }
    content = {"program": "part.ngc", "cell": "cell", "variants": figure}
    none: Any = None
    one = Comparison(none, dict.fromkeys(names, none), content)
    assert one.table["figure"].to_list() == ["path.p997_mm", "path.max_mm", "path.rms_mm"]
    for k, name in enumerate(names):
        assert one.table[name].to_list() == [k + 0.5, k + 2.0, k + 0.1]
    said = repr(one).splitlines()
    assert said == ["part.ngc in cell"] + [
        f"{name}: path error {k + 0.5:.3f} mm (99.7 %), {k + 2.0:.3f} mm at most" for k, name in enumerate(names)
    ]
