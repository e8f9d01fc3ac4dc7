"""A plan at lowered feeds is for the compensated program only; a robot that runs the original one gets its own plan."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.compensation import compensate
from counterflex.app.run import session
from counterflex.core.errors import InputError
from counterflex.files.plan_file import read_plan

RSI = Path(__file__).parents[3] / "examples" / "rsi" / "rsi.xml"


def test_a_plan_at_lowered_feeds_is_refused_for_the_original_program(
    small: Path, program: Callable[..., Path], tmp_path: Path
) -> None:
    lowered = compensate.run(program(), small, tmp_path / "lowered", report=False, predict=False)
    kept = compensate.run(program(), small, tmp_path / "kept", report=False, predict=False, programmed_feed=True)
    assert lowered["calm_feed"]["lines"]
    assert lowered["calm_feed"]["extra_s"] > 0.1
    assert kept["calm_feed"]["lines"] == []
    plans = {name: read_plan(tmp_path / name / "plan.parquet") for name in ("lowered", "kept")}
    longer = plans["lowered"][0].path.time_s[-1] - plans["kept"][0].path.time_s[-1]
    assert plans["lowered"][1]["feed_lowered_s"] == pytest.approx(longer, abs=1e-3)
    np.testing.assert_array_equal(plans["lowered"][0].path.p_part_tcp, plans["kept"][0].path.p_part_tcp)
    settings = session.RunSettings(
        small, ("rsi", RSI), tmp_path / "lowered" / "plan.parquet", compensated=False, port=0
    )
    with pytest.raises(InputError, match=r"lower feed than the original program runs.*--programmed-feed"):
        session.open_session(settings)
