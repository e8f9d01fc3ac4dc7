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

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.jit import kernel
from counterflex.geometry import pose
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.runtime.primitives.lag_filters import MEMORY, lag
from counterflex.sensing.carrier import carrier_to_tcp
from counterflex.sensing.flange_sensor import FlangeSensor, tensor
from counterflex.signals.filters import Smoothing

_MOST_CYCLES = 4
"""Cycles without a telegram that are bridged; after more of them the motion is taken up anew."""

# Places in the memory of the kernel.
_LOW = 0  # 24: wrench
_SECOND = MEMORY  # 24: motion
_PLACE = 2 * MEMORY  # 6: place of the centre of gravity and turn of the tool, last telegram
_WRENCH = _PLACE + 6  # 6: likewise
_R = _WRENCH + 6  # 9: rotation of the tool, last telegram
_TURN = _R + 9  # 3: how far the program has turned the tool since the beginning
_RESULT = _TURN + 3  # 6
_ACCELERATION = _RESULT + 6  # 6
_SIZE = _ACCELERATION + 6

# Places in its constants.
_C_LOW = 0  # 5
_C_SECOND = 5  # 5
_C_COM = 10  # 3: centre of gravity in the tool frame
_C_MASS = 13
_C_INERTIA = 14  # 9: about it, tool axes
_C_R = 23  # 9: R_base_part
_CONSTANTS = 32


