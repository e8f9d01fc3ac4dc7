"""A sharp corner in the cut on a simulated cell: what the plan takes away, and what it says that it leaves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.compensation.languages import write
from counterflex.app.inputs import Job, read_job, setting_of
from counterflex.app.proof import simulate
from counterflex.app.proof.judge import judge, reference_of
from counterflex.app.proof.truth import knowing, truth_of
from counterflex.core.arrays import Bool, Float
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.plan import compensate
from counterflex.plan.inputs import Setting
from counterflex.plan.plan import across
from counterflex.twin.truth.family import WIDE
from counterflex.twin.truth.truth import Truth

CORNER = (
    "G21 G17 G90\nM6 T1\nM3 S13000\nG0 Z60\nG0 X-10 Y10\nG0 Z42\nG1 Z36 F3000\nG1 X22 F1500\nG1 Y40\nG0 Z60\nM5\nM2\n"
)
AT = np.array([22.0, 10.0]) * MM
SEED = 6
"""For tuning (docs/summary.md)."""
UNSHAKEN = 1e-9
"""m/s2: a controller that never changes its speed shakes nothing. Its times are those of the program then."""


@dataclass(frozen=True)
class Machined:
    """Largest errors, m: within 6 mm of the corner as machined and as predicted, and of the floor."""

    corner_m: float
    predicted_m: float
    lowest_floor_m: float


@dataclass(frozen=True)
class Bench:
    """A program, its cell, a truth, and where the compensated program is written."""

    job: Job
    cell: Cell
    truth: Truth
    folder: Path

    @property
    def setting(self) -> Setting:
        """That of a planner who knows the truth."""
        chain, law = knowing(self.cell, self.truth)
        return setting_of(self.cell, chain=chain, law=law)

    def machined(self, setting: Setting) -> Machined:
        """Plan, machine, judge."""
        job, cell = self.job, self.cell
        plan = compensate.plan(job.path, job.line_of_motion, cell.stock(), setting, feeds=job.feeds)
        text = next(iter(write(job, plan, cell, "gcode")[0].values()))
        file = self.folder / "compensated.ngc"
        file.write_text(text, encoding="ascii", newline="")
        record = simulate.machine(read_job(file, cell), cell, self.truth)
        judged = judge(reference_of(job, cell), record, record.stock)
        assert judged.surface is not None
        d = judged.deviation
        planned = np.linalg.norm(across(plan.deviation_compensated_part, plan.path.p_part_tcp), axis=1)
        return Machined(
            float(d.across_m[d.cutting & near(d.p_part_nominal)].max()),
            float(planned[plan.cutting & near(plan.path.p_part_tcp)].max()),
            float(np.nanmin(judged.surface.floor_m)),
        )


def near(p_part: Float) -> Bool:
    """Within 6 mm of the corner, seen from above."""
    out: Bool = np.linalg.norm(p_part[:, :2] - AT, axis=1) < 6.0 * MM
    return out


@pytest.fixture
def bench(program: Callable[..., Path], small: Path, tmp_path: Path) -> Bench:
    cell = read_cell(small)
    return Bench(read_job(program(CORNER), cell), cell, truth_of(cell, SEED, WIDE), tmp_path)


@pytest.fixture
def unshaken(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> Machined:
    """At the programmed feed, the swing of the arm at the corner not planned."""
    with monkeypatch.context() as patch:
        patch.setattr(compensate, "as_run", lambda path, _: path)
        return bench.machined(replace(bench.setting, swing_m=0.0, acceleration_m_s2=UNSHAKEN))


def test_a_sharp_corner_is_kept_and_its_floor_too_pair(bench: Bench, unshaken: Machined) -> None:
    """The swing of the arm at the corner not planned, and as it is planned."""
    after = bench.machined(bench.setting)
    assert unshaken.corner_m > 0.3 * MM
    assert after.corner_m < 0.12 * MM
    assert after.lowest_floor_m > -0.1 * MM


def test_the_plan_says_what_a_corner_leaves_pair(bench: Bench, unshaken: Machined) -> None:
    """At the programmed feed the swing is too large to be taken away, and the prediction holds it."""
    found = bench.machined(replace(bench.setting, swing_m=0.0))
    assert unshaken.predicted_m < 0.3 * unshaken.corner_m
    assert found.predicted_m > 0.5 * found.corner_m
