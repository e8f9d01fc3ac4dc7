"""The inertia of the spindle taken out of the flange sensor's force.

A sensor at the flange feels the process and, beside it, the mass m that hangs behind it: ``w = process - m a``. A
correction accelerates that mass, which looks like a force, which is corrected again; with light filters the loop
becomes unstable. The acceleration is known without an accelerometer: the centre of gravity stands where the motors
are, as the controller shows it, plus the deflection of the arm under the very wrench that the sensor shows::

    p_com = p_tcp(motors) + R p_tcp_com + (C w)_at_com,   process = L (w + m p_com'')

L is a second-order low-pass with a corner far above the one of the force filter. It is the same on both parts, so that
they stay in phase, and the second derivative costs no noise above its corner: ``L s^2`` is one filter. What is left out
are the masses of the arm itself and what the model's compliance lacks.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.arrays import Float, as_float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, record, records
from counterflex.geometry import pose
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.runtime.primitives.frames import MEMORY, lag
from counterflex.sensing.carrier import carrier_to_tcp
from counterflex.sensing.flange_sensor import FlangeSensor, tensor
from counterflex.signals.filters import Smoothing

_MOST_CYCLES = 4
"""Cycles without a telegram that are bridged; after more of them the motion is taken up anew."""

INERTIA: Final = record(
    low=(float, 5),  # coefficients of L
    second=(float, 5),  # of L s^2
    com=(float, 3),  # centre of gravity in the tool frame
    mass=float,
    tensor=(float, 9),  # of inertia about it, tool axes
    R_base_part=(float, 9),
    low_memory=(float, MEMORY),  # wrench
    second_memory=(float, MEMORY),  # motion
    place=(float, 6),  # of the centre of gravity, and turn of the tool, last telegram
    wrench=(float, 6),  # likewise
    R=(float, 9),  # rotation of the tool, last telegram
    turn=(float, 3),  # how far the program has turned the tool since the beginning
    result=(float, 6),
    acceleration=(float, 6),
    # Of this telegram alone.
    now=(float, 6),  # place and turn
    moved=(float, 6),  # of a cycle without a telegram
    felt=(float, 6),  # wrench of such a cycle
)
"""Constants and memory."""


@kernel("void(Inertia, float64[::1], float64[::1], float64[::1])", Inertia=INERTIA)
def _place(s: Record, T: Float, w: Float, C: Float) -> None:
    """Centre of gravity in part axes (3), and the turn of the tool by its deflection (3): into ``now``."""
    R, c, out = s.R_base_part[:], s.com[:], s.now[:]
    for k in range(6):
        out[k] = 0.0
    for i in range(6):
        total = 0.0
        for j in range(6):
            part = 3 * (j // 3)
            row = 3 * (j % 3)
            base = R[row] * w[part] + R[row + 1] * w[part + 1] + R[row + 2] * w[part + 2]
            total += C[6 * i + j] * base
        part, row = 3 * (i // 3), 3 * (i % 3)
        for k in range(3):
            out[part + k] += R[row + k] * total
    x = T[0] * c[0] + T[1] * c[1] + T[2] * c[2]
    y = T[3] * c[0] + T[4] * c[1] + T[5] * c[2]
    z = T[6] * c[0] + T[7] * c[1] + T[8] * c[2]
    out[0] += T[9] + x + out[4] * z - out[5] * y
    out[1] += T[10] + y + out[5] * x - out[3] * z
    out[2] += T[11] + z + out[3] * y - out[4] * x


@kernel("void(Inertia, float64[::1])", Inertia=INERTIA)
def _add(s: Record, T: Float) -> None:
    """Add ``m a`` at the centre of gravity and ``I alpha`` to the result."""
    a, c, arm, alpha, result = s.acceleration, s.com, s.moved, s.felt, s.result
    for k in range(3):
        arm[k] = T[3 * k] * c[0] + T[3 * k + 1] * c[1] + T[3 * k + 2] * c[2]
        result[k] += s.mass * a[k]
        alpha[k] = T[k] * a[3] + T[3 + k] * a[4] + T[6 + k] * a[5]
    result[3] += s.mass * (arm[1] * a[2] - arm[2] * a[1])
    result[4] += s.mass * (arm[2] * a[0] - arm[0] * a[2])
    result[5] += s.mass * (arm[0] * a[1] - arm[1] * a[0])
    for k in range(3):
        moment = s.tensor[3 * k] * alpha[0] + s.tensor[3 * k + 1] * alpha[1] + s.tensor[3 * k + 2] * alpha[2]
        for n in range(3):
            result[3 + n] += T[3 * n + k] * moment


@kernel("void(Inertia, float64[::1], boolean)", Inertia=INERTIA)
def _turn_on(s: Record, T: Float, goes_on: bool) -> None:
    """The program's own turning, summed up from telegram to telegram, added to the turn of the tool."""
    R = s.R
    for k in range(3):
        i, j = 3 * ((k + 1) % 3), 3 * ((k + 2) % 3)
        turned = 0.0
        for n in range(3):
            turned += T[j + n] * R[i + n] - T[i + n] * R[j + n]
        s.turn[k] = s.turn[k] + 0.5 * turned if goes_on else 0.0
        s.now[3 + k] += s.turn[k]
    for k in range(9):
        R[k] = T[k]


