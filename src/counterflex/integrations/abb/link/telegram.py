"""ABB Externally Guided Motion: what the robot sends, position guidance and path correction (protobuf over UDP).

Path correction moves a running RAPID path sideways (y and z of the path frame: x = tangent, y = tangent cross tool z,
z = x cross y) every 24 ms or a multiple, without orientation. Position guidance replaces the path: every 4 ms the whole
pose is sent.

Message types of ABB's Externally Guided Motion, built from their published field numbers (proto2, ``abb.egm``).

``EgmRobot.measuredForce`` is declared as bytes: its inside differs between RobotWare 6 and 7, see
:func:`counterflex.integrations.abb.link.telegram.measured_force`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import ProtocolError
from counterflex.core.units import DEG, MM, MS
from counterflex.geometry import pose, rotation

_FIELD = descriptor_pb2.FieldDescriptorProto
_TYPES: Final = {
    "double": _FIELD.TYPE_DOUBLE,
    "uint32": _FIELD.TYPE_UINT32,
    "uint64": _FIELD.TYPE_UINT64,
    "bool": _FIELD.TYPE_BOOL,
    "bytes": _FIELD.TYPE_BYTES,
    "enum": _FIELD.TYPE_UINT32,
}
_SCHEMA: Final[dict[str, str]] = {
    "EgmHeader": "1 seqno uint32, 2 tm uint32, 3 mtype enum",
    "EgmCartesian": "1 x double!, 2 y double!, 3 z double!",
    "EgmQuaternion": "1 u0 double!, 2 u1 double!, 3 u2 double!, 4 u3 double!",
    "EgmEuler": "1 x double!, 2 y double!, 3 z double!",
    "EgmClock": "1 sec uint64!, 2 usec uint64!",
    "EgmPose": "1 pos EgmCartesian, 2 orient EgmQuaternion, 3 euler EgmEuler",
    "EgmCartesianSpeed": "1 value double*",
    "EgmJoints": "1 joints double*",
    "EgmExternalJoints": "1 joints double*",
    "EgmPlanned": "1 joints EgmJoints, 2 cartesian EgmPose, 3 externalJoints EgmJoints, 4 time EgmClock",
    "EgmSpeedRef": "1 joints EgmJoints, 2 cartesians EgmCartesianSpeed, 3 externalJoints EgmJoints",
    "EgmPathCorr": "1 pos EgmCartesian!, 2 age uint32!",
    "EgmFeedBack": "1 joints EgmJoints, 2 cartesian EgmPose, 3 externalJoints EgmJoints, 4 time EgmClock",
    "EgmMotorState": "1 state enum!",
    "EgmMCIState": "1 state enum",
    "EgmRapidCtrlExecState": "1 state enum",
    "EgmTestSignals": "1 signals double*",
    "EgmForceSix": "1 force double*",
    "EgmForceSeven": "1 fcActive bool, 2 force double*",
    "EgmRobot": (
        "1 header EgmHeader, 2 feedBack EgmFeedBack, 3 planned EgmPlanned, 4 motorState EgmMotorState, "
        "5 mciState EgmMCIState, 6 mciConvergenceMet bool, 7 testSignals EgmTestSignals, "
        "8 rapidExecState EgmRapidCtrlExecState, 9 measuredForce bytes, 10 utilizationRate double, 11 moveIndex uint32"
    ),
    "EgmSensor": "1 header EgmHeader, 2 planned EgmPlanned, 3 speedRef EgmSpeedRef",
    "EgmSensorPathCorr": "1 header EgmHeader, 2 pathCorr EgmPathCorr",
}
"""Fields per message: number, name, type; ``!`` required, ``*`` repeated (unpacked)."""


def _build() -> dict[str, Any]:
    file = descriptor_pb2.FileDescriptorProto(name="counterflex/egm.proto", package="abb.egm", syntax="proto2")
    for name, fields in _SCHEMA.items():
        message = file.message_type.add(name=name)
        for row in fields.split(", "):
            number, field_name, kind = row.split()
            field = message.field.add(name=field_name, number=int(number), label=_FIELD.LABEL_OPTIONAL)
            if kind.endswith("!"):
                field.label = _FIELD.LABEL_REQUIRED
            elif kind.endswith("*"):
                field.label = _FIELD.LABEL_REPEATED
            kind = kind.rstrip("!*")
            if kind in _TYPES:
                field.type = _TYPES[kind]
            else:
                field.type = _FIELD.TYPE_MESSAGE
                field.type_name = f".abb.egm.{kind}"
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return {name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"abb.egm.{name}")) for name in _SCHEMA}


MESSAGES: Final[dict[str, Any]] = _build()
"""Message classes by name."""


UNDEFINED: Final = 0
DATA: Final = 2
CORRECTION: Final = 3
PATH_CORRECTION: Final = 4
MOTORS_ON: Final = 1
MCI_RUNNING: Final = 3
RAPID_RUNNING: Final = 2
PATH_PERIOD_S: Final = 24.0 * MS
LARGEST: Final = 1e6
"""Number of the robot's own force, N or N m, beyond which a message is damaged."""
_UNIT: Final = 1e-3  # How far a quaternion may be from unit length


