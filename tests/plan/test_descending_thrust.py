"""The thrust of a descending end face damps the tool: no ramp, however shallow, makes a trial swing by itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from scipy.optimize import brentq

from counterflex.app.inputs import setting_of
from counterflex.core.arrays import Float
from counterflex.core.units import UM
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.bending_kernels import thrust_of_step
from counterflex.plan.compensate import plan
from counterflex.plan.cut import cut
from counterflex.plan.lasting_swing import lasting_swings
from counterflex.plan.plan import across
from counterflex.robot.model.description import Servo
from counterflex.signals.preview import Mode

PathOf = Callable[..., ToolPath]
CellOf = Callable[..., Cell]
Block = Callable[..., HeightMap]
EPS = float(np.finfo(float).eps)
DRIVES = (Servo(1e5, 20.0, 0.06, friction_nm=0.0, slip_rad=1e-5),) * 6


@given(
    free=st.floats(1e-6, 1.0),
    gain=st.floats(1e-8, 1e-2),
    amplitude=st.floats(1e-2, 1e5),
    exponent=st.floats(0.05, 1.0),
)
@example(free=5.740125773813783e-4, gain=1e-8, amplitude=1e5, exponent=0.05)  # eight steps are off by 7e-5
@example(free=0.6152583900044651, gain=1e-8, amplitude=0.01, exponent=1.0)  # one digit of the descent is 1e-6 of it
def test_thrust_and_descent_agree(free: float, gain: float, amplitude: float, exponent: float) -> None:
    """Against another solver of the same equation.

    ``F = (free - d) / gain``: a descent that is right to its last digit, which is at most ``eps free``, leaves the
    thrust ``eps free / gain`` off. The other solver rounds ``free - gain F``, and ends 4 eps beside its root.
    """
    most = free / gain * (1.0 + 1e-12)  # beyond the place where rounding leaves a descent
    expected = brentq(
        lambda force: force - amplitude * max(free - gain * force, 0.0) ** exponent,
        0.0, most, xtol=1e-300, rtol=4.0 * EPS, maxiter=1000,
    )  # fmt: skip
    digit = EPS * free / gain
    assert thrust_of_step(free, gain, amplitude, exponent) == pytest.approx(expected, rel=8.0 * EPS, abs=4.0 * digit)


def test_a_tool_that_rises_is_not_pushed() -> None:
    assert thrust_of_step(-1e-3, 1e-5, 1e3, 0.3) == 0.0
    assert thrust_of_step(0.0, 1e-5, 1e3, 0.3) == 0.0


def _ramp(down_mm: float) -> str:
    return f"G0 Z10\nG0 X20 Y20\nG1 Z0 F600\nG1 X100 Z{-down_mm} F900"


@pytest.mark.parametrize("down_mm", [0.2, 0.4, 1.6])
@pytest.mark.parametrize("hz", [6.0, 12.0, 25.0])
def test_a_ramp_comes_to_rest_at_the_deflection_under_its_own_force(
    law: KienzleLaw,
    cutter: Cutter,
    path_of: PathOf,
    block: Block,
    stiffness: Callable[[int], Float],
    hz: float,
    down_mm: float,
) -> None:
    """Through one mode: statics, with the force of the undisturbed cut, say where the tool stays."""
    path = path_of(_ramp(down_mm))
    stock, C = block((0, 0), (120, 40)), stiffness(len(path))
    undisturbed = cut(path, path.p_part_tcp, stock.copy(), lambda _: cutter, law)
    mode = Mode(2.0 * np.pi * hz, 0.1)
    bent = cut(path, path.p_part_tcp, stock, lambda _: cutter, law, compliance_part=C, mode=mode)
    last = (path.kind == FEED) & (path.p_part_tcp[:, 0] > 0.070)
    z, at_rest = bent.displacement_part[last, 2], C[0, 2, 2] * undisturbed.w_tcp_part[last, 2].mean()
    assert z.mean() == pytest.approx(at_rest, rel=0.05)
    assert np.ptp(z) < 0.2 * at_rest


@pytest.mark.parametrize("moved", [False, True])
@pytest.mark.parametrize("down_mm", [0.3, 1.0])
def test_no_ramp_of_a_plan_swings_or_gets_worse(cell_of: CellOf, path_of: PathOf, down_mm: float, moved: bool) -> None:
    """Back and forth in a slot, both with the robot in motion and through one mode."""
    cell = cell_of()
    body = "".join(f"G1 X{28 if k % 2 == 0 else 12} Z{40 - down_mm * (k + 1)} F900\n" for k in range(4))
    path = path_of(f"G0 Z60\nG0 X12 Y15\nG0 Z41\nG1 Z40 F600\n{body}G1 X{12} F900\nG0 Z60")
    setting = setting_of(cell)
    chain = setting.chain
    mass = chain.mass if moved else np.where(np.arange(chain.n) == np.flatnonzero(chain.mass)[0], 0.0, chain.mass)
    setting = replace(setting, chain=replace(chain, mass=mass, servo=DRIVES if moved else None, play=None))
    lines = np.arange(1, int(path.motion.max()) + 2)
    made = plan(path, lines, cell.stock(), setting)
    before, after = (
        np.linalg.norm(across(d, path.p_part_tcp), axis=1)[made.cutting]
        for d in (made.deviation_nominal_part, made.deviation_compensated_part)
    )
    assert np.sqrt(np.mean(after**2)) < 0.5 * np.sqrt(np.mean(before**2))
    for deviation in (made.deviation_nominal_part, made.deviation_compensated_part):
        assert lasting_swings(path.time_s, deviation, made.cutting, made.line) == []
    assert np.sqrt(np.mean(before**2)) > 30.0 * UM  # the ramp bends the arm at all
