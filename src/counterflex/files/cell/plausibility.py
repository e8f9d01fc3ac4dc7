"""Numbers of a cell file against what milling cells have: a mistaken unit is found where the file is read (R25).

Each key has two windows. Outside the wider one no milling cell lies: such a file is refused. Outside the narrower one
few lie: such a number is told. Both are decades wide, so they find a thousand where one was meant, not a third. A zero
is no mistake of units, and neither an angle nor one component of a place is too small by itself: it may be aligned.
Numbers that an identification wrote are not told.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from counterflex.core.errors import FileFormatError
from counterflex.core.units import (
    DEG,
    GRAM,
    INCH,
    KN,
    MINUTE,
    MM,
    MRAD,
    MS,
    N_MM,
    N_PER_MM2,
    STANDARD_GRAVITY,
    UM,
    UM_PER_KN,
    URAD,
    URAD_PER_KNM,
    US,
)
from counterflex.files.cell.tables import CellTables

_TURN = 2.0 * math.pi
_SAME = 4e-3  # of a twelfth of pi, 1e-3 rad
_TURNS: Final = ("rx_urad_per_knm", "ry_urad_per_knm", "rz_urad_per_knm")
_RATIO: Final = 30.0
"""Ratio of the rotational compliances of one element that is told; published ones are at most 4.3 apart (Haehn2020)."""


@dataclass(frozen=True)
class Window:
    """Magnitudes that a key may have, in its own unit."""

    least: float
    low: float
    high: float
    most: float

    @classmethod
    def of(cls, low: float, high: float, least: float | None = None, most: float | None = None) -> Window:
        """Told outside of low to high; refused outside of least to most, by default the same."""
        return cls(low if least is None else least, low, high, high if most is None else most)


_ANY = 0.0
_ROUNDED: Final = 1e-8  # Digits that an identified value keeps in the file
_AMONG: Final = "the other rotational compliances of this element are far from it; is it in another unit?"
_PLACE = Window.of(0.5, 1000.0, _ANY, 5000.0)
_TURNED = Window.of(1e-3, 360.0, _ANY, 720.0)  # An angle that is meant to be zero is measured to be anything
_ELEMENT = Window.of(1.0, 2e4, _ANY, 1e6)
_TURNING = Window.of(10.0, 15e3, _ANY, 1e6)  # published elements of milling robots: 83 to 14925 (Haehn2020)
_FRICTION = Window.of(0.5, 500.0, 0.2, 1000.0)
_SLIP = Window.of(1.0, 500.0)
_MASS = Window.of(0.1, 500.0, 0.02, 2000.0)
_SHARE = Window.of(0.01, 1.5, 0.005, 3.0)

_SWAPPED: Final = tuple(f"{table}.{key}_mm" for table in ("tcp", "part") for key in "xyz")

WINDOWS: Final[dict[str, Window]] = {
    "play.dead_band_half_urad": Window.of(0.5, 1000.0, 0.1, 1100.0),
    "play.friction_nm": _FRICTION,
    "play.slip_urad": _SLIP,
    "servo.speed_gain_nm_s": Window.of(200.0, 270e3, 20.0, 5e6),
    "servo.position_gain_per_s": Window.of(1.0, 200.0),
    "servo.integral_time_ms": Window.of(1.0, 2000.0),
    "servo.friction_nm": _FRICTION,
    "servo.slip_urad": _SLIP,
    "end_effector.x_mm": _PLACE,
    "end_effector.y_mm": _PLACE,
    "end_effector.z_mm": _PLACE,
    "end_effector.com_x_mm": _PLACE,
    "end_effector.com_y_mm": _PLACE,
    "end_effector.com_z_mm": _PLACE,
    "end_effector.a_deg": _TURNED,
    "end_effector.b_deg": _TURNED,
    "end_effector.c_deg": _TURNED,
    "end_effector.mass_kg": _MASS,
    "end_effector.tx_um_per_kn": _ELEMENT,
    "end_effector.ty_um_per_kn": _ELEMENT,
    "end_effector.tz_um_per_kn": _ELEMENT,
    "end_effector.rx_urad_per_knm": _TURNING,
    "end_effector.ry_urad_per_knm": _TURNING,
    "end_effector.rz_urad_per_knm": _TURNING,
    "elastic.mass_kg": Window.of(0.1, 2000.0, 0.02, 5000.0),
    "tcp.x_mm": _PLACE,
    "tcp.y_mm": _PLACE,
    "tcp.z_mm": _PLACE,
    "tcp.a_deg": _TURNED,
    "tcp.b_deg": _TURNED,
    "tcp.c_deg": _TURNED,
    "part.x_mm": Window.of(2.0, 4000.0, _ANY, 10e3),
    "part.y_mm": Window.of(2.0, 4000.0, _ANY, 10e3),
    "part.z_mm": Window.of(2.0, 4000.0, _ANY, 10e3),
    "part.a_deg": _TURNED,
    "part.b_deg": _TURNED,
    "part.c_deg": _TURNED,
    "part.datum_points_mm": Window.of(0.5, 2000.0, _ANY, 10e3),
    "stock.box_min_mm": Window.of(0.5, 2000.0, _ANY, 10e3),
    "stock.box_max_mm": Window.of(0.5, 2000.0, _ANY, 10e3),
    "tools.diameter_mm": Window.of(0.3, 200.0, 0.1, 400.0),
    "tools.corner_radius_mm": Window.of(0.02, 100.0, 0.002, 200.0),
    "tools.flute_length_mm": Window.of(0.5, 250.0, 0.1, 500.0),
    "tools.helix_deg": Window.of(1.0, 60.0, _ANY, 80.0),
    "tools.spindle_rpm": Window.of(50.0, 80e3, 10.0, 200e3),
    "tools.runout_um": Window.of(0.5, 200.0, 0.05, 1000.0),
    "material.kc11_n_mm2": Window.of(10.0, 6000.0, 1.0, 20e3),
    "material.ktc_n_mm2": Window.of(10.0, 10e3, 1.0, 20e3),
    "material.krc_n_mm2": Window.of(1.0, 10e3, 0.1, 20e3),
    "material.mc": Window.of(0.02, 0.9, 0.005, 1.0),
    "material.mr": Window.of(0.02, 0.9, 0.005, 1.0),
    "material.ma": Window.of(0.02, 0.9, 0.005, 1.0),
    "material.kr_over_kc": _SHARE,
    "material.ka_over_kc": _SHARE,
    "posture.rotation_about_tool_deg": _TURNED,
    "controller.cycle_ms": Window.of(0.25, 100.0),
    "controller.blending_mm": Window.of(0.005, 20.0, 0.001, 100.0),
    "controller.acceleration_mm_s2": Window.of(20.0, 20e3, 10.0, 50e3),
    "controller.rapid_mm_s": Window.of(5.0, 3000.0, 1.0, 10e3),
    "dynamics.mode_hz": Window.of(2.0, 100.0, 0.5, 300.0),
    "dynamics.damping_ratio": Window.of(0.003, 1.0, 0.001, 2.0),
    "dynamics.correction_smoothing_ms": Window.of(0.5, 500.0, 0.1, 1000.0),
    "dynamics.correction_lead_ms": Window.of(0.1, 150.0, 0.01, 500.0),
    "limits.correction_mm": Window.of(0.05, 20.0, 0.01, 50.0),
    "limits.correction_deg": Window.of(0.01, 10.0, 0.002, 20.0),
    "limits.joint_margin_deg": Window.of(0.05, 60.0, 0.005, 90.0),
    "limits.wrist_singularity_deg": Window.of(0.1, 60.0, 0.01, 90.0),
    "sensor.mass_kg": _MASS,
    "sensor.range_n": Window.of(20.0, 50e3, 2.0, 500e3),
    "sensor.range_nm": Window.of(1.0, 10e3, 0.1, 100e3),
    "online.correction_mm": Window.of(0.05, 10.0, 0.01, 50.0),
    "online.correction_deg": Window.of(0.01, 5.0, 0.002, 20.0),
    "online.speed_mm_s": Window.of(0.5, 500.0, 0.05, 5000.0),
    "online.acceleration_mm_s2": Window.of(10.0, 50e3, 1.0, 200e3),
    "online.ramp_mm_s": Window.of(0.05, 100.0, 0.01, 1000.0),
    "online.corner_hz": Window.of(0.1, 100.0, 0.01, 100.0),
    "online.natural_hz": Window.of(0.3, 100.0, 0.1, 500.0),
    "online.damping": Window.of(0.05, 3.0, 0.01, 10.0),
    "online.threshold_n": Window.of(2.0, 2000.0, 0.2, 20e3),
    "online.blend_ms": Window.of(2.0, 2000.0, 1.0, 5000.0),
    "online.lead_ms": Window.of(0.5, 500.0, 0.05, 1000.0),
    "online.dead_ms": Window.of(0.5, 500.0, 0.05, 1000.0),
    "online.tracker_step_um": Window.of(0.5, 1000.0, 0.05, 5000.0),
    "online.torque_per_current_nm": Window.of(2.0, 2000.0, 0.05, 1e5),
    "online.torque_noise_nm": Window.of(1.0, 1000.0, 0.02, 1e4),
}
"""By the table and key, without the numbers of lists."""

_PLACES: Final = frozenset(
    (
        *(f"{table}.{axis}_mm" for table in ("end_effector", "tcp", "part") for axis in "xyz"),
        *(f"end_effector.com_{axis}_mm" for axis in "xyz"),
        *("part.datum_points_mm", "stock.box_min_mm", "stock.box_max_mm"),
    )
)
"""Components of places: one alone may be near zero."""
_AXES: Final = frozenset(f"{axis}_mm" for axis in "xyz")
_OFFSETS: Final = frozenset(f"end_effector.com_{axis}_mm" for axis in "xyz")
"""Components that are near zero by design, whatever their digits."""
_TYPED_DECIMALS: Final = 2
"""Decimals of a length that was typed in m: 0.24; a small offset that was measured has more: 0.117."""
_OWN: Final = "identified"  # Beginning of the source of what an identification wrote
_WRITTEN: Final = re.compile(
    r"com_[xyz]_mm|mass_kg|.*_um_per_kn|.*_urad_per_knm|dead_band_half_urad|friction_nm|slip_urad|speed_gain_nm_s|"
    r"position_gain_per_s|integral_time_ms|k[tra]c.*|kc11_n_mm2|k[ra]_over_kc|m[cra]"
)
"""Keys of such tables that an identification writes."""

_OTHER: Final[dict[str, tuple[tuple[float, str], ...]]] = {
    "mm": ((1.0 / MM, "m"), (INCH / MM, "inches"), (UM / MM, "um")),
    "um": ((MM / UM, "mm"), (1.0 / UM, "m")),
    "deg": ((1.0 / DEG, "rad"),),
    "urad": ((1.0 / URAD, "rad"), (MRAD / URAD, "mrad"), (DEG / URAD, "deg")),
    "kg": ((GRAM, "g"), (1.0 / GRAM, "t")),
    "ms": ((1.0 / MS, "s"), (US / MS, "us")),
    "hz": ((1.0 / _TURN, "rad/s"),),
    "per_s": ((1.0 / MS, "1/ms"), (1.0 / MINUTE, "1/min")),
    "nm": ((N_MM, "N mm"), (KN, "kN m")),
    "nm_s": ((N_MM, "N mm s"), (KN, "kN m s"), (1.0 / DEG, "N m s/deg")),
    "n": ((KN, "kN"), (STANDARD_GRAVITY, "kgf")),
    "n_mm2": ((KN, "GPa"), (1.0 / N_PER_MM2, "N/m2")),
    "mm_s": ((1.0 / MM, "m/s"), (1.0 / MINUTE, "mm/min")),
    "mm_s2": ((1.0 / MM, "m/s2"),),
    "um_per_kn": ((1.0 / UM_PER_KN, "m/N"), (MM / UM_PER_KN, "mm/N"), (UM / UM_PER_KN, "um/N")),
    "urad_per_knm": (
        (1.0 / URAD_PER_KNM, "rad/(N m)"),
        (DEG / URAD_PER_KNM, "deg/(N m)"),
        (URAD / URAD_PER_KNM, "urad/(N m)"),
    ),
}
"""By the unit of a key: what a number is multiplied with that was meant in another unit, and that unit."""


@dataclass(frozen=True)
class Unusual:
    """A number outside of its window."""

    key: str  # Where it stands, as in the file: ``robot.play[1].friction_nm[3]``
    value: float  # In the unit of the key
    low: float  # End of the window that it should lie in
    high: float
    hint: str  # Which unit it may be in, or empty
    refused: bool  # It lies where no milling cell lies

    def sentence(self) -> str:
        """One line."""
        hint = f"; {self.hint}" if self.hint else ""
        return f"{self.key} = {self.value:g} is unusual: {self.low:g} to {self.high:g} are{hint}"


def unusual(tables: CellTables) -> list[Unusual]:
    """Numbers of a cell file outside of their windows, those that are refused first."""
    identified = [value.value for table in tables.identified for value in table.values]
    values = tables.model_dump(exclude_unset=True, exclude={"identified", "calibration"})
    own = set(_own(values))
    numbers = list(_numbers(values))
    largest: dict[str, float] = {}
    for key, _, value in numbers:
        largest[_place(key)] = max(abs(value), largest.get(_place(key), 0.0))
    results = []
    for key, name, value in numbers:
        window = WINDOWS.get(_held_the_other_way(name) if tables.part_on == "flange" else name)
        one = None if window is None else _outside(key, name, value, window, largest[_place(key)])
        if one is not None and (one.refused or key not in own) and not _is_among(value, identified):
            results.append(one)
    known = own | {one.key for one in results}
    unlike = [one for one in _unlike_axes(values) if one.key not in known and not _is_among(one.value, identified)]
    return sorted([*unlike, *results], key=lambda one: not one.refused)


def _is_among(value: float, identified: Sequence[float]) -> bool:
    return any(math.isclose(value, other, rel_tol=_ROUNDED) for other in identified)


def _outside(key: str, name: str, value: float, window: Window, largest: float) -> Unusual | None:
    """A number outside of its window; None inside, and for a component of a place that may be near zero.

    Args:
        largest: Magnitude of the largest component of the place.
    """
    size, unit = abs(value), _unit(name)
    typed = name not in _OFFSETS and round(size, _TYPED_DECIMALS) == size
    if size == 0.0 or (name in _PLACES and not typed and size < window.low <= largest):
        return None
    radian = unit == "deg" and _is_radian(size)
    if window.low <= size <= window.high and not radian:
        return None
    refused = not window.least <= size <= window.most
    low, high = (window.least, window.most) if refused else (window.low, window.high)
    return Unusual(key, value, low, high, "is it in rad?" if radian else _unit_hint(size, window, unit), refused)


def _held_the_other_way(name: str) -> str:
    """The key that says what this one says where the robot holds the part: tool and part change their places."""
    table, _, key = name.partition(".")
    return f"{'part' if table == 'tcp' else 'tcp'}.{key}" if name in _SWAPPED else name


def require_units(tables: CellTables, where: str) -> None:
    """Refuse a cell file with a number that no milling cell has.

    Raises:
        FileFormatError: One line: key, value, limit, likely unit.
    """
    results = [one for one in unusual(tables) if one.refused]
    if not results:
        return
    first = results[0]
    more = f" ({len(results) - 1} more like it)" if len(results) > 1 else ""
    raise FileFormatError(
        f"'{first.key.rsplit('.', 1)[-1].split('[')[0]}' is in another unit, or mistyped{more}",
        where=f"{where}: {first.key}",
        value=f"{first.value:g}",
        limit=f"magnitude {first.low:g} to {first.high:g}",
        hint=first.hint[:1].upper() + first.hint[1:] if first.hint else None,
    )


def _numbers(table: Any, path: str = "", name: str = "") -> Iterator[tuple[str, str, float]]:
    """Every number with its place, its table and key, and its value."""
    if isinstance(table, dict):
        for key, value in table.items():
            yield from _numbers(value, f"{path}.{key}" if path else key, f"{name.rsplit('.', 1)[-1]}.{key}")
    elif isinstance(table, list | tuple):
        for k, value in enumerate(table, start=1):
            yield from _numbers(value, f"{path}[{k}]", name)
    elif isinstance(table, int | float) and not isinstance(table, bool):
        yield path, name, float(table)


def _unlike_axes(table: Any, path: str = "") -> Iterator[Unusual]:
    """Elements of which one rotational compliance is far from the others: the one farthest from their median."""
    if isinstance(table, list | tuple):
        for k, value in enumerate(table, start=1):
            yield from _unlike_axes(value, f"{path}[{k}]")
        return
    if not isinstance(table, dict):
        return
    for key, value in table.items():
        yield from _unlike_axes(value, f"{path}.{key}" if path else key)
    turns = {key: abs(table[key]) for key in _TURNS if isinstance(table.get(key), int | float) and table[key] != 0.0}
    if len(turns) < 2 or max(turns.values()) <= _RATIO * min(turns.values()):
        return
    middle = sorted(turns.values())[len(turns) // 2]
    odd = max(turns, key=lambda key: abs(math.log(turns[key] / middle)))
    others = [value for key, value in turns.items() if key != odd]
    yield Unusual(f"{path}.{odd}", table[odd], max(others) / _RATIO, min(others) * _RATIO, _AMONG, refused=False)


def _place(key: str) -> str:
    """Return what components belong together: the table, and the keys that say one place in it."""
    table, _, last = key.rpartition(".")
    stem = re.sub(r"\[\d+\]", "", last)
    if stem.startswith("box"):
        return f"{table}.box"
    return f"{table}.{'com' if stem.startswith('com') else 'place' if stem in _AXES else stem}"


def _own(table: Any, path: str = "") -> Iterator[str]:
    """Keys of numbers that an identification wrote, by the source that it gave their table."""
    if isinstance(table, dict):
        own = str(table.get("source", "")).startswith(_OWN)
        for key, value in table.items():
            place = f"{path}.{key}" if path else key
            if own and _WRITTEN.fullmatch(key):
                yield from (at for at, _, _ in _numbers(value, place, key))
            else:
                yield from _own(value, place)
    elif isinstance(table, list | tuple):
        for k, value in enumerate(table, start=1):
            yield from _own(value, f"{path}[{k}]")


def _unit(name: str) -> str:
    """Unit at the end of a key."""
    return max((unit for unit in _OTHER if name.endswith(f"_{unit}")), key=len, default="")


def _unit_hint(size: float, window: Window, unit: str) -> str:
    for factor, other in _OTHER.get(unit, ()):
        if window.low <= size * factor <= window.high:
            return f"is it in {other}?"
    return ""


def _is_radian(size: float) -> bool:
    """Return whether an angle is a whole number of twelfths of pi: 1.5708 is a right angle in rad, not in deg."""
    twelfths = size * 12.0 / math.pi
    return 0.5 < twelfths < 24.5 and abs(twelfths - round(twelfths)) < _SAME and size != round(size, 1)
