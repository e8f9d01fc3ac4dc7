"""Operators and functions of RAPID expressions: numbers, strings, positions, orientations, poses, robtargets."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.geometry import rotation
from counterflex.programs.expression import ExpressionError, Grammar, is_number
from counterflex.programs.unknown import Unknown

Options = Mapping[str, object]
_SINGLE: Final = 2.0**-23
"""Relative step of a num, which has 24 bits: a closer comparison depends on how the controller rounds."""
_LEAST_LENGTH: Final = 1e-6


def _near(a: object, b: object) -> Unknown | None:
    if not (is_number(a) and is_number(b)) or a == b:
        return None
    x, y = float(a), float(b)  # type: ignore[arg-type]
    if abs(x - y) > 4.0 * _SINGLE * max(abs(x), abs(y)):
        return None
    return Unknown(f"the rounding of the controller decides between {x!r} and {y!r}")


def _compare(decide: Callable[[object, object], bool]) -> Callable[[object, object], object]:
    def compared(a: object, b: object) -> object:
        near = _near(a, b)
        return decide(a, b) if near is None else near

    return compared


def _times(a: object, b: object) -> object:
    if isinstance(a, list) and isinstance(b, list):
        if len(a) == len(b) == 4:
            return _product(a, b)
        return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    if isinstance(a, list):
        return [item * _number(b) for item in a]
    if isinstance(b, list):
        return [_number(a) * item for item in b]
    return _number(a) * _number(b)


def _plus(a: object, b: object) -> object:
    if isinstance(a, list) and isinstance(b, list):
        return [x + y for x, y in zip(a, b, strict=True)]
    if isinstance(a, str) and isinstance(b, str):
        return a + b
    return _number(a) + _number(b)


def _minus(a: object, b: object) -> object:
    if isinstance(a, list) and isinstance(b, list):
        return [x - y for x, y in zip(a, b, strict=True)]
    return _number(a) - _number(b)


def _number(value: object) -> float:
    if not is_number(value):
        raise TypeError("no number")
    return value  # type: ignore[return-value]


def _truth(value: object) -> bool:
    if not isinstance(value, bool):
        raise TypeError("no truth value")
    return value


def _product(a: Sequence[float], b: Sequence[float]) -> list[float]:
    (w, x, y, z), (p, q, r, s) = a, b
    return [
        w * p - x * q - y * r - z * s, w * q + x * p + y * s - z * r, w * r - x * s + y * p + z * q,
        w * s + x * r - y * q + z * p,
    ]  # fmt: skip


def _negative(a: object) -> object:
    return [-item for item in a] if isinstance(a, list) else -_number(a)


GRAMMAR: Final = Grammar(
    binary={
        "OR": (1, lambda a, b: _truth(a) or _truth(b)),
        "XOR": (1, lambda a, b: _truth(a) != _truth(b)),
        "AND": (2, lambda a, b: _truth(a) and _truth(b)),
        "<=": (3, _compare(lambda a, b: a <= b)),  # type: ignore[operator]
        ">=": (3, _compare(lambda a, b: a >= b)),  # type: ignore[operator]
        "<>": (3, _compare(lambda a, b: a != b)),
        "<": (3, _compare(lambda a, b: a < b)),  # type: ignore[operator]
        ">": (3, _compare(lambda a, b: a > b)),  # type: ignore[operator]
        "=": (3, _compare(lambda a, b: a == b)),
        "+": (4, _plus),
        "-": (4, _minus),
        "*": (5, _times),
        "/": (5, lambda a, b: _number(a) / _number(b)),
        "DIV": (5, lambda a, b: math.trunc(math.trunc(_number(a)) / math.trunc(_number(b)))),
        "MOD": (5, lambda a, b: int(math.fmod(math.trunc(_number(a)), math.trunc(_number(b))))),
    },
    unary={"NOT": (2, lambda a: not _truth(a)), "-": (5, _negative), "+": (5, lambda a: a)},
    constants={"TRUE": True, "FALSE": False},
    index="{}",
)
"""RAPID overview, chapter expressions: NOT binds looser than AND, a sign before a product belongs to the product."""


# ---- frames ------------------------------------------------------------------------------------------------------


def matrix(q: Sequence[float]) -> Float:
    """Return (3, 3) of q1 to q4, scalar first, its length taken out."""
    w, x, y, z = q
    n = 2.0 / (w * w + x * x + y * y + z * z)
    out: Float = np.array(
        (
            (1.0 - n * (y * y + z * z), n * (x * y - w * z), n * (x * z + w * y)),
            (n * (x * y + w * z), 1.0 - n * (x * x + z * z), n * (y * z - w * x)),
            (n * (x * z - w * y), n * (y * z + w * x), 1.0 - n * (x * x + y * y)),
        )
    )
    return out


def _quaternion(value: object) -> list[float]:
    if not isinstance(value, list) or len(value) != 4 or math.hypot(*value) < _LEAST_LENGTH:
        raise ExpressionError(f"{value} is no orientation: its four numbers must not all be 0")
    return value


def _unit(q: Sequence[float]) -> list[float]:
    length = math.hypot(*_quaternion(q))
    return [part / length for part in q]


def _rotated(q: Sequence[float], p: Sequence[float]) -> list[float]:
    return [float(value) for value in matrix(_quaternion(q)) @ np.array(p, dtype=float)]


def pose_product(a: Sequence[list[float]], b: Sequence[list[float]]) -> list[list[float]]:
    """Return the pose a times b, each ``[[x,y,z],[q1,q2,q3,q4]]``."""
    p = [x + y for x, y in zip(a[0], _rotated(a[1], b[0]), strict=True)]
    return [p, _unit(_product(_unit(a[1]), _unit(b[1])))]


def pose_inverse(a: Sequence[list[float]]) -> list[list[float]]:
    """Return the inverse of a pose."""
    w, x, y, z = _unit(a[1])
    q = [w, -x, -y, -z]
    return [[-part for part in _rotated(q, a[0])], q]


def _offs(p: list[list[float]], x: float, y: float, z: float) -> list[object]:
    return [[a + b for a, b in zip(p[0], (x, y, z), strict=True)], *p[1:]]


def _rel_tool(options: Options, p: list[list[float]], x: float, y: float, z: float) -> list[object]:
    q = list(p[1])
    for key, axis in (("RX", 0), ("RY", 1), ("RZ", 2)):
        if key in options:
            half = math.radians(_number(options[key])) / 2.0
            turn = [math.cos(half), 0.0, 0.0, 0.0]
            turn[axis + 1] = math.sin(half)
            q = _product(q, turn)
    return [[a + b for a, b in zip(p[0], _rotated(p[1], (x, y, z)), strict=True)], q, *p[2:]]


def _orient_zyx(z: float, y: float, x: float) -> list[float]:
    R = rotation.about_z(math.radians(z)) @ rotation.about_y(math.radians(y)) @ rotation.about_x(math.radians(x))
    return [float(part) for part in rotation.quat_wxyz(R)]


def _euler_zyx(options: Options, q: list[float]) -> float:
    R = matrix(_quaternion(q))
    level = math.hypot(R[0, 0], R[1, 0])
    angle = math.atan2(R[1, 0], R[0, 0])
    if "Y" in options:
        angle = math.atan2(-R[2, 0], level)
    elif level < _LEAST_LENGTH:
        angle = 0.0 if "X" in options else math.atan2(-R[0, 1], R[1, 1])
    elif "X" in options:
        angle = math.atan2(R[2, 1], R[2, 2])
    return math.degrees(angle)


def _def_frame(options: Options, p1: list[list[float]], p2: list[list[float]], p3: list[list[float]]) -> list[object]:
    r"""Return the frame with x from the first to the second point, y towards the third; ``\Origin`` 3 has it on y."""
    a, b, c = (np.array(p[0], dtype=float) for p in (p1, p2, p3))
    x = b - a
    y = c - a - x * float((c - a) @ x) / float(x @ x) if float(x @ x) > 0.0 else x
    if not float(x @ x) > 0.0 or not float(y @ y) > 0.0:
        raise ExpressionError("the three points of DefFrame lie on a line")
    origin = {2: b, 3: c - y}.get(int(_number(options.get("ORIGIN", 1))), a)
    x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
    R = np.column_stack([x, y, np.cross(x, y)])
    return [origin.tolist(), [float(part) for part in rotation.quat_wxyz(R)]]


# ---- numbers and strings -----------------------------------------------------------------------------------------


def _round(options: Options, value: float) -> float:
    scale = math.pow(10.0, _number(options.get("DEC", 0)))
    return math.copysign(math.floor(abs(value) * scale + 0.5), value) / scale


def _trunc(options: Options, value: float) -> float:
    scale = math.pow(10.0, _number(options.get("DEC", 0)))
    return math.trunc(value * scale) / scale


def shown(value: object) -> str:
    """Return a value as text, as ValToStr gives it."""
    if isinstance(value, bool):
        return "TRUE" if value else "FALSE"
    if isinstance(value, list):
        return "[" + ",".join(shown(item) for item in value) + "]"
    if isinstance(value, str):
        return f'"{value}"'
    return f"{value:.7g}" if is_number(value) else str(value)


def _dim(value: object, which: float) -> int:
    for _ in range(int(which) - 1):
        value = value[0] if isinstance(value, list) and value else value
    if not isinstance(value, list):
        raise TypeError("no array")
    return len(value)


def _degrees(function: Callable[..., float]) -> Callable[..., float]:
    return lambda *values: math.degrees(function(*values))


def _of_degrees(function: Callable[[float], float]) -> Callable[[float], float]:
    return lambda value: function(math.radians(value))


def _vector(value: list[float]) -> Float:
    return np.array(value, dtype=float)


WITH_OPTIONS: Final[dict[str, Callable[..., object]]] = {
    "RELTOOL": _rel_tool, "EULERZYX": _euler_zyx, "DEFFRAME": _def_frame, "ROUND": _round, "TRUNC": _trunc,
    "ROUNDDNUM": _round, "TRUNCDNUM": _trunc,
}  # fmt: skip
"""Functions that get their options first."""
FUNCTIONS: Final[dict[str, Callable[..., object]]] = {
    "OFFS": _offs,
    "POSEMULT": pose_product,
    "POSEINV": pose_inverse,
    "POSEVECT": lambda a, p: [x + y for x, y in zip(a[0], _rotated(a[1], p), strict=True)],
    "ORIENTZYX": _orient_zyx,
    "NORIENT": _unit,
    "DISTANCE": lambda a, b: float(np.linalg.norm(_vector(a) - _vector(b))),
    "DOTPROD": lambda a, b: float(_vector(a) @ _vector(b)),
    "VECTMAGN": lambda a: float(np.linalg.norm(_vector(a))),
    "ABS": abs, "ABSDNUM": abs, "SQRT": math.sqrt, "SQRTDNUM": math.sqrt, "EXP": math.exp, "POW": math.pow,
    "POWDNUM": math.pow, "MAX": max, "MIN": min, "NUMTODNUM": lambda a: a, "DNUMTONUM": lambda a: a,
    "SIN": _of_degrees(math.sin), "COS": _of_degrees(math.cos), "TAN": _of_degrees(math.tan),
    "ASIN": _degrees(math.asin), "ACOS": _degrees(math.acos), "ATAN": _degrees(math.atan),
    "ATAN2": _degrees(math.atan2), "SINDNUM": _of_degrees(math.sin), "COSDNUM": _of_degrees(math.cos),
    "TANDNUM": _of_degrees(math.tan), "ASINDNUM": _degrees(math.asin), "ACOSDNUM": _degrees(math.acos),
    "ATANDNUM": _degrees(math.atan), "ATAN2DNUM": _degrees(math.atan2),
    "DIM": _dim,
    "VALTOSTR": shown,
    "NUMTOSTR": lambda value, digits: f"{value:.{int(digits)}f}",
    "STRLEN": len,
    "STRPART": lambda text, at, count: text[int(at) - 1 : int(at) - 1 + int(count)],
    "STRMATCH": lambda text, at, part: (text.find(part, int(at) - 1) + 1) or len(text) + 1,
    "BITAND": lambda a, b: int(a) & int(b), "BITOR": lambda a, b: int(a) | int(b),
    "BITXOR": lambda a, b: int(a) ^ int(b), "BITLSH": lambda a, n: int(a) << int(n) & 255,
    "BITRSH": lambda a, n: int(a) >> int(n), "BITCHECK": lambda a, n: bool(int(a) >> int(n) - 1 & 1),
}  # fmt: skip
"""Functions whose value follows from their arguments, by name in capitals."""
