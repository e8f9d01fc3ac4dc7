"""Jobs with a TwinCAT: look at its symbols, read and write them, and pass its tracker on to the loop."""

from __future__ import annotations

import contextlib
import math
import queue
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.plc import Plc
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError, OutputError
from counterflex.core.units import MS
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.links import HOLDER_TEMPERATURE, HOLDER_TIME, STRAIN, AdsTable, AdsTrackerTable, si_of
from counterflex.files.cell.sensing import strain_holder
from counterflex.geometry import pose, rotation
from counterflex.integrations.beckhoff.link.link import (
    AdsLink,
    AdsReader,
    AdsReading,
    AdsSettings,
    AdsSymbol,
    DeviceSymbol,
)
from counterflex.protocols.strain.telegram import StrainSample
from counterflex.protocols.system.forwarder import Forwarder
from counterflex.protocols.tracker.telegram import BEAM_BROKEN, INACCURATE, NO_ORIENTATION, TrackerPose, spherical_point
from counterflex.sensing.strain_holder import strain_of_voltage

_PATIENCE: float = 10.0
_UNIT: float = 1e-3


def ads_table(cell: Cell) -> AdsTable:
    """The table ``[ads]`` of a cell. Raises FileFormatError: it has none."""
    table = cell.tables.ads
    if table is None:
        raise FileFormatError(
            "the cell file has no address of a TwinCAT",
            where=str(cell.path),
            hint='Add a table [ads], for example with net_id = "192.168.1.20.1.1" and host = "192.168.1.20"',
        )
    return table


def symbols_of(table: AdsTable) -> tuple[AdsSymbol, ...]:
    """All: terminals ``strain1`` ..., their time and temperature, tracker ``tracker_...``, parameters by names."""
    si = si_of(table.strain_unit)[1]
    strain = tuple(AdsSymbol(f"{STRAIN}{k}", symbol, si) for k, symbol in enumerate(table.strain, start=1))
    readings = ((HOLDER_TIME, table.strain_time), (HOLDER_TEMPERATURE, table.strain_temperature))
    strain += tuple(AdsSymbol(name, symbol, 1.0) for name, symbol in readings if symbol is not None)
    parameters = []
    for one in table.parameters:
        unit = si_of(one.unit)[1]
        low = -math.inf if one.low is None else one.low * unit
        high = math.inf if one.high is None else one.high * unit
        parameters.append(AdsSymbol(one.name, one.symbol, unit, one.write, low, high))
    return (*strain, *(() if table.tracker is None else _tracker_symbols(table.tracker)), *parameters)


def _tracker_symbols(tracker: AdsTrackerTable) -> tuple[AdsSymbol, ...]:
    length, angle = si_of(tracker.length_unit)[1], si_of(tracker.angle_unit)[1]
    units = {"distance": length, "azimuth": angle, "zenith": angle}
    names = ("distance", "azimuth", "zenith", "qw", "qx", "qy", "qz", "beam_ok")
    return tuple(
        AdsSymbol(f"tracker_{name}", symbol, units.get(name, 1.0))
        for name in names
        if (symbol := getattr(tracker, name)) is not None
    )


@contextlib.contextmanager
def connected(table: AdsTable, *, symbols: bool = True) -> Iterator[AdsLink]:
    """A connection to the TwinCAT of a table. Raises as :class:`.AdsLink`."""
    settings = AdsSettings(table.net_id, table.host, table.port, table.local_net_id, table.timeout_ms * MS)
    link = AdsLink(settings, symbols_of(table) if symbols else ())
    try:
        yield link
    finally:
        link.close()


def list_symbols(cell: str | Path, containing: str = "") -> list[DeviceSymbol]:
    """Return symbols of the TwinCAT of a cell, by name; only names that contain a text, whatever its case."""
    with connected(ads_table(read_cell(cell)), symbols=False) as link:
        symbols = link.device_symbols()
    return sorted((one for one in symbols if containing.lower() in one.name.lower()), key=lambda one: one.name)


def read(cell: str | Path) -> dict[str, Any]:
    """Read all symbols of a cell's table once.

    Returns:
        Values in the units of the table, the time that it took, and, where the cell has an instrumented holder, the
        force at the tool.
    """
    whole = read_cell(cell)
    table = ads_table(whole)
    with connected(table) as link:
        reader = AdsReader(link, 1.0, take=(readings := queue.SimpleQueue[AdsReading]()).put)
        link.read()  # the first exchange also asks for places and types
        reader.start()
        try:
            reading = readings.get(timeout=_PATIENCE)
        except queue.Empty:
            raise InputError("the TwinCAT does not answer", where=table.host, value=reader.trouble or None) from None
        finally:
            reader.end()
        units = {one.name: one.si for one in link.symbols}
        kinds = dict(link.kinds)
    force = holder_force(whole, reading.values)
    return {
        "job": "ads read",
        "took_ms": round(reading.took_s / MS, 3),
        "values": {name: _plain(value / units[name]) for name, value in reading.values.items()},
        "types": kinds,
        "force_n": None if force is None else [round(float(v), 3) for v in force],
    }


