"""The instrumented holder that a cell says it has."""

from __future__ import annotations

from counterflex.core.errors import InputError, ModelError
from counterflex.identify.data.model import CellModel
from counterflex.sensing.strain_holder import StrainHolder


def holder_before(cell: CellModel) -> StrainHolder:
    """The holder before identification.

    Raises:
        InputError: The cell has none.
        ModelError: What the cell holds as its holder is none.
    """
    table = cell.tables.get("holder")
    if table is None:
        raise InputError(
            "the cell has no instrumented spindle holder",
            where=cell.name,
            hint="Add a table [holder] with its dimensions, [[holder.gauges]] and tcp_mm to the cell file",
        )
    if not isinstance(table, StrainHolder):
        raise ModelError("the holder of the cell is not a holder", value=type(table).__name__)
    return table
