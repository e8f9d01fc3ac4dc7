"""One channel of a dataset: from the columns of a manifest to SI values with standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import FileFormatError
from counterflex.core.units import DEG
from counterflex.files.dataset import units
from counterflex.files.dataset.cells import Cells, Pick, by_quantity, in_stated_unit, spread, unit_factors
from counterflex.files.dataset.manifest import COLUMNS_OF, REPEATS, ChannelTable, Manifest
from counterflex.files.dataset.rotation import faulty, matrices, rotation_sigma
from counterflex.geometry import rotation
from counterflex.identify.data.channels import CHANNELS, ChannelKind
from counterflex.identify.data.dataset import Channel

LARGEST: Final[dict[str, tuple[float, str]]] = {
    "m": (100.0, "100 m"),
    "rad": (4.0 * np.pi, "720 deg"),
    "N": (1e6, "1000 kN"),
    "N m": (1e6, "1000 kN m"),
    "degC": (1000.0, "1000 degC"),
}
"""Largest size of a value that is no unit mistake, by SI unit, and how it is said."""


def build(name: str, kind: ChannelKind, table: ChannelTable, manifest: Manifest, pick: Pick, n: int, where: str) -> Raw:
    """Read the numbers of a channel and check what the manifest says about them.

    Raises:
        FileFormatError: A wrong number of columns, a unit that is missing or not of this quantity, a frame, sign or
            convention that this channel cannot have.
    """
    _check_natures(kind, table, where)
    if table.constant is None:
        cells = pick(table.columns, f"{where}.columns")
    else:
        constant = np.array(table.constant, dtype=np.float64)
        names = tuple(f"constant [{i}]" for i in range(len(constant)))
        here = f"{where}.constant"
        none = (None,) * len(constant)
        cells = Cells(np.broadcast_to(constant, (n, len(constant))), names, none, lambda _row, _k: here)
    count = cells.values.shape[1]
    convention = table.rotation or ""
    if kind.nature == "rotation":
        expected: tuple[int, ...] = (COLUMNS_OF.get(convention, 3),)
    else:
        expected = kind.allowed
    if count not in expected:
        raise FileFormatError(
            f"the channel has {count} column{'s' if count > 1 else ''}",
            where=f"{where}.columns",
            limit=f"{' or '.join(map(str, expected))}: {kind.text}",
        )
    if table.factor is not None:
        cells = in_stated_unit(kind, table, count, cells, where)
    factors = unit_factors(kind, table, count, cells, where)
    extra = pick(table.sigma_columns, f"{where}.sigma_columns") if table.sigma_columns else None
    return Raw(name, kind, table, manifest, cells, extra, factors, where)


@dataclass(frozen=True, eq=False)
class Raw:
    """A channel as the file has it, before incomplete rows are dropped."""

    name: str
    kind: ChannelKind
    table: ChannelTable
    manifest: Manifest
    cells: Cells
    sigma: Cells | None
    factors: Float
    where: str

    @property
    def missing(self) -> Bool:
        """(n,) rows with a number missing."""
        gaps: Bool = np.isnan(np.concatenate([block.values for block in self._blocks], axis=1)).any(axis=1)
        return gaps

    def place_of_missing(self, row: int) -> str:
        """Place of the first missing number of a row, for messages."""
        gaps = [(block, np.isnan(block.values[row])) for block in self._blocks]
        return next((block.place(row, int(np.argmax(gap))) for block, gap in gaps if np.any(gap)), self.where)

    @property
    def _blocks(self) -> list[Cells]:
        return [self.cells] if self.sigma is None else [self.cells, self.sigma]

    def channel(self, keep: Bool, group: Int) -> Channel:
        """The channel in SI.

        Args:
            keep: (n,) rows to take.
            group: (kept,) ids of rows that belong together, for standard deviations from repeats.

        Raises:
            FileFormatError: A value that is a unit mistake or no rotation; a standard deviation that is not above
                zero or cannot be had from repeats.
        """
        rows = np.flatnonzero(keep)
        raw = self.cells.values[keep]
        numbers = self._joints(raw * self.factors[: raw.shape[1]] if self._has_unit() else raw)
        convention = self.table.rotation or ""
        if self.kind.nature == "rotation":
            if self._has_unit():
                self._check_size(numbers, raw, rows)
            bad, what = faulty(convention, numbers)
            if np.any(bad):
                row = int(np.argmax(bad))
                text = ", ".join(f"{value:g}" for value in raw[row])
                raise FileFormatError(what, where=self.cells.place(rows[row], 0), value=text, hint="Check the columns")
            values = matrices(convention, numbers)
        else:
            self._check_size(numbers, raw, rows)
            values = numbers
        values = self._framed(values)
        if self.table.acts_on == "surroundings":
            values = -values
        source = self._source()
        sigma, note = self._sigma(raw, numbers, values, rows, group)
        unit = " ".join(dict.fromkeys(self.kind.si_units(numbers.shape[1])))
        columns = self.cells.names if self.table.constant is None else ()
        stated = bool(self.table.coupling or self.table.signs or self.table.offsets_deg)
        return Channel(self.name, values, sigma, unit, source + note, columns, as_model=stated)

    def _source(self) -> str:
        return f"{self.where} ({', '.join(self.cells.names)})"

    def _has_unit(self) -> bool:
        return COLUMNS_OF.get(self.table.rotation or "", 3) == 3

    def _check_size(self, numbers: Float, raw: Float, rows: Int) -> None:
        broken = np.any(numbers != np.round(numbers), axis=1)
        if self.kind.whole and np.any(broken):
            row = int(np.argmax(broken))
            raise FileFormatError(
                "the value is not a whole number", where=self.cells.place(rows[row], 0), value=f"{raw[row, 0]:g}"
            )
        for k, si in enumerate(self.kind.si_units(numbers.shape[1])):
            if si not in LARGEST:
                continue
            limit, text = LARGEST[si]
            bad = np.abs(numbers[:, k]) > limit
            if np.any(bad):
                row = int(np.argmax(bad))
                raise FileFormatError(
                    "the value is too large for its unit",
                    where=self.cells.place(rows[row], min(k, len(self.cells.names) - 1)),
                    value=f"{raw[row, k]:g} {units.plain(self._unit_names()[k])}",
                    limit=f"at most {text}",
                    hint=f"Check unit in {self.where}, decimal and thousands marks",
                )

    def _unit_names(self) -> tuple[str, ...]:
        count = self.cells.values.shape[1]
        stated = self.table.unit or tuple(unit or "" for unit in self.cells.units)
        return spread(stated, self.kind, count)

    def _joints(self, numbers: Float) -> Float:
        table, count = self.table, numbers.shape[1]
        if table.coupling:
            numbers = numbers @ _square(table.coupling, count, self.where).T
        if table.signs:
            numbers = numbers * _listed("signs", table.signs, count, self.where)
        if table.offsets_deg:
            numbers = numbers + _listed("offsets_deg", table.offsets_deg, count, self.where) * DEG
        return numbers

    def _framed(self, values: Float) -> Float:
        if self.table.frame is None:
            return values
        T = self.manifest.frames[self.table.frame].matrix()
        R, p = T[:3, :3], T[:3, 3]
        if self.kind.nature == "rotation":
            return R @ values
        turned = [values[:, k : k + 3] @ R.T for k in range(0, values.shape[1], 3)]
        if self.kind.nature == "point":
            turned[0] = turned[0] + p
        return np.concatenate(turned, axis=1)

    def _sigma(self, raw: Float, numbers: Float, values: Float, rows: Int, group: Int) -> tuple[Float | None, str]:
        table, n = self.table, len(rows)
        count = 3 if self.kind.nature == "rotation" else numbers.shape[1]
        if table.sigma == REPEATS:
            return self._repeats(values, group)
        if table.sigma is None and self.sigma is None:
            return None, ""
        variance = np.zeros((n, count))
        scale = self._sigma_factors(count)
        if table.sigma is not None:
            sigma = np.array(table.sigma, dtype=np.float64)
            if len(sigma) not in (1, count, len(set(self.kind.si_units(count)))):
                raise FileFormatError(
                    "sigma has another number of values", where=self.where, value=len(sigma), limit=f"1 or {count}"
                )
            if len(sigma) == 1 and len(set(self.kind.si_units(count))) > 1:
                raise FileFormatError(
                    "one sigma cannot stand for two quantities",
                    where=f"{self.where}.sigma",
                    limit=f"one for each of {', '.join(dict.fromkeys(self.kind.si_units(count)))}, or {count}",
                )
            variance += self._turned(raw, by_quantity(sigma, self.kind, count) * scale * np.ones((n, count))) ** 2
        if self.sigma is not None:
            columns = self.sigma.values[rows]
            if columns.shape[1] not in (1, count):
                raise FileFormatError(
                    "sigma_columns has another number of columns",
                    where=self.where,
                    value=columns.shape[1],
                    limit=f"1 or {count}",
                )
            width = columns.shape[1]
            stated = (table.sigma_unit,) * width if table.sigma_unit else self._unit_names()[:width]
            self.sigma.check_headers(stated, self.kind.si_units(count)[:width], f"{self.where}.sigma_unit")
            bad = columns < 0.0 if table.sigma is not None else columns <= 0.0
            if np.any(bad):
                row, k = (int(i) for i in np.argwhere(bad)[0])
                raise FileFormatError(
                    "the standard deviation is not above zero",
                    where=self.sigma.place(int(rows[row]), k),
                    value=f"{columns[row, k]:g}",
                    hint="Give the least one as sigma = ... beside sigma_columns (the two add up as squares)",
                )
            variance += self._turned(raw, columns / table.sigma_coverage * scale * np.ones((n, count))) ** 2
        return np.sqrt(variance), ""

    def _sigma_factors(self, count: int) -> Float:
        if self.table.sigma_unit is None:
            return self.factors[:count]
        si = self.kind.si_units(count)
        return np.array([units.factor(self.table.sigma_unit, unit, f"{self.where}.sigma_unit") for unit in si])

    def _turned(self, raw: Float, sigma: Float) -> Float:
        """Standard deviations after what was done to the values: coupling, angles to a rotation vector, frame."""
        if self.table.coupling:
            A = _square(self.table.coupling, sigma.shape[1], self.where)
            sigma = np.sqrt(sigma**2 @ (A**2).T)
        if self.kind.nature == "rotation":
            numbers = raw * self.factors[:3] if self._has_unit() else raw
            sigma = rotation_sigma(self.table.rotation or "", numbers, sigma)
        if self.table.frame is not None:
            R = self.manifest.frames[self.table.frame].matrix()[:3, :3]
            parts = [np.sqrt(sigma[:, k : k + 3] ** 2 @ (R**2).T) for k in range(0, sigma.shape[1], 3)]
            sigma = np.concatenate(parts, axis=1)
        return sigma

    def _repeats(self, values: Float, group: Int) -> tuple[Float, str]:
        """Standard deviation pooled over the groups: ``s^2 = sum (x - mean of group)^2 / (rows - groups)``."""
        _, index, counts = np.unique(group, return_inverse=True, return_counts=True)
        dof = len(group) - len(counts)
        if dof < 1:
            raise FileFormatError(
                "there are no repeats to estimate the standard deviation from",
                where=f"{self.where}.sigma",
                value=f"{len(group)} rows in {len(counts)} groups",
                hint='Name the columns that repeats have in common: group = ["..."], or state sigma',
            )
        off = _from_group_mean(values, index, counts, self.kind.nature == "rotation")
        s = np.sqrt(np.sum(off**2, axis=0) / dof)
        if np.any(s <= 0.0):
            raise FileFormatError(
                "repeats are identical: their standard deviation is zero",
                where=f"{self.where}.sigma",
                value=f"component {int(np.argmax(s <= 0.0)) + 1}",
                hint="Rows were copied, or the resolution is too coarse; state sigma",
            )
        note = f"; standard deviation from repeats, {dof} degrees of freedom"
        return np.broadcast_to(s, off.shape).copy(), note


def _from_group_mean(values: Float, index: Int, counts: Int, turning: bool) -> Float:
    """Each row's difference from the mean of its group; for rotations the rotation vector of the difference."""
    flat = values.reshape(len(values), -1)
    total = np.zeros((len(counts), flat.shape[1]))
    np.add.at(total, index, flat)
    mean = (total / counts[:, None])[index]
    if not turning:
        out: Float = flat - mean
        return out
    U, _, Vt = np.linalg.svd(mean.reshape(-1, 3, 3))
    return rotation.log(values @ np.swapaxes(U @ Vt, 1, 2))


