"""Pairs of channels of a record, one following the other, whose delay is looked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MRAD, MS, UM, URAD
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.model import CellModel
from counterflex.identify.timing.delay import Extra, Pair
from counterflex.identify.timing.stamped import Stamped, stamped
from counterflex.robot.elasticity.chain import ElasticChain

DIRECTION_RAD_S: Final = 2.0 * MRAD
"""Speed at which the sign of the motion is taken as turned round: ``tanh(v / this)``."""
_LOADED = 1e-12
_MOVES_RAD = 1.0 * MRAD


@dataclass(frozen=True)
class Following:
    """One kind of pair."""

    name: str  # of the pair and of its table in the cell file, `[timing.<name>]`
    reference: tuple[str, ...]  # channels that may lead, the best first
    answer: str  # channel that follows
    mixing: Literal["own", "matrix"]
    derivative: int = 0
    components: int = 0  # how many components of the answer take part; 0 is all
    inertia: bool = False
    lag: bool = False  # a lag large enough to be told from a dead time is to be expected
    requested: bool = False  # only looked for when it is asked for by name


FOLLOWING: Final = (
    Following("link_encoder", ("q_motor",), "q_link", "own"),
    Following("drive", ("q_command",), "q_motor", "own", inertia=True),
    Following("correction", ("d_correction",), "p_base_tcp", "matrix", lag=True),
    Following("correction", ("d_correction",), "p_tracker_target", "matrix", lag=True),
    Following("feedback", ("p_base_command",), "p_base_tcp", "matrix", inertia=True),
    Following("tracker", ("p_base_tcp", "p_base_command", "q_motor", "q"), "p_tracker_target", "matrix", inertia=True),
    Following("force", ("q_motor", "q"), "w_sensor", "matrix", components=3, requested=True),
)
"""In the order in which they are looked for; of several with one name the first that the record has."""


def pairs(cell: CellModel, dataset: Dataset, requested: str = "auto") -> tuple[Pair, ...]:
    """The pairs of a record.

    Args:
        cell: What is known before: compliance of the axes, ``[timing]``.
        dataset: Of kind ``record``.
        requested: ``auto``, or the names of pairs, separated by commas.

    Returns:
        At least one pair.

    Raises:
        InputError: The record has no two channels that follow each other, or not those that are expected.
    """
    names = _named(requested)
    by_name: dict[str, Pair] = {}
    for kind in FOLLOWING:
        expected = not kind.requested if names is None else kind.name in names
        lead = next((name for name in kind.reference if dataset.has(name)), None)
        if expected and kind.name not in by_name and lead is not None and dataset.has(kind.answer):
            by_name[kind.name] = _pair(cell, dataset, kind, lead)
    missing = [name for name in names or () if name not in by_name]
    if not by_name:
        raise _none("the record has no channels that follow each other", dataset, missing)
    if missing:
        raise _none("the record has no such pair", dataset, missing)
    return tuple(by_name.values())


def _none(what: str, dataset: Dataset, missing: Sequence[str]) -> InputError:
    return InputError(
        what,
        where=dataset.where,
        value=", ".join(missing) or ", ".join(dataset.channels),
        limit="; ".join(f"{f.answer} after {' or '.join(f.reference)}" for f in FOLLOWING),
    )


def _named(requested: str) -> list[str] | None:
    if requested == "auto":
        return None
    names = [part.strip() for part in requested.split(",") if part.strip()]
    known = sorted({f.name for f in FOLLOWING})
    for name in names:
        if name not in known:
            raise InputError("there is no such pair of channels", value=name, limit=", ".join(known))
    return names


def axes_of(dataset: Dataset, count: int) -> tuple[int, ...]:
    """Axes 0..5 that the components of the joint channels belong to.

    Raises InputError: the setting ``driven_axes`` does not fit the channel.
    """
    numbers = dataset.settings.get("driven_axes", list(range(1, count + 1)))
    axes = tuple(int(a) - 1 for a in (numbers if isinstance(numbers, list | tuple) else [numbers]))
    if len(axes) != count or any(not 0 <= a < 6 for a in axes) or len(set(axes)) != count:
        raise InputError(
            "settings.driven_axes does not fit the joint channels",
            where=dataset.where,
            value=str(numbers),
            limit=f"{count} different numbers of 1..6",
        )
    return axes


def torsion_compliance(chain: ElasticChain) -> Float:
    """(6,) rad/(N m) compliance of the axes about themselves."""
    out: Float = chain.compliance[chain.torsion, 5]
    return out


def gear_torque(dataset: Dataset, motor: Stamped) -> Float | None:
    """Torque (n, m) N m that the motors give into the gears, less what turns their own inertia; None if not measured.

    ``tau = i tau_motor - J d2q/dt2`` with the settings ``gear_ratio`` i (1 if not stated) and ``rotor_inertia_kg_m2`` J
    (seen on the link side; 0 if not stated).
    """
    if not dataset.has("tau_motor"):
        return None
    tau = stamped(dataset, "tau_motor")
    if tau.values.shape != motor.values.shape:
        raise InputError(
            "tau_motor and q_motor must have the same axes",
            where=dataset.where,
            value=tau.values.shape[1],
            limit=motor.values.shape[1],
        )
    ratio, inertia = _per_axis(dataset, "gear_ratio", 1.0, motor), _per_axis(dataset, "rotor_inertia_kg_m2", 0.0, motor)
    speed = np.gradient(motor.values, motor.time_s, axis=0)
    out: Float = ratio * tau.values - inertia * np.gradient(speed, motor.time_s, axis=0)
    return out


def _per_axis(dataset: Dataset, key: str, default: float, motor: Stamped) -> Float:
    values = np.asarray(dataset.settings.get(key, default), dtype=np.float64)
    if values.ndim and values.shape != (motor.values.shape[1],):
        raise InputError(
            f"settings.{key} needs one number, or one for each axis of q_motor",
            where=dataset.where,
            value=values.tolist(),
        )
    return values


def direction(motor: Stamped) -> Float:
    """Smoothed sign of the speed (n, m): ``tanh(v / v_0)`` with v_0 = :data:`DIRECTION_RAD_S`."""
    out: Float = np.tanh(scipy.interpolate.CubicSpline(motor.time_s, motor.values)(motor.time_s, 1) / DIRECTION_RAD_S)
    return out


def _pair(cell: CellModel, dataset: Dataset, kind: Following, lead: str) -> Pair:
    reference, answer = stamped(dataset, lead), stamped(dataset, kind.answer)
    if kind.components:
        answer = Stamped(
            answer.name,
            answer.time_s,
            answer.values[:, : kind.components],
            answer.sigma[:, : kind.components],
            answer.clock,
            answer.remarks,
            answer.where,
        )
    m = answer.values.shape[1]
    extras: tuple[Extra, ...] = ()
    joints = kind.answer in ("q_link", "q_motor")
    labels = tuple("xyz"[:m]) if not joints else tuple(str(a + 1) for a in axes_of(dataset, m))
    if joints and reference.values.shape[1] != m:
        raise InputError(
            f"{lead} and {kind.answer} must have the same axes",
            where=dataset.where,
            value=m,
            limit=reference.values.shape[1],
        )
    if kind.name == "link_encoder":
        axes = axes_of(dataset, m)
        torque = gear_torque(dataset, reference)
        sign = direction(reference)
        if torque is not None:
            soft = torsion_compliance(cell.chain)[list(axes)]
            extras = (Extra("compliance", "rad/(N m)", -torque, soft, max(float(np.max(soft)), _LOADED)),)
        extras = (*extras, Extra("dry", "rad", -sign, np.zeros(m), 200.0 * URAD))
    if kind.answer == "p_tracker_target" and dataset.has("q_motor") and kind.name == "tracker":
        motor = stamped(dataset, "q_motor")
        sign = _at(motor, direction(motor), reference.time_s)
        moving = np.flatnonzero(np.ptp(motor.values, axis=0) > _MOVES_RAD)
        extras = tuple(
            Extra(f"dry{a + 1}", "m", np.repeat(sign[:, a : a + 1], m, axis=1), np.zeros(m), 200.0 * UM) for a in moving
        )
    unit = "rad" if joints else ("N" if kind.answer == "w_sensor" else "m")
    return Pair(
        name=kind.name,
        reference=reference,
        answer=answer,
        labels=labels,
        components=tuple(f"{kind.answer} {label} {unit}" for label in labels),
        mixing=kind.mixing,
        each=kind.name == "link_encoder",
        derivative=kind.derivative,
        inertia=kind.inertia,
        extras=extras,
        delay_s=_known(cell, kind.name),
        lag=kind.lag,
    )


def _at(stamped_signal: Stamped, values: Float, time_s: Float) -> Float:
    """A signal (n, k) at other stamps of the same clock."""
    return np.stack([np.interp(time_s, stamped_signal.time_s, column) for column in values.T], axis=1)


def _known(cell: CellModel, name: str) -> float:
    """Dead time that the cell file has for a pair, s; 0 where it has none."""
    table = dict(cell.tables.get("timing") or {}).get(name) or {}
    dead_times = dict(table).get("dead_time_ms") or (0.0,)
    return float(np.mean(dead_times)) * MS