@kernel("void(Inertia, float64[::1], boolean)", Inertia=INERTIA)
def _begin(s: Record, w: Float, moves: bool) -> None:
    """Take the motion up anew: the filters as if wrench and speed had been so for ever."""
    for k in range(6):
        m = 4 * k
        for n in range(4):
            s.low_memory[m + n] = w[k]
        speed = s.second_memory[m] - s.second_memory[m + 1] if moves else 0.0
        s.second_memory[m], s.second_memory[m + 1] = s.now[k], s.now[k] - speed
        s.second_memory[m + 2] = s.second_memory[m + 3] = 0.0
        s.result[k], s.acceleration[k] = w[k], 0.0


@kernel("void(float64[::1], int64, float64[::1], float64[::1], int64, Inertia[::1])", Inertia=INERTIA, entry=True)
def _remove(poses: Float, at: int, w: Float, C: Float, elapsed: int, inertias: Records) -> None:
    """One telegram; see :class:`SpindleInertia`."""
    s, T = inertias[0], poses[at : at + 12]
    _place(s, T, w, C)
    _turn_on(s, T, elapsed > 0)
    if elapsed < 1 or elapsed > _MOST_CYCLES:
        _begin(s, w, elapsed > 0)
    else:
        for n in range(1, elapsed + 1):
            share = n / elapsed
            for k in range(6):
                s.moved[k] = s.place[k] + share * (s.now[k] - s.place[k])
                s.felt[k] = s.wrench[k] + share * (w[k] - s.wrench[k])
            lag(s.felt[:], s.low[:], s.low_memory[:], s.result[:])
            lag(s.moved[:], s.second[:], s.second_memory[:], s.acceleration[:])
        _add(s, T)
    for k in range(6):
        s.place[k], s.wrench[k] = s.now[k], w[k]


class SpindleInertia:
    """Takes ``m a`` of what hangs behind the sensor out of its force; buffers are allocated once.

    Args:
        chain: Elastic chain of the cell.
        sensor: Constants of the sensor: mass, centre of gravity, inertia of what hangs behind it.
        T_base_part: (4, 4) part frame.
        corner_hz: Of the low-pass L that force and acceleration pass through; see :meth:`smoothing`.
        period_s: Cycle of the controller.

    Attributes:
        w_part: (6,) N, N m: view of the result, wrench of the process about the TCP, part axes.
        acceleration: (6,) m/s2, rad/s2: view, of the centre of gravity and of the tool, part axes.

    Valid for:
        Motions below about a fifth of the sampling rate; modes of the arm in which its own masses bend it are not seen.

    Raises:
        InputError: The corner is above what the sampling rate allows.
    """

    def __init__(
        self, chain: ElasticChain, sensor: FlangeSensor, T_base_part: Float, corner_hz: float, period_s: float
    ) -> None:
        low = SpindleInertia.smoothing(corner_hz, period_s).coefficients()
        T_sensor_tcp = pose.inverse(sensor.T_seg_sensor) @ carrier_to_tcp(chain, sensor.segment)
        R_tcp_sensor = T_sensor_tcp[:3, :3].T
        self._inertia = records(INERTIA)
        one = self._inertia[0]
        one.low = low
        # Bilinear ``s = 2 / T (1 - z^-1) / (1 + z^-1)``: the double zero of L at -1 cancels, ``L s^2`` keeps L's poles,
        # so both stay in phase at every frequency.
        square = (2.0 / period_s) ** 2 * low[0]
        one.second = square, -2.0 * square, square, low[3], low[4]
        one.com = R_tcp_sensor @ (sensor.p_sensor_com - T_sensor_tcp[:3, 3])
        one.mass = sensor.mass_kg
        one.tensor = (R_tcp_sensor @ tensor(sensor.inertia_kg_m2) @ R_tcp_sensor.T).reshape(-1)
        one.R_base_part = as_float("T_base_part", T_base_part, (4, 4))[:3, :3].reshape(-1)
        self._begun = False
        self.w_part: Float = one.result
        self.acceleration: Float = one.acceleration

    @staticmethod
    def smoothing(corner_hz: float, period_s: float) -> Smoothing:
        """The low-pass L; a force that is compared with the result must pass through it too."""
        return Smoothing(corner_hz, 1, period_s)

    def __call__(self, T_part_tcp: Float, w_part: Float, C: Float, elapsed: int, *, at_t: int = 0) -> Float:
        """Wrench of the process of one telegram.

        Args:
            T_part_tcp: Array that holds, from ``at_t`` on, the rotation by rows and the position (12,) of the tool as
                the motors stand: path and correction in effect, deflection not.
            w_part: (6,) N, N m: what the sensor shows, zero and weight taken off, about the TCP in part axes.
            C: (36,) or (6, 6) compliance at the TCP, base axes; float64, C order.
            elapsed: Cycles since the last telegram.
        """
        _remove(T_part_tcp, at_t, w_part, C.reshape(-1), elapsed if self._begun else 0, self._inertia)
        self._begun = True
        return self.w_part