def write(cell: str | Path, name: str, value: float) -> dict[str, Any]:
    """Write a parameter and read it back.

    Args:
        value: In the unit of the table.

    Raises:
        CounterflexError: The cell file or the connection cannot be used, or the value may not be written.
    """
    table = ads_table(read_cell(cell))
    with connected(table) as link:
        factor = next((one.si for one in link.symbols if one.name == name), 1.0)
        before = link.read().get(name, math.nan)
        written = link.write(name, value * factor)
        after = link.read()[name]
    if after != written:
        raise OutputError(
            f"the TwinCAT does not keep '{name}'", where=table.host, value=_plain(after / factor),
            limit=_plain(written / factor), hint="Does its program write the variable itself?",
        )  # fmt: skip
    return {"job": "ads write", "name": name, "before": _plain(before / factor), "after": _plain(after / factor)}


def holder_force(cell: Cell, values: Mapping[str, float]) -> Float | None:
    """Force (3,) N at the tool, holder axes, from strain terminals; None where the cell has no holder or no terminals.

    ``f = M (s - bias)`` (Denkena2015 eq. 8). Signals of bridges (V/V) are turned into strain first.

    Args:
        cell: With a table ``[holder]``.
        values: SI, ``strain1`` ... as :class:`.AdsLink` reads them.

    Raises:
        InputError: There are more or fewer terminals than bridges, or a strain is not finite.
    """
    table, holder = cell.tables.ads, strain_holder(cell.tables.holder)
    if table is None or holder is None or not table.strain:
        return None
    if len(table.strain) != len(holder.gauges):
        raise InputError(
            "strain terminals and bridges of the holder", where=str(cell.path), value=len(table.strain),
            limit=f"{len(holder.gauges)}, one symbol for each gauge in its order",
        )  # fmt: skip
    strain = strains_of(table, holder.beam.poisson_ratio, values)
    if not np.all(np.isfinite(strain)):
        raise InputError("a strain terminal shows no number", value=strain.tolist(), hint="Is its cable broken?")
    return holder.forces(strain, holder.matrix())


def strains_of(table: AdsTable, poisson_ratio: float, values: Mapping[str, float]) -> Float:
    """(n,) strains of the terminals, NaN where one shows no number; signals of bridges are turned into strain.

    Args:
        values: SI, ``strain1`` ... as :class:`.AdsLink` reads them.
    """
    strain: Float = np.array([values[f"{STRAIN}{k}"] for k in range(1, len(table.strain) + 1)])
    if table.in_volts:
        strain = strain_of_voltage(strain, poisson_ratio=poisson_ratio, supply_v=1.0)
    return strain


def tracker_pose(values: Mapping[str, float], sequence: int, time_ns: int) -> TrackerPose:
    """The measurement of a tracker that a TwinCAT shows (Mandiola2023 eq. 1).

    What is not a number, or not a distance, becomes a measurement that says of itself that it is not to be used.

    Args:
        values: SI, ``tracker_distance`` ... as :class:`.AdsLink` reads them.
    """
    distance, azimuth, zenith = (values[f"tracker_{name}"] for name in ("distance", "azimuth", "zenith"))
    status = 0 if values.get("tracker_beam_ok", 1.0) > 0.5 else BEAM_BROKEN
    R: Float = np.eye(3)
    if "tracker_qw" in values:
        quat = np.array([values[f"tracker_{name}"] for name in ("qw", "qx", "qy", "qz")])
        size = float(np.linalg.norm(quat))
        if abs(size - 1.0) < _UNIT:  # false for NaN
            R = rotation.from_quat_wxyz(quat / size)
        else:
            status |= INACCURATE
    else:
        status |= NO_ORIENTATION
    p: Float = np.zeros(3)
    if math.isfinite(azimuth) and math.isfinite(zenith) and 0.0 < distance < math.inf:
        p = spherical_point(distance, azimuth, zenith)
    else:
        status |= INACCURATE
    return TrackerPose(sequence & 0xFFFFFFFF, time_ns, status, 0, pose.make(R, p), 0.0)


@dataclass
class Forwarded:
    """Counts of a bridge so far: datagrams sent, readings that could not be used, readings that failed."""

    sent: int = 0
    unusable: int = 0
    failed: int = 0


