"""Values of VAL3 and the expressions over them: numbers, strings, transformations, points, frames, tools, speeds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, cast

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.geometry import pose, rotation
from counterflex.integrations.staubli.language.program import LETTERS, Val3Value, frame_of, rotations_of
from counterflex.integrations.staubli.language.read.data_file import DataFile
from counterflex.programs.expression import ExpressionError, Grammar, Value, is_number
from counterflex.programs.unknown import Unknown, first_unknown

TRSF, FATHER, CONFIG = "trsf", "father", "config"
JOINTS: Final = ("j1", "j2", "j3", "j4", "j5", "j6")
SPEED_FIELDS: Final = {
    "accel": "accel", "vel": "vel", "decel": "decel", "tvel": "tmax", "rvel": "rmax", "blend": "blend",
    "leave": "leave", "reach": "reach",
}  # fmt: skip
"""Fields of an mdesc by their attributes in the data file."""
CONFIG_FIELDS: Final = ("shoulder", "elbow", "wrist")
WORDS: Final = frozenset(
    ("off", "joint", "cartesian", "Cartesian", "righty", "lefty", "ssame", "sfree", "epositive", "enegative", "esame",
     "efree", "wpositive", "wnegative", "wsame", "wfree")
)  # fmt: skip
"""Constants of mdesc and config."""
SIGNALS: Final = ("dio", "aio", "sio")


def kind_of(kind: str) -> str:
    """Return the kind of a variable without the kind of arm: pointRs is a point."""
    for plain in ("point", "joint", "config"):
        if kind.startswith(plain):
            return plain
    return kind


def default_of(kind: str) -> Value:
    """Return the value that a variable has where nothing sets it."""
    plain = kind_of(kind)
    zero = dict.fromkeys(LETTERS, 0.0)
    if plain in ("point", "frame", "tool"):
        return {TRSF: zero, FATHER: "flange[0]" if plain == "tool" else "world[0]",
                **({CONFIG: dict.fromkeys(CONFIG_FIELDS, "")} if plain == "point" else {})}  # fmt: skip
    if plain == "mdesc":
        return {"accel": 100.0, "vel": 100.0, "decel": 100.0, "tvel": 99999.0, "rvel": 99999.0, "blend": "off",
                "leave": 50.0, "reach": 50.0}  # fmt: skip
    return {
        "num": 0.0, "bool": False, "string": "", "trsf": zero, "joint": dict.fromkeys(JOINTS, 0.0),
        "config": dict.fromkeys(CONFIG_FIELDS, ""),
    }.get(plain, Unknown(f"values of type {kind} are not read"))  # fmt: skip


_NUMBERS: Final = {"trsf": tuple(LETTERS), "joint": tuple(JOINTS)}  # Values that are numbers alone, by kind


def _speed_description(data: DataFile, value: Val3Value) -> Value:
    missing = dict.fromkeys(SPEED_FIELDS, Unknown("the data file does not give it"))
    return {**missing, "tvel": 99999.0, "blend": "off", **{
        field: value.attributes[name].strip() if field == "blend" else data.number(value, name)
        for field, name in SPEED_FIELDS.items() if name in value.attributes
    }}  # fmt: skip


def data_value(data: DataFile, kind: str, value: Val3Value) -> Value:
    """Return the value of an element of a data file. Raises ProgramError: a number of it is none."""
    plain, attributes = kind_of(kind), value.attributes
    if plain in _NUMBERS:
        return {name: data.number(value, name) for name in _NUMBERS[plain]}
    if plain in ("point", "frame", "tool"):
        out: dict[str, Value] = {TRSF: {letter: data.number(value, letter) for letter in LETTERS}}
        out[FATHER] = attributes.get("fatherId", "flange[0]" if plain == "tool" else "world[0]")
        if plain == "point":
            out[CONFIG] = {name: attributes.get(name, "") for name in CONFIG_FIELDS}
        return out
    if plain == "mdesc":
        return _speed_description(data, value)
    if plain == "config":
        return {name: attributes.get(name, "") for name in CONFIG_FIELDS}
    text = attributes.get("value", "")
    if plain == "num":
        return data.number(value, "value")
    if plain == "bool":
        return text.strip().lower() == "true"
    return text if plain == "string" else default_of(kind)


# ---- transformations -----------------------------------------------------------------------------------------


def matrix(value: Value) -> Float:
    """(4, 4) m of a transformation, point, frame or tool; of six numbers too. Raises ExpressionError: it is none."""
    if isinstance(value, list) and len(value) == 6 and all(is_number(item) for item in value):
        value = dict(zip(LETTERS, value, strict=True))
    if isinstance(value, list) and value:
        return matrix(value[0])
    if isinstance(value, Mapping) and TRSF in value:
        value = value[TRSF]
    if not isinstance(value, Mapping) or not all(is_number(value.get(letter)) for letter in LETTERS):
        raise ExpressionError("this is no place: x y z rx ry rz are needed")
    return frame_of({letter: float(value[letter]) for letter in LETTERS})


def trsf_of(T: Float) -> dict[str, Value]:
    """X y z in mm and rx ry rz in deg of a pose (4, 4) m."""
    return dict(zip(LETTERS, [*(T[:3, 3] / MM).tolist(), *rotations_of(T[:3, :3])], strict=True))


def _product(a: Value, b: Value) -> Value:
    if is_number(a) and is_number(b):
        return cast("float", a) * cast("float", b)
    return trsf_of(matrix(a) @ matrix(b))


def _sum(a: Value, b: Value) -> Value:
    if isinstance(a, str) and isinstance(b, str):
        return a + b
    joints = _joints(a, b)
    if joints is not None:
        return {name: joints[0][name] + joints[1][name] for name in JOINTS}
    return _number(a) + _number(b)


def _difference(a: Value, b: Value) -> Value:
    joints = _joints(a, b)
    if joints is not None:
        return {name: joints[0][name] - joints[1][name] for name in JOINTS}
    return _number(a) - _number(b)


def _joints(a: Value, b: Value) -> tuple[Any, Any] | None:
    """Two values as joints, of which one is a joint and the other may be six numbers; None of others."""
    two = [joint_of(one) for one in (a, b)]
    named = any(isinstance(one, Mapping) for one in (a, b))
    return (two[0], two[1]) if named and two[0] is not None and two[1] is not None else None


def joint_of(value: Value) -> Mapping[str, Value] | None:
    """Return a joint, or six numbers in braces as one; None of another value."""
    if isinstance(value, list) and len(value) == len(JOINTS) and all(is_number(one) for one in value):
        return dict(zip(JOINTS, value, strict=True))
    return value if isinstance(value, Mapping) and "j1" in value else None


def _not(a: Value) -> Value:
    if isinstance(a, bool):
        return not a
    return trsf_of(pose.inverse(matrix(a)))


def _number(value: Value) -> float:
    if not is_number(value):
        raise TypeError
    return float(cast("float", value))


def _truth(value: Value) -> bool:
    if not isinstance(value, bool):
        raise TypeError
    return value


def _equal(a: Value, b: Value) -> bool:
    if is_number(a) != is_number(b):
        raise TypeError
    return a == b


GRAMMAR: Final = Grammar(
    binary={
        "OR": (1, lambda a, b: _truth(a) or _truth(b)), "XOR": (2, lambda a, b: _truth(a) != _truth(b)),
        "AND": (3, lambda a, b: _truth(a) and _truth(b)),
        "==": (4, _equal), "!=": (4, lambda a, b: not _equal(a, b)),
        "<=": (5, lambda a, b: _number(a) <= _number(b)), ">=": (5, lambda a, b: _number(a) >= _number(b)),
        "<": (5, lambda a, b: _number(a) < _number(b)), ">": (5, lambda a, b: _number(a) > _number(b)),
        "+": (6, _sum), "-": (6, _difference),
        "*": (7, _product), "/": (7, lambda a, b: _number(a) / _number(b)),
        "%": (7, lambda a, b: math.fmod(_number(a), _number(b))),
    },
    unary={"!": (8, _not), "-": (8, lambda a: -_number(a)), "+": (8, _number)},
    constants={"TRUE": True, "FALSE": False},
    name=r"[A-Za-z_]\w*(?::[A-Za-z_]\w*)?",
    aggregate="{}",
)  # fmt: skip
"""Operators in the order of the VAL3 Reference manual, "Order of operations"."""

_NUMERIC: Final[dict[str, tuple[int, Callable[..., float]]]] = {
    "abs": (1, abs), "sqrt": (1, math.sqrt), "exp": (1, math.exp), "ln": (1, math.log), "log": (1, math.log10),
    "sin": (1, lambda x: math.sin(math.radians(x))), "cos": (1, lambda x: math.cos(math.radians(x))),
    "tan": (1, lambda x: math.tan(math.radians(x))), "asin": (1, lambda x: math.degrees(math.asin(x))),
    "acos": (1, lambda x: math.degrees(math.acos(x))), "atan": (1, lambda x: math.degrees(math.atan(x))),
    "power": (2, math.pow), "min": (2, min), "max": (2, max), "trunc": (1, math.trunc),
    "roundUp": (1, math.ceil), "roundDown": (1, math.floor), "round": (1, lambda x: math.floor(x + 0.5)),
    "limit": (3, lambda x, low, high: min(max(x, low), high)),
}  # fmt: skip
COMPUTED: Final = frozenset((*_NUMERIC, "sel", "appro", "interpolateL", "toRad", "distance", "position", "compose"))
"""Functions whose value follows from their arguments."""


def function(name: str, arguments: Sequence[Value], place: Callable[[Value], Float]) -> Value:
    """Return the value of a function of VAL3.

    Args:
        place: Gives (4, 4) m of a point or frame in the world.

    Raises:
        ExpressionError: The arguments do not fit.
    """
    if name not in COMPUTED:
        return Unknown(f"the value of {name}() is the controller's")
    unknown = first_unknown(list(arguments))
    if unknown is not None:
        return unknown
    try:
        if name in _NUMERIC:
            count, compute = _NUMERIC[name]
            if len(arguments) != count:
                raise ExpressionError(f"{name}() has {count} arguments")
            return compute(*(_number(one) for one in arguments))
        return _geometry(name, arguments, place)
    except (TypeError, ValueError, IndexError, OverflowError) as error:
        raise ExpressionError(f"the arguments of {name}() do not fit") from error


def _geometry(name: str, arguments: Sequence[Value], place: Callable[[Value], Float]) -> Value:
    first = arguments[0]
    if name == "sel":
        return arguments[1] if _truth(first) else arguments[2]
    if name == "appro":  # the transformation is in the axes of the point (VAL3 Reference manual, appro)
        return {**cast("Mapping[str, Value]", first), TRSF: trsf_of(matrix(first) @ matrix(arguments[1]))}
    if name == "compose":  # the transformation is in the axes of the frame (VAL3 Reference manual, compose)
        T_world_frame = place(arguments[1])
        T = T_world_frame @ matrix(arguments[2]) @ pose.inverse(T_world_frame) @ place(first)
        father = pose.inverse(place(first) @ pose.inverse(matrix(first)))
        return {**cast("Mapping[str, Value]", first), TRSF: trsf_of(father @ T)}
    if name == "position":
        return trsf_of(pose.inverse(place(arguments[1])) @ place(first))
    if name == "distance":
        a, b = ((place(one) if FATHER in cast("Mapping[str, Value]", one) else matrix(one)) for one in arguments)
        return float(np.linalg.norm(a[:3, 3] - b[:3, 3]) / MM)
    if name == "interpolateL":
        a, b, share = matrix(first), matrix(arguments[1]), _number(arguments[2])
        turn = rotation.log(a[:3, :3].T @ b[:3, :3])
        return trsf_of(pose.make(a[:3, :3] @ rotation.exp(share * turn), a[:3, 3] + share * (b[:3, 3] - a[:3, 3])))
    return Unknown(f"the value of {name}() is the controller's")


def with_component(value: Value, path: Sequence[str], new: Value) -> Value:
    """Return a value with another component. Raises ExpressionError: it has no such component."""
    if not path:
        return as_stored(value, new)
    if not isinstance(value, Mapping):
        raise ExpressionError(f"there is no component {path[0]}")
    known = {**value}
    if path[0] not in known:
        raise ExpressionError(f"there is no component {path[0]}")
    return {**known, path[0]: with_component(known[path[0]], path[1:], new)}


def _placed(old: Mapping[str, Value], new: list[Value]) -> Value:
    """A point, frame or tool with six numbers, or with these and its configuration."""
    nested = new[0] if new and isinstance(new[0], list) else new
    out = {**old, TRSF: as_stored(old[TRSF], nested)}
    if CONFIG in old and nested is not new and len(new) > 1 and isinstance(new[1], list):
        out[CONFIG] = dict(zip(CONFIG_FIELDS, new[1], strict=False))
    return out


def as_stored(old: Value, new: Value) -> Value:
    """Return a value in the form of the variable that it is put into: six numbers as a transformation or joint.

    Raises:
        ExpressionError: It does not fit.
    """
    if isinstance(new, Unknown) or isinstance(old, Unknown):
        return new
    if isinstance(old, Mapping) and isinstance(new, list):
        if TRSF in old:
            return _placed(old, new)
        if len(new) != len(old):
            raise ExpressionError(f"{len(old)} values are needed")
        return dict(zip(old, new, strict=True))
    if isinstance(old, Mapping) and not isinstance(new, Mapping):
        raise ExpressionError("the value does not fit the variable")
    if isinstance(old, Mapping) and isinstance(new, Mapping) and FATHER in old and FATHER in new:
        return {**new, FATHER: new[FATHER]}
    return new
