"""Protocols of force sensors by name: what ``[sensor] protocol`` may say.

Another package adds one with an entry point of the group ``counterflex.force_sensors`` (docs/extend.md). It brings a
receiver of samples; mean, saturation, frozen readings and everything that is no six finite numbers are judged here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from counterflex.core.errors import CounterflexError, InputError, OutputError
from counterflex.core.registry import Registry
from counterflex.protocols.force.polled import PolledForce
from counterflex.protocols.force.source import ForceSource

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
    {
        "frame": "counterflex.protocols.frame.sensor:FRAME",
        "wrench": "counterflex.protocols.wrench.sensor:WRENCH",
    },
)
