"""A simulated TwinCAT alone: it has the symbols that a cell file names."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import NS
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.links import STRAIN, AdsTable, si_of
from counterflex.files.cell.sensing import strain_holder
from counterflex.geometry import pose, rotation
from counterflex.integrations.beckhoff.jobs import ads_table
from counterflex.integrations.beckhoff.link.telegram import TCP_PORT
from counterflex.integrations.beckhoff.simulated import AdsServer, PlcVariable
from counterflex.sensing.strain_holder import lever
from counterflex.twin.devices.pose_source import PoseSource, StandingTarget
from counterflex.twin.devices.strain import StrainSender
from counterflex.twin.network.faults import FaultSchedule

_TICK_S = 0.1
_AHEAD: Final = StandingTarget(pose.make(p=np.array([3.0, 0.0, 0.0])))


@dataclass(frozen=True, eq=False)
class LoneAds:
    """A TwinCAT alone."""

    cell: Path  # Cell file with a table ``[ads]``; its symbols are there, as LREAL, ``beam_ok`` as BOOL
    # (3,) force at the tool, holder axes, that the strain terminals show
    force_n: Float = field(default_factory=lambda: np.zeros(3))
    source: PoseSource = _AHEAD  # What the tracker sees
    noise: float = 0.0  # Standard deviation of a strain
    host: str = "127.0.0.1"  # Address to bind
    port: int = TCP_PORT  # TCP port
    seconds: float | None = None  # How long, or None for ever
    faults: FaultSchedule = field(default_factory=FaultSchedule)  # Scripted

    def _strains(self, cell: Cell, table: AdsTable) -> list[PlcVariable]:
        if not table.strain:
            return []
        holder = strain_holder(cell.tables.holder)
        if holder is None or len(holder.gauges) != len(table.strain):
            raise InputError(
                "strain terminals without a holder of as many bridges", where=str(cell.path), value=len(table.strain),
                hint="Add a table [holder] with one gauge for each terminal, or leave out strain",
            )  # fmt: skip
        strain = holder.bias + holder.sensitivity @ lever(holder.p_holder_tcp) @ self.force_n
        volts_per_strain = (1.0 + holder.beam.poisson_ratio) if table.in_volts else 1.0  # gauge factor 2, full bridge
        unit = si_of(table.strain_unit)[1]
        noise = np.random.default_rng(self.faults.seed)
        comment = f"{STRAIN} in {table.strain_unit}"
        return [
            PlcVariable(source=partial(self._strain, noise, float(value), volts_per_strain, unit), comment=comment)
            for value in strain
        ]

    def _strain(
        self, noise: np.random.Generator, value: float, volts_per_strain: float, unit: float, _time_s: float
    ) -> float:
        return float(value + self.noise * noise.standard_normal()) * volts_per_strain / unit

    def _tracker(self, table: AdsTable) -> dict[str, PlcVariable]:
        tracker, source = table.tracker, self.source
        if tracker is None:
            return {}
        length, angle = si_of(tracker.length_unit)[1], si_of(tracker.angle_unit)[1]
        return {
            symbol: PlcVariable(
                kind="BOOL" if name == "beam_ok" else "LREAL",
                source=partial(_tracker_word, source, length, angle, name),
                comment=f"tracker {name}",
            )
            for name in _tracker_words(source(0.0), length, angle)
            if (symbol := getattr(tracker, name)) is not None
        }


def _tracker_word(source: PoseSource, length: float, angle: float, name: str, time_s: float) -> float:
    return _tracker_words(source(time_s), length, angle)[name]


def _tracker_words(T_tracker_reflector: Float, length: float, angle: float) -> dict[str, float]:
    """Position in polar coordinates and orientation, in the units of the PLC."""
    x, y, z = (float(v) for v in T_tracker_reflector[:3, 3])
    qw, qx, qy, qz = (float(v) for v in rotation.quat_wxyz(T_tracker_reflector[:3, :3]))
    return {
        "distance": math.sqrt(x * x + y * y + z * z) / length,
        "azimuth": math.atan2(y, x) / angle,
        "zenith": math.atan2(math.hypot(x, y), z) / angle,
        "qw": qw,
        "qx": qx,
        "qy": qy,
        "qz": qz,
        "beam_ok": 1.0,
    }


def variables(settings: LoneAds, cell: Cell) -> dict[str, PlcVariable]:
    """Variables of the simulated PLC, in its own units.

    Strain terminals show ``s = bias + S G(p) f`` of the cell's holder; parameters begin at the middle of their limits,
    or at 0.

    Raises:
        FileFormatError: The cell has no table ``[ads]``.
        InputError: It has strain terminals without a holder that fits.
    """
    table = ads_table(cell)
    functions = dict(zip(table.strain, settings._strains(cell, table), strict=True))
    if table.strain_time is not None:
        functions[table.strain_time] = PlcVariable("ULINT", source=lambda time_s: time_s / NS)
    if table.strain_temperature is not None:
        functions[table.strain_temperature] = PlcVariable(value=20.0, comment="temperature of the holder, deg C")
    if table.tracker is not None:
        functions |= settings._tracker(table)
    for one in table.parameters:
        middle = 0.0 if one.low is None or one.high is None else 0.5 * (one.low + one.high)
        functions[one.symbol] = PlcVariable(value=middle, comment=f"{one.name} in {one.unit}")
    return functions


def terminals(cell: Cell, amplifiers: StrainSender, address: tuple[str, int]) -> AdsServer:
    """A TwinCAT whose strain terminals show what the amplifiers of a simulated holder show.

    Args:
        cell: With ``[ads] strain``, one symbol for each bridge.
        amplifiers: Read whenever a symbol is.

    Raises:
        FileFormatError: The cell has no table ``[ads]``.
        InputError: More or fewer symbols than bridges.
        OutputError: The port is taken.
    """
    table, holder = ads_table(cell), strain_holder(cell.tables.holder)
    if holder is None or len(table.strain) != len(amplifiers.shown):
        raise InputError(
            "strain terminals and bridges of the holder", where=str(cell.path), value=len(table.strain),
            limit=f"{len(amplifiers.shown)}, one symbol in [ads] strain for each bridge",
        )  # fmt: skip
    volts_per_strain = (1.0 + holder.beam.poisson_ratio) if table.in_volts else 1.0
    unit = si_of(table.strain_unit)[1]
    variables = {
        symbol: PlcVariable(source=partial(_shown, amplifiers, k, volts_per_strain, unit), comment=STRAIN)
        for k, symbol in enumerate(table.strain)
    }
    if table.strain_time is not None:
        variables[table.strain_time] = PlcVariable("ULINT", source=lambda _: float(amplifiers.time_ns))
    if table.strain_temperature is not None:
        variables[table.strain_temperature] = PlcVariable(source=lambda _: amplifiers.temperature_c)
    return AdsServer(variables, host=address[0], port=address[1], ams_port=table.port)


def _shown(amplifiers: StrainSender, k: int, volts_per_strain: float, unit: float, _time_s: float) -> float:
    return float(amplifiers.shown[k]) * volts_per_strain / unit


def run(
    settings: LoneAds, *, started: Callable[[AdsServer], None] = lambda _: None, ending: threading.Event | None = None
) -> dict[str, Any]:
    """Run a TwinCAT until its time is over, it dies, or somebody presses Ctrl-C.

    Args:
        settings: See :class:`LoneAds`.
        started: Told the server.
        ending: Ends it, or None.

    Returns:
        Summary: requests answered.

    Raises:
        CounterflexError: The cell file cannot be used, or the port is taken.
    """
    cell = read_cell(settings.cell)
    table = ads_table(cell)
    server = AdsServer(
        variables(settings, cell), host=settings.host, port=settings.port, ams_port=table.port, faults=settings.faults
    )
    ending = ending if ending is not None else threading.Event()
    remaining = settings.seconds
    try:
        with contextlib.suppress(KeyboardInterrupt):
            started(server)
            while not server.dead and (remaining is None or remaining > 0.0):
                if ending.wait(_TICK_S if remaining is None else min(_TICK_S, remaining)):
                    break
                remaining = None if remaining is None else remaining - _TICK_S
    finally:
        server.close()
    return {
        "job": "twin ads",
        "ended": "died" if server.dead else "finished",
        "requests": server.requests,
        "counterflex": __version__,
    }


def alone(*, started: Callable[[AdsServer], None] = lambda _: None, **settings: Any) -> dict[str, Any]:
    """As :func:`run`, with the settings by name."""
    return run(LoneAds(**settings), started=started)
