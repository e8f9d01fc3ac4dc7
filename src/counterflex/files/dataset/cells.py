"""Cells of some columns, and the SI value of one unit of each: what the manifest says, held against the headers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.dataset import units
from counterflex.files.dataset.manifest import COLUMNS_OF, ChannelTable
from counterflex.identify.data.channels import ChannelKind


@dataclass(frozen=True, eq=False)
class Cells:
    """Numbers of some columns for the rows of a dataset."""

    values: Float  # (n, k) as the file has them, NaN where there is none
    names: tuple[str, ...]
    units: tuple[str | None, ...]  # Unit that each header states, or None
    place: Callable[[int, int], str]  # Where the cell of column k in row n stands, for messages
    places: tuple[tuple[int, int], ...] = ()  # File and column of each; empty for constants

    def check_headers(self, stated: Sequence[str], si: Sequence[str], where: str, *, all_of_them: bool = True) -> None:
        """Refuse a unit that the header of a column contradicts.

        Args:
            stated: Unit of each column.
            si: SI unit of its quantity.
            all_of_them: Other units of the same quantity contradict too; False takes these as the unit.

        Raises:
            FileFormatError: Names unit and header.
        """
        if len(self.units) != len(stated):
            return
        for header, name, header_unit, s in zip(self.names, stated, self.units, si, strict=True):
            if header_unit is None or header_unit == units.plain(name):
                continue
            alike = header_unit in units.UNITS.get(s, {})
            if (alike and all_of_them) or header_unit in units.RAW or units.of_another_quantity(header, s):
                ignored = 'where the header is wrong, say header_units = "ignore" under [[files]]'
                raise FileFormatError(
                    "the unit is not the one in the header of the column",
                    where=where,
                    value=repr(name),
                    limit=f"{header_unit!r} as in '{header}'",
                    hint=f"How much {name} one {header_unit} is, is said by factor = ...; {ignored}"
                    if header_unit in units.RAW
                    else ignored.capitalize(),
                )


Pick = Callable[[Sequence[str | int], str], Cells]
"""Gives the cells of some columns; the second argument is the key of the manifest that names them."""


def in_stated_unit(kind: ChannelKind, table: ChannelTable, count: int, cells: Cells, where: str) -> Cells:
    """Cells in the unit of the manifest: counts or volts times the factor. What a header states is theirs."""
    if kind.nature == "rotation":
        raise FileFormatError("the channel is a rotation, which has no factor", where=f"{where}.factor")
    stated = by_quantity(np.array(table.factor, dtype=np.float64), kind, count)
    if len(stated) not in (1, count):
        raise FileFormatError(
            "factor has another number of values", where=f"{where}.factor", value=len(stated), limit=f"1 or {count}"
        )
    if len(stated) == 1 and len(set(kind.si_units(count))) > 1:
        raise FileFormatError(
            "one factor cannot stand for two quantities",
            where=f"{where}.factor",
            limit=f"one for each of {', '.join(dict.fromkeys(kind.si_units(count)))}, or {count}",
        )
    return replace(cells, values=cells.values * stated, units=(None,) * len(cells.units))


def _of_headers(kind: ChannelKind, table: ChannelTable, count: int, cells: Cells, where: str) -> Float:
    si = kind.si_units(count)
    plain_numbers = all(unit == "1" for unit in si)
    if COLUMNS_OF.get(table.rotation or "", 3) != 3 or (plain_numbers and kind.whole):
        return np.ones(count)
    if plain_numbers:  # "[um/m]" of a strain counts, "x_mm" of a direction is its name
        cells.check_headers(("1",) * count, si, where, all_of_them=False)
        own = [h if h in units.UNITS["1"] else "1" for h in cells.units]
        return np.array([units.factor(unit, "1", where) for unit in own])
    pairs = list(zip(cells.units, si, strict=True))
    if not all(unit in units.UNITS.get(s, {}) for unit, s in pairs):
        raise FileFormatError("the unit is missing", where=where, hint=_say_unit(kind.file_units(count), cells))
    return np.array([units.factor(str(unit), s, where) for unit, s in pairs])


def _say_unit(file_units: Sequence[str], cells: Cells) -> str:
    names = [f'"{name}"' for name in dict.fromkeys(file_units)]
    shown = names[0] if len(names) == 1 else f"[{', '.join(names)}]"
    raw = next((unit for unit in cells.units if unit in units.RAW), None)
    remark = f"; the header says {raw}: what one of them is, is said by factor = ..." if raw else ""
    return f"Say unit = {shown}, or whichever it is{remark}"


def unit_factors(kind: ChannelKind, table: ChannelTable, count: int, cells: Cells, where: str) -> Float:
    """SI value of one unit of each component, from the manifest or the headers."""
    count = 3 if kind.nature == "rotation" else count
    if table.unit is None:
        return _of_headers(kind, table, count, cells, where)
    si = kind.si_units(count)
    stated = spread(table.unit, kind, count)
    if len(stated) != count:
        raise FileFormatError(
            "unit has another number of values", where=f"{where}.unit", value=len(table.unit), limit=f"1 or {count}"
        )
    cells.check_headers(stated, si, f"{where}.unit")
    return np.array([units.factor(name, s, f"{where}.unit") for name, s in zip(stated, si, strict=True)])


def spread(stated: Sequence[str], kind: ChannelKind, count: int) -> tuple[str, ...]:
    """One unit for each component, from one for all, one for each quantity, or one for each."""
    quantities = list(dict.fromkeys(kind.si_units(count)))
    if len(stated) == len(quantities):
        return tuple(stated[quantities.index(si)] for si in kind.si_units(count))
    return tuple(stated)


def by_quantity(factors: Float, kind: ChannelKind, count: int) -> Float:
    """(count,) numbers from one for each quantity; other numbers of them as they are."""
    quantities = list(dict.fromkeys(kind.si_units(count)))
    if len(factors) == len(quantities) and count != len(factors):
        return np.array([factors[quantities.index(si)] for si in kind.si_units(count)])
    return factors
