"""Other ways to read the same data: what a laboratory's file may mean when it does not mean what its manifest says.

Each :class:`AlternativeReading` changes one thing in a dataset: the unit, a sign, the order of columns or rows, the
hand of the axes. :mod:`counterflex.identify.data.manifest_checks` tries them; none is ever applied to what is
identified.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Final

import numpy as np

from counterflex.core import units
from counterflex.core.arrays import Float, Int
from counterflex.geometry import rotation
from counterflex.identify.data.channels import CHANNELS
from counterflex.identify.data.dataset import Dataset

Change = Callable[[Dataset], Dataset]

_OTHER_UNITS: Final = {
    "m": (("mm", units.MM), ("um", units.UM)),
    "rad": (("deg", units.DEG),),
    "N": (("kN", units.KN),),
    "N m": (("N mm", units.N_MM), ("kN m", units.KN)),
}
"""Units that are taken for the SI unit, or the SI unit for them, with their SI value."""


@dataclass(frozen=True)
class AlternativeReading:
    """One other way to read a dataset."""

    channel: str  # the channel it concerns
    says: str  # what would be the case, as a clause: `'q' is in deg, stated as rad`
    remedy: str  # what to change in the manifest or the file if so
    change: Change  # makes the dataset as it would then be


def unit_mistakes(data: Dataset, channel: str) -> tuple[AlternativeReading, ...]:
    """Lengths 1000 times too large or small, deg for rad, kN for N, N mm for N m, for the parts of a like unit."""
    out = []
    for unit, places in _parts(data, channel).items():
        part = _part_name(data, channel, places)
        for other, size in _OTHER_UNITS.get(unit, ()):
            times = max(size, 1.0 / size)
            too = f"{times:.0f}" if times > 100.0 else f"{times:.3g}"
            large, small = ("large", "small") if size < 1.0 else ("small", "large")
            out.append(
                AlternativeReading(
                    channel,
                    f"{part} is {too} times too {large} ({other} read as {unit})",
                    f'write unit = "{other}" under [channels.{channel}]',
                    _scaled(channel, places, size),
                )
            )
            out.append(
                AlternativeReading(
                    channel,
                    f"{part} is {too} times too {small} ({unit} read as {other})",
                    f'write unit = "{unit}" under [channels.{channel}]',
                    _scaled(channel, places, 1.0 / size),
                )
            )
    return tuple(out)


def sign_mistakes(data: Dataset, channel: str, *, single: bool = True) -> tuple[AlternativeReading, ...]:
    """The sign of the whole channel, of each part of a like unit, and (``single``) of each component."""
    count = data.values(channel).shape[1]
    sets = {tuple(range(count))} | {tuple(p) for p in _parts(data, channel).values()}
    if single:
        sets |= {(i,) for i in range(count)}
    out = []
    for places in sorted(sets, key=lambda s: (-len(s), s)):
        factor = np.ones(count)
        factor[list(places)] = -1.0
        out.append(
            AlternativeReading(
                channel,
                f"the sign of {_part_name(data, channel, places)} is reversed",
                _sign_remedy(channel, factor),
                _times(channel, factor),
            )
        )
    return tuple(out)


def swapped_columns(data: Dataset, channel: str) -> tuple[AlternativeReading, ...]:
    """Any two components of like unit exchanged."""
    out = []
    for places in _parts(data, channel).values():
        for i, j in combinations(places, 2):
            order = np.arange(data.values(channel).shape[1])
            order[[i, j]] = j, i
            out.append(
                AlternativeReading(
                    channel,
                    f"columns {_component(channel, i)} and {_component(channel, j)} of '{channel}' are swapped",
                    f"put columns = [...] under [channels.{channel}] in the right order",
                    _ordered(channel, order),
                )
            )
    return tuple(out)


def left_handed(
    points: Sequence[str], rotations: Sequence[str] = (), *, free_frame: bool = True
) -> tuple[AlternativeReading, ...]:
    """One axis of the measuring frame mirrored: a left-handed frame, in positions and orientations alike.

    Args:
        points: Channels (n, 3) in that frame.
        rotations: Channels (n, 3, 3) in that frame.
        free_frame: The recipe finds the frame anyway: then the mirrored axis makes no difference, and one reading is
            enough. False gives one for each axis.
    """
    names = " and ".join(f"'{c}'" for c in (*points, *rotations))
    remedy = "export from a right-handed frame, or turn the sign of one axis in the file"
    if free_frame:
        text = f"{names} are in a left-handed frame"
        return (AlternativeReading(points[0], text, remedy, _mirrored(points, rotations, 1)),)
    return tuple(
        AlternativeReading(
            points[0],
            f"{names} are in a left-handed frame (axis {name} points the other way)",
            remedy,
            _mirrored(points, rotations, axis),
        )
        for axis, name in enumerate("xyz")
    )


def inverted_pose(point: str, rotation: str) -> AlternativeReading:
    """The pose given the other way round: the tracker in the target."""
    return AlternativeReading(
        point,
        f"'{point}' and '{rotation}' are given the other way round (inverse poses)",
        "invert the poses, or map them to the channels of the inverse pose",
        partial(_inverted, point, rotation),
    )


def _inverted(point: str, rotation: str, d: Dataset) -> Dataset:
    R = np.swapaxes(d.values(rotation), 1, 2)
    return _with(_with(d, point, -np.einsum("nij,nj->ni", R, d.values(point))), rotation, R)


def transposed(rotation: str) -> AlternativeReading:
    """Rotation matrices transposed: rows read as columns, or the inverse rotation."""
    return AlternativeReading(
        rotation,
        f"the rotations '{rotation}' are transposed",
        f"check the order of the columns and rotation = ... under [channels.{rotation}]",
        lambda d: _with(d, rotation, np.ascontiguousarray(np.swapaxes(d.values(rotation), 1, 2))),
    )


def quaternion_mistakes(channel: str) -> tuple[AlternativeReading, ...]:
    """The real part of quaternions read as first for last, and the reverse."""
    return tuple(
        AlternativeReading(
            channel,
            f"the quaternions '{channel}' are in the order {actual}, not {read}",
            f'check the order of the columns, or write rotation = "quat_{actual}" under [channels.{channel}]',
            partial(_rolled_quaternions, channel, shift),
        )
        for read, actual, shift in (("xyzw", "wxyz", -1), ("wxyz", "xyzw", 1))
    )


def _rolled_quaternions(channel: str, shift: int, d: Dataset) -> Dataset:
    # Read as (w, x, y, z) or (x, y, z, w); the same numbers in the other order.
    return _with(d, channel, rotation.from_quat_wxyz(np.roll(rotation.quat_wxyz(d.values(channel)), shift, -1)))


def row_mistakes(channel: str) -> tuple[AlternativeReading, ...]:
    """The rows of one channel in reversed order, or off by one against the others."""
    remedy = "bring the rows of the files into the same order, or join them by a common column"
    return (
        AlternativeReading(
            channel,
            f"the rows of '{channel}' are in reversed order",
            remedy,
            lambda d: _with(d, channel, np.ascontiguousarray(d.values(channel)[::-1])),
        ),
        AlternativeReading(channel, f"'{channel}' comes one row late", remedy, partial(_shifted, channel, -1)),
        AlternativeReading(channel, f"'{channel}' comes one row early", remedy, partial(_shifted, channel, 1)),
    )


def _shifted(channel: str, by: int, d: Dataset) -> Dataset:
    """One channel moved by a row against the others, without the row that comes from the other end."""
    # The row that comes round from the other end belongs to nothing and would spoil a reading that is right.
    row = np.arange(len(d))
    return _with(d, channel, np.roll(d.values(channel), by, axis=0)).rows(row > 0 if by > 0 else row < len(d) - 1)


def other_axes(channel: str, R_of: Callable[[Dataset], Float], text: str, remedy: str) -> AlternativeReading:
    """The three-vectors of a channel given in other axes than stated.

    ``channel``: (n, 3) or (n, 6): each half is a vector. ``R_of``: Rotation (n, 3, 3) from the axes they would be in to
    those stated: ``v_stated = R v``. ``text``: As in :class:`AlternativeReading`: ``'w_tcp_base' is in the axes of the
    sensor``.
    """
    return AlternativeReading(channel, text, remedy, partial(_in_axes, channel, R_of))


def _in_axes(channel: str, R_of: Callable[[Dataset], Float], d: Dataset) -> Dataset:
    v = d.values(channel)
    turned = np.einsum("nij,nhj->nhi", R_of(d), v.reshape(len(v), -1, 3))
    return _with(d, channel, turned.reshape(v.shape))


def _parts(data: Dataset, channel: str) -> dict[str, list[int]]:
    """Places of the components by SI unit."""
    count = data.values(channel).shape[1]
    kind = CHANNELS.get(channel)
    units = (data.channel(channel).unit,) * count if kind is None else kind.si_units(count)
    out: dict[str, list[int]] = {}
    for i, unit in enumerate(units):
        out.setdefault(unit, []).append(i)
    return out


def _component(channel: str, place: int) -> str:
    kind = CHANNELS.get(channel)
    return str(place + 1) if kind is None else kind.components[place]


def _part_name(data: Dataset, channel: str, places: Sequence[int]) -> str:
    if len(places) == data.values(channel).shape[1]:
        return f"'{channel}'"
    return f"'{channel}' ({', '.join(_component(channel, i) for i in places)})"


def _sign_remedy(channel: str, factor: Float) -> str:
    nature = CHANNELS[channel].nature if channel in CHANNELS else "scalars"
    if nature in ("wrench", "vector") and np.all(factor < 0.0):
        return f'write acts_on = "surroundings" under [channels.{channel}] if it is what the tool does to them'
    signs = ", ".join(f"{int(s)}" for s in factor)
    return f"write signs = [{signs}] under [channels.{channel}] if the file counts the other way"


def _with(data: Dataset, channel: str, values: Float, sigma: Float | None = None) -> Dataset:
    old = data.channel(channel)
    return replace(
        data,
        channels={**data.channels, channel: replace(old, values=values, sigma=old.sigma if sigma is None else sigma)},
    )


def _scaled(channel: str, places: Sequence[int], size: float) -> Change:
    def change(d: Dataset) -> Dataset:
        old = d.channel(channel)
        factor = np.ones(old.values.shape[1])
        factor[list(places)] = size
        return _with(d, channel, old.values * factor, None if old.sigma is None else old.sigma * factor)

    return change


def _times(channel: str, factor: Float) -> Change:
    return lambda d: _with(d, channel, d.values(channel) * factor)


def _ordered(channel: str, order: Int) -> Change:
    def change(d: Dataset) -> Dataset:
        old = d.channel(channel)
        return _with(d, channel, old.values[:, order], None if old.sigma is None else old.sigma[:, order])

    return change


def _mirrored(points: Sequence[str], rotations: Sequence[str], axis: int) -> Change:
    flip = np.ones(3)
    flip[axis] = -1.0

    def change(d: Dataset) -> Dataset:
        for p in points:
            d = _with(d, p, d.values(p) * flip)
        for r in rotations:
            d = _with(d, r, d.values(r) * flip[:, None] * flip)
        return d

    return change
