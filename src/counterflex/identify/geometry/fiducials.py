"""Fiducial points, known in the robot base and measured by the tracker: residuals, and checks before any fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import INCH, MM
from counterflex.geometry import pose, rotation
from counterflex.geometry.pose import register
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.geometry.pose_residuals import PlacedFrame

_MIRROR = 0.3
_CLEAR_SIGMAS = 5.0
_SCALES: Final = {
    1.0 / MM: "mm were read as m",
    MM: "m were read as mm",
    INCH: "m were read as inches",
    1.0 / INCH: "inches were read as m",
    INCH / MM: "inches were read as mm",
    MM / INCH: "mm were read as inches",
}


@dataclass(frozen=True, eq=False)
class FiducialResiduals:
    """``p_base - T_base_tracker p_tracker`` of fiducials, in base axes."""

    name: str
    group: Int  # (m,) id of each row's fiducial
    sigma: Float  # (m, 3) m
    tracker: PlacedFrame
    p_base: Float  # (m, 3) m, known
    p_tracker: Float  # (m, 3) m, measured
    components: tuple[str, ...] = ("x m", "y m", "z m")

    def evaluate(self, x: Float) -> Float:
        """(m, 3) differences over sigma."""
        out: Float = (self.p_base - pose.transform(self.tracker.at(x), self.p_tracker)) / self.sigma
        return out

    def jacobian(self, x: Float) -> Float:
        """(m, 3, p) derivative of :meth:`evaluate`."""
        out = np.zeros((len(self.group), 3, len(x)))
        T = self.tracker.at(x)
        R0, turned = self.tracker.T0[:3, :3], self.tracker.turned(x)
        arm = self.p_tracker @ T[:3, :3].T
        for c, place in enumerate(self.tracker.index):
            if place >= 0 and c < 3:
                out[:, :, place] = -R0[:, c]
            elif place >= 0:
                out[:, :, place] = -np.cross(R0 @ turned[:, c - 3], arm)
        out /= self.sigma[:, :, None]
        return out

    def subset(self, rows: Bool) -> FiducialResiduals:
        """The marked rows only."""
        return replace(
            self,
            group=self.group[rows],
            sigma=self.sigma[rows],
            p_base=self.p_base[rows],
            p_tracker=self.p_tracker[rows],
        )


def fiducial_sigma(d: Dataset) -> Float:
    """(m, 3) m, standard deviation of known minus measured place of a dataset of fiducials."""
    measured = d.channel("p_tracker_fiducial").need_sigma()
    known = d.channel("p_base_fiducial").sigma
    # The tracker's axes are not the base's: its largest component stands for all of them.
    spread = np.broadcast_to(np.max(measured, axis=1, keepdims=True), measured.shape)
    return spread.copy() if known is None else np.sqrt(spread**2 + known**2)


def check_sense(p_base: Float, p_tracker: Float, sigma_m: float, where: str) -> None:
    """Refuse points whose lengths or handedness contradict each other.

    ``p_base``: (m, 3) m. ``p_tracker``: (m, 3) m, the same points. Raises InputError: lengths differ by a unit's
    factor, or a mirror image fits far better than the points themselves.
    """
    ratio = _scale(p_base, p_tracker)
    for factor, words in _SCALES.items():
        if abs(ratio / factor - 1.0) < 0.03:
            raise InputError(
                "distances between the points differ by the factor of a unit",
                where=where,
                value=f"tracker / base = {ratio:.5g}: {words}",
                hint="Correct the units in the manifest",
            )
    if len(p_base) < 4:
        return  # three points lie in a plane, and a plane looks the same in a mirror
    best, turned = _rms(p_base, p_tracker), _rms(p_base, p_tracker * np.array([1.0, 1.0, -1.0]))
    # Points near one plane look alike in the mirror: the mirror image must be clearly better, and the points clearly
    # off.
    if turned < _MIRROR * best and best > _CLEAR_SIGMAS * sigma_m:
        raise InputError(
            "a mirror image fits the points far better: a frame is left-handed, two columns are swapped, or the sign "
            "of one is reversed",
            where=where,
            value=f"{best / MM:.3g} mm, mirrored {turned / MM:.3g} mm",
            hint="Correct columns or signs in the manifest: frames must be right-handed",
        )


def robust_register(p_base: Float, p_tracker: Float, *, seed: int = 0) -> Float:
    """T_base_tracker (4, 4) by the triple of points whose registration has the least median error, then refined.

    ``p_base``: (m, 3) m. ``p_tracker``: (m, 3) m. Raises InputError: as :func:`counterflex.geometry.pose.register`.
    """
    best, residuals = register(p_base, p_tracker)
    errors = np.linalg.norm(residuals, axis=1)
    rng = np.random.default_rng(seed)
    for _ in range(200 if len(p_base) > 4 else 0):
        rows = rng.choice(len(p_base), 3, replace=False)
        try:
            T, _ = register(p_base[rows], p_tracker[rows])
        except InputError:
            continue
        off = np.linalg.norm(p_base - pose.transform(T, p_tracker), axis=1)
        if _inner(off) < _inner(errors):
            best, errors = T, off
    # Refitted to all that agree: three points chosen for their median carry the noise of three points.
    good = errors <= 6.0 * max(_inner(errors), 1e-9)
    if np.sum(good) >= 3:
        try:
            best, _ = register(p_base[good], p_tracker[good])
        except InputError:
            return best
    return best


def displacement_between(T0: Float, T: Float) -> Float:
    """(6,) displacement d with ``T = T0 D(d)``, m and rad."""
    step = pose.inverse(T0) @ T
    return np.concatenate([step[:3, 3], rotation.log(step[:3, :3])])


def _inner(errors: Float) -> float:
    """Size that 60 % of the errors keep: more than half of the points must agree beyond the three that were used."""
    return float(np.quantile(errors, 0.6))


def _scale(p_base: Float, p_tracker: Float) -> float:
    """Median ratio of the distances between points, tracker by base."""
    i, j = np.triu_indices(len(p_base), 1)
    a = np.linalg.norm(p_base[i] - p_base[j], axis=1)
    b = np.linalg.norm(p_tracker[i] - p_tracker[j], axis=1)
    far = a > 0.1 * np.max(a)
    return float(np.median(b[far] / a[far]))


def _rms(a: Float, b: Float) -> float:
    T = robust_register(a, b)
    return float(np.median(np.linalg.norm(a - pose.transform(T, b), axis=1)))
