"""A robot controller's side of KUKA RSI, cycle by cycle: what it sends, what it makes of the answers. No socket.

Models what real controllers do and public simulators leave out: RSol without correction, numbers rounded to Precision,
answers checked for SENTYPE and IPOC, late answers counted in Delay, HOLDON, ABSOLUTE and RELATIVE corrections, POSCORR
clamping in silence, POSCORRMON and Timeout stopping the motion, a nearly empty first telegram (KR C2).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, MS
from counterflex.geometry import rotation
from counterflex.integrations.kuka.link.config import ConfigValue, RsiConfig
from counterflex.integrations.kuka.link.kernel import MISSING, OK
from counterflex.integrations.kuka.link.telegram import answer_reader, robot_writer
from counterflex.robot.model.controller_axes import AS_MODEL, ControllerAxes
from counterflex.twin.devices.commanded_motion import Report
from counterflex.twin.plant.drives import MotorCurrents

_TYPE: Final = re.compile(rb"<Sen\s+Type\s*=\s*[\"']([^\"']*)[\"']")
FREE: Final = 0
CORRECTING: Final = 1
CLAMPED: Final = 2
_MEASURED: Final = ("RIst", "RSol", "AIPos", "ASPos")
_UNITS: Final = (MM, MM, MM, DEG, DEG, DEG)
_NO_TAG: Final = -1  # Place of a tag that the configuration does not have
_LOCKED: Final = 1e-12  # Cosine of B below which only A -+ C is determined


@dataclass(frozen=True)
class RsiContext:
    """Settings of the RSI context and of RSI_ON on the controller."""

    # ``absolute``: the answer is the total correction; ``relative``: it is added every cycle
    mode: Literal["absolute", "relative"] = "absolute"
    cycle_s: float = 4.0 * MS  # 4 ms (#IPO_FAST) or 12 ms (#IPO)
    timeout: int = 10  # Late answers at which the motion stops (RSITimeout)
    precision: int = 4  # Decimal places that are sent
    clamp_m: float = 5.0 * MM  # POSCORR: largest correction per axis; beyond it is clamped silently
    clamp_rad: float = 5.0 * DEG  # POSCORR: MaxRotAngle
    monitor_m: float = 6.0 * MM  # POSCORRMON: MaxTrans; beyond it the motion stops
    monitor_rad: float = 6.0 * DEG  # POSCORRMON: MaxRotAngle
    axis_clamp_rad: float = 5.0 * DEG  # AXISCORR, per axis
    empty_first: bool = False  # KR C2: the first telegram contains the counter only
    first_counter: int = 4208163000  # First IPOC, ms
    axes: ControllerAxes = AS_MODEL  # How the controller counts the axes

    def __post_init__(self) -> None:
        """Check ranges."""
        if self.mode not in ("absolute", "relative"):
            raise InputError("mode of RSI", value=self.mode, limit="absolute or relative")
        if round(self.cycle_s / MS) not in (4, 12):
            raise InputError("cycle of RSI", value=f"{self.cycle_s / MS:g} ms", limit="4 or 12 ms")
        if not 0 <= self.precision <= 9 or self.timeout < 1:
            raise InputError("Precision or Timeout of RSI", value=(self.precision, self.timeout))


class FakeRsi:
    """One RSI session of a simulated controller.

    Args:
        config: The ETHERNET configuration that both sides have.
        context: Settings of the controller.
        frees: Values of free tags that the robot program sets, by name (``Enable``); changed from outside at will.
        currents: Shows the motor currents of the drives, where the configuration sends MACur; None: they are 0.
        job: Number of the job that the program says by ``Enable`` instead of 1, see ``rsi make``; 0: it says none.
    """

    def __init__(
        self,
        config: RsiConfig,
        context: RsiContext,
        frees: dict[str, float] | None = None,
        currents: MotorCurrents | None = None,
        job: int = 0,
    ) -> None:
        self.config, self.context = config, context
        sent = config.sent()
        self._currents = currents
        self._job = job if any(v.name == "Enable" and v.kind != "BOOL" for v in sent) else 0
        self._has_currents = currents is not None and any(value.element == "MACur" for value in sent)
        self._free_names, self._sent_places = _sources(sent, currents=self._has_currents)
        self._reader, self._writer = answer_reader(config), robot_writer(config, decimals=context.precision)
        self.frees: dict[str, float] = dict(frees or {})
        self.counter = context.first_counter - self._increment  # IPOC of the telegram to be answered
        self.late = 0  # Late or unusable answers so far (``Delay``); never counted back
        self.stopped = ""  # Why the motion was stopped, or empty
        self.refused = ""  # Why the last answer was refused, or empty
        # (6,) total Cartesian correction in force, m and rad (A B C taken as a rotation about z, y, x)
        self.correction: Float = np.zeros(6)
        self.axes: Float = np.zeros(6)  # (6,) total axis correction in force, rad
        self.stat = FREE  # POSCORR status: 0, 1 correcting, 2 clamped
        self.override = 1.0  # Speed of the program that the answer asks for, 0..1 (tag ``Override``, %)
        self.feed_hold = False  # The answer asks for a feed hold (tag ``FeedHold``)
        received = config.received()
        places = {value.name: k for k, value in enumerate(received)}
        # What the sensor program says it is doing (tag ``State``); -1 where the configuration has none
        self.reported_state = 0 if "State" in places else -1
        self._sent = 0
        self._hold = np.array([value.tag.hold for value in received])
        self._latched: Float = np.array([100.0 if value.name == "Override" else 0.0 for value in received])
        self._pose_places = [places.get(f"RKorr.{a}", _NO_TAG) for a in "XYZABC"]
        self._axis_places = [(places.get(f"AKorr.A{i}", _NO_TAG), places.get(f"AK.A{i}", _NO_TAG)) for i in range(1, 7)]
        self._hold_place, self._state_place, self._override_place, self._stop_place = (
            places.get(name, _NO_TAG) for name in ("FeedHold", "State", "Override", "Stop")
        )

    @property
    def _increment(self) -> int:
        return round(self.context.cycle_s / MS)

    @property
    def cycle_s(self) -> float:
        """Time between telegrams."""
        return self.context.cycle_s

    @property
    def guides(self) -> bool:
        """False: RSI corrects a program."""
        return False

    @property
    def only_sends(self) -> bool:
        """ONLYSEND: nothing is expected back."""
        return self.config.only_send

    @property
    def enabled(self) -> bool:
        """Free tag ``Enable``: the program is where corrections are wanted."""
        return self.frees.get("Enable", 0.0) > 0.5

    @enabled.setter
    def enabled(self, value: bool) -> None:
        self.frees["Enable"] = float(max(1, self._job)) if value else 0.0

    def telegram(self, report: Report) -> bytes:
        """The telegram of the next cycle."""
        self.counter += self._increment
        self._sent += 1
        if self.context.empty_first and self._sent == 1:
            return f'<Rob Type="KUKA"><IPOC>{self.counter}</IPOC></Rob>'.encode("ascii")
        axes, frees = self.context.axes, self.frees
        currents: list[float] = []
        if self._currents is not None and self._has_currents:
            currents = self._currents(report.drive_torque).tolist()
        numbers = (
            *_frame(report.T_part_actual),
            *_frame(report.T_part_nominal),
            *(axes.shown(report.q_actual) / DEG).tolist(),
            *(axes.shown(report.q_command) / DEG).tolist(),
            *currents,
            float(self.late),
            float(self.stat),
            *[frees.get(name, 0.0) for name in self._free_names],
        )
        self._writer.values[:] = [numbers[k] for k in self._sent_places]
        return self._writer.telegram(self.counter)

    def answers(self, data: bytes) -> bool:
        """Return whether a datagram carries the IPOC of the newest telegram."""
        return f"<IPOC>{self.counter}</IPOC>".encode("ascii") in data

    def answer(self, data: bytes | None) -> None:
        """Return the last datagram of the cycle, or None; then :attr:`correction` is what is in force.

        An answer that is late, for another cycle, of another SENTYPE or not readable counts as none. With ONLYSEND
        none is expected.
        """
        if self.stopped or self.config.only_send:
            return
        self.refused = self._accept(data)
        if self.refused:
            self.late += 1
            self._latched[~self._hold] = 0.0
            if self.late >= self.context.timeout:
                self.stopped = "RSITimeout"
        self._apply()

    def _accept(self, data: bytes | None) -> str:
        if data is None:
            return "no answer"
        match = _TYPE.match(data)
        if match is None or match.group(1) != self.config.sentype.encode("ascii"):
            return "SENTYPE"
        status = self._reader.read_bytes(data)
        if status not in (OK, MISSING):
            return "unreadable"
        if self._reader.counter != self.counter:
            return "IPOC"
        np.copyto(self._latched, self._reader.values, where=self._reader.seen)
        return ""

    def _apply(self) -> None:
        context, number = self.context, [*self._latched.tolist(), 0.0]  # the last one: what there is no tag for
        pose = [number[k] * unit for k, unit in zip(self._pose_places, _UNITS, strict=True)]
        axis = [(number[one] + number[other]) * DEG for one, other in self._axis_places]
        if context.mode == "relative":
            pose = [a + b for a, b in zip(self.correction.tolist(), pose, strict=True)]
            axis = [a + b for a, b in zip(context.axes.shown_change(self.axes).tolist(), axis, strict=True)]
        clamped = [_clamped(v, context.clamp_m if i < 3 else context.clamp_rad) for i, v in enumerate(pose)]
        axis_clamped = [_clamped(v, context.axis_clamp_rad) for v in axis]
        over = clamped != pose or axis_clamped != axis
        self.correction, self.axes = np.array(clamped), context.axes.model_change(np.array(axis_clamped))
        self.stat = CLAMPED if over else CORRECTING if any(clamped) or any(axis_clamped) else FREE
        if math.hypot(*clamped[:3]) > context.monitor_m or max(map(abs, clamped[3:])) > context.monitor_rad:
            self.stopped = "POSCORRMON"
        self._command(number)

    def _command(self, number: list[float]) -> None:
        """Feed hold, state, override and stop of the answer in force."""
        self.feed_hold = number[self._hold_place] > 0.5
        self.reported_state = -1 if self._state_place == _NO_TAG else int(number[self._state_place])
        override = 100.0 if self._override_place == _NO_TAG else number[self._override_place]
        self.override = min(1.0, max(0.0, override / 100.0))
        if number[self._stop_place] > 0.5:
            self.stopped = "Stop"

    def again(self, ahead_ms: int) -> FakeRsi:
        """Another session of the same program, its counter so far ahead of this one's."""
        return FakeRsi(self.config, replace(self.context, first_counter=self.counter + ahead_ms), self.frees)

    def guided_pose(self) -> Float | None:
        """None: RSI corrects a program."""
        return None

    def pose_correction(self) -> Float:
        """(6,) Cartesian correction in force: m, and rotation vector of ``Rz(A) Ry(B) Rx(C)``."""
        out = np.zeros(6)
        out[:3] = self.correction[:3]
        if self.correction[3:].any():
            out[3:] = rotation.log(rotation.from_zyx(self.correction[3:]))
        return out


