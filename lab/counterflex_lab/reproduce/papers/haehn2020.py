"""Ours of Haehn2020: virtual joints, the 60 load cases, sensor equations, delays, groove."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, MS
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import engagement_of_arc, mean_force
from counterflex.cutting.material import load as load_material
from counterflex.files.cell.online import OnlineTable
from counterflex.geometry import rotation
from counterflex.robot.elasticity.chain import ElasticChain, frames
from counterflex.robot.elasticity.compliance import deflection
from counterflex.robot.kinematics.inverse import inverse
from counterflex.robot.model import catalog, load_cases
from counterflex.runtime.estimator.force import blend
from counterflex.runtime.settings import OnlineSettings, force_delay
from counterflex.signals.filters import Smoother

ROBOT: Final = "kuka_kr300_r2500_ultra"
FORCE_N: Final = 546.0
DEPTH_M: Final = 9.5 * MM
THRESHOLD_N: Final = 150.0
BLEND_S: Final = 80.0 * MS
LEAD_S: Final = 40.0 * MS
PERIOD_S: Final = 4.0 * MS
FALL_S: Final = 80.0 * MS
"""In which the force of an exit falls to zero (assumed)."""
_RUN_S: Final = 0.8
_EXIT_S: Final = 0.4
"""Length of the signals of :func:`exit_signals`, and when the force begins to fall."""


def loaded_poses() -> tuple[ElasticChain, Float, Float]:
    """Chain, axes (60, 6) rad and wrenches (60, 6) N, N m of the load cases of section 3.1."""
    chain = ElasticChain.build(catalog.load(ROBOT), load_cases.end_effector())
    cases = load_cases.cases()
    q = np.array([inverse(chain, case.T_base_tcp, "front up noflip").q for case in cases])
    return chain, q, np.array([case.w_tcp_base for case in cases])


def deflections_mm() -> Float:
    """(60,) mm, norm of the deflection in each load case."""
    chain, q, w = loaded_poses()
    return np.asarray(np.linalg.norm(deflection(chain, q, w)[:, :3], axis=1) / MM)


def printed_deflection(chain: ElasticChain, q: Float, force_base: Float) -> Float:
    """(3,) m, displacement of the TCP by eq. 1 to 9: turns behind every frame by the moments of the rigid robot.

    Args:
        chain: Only its rotational compliances are used, as in the paper.
        q: (6,) rad.
        force_base: (3,) N.
    """
    rigid = frames(chain, q)
    tip = (rigid[-1] @ chain.T_last_tcp)[:3, 3]
    T, before = np.eye(4), np.eye(4)
    for T_base_i, c in zip(rigid, chain.compliance, strict=True):
        lever, force = T_base_i[:3, :3].T @ (tip - T_base_i[:3, 3]), T_base_i[:3, :3].T @ force_base
        alpha, beta, gamma = np.cross(lever, force) * c[3:]
        turned = np.eye(4)
        turned[:3, :3] = rotation.about_z(gamma) @ rotation.about_y(beta) @ rotation.about_x(alpha)
        T = T @ np.linalg.inv(before) @ T_base_i @ turned
        before = T_base_i
    out: Float = (T @ chain.T_last_tcp)[:3, 3] - tip
    return out


def _printed_against_ours_mm() -> float:
    chain, q, w = loaded_poses()
    printed = np.array([printed_deflection(chain, a, f[:3]) for a, f in zip(q, w, strict=True)])
    return float(np.linalg.norm(printed - deflection(chain, q, w)[:, :3], axis=1).max() / MM)


def _linear_gap_mm() -> float:
    chain, q, w = loaded_poses()
    both = [deflection(chain, q, w, nonlinear=how)[:, :3] for how in (True, False)]
    return float(np.linalg.norm(both[0] - both[1], axis=1).max() / MM)


def reachable() -> float:
    """Number of the 20 poses of section 3.1 that a posture within the joint limits reaches."""
    chain, q, _ = loaded_poses()
    lower, upper = np.asarray(chain.joint_limits_rad).T
    return float(np.count_nonzero(np.all((q >= lower) & (q <= upper), axis=1)[:: len(load_cases.FORCES)]))


def groove_force_n() -> float:
    """Mean lateral force in a slot of :data:`DEPTH_M`, 16 mm, three teeth, 25 mm/s, 13 000 rpm, N."""
    cutter = Cutter(diameter_m=16.0 * MM, flutes=3, helix_rad=30.0 * DEG, flute_length_m=35.0 * MM)
    law = load_material("en-aw-2017-vdi22").with_ratios(kr_over_kc=0.35, ka_over_kc=0.15)
    depths = engagement_of_arc(cutter, DEPTH_M, 0.0, np.pi)
    feed_m = 25.0 * MM * 60.0 / 13000.0 / 3
    wrench = mean_force(cutter, law, depths[None], feed_m, allow_extrapolation=True).wrench_tcp[0]
    return float(np.linalg.norm(wrench[:2]))


def independent_terms(count: int = 27) -> int:
    """Rank of the 15 terms of eq. 17 at random orientations."""
    q = np.random.default_rng(1).normal(size=(count, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    pairs = [q[:, a] * q[:, b] for a in range(4) for b in range(a, 4)]
    return int(np.linalg.matrix_rank(np.column_stack([np.ones(count), q, *pairs])))


def quaternion_as_printed(angles: Float) -> Float:
    """(4,) of eq. 16 as printed: one row four times.

    Args:
        angles: (3,) rad.
    """
    half = 0.5 * np.asarray(angles)
    return np.full(4, np.prod(np.sin(half)) + np.prod(np.cos(half)))


def _left_along_feed() -> float:
    r, v = np.random.default_rng(2).normal(size=(2, 1000, 3))
    unit = v / np.linalg.norm(v, axis=1)[:, None]
    projected = r - np.sum(r * unit, axis=1)[:, None] * unit
    return float((np.abs(np.sum(projected * unit, axis=1)) / np.linalg.norm(r, axis=1)).max())


def _settings() -> OnlineSettings:
    return OnlineTable(force="measured").settings(None, compensated=False)


@dataclass(frozen=True)
class ExitSignals:
    """Forces around an exit, N, at each of ``time_s``."""

    time_s: Float  # from the beginning of the fall
    force_n: Float  # the force on the tool
    measured_n: Float  # behind the filters
    predicted_n: Float  # as it rides in the program, with lead
    blended_n: Float  # what is corrected for
    measured_acts_n: Float  # force whose correction has taken effect, measured force alone
    blended_acts_n: Float  # the same with pilot control


def _falling(time_s: Float) -> Float:
    """Force that falls from 0 to :data:`FALL_S`, N."""
    return np.asarray(FORCE_N * np.clip(1.0 - time_s / FALL_S, 0.0, 1.0))


def exit_signals(lead_s: float = LEAD_S) -> ExitSignals:
    """Figure 3 with our filters, dead time and lag: a force that falls, measured, predicted, blended, and what acts.

    Args:
        lead_s: By how much the prediction comes early, s.
    """
    settings = _settings()
    time = np.arange(0.0, _RUN_S, PERIOD_S) - _EXIT_S
    force = _falling(time)
    smoother, share = Smoother(settings.smoothing, 6), 0.0
    value, out = np.zeros(6), np.zeros(6)
    value[0] = FORCE_N
    smoother.reset(value)
    measured, blended, predicted = np.zeros_like(time), np.zeros_like(time), _falling(time + lead_s)
    ahead = np.zeros(6)
    for k, now in enumerate(force):
        value[0], ahead[0] = now, predicted[k]
        smoother(value, out)
        share = blend(out, ahead, share, THRESHOLD_N, PERIOD_S / BLEND_S)
        measured[k], blended[k] = out[0], (1.0 - share) * out[0] + share * ahead[0]
    acting = (np.interp(time - settings.delays.correction_s, time, signal) for signal in (measured, blended))
    return ExitSignals(time, force, measured, predicted, blended, *acting)


def _half_way_s(time: Float, falling: Float) -> float:
    """Time at which a signal first falls below half of :data:`FORCE_N`."""
    k = int(np.argmax(falling < 0.5 * FORCE_N))
    above, below = falling[k - 1], falling[k]
    return float(time[k - 1] + (time[k] - time[k - 1]) * (above - 0.5 * FORCE_N) / (above - below))


def _pilot_miss_ms(lead_s: float = LEAD_S) -> float:
    s = exit_signals(lead_s)
    return (_half_way_s(s.time_s, s.blended_acts_n) - _half_way_s(s.time_s, s.force_n)) / MS


def _reaction_ms() -> float:
    settings = _settings()
    return (force_delay(settings) + settings.delays.correction_s) / MS


OURS: Final[Mapping[str, Callable[[], float]]] = {
    "virtual_joints": _printed_against_ours_mm,
    "linear": _linear_gap_mm,
    "eq_10": _left_along_feed,
    "eq_13": lambda: float(1.0 / np.sqrt(2.0)),
    "eq_16": lambda: float(np.linalg.norm(quaternion_as_printed(np.zeros(3)))),
    "terms": lambda: float(independent_terms()),
    "poses": reachable,
    "mean_deflection": lambda: float(deflections_mm().mean()),
    "reaction": _reaction_ms,
    "pilot_reaction": _pilot_miss_ms,
    "pilot_reaction_computed": lambda: _pilot_miss_ms(_settings().delays.correction_s + 0.5 * BLEND_S),
    "force": groove_force_n,
    "reduction_arithmetic": lambda: 100.0 * (1.0 - 0.3 / 1.4),
}
"""Ours, by the name of the row."""


def _median(run: Mapping[str, Any], name: str, edge: str = "straight", stretch: str = "path") -> float | None:
    """Largest error with a variant at an edge, median of the truths, mm; None where no such run is stored."""
    figures = run["table"].get(name, {}).get(edge)
    return None if figures is None else float(figures[stretch][0])


def _ratio(top: float | None, bottom: float | None) -> float | None:
    return None if top is None or bottom is None else top / bottom


def _reduction(run: Mapping[str, Any]) -> float | None:
    left = _ratio(_median(run, "force_pilot"), _median(run, "uncompensated"))
    return None if left is None else 100.0 * (1.0 - left)


MEASURED: Final[Mapping[str, Callable[[Mapping[str, Any]], float | None]]] = {
    "cubes": lambda run: float(run["median_percent"]),
    "determined": lambda run: float(run["determined"]),
    "uncompensated": lambda run: _median(run, "uncompensated"),
    "cartesian": lambda run: _median(run, "force"),
    "cartesian_oblique": lambda run: _median(run, "force", "oblique"),
    "at_exit": lambda run: _ratio(_median(run, "force", stretch="exit"), _median(run, "force")),
    "pilot": lambda run: _median(run, "force_pilot_40ms"),
    "pilot_shaped": lambda run: _median(run, "force_pilot"),
    "axes": lambda run: _ratio(_median(run, "force_pilot_axes"), _median(run, "force_pilot")),
    "reduction": _reduction,
}
"""Ours from the results of an experiment, by the name of the row."""
