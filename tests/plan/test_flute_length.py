"""Cuts deeper than the flutes: the depth that removed volume proves."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.errors import ModelError
from counterflex.cutting.cutter import Cutter
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.undisturbed_cut import check_flutes, least_depth

DIAMETER = 0.016


def _slot(depth: float, descent: float = 0.0) -> tuple[ToolPath, np.ndarray]:
    """A full slot along x, and what it removes; ``descent`` is the slope of the floor."""
    n = 81
    x = np.linspace(0.0, 0.04, n)
    path = ToolPath(
        p_part_tcp=np.stack([x, np.zeros(n), -descent * x], axis=1),
        axis_part=np.tile([0.0, 0.0, 1.0], (n, 1)),
        kind=np.full(n, FEED),
        motion=np.zeros(n, dtype=np.int64),
        tool=np.ones(n, dtype=np.int64),
        feed_m_s=np.full(n, 0.025),
        spindle_rad_s=np.full(n, 1000.0),
        time_s=x / 0.025,
    )
    step = np.diff(x, prepend=x[0])
    below = np.pi * DIAMETER**2 / 4.0 * descent * step
    volume = DIAMETER * (depth + descent * x) * step + np.where(step > 0.0, below, 0.0)
    return path, volume


def _cutter(flute_length: float) -> Cutter:
    return Cutter(
        diameter_m=DIAMETER,
        corner_radius_m=0.0,
        flutes=3,
        helix_rad=0.5,
        flute_length_m=flute_length,
        runout_m=0.0,
    )


def test_a_slot_proves_its_depth() -> None:
    path, volume = _slot(0.012)
    depth = least_depth(path, volume, np.full(len(path), DIAMETER))
    assert depth[10:] == pytest.approx(0.012, rel=1e-9)
    assert not depth[:3].any()


def test_a_ramp_is_not_taken_for_a_deeper_cut() -> None:
    path, volume = _slot(0.0, 0.2)
    depth = least_depth(path, volume, np.full(len(path), DIAMETER))
    assert np.all(depth <= 0.2 * path.p_part_tcp[:, 0] + 1e-12)
    assert depth[-1] == pytest.approx(0.2 * 0.039, rel=0.02)


def test_deeper_than_the_flutes_is_refused_with_its_place() -> None:
    path, volume = _slot(0.012)
    check_flutes(path, volume, lambda _: _cutter(0.012), str)
    with pytest.raises(ModelError, match=r"point \d+: the cut is deeper .* got 12.0 mm; expected at most 10 mm"):
        check_flutes(path, volume, lambda _: _cutter(0.010), lambda row: f"point {row}")