def _check_natures(kind: ChannelKind, table: ChannelTable, where: str) -> None:
    if (table.rotation is not None) != (kind.nature == "rotation"):
        if table.rotation is None:
            raise FileFormatError(
                "the convention of the rotation is missing",
                where=where,
                hint='Say rotation = "xyz_fixed", "xyz_intrinsic", "zyx_intrinsic", "rotation_vector", "quat_wxyz", '
                '"quat_xyzw" or "matrix"',
            )
        raise FileFormatError("the channel is no rotation", where=f"{where}.rotation", value=table.rotation)
    if (table.offsets_deg or table.coupling) and kind.nature != "joints":
        raise FileFormatError("offsets_deg and coupling are for joint angles", where=where)
    if table.signs and kind.nature == "rotation":
        raise FileFormatError("signs are for numbers, not for rotations", where=where)
    if table.acts_on == "surroundings" and kind.nature not in ("wrench", "vector"):
        raise FileFormatError("acts_on is for forces", where=where)
    if table.axes != "sensor" and kind is not CHANNELS["w_sensor"]:
        raise FileFormatError("axes is for w_sensor", where=f"{where}.axes", value=table.axes)
    if table.frame is not None and kind.nature in ("scalars", "joints"):
        raise FileFormatError("the channel has no frame", where=f"{where}.frame", value=table.frame)


def _listed(key: str, values: Sequence[float], count: int, where: str) -> Float:
    if len(values) != count:
        raise FileFormatError(f"{key} has {len(values)} values", where=f"{where}.{key}", limit=str(count))
    return np.array(values, dtype=np.float64)


def _square(rows: Sequence[Sequence[float]], count: int, where: str) -> Float:
    if len(rows) != count or any(len(row) != count for row in rows):
        raise FileFormatError(
            "coupling is no square matrix", where=f"{where}.coupling", limit=f"{count} rows of {count}"
        )
    return np.array(rows, dtype=np.float64)
