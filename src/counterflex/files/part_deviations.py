"""Deviations of a measured part (``counterflex-part-deviations``, version 1): one row per measured place, Parquet."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import MM, UM
from counterflex.evaluate.inspection.part_deviations import PartDeviations
from counterflex.files.parquet_table import Column, columns, read, write
from counterflex.files.summary_file import require_whole

KIND: Final = "counterflex-part-deviations"
VERSION: Final = 1

LAYOUT: Final = (
    *columns("x_mm y_mm z_mm", "points", MM),
    *columns("nx ny nz", "normals"),
    Column("deviation_um", "deviation_m", unit=UM),
    Column("standard_deviation_um", "standard_deviation_m", unit=UM),
    Column("face", "face", whole=True),
)


@dataclass(frozen=True)
class MeasuredPart:
    """What a part's deviations come from: the metadata of the file."""

    program: str  # Name of the program that made the part
    program_sha256: str  # Hash of that program's bytes, hexadecimal
    source: str  # Name of the file that was measured
    unit: str  # Unit of the lengths in that file
    # Names of the faces that placed the scan on the nominal part; empty where it was given in the part frame
    datum_faces: tuple[str, ...]
    residual_um: float  # Root mean square of the distances of the scan to the datum faces after registration, um


def write_part_deviations(path: Path, deviations: PartDeviations, part: MeasuredPart) -> None:
    """Write the deviations of a part, whole or not at all. Raises OutputError: the folder cannot be written."""
    write(path, KIND, VERSION, LAYOUT, deviations, asdict(part))


def read_part_deviations(path: Path) -> tuple[PartDeviations, MeasuredPart]:
    """Read the deviations of a part, in SI, and what they come from."""
    data, about = read(path, KIND, VERSION, LAYOUT)
    require_whole(path.parent)
    try:
        deviations = PartDeviations(**data)
    except InputError as fault:
        raise FileFormatError(str(fault), where=str(path)) from fault
    return deviations, _measured_part(about, str(path))


def _measured_part(about: dict[str, Any], where: str) -> MeasuredPart:
    """The metadata of a file, checked key by key."""
    kinds = {"program": str, "program_sha256": str, "source": str, "unit": str, "datum_faces": list}
    for key, kind in kinds.items():
        if not isinstance(about.get(key), kind):
            raise FileFormatError(f"the metadata lack a valid {key}", where=where, value=repr(about.get(key))[:60])
    residual, faces = about.get("residual_um"), about["datum_faces"]
    if isinstance(residual, bool) or not isinstance(residual, int | float) or not residual >= 0.0:
        raise FileFormatError("the metadata lack a valid residual_um", where=where, value=repr(residual), limit=">= 0")
    if not all(isinstance(face, str) for face in faces):
        raise FileFormatError("a datum face in the metadata has no name", where=where, value=repr(faces)[:60])
    names = {key: about[key] for key in ("program", "program_sha256", "source", "unit")}
    return MeasuredPart(**names, datum_faces=tuple(faces), residual_um=float(residual))
