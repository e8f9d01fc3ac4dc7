"""The wrench that a loop reads ahead of time: laws."""

from __future__ import annotations

import numpy as np
from hypothesis import given, strategies as st
from scipy.integrate import solve_ivp

from counterflex.core.arrays import Float
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose
from counterflex.plan.play_compensation import arm_share, arrival
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.signals.preview import Ahead, Mode, Shaping

CELL = "examples/cells/kr300_d16_flat.toml"


def test_the_share_of_the_arm_is_what_a_rigid_end_effector_would_leave() -> None:
    """Against the compliance matrix of the same chain with everything beyond the flange made rigid."""
    cell = read_cell(CELL)
    chain, R = cell.chain, cell.T_base_part[:3, :3]
    q = np.tile(np.deg2rad([-3.0, -92.0, 123.0, -174.0, 31.0, 175.0]), (3, 1))
    w = np.array([[-178.0, 508.0, -100.0, 0.0, 0.0, 0.0], [10.0, 0.0, -300.0, 0.0, 0.0, 0.0], np.zeros(6)])
    w_base = pose.rotate_wrench(R, w)
    C = cartesian_compliance(chain, q)
    own = np.array(chain.compliance)
    own[chain.flange_segment + 1 :] = 0.0
    stiff = type(chain)(**{**{f: getattr(chain, f) for f in chain.__dataclass_fields__}, "compliance": own})
    C_arm = cartesian_compliance(stiff, q)
    d, d_arm = ((m @ w_base[..., None])[..., 0][:2, :3] for m in (C, C_arm))
    expected = np.median(np.sum(d * d_arm, axis=1) / np.sum(d * d, axis=1))
    assert np.isclose(arm_share(chain, q, w_base), expected, rtol=1e-9)
    assert arm_share(chain, q, np.zeros_like(w)) == 1.0


def test_what_is_sent_undoes_the_deflection_pair() -> None:
    """A force that sets in within 80 ms, corrections late by 60 ms and ringing: read ahead as it is, and as shaped."""
    time = np.arange(0.0, 3.0, 0.004)
    w = np.zeros((len(time), 6))
    w[:, 1] = 500.0 * np.clip((time - 1.0) / 0.08, 0.0, 1.0)
    arm, answer, dead, share = Mode(2.0 * np.pi * 9.0, 0.08), Mode(2.0 * np.pi * 5.0, 0.7), 0.012, 0.7

    def through(mode: Mode, x: Float) -> Float:
        a, z = mode.omega_rad_s, mode.damping_ratio
        found = solve_ivp(
            lambda t, s: [s[1], a * a * (np.interp(t, time, x) - s[0]) - 2.0 * z * a * s[1]],
            (time[0], time[-1]),
            [x[0], 0.0],
            t_eval=time,
            max_step=2e-3,
        )
        out: Float = found.y[0]
        return out

    felt = (1.0 - share) * w[:, 1] + share * through(arm, w[:, 1])

    def left(sent: Float) -> float:
        late = np.interp(time - dead, time, sent)
        return float(np.max(np.abs(felt - through(arm, through(answer, late)))))

    lead = dead + 2.0 * answer.damping_ratio / answer.omega_rad_s
    plain = np.interp(time + lead, time, w[:, 1])
    shaped = Ahead(share, (arm, answer), Shaping(0.008, dead)).command(w, time)[:, 1]
    assert left(w[:, 1]) > 150.0
    assert left(plain) > 40.0
    assert left(shaped) < 0.35 * left(plain)


def test_a_tool_pushed_back_arrives_late_by_its_deflection_over_the_speed() -> None:
    """Around a corner: only what lies along the feed counts, against it late and with it early."""
    corner = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.1, 0.0]])
    time = np.array([0.0, 4.0, 8.0])
    rows = np.linspace(0.0, 8.0, 161)
    p = np.stack([np.interp(rows, time, c) for c in corner.T], axis=1)
    d = np.tile([-0.4e-3, 0.1e-3, 5e-3], (161, 1))
    late = arrival(p, rows, d) - rows
    np.testing.assert_allclose(late[1:81], 0.016, rtol=1e-9)
    # Around the corner it would be early by 4 ms; but no point is reached before the one ahead of it.
    np.testing.assert_allclose(late[82:], -0.004, rtol=1e-9)


@given(st.integers(0, 2**32 - 1))
def test_no_point_is_reached_before_the_one_ahead_of_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p = np.cumsum(rng.standard_normal((30, 3)) * (rng.random((30, 1)) > 0.2), axis=0) * 1e-4
    time = np.cumsum(0.01 * rng.random(30))
    found = arrival(p, time, 1e-3 * rng.standard_normal((30, 3)))
    assert np.all(np.diff(found) >= 0.0)
    assert np.all(np.isfinite(found))
