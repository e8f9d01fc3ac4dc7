"""From the flange sensor's reading to the process wrench at the TCP, sample by sample, on the bent arm."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import carray

from counterflex.core.array_table import ArrayTable, addresses, matrix, reals, to_pointer
from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, record, records
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.kernels.records import CHAIN, REGION, STATION, SURROUNDINGS, Compact
from counterflex.robot.elasticity.kernels.scalar import chain_pass, joint_trig, loads
from counterflex.sensing.carrier import carrier_to_tcp, hose_place, segment_index
from counterflex.sensing.flange_sensor import IDLE, FlangeSensor
from counterflex.sensing.wrench_kernel import idle, to_tcp

CARRIED: Final = record(
    station=int,
    hose=int,
    R_station_sensor=(float, 9),
    gravity=(float, 3),
    p_sensor_tcp=(float, 3),
    unturned=(float, 9),
    R_base_part=(float, 9),
    hand=int,
    trig=(float, 12),
    turn=(float, 9),
    R_base_sensor=(float, 9),
    R_rest=(float, 9),
    idle=(float, 6),
)
"""A sensor in the chain: what does not change, work rows, and what the last sample gave.

``station`` of the body that carries it, or the one before it; ``hose``: station of the body that the hose pack comes
from, or -1. ``R_station_sensor``: sensor in the station, behind its elastic element; rotations by rows. ``R_rest``:
rotation that the offset goes by, in the hose's body on the unbent arm, else ``R_base_sensor``. ``idle`` (N, N m): what
the sensor shows without a process. ``hand``: station of the hand where it holds the part, whose axes are the part's
then; -1 where the part stands in ``R_base_part``.
"""
ARRAYS: Final = addresses(
    "stations", "surroundings", "regions", "frame", "delta", "carried", "constants", "w_base", "w_part"
)


@kernel(
    "void(Chain, Carried, float64[::1], float64[::1], float64[:, ::1], float64[:, ::1])", Chain=CHAIN, Carried=CARRIED
)
def bent_rotation(chain: Compact, carried: Record, q: Float, w_tcp_base: Float, frame: Float, delta: Float) -> None:
    """Rotation of the sensor in the base, weight and the last process wrench included.

    Args:
        chain: Compact chain.
        carried: The sensor; ``R_base_sensor`` and ``R_rest`` are written.
        q: (6,) rad.
        w_tcp_base: (6,).
        frame: Work arrays of the chain.
    """
    station, hose = carried.station, carried.hose
    trig, turn, R_station_sensor = carried.trig[:], carried.turn[:], carried.R_station_sensor[:]
    out, rest = carried.R_base_sensor[:], carried.R_rest[:]
    joint_trig(q, trig)
    chain_pass(chain, trig, delta, 0, frame)
    if hose >= 0:
        a, b = frame[hose], frame[station]
        for i in range(3):
            for k in range(3):
                turn[3 * i + k] = a[i] * b[k] + a[3 + i] * b[3 + k] + a[6 + i] * b[6 + k]
        for i in range(3):
            for j in range(3):
                total = 0.0
                for k in range(3):
                    total += turn[3 * i + k] * R_station_sensor[3 * k + j]
                rest[3 * i + j] = total
    loads(chain, frame, q, w_tcp_base, 1, delta)
    chain_pass(chain, trig, delta, 1, frame)
    f, d = frame[station], delta[station]
    cz, sz, cy, sy, cx, sx = (
        math.cos(d[5]), math.sin(d[5]), math.cos(d[4]), math.sin(d[4]), math.cos(d[3]), math.sin(d[3]),
    )  # fmt: skip
    turn[0], turn[1], turn[2] = cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx
    turn[3], turn[4], turn[5] = sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx
    turn[6], turn[7], turn[8] = -sy, cy * sx, cy * cx
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(3):
                inner = turn[3 * k] * R_station_sensor[j]
                inner += turn[3 * k + 1] * R_station_sensor[3 + j]
                inner += turn[3 * k + 2] * R_station_sensor[6 + j]
                total += f[3 * i + k] * inner
            out[3 * i + j] = total
            if hose < 0:
                rest[3 * i + j] = total


@kernel("void(Arrays[::1], float64[::1], float64[::1], float64, float64)", Arrays=ARRAYS, entry=True)
def sensor_wrench(tables: Records, q: Float, w_sensor: Float, time_s: float, temperature_c: float) -> None:
    """Process wrench of one reading; see :meth:`SensorWrench.__call__`.

    Args:
        tables: (1,) ARRAYS; the wrench in base and in part axes is written.
        q: (6,) rad.
        w_sensor: (6,) N, N m.
        time_s: Since the sensor's zero.
        temperature_c: NaN is the reference temperature.
    """
    table = tables[0]
    stations, surroundings, regions = table.stations, table.surroundings, table.regions
    chain = Compact(
        carray(to_pointer(stations.place), (stations.rows,), STATION),
        carray(to_pointer(surroundings.place), (1,), SURROUNDINGS),
        carray(to_pointer(regions.place), (regions.rows,), REGION),
    )
    sensors, w_base = carray(to_pointer(table.constants.place), (1,), IDLE), reals(table.w_base)
    carried = carray(to_pointer(table.carried.place), (1,), CARRIED)[0]
    R, still, p = carried.R_base_sensor[:], carried.idle[:], carried.p_sensor_tcp[:]
    frame = matrix(table.frame)
    for k in range(6):
        if not math.isfinite(w_base[k]):  # one damaged reading must not stay in the load of all that come after it
            w_base[k] = 0.0
    bent_rotation(chain, carried, q, w_base, frame, matrix(table.delta))
    if carried.hand >= 0:
        for k in range(9):
            carried.R_base_part[k] = frame[carried.hand, k]
    idle(sensors, R, carried.R_rest[:], carried.gravity[:], time_s, temperature_c, still)
    to_tcp(w_sensor, still, R, p, carried.unturned[:], w_base)
    to_tcp(w_sensor, still, R, p, carried.R_base_part[:], reals(table.w_part))


def carried_sensor(chain: ElasticChain, sensor: FlangeSensor, T_base_part: Float | None) -> Records:
    """(1,) CARRIED of a sensor in the chain of a cell.

    ``sensor``: identified constants. ``T_base_part``: (4, 4) part frame; None where the robot holds the part.

    Raises:
        InputError: The sensor's body is not there, or lies before the last axis.
    """
    place = segment_index(chain, sensor.segment)
    if np.any(chain.joint[place + 1 :] >= 0):
        raise InputError("an axis moves between the sensor and the tool", value=sensor.segment)
    stations = chain.compact.stations["segment"][:-1]
    out = records(CARRIED)
    carried: Record = out[0]
    station = int(np.flatnonzero(stations <= place)[-1])
    T = np.eye(4)
    for i in range(int(stations[station]) + 1, place + 1):
        T = T @ chain.fixed[i] @ pose.make(rotation.about_z(chain.offset[i]))
    carried.station, carried.hose = station, -1
    if sensor.hose_from:
        hose = hose_place(chain, sensor.hose_from, sensor.segment)
        carried.hose = int(np.flatnonzero(stations == hose)[0])
    carried.R_station_sensor = (T @ sensor.T_seg_sensor)[:3, :3].reshape(-1)
    p = (pose.inverse(sensor.T_seg_sensor) @ carrier_to_tcp(chain, sensor.segment))[:3, 3]
    carried.p_sensor_tcp = p
    carried.hand = len(stations) if T_base_part is None else -1
    if T_base_part is not None:
        carried.R_base_part = as_float("T_base_part", T_base_part, (4, 4))[:3, :3].reshape(-1)
    carried.gravity, carried.unturned = chain.gravity, np.eye(3).reshape(-1)
    return out


class SensorWrench:
    """The reading of one cell's flange sensor as process wrench, with buffers that are allocated once.

    Args:
        chain: Elastic chain of the cell.
        sensor: Identified constants.
        T_base_part: (4, 4) part frame; None where the robot holds the part: it is the end of the chain then.

    Attributes:
        w_part: (6,) N, N m: result, on what the hand holds about the end of the chain (TCP), in part axes.
        w_base: (6,) the same in base axes; the load that the next sample's bending is taken from.
        doubt: Cause why the reading cannot be used; here always 0.

    Raises:
        InputError: The sensor's body is not there, or lies before the last axis.
    """

    doubt = 0

    def __init__(self, chain: ElasticChain, sensor: FlangeSensor, T_base_part: Float | None) -> None:
        self._records = carried_sensor(chain, sensor, T_base_part)
        self._carried: Record = self._records[0]
        self._load = sensor.record()
        compact = chain.compact
        m = len(compact.stations) - 1
        self.w_part: Float = np.zeros(6)
        self.w_base: Float = np.zeros(6)
        self.table = ArrayTable(
            ARRAYS,
            stations=compact.stations,
            surroundings=compact.surroundings,
            regions=compact.regions,
            frame=np.zeros((m + 1, 12)),
            delta=np.zeros((m, 6)),
            carried=self._records,
            constants=self._load,
            w_base=self.w_base,
            w_part=self.w_part,
        )

    def carry(self, mass_kg: float, p_sensor_com: Float) -> None:
        """Take another load behind the sensor: that of the tool in use.

        Args:
            mass_kg: Whole mass.
            p_sensor_com: (3,) m, its centre of gravity in the sensor frame.
        """
        load: Record = self._load[0]
        load.mass, load.com = mass_kg, p_sensor_com

    def __call__(self, q: Float, w_sensor: Float, time_s: float = 0.0, temperature_c: float = math.nan) -> Float:
        """Process wrench of one reading.

        Args:
            q: (6,) rad.
            w_sensor: (6,) N, N m: reading, about the sensor's origin in its axes.
            time_s: Since the sensor's zero.
            temperature_c: NaN is the reference temperature.
        """
        sensor_wrench(self.table.rows, q, w_sensor, time_s, temperature_c)
        return self.w_part

    @property
    def rows(self) -> Records:
        """(1,) ARRAYS of :func:`sensor_wrench`, for a kernel that calls it."""
        return self.table.rows

    @property
    def R_base_sensor(self) -> Float:
        """(3, 3) of the last sample."""
        out: Float = self._carried.R_base_sensor.reshape(3, 3).copy()
        return out
