"""The flange sensor that a cell says it has, or the one its first body stands for."""

from __future__ import annotations

import numpy as np

from counterflex.core.errors import InputError, ModelError
from counterflex.identify.data.model import CellModel
from counterflex.sensing.carrier import mass_behind
from counterflex.sensing.flange_sensor import FlangeSensor


def sensor_before(cell: CellModel) -> FlangeSensor:
    """The sensor before identification: of the cell, or in the body named ``sensor`` with its axes.

    Raises:
        InputError: The cell names no sensor and no body of its end effector is called so.
        ModelError: What the cell holds as its sensor is none.
    """
    table = cell.tables.get("sensor")
    if isinstance(table, FlangeSensor):
        return table
    if table is not None:
        raise ModelError("the sensor of the cell is not a sensor", value=type(table).__name__)
    chain = cell.chain
    name = next((s.name for s in cell.end_effector.segments if "sensor" in s.name), None)
    if name is None:
        raise InputError(
            "the cell has no force sensor",
            where=cell.name,
            limit=", ".join(s.name for s in cell.end_effector.segments) or "no body in the end effector",
            hint='Add a table [sensor] with segment = "NAME OF THE BODY THAT CARRIES IT" to the cell file',
        )
    mass_kg, p_seg_com = mass_behind(chain, name)
    return FlangeSensor(name, np.eye(4), mass_kg, p_seg_com)
