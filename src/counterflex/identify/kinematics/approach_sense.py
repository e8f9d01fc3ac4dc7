"""From which side each axis came to a pose, and what that costs: half of the lost motion of each axis.

A link stays behind its motor by half of the lost motion in the sense in which the axis came: ``q_link = q - h s`` with
s = +1 where the angle rose before the pose, -1 where it fell, 0 where nobody knows. Dry friction over the torsion of
the axis does that on a loaded axis too; a dead band alone does not, since the load keeps it taken up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, UM, URAD
from counterflex.identify.data.changes import AxisPlay
from counterflex.identify.data.dataset import Channel, Dataset
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import HeldOut
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.play import axis_torque
from counterflex.robot.model.description import Play

CHANNEL: Final = "approach"
SETTING: Final = "approach"
IN_ORDER: Final = "row order"
"""Value of the manifest's setting ``approach``: the rows stand in the order in which the poses were taken."""
OPTIONS: Final = ("auto", "off", "known", "order")
LEAST_RAD: Final = 0.02 * DEG
"""A move shorter than this does not turn the friction of an axis round: the sense of the move before it holds."""
PRIOR_RAD: Final = 100.0 * URAD
"""Standard deviation of half of the lost motion before it is measured."""
SEEN: Final = 3.0
"""Standard deviations above zero from which an axis is taken to lose motion."""
SURE: Final = 2.0
"""Standard errors by which the error of poses held out has to fall."""
SLIP_RAD: Final = 20.0 * URAD
"""Angle within which friction turns round, where the cell file does not say it."""
SOFTEST: Final = 1e-11
"""Torsion compliance from which friction over it is written, rad/(N m)."""
_RIGID_FRICTION_NM = 1.0


def with_approach(data: Sequence[Dataset], option: str) -> list[Dataset]:
    """The datasets with the channel ``approach`` (angles before the pose minus those of the pose) where it is known.

    Args:
        data: Any kinds; only poses and points with angles matter.
        option: ``known`` takes the channel, or the order of the rows where the manifest says that they stand in it
            (``approach = "row order"``); ``auto`` does so where there is either; ``order`` takes the order of the rows
            of every dataset without the channel.

    Raises:
        InputError: Another word, or not one dataset says from where its poses were reached.
    """
    if option not in OPTIONS:
        raise InputError("unknown setting", where="play", value=option, limit=", ".join(OPTIONS))
    if option == "off":
        return list(data)
    out, known = [], False
    for d in data:
        stated = str(d.settings.get(SETTING, ""))
        if stated not in ("", IN_ORDER):
            raise InputError("unknown setting", where=f"{d.where}: approach", value=stated, limit=f"'{IN_ORDER}'")
        open_ = d.kind in ("tracker_poses", "tracker_points") and d.has("q") and not d.has(CHANNEL)
        ordered = open_ and (option == "order" or stated == IN_ORDER)
        out.append(replace(d, channels={**d.channels, CHANNEL: in_order(d)}) if ordered else d)
        known = known or out[-1].has(CHANNEL)
    if not known and option != "auto":
        raise InputError(
            "the direction of approach of the axes is not stated",
            where=data[0].where or data[0].name,
            value="play = known",
            hint=f'Map the channel "{CHANNEL}", or state under [settings]: {SETTING} = "{IN_ORDER}" where the rows '
            "stand in the order in which they were measured (or --set play=order)",
        )
    return out


def in_order(d: Dataset) -> Channel:
    """Channel ``approach`` of rows that stand in the order in which the poses were taken; 0 before the first move."""
    q = d.values("q")
    out = np.zeros_like(q)
    for i in range(1, len(q)):
        back = q[i - 1] - q[i]
        # A shorter move leaves the axis where friction had pressed it: the sense of the move before still holds.
        out[i] = np.where(np.abs(back) >= LEAST_RAD, back, out[i - 1])
    return Channel(CHANNEL, out, None, "rad", f"{d.name}: order of the rows")


def senses(d: Dataset) -> Float | None:
    """(m, 6) sense s in which each axis came to each pose: +1, -1, or 0 where it is not known; None without it."""
    if not d.has(CHANNEL):
        return None
    back = d.values(CHANNEL)
    out: Float = np.where(np.abs(back) >= LEAST_RAD, -np.sign(back), 0.0)
    return out


