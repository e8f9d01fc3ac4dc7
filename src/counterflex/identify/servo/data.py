"""Load steps as a dataset has them, checked and cut into steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Bool, Float, as_float, as_positive, rows_of_each
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import MS, URAD
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.model import CellModel
from counterflex.identify.design.pose_candidates import measurable
from counterflex.identify.recipe import Proposal
from counterflex.identify.servo.residuals import Release
from counterflex.robot.elasticity.chain import jacobian
from counterflex.robot.model.description import Servo

FORCE_N: Final = 500.0
CANDIDATES: Final = 60
USUAL_NM_S: Final = (1.5e5, 1.8e5, 1.0e5, 1.0e4, 1.1e4, 4.8e3)
"""K of a large robot, where the cell file has none, for the choice only."""
_ENCODER_RAD = 0.5 * URAD
_SEEN = 40.0
_CORRELATED = 20.0


def propose(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Poses and cable forces of ``count`` load steps.

    Chosen one after another so that the sum over the axes of the logarithm of the squared motion grows most.

    ``count``: Load steps; at least 3. ``settings``: ``seed`` of the candidates, ``force_n``.

    Returns:
        ``q1_rad`` ... ``q6_rad``, ``fx_n fy_n fz_n`` (what the cable pulls the tool with, base axes); expected
        standard deviations of K of each axis (without the error of the torque's scale).

    Raises:
        InputError: Fewer than 3 load steps.
        ReachError: Hardly any pose can be measured.
    """
    if count < 3:
        raise InputError("load steps to propose", value=count, limit=">= 3")
    force = float(settings.get("force_n", FORCE_N))
    rng = np.random.default_rng(int(settings.get("seed", 0)))
    q = measurable(cell, CANDIDATES, rng, around_part=0.7)
    way = rng.standard_normal((len(q), 8, 3))
    way[:, :, 2] = -np.abs(way[:, :, 2])  # cables pull down or sideways
    way *= force / np.linalg.norm(way, axis=2, keepdims=True)
    torque = np.einsum("nca,nwc->nwa", jacobian(cell.chain, q)[:, :3, :], way)
    swing = 0.4 * torque / stiffness(cell) / _ENCODER_RAD
    total = np.full(6, 1.0)
    picked: list[tuple[int, int]] = []
    for _ in range(count):
        gain = np.sum(np.log(total + swing**2), axis=2)
        for pose, turn in picked:
            gain[pose, turn] = -np.inf
        best = np.unravel_index(int(np.argmax(gain)), gain.shape)
        picked.append((int(best[0]), int(best[1])))
        total = total + swing[picked[-1]] ** 2
    poses, turns = np.array([p for p, _ in picked]), np.array([t for _, t in picked])
    columns = {f"q{i + 1}_rad": q[poses, i] for i in range(6)}
    columns |= {f"f{a}_n": way[poses, turns, i] for i, a in enumerate("xyz")}
    gains = _gains(cell)
    expected = {f"axis{a + 1}.speed_gain": float(gains[a] * _CORRELATED / np.sqrt(_SEEN * total[a])) for a in range(6)}
    return Proposal(
        "servo",
        "servo_steps",
        columns,
        expected,
        remarks=(
            f"hang {force:.0f} N on a cable in the given direction, let the arm rest, start the trace of the "
            f"controller (command, motor angle and torque of all axes), release the cable, record one more second",
        ),
        units=dict.fromkeys(expected, "N m s/rad"),
    )


def stiffness(cell: CellModel) -> Float:
    """(6,) N m/rad: ``K Kv`` of the axes."""
    known: tuple[Servo | None, ...] = cell.robot.servo or (None,) * 6
    rate = np.array([20.0 if s is None else s.position_gain_per_s for s in known])
    out: Float = _gains(cell) * rate
    return out


def _gains(cell: CellModel) -> Float:
    known: tuple[Servo | None, ...] = cell.robot.servo or (None,) * 6
    return np.array([USUAL_NM_S[a] if s is None else s.speed_gain_nm_s for a, s in enumerate(known)])


# Lowest mode of a structure that rings down, from samples of any of its motions.
# Free motion is a sum of damped exponentials ``z^n`` with poles z shared by all channels; the poles are the eigenvalues
# of the shift that carries one window of samples onto the next (matrix pencil, signal space from a singular value
# decomposition). A mode has ``ln z / h = -zeta w +- i w sqrt(1 - zeta^2)``.
#
# Source: Hua and Sarkar 1990.

ORDER: Final = 10
SHARE: Final = 0.1
"""Amplitude against the strongest mode below which a mode does not count."""
_BAND_HZ = (1.0, 60.0)


@dataclass(frozen=True)
class RingingMode:
    """A damped oscillation."""

    frequency_hz: float  # undamped natural frequency
    damping: float  # zeta, 1
    amplitude: float  # root of the sum of squared amplitudes over the channels, unit of the signals


