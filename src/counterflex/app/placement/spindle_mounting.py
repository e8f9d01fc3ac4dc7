"""How the spindle is mounted: an angle of a body of the end effector, one of several that a shop can have.

Turning the body turns all beyond it, with its mass and its compliance; a shop has such choices as holders or shims.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from counterflex.core.errors import InputError
from counterflex.files.cell.cell import Cell, resolve


@dataclass(frozen=True)
class Mounting:
    """Angles to choose from."""

    body: str  # Name of a body of the end effector, or ``tcp``
    key: str  # ``a_deg``, ``b_deg`` or ``c_deg``
    values_deg: tuple[float, ...]  # Angles that can be had, besides the present one

    def present_deg(self, cell: Cell) -> float:
        """The angle that a cell file has. Raises InputError: the cell has no such body, or holds the part."""
        if self.body == "tcp":
            return float(getattr(cell.tables.tcp, self.key))
        for table in cell.tables.end_effector:
            if table.name == self.body:
                return float(getattr(table, self.key))
        raise InputError(
            "the end effector has no such body",
            where="--mounting",
            value=self.body,
            limit=", ".join([*(table.name for table in cell.tables.end_effector), "tcp"]),
        )

    def cell(self, cell: Cell, value_deg: float) -> Cell:
        """The cell with the spindle mounted at another angle."""
        tables = cell.tables
        change = {self.key: value_deg}
        if self.body == "tcp":
            tables = tables.model_copy(update={"tcp": tables.tcp.model_copy(update=change)})
        else:
            bodies = tuple(b.model_copy(update=change) if b.name == self.body else b for b in tables.end_effector)
            tables = tables.model_copy(update={"end_effector": bodies})
        return resolve(tables, Path(cell.path), assume_class=cell.class_stiffness is not None)
