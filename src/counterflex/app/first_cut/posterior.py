"""Constants of a cell from coordinates measured on one part: Gaussian in the logarithms of their factors.

A face lies off by the displacement of the tool that made it,

    y = n . (d_0 + sum_jk (exp(a_j + c_k) - 1) D_jk + sum_j (exp(a_j + g) - 1) S_j + sum_i (exp(p_i) - 1) P_i + o) + e

with d_0 predicted with the cell file, D_jk the deflection of elastic element k under the cutting force of direction j
(tangential, radial, axial), S_j what the drives yield to it, P_i what play or friction of an axis adds per factor and o
an offset of the part frame. a, c, g, p and o are normal about zero with the spread that ``cell check`` takes; e is
noise, :data:`STRUCTURE` of the deflection that a face has in common and :data:`LOCAL` of it place by place. The
estimate is the maximum a posteriori by Gauss-Newton; places far off lose their weight (Student's t, :data:`FREEDOM`).

What one coupon shows of each element by itself is little; of all together, the deflection, it is much. All are kept: a
deflection without the play that was found beside it fits no face. Derivatives are those of a robot at rest: in motion
the grain of the stock makes more noise than a loop gain does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
import scipy

from counterflex.app.correction.causes import OFFSET_M
from counterflex.app.inputs import setting_of
from counterflex.app.lowest_mode import COMMON, STATED, assumed_sigma, at_largest_force, identified_sigma
from counterflex.app.prediction_interval import STRUCTURE, drives_yield
from counterflex.app.unknowns import HANDBOOK, IDENTIFIED, WORN
from counterflex.core.arrays import Float, Int
from counterflex.core.progress import silent
from counterflex.core.units import MM, UM
from counterflex.files.cell.cell import Cell
from counterflex.plan.compensate import in_fine_stock
from counterflex.plan.inputs import CompensationInputs
from counterflex.plan.plan import Plan
from counterflex.plan.sag_and_play import play_deviation, touched_points
from counterflex.plan.static_correction import loaded_robot
from counterflex.plan.tool_deviation import run
from counterflex.plan.undisturbed_cut import undisturbed_cut
from counterflex.robot.elasticity.compliance import shares
from counterflex.robot.elasticity.play import arrays
from counterflex.robot.model.class_prior import PLAY_FACTOR
from counterflex.robot.model.description import Play

FORCES: Final = ("tangential", "radial", "axial")
LOCAL: Final = 0.03
"""Of the deflection, place by place."""
DIRECTION: Final = 0.25
"""Standard deviation of the logarithm of radial and axial force, beside the common one."""
FREEDOM: Final = 4.0
OTHERWISE: Final = 0.5
"""Share of the variance of drives, play and friction that no coupon takes away: other programs turn other axes back, at
other speeds, and friction before and behind a gear acts otherwise then. A judgement."""
_LEAST_M: Final = 5.0 * UM
_SEEN: Final = 1e-4
"""Share of the sum of squares of the deflection from which an element counts."""
_STEPS: Final = 20
_LONGEST: Final = 0.7
"""Longest step of a logarithm."""
_NORMAL: Final = 1.645
# Friction has that of play: how much of it acts behind the gear is known as little.
_CHANGE: Final = 0.25
"""Of play and friction, for derivatives by differences."""


@dataclass(frozen=True, eq=False)
class MeasuredCoordinates:
    """Coordinates measured on a part; m places."""

    row: Int  # (m,) row of the plan whose tool made the place
    axis: Int  # (m,) 0..2
    face: Int  # (m,) number of the face
    number: Int  # (m,) of the place in its table
    off_m: Float  # (m,) measured minus nominal coordinate
    sigma_m: float  # standard deviation of a reading

    def along(self, displacement: Float) -> Float:
        """Component (..., m) m of displacements (..., m, 3) m along the measured axis."""
        out: Float = displacement[..., np.arange(len(self.axis)), self.axis]
        return out

    def only(self, rows: Int) -> MeasuredCoordinates:
        """Some of the places."""
        values = {name: getattr(self, name)[rows] for name in ("row", "axis", "face", "number", "off_m")}
        return replace(self, **values)


class Constants(NamedTuple):
    """A value of each constant."""

    force: Float  # (3,) tangential, radial, axial
    elements: Float  # (k,) compliance
    drives: Float  # (1,) what the drives yield
    play: Float  # (i,) play, then friction behind the gear, of each axis
    offset_m: Float  # (3,)


def split(values: Float, elements: int) -> Constants:
    """Values (p,) of all constants by kind."""
    return Constants(*np.split(values, [3, 3 + elements, 4 + elements, len(values) - 3]))


@dataclass(frozen=True, eq=False)
class Patterns:
    """Coordinates of m places, m, and their parts by each constant."""

    predicted_m: Float  # (m,)
    elements_m: Float  # (3, k, m) deflection of each element by each direction of force
    drives_m: Float  # (3, m) what the drives yield to each direction of force
    play_m: Float  # (i, m) by a factor of play, then of friction
    offset_m: Float  # (3, m)

    def at(self, values: Float) -> tuple[Float, Float]:
        """Coordinates (m,) and their derivatives (m, p) at logarithms of the factors and the offset (p,)."""
        log = split(values, self.elements_m.shape[1])
        force, soft, drive, play = (np.exp(one) for one in log[:-1])
        by_force = np.einsum("k,jkm->jm", soft, self.elements_m) + drive * self.drives_m
        still = self.elements_m.sum(axis=(0, 1)) + self.drives_m.sum(axis=0) + self.play_m.sum(axis=0)
        y = self.predicted_m - still + force @ by_force + play @ self.play_m
        columns = [
            force[:, None] * by_force,
            soft[:, None] * np.einsum("j,jkm->km", force, self.elements_m),
            (force @ (drive * self.drives_m))[None],
            play[:, None] * self.play_m,
            self.offset_m,
        ]
        return y + log.offset_m @ self.offset_m, np.concatenate(columns).T

    def through(self, predicted_m: Float, play_m: Float, fit: Posterior) -> Patterns:
        """The patterns as a cell with the constants of an estimate has them: coordinates (m,), its play (i, m), m."""
        theta = fit.value.copy()
        theta[-3:] = 0.0
        new = replace(self, play_m=play_m / fit.factors.play[:, None])
        return replace(new, predicted_m=self.predicted_m + predicted_m - new.at(theta)[0])

    def only(self, rows: Int) -> Patterns:
        """Some of the places."""
        return Patterns(*(getattr(self, name)[..., rows] for name in self.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class Posterior:
    """Estimate of the constants."""

    elements: tuple[str, ...]  # names
    value: Float  # (p,) logarithms of the factors of force (3), elements, drives, play and friction; offset (3) m
    covariance: Float  # (p, p)
    before: Float  # (p, p) covariance of what was known before
    left_m: Float  # (m,) measured minus estimated coordinate

    @property
    def factors(self) -> Constants:
        """Factors of the constants, and the offset."""
        log = split(self.value, len(self.elements))
        force, elements, drives, play = (np.exp(one) for one in log[:-1])
        return Constants(force, elements, drives, play, log.offset_m)

    @property
    def sigma(self) -> Constants:
        """Standard deviations of the logarithms, and of the offset."""
        return split(np.sqrt(np.diag(self.covariance)), len(self.elements))

    def widened(self, off_m: Float, sigma_m: Float) -> Posterior:
        """The estimate with the doubt that left-out faces show, off by ``off_m`` where ``sigma_m`` was expected.

        What other programs meet is foretold no better than they were. Faces that fit better by chance narrow nothing.
        :data:`OTHERWISE` of the variance of drives, play and friction stays.
        """
        P, k = self.covariance * max(1.0, float(np.mean((off_m / sigma_m) ** 2))), len(self.elements)
        P[3 + k : -3, 3 + k : -3] += OTHERWISE * self.before[3 + k : -3, 3 + k : -3]
        return replace(self, covariance=P)

    def names(self, cell: Cell) -> list[str]:
        """Names of the constants, in the order of their logarithms."""
        axes = () if cell.class_drives is None else cell.class_drives.play_axes
        forces = [f"{name} force" for name in FORCES] + [f"compliance of {name}" for name in self.elements]
        lost = [f"{what} of axis{axis + 1}" for what in ("play", "friction") for axis in axes]
        return [*forces, "yield of the drives", *lost]


def patterns_of(plan: Plan, cell: Cell, measured: MeasuredCoordinates) -> tuple[tuple[str, ...], Patterns]:
    """Names of the elements that bend, and what each constant does to the measured coordinates.

    Args:
        plan: Of the program that made the part, as the cell file predicts it.
    """
    row, R, chain = measured.row, cell.T_base_part[:3, :3], cell.chain
    w = _by_direction(plan, cell)
    turned = [np.concatenate([v[row, :3] @ R.T, v[row, 3:] @ R.T], axis=1) for v in w]
    bends = np.stack([shares(chain, plan.q[row], one)[..., :3] @ R for one in turned])  # (3, m, elements, 3)
    elements = measured.along(np.moveaxis(bends, 2, 1))
    size = np.sum(bends.sum(axis=0) ** 2, axis=(0, 2))
    bent = size > _SEEN * np.sum(bends.sum(axis=(0, 2)) ** 2)
    assumed = assumed_sigma(cell)  # these are written, too: nothing else in the file would give them
    seen = np.flatnonzero(bent | np.array([name in assumed for name in chain.names]))
    yields = np.stack([drives_yield(replace(plan, w_tcp_part=v), cell)[row] for v in w])
    offset = np.tile(np.eye(3)[:, None], (1, len(row), 1))
    predicted, yields, offset = (measured.along(d) for d in (plan.deviation_nominal_part[row], yields, offset))
    patterns = Patterns(predicted, elements[:, seen], yields, lost_by_factor(plan, cell, cell, measured), offset)
    return tuple(chain.names[i] for i in seen), patterns


def moved(plan: Plan, cell: Cell, measured: MeasuredCoordinates) -> Float:
    """Coordinates (m,) m that a cell makes in motion, the program as it is."""
    inputs = CompensationInputs(plan.path, plan.line, cell.stock(), setting_of(cell), plan.q)
    loaded = in_fine_stock(loaded_robot(inputs, undisturbed_cut(inputs, silent)))
    at_rest = np.zeros_like(plan.path.p_part_tcp)
    deviation = run(loaded.robot, loaded.inputs.stock, plan.q, at_rest, silent)[1]
    return measured.along(deviation[measured.row, :3])


def estimated(names: tuple[str, ...], patterns: Patterns, measured: MeasuredCoordinates, cell: Cell) -> Posterior:
    """The likeliest constants with their covariance."""
    P = _before(names, cell)
    bend = np.abs(patterns.elements_m.sum(axis=(0, 1)))
    common = STRUCTURE * bend + _LEAST_M
    C = (measured.face[:, None] == measured.face[None, :]) * np.outer(common, common)
    own = measured.sigma_m**2 + (LOCAL * bend) ** 2
    theta, weight, H = np.zeros(len(P)), np.ones(len(bend)), np.zeros((len(bend), len(P)))
    gain = np.zeros(H.T.shape)
    for _ in range(_STEPS):
        y, H = patterns.at(theta)
        S = H @ P @ H.T + C + np.diag(own / weight)
        gain = np.linalg.solve(S, H @ P).T
        step = gain @ (measured.off_m - y + H @ theta) - theta
        theta = theta + np.clip(step, -_LONGEST, _LONGEST)
        left = measured.off_m - patterns.at(theta)[0]
        weight = (FREEDOM + 1.0) / (FREEDOM + left**2 / (own + common**2))
    return Posterior(names, theta, P - gain @ H @ P, P, measured.off_m - patterns.at(theta)[0])


def left_out(
    names: tuple[str, ...], patterns: Patterns, measured: MeasuredCoordinates, cell: Cell
) -> tuple[Float, Float]:
    """Measured minus predicted coordinate of each face by the constants that all other faces give.

    Returns:
        (m,) m, and the standard deviation (m,) m that these constants leave it.
    """
    off, sigma = np.empty((2, len(measured.off_m)))
    for face in np.unique(measured.face).tolist():
        rest, own = np.flatnonzero(measured.face != face), np.flatnonzero(measured.face == face)
        fit, here = estimated(names, patterns.only(rest), measured.only(rest), cell), patterns.only(own)
        y, H = here.at(fit.value)
        bend = np.abs(here.elements_m.sum(axis=(0, 1)))
        variance = measured.sigma_m**2 + (LOCAL * bend) ** 2 + (STRUCTURE * bend + _LEAST_M) ** 2
        off[own] = measured.off_m[own] - y
        sigma[own] = np.sqrt(np.einsum("mp,pq,mq->m", H, fit.covariance, H) + variance)
    return off, sigma


def held(fit: Posterior, value: Float) -> Posterior:
    """The estimate with no constant farther from its value before, (p,), than a step may be: it is refined next."""
    return replace(fit, value=np.clip(fit.value, value - _LONGEST, value + _LONGEST))


def share_left(fit: Posterior, patterns: Patterns) -> tuple[float, float]:
    """Standard deviation of the deflection after, mean square over the places, over two others.

    Returns:
        Over that before; and over that before by the elements alone, each by itself: times this ratio, independent
        values of the elements leave the doubt that elements and forces leave together.
    """
    _, H = patterns.at(fit.value)
    k = len(fit.elements)
    constants = np.arange(3 + k)
    after, before = (
        np.trace(H[:, constants] @ M[np.ix_(constants, constants)] @ H[:, constants].T)
        for M in (fit.covariance, fit.before)
    )
    alone = float(np.sum(H[:, 3 : 3 + k] ** 2 @ np.diag(fit.before)[3 : 3 + k]))
    return float(np.sqrt(after / before)), float(np.sqrt(after / alone))


def lost_rad(fit: Posterior, cell: Cell) -> list[tuple[int, float, float]]:
    """Axes 0..5 that the class gave play, half of what each loses at a reversal, rad, and its standard deviation.

    The half dead band, and the twist that friction behind the gear holds.
    """
    given, chain = cell.class_drives, cell.planning_chain
    axes = [] if given is None else list(given.play_axes)
    band, limit, _ = arrays(chain)
    at_one = np.stack([band, chain.compliance[chain.torsion, 5] * limit.sum(axis=1)])[:, axes]
    angle = at_one * np.reshape(fit.factors.play, (2, -1))
    rows = 4 + len(fit.elements) + np.arange(angle.size).reshape(2, -1)
    variance = np.einsum("ai,abi,bi->i", angle, fit.covariance[rows[:, None], rows[None, :]], angle)
    return list(zip(axes, angle.sum(axis=0).tolist(), np.sqrt(variance).tolist(), strict=True))


def _by_direction(plan: Plan, cell: Cell) -> tuple[Float, Float, Float]:
    """(n, 6) N, N m, the mean wrench by tangential, radial and axial force; forces are linear in each."""
    setting, wrenches = setting_of(cell, part_may_be_held=True), []
    for factors in ((1.0, 1.0, 1.0), (1.0, 2.0, 1.0), (1.0, 1.0, 2.0)):
        changed = replace(setting, law=cell.force_law.scaled(factors))
        inputs = CompensationInputs(plan.path, plan.line, cell.stock(), changed, plan.q)
        wrenches.append(undisturbed_cut(inputs, silent).w_tcp_part)
    whole, more_radial, more_axial = wrenches
    return 3.0 * whole - more_radial - more_axial, more_radial - whole, more_axial - whole


def lost_by_factor(plan: Plan, cell: Cell, known: Cell, measured: MeasuredCoordinates) -> Float:
    """(i, m) m, what a factor on play, then on friction behind the gear, of each axis adds to the coordinates.

    Args:
        plan: Of the program that made the part.
        cell: Its class gave the play.
        known: The cell that has it.
    """
    given, path, setting = cell.class_drives, plan.path, setting_of(known)
    if given is None or not given.play_axes:
        return np.zeros((0, len(measured.row)))
    relative, touched, mode = setting.relative_motion(path), touched_points(setting), at_largest_force(known, plan).mode
    play = setting.chain.play or ()
    more = [
        tuple(_more(one, friction=friction) if i == axis else one for i, one in enumerate(play))
        for friction in (False, True)
        for axis in given.play_axes
    ]
    y = []
    for one in (play, *more):
        chain = replace(setting.chain, servo=None, play=one)
        off = play_deviation(chain, relative, path.p_part_tcp, plan.q, plan.w_tcp_part, path.time_s, touched, mode)
        y.append(measured.along(off[measured.row]))
    out: Float = (np.array(y[1:]) - y[0]) / _CHANGE
    return out


def _more(play: Play | None, *, friction: bool) -> Play:
    """Play with more of the dead band, or of all friction."""
    assert play is not None
    more = 1.0 + _CHANGE
    if friction:
        return replace(play, friction_nm=tuple(more * torque for torque in play.friction_nm))
    return replace(play, half_band_rad=more * play.half_band_rad)


def _before(names: tuple[str, ...], cell: Cell) -> Float:
    """(p, p) covariance of what is known of the constants before."""
    known = any(entry.recipe in ("cutting", "first_cut") for entry in cell.tables.identified)
    force = IDENTIFIED if known else np.hypot(HANDBOOK, 0.5 * WORN)
    relative = assumed_sigma(cell) | identified_sigma(cell)
    soft = np.array([relative.get(name, STATED) for name in names])
    given = cell.class_drives
    drive = given.prior.yield_log_sigma if given is not None and given.servo_axes else 0.0
    lost = 0 if given is None else 2 * len(given.play_axes)
    blocks: list[Any] = [
        np.full((3, 3), force**2)
        + np.diag(np.square([IDENTIFIED, DIRECTION, DIRECTION]) if not known else np.full(3, IDENTIFIED**2)),
        np.outer(soft, soft) * (COMMON + (1.0 - COMMON) * np.eye(len(soft))),
        drive**2,
        (np.log(PLAY_FACTOR) / _NORMAL) ** 2 * np.eye(lost),
        OFFSET_M**2 * np.eye(3),
    ]
    out: Float = scipy.linalg.block_diag(*blocks)
    return out


_BELIEVED: Final = 3.0
"""Standard deviations of what was known before beyond which a constant is doubted."""


def doubts(fit: Posterior, places: MeasuredCoordinates, predicted_m: Float, cell: Cell) -> list[str]:
    """Warnings about the readings themselves: axes mirrored against the prediction, constants nobody expects."""
    out = []
    for axis in range(3):
        on = places.axis == axis
        if float(places.off_m[on] @ predicted_m[on]) < 0.0:
            out.append(
                f"readings along {'xyz'[axis]} lie on the other side of nominal than the cell file predicts: "
                "look at the sign and the axis of the measured part frame"
            )
    far = np.flatnonzero(np.abs(fit.value[-3:]) > _BELIEVED * OFFSET_M)
    if len(far):
        along = ", ".join(f"{'xyz'[k]} {fit.value[-3:][k] / MM:+.2f} mm" for k in far)
        out.append(f"all readings are off by {along}: look at the part frame and the zero of the probe")
    for name, value, variance in zip(fit.names(cell), fit.value, np.diag(fit.before), strict=False):
        if value**2 > _BELIEVED**2 * variance:
            out.append(
                f"{name} is {np.exp(value):.2f} times that of the cell file, beyond {_BELIEVED:g} standard deviations "
                f"({100.0 * np.sqrt(variance):.0f} % each) of what was known: look at the unit of the readings, tool, "
                "material and feed"
            )
    return out