def lowest_mode(signals: Float, step_s: float, *, order: int = ORDER) -> RingingMode:
    """The lowest mode that rings noticeably.

    ``signals``: (n, k) at even steps, from just after the release; like units. ``step_s``: s. Returns of the modes with
    at least :data:`SHARE` of the strongest one's amplitude the one of lowest frequency. Raises InputError: too few
    samples, or nothing rings.
    """
    y = as_float("signals", signals, (None, None))
    h = as_positive("step_s", step_s)
    n = len(y)
    if n < 4 * order:
        raise InputError("a record too short to determine a mode", value=n, limit=f">= {4 * order} samples")
    y = y - y[-max(n // 10, 1) :].mean(axis=0)
    window = n // 3
    H = np.concatenate([np.lib.stride_tricks.sliding_window_view(column, window).T for column in y.T], axis=1)
    u = np.linalg.svd(H @ H.T)[0][:, :order]
    z = np.linalg.eigvals(np.linalg.lstsq(u[:-1], u[1:], rcond=None)[0])
    z = z[(np.abs(z) < 1.02) & (np.abs(z) > 0.1)]
    V = z[None, :] ** np.arange(n)[:, None]
    amplitudes = np.linalg.norm(np.linalg.lstsq(V, y.astype(np.complex128), rcond=None)[0], axis=1)
    rate = np.log(z) / h
    modes = [
        RingingMode(float(abs(r)) / (2.0 * np.pi), float(-r.real / abs(r)), 2.0 * float(a))
        for r, a in zip(rate, amplitudes, strict=True)
        if r.imag > 0.0 and _BAND_HZ[0] < abs(r) / (2.0 * np.pi) < _BAND_HZ[1] and 0.0 < -r.real / abs(r) < 0.6
    ]
    if not modes:
        raise InputError("nothing rings in this record", limit=f"{_BAND_HZ[0]:g} .. {_BAND_HZ[1]:g} Hz")
    strongest = max(mode.amplitude for mode in modes)
    return min((mode for mode in modes if mode.amplitude >= SHARE * strongest), key=lambda mode: mode.frequency_hz)


FEWEST: Final = 60
"""Rows of a load step."""
_UNEVEN = 0.05
_MOST_RAD = 50e-3
_HANGS = 0.05


@dataclass(frozen=True, eq=False)
class LoadStep:
    """One release of a load."""

    run: int
    step_s: float
    time_s: Float  # (n,) s from the first row
    released: Bool  # (n,) the load is off
    error: Float  # (n, 6) rad motor minus command, less the mean before
    sigma: Float  # (n, 6) rad
    torque: Float  # (n, 6) N m, less the mean before
    tip: Float | None  # (n, 3) m position seen by a tracker, or None
    where: str

    def of_axis(self, axis: int) -> Release:
        """One axis of it."""
        return Release(self.run, self.step_s, self.torque[:, axis], self.error[:, axis], self.sigma[:, axis])


def load_steps(data: Sequence[Dataset], first_run: int = 0) -> list[LoadStep]:
    """All load steps of some datasets.

    ``data``: Of kind ``servo_steps``: ``time_s``, ``q_command``, ``q_motor``, ``tau_motor`` of six axes and
    ``w_tcp_base`` or ``f_tcp_base`` (what the cable pulls with, zero once it is cut); perhaps ``p_tracker_target``.
    Rows of one group are one step.

    Raises:
        FileFormatError: Channels or standard deviations are missing, values are not numbers, uneven time.
        InputError: Too short, no release, or units that cannot be.
    """
    out: list[LoadStep] = []
    for dataset in data:
        load = "w_tcp_base" if dataset.has("w_tcp_base") else "f_tcp_base"
        names = ["time_s", "q_command", "q_motor", "tau_motor", load]
        names += ["p_tracker_target"] if dataset.has("p_tracker_target") else []
        for name in names:
            values = dataset.finite(name)
            if name.startswith(("q_", "tau_")) and values.shape[1] != 6:
                raise InputError(
                    f"load steps need '{name}' of all six axes", where=dataset.where, value=values.shape[1]
                )
        for _, rows in rows_of_each(dataset.group):
            out.append(_step(dataset, rows, load, first_run + len(out)))
    return out


def _step(dataset: Dataset, rows: np.ndarray, load: str, run: int) -> LoadStep:
    where = dataset.place(int(rows[0]))
    if len(rows) < FEWEST:
        raise InputError("a load step has too few rows", where=where, value=len(rows), limit=f">= {FEWEST}")
    time = dataset.values("time_s")[rows, 0]
    step = np.diff(time)
    h = float(np.median(step))
    if h <= 0.0 or float(np.max(np.abs(step - h))) > _UNEVEN * h:
        worst = int(np.argmax(np.abs(step - h)))
        raise FileFormatError(
            "rows of a load step must come at even times",
            where=dataset.place(int(rows[worst + 1])),
            value=f"{step[worst] / MS:g} ms after the row before",
            limit=f"{h / MS:g} ms",
            hint="Record with the controller's trace; rows that are missing or repeated make the loop look faster",
        )
    force = np.linalg.norm(dataset.values(load)[rows][:, :3], axis=1)
    released = force < _HANGS * float(force.max())
    if force.max() == 0.0 or released.all() or not released.any() or released[0]:
        raise InputError(
            "no load is released in these rows",
            where=where,
            value=f"{force[0]:.3g} N at first, {force[-1]:.3g} N at last",
            hint="A load step begins with the load hanging and ends with it cut off",
        )
    first = int(np.argmax(released))
    if first < 5:
        raise InputError("too few rows before the release", where=where, value=first, limit=">= 5")
    before = slice(0, first - 1)
    motor, command = dataset.values("q_motor")[rows], dataset.values("q_command")[rows]
    error = motor - command
    if float(np.max(np.abs(error))) > _MOST_RAD:
        raise InputError(
            "the motors are far from their commands: one of q_motor and q_command has a wrong unit or order",
            where=where,
            value=f"{np.max(np.abs(error)):.3g} rad",
            limit=f"<= {_MOST_RAD:g} rad",
        )
    error = error - error[before].mean(axis=0)
    torque = dataset.values("tau_motor")[rows]
    torque = torque - torque[before].mean(axis=0)
    torque[0] = 0.0
    sigma = dataset.channel("q_motor").need_sigma()[rows]
    tip = dataset.values("p_tracker_target")[rows] if dataset.has("p_tracker_target") else None
    return LoadStep(run, h, time - time[0], released, error, np.maximum(sigma, 0.1 * URAD), torque, tip, where)
