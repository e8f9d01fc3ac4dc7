"""Frames of tracker and target from robot poses with gross errors among them: the best of many small samples, refined.

Each sample is fitted as :mod:`.hand_eye` fits all poses; the one with the least median error over all poses decides
which measurements agree, and these are fitted again (least median of squares). It survives about 40 % of gross errors.

Source: P. J. Rousseeuw, J. American Statistical Association 79 (1984) 871.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, batches
from counterflex.core.errors import InputError
from counterflex.identify.geometry import hand_eye

TRIALS: Final = 200
_SAMPLE = 5
_POINT_SAMPLE = 8
_INLIER = 6.0
_AT_ONCE = 20_000
"""Predictions of samples that are computed together."""


@dataclass(frozen=True, eq=False)
class HandEye:
    """Frames found."""

    T_base_tracker: Float  # (4, 4)
    T_tcp_target: Float  # (4, 4); its rotation is identity where only points were measured
    error_m: Float  # (m,) distance of each measurement from its prediction, rotations counted at LENGTH_M
    good: Bool  # (m,) measurements that are no gross errors
    # (k, 3) unit vectors in the axes of the TCP along which the poses do not tell the target's offset
    open: Float = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def median_m(self) -> float:
        """Median of the errors."""
        return float(np.median(self.error_m))


def robust_of_poses(
    Ts_base_tcp: Float, Ts_tracker_target: Float, *, seed: int = 0, trials: int = TRIALS, partly: bool = False
) -> HandEye:
    """:func:`of_poses` that survives up to about 40 % of gross errors: the best of many small samples, then refined.

    ``Ts_base_tcp``: (m, 4, 4) robot poses, m. ``Ts_tracker_target``: (m, 4, 4) measured poses. ``trials``: Samples; 0
    is plain least squares, then refined. Raises InputError: as :func:`of_poses`.
    """
    best = _best(
        len(Ts_base_tcp),
        _SAMPLE,
        lambda rows: hand_eye.of_poses(Ts_base_tcp[rows], Ts_tracker_target[rows], partly=partly),
        lambda rows: hand_eye.quick_of_samples(Ts_base_tcp[rows], Ts_tracker_target[rows], partly),
        lambda rows, R: hand_eye.refined(Ts_base_tcp[rows], Ts_tracker_target[rows], R),
        lambda Z, X: hand_eye.error_of(Ts_base_tcp, Ts_tracker_target, Z, X),
        seed,
        trials,
    )
    return replace(best, open=hand_eye.open_offsets(Ts_base_tcp))


def robust_tracker(Ts_base_tcp: Float, measured: Float, T_tcp_target: Float, *, trials: int = TRIALS) -> HandEye:
    """:func:`tracker_of_poses` that survives gross errors: the six numbers of the tracker only. Arguments as there."""
    return _best(
        len(Ts_base_tcp),
        _SAMPLE,
        lambda rows: (hand_eye.tracker_of_poses(Ts_base_tcp[rows], measured[rows], T_tcp_target), T_tcp_target),
        None,
        None,
        lambda Z, X: hand_eye.error_of(Ts_base_tcp, measured, Z, X),
        0,
        trials,
    )


def robust_target(Ts_base_tcp: Float, measured: Float, T_base_tracker: Float, *, trials: int = TRIALS) -> HandEye:
    """:func:`target_of_poses` that survives gross errors. Arguments as there."""
    return _best(
        len(Ts_base_tcp),
        _SAMPLE,
        lambda rows: (T_base_tracker, hand_eye.target_of_poses(Ts_base_tcp[rows], measured[rows], T_base_tracker)),
        None,
        None,
        lambda Z, X: hand_eye.error_of(Ts_base_tcp, measured, Z, X),
        0,
        trials,
    )


def robust_of_points(
    Ts_base_tcp: Float, p_tracker_target: Float, *, seed: int = 0, trials: int = TRIALS, partly: bool = False
) -> HandEye:
    """:func:`of_points` that survives gross errors. Arguments and errors as there."""
    best = _best(
        len(Ts_base_tcp),
        _POINT_SAMPLE,
        lambda rows: hand_eye.of_points(Ts_base_tcp[rows], p_tracker_target[rows], partly=partly),
        None,
        lambda rows, R: hand_eye.refined(Ts_base_tcp[rows], p_tracker_target[rows], R),
        lambda Z, X: hand_eye.error_of(Ts_base_tcp, p_tracker_target, Z, X),
        seed,
        trials,
    )
    return replace(best, open=hand_eye.open_offsets(Ts_base_tcp))


def _best(
    count: int,
    sample: int,
    fit: Callable[[Int | Bool], tuple[Float, Float]],
    quick: Callable[[Int], tuple[Float, Float]] | None,
    again: Callable[[Bool, Float], tuple[Float, Float]] | None,
    error: Callable[[Float, Float], Float],
    seed: int,
    trials: int,
) -> HandEye:
    """Least median of errors over random samples, fitted quickly, then least squares over what agrees with the best."""
    # `quick` takes the rows (t, sample) of many samples, all others the rows of one.
    Z, X = fit(np.ones(count, dtype=np.bool_))
    best = error(Z, X)
    rng = np.random.default_rng(seed)
    drawn = [rng.choice(count, sample, replace=False) for _ in range(trials if count > sample else 0)]
    samples: Int = np.array(drawn, dtype=np.int64).reshape(-1, sample)
    for some in batches(len(samples), 1 if quick is None else max(1, _AT_ONCE // count)):
        try:
            if quick is None:
                one = fit(samples[some.start])
                Zs, Xs = one[0][None], one[1][None]
            else:
                Zs, Xs = quick(samples[some])
        except InputError:  # a sample that does not turn enough says nothing
            continue
        if len(Zs) == 0:
            continue
        errors = np.array([error(Zs[0], Xs[0])]) if quick is None else error(Zs[:, None], Xs[:, None])
        medians = np.median(errors, axis=1)
        k = int(np.argmin(np.where(np.isnan(medians), np.inf, medians)))
        if medians[k] < np.median(best):
            Z, X, best = Zs[k], Xs[k], errors[k]
    for _ in range(5):
        # Scale from the median of the errors themselves: what an uncalibrated arm is off by is not known beforehand.
        good = best <= _INLIER * max(float(np.median(best)), 1e-12)
        try:
            trial = fit(good) if again is None else again(good, Z[:3, :3])
        except InputError:
            break
        errors = error(*trial)
        # Least squares over the agreeing rows may leave them again, when those next to the limit pull together.
        if np.median(errors) > 1.2 * np.median(best):
            break
        (Z, X), best = trial, errors
    return HandEye(Z, X, best, best <= _INLIER * max(float(np.median(best)), 1e-12))