def forward(
    cell: str | Path,
    peer: tuple[str, int],
    *,
    readings: int | None = None,
    strain: bool = False,
    watch: Callable[[Forwarded], None] = lambda _: None,
) -> dict[str, Any]:
    """Pass the tracker of a TwinCAT on as pose datagrams, or its strain terminals, until Ctrl-C or so many readings.

    A reading with the time stamp of the one before (``[ads] strain_time``) is no new one and is not passed on.

    Args:
        cell: Cell file with a table ``[ads.tracker]``.
        watch: Told what has been done, at every hundredth reading.

    Raises:
        CounterflexError: The cell file or the connection cannot be used, or the TwinCAT is silent for 10 s.
    """
    whole = read_cell(cell)
    table = ads_table(whole)
    sender = _strain_sender(whole, table, peer) if strain else _pose_sender(whole, table, peer)
    done = Forwarded()
    queued = queue.SimpleQueue[AdsReading]()
    try:
        with connected(table) as link:
            reader = AdsReader(link, table.period_ms * MS, take=queued.put)
            reader.start()
            try:
                with contextlib.suppress(KeyboardInterrupt):
                    while readings is None or done.sent < readings:
                        try:
                            reading = queued.get(timeout=_PATIENCE)
                        except queue.Empty:
                            raise InputError(
                                "the TwinCAT does not answer any more", where=table.host, value=reader.trouble or None
                            ) from None
                        sent, usable = sender.take(reading)
                        done.sent += int(sent)
                        done.unusable += int(not usable)
                        done.failed = reader.failed
                        if sent and done.sent % 100 == 0:
                            watch(done)
            finally:
                reader.end()
    finally:
        sender.close()
    return {"job": "ads forward", "sent": done.sent, "unusable": done.unusable, "failed_readings": done.failed}


class _PoseSender:
    """Readings of a tracker as pose datagrams."""

    def __init__(self, peer: tuple[str, int]) -> None:
        self._forwarder = Forwarder(peer, "poses")
        self.close = self._forwarder.close

    def take(self, reading: AdsReading) -> tuple[bool, bool]:
        """Return whether it was sent, and can be used."""
        measured = tracker_pose(reading.values, reading.number, reading.time_ns)
        self._forwarder.send(measured.telegram())
        return True, not measured.status & (BEAM_BROKEN | INACCURATE)


class _StrainSender:
    """Readings of strain terminals as strain datagrams."""

    def __init__(self, peer: tuple[str, int], table: AdsTable, poisson_ratio: float) -> None:
        self._forwarder = Forwarder(peer, "strains")
        self._table, self._poisson_ratio, self._before = table, poisson_ratio, -1
        self.close = self._forwarder.close

    def take(self, reading: AdsReading) -> tuple[bool, bool]:
        """Return whether it was sent, and can be used."""
        values = reading.values
        stamp = values.get(HOLDER_TIME, math.nan)
        time_ns = round(stamp) if math.isfinite(stamp) else reading.time_ns
        if time_ns == self._before:
            return False, True
        self._before = time_ns
        strain = strains_of(self._table, self._poisson_ratio, values)
        sequence, temperature_c = (self._forwarder.sent + 1) & 0xFFFFFFFF, values.get(HOLDER_TEMPERATURE, math.nan)
        self._forwarder.send(StrainSample(sequence, time_ns, 0, temperature_c, strain).telegram())
        return True, bool(np.all(np.isfinite(strain)))


def _pose_sender(cell: Cell, table: AdsTable, peer: tuple[str, int]) -> _PoseSender:
    if table.tracker is None:
        raise FileFormatError("the cell's TwinCAT has no tracker", where=str(cell.path), hint="Add [ads.tracker]")
    return _PoseSender(peer)


def _strain_sender(cell: Cell, table: AdsTable, peer: tuple[str, int]) -> _StrainSender:
    holder = strain_holder(cell.tables.holder)
    if holder is None or len(holder.gauges) != len(table.strain):
        raise FileFormatError(
            "strain terminals and bridges of the holder",
            where=str(cell.path),
            value=len(table.strain),
            limit="one symbol in [ads] strain for each gauge of [holder]"
            if holder is None
            else f"{len(holder.gauges)}",
        )
    return _StrainSender(peer, table, holder.beam.poisson_ratio)


def _plain(value: float) -> float | None:
    """For JSON, which knows no NaN."""
    return float(f"{value:.9g}") if math.isfinite(value) else None


PLC: Final = Plc(
    title="TwinCAT (Beckhoff ADS)",
    symbols=list_symbols,
    read=read,
    write=write,
    forward=forward,
    alone="counterflex.integrations.beckhoff.alone:alone",
    terminals="counterflex.integrations.beckhoff.alone:terminals",
)
