"""The sensors of a measuring frame in a manifest: ``[[sensors]]``, ``settings.sensor_axes`` and their readings."""

from __future__ import annotations

from collections import Counter
from typing import Final

import numpy as np

from counterflex.core.errors import FileFormatError
from counterflex.core.units import MM
from counterflex.files.dataset.manifest import Manifest
from counterflex.identify.data.measuring_frame import SensorFrame

AXES: Final = ("tcp", "base", "frame")
KIND: Final = "pulls"
_CHANNELS: Final = ("s_unloaded", "s_loaded")


def sensor_frame(manifest: Manifest, where: str) -> SensorFrame | None:
    """Sensors that a manifest describes, or None where it has none.

    Args:
        manifest: Read.
        where: Its path, for messages.

    Raises:
        FileFormatError: Sensors without readings or readings without sensors, another number of them, a name twice,
            axes that are not said, another kind of dataset.
    """
    read = [name for name in _CHANNELS if name in manifest.channels]
    tables = manifest.sensors
    if not tables and not read:
        return None
    if manifest.kind != KIND:
        raise FileFormatError(
            "sensors of a measuring frame are read in pulls only",
            where=f"{where}: kind",
            value=manifest.kind,
            limit=KIND,
        )
    if not tables:
        raise FileFormatError(
            "the sensors of these distances are not described",
            where=f"{where}: channels.{read[0]}",
            hint="Describe each in a table [[sensors]]: name, position_mm, direction; say sensor_axes in [settings]",
        )
    for name in _CHANNELS:
        if name not in manifest.channels:
            raise FileFormatError(
                f"the dataset has no channel '{name}'",
                where=where,
                hint=f"Map it: [channels.{name}] columns = [...]; gauges set to zero before the load: s_unloaded with "
                "constant = [0, ...]",
            )
        table = manifest.channels[name]
        count = len(table.columns) if table.constant is None else len(table.constant)
        if count != len(tables):
            raise FileFormatError(
                "every sensor has one column, in the order of [[sensors]]",
                where=f"{where}: channels.{name}",
                value=f"{count} columns",
                limit=f"{len(tables)} ({', '.join(t.name for t in tables)})",
            )
    twice = [name for name, count in Counter(t.name for t in tables).items() if count > 1]
    if twice:
        raise FileFormatError("two sensors have the same name", where=f"{where}: sensors", value=twice[0])
    axes = manifest.settings.get("sensor_axes")
    if axes not in AXES:
        raise FileFormatError(
            "the axes of the sensor positions are not stated" if axes is None else "there are no such axes",
            where=f"{where}: settings.sensor_axes",
            value=None if axes is None else repr(axes),
            limit=", ".join(AXES),
            hint='"tcp": those of the unloaded tool, from its tip (the frame is put up anew at each pose); "base": '
            'those of the robot base; "frame": its own, with channels p_base_frame and R_base_frame',
        )
    direction = np.array([t.direction for t in tables], dtype=np.float64)
    normal = np.array([t.normal if t.normal is not None else [-v for v in t.direction] for t in tables])
    point = np.array([t.point_mm if t.point_mm is not None else (np.nan,) * 3 for t in tables])
    return SensorFrame(
        names=tuple(t.name for t in tables),
        position=np.array([t.position_mm for t in tables], dtype=np.float64) * MM,
        direction=direction / np.linalg.norm(direction, axis=1, keepdims=True),
        normal=normal / np.linalg.norm(normal, axis=1, keepdims=True),
        point=point * MM,
        axes=str(axes),
        where=f"{where}: sensors",
    )
