"""Which stretches of a program the simulated cell runs: lead-in, contact, lead-out, and nothing else."""

from __future__ import annotations

import numpy as np
from hypothesis import given, strategies as st

from counterflex.twin.plant.simulate import LEAD_IN_S, LEAD_OUT_S, _stretches as stretches

CYCLE_S = 0.05


@given(st.lists(st.booleans(), min_size=1, max_size=80))
def test_stretches_are_contact_with_its_lead_in_and_lead_out(near: list[bool]) -> None:
    """Against the definition, sample by sample."""
    before, behind = round(LEAD_IN_S / CYCLE_S), round(LEAD_OUT_S / CYCLE_S)
    wanted = [any(near[max(0, k - behind) : k + before + 1]) for k in range(len(near))]
    found = np.zeros(len(near), dtype=np.bool_)
    alone = np.ones(len(near), dtype=np.bool_)
    for first, last in stretches(np.array(near), CYCLE_S, True):
        assert last > first
        found[first : last + 1] = True
    for k in range(len(near)):
        alone[k] = not (wanted[k - 1] if k else False) and not (wanted[k + 1] if k + 1 < len(near) else False)
    assert found.tolist() == [w and not a for w, a in zip(wanted, alone.tolist(), strict=True)]


def test_air_is_kept_on_request() -> None:
    assert stretches(np.zeros(7, dtype=np.bool_), CYCLE_S, False) == [(0, 6)]