def seen_axes(places: Mapping[int, int], fit: Fit) -> tuple[int, ...]:
    """Axes whose half of the lost motion is above zero beyond chance.

    ``places``: Of the parameters, by axis 0..5.
    """
    return tuple(a for a, i in places.items() if fit.values[i] > SEEN * fit.sigma[i])


def better(with_lost: HeldOut, without: HeldOut) -> tuple[bool, str]:
    """Return whether poses held out are predicted better beyond chance, pose by pose, and the sentence that says it."""
    rows = {
        (int(b), int(r)): float(e)
        for b, r, e, g in zip(without.block, without.row, without.identified, without.gross, strict=True)
        if not g
    }
    pairs = np.array(
        [
            (e, rows[int(b), int(r)])
            for b, r, e, g in zip(with_lost.block, with_lost.row, with_lost.identified, with_lost.gross, strict=True)
            if not g and (int(b), int(r)) in rows
        ]
    )
    fall = pairs[:, 1] - pairs[:, 0]
    error = float(np.std(fall) / np.sqrt(len(fall)))
    mean = float(np.mean(fall))
    sentence = (
        f"the mean error of poses held out is {np.mean(pairs[:, 0]) / UM:.1f} um with and "
        f"{np.mean(pairs[:, 1]) / UM:.1f} um without (difference {mean / UM:.2f} +- {error / UM:.2f} um)"
    )
    return mean > SURE * error and mean > 0.0, sentence


def as_play(chain: ElasticChain, axis: int, half_rad: float, compliance: float, q: Float) -> AxisPlay | None:
    """Half of the lost motion as the friction of the cell file's ``[[robot.play]]``: ``h = c F``.

    Args:
        chain: With masses, and the play known so far.
        axis: 0..5.
        half_rad: h.
        compliance: c, torsion compliance of the axis, rad/(N m); where the axis is rigid and carries no weight, a dead
            band with little friction does the same.
        q: (m, 6) rad, the poses.

    Returns:
        None where the axis is rigid and loaded: the cell file cannot say it without a compliance.
    """
    before = None if chain.play is None else chain.play[axis]
    slip = before.slip_rad[-1] if before is not None and before.slip_rad else SLIP_RAD
    if compliance >= SOFTEST:
        return AxisPlay(axis, Play(0.0, (half_rad / compliance,), (slip,)))
    if float(np.max(np.abs(axis_torque(chain, q)[:, axis]), initial=0.0)) > 0.5 * _RIGID_FRICTION_NM:
        return None
    return AxisPlay(axis, Play(half_rad, (_RIGID_FRICTION_NM,), (slip,)))


def play_remarks(plays: Mapping[int, AxisPlay | None]) -> tuple[str, ...]:
    """Remarks on the cell file's ``[[robot.play]]``.

    ``plays``: By axis 0..5, see :func:`as_play`.
    """
    stored = [f"{a + 1}" for a, play in sorted(plays.items()) if play is not None]
    omitted = [f"{a + 1}" for a, play in sorted(plays.items()) if play is None]
    out = []
    if stored:
        out.append(
            f"Lost motion of axis {', '.join(stored)} is stored in [[robot.play]] as friction over the torsion of the "
            f"axis and replaces the former values: plans reverse it with the axis."
        )
    if omitted:
        out.append(
            f"Lost motion of axis {', '.join(omitted)} is not written to the cell file: the axis carries weight and "
            f"has no torsion compliance there; identify stiffness first."
        )
    return tuple(out)


def describe(places: Mapping[int, int], fit: Fit, axes: Sequence[int]) -> str:
    """Describe the result, axis by axis, with the ends of the 95 % interval."""
    return "; ".join(
        f"axis {a + 1} loses +-{fit.values[places[a]] / URAD:.1f} urad "
        f"({_ends(float(fit.values[places[a]]), float(fit.sigma[places[a]]))})"
        for a in axes
    )


def _ends(value: float, sigma: float) -> str:
    return f"{(value - 1.96 * sigma) / URAD:.1f} to {(value + 1.96 * sigma) / URAD:.1f}, 95 %"
