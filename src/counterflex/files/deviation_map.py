"""Deviations of a measured part for viewers of other makers: a point cloud with scalar fields, PLY or VTK (VTP)."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core import atomic
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.evaluate.inspection.part_deviations import FACES, PartDeviations
from counterflex.geometry import pose

FRAMES: Final = {"part": "part frame", "base": "base of the robot"}
"""Frames of a map, and their words in the file."""
_TYPES: Final = {"f4": ("float", "Float32"), "f8": ("double", "Float64"), "u1": ("uchar", "UInt8")}


def about(frame: str) -> tuple[str, str]:
    """Lines that a map says about itself."""
    faces = ", ".join(f"{number} = {name}" for number, name in enumerate(FACES))
    return (
        "deviation_mm: actual minus nominal along the outward normal, positive = material left, mm",
        f"points on the nominal surface, {FRAMES[frame]}, mm; face: {faces}",
    )


def _fields(deviations: PartDeviations) -> Mapping[str, Float]:
    """Scalar fields by name."""
    return {
        "deviation_mm": (deviations.deviation_m / MM).astype("<f4"),
        "standard_deviation_mm": (deviations.standard_deviation_m / MM).astype("<f4"),
        "face": deviations.face.astype("u1"),
    }


def _ply(deviations: PartDeviations, remarks: tuple[str, str]) -> bytes:
    columns = dict(zip(("x", "y", "z"), (deviations.points / MM).astype("<f8").T, strict=True))
    columns |= zip(("nx", "ny", "nz"), deviations.normals.astype("<f4").T, strict=True)
    columns |= _fields(deviations)
    head = ["ply", "format binary_little_endian 1.0", *(f"comment {line}" for line in remarks)]
    head.append(f"element vertex {len(deviations)}")
    head += [f"property {_TYPES[values.dtype.str[1:]][0]} {name}" for name, values in columns.items()]
    rows = np.empty(len(deviations), [(name, values.dtype) for name, values in columns.items()])
    for name, values in columns.items():
        rows[name] = values
    return "\n".join([*head, "end_header\n"]).encode("ascii") + rows.tobytes()


def _array(name: str, values: np.ndarray[Any, Any], kind: str = "") -> str:
    """An array as VTK reads it: its bytes behind their number, in base 64."""
    data = np.ascontiguousarray(values).tobytes()
    text = base64.b64encode(len(data).to_bytes(8, "little") + data).decode("ascii")
    parts = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    kind = kind or _TYPES[values.dtype.str[1:]][1]
    return f'<DataArray type="{kind}" Name="{name}"{parts} format="binary">{text}</DataArray>'


def _vtp(deviations: PartDeviations, remarks: tuple[str, str]) -> bytes:
    count = len(deviations)
    codes = " ".join(str(code) for code in [*"; ".join(remarks).encode("ascii"), 0])
    fields = [_array(name, values) for name, values in _fields(deviations).items()]
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64"><PolyData>',
        f'<FieldData><Array type="String" Name="about" NumberOfTuples="1" format="ascii">{codes}</Array></FieldData>',
        f'<Piece NumberOfPoints="{count}" NumberOfVerts="{count}" NumberOfLines="0" NumberOfStrips="0" '
        'NumberOfPolys="0">',
        '<PointData Scalars="deviation_mm" Normals="normal">',
        *fields,
        _array("normal", deviations.normals.astype("<f4")),
        "</PointData><Points>",
        _array("points", (deviations.points / MM).astype("<f8")),
        "</Points><Verts>",  # a point is drawn where it is a cell
        _array("connectivity", np.arange(count, dtype="<i8"), "Int64"),
        _array("offsets", np.arange(1, count + 1, dtype="<i8"), "Int64"),
        "</Verts></Piece></PolyData></VTKFile>\n",
    ]
    return "\n".join(lines).encode("ascii")


_MAKERS: Final[Mapping[str, Callable[[PartDeviations, tuple[str, str]], bytes]]] = {".ply": _ply, ".vtp": _vtp}


def require_format(path: Path) -> None:
    """Refuse a name that says no format. Raises InputError: it ends otherwise."""
    if path.suffix.lower() not in _MAKERS:
        raise InputError(
            "no such format", where=str(path), value=path.suffix or "no ending", limit=" or ".join(_MAKERS)
        )


def write_deviation_map(
    path: Path, deviations: PartDeviations, T_frame_part: Float | None = None, frame: str = "part"
) -> None:
    """Write deviations as points with scalar fields, whole or not at all; the ending chooses the format.

    Args:
        T_frame_part: Pose of the axes of the deviations in the frame of the map; None: they are the same.
        frame: Name of the frame of the map, of :data:`FRAMES`.
    """
    require_format(path)
    if T_frame_part is not None:
        points, normals = pose.transform(T_frame_part, deviations.points), deviations.normals @ T_frame_part[:3, :3].T
        deviations = replace(deviations, points=points, normals=normals)
    atomic.write_bytes(path, _MAKERS[path.suffix.lower()](deviations, about(frame)))
