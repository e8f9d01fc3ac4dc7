"""From the flange sensor's reading to the process wrench at the TCP, sample by sample, on the bent arm."""

from __future__ import annotations

import math

import numpy as np
from numba import carray

from counterflex.core.array_table import ArrayTable, matrix, reals, to_pointer, whole_matrix, wholes
from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.core.records import Records
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.kernels.scalar import chain_pass, joint_trig, loads
from counterflex.sensing.carrier import carrier_to_tcp, hose_place, segment_index
from counterflex.sensing.flange_sensor import IDLE, FlangeSensor
from counterflex.sensing.wrench_kernel import idle, to_tcp


@kernel(
    "void(float64[:, ::1], int64[:, ::1], int64, int64, float64[::1], float64[::1], float64[::1], float64[:, ::1],"
    " float64[:, ::1], float64[::1], float64[::1], float64[::1], float64[::1])"
)
def bent_rotation(
    real: Float,
    kind: Int,
    station: int,
    hose: int,
    R_station_sensor: Float,
    q: Float,
    w_tcp_base: Float,
    frame: Float,
    delta: Float,
    trig: Float,
    turn: Float,
    out: Float,
    rest: Float,
) -> None:
    """Rotation of the sensor in the base, weight and the last process wrench included: ``R_base_sensor`` (9,) by rows.

    Args:
        real: Compact chain.
        kind: Likewise.
        station: Of the body that carries the sensor, or the one before it.
        hose: Station of the body that the hose pack comes from, or -1.
        R_station_sensor: (9,) sensor in the station, behind its elastic element.
        q: (6,) rad.
        w_tcp_base: (6,).
        frame: Work arrays of the chain.
        delta: Likewise.
        trig: (12,) likewise.
        turn: (9,) likewise.
        out: (9,) written.
        rest: (9,) written: rotation that the offset goes by, in that body on the unbent arm, else the same as ``out``.
    """
    m = kind.shape[0] - 1
    joint_trig(q, trig)
    chain_pass(real, kind, m, trig, delta, 0, frame)
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
    loads(real, kind, m, frame, q, w_tcp_base, 1, delta)
    chain_pass(real, kind, m, trig, delta, 1, frame)
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


@kernel("Idle[::1](int64[:, ::1])", Idle=IDLE)
def _sensor(table: Int) -> Records:
    out: Records = carray(to_pointer(table[10, 0]), (1,), IDLE)
    return out


@kernel("void(int64[:, ::1], float64[::1], float64[::1], float64, float64)")
def sensor_wrench(table: Int, q: Float, w_sensor: Float, time_s: float, temperature_c: float) -> None:
    """Process wrench of one reading; see :meth:`SensorWrench.__call__`.

    Args:
        table: Real, kind; (2,) stations of sensor and hose; rotation of the sensor in its station; frame, delta, trig,
            turn, both rotations of :func:`bent_rotation`; IDLE of the sensor, gravity, idle reading, TCP in the
            sensor, the unit rotation, R_base_part; and the wrench in base and in part axes: these two are written.
        q: (6,) rad.
        w_sensor: (6,) N, N m.
        time_s: Since the sensor's zero.
        temperature_c: NaN is the reference temperature.
    """
    stations, R, R_rest = wholes(table, 2), reals(table, 8), reals(table, 9)
    still, p, w_base = reals(table, 12), reals(table, 13), reals(table, 16)
    bent_rotation(
        matrix(table, 0),
        whole_matrix(table, 1),
        stations[0],
        stations[1],
        reals(table, 3),
        q,
        w_base,
        matrix(table, 4),
        matrix(table, 5),
        reals(table, 6),
        reals(table, 7),
        R,
        R_rest,
    )
    idle(_sensor(table), R, R_rest, reals(table, 11), time_s, temperature_c, still)
    to_tcp(w_sensor, still, R, p, reals(table, 14), w_base)
    to_tcp(w_sensor, still, R, p, reals(table, 15), reals(table, 17))


class SensorWrench:
    """The reading of one cell's flange sensor as process wrench, with buffers that are allocated once.

    Args:
        chain: Elastic chain of the cell.
        sensor: Identified constants.
        T_base_part: (4, 4) part frame.

    Attributes:
        w_part: (6,) N, N m: result, on the tool about the TCP in part axes.
        w_base: (6,) the same in base axes; the load that the next sample's bending is taken from.

    Raises:
        InputError: The sensor's body is not there, or lies before the last axis.
    """

    def __init__(self, chain: ElasticChain, sensor: FlangeSensor, T_base_part: Float) -> None:
        compact = chain.compact
        place = segment_index(chain, sensor.segment)
        if np.any(chain.joint[place + 1 :] >= 0):
            raise InputError("an axis moves between the sensor and the tool", value=sensor.segment)
        stations = compact.segment
        self._station = int(np.flatnonzero(stations <= place)[-1])
        T = np.eye(4)
        for i in range(int(stations[self._station]) + 1, place + 1):
            T = T @ chain.fixed[i] @ pose.make(rotation.about_z(chain.offset[i]))
        self._hose = -1
        if sensor.hose_from:
            self._hose = int(np.flatnonzero(stations == hose_place(chain, sensor.hose_from, sensor.segment))[0])
        self._R_station_sensor = np.ascontiguousarray((T @ sensor.T_seg_sensor)[:3, :3].reshape(-1))
        p = (pose.inverse(sensor.T_seg_sensor) @ carrier_to_tcp(chain, sensor.segment))[:3, 3]
        self._p_sensor_tcp = np.ascontiguousarray(p)
        R_base_part = as_float("T_base_part", T_base_part, (4, 4))[:3, :3]
        self._R_base_part = np.ascontiguousarray(R_base_part.reshape(-1))
        self._real, self._kind = compact.real, compact.kind
        self._sensor, self._gravity = sensor.record(), np.array(chain.gravity)
        m = compact.stations
        self._frame: Float = np.zeros((m + 1, 12))
        self._delta: Float = np.zeros((m, 6))
        self._trig: Float = np.zeros(12)
        self._turn: Float = np.zeros(9)
        self._R: Float = np.zeros(9)
        self._R_rest: Float = np.zeros(9)
        self._idle: Float = np.zeros(6)
        self._unturned: Float = np.eye(3).reshape(-1).copy()
        self.w_part: Float = np.zeros(6)
        self.w_base: Float = np.zeros(6)
        stations_of = np.array([self._station, self._hose], dtype=np.int64)
        self._table = ArrayTable(
            (
                *(self._real, self._kind, stations_of, self._R_station_sensor),
                *(self._frame, self._delta, self._trig, self._turn, self._R, self._R_rest),
                *(self._sensor, self._gravity, self._idle, self._p_sensor_tcp, self._unturned, self._R_base_part),
                *(self.w_base, self.w_part),
            )
        )

    def __call__(self, q: Float, w_sensor: Float, time_s: float = 0.0, temperature_c: float = math.nan) -> Float:
        """Process wrench of one reading.

        Args:
            q: (6,) rad.
            w_sensor: (6,) N, N m: reading, about the sensor's origin in its axes.
            time_s: Since the sensor's zero.
            temperature_c: NaN is the reference temperature.

        Returns:
            :attr:`w_part`.
        """
        sensor_wrench(self._table.rows, q, w_sensor, time_s, temperature_c)
        return self.w_part

    @property
    def R_base_sensor(self) -> Float:
        """(3, 3) of the last sample."""
        return self._R.reshape(3, 3).copy()
