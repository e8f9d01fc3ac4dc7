"""The part frame that an explanation moves: what the tool was off becomes where the part lies, in every direction."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.app.correction.causes import FRAME, TURNED, changes_of
from counterflex.core.units import DEG, MM, MRAD
from counterflex.evaluate.path_error.explanations import Explanation
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.identify.data.changes import TableValues

FACTORS = (*(f"offset {a}, m" for a in "xyz"), *(f"rotation about {a}, rad" for a in "xyz"))


@pytest.fixture(scope="module")
def cell(small: Any) -> Cell:
    return read_cell(small)


@settings(max_examples=25)
@given(st.integers(0, 2**31), st.booleans())
def test_a_point_of_the_program_moves_by_what_the_tool_was_off(cell: Cell, number: int, turned: bool) -> None:
    """In the moved frame every point lies where the error put it: shifted, and turned about the middle of the cut."""
    rng = np.random.default_rng(number)
    value = np.concatenate([rng.normal(size=3) * 0.3 * MM, rng.normal(size=3) * 2.0 * MRAD])
    p = rng.uniform(-0.1, 0.2, (12, 3)) + np.array([0.3, 0.2, 0.0])
    cutting = np.arange(12) >= 7  # the middle of the cut is not that of the path
    plan: Any = SimpleNamespace(path=SimpleNamespace(p_part_tcp=p), cutting=cutting)
    count = 6 if turned else 3
    name = f"{FRAME} + {TURNED}" if turned else FRAME
    one = Explanation(name, FACTORS[:count], value[:count], np.ones(count), np.eye(count), 1.0, 1.0)
    (change,) = changes_of(one, plan, cell)
    assert isinstance(change, TableValues)
    assert change.table == "part"
    assert ("a_deg" in change.values) == turned
    keys = {key: float(v) for key, v in change.values.items()}  # type: ignore[arg-type]
    place = np.array([keys[f"{a}_mm"] for a in "xyz"]) * MM
    R = rotation.from_zyx(np.array([keys[f"{a}_deg"] for a in "abc"]) * DEG) if turned else cell.T_base_part[:3, :3]
    now = pose.transform(pose.inverse(pose.make(R, place)), pose.transform(cell.T_base_part, p))
    centre = p[cutting].mean(axis=0)
    turn = rotation.exp(value[3:] if turned else np.zeros(3))
    np.testing.assert_allclose(now, (p - centre) @ turn.T + centre + value[:3], atol=3e-8)