@dataclass(frozen=True, eq=False)
class RobotState:
    """State that the robot reports."""

    sequence: int  # Of the message
    time_ms: int  # Clock of the controller
    q: Float | None  # (6,) rad measured angles, or None
    T_frame_tcp: Float | None  # (4, 4) measured pose in the frame that the RAPID program chose, or None
    T_frame_tcp_planned: Float | None  # (4, 4) planned pose, or None
    motors_on: bool  # Motor state
    guided: bool  # The motion interface runs
    rapid_running: bool  # The program runs
    utilization: float | None  # Share of what the motion interface can do, 1 = 100 %; above, the motion is limited
    force: Float | None  # (6,) N, N m that the robot itself measures, or None
    converged: bool = False  # The robot is where the sensor wants it, within the program's window
    move: int | None = None  # Number of the movement instruction that is run, or None
    q_planned: Float | None = None  # (6,) rad planned angles, or None
    # Fields without which nothing can be corrected and that the message leaves out, or that hold something else
    # (another number of axes, a quaternion not of unit length), by their names
    missing: tuple[str, ...] = ()

    def telegram(self, *, robotware: int = 7) -> bytes:
        """An ``EgmRobot`` message: the robot's side, with every field that a controller sends.

        ABB's client library drops a message without number, clock or type in its header, without joints, pose or time
        in feedback and plan, or without one of the four states (its ``parse`` functions).

        Args:
            robotware: 6 or 7; how the force is written.
        """
        message = MESSAGES["EgmRobot"]()
        _head(message.header, self.sequence, self.time_ms, DATA)
        message.header.tm = self.time_ms
        for part, q, T in (
            (message.feedBack, self.q, self.T_frame_tcp),
            (message.planned, self.q_planned, self.T_frame_tcp_planned),
        ):
            if q is not None:
                part.joints.joints.extend((q / DEG).tolist())
            if T is not None:
                _fill(part.cartesian, T)
            part.time.sec, part.time.usec = divmod(self.time_ms * 1000, 1_000_000)
        message.motorState.state = 1 if self.motors_on else 2
        message.mciState.state = 3 if self.guided else 2
        message.rapidExecState.state = 2 if self.rapid_running else 1
        if self.utilization is not None:
            message.utilizationRate = 100.0 * self.utilization
        message.mciConvergenceMet = self.converged
        if self.move is not None:
            message.moveIndex = self.move
        if self.force is not None:
            inside = MESSAGES["EgmForceSix" if robotware < 7 else "EgmForceSeven"]()
            if robotware >= 7:
                inside.fcActive = True
            inside.force.extend(self.force.tolist())
            message.measuredForce = inside.SerializeToString()
        out: bytes = message.SerializeToString()
        return out


