"""Protocols of force sensors by name: what ``[sensor] protocol`` may say.

Another package adds one with an entry point of the group ``counterflex.force_sensors`` (docs/extend.md). It brings a
receiver of samples; mean, saturation, frozen readings and everything that is no six finite numbers are judged here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import CounterflexError, InputError, OutputError
from counterflex.core.registry import Registry
from counterflex.protocols.force.source import LARGEST, ForceSource

MOST_SAMPLES: Final = 512
"""Samples of one drain that are kept one by one; later ones still enter the mean."""
SATURATED: Final = 0.95
"""Share of the range at which a reading is not believed any more."""
FROZEN: Final = 25
"""Samples with the same six numbers in a row that no living sensor sends."""


class Receiver(Protocol):
    """A receiver that a protocol of another package opens."""

    def receive(self) -> Float:
        """(k, 6) N, N m: the samples that have come since the last call, oldest first, k >= 0; must not wait."""

    def close(self) -> None:
        """End the stream and free the socket."""


class PolledForce:
    """Readings of a receiver. Nothing that it does can stop the loop: a call that fails is a cycle without samples.

    Args:
        receiver: What is asked in every cycle.
        range_n: Largest force that the sensor measures; 95 % of it counts as saturated. None: not watched.
        range_nm: Largest moment, likewise.

    Attributes:
        w_sensor: (6,) N, N m, mean of the good samples since the last :meth:`drain` that had any.
        samples: (MOST_SAMPLES, 6) N, N m, the good ones of the last drain one by one.
        first: -1: they do not come at 1 kHz.
        good: Good samples in the last drain.
        saturated: One of them was beyond the range.
        frozen: The readings have not changed for 25 samples.
        bad: Samples that were no six finite numbers, and calls that failed, in all.
        fault: The last thing that was wrong, for people.

    Raises:
        InputError: A range is not above 0.
    """

    def __init__(self, receiver: Receiver, *, range_n: float | None = None, range_nm: float | None = None) -> None:
        limits = [np.inf if value is None else value for value in (range_n, range_nm)]
        if not min(limits) > 0.0:
            raise InputError("the range of the force sensor is not above 0", value=min(limits))
        self._receiver = receiver
        self._limit: Float = SATURATED * np.repeat(limits, 3)
        self._last: Float = np.full(6, np.nan)
        self._same = 0
        self.w_sensor: Float = np.zeros(6)
        self.samples: Float = np.zeros((MOST_SAMPLES, 6))
        self.first, self.good, self.bad = -1, 0, 0
        self.saturated = self.frozen = False
        self.fault = ""

    def drain(self) -> int:
        """Take every sample that is there; returns the number of good ones."""
        self.good = 0
        try:
            received = np.array(self._receiver.receive(), dtype=np.float64)
        except Exception as fault:
            return self._wrong(1, f"{type(fault).__name__}: {fault}")
        if received.size == 0:
            return 0
        if received.ndim != 2 or received.shape[1] != 6:
            return self._wrong(1, f"samples of shape {received.shape}, expected (k, 6)")
        finite: Bool = np.all(np.abs(received) <= LARGEST, axis=1)  # a NaN is not
        if not np.all(finite):
            self._wrong(int(np.sum(~finite)), "a sample with a number that is not finite, or beyond 1e6")
        return self._take(received[finite])

    def _take(self, good: Float) -> int:
        self.good = len(good)
        if self.good == 0:
            return 0
        for sample in good:
            self._same = self._same + 1 if np.array_equal(sample, self._last) else 0
            self._last = sample
        self.frozen = self._same >= FROZEN - 1
        self.saturated = bool(np.any(np.abs(good) > self._limit))
        self.w_sensor[:] = good.mean(axis=0)
        count = min(self.good, MOST_SAMPLES)
        self.samples[:count] = good[:count]
        return self.good

    def _wrong(self, count: int, fault: str) -> int:
        self.bad += count
        self.fault = fault
        return 0

    def close(self) -> None:
        """End the stream; a receiver that fails in it has ended too."""
        try:
            self._receiver.close()
        except Exception as fault:
            self._wrong(1, f"{type(fault).__name__}: {fault}")


Value = float | int | str | bool


@dataclass(frozen=True)
class Opening:
    """Address of a sensor, and its settings in the cell file."""

    host: str  # name or address
    port: int  # UDP or TCP port
    http_port: int = 80  # of the sensor's web page, where it has one
    wait_s: float = 10.0  # how long to wait for the sensor to answer: parts of a cell may be started in any order
    range_n: float | None = None  # largest force that the sensor measures in N, or None
    range_nm: float | None = None  # largest moment in N m, or None
    # of ``[sensor.link]`` in the cell file, every key that the protocol has, with its default where the file has none
    values: Mapping[str, Value] = field(default_factory=dict)
    frame: object = None  # of ``[sensor.frame]``, for ``protocol = "frame"``: its FrameSource; else None


@dataclass(frozen=True)
class ForceSensorKind:
    """A protocol that a cell file can name."""

    title: str  # one line for help and reports
    # reaches the sensor and returns a Receiver (our own protocols: a ready ForceSource). Raises OutputError where the
    # sensor does not answer within ``wait_s``
    open: Callable[[Opening], Any]
    # keys of ``[sensor.link]`` with their defaults; a value must be of the type of its default
    values: Mapping[str, Value] = field(default_factory=dict)
    # ``module:object`` of the sensor's side on the simulated cell, which makes a ForceDevice of a ``ForceStart``;
    # empty: it has none
    device: str = ""


def link_values(name: str, values: Mapping[str, Value]) -> dict[str, Value]:
    """Values of ``[sensor.link]`` with defaults.

    Raises:
        ValueError: A key that the protocol does not have, or a value of another type than its default.
    """
    return checked_values(name, FORCE_SENSORS[name].values, values)


def checked_values(name: str, defaults: Mapping[str, Value], values: Mapping[str, Value]) -> dict[str, Value]:
    """Values of a protocol with defaults. Raises as :func:`link_values`."""
    for key, value in values.items():
        if key not in defaults:
            raise ValueError(f"the {name} protocol has no key {key}; it has {', '.join(defaults) or 'none'}")
        expected = type(defaults[key])
        if type(value) is not expected and not (expected is float and type(value) is int):
            raise ValueError(f"{key} of the {name} protocol is a {type(value).__name__}, expected {expected.__name__}")
    return {**defaults, **values}


def opened(name: str, opening: Opening) -> ForceSource:
    """Reach a sensor.

    Raises:
        InputError: There is no such protocol, or that of another package fails.
        OutputError: The sensor does not answer.
        ProtocolError: What it says is not of its protocol.
    """
    kind = FORCE_SENSORS[name]
    where = f"{name} at {opening.host}:{opening.port}"
    try:
        receiver = kind.open(opening)
    except CounterflexError:
        raise
    except OSError as fault:
        raise OutputError(f"the force sensor cannot be reached: {fault}", where=where) from fault
    except Exception as fault:
        raise InputError(
            f"the force sensor's protocol of another package fails: {type(fault).__name__}: {fault}", where=where
        ) from fault
    if name in FORCE_SENSORS.own and isinstance(receiver, ForceSource):
        return receiver
    missing = [member for member in ("receive", "close") if not callable(getattr(receiver, member, None))]
    if missing:
        raise InputError("what the protocol opens cannot be read", where=where, value=f"it has no {missing[0]}()")
    return PolledForce(receiver, range_n=opening.range_n, range_nm=opening.range_nm)


FORCE_SENSORS: Final[Registry[ForceSensorKind]] = Registry(
    "counterflex.force_sensors",
    "protocol of a force sensor",
    "counterflex.protocols.force.sensors:ForceSensorKind",
    {"frame": "counterflex.protocols.frame.sensor:FRAME", "wrench": "counterflex.protocols.wrench.sensor:WRENCH"},
)