@kernel("void(float64[::1], int64, float64[::1], float64[::1], int64, float64[::1], float64[::1])")
def _place(T: Float, at_t: int, w: Float, C: Float, at_c: int, constants: Float, out: Float) -> None:
    """Centre of gravity in part axes (3), and the turn of the tool by its deflection (3).

    Args:
        T: Array that holds the pose of the tool (12, part frame) from ``at_t`` on.
        at_t: See above.
        w: (6,) wrench that the sensor shows, weight taken off, about the TCP in part axes.
        C: Array that holds the compliance at the TCP (36, base axes) from ``at_c`` on.
        at_c: See above.
        constants: See the module.
        out: (6,) written.
    """
    R = constants[_C_R : _C_R + 9]
    for k in range(6):
        out[k] = 0.0
    for i in range(6):
        total = 0.0
        for j in range(6):
            part = 3 * (j // 3)
            row = 3 * (j % 3)
            base = R[row] * w[part] + R[row + 1] * w[part + 1] + R[row + 2] * w[part + 2]
            total += C[at_c + 6 * i + j] * base
        part, row = 3 * (i // 3), 3 * (i % 3)
        for k in range(3):
            out[part + k] += R[row + k] * total
    c = constants[_C_COM : _C_COM + 3]
    x = T[at_t] * c[0] + T[at_t + 1] * c[1] + T[at_t + 2] * c[2]
    y = T[at_t + 3] * c[0] + T[at_t + 4] * c[1] + T[at_t + 5] * c[2]
    z = T[at_t + 6] * c[0] + T[at_t + 7] * c[1] + T[at_t + 8] * c[2]
    out[0] += T[at_t + 9] + x + out[4] * z - out[5] * y
    out[1] += T[at_t + 10] + y + out[5] * x - out[3] * z
    out[2] += T[at_t + 11] + z + out[3] * y - out[4] * x


@kernel("void(float64[::1], int64, float64[::1], float64[::1], float64[::1])")
def _add(T: Float, at_t: int, constants: Float, memory: Float, work: Float) -> None:
    """Add ``m a`` at the centre of gravity and ``I alpha`` to the result. Arguments as for :func:`_remove`."""
    a, c = memory[_ACCELERATION : _ACCELERATION + 6], constants[_C_COM : _C_COM + 3]
    mass = constants[_C_MASS]
    for k in range(3):
        work[k] = T[at_t + 3 * k] * c[0] + T[at_t + 3 * k + 1] * c[1] + T[at_t + 3 * k + 2] * c[2]
        memory[_RESULT + k] += mass * a[k]
        work[3 + k] = T[at_t + k] * a[3] + T[at_t + 3 + k] * a[4] + T[at_t + 6 + k] * a[5]
    memory[_RESULT + 3] += mass * (work[1] * a[2] - work[2] * a[1])
    memory[_RESULT + 4] += mass * (work[2] * a[0] - work[0] * a[2])
    memory[_RESULT + 5] += mass * (work[0] * a[1] - work[1] * a[0])
    for k in range(3):
        i = _C_INERTIA + 3 * k
        moment = constants[i] * work[3] + constants[i + 1] * work[4] + constants[i + 2] * work[5]
        for n in range(3):
            memory[_RESULT + 3 + n] += T[at_t + 3 * n + k] * moment


@kernel("void(float64[::1], int64, float64[::1], float64[::1], int64, float64[::1], int64, float64[::1], float64[::1])")
def _remove(
    T: Float, at_t: int, w: Float, C: Float, at_c: int, constants: Float, elapsed: int, memory: Float, work: Float
) -> None:
    """One telegram; see :class:`SpindleInertia`. ``elapsed`` 0 begins, ``work`` (18,) is work space."""
    place, x, v = work[:6], work[6:12], work[12:18]
    _place(T, at_t, w, C, at_c, constants, place)
    for k in range(3):  # the program's own turning, summed up from telegram to telegram
        i, j = 3 * ((k + 1) % 3), 3 * ((k + 2) % 3)
        turned = 0.0
        for n in range(3):
            turned += T[at_t + j + n] * memory[_R + i + n] - T[at_t + i + n] * memory[_R + j + n]
        memory[_TURN + k] = memory[_TURN + k] + 0.5 * turned if elapsed > 0 else 0.0
        place[3 + k] += memory[_TURN + k]
    for k in range(9):
        memory[_R + k] = T[at_t + k]
    if elapsed < 1 or elapsed > _MOST_CYCLES:
        for k in range(6):
            m = _LOW + 4 * k
            memory[m] = memory[m + 1] = memory[m + 2] = memory[m + 3] = w[k]
            m = _SECOND + 4 * k
            speed = memory[m] - memory[m + 1] if elapsed > 0 else 0.0
            memory[m], memory[m + 1], memory[m + 2], memory[m + 3] = place[k], place[k] - speed, 0.0, 0.0
            memory[_RESULT + k], memory[_ACCELERATION + k] = w[k], 0.0
    else:
        for n in range(1, elapsed + 1):
            share = n / elapsed
            for k in range(6):
                x[k] = memory[_PLACE + k] + share * (place[k] - memory[_PLACE + k])
                v[k] = memory[_WRENCH + k] + share * (w[k] - memory[_WRENCH + k])
            lag(v, 0, constants, _C_LOW, memory, _LOW, memory, _RESULT)
            lag(x, 0, constants, _C_SECOND, memory, _SECOND, memory, _ACCELERATION)
        _add(T, at_t, constants, memory, x)
    for k in range(6):
        memory[_PLACE + k], memory[_WRENCH + k] = place[k], w[k]


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
        self._constants: Float = np.zeros(_CONSTANTS)
        self._constants[_C_LOW : _C_LOW + 5] = low
        square = (2.0 / period_s) ** 2 * low[0]
        self._constants[_C_SECOND : _C_SECOND + 5] = square, -2.0 * square, square, low[3], low[4]
        self._constants[_C_COM : _C_COM + 3] = R_tcp_sensor @ (sensor.p_sensor_com - T_sensor_tcp[:3, 3])
        self._constants[_C_MASS] = sensor.mass_kg
        inertia = R_tcp_sensor @ tensor(sensor.inertia_kg_m2) @ R_tcp_sensor.T
        self._constants[_C_INERTIA : _C_INERTIA + 9] = inertia.reshape(-1)
        self._constants[_C_R : _C_R + 9] = as_float("T_base_part", T_base_part, (4, 4))[:3, :3].reshape(-1)
        self._memory: Float = np.zeros(_SIZE)
        self._work: Float = np.zeros(18)
        self._begun = False
        self.w_part: Float = self._memory[_RESULT : _RESULT + 6]
        self.acceleration: Float = self._memory[_ACCELERATION : _ACCELERATION + 6]

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
            at_t: See above.

        Returns:
            :attr:`w_part`.
        """
        _remove(
            T_part_tcp,
            at_t,
            w_part,
            C.reshape(-1),
            0,
            self._constants,
            elapsed if self._begun else 0,
            self._memory,
            self._work,
        )
        self._begun = True
        return self.w_part