def _sources(sent: tuple[ConfigValue, ...], *, currents: bool) -> tuple[list[str], list[int]]:
    """Return the names of the program's own numbers, and which of all numbers each sent value is.

    All are, in order: the measured elements, six numbers each; Delay and Stat; those of the program.
    """
    measured = (*_MEASURED, "MACur") if currents else _MEASURED
    delay = 6 * len(measured)
    frees: list[str] = []
    places: list[int] = []
    for value in sent:
        if value.element in measured and (value.element == "MACur" or value.tag.tag.startswith("DEF_")):
            place = "XYZABC".index(value.attribute) if value.element[0] == "R" else int(value.attribute[1:]) - 1
            places.append(6 * measured.index(value.element) + place)
        elif value.name == "Delay.D":
            places.append(delay)
        elif value.name.endswith(".Stat"):
            places.append(delay + 1)
        else:
            places.append(delay + 2 + len(frees))
            frees.append(value.name)
    return frees, places


def _clamped(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


def _frame(T: Float) -> list[float]:
    """X Y Z A B C in mm and deg of a pose, as :func:`counterflex.geometry.rotation.to_zyx` has the angles."""
    (r00, r01, _, x), (r10, r11, _, y), (r20, r21, r22, z), _ = T.tolist()
    level = math.hypot(r00, r10)
    if level < _LOCKED:
        a, c = math.atan2(-r01, r11), 0.0
    else:
        a, c = math.atan2(r10, r00), math.atan2(r21, r22)
    return [x / MM, y / MM, z / MM, a / DEG, math.atan2(-r20, level) / DEG, c / DEG]