def read_robot(data: bytes) -> RobotState:
    """Read an ``EgmRobot`` message.

    Every field of it is optional in the protocol. Where ``motorState`` or ``rapidExecState`` is left out, a running
    motion interface says as much: it does not run without motors and program. What else is needed and not there is
    named in :attr:`RobotState.missing`. A plan that is empty or zero, as before the movement, is none.

    Raises:
        ProtocolError: Not such a message, a required field left out, a number that is not finite.
    """
    message = _parse("EgmRobot", data)
    if not message.HasField("header"):
        raise ProtocolError("an EGM message has no header", value=f"{len(data)} bytes")
    if message.header.mtype not in (UNDEFINED, DATA):
        raise ProtocolError(
            "an EGM message does not come from a robot", value=f"type {message.header.mtype}", limit=DATA
        )
    back, planned = message.feedBack, message.planned
    guided = message.mciState.state == MCI_RUNNING
    no_joints, no_pose = _six_joints(back), _whole_pose(back)
    missing = [
        name
        for name, there in (
            ("header.seqno", message.header.HasField("seqno")),
            (no_joints, not no_joints),
            (no_pose, not no_pose),
            ("mciState", message.HasField("mciState")),
        )
        if not there
    ]
    return RobotState(
        sequence=message.header.seqno,
        time_ms=message.header.tm,
        q=None if no_joints else _joints(back),
        T_frame_tcp=None if no_pose else _pose(back.cartesian),
        T_frame_tcp_planned=None if _whole_pose(planned) else _pose(planned.cartesian),
        motors_on=message.motorState.state == MOTORS_ON if message.HasField("motorState") else guided,
        guided=guided,
        rapid_running=message.rapidExecState.state == RAPID_RUNNING if message.HasField("rapidExecState") else guided,
        utilization=_finite(message.utilizationRate) / 100.0 if message.HasField("utilizationRate") else None,
        force=measured_force(message.measuredForce) if message.HasField("measuredForce") else None,
        converged=message.mciConvergenceMet,
        move=message.moveIndex if message.HasField("moveIndex") else None,
        q_planned=None if _six_joints(planned) else _joints(planned),
        missing=tuple(missing),
    )


def _placed(part: Any) -> bool:
    """Return whether feedback or plan holds a whole pose."""
    cartesian = part.cartesian
    turned = cartesian.HasField("orient") or cartesian.HasField("euler")
    return bool(part.HasField("cartesian") and cartesian.HasField("pos") and turned)


def _six_joints(back: Any) -> str:
    """Fault of the number of angles in the feedback; empty: none."""
    if not back.HasField("joints"):
        return "feedBack.joints"
    count = len(back.joints.joints)
    return "" if count == 6 else f"feedBack.joints of 6 axes (they are {count})"


def _whole_pose(back: Any) -> str:
    """Fault of the pose in the feedback; empty: none."""
    if not _placed(back):
        return "feedBack.cartesian"
    if back.cartesian.HasField("euler"):
        return ""
    u = back.cartesian.orient
    size = math.hypot(u.u0, u.u1, u.u2, u.u3)
    if not math.isfinite(size) or abs(size - 1.0) <= _UNIT:
        return ""
    return f"feedBack.cartesian.orient of length 1 (it is {size:.3g})"


def measured_force(data: bytes) -> Float | None:
    """Six numbers of the field ``measuredForce``, RobotWare 6 or 7; None where force control is not active.

    RobotWare 6 holds repeated doubles in field 1, RobotWare 7 a flag in field 1 and the doubles in field 2; the wire
    type of field 1 tells them apart.

    Raises:
        ProtocolError: Neither form, or not six finite numbers up to 1e6.
    """
    if not data:
        return None
    field, wire_type = data[0] >> 3, data[0] & 7
    if (field, wire_type) in ((1, 1), (1, 2)):
        values = list(_parse("EgmForceSix", data).force)
    else:
        seven = _parse("EgmForceSeven", data)
        if seven.HasField("fcActive") and not seven.fcActive:
            return None
        values = list(seven.force)
    if len(values) != 6 or not all(abs(value) <= LARGEST for value in values):  # a NaN is not
        raise ProtocolError("the robot's own force is not six numbers", value=values, limit=f"{LARGEST:g} N, N m")
    return np.array(values)


def write_path_correction(sequence: int, y_m: float, z_m: float, age_s: float, time_ms: int = 0) -> bytes:
    """An ``EgmSensorPathCorr``: correction in the path frame, along it always zero.

    Args:
        y_m: m, along tangent cross tool z.
        z_m: m.
        age_s: How old the measurement behind it is.
        time_ms: Our clock.

    Raises:
        ProtocolError: A number is not finite.
    """
    message = MESSAGES["EgmSensorPathCorr"]()
    _head(message.header, sequence, time_ms, PATH_CORRECTION)
    position = message.pathCorr.pos
    position.x, position.y, position.z = 0.0, _finite(y_m) / MM, _finite(z_m) / MM
    message.pathCorr.age = max(0, round(_finite(age_s) / MS))
    out: bytes = message.SerializeToString()
    return out


def read_path_correction(data: bytes) -> tuple[int, Float, float]:
    """Sequence, correction (3,) m in the path frame and its age in s: the robot's side.

    Raises:
        ProtocolError: Not such a message, or a number that is not finite.
    """
    message = _parse("EgmSensorPathCorr", data)
    _kind(message.header, PATH_CORRECTION)
    p = message.pathCorr.pos
    correction = np.array([_finite(p.x), _finite(p.y), _finite(p.z)]) * MM
    return message.header.seqno, correction, message.pathCorr.age * MS


