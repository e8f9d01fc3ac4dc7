"""What is the same in all test cuts and is not fitted: the force sensor's scale and cross-talk, wear, runout.

A sensor that shows 2 % of the cutting force along its axial direction shows it in every cut: it passes for another
axial constant, and no residual and no cut left out tells. The standard deviations of such quantities go through the fit
(:mod:`counterflex.identify.solver.considered`). For a force f on the tool, in the axes of the force channel::

    sensor    d f_i = E_ij f_j         E_ii ~ scale, E_ij ~ cross_talk    (shares of the reading)
    mounting  d f = a x f              a ~ alignment per axis
    wear      d f = w p f              p: 0 at the first piece, 1 at the last; w ~ wear_sigma
    runout    d f = f(e) - f(0)        mean over a revolution with the teeth e beside the spindle axis

Sources: data sheets. Piezoelectric dynamometers for milling (Kistler 9129AA, 9257B) state a cross-talk within 2 %,
taken as uniform, 2 % / sqrt 3; six-axis sensors (ATI Net F/T) an uncertainty at 95 % of 1 to 2 % of the range per axis,
half of the larger one. Runout: 10 um of indicated run-out at the edges (half of that is the offset of the axis), what
collet chucks of good quality have at three diameters (ISO 15488). Wear: the force grows by some 30 % over the life of
an edge, of which test cuts take a tenth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, UM
from counterflex.cutting.arc_force import ArcCuts
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.force import engagement_of_arc
from counterflex.cutting.tooth_force import tooth_forces
from counterflex.identify.cutting.residuals import SlotResiduals
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.solver.considered import added, considered
from counterflex.identify.solver.fit import Fit

SCALE: Final = 0.01
CROSS_TALK: Final = 0.02 / math.sqrt(3.0)
ALIGNMENT_RAD: Final = 1.0 * DEG
WEAR: Final = 0.03
RUNOUT_M: Final = 5.0 * UM
ACCURACY, SCALE_KEY, CROSS_KEY, ALIGNMENT_KEY = (
    "force_accuracy_n",
    "force_scale_sigma",
    "force_cross_talk_sigma",
    "force_alignment_rad",
)
_MOST: Final = 0.5
_BINS: Final = 32
_STEPS: Final = 384


@dataclass(frozen=True)
class ForceSensor:
    """How true a force sensor is, as standard deviations.

    Attributes:
        scale: Of the scale of each axis, share of the reading.
        cross_talk: Of what an axis shows of the force along another, share of that force.
        alignment_rad: Of its turn against the stated axes, about each axis.
        accuracy_n: Uncertainty (95 %) of each axis anywhere in its range, N, in place of scale and cross-talk; or None.
        stated: Keys of the manifest that it was read from.
    """

    scale: float = SCALE
    cross_talk: float = CROSS_TALK
    alignment_rad: float = ALIGNMENT_RAD
    accuracy_n: float | None = None
    stated: tuple[str, ...] = ()

    def shares(self, force_n: float) -> tuple[float, float]:
        """Standard deviations of scale and cross-talk as shares of the force.

        ``force_n``: Largest force measured. An uncertainty in N is what it is there: half of it (one standard
        deviation) over the force.
        """
        if self.accuracy_n is None:
            return self.scale, self.cross_talk
        share = 0.5 * self.accuracy_n / max(force_n, 1e-9)
        return share, share

    @property
    def text(self) -> str:
        """In words, with what was taken because nothing is stated."""
        parts = []
        if self.accuracy_n is not None:
            parts.append((f"uncertainty {self.accuracy_n:.3g} N (95 %) per axis", ACCURACY in self.stated))
        else:
            parts.append((f"scale {100 * self.scale:.2g} % per axis", SCALE_KEY in self.stated))
            parts.append((f"cross-talk {100 * self.cross_talk:.2g} %", CROSS_KEY in self.stated))
        parts.append((f"alignment {self.alignment_rad / DEG:.2g} deg per axis", ALIGNMENT_KEY in self.stated))
        return ", ".join(f"{text} ({'as stated' if stated else 'usual'})" for text, stated in parts)


def force_sensor(data: Sequence[Dataset]) -> ForceSensor:
    """The sensor as the manifests state it under ``[settings]``; of several statements the widest.

    Raises:
        InputError: A statement out of range, or the uncertainty stated twice.
    """
    sigma: dict[str, float] = {}
    for d in data:
        for key, most in ((ACCURACY, math.inf), (SCALE_KEY, _MOST), (CROSS_KEY, _MOST), (ALIGNMENT_KEY, _MOST)):
            if key in d.settings:
                sigma[key] = max(sigma.get(key, 0.0), _number(d, key, most))
        if ACCURACY in d.settings and (SCALE_KEY in d.settings or CROSS_KEY in d.settings):
            raise InputError(
                "the uncertainty of the force sensor is stated twice",
                where=d.where or d.name,
                value=", ".join(k for k in (ACCURACY, SCALE_KEY, CROSS_KEY) if k in d.settings),
                hint=f"Give {ACCURACY} (% of the range), or {SCALE_KEY} and {CROSS_KEY} (% of the force)",
            )
    return ForceSensor(
        sigma.get(SCALE_KEY, SCALE),
        sigma.get(CROSS_KEY, CROSS_TALK),
        sigma.get(ALIGNMENT_KEY, ALIGNMENT_RAD),
        sigma.get(ACCURACY),
        tuple(sigma),
    )


def _number(data: Dataset, key: str, most: float) -> float:
    value = data.settings[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < most:
        limit = ">= 0, N" if most == math.inf else f"0 .. {most:g}, one standard deviation"
        raise InputError(f"setting {key}", where=data.where or data.name, value=str(value), limit=limit)
    return float(value)


def moved_by(block: SlotResiduals, x: Float, law: ForceLaw, sensor: ForceSensor, wear: float, runout_m: float) -> Float:
    """(n, 3, 14) N, feed frame: what one standard deviation of each quantity moves the mean force of each piece by.

    Args:
        block: The pieces.
        x: (p,) fitted values, for depth and arc.
        law: The fitted law, for the runout.
        sensor: How true the sensor is.
        wear: Standard deviation of the growth of the force from the first piece to the last, share.
        runout_m: Of the offset of the cutter's axis from the spindle's; one of the cell file counts where it is larger.
    """
    pieces = block.pieces
    done = pieces.run_m if np.ptp(pieces.run_m) > 0.0 else np.arange(len(pieces), dtype=np.float64)
    worn = pieces.force * (wear * (done - done.min()) / max(float(np.ptp(done)), 1e-12))[:, None]
    eccentric = runout_force(block, x, law, max(runout_m, block.cutter.runout_m))
    shown = shown_by_sensor(pieces.force, pieces.axes, sensor)
    out: Float = np.concatenate([shown, worn[:, :, None], eccentric[:, :, None]], axis=2)
    return out


def shown_by_sensor(force: Float, axes: Float, sensor: ForceSensor) -> Float:
    """(n, 3, 12) N, feed frame: what one standard deviation of scale, cross-talk and alignment moves mean forces by.

    ``force``: (n, 3) N in the feed frame. ``axes``: (n, 3, 3) from the axes of the force channel to the feed frame.
    """
    n = len(force)
    scale, cross = sensor.shares(float(np.max(np.linalg.norm(force, axis=1), initial=0.0)))
    own = np.einsum("nji,nj->ni", axes, force)
    share = np.where(np.eye(3, dtype=np.bool_), scale, cross)
    shown = np.einsum("nai,nj,ij->naij", axes, own, share).reshape(n, 3, 9)
    turned = np.stack([np.cross(e, own) for e in np.eye(3)], axis=2) * sensor.alignment_rad
    out: Float = np.concatenate([shown, np.einsum("nai,nij->naj", axes, turned)], axis=2)
    return out


def runout_force(block: SlotResiduals, x: Float, law: ForceLaw, runout_m: float) -> Float:
    """(n, 3) N: by how much runout changes the mean force of each piece.

    ``x``: (p,) values of all parameters. ``runout_m``: Offset of the cutter's axis, m; at its angle to the teeth the
    mean over a revolution is the same.

    Returns:
        Force with less force without it. Descent of the tool is left out.
    """
    return runout_of_arcs(block.shape(x).cuts, law, runout_m)


def runout_of_arcs(cuts: ArcCuts, law: ForceLaw, runout_m: float) -> Float:
    """(n, 3) N: the same for cuts over one arc; see :func:`runout_force`."""
    out = np.zeros((len(cuts), 3))
    cutter = cuts.cutter
    if runout_m <= 0.0 or cutter.flutes < 2:
        return out
    cutters = [replace(cutter, runout_m=e, runout_angle_rad=0.0) for e in (runout_m, 0.0)]
    for i in range(len(cuts)):
        depth, entry, leave = float(cuts.depth_m[i]), float(cuts.entry_rad[i]), float(cuts.exit_rad[i])
        if depth <= 0.0 or leave <= entry:
            continue
        engaged = engagement_of_arc(cutter, depth, entry, leave, _BINS)
        feed = float(cuts.feed_tooth_m[i])
        with_it, without = (tooth_forces(c, law, engaged, feed, trochoid=False, steps=_STEPS).mean[:3] for c in cutters)
        out[i] = with_it - without
    return out


def with_shared(
    fit: Fit, block: SlotResiduals, law: ForceLaw, sensor: ForceSensor, wear: float, runout_m: float
) -> Fit:
    """The fit with the standard deviations of what all cuts share; arguments as in :func:`moved_by`."""
    return added(fit, considered(fit, [block], [moved_by(block, fit.values, law, sensor, wear, runout_m)]))
