"""Effects that all test cuts share and no fit finds: the force sensor's scale and cross-talk, wear, runout.

A sensor that shows 2 % of the cutting force along its axial direction shows it in every cut: it passes for another
axial constant, and no residual and no cut left out tells. The standard deviations of such quantities go through the fit
(:mod:`counterflex.identify.solver.jackknife`). For a force f on the tool, in the axes of the force channel::

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
from functools import partial
from typing import Final, Protocol

import numpy as np
import scipy

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, UM
from counterflex.cutting.arc_force import ArcCuts
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import engagement_of_arc
from counterflex.cutting.tooth_force import tooth_forces
from counterflex.identify.cutting.cut_rows import Pieces
from counterflex.identify.cutting.force_forms import FORMS
from counterflex.identify.cutting.residuals import SlotResiduals, geometry_parameters
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.model import CellModel
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.jackknife import added, considered

FORCE_N = 0.5
"""Standard deviation of the mean of a settled piece that is assumed."""


GAUGE_M = 20.0 * UM
"""Standard deviation of a gauged depth that is assumed."""


class PlannedMove(Protocol):
    """Part of a proposed motion that is used; see :class:`counterflex.identify.cutting.proposal.CutMove`."""

    @property
    def blank(self) -> int:
        """Number of the blank."""

    @property
    def cut(self) -> int:
        """Number of the cut."""

    @property
    def depth_m(self) -> float:
        """Depth."""

    @property
    def width_m(self) -> float:
        """Signed width."""

    @property
    def feed_tooth_m(self) -> float:
        """Feed per tooth."""

    @property
    def piece(self) -> bool:
        """Return whether it is a test piece."""


def planned_pieces(cutter: Cutter, moves: Sequence[PlannedMove], gauged: bool) -> Pieces:
    """Pieces of proposed motions, without forces."""
    own = [m for m in moves if m.piece]
    n, R = len(own), cutter.radius_m
    width = np.array([m.width_m for m in own])
    slot = np.abs(width) >= 2.0 * R * (1.0 - 1e-9)
    up, down = ~slot & (width > 0.0), ~slot & (width < 0.0)
    return Pieces(
        force=np.ones((n, 3)),
        sigma=np.full((n, 3), FORCE_N),
        depth_m=np.array([m.depth_m for m in own]),
        depth_sigma_m=np.full(n, GAUGE_M if gauged else 0.0),
        measured=np.full(n, gauged),
        left_m=np.where(down, -R - width, R),
        right_m=np.where(up, R - width, -R),
        left_wall=down,
        right_wall=up,
        feed_tooth_m=np.array([m.feed_tooth_m for m in own]),
        drop_tooth_m=np.zeros(n),
        drop_sigma_m=np.zeros(n),
        give_m=np.zeros((n, 3)),
        elastic=np.zeros(n, dtype=np.bool_),
        axes=np.tile(np.eye(3), (n, 1, 1)),
        turn_n=np.full(n, np.nan),
        cut=np.array([m.cut for m in own], dtype=np.int64),
        blank=np.array([m.blank for m in own], dtype=np.int64),
        run_m=np.zeros(n),
        session=np.zeros(n, dtype=np.int64),
        place=np.arange(n, dtype=np.int64),
    )


def expected_sigma(cell: CellModel, cutter: Cutter, moves: Sequence[PlannedMove], *, gauged: bool) -> dict[str, float]:
    """Standard deviation of each constant of the fullest form of the law and of the tops of the blanks, SI.

    The covariance of ``J^T J`` plus the priors at the law known so far; forces of :data:`FORCE_N`, depths and widths
    as uncertain as :mod:`counterflex.identify.cutting.residuals` takes them.
    """
    pieces, form = planned_pieces(cutter, moves, gauged), FORMS[-1]
    blanks = int(np.max(pieces.blank)) + 1
    rough = SlotResiduals(pieces, cutter, form, 50e-6, cell.force_law, blanks)
    h_ref = rough.reference_m()
    block = SlotResiduals(pieces, cutter, form, h_ref, cell.force_law, blanks)
    parameters = form.parameters(cell.force_law, h_ref) + geometry_parameters(pieces)
    x = parameters.nominal
    free = np.flatnonzero(parameters.free)
    J: Float = block.jacobian(x)[:, :, free].reshape(-1, len(free)) * parameters.slope(x)[free]
    known = np.array([parameters.items[i].has_prior for i in free], dtype=np.float64)
    covariance = np.linalg.inv(J.T @ J + np.diag(known))
    sigma = np.sqrt(np.diag(covariance)) * parameters.slope(x)[free]
    return {parameters.items[i].name: float(s) for i, s in zip(free, sigma, strict=True)}


# Runout of the tool from the part of the cutting force that repeats once per turn of the spindle.
# Teeth that stand at different radii take chips of different thickness: the force then has a part at the spindle's own
# frequency, nearly in proportion to the runout. It is seen only in a fast record from a sensor that is true there.

LEAST_TURNS: Final = 5.0
"""Turns that a stretch must span."""
SAMPLES_PER_TOOTH: Final = 2.5
"""Samples per tooth passing that a record needs."""
_LARGEST: Final = 5.0  # feeds per tooth; the answer no longer grows beyond


@dataclass(frozen=True)
class TurnForce:
    """Force that repeats once per turn in a settled piece of a cut."""

    amplitude_n: float  # length of the complex amplitude of the force across the tool axis
    depth_m: float
    entry_rad: float
    exit_rad: float
    feed_tooth_m: float  # feed per tooth

    def amplitude(self, cutter: Cutter, law: ForceLaw, runout_m: float) -> float:
        """The same as the model has it with a runout, N."""
        depth = engagement_of_arc(cutter, self.depth_m, self.entry_rad, self.exit_rad)
        teeth = tooth_forces(replace(cutter, runout_m=runout_m), law, depth, self.feed_tooth_m, trochoid=False)
        wave = np.exp(-1j * teeth.angle_rad)
        return float(np.linalg.norm(2.0 * np.mean(teeth.wrench_tcp[:, :2] * wave[:, None], axis=0)))


@dataclass(frozen=True)
class Runout:
    """Offset of the tool's axis from the spindle's, and its standard deviation from the scatter between pieces, m."""

    value_m: float
    sigma_m: float
    pieces: int


def fast_enough(time_s: Float, spindle_rad_s: float, flutes: int) -> bool:
    """Return whether single teeth show: :data:`SAMPLES_PER_TOOTH` samples of each over :data:`LEAST_TURNS` turns."""
    if len(time_s) < 2:
        return False
    turns = float(np.ptp(time_s)) * spindle_rad_s / (2.0 * math.pi)
    return turns >= LEAST_TURNS and len(time_s) / turns >= SAMPLES_PER_TOOTH * flutes


def turn_amplitude(force: Float, time_s: Float, spindle_rad_s: float, flutes: int) -> float:
    """Amplitude of what repeats once per turn, N: least squares on the harmonics of a turn up to the tooth passing.

    ``force``: (n, 2) N across the tool axis. ``time_s``: (n,) s. Raises InputError: the record is not fast or long
    enough; see :func:`fast_enough`.
    """
    force = as_float("force", force, (len(time_s), 2))
    if not fast_enough(time_s, as_positive("spindle_rad_s", spindle_rad_s), flutes):
        raise InputError("the record does not show single teeth", value=f"{len(time_s)} samples")
    angle = spindle_rad_s * (time_s - time_s[0])
    waves = [np.ones_like(angle)]
    for order in range(1, flutes + 1):
        waves += [np.cos(order * angle), np.sin(order * angle)]
    coefficients, *_ = np.linalg.lstsq(np.stack(waves, axis=1), force, rcond=None)
    return float(np.linalg.norm(coefficients[1:3]))


def runout(turns: Sequence[TurnForce], cutter: Cutter, law: ForceLaw) -> Runout | None:
    """Runout that gives every piece its amplitude; median over the pieces.

    Returns the runout, or None for a single flute, no piece, or amplitudes of half of them beyond what runout can do.
    """
    amplitudes = []
    if cutter.flutes < 2:
        return None
    for turn in turns:
        largest = min(_LARGEST * turn.feed_tooth_m, 0.5 * cutter.radius_m)
        excess = partial(_excess, turn, cutter, law)
        # Beyond a few feeds per tooth only one tooth cuts and the amplitude no longer grows: no runout explains more.
        # Such a piece counts as larger than all others: left out, it would draw the median down.
        within = excess(largest) > 0.0
        amplitudes.append(float(scipy.optimize.brentq(excess, 0.0, largest, xtol=1e-9)) if within else math.inf)
    values = np.array(amplitudes)
    if not amplitudes or 2 * np.count_nonzero(np.isfinite(values)) <= len(values):
        return None
    spread = 1.4826 * float(np.median(np.abs(values - np.median(values))))
    return Runout(float(np.median(values)), 1.2533 * spread / math.sqrt(len(values)), len(values))


def _excess(turn: TurnForce, cutter: Cutter, law: ForceLaw, runout_m: float) -> float:
    return turn.amplitude(cutter, law, runout_m) - turn.amplitude_n


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
class SensorAccuracy:
    """Accuracy of a force sensor, as standard deviations."""

    scale: float = SCALE  # of the scale of each axis, share of the reading
    cross_talk: float = CROSS_TALK  # of what an axis shows of the force along another, share of that force
    alignment_rad: float = ALIGNMENT_RAD  # of its turn against the stated axes, about each axis
    # uncertainty (95 %) of each axis anywhere in its range, N, in place of scale and cross-talk; or None
    accuracy_n: float | None = None
    stated: tuple[str, ...] = ()  # keys of the manifest that it was read from

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


def force_sensor(data: Sequence[Dataset]) -> SensorAccuracy:
    """The sensor as the manifests state it under ``[settings]``; of several statements the widest.

    Raises InputError: a statement out of range, or the uncertainty stated twice.
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
    return SensorAccuracy(
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


def moved_by(
    block: SlotResiduals, x: Float, law: ForceLaw, sensor: SensorAccuracy, wear: float, runout_m: float
) -> Float:
    """(n, 3, 14) N, feed frame: what one standard deviation of each quantity moves the mean force of each piece by.

    ``x``: (p,) fitted values, for depth and arc. ``wear``: Standard deviation of the growth of the force from the first
    piece to the last, share. ``runout_m``: Of the offset of the cutter's axis from the spindle's; one of the cell file
    counts where it is larger.
    """
    pieces = block.pieces
    done = pieces.run_m if np.ptp(pieces.run_m) > 0.0 else np.arange(len(pieces), dtype=np.float64)
    worn = pieces.force * (wear * (done - done.min()) / max(float(np.ptp(done)), 1e-12))[:, None]
    eccentric = runout_force(block, x, law, max(runout_m, block.cutter.runout_m))
    shown = shown_by_sensor(pieces.force, pieces.axes, sensor)
    out: Float = np.concatenate([shown, worn[:, :, None], eccentric[:, :, None]], axis=2)
    return out


def shown_by_sensor(force: Float, axes: Float, sensor: SensorAccuracy) -> Float:
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
    mean over a revolution is the same. Returns force with less force without it. Descent of the tool is left out.
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
    fit: Fit, block: SlotResiduals, law: ForceLaw, sensor: SensorAccuracy, wear: float, runout_m: float
) -> Fit:
    """The fit with the standard deviations of what all cuts share; arguments as in :func:`moved_by`."""
    return added(fit, considered(fit, [block], [moved_by(block, fit.values, law, sensor, wear, runout_m)]))
