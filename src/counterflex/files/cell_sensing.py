"""Table ``[sensor]`` of a cell file: how its forces are measured, in shop units."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from counterflex.core.arrays import Float
from counterflex.core.units import MINUTE, MM
from counterflex.files.schema import PoseTable
from counterflex.robot.chain import ElasticChain
from counterflex.sensing.carrier import behind
from counterflex.sensing.flange_sensor import FlangeSensor

Three = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]
_HOUR = 60.0 * MINUTE
_SHAPE = "expected 0, 9 or 34 rows of six numbers"


class SensorTable(PoseTable):
    """The six-axis force sensor; its pose is that of the sensor frame in the body that carries it."""

    segment: Annotated[str, Field(min_length=1)]
    mass_kg: Annotated[float, Field(ge=0.0, le=5000.0)] | None = None
    com_mm: Three | None = None
    inertia_kg_m2: Six | None = None
    bias_n: Three = (0.0, 0.0, 0.0)
    bias_nm: Three = (0.0, 0.0, 0.0)
    drift_n_per_h: Three = (0.0, 0.0, 0.0)
    drift_nm_per_h: Three = (0.0, 0.0, 0.0)
    temperature_n_per_k: Three = (0.0, 0.0, 0.0)
    temperature_nm_per_k: Three = (0.0, 0.0, 0.0)
    reference_c: Annotated[float, Field(ge=-50.0, le=150.0)] = 20.0
    offset: tuple[Six, ...] = ()
    source: str = ""

    @model_validator(mode="after")
    def _both(self) -> Self:
        if (self.mass_kg is None) != (self.com_mm is None):
            raise ValueError("mass_kg and com_mm of what hangs behind the sensor belong together; give both or none")
        if len(self.offset) not in (0, 9, 34):
            raise ValueError(f"offset has {len(self.offset)} rows; {_SHAPE}")
        return self


def flange_sensor(table: SensorTable | None, chain: ElasticChain) -> FlangeSensor | None:
    """The sensor of a cell in SI.

    Args:
        table: Of the file; None where the cell has no sensor.
        chain: Of the cell: what the file does not say of mass and centre of gravity is that of the bodies behind.

    Returns:
        The sensor, or None.

    Raises:
        InputError: The end effector has no such body.
    """
    if table is None:
        return None
    T_seg_sensor = table.matrix()
    R, p = T_seg_sensor[:3, :3], T_seg_sensor[:3, 3]
    mass_kg, p_seg_com = behind(chain, table.segment)
    p_sensor_com: Float = R.T @ (p_seg_com - p)
    if table.mass_kg is not None and table.com_mm is not None:
        mass_kg, p_sensor_com = table.mass_kg, np.array(table.com_mm) * MM
    return FlangeSensor(
        segment=table.segment,
        T_seg_sensor=T_seg_sensor,
        mass_kg=mass_kg,
        p_sensor_com=p_sensor_com,
        w_bias=np.array([*table.bias_n, *table.bias_nm]),
        w_drift_per_s=np.array([*table.drift_n_per_h, *table.drift_nm_per_h]) / _HOUR,
        w_kelvin=np.array([*table.temperature_n_per_k, *table.temperature_nm_per_k]),
        reference_c=table.reference_c,
        w_offset=np.array(table.offset).reshape(-1, 6),
        inertia_kg_m2=np.array(table.inertia_kg_m2) if table.inertia_kg_m2 is not None else np.zeros(6),
    )


def sensing_of(sensor: SensorTable | None, chain: ElasticChain) -> dict[str, FlangeSensor]:
    """What measures forces in a cell, as objects, by the name of its table; nothing for tables that are not there.

    Args:
        sensor: Table of the flange sensor.
        chain: Of the cell.

    Raises:
        InputError: The end effector has no such body.
    """
    found = flange_sensor(sensor, chain)
    return {} if found is None else {"sensor": found}