def write_guidance(sequence: int, T_frame_tcp: Float, time_ms: int = 0, twist: Float | None = None) -> bytes:
    """An ``EgmSensor`` that guides the tool to a pose.

    The controller's law is ``speed = k (pose - where it is) + speed reference``.

    Args:
        T_frame_tcp: (4, 4) m, in the frame that the RAPID program chose.
        time_ms: Our clock.
        twist: (6,) m/s and rad/s, speed reference in the same frame; None sends none: the law is then the first term.

    Raises:
        InputError: The pose is not (4, 4), the twist not (6,), or a number is not finite.
    """
    message = MESSAGES["EgmSensor"]()
    _head(message.header, sequence, time_ms, CORRECTION)
    _fill(message.planned.cartesian, as_float("T_frame_tcp", T_frame_tcp, (4, 4)))
    if twist is not None:
        speed = as_float("twist", twist, (6,))
        message.speedRef.cartesians.value.extend([*(speed[:3] / MM).tolist(), *(speed[3:] / DEG).tolist()])
    out: bytes = message.SerializeToString()
    return out


def read_guidance(data: bytes) -> tuple[int, Float, Float]:
    """Sequence, pose (4, 4) and speed reference (6,) m/s and rad/s (zero where none is given): the robot's side.

    Raises:
        ProtocolError: Not such a message, no pose, or a number that is not finite.
    """
    message = _parse("EgmSensor", data)
    _kind(message.header, CORRECTION)
    if not message.planned.HasField("cartesian"):
        raise ProtocolError("a guidance message has no pose", value=f"{len(data)} bytes")
    twist = np.zeros(6)
    values = message.speedRef.cartesians.value
    if values:
        if len(values) != 6:
            raise ProtocolError("a speed reference is not six numbers", value=len(values))
        twist = np.array([_finite(v) for v in values]) * ([MM] * 3 + [DEG] * 3)
    return message.header.seqno, _pose(message.planned.cartesian), twist


def _parse(name: str, data: bytes) -> Any:
    message = MESSAGES[name]()
    try:
        message.ParseFromString(data)
    except (DecodeError, ValueError, RecursionError) as fault:
        raise ProtocolError(f"not an {name} message: {fault}", value=f"{len(data)} bytes") from fault
    if not message.IsInitialized():
        lacking = ", ".join(message.FindInitializationErrors())
        raise ProtocolError(f"an {name} message leaves out required fields: {lacking}", value=f"{len(data)} bytes")
    return message


def _head(header: Any, sequence: int, time_ms: int, kind: int) -> None:
    header.seqno, header.mtype = sequence, kind
    if time_ms:
        header.tm = time_ms


def _kind(header: Any, expected: int) -> None:
    if header.mtype != expected:
        raise ProtocolError("an EGM message is of another type", value=header.mtype, limit=expected)


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ProtocolError("a number of an EGM message is not finite", value=value)
    return value


def _joints(back: Any) -> Float:
    values = [_finite(v) for v in back.joints.joints]
    if len(values) != 6:
        raise ProtocolError("an EGM message has another number of joints", value=len(values), limit=6)
    return np.array(values) * DEG


def _pose(cartesian: Any) -> Float:
    p = np.array([_finite(v) for v in (cartesian.pos.x, cartesian.pos.y, cartesian.pos.z)]) * MM
    if cartesian.HasField("euler"):
        angles = [_finite(v) * DEG for v in (cartesian.euler.z, cartesian.euler.y, cartesian.euler.x)]
        return pose.make(rotation.from_zyx(np.array(angles)), p)
    u = cartesian.orient
    quat = [_finite(v) for v in (u.u0, u.u1, u.u2, u.u3)]
    size = math.hypot(*quat)
    if abs(size - 1.0) > _UNIT:
        raise ProtocolError("an EGM quaternion is not of unit length", value=size, limit="1 +- 0.001")
    return pose.make(rotation.from_quat_wxyz(np.array([v / size for v in quat])), p)


def _fill(cartesian: Any, T: Float) -> None:
    p, u = cartesian.pos, cartesian.orient
    p.x, p.y, p.z = (T[:3, 3] / MM).tolist()
    u.u0, u.u1, u.u2, u.u3 = rotation.quat_wxyz(T[:3, :3]).tolist()
