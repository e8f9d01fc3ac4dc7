"""Choose side, width, depth, chip and spindle speed of a wall finish such that the tool stays on the wall.

Every combination of the asked values is computed: the mean force, what it displaces the tool normal to the wall at the
pose, and what that does to spindle, tool and robot. What is not known of force and stiffness is drawn, and choices are
ranked by the size that nine of ten draws stay below: a force that is zero by handbook constants is not zero.

A limit binds where a better choice would be allowed without it. The displacement is that at rest in full engagement;
entry, exit, own weight and lost motion of the drives come on top.

Tooth passing and runout (frequencies N n / 60 and n / 60) are kept off the modes of every posture along the cut: the
magnification of a harmonic force (:mod:`counterflex.plan.strategy.chatter`) stays below :data:`MAGNIFIED`. Chatter of
the robot's own modes: :mod:`counterflex.plan.strategy.chatter`, by the constants and the damping as they are stated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.cutting.coefficients import ForceLaw
from counterflex.plan.process_limits import ProcessLimits, axis_torques
from counterflex.plan.strategy.chatter import Swing, WallPosture, depth_used, worst
from counterflex.plan.strategy.side_cut import SideCuts, in_part, peak_side_force, wrenches
from counterflex.robot.elasticity.chain import ElasticChain

MAGNIFIED: Final = 1.5
_DRAWS: Final = 500
_SEED: Final = 1014
_HIGH: Final = 0.9
_EXPECTED: Final = (0.5, 0.05, 0.95)
_GAIN: Final = 0.98
"""A choice that leaves less than this share of the best allowed one is better."""
_ALIKE: Final = 1.05
"""Choices whose bounds (nine of ten draws) are up to this factor apart are ranked by their force: the standard error of
that quantile of :data:`_DRAWS` draws is 4 %, and what is not drawn (entry, exit, swing) grows with the force."""


@dataclass(frozen=True)
class Doubt:
    """Uncertainties, as standard deviations of logarithms (0.3 is 30 %)."""

    force_common_sigma: float = 0.0  # of all force constants together
    force_each_sigma: float = 0.0  # of the cutting, radial and axial constants separately
    wear_share: float = 0.0  # A worn tool needs up to this share more
    compliance_sigma: float = 0.0  # of the robot's compliance

    def factors(self) -> Float:
        """(draws, 3) factors on the displacement by the cutting, radial and axial constants."""
        rng = np.random.default_rng(_SEED)
        common = self.force_common_sigma * rng.standard_normal((_DRAWS, 1))
        common += self.compliance_sigma * rng.standard_normal((_DRAWS, 1))
        each = self.force_each_sigma * rng.standard_normal((_DRAWS, 3))
        out: Float = np.exp(common + each) * (1.0 + self.wear_share * rng.uniform(size=(_DRAWS, 1)))
        return out


@dataclass(frozen=True, eq=False)
class CutPlace:
    """Place of a cut: stiffness and frames. Part axes are those whose z is the tool axis in the place."""

    chain: ElasticChain  # the robot
    q: Float  # (6,) rad
    compliance_part: Float  # (6, 6) at the tool tip, part axes
    to_part: Float  # (6, 6) motion of the tool relative to the part, part axes, from that of the hand, base axes
    normal_part: Float  # (3,) unit normal of the wall, horizontal, out of the material
    height_m: float  # of the wall, cut in levels of a_p
    standings: tuple[WallPosture, ...] = ()  # the robot in postures along the cut, against chatter; none: nobody looks
    swings: tuple[Swing, ...] = ()  # modes of the postures along the cut, that spindle and teeth are kept off


@dataclass(frozen=True, eq=False)
class Choices:
    """Choices and what they lead to; n of them."""

    cuts: SideCuts  # side, width, depth, feed per tooth
    spindle_rad_s: Float
    error_m: Float  # (n,) normal to the wall by the stated constants; positive leaves material
    expected_m: Float  # (n, 3) size of the error: median of what may be, and the range of nine of ten
    high_m: Float  # (n,) size that nine of ten stay below
    force_n: Float  # (n,) mean force
    peak_n: Float  # (n,) largest force square to the axis, without helix: an upper bound
    torque_nm: Float  # (n,) mean, of the spindle
    power_w: Float
    time_s_per_m: Float  # (n,) for a metre of wall, all levels
    use: dict[str, Float]  # for each limit that is known, (n,) share of it that is used; above 1 it is violated

    @property
    def levels(self) -> Int:
        """(n,) number of levels."""
        flutes = self.cuts.cutter.flutes
        speed = self.cuts.fz_m * flutes * self.spindle_rad_s / (2.0 * math.pi)
        out: Int = np.rint(self.time_s_per_m * speed).astype(np.int64)
        return out

    def allowed(self, without: str = "") -> Bool:
        """(n,) choices within every limit, or every one but ``without``."""
        out = np.ones(len(self.cuts), dtype=np.bool_)
        for name, used in self.use.items():
            if name != without:
                out &= used <= 1.0 + 1e-9
        return out

    def violated(self, row: int) -> tuple[str, ...]:
        """Limits that a choice is beyond."""
        return tuple(name for name, used in self.use.items() if used[row] > 1.0 + 1e-9)

    def best(self, count: int) -> list[int]:
        """The allowed choices of smallest error, one for each side and width, the best first; alike ones by force."""
        allowed = np.flatnonzero(self.allowed())
        high, force = self.high_m[allowed], self.force_n[allowed]
        behind = high > _ALIKE * high.min(initial=math.inf)
        order = allowed[np.lexsort((self.time_s_per_m[allowed], np.where(behind, high, force), behind))]
        seen: set[tuple[bool, float]] = set()
        out = []
        for row in order.tolist():
            key = (bool(self.cuts.up[row]), float(self.cuts.ae_m[row]))
            if key not in seen:
                seen.add(key)
                out.append(row)
            if len(out) == count:
                break
        return out

    def binding(self) -> dict[str, float]:
        """Limits that keep a better choice out, with the error (m) that would be left without each of them."""
        allowed = self.allowed()
        best = float(self.high_m[allowed].min()) if allowed.any() else math.inf
        out = {}
        for name in self.use:
            others = self.allowed(name)
            if others.any() and float(self.high_m[others].min()) < _GAIN * best:
                out[name] = float(self.high_m[others].min())
        return out


@dataclass(frozen=True, eq=False)
class Demands:
    """Demands on a choice beside the limits of the process."""

    slowest_s_per_m: float | None = None  # longest time for a metre of wall; None is any
    allowance_m: float | None = None  # least radial width: roughing is off by so much; None is any
    chips_in_range: bool = True  # hold the mean chip within the range of the law
    # what the program does now. Where its chips or its margin to chatter are beyond a limit, a choice is held against
    # the program instead: such limits are drawn wide, and the program runs
    present: Choices | None = None


CHATTER: Final = "chatter of the robot"
_SOFT: Final = ("thinnest chip of the constants", "thickest chip of the constants", CHATTER)


def grid(cutter_cuts: Sequence[SideCuts], spindle_rad_s: Float) -> tuple[SideCuts, Float]:
    """Every cut with every spindle speed; what :func:`outcomes` takes.

    Args:
        spindle_rad_s: (k,) speeds.

    Raises:
        InputError: There is nothing to choose from.
    """
    if not cutter_cuts or not len(spindle_rad_s) or not sum(len(cuts) for cuts in cutter_cuts):
        raise InputError("there is nothing to choose from", hint="Give ranges that hold at least one value")
    parts = [np.concatenate([getattr(cuts, name) for cuts in cutter_cuts]) for name in ("up", "ae_m", "ap_m", "fz_m")]
    count = len(parts[0])
    up, ae, ap, fz = (np.repeat(part, len(spindle_rad_s)) for part in parts)
    return SideCuts(cutter_cuts[0].cutter, up, ae, ap, fz), np.tile(spindle_rad_s, count)


def outcomes(
    cuts: SideCuts,
    spindle_rad_s: Float,
    law: ForceLaw,
    place: CutPlace,
    limits: ProcessLimits,
    doubt: Doubt,
    demands: Demands,
) -> Choices:
    """Predict the outcome of each choice.

    Args:
        cuts: (n) the cuts.
        spindle_rad_s: (n,) their spindle speeds.
        place: Pose and wall.
        limits: What spindle, tool and robot bear.
        doubt: What is not known.
        demands: What else is asked of a choice.
    """
    alike, back = _alike(cuts)
    by_constant = in_part(alike, wrenches(alike, law), place.normal_part)
    errors = by_constant @ (place.normal_part @ place.compliance_part[:3])
    drawn = np.abs(doubt.factors() @ errors.T)
    expected, high = np.quantile(drawn, _EXPECTED, axis=0).T, np.quantile(drawn, _HIGH, axis=0)
    w = by_constant.sum(axis=1)
    force, torque = np.linalg.norm(w[:, :3], axis=1), np.abs(w[:, 5])
    peak = peak_side_force(alike, law)
    axes = np.abs(axis_torques(place.chain, np.broadcast_to(place.q, (len(alike), 6)), w @ place.to_part))
    power = torque[back] * spindle_rad_s
    speed = cuts.fz_m * cuts.cutter.flutes * spindle_rad_s / (2.0 * math.pi)
    time = np.ceil(place.height_m / cuts.ap_m - 1e-9) / speed
    use: dict[str, Float] = {}
    if demands.chips_in_range:
        use["thinnest chip of the constants"] = law.h_min_m / cuts.mean_chip_m
        use["thickest chip of the constants"] = cuts.mean_chip_m / law.h_max_m
    for name, value, limit in (
        ("spindle torque", torque[back], limits.torque_at(spindle_rad_s)),
        ("spindle power", power, limits.power_w),
        ("highest spindle speed", spindle_rad_s, limits.spindle_max_rad_s),
        ("force", force[back], limits.force_n),
        ("tool bending", limits.bending(cuts.cutter.diameter_m, peak)[back], limits.bending_m),
        ("deflection", high[back], limits.deflection_m),
        ("time", time, demands.slowest_s_per_m),
    ):
        if limit is not None:
            use[name] = value / limit
    if demands.allowance_m is not None:
        use["allowance for roughing"] = demands.allowance_m / cuts.ae_m
    if limits.spindle_min_rad_s is not None:
        use["lowest spindle speed"] = limits.spindle_min_rad_s / spindle_rad_s
    if limits.axis_torque_nm is not None:
        for axis in range(axes.shape[1]):
            use[f"torque of axis {axis + 1}"] = axes[back, axis] / limits.axis_torque_nm[axis]
    if place.standings:
        use[CHATTER] = depth_used(cuts, law, spindle_rad_s, place.standings).max(axis=1)
    use |= _mode_use(cuts.cutter.flutes, spindle_rad_s, place.swings)
    for name in _SOFT if demands.present is not None else ():
        if demands.present is not None and name in use:
            # A program that runs beyond such a limit shows how wide it is drawn: a choice may be as far beyond, no
            # farther.
            use[name] = use[name] / max(1.0, float(demands.present.use[name][0]))
    return Choices(
        cuts=cuts,
        spindle_rad_s=spindle_rad_s,
        error_m=errors.sum(axis=1)[back],
        expected_m=expected[back],
        high_m=high[back],
        force_n=force[back],
        peak_n=peak[back],
        torque_nm=torque[back],
        power_w=power,
        time_s_per_m=time,
        use=use,
    )


def _alike(cuts: SideCuts) -> tuple[SideCuts, Int]:
    """Cuts without repetitions, and which of them each is."""
    keys = np.stack([cuts.up.astype(np.float64), cuts.ae_m, cuts.ap_m, cuts.fz_m], axis=1)
    _, first, back = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return cuts.some(first.tolist()), np.asarray(back, dtype=np.int64).reshape(-1)


def _mode_use(flutes: int, spindle_rad_s: Float, swings: tuple[Swing, ...]) -> dict[str, Float]:
    """Largest magnification along the cut over what is allowed, of tooth passing and runout."""
    if not swings:
        return {}
    return {
        name: worst(swings, times * spindle_rad_s) / MAGNIFIED
        for name, times in (("tooth passing on a mode", float(flutes)), ("runout on a mode", 1.0))
    }
