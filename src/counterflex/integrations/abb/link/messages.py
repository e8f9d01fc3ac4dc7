"""Message types of ABB's Externally Guided Motion, built from their published field numbers (proto2, ``abb.egm``).

``EgmRobot.measuredForce`` is declared as bytes: its inside differs between RobotWare 6 and 7, see
:func:`counterflex.integrations.abb.link.telegram.measured_force`.
"""

from __future__ import annotations

from typing import Any, Final

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

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
