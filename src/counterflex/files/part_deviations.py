"""Deviations of a measured part, and the error of the path behind them, Parquet.

Deviations (``counterflex-part-deviations``, version 1): one row per measured place. Error of the path
(``counterflex-path-error``, version 1): one row per path point.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import MM, UM
from counterflex.evaluate.inspection.part_deviations import PartDeviations
from counterflex.evaluate.path_error.learning import MeasuredError
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

_ERROR_KIND: Final = "counterflex-path-error"
_ERROR_VERSION: Final = 1

_ERROR_LAYOUT: Final = (
    *columns("taken_x_um taken_y_um taken_z_um", "taken_m", UM),
    *columns("error_x_um error_y_um error_z_um", "error_m", UM),
    *columns("sigma_x_um sigma_y_um sigma_z_um", "sigma_m", UM),
    *(Column(f"seen_{axis}", "seen", i, whole=True) for i, axis in enumerate("xyz")),
)


@dataclass(frozen=True)
class MeasuredPart:
    """Source of a part's deviations: the metadata of the file."""

    program: str  # Name of the program that made the part
    program_sha256: str  # Hash of that program's bytes, hexadecimal
    source: str  # Name of the file that was measured
    unit: str  # Unit of the lengths in that file
    # Names of the faces that placed the scan on the nominal part; empty where it was given in the part frame
    datum_faces: tuple[str, ...]
    residual_um: float  # Root mean square of the distances of the scan to the datum faces after registration, um

    @classmethod
    def of(cls, about: dict[str, Any], where: str) -> MeasuredPart:
        """The metadata of a file, checked key by key."""
        kinds = {"program": str, "program_sha256": str, "source": str, "unit": str, "datum_faces": list}
        for key, kind in kinds.items():
            if not isinstance(about.get(key), kind):
                raise FileFormatError(f"the metadata lack a valid {key}", where=where, value=repr(about.get(key))[:60])
        residual, faces = about.get("residual_um"), about["datum_faces"]
        if isinstance(residual, bool) or not isinstance(residual, int | float) or not residual >= 0.0:
            raise FileFormatError(
                "the metadata lack a valid residual_um", where=where, value=repr(residual), limit=">= 0"
            )
        if not all(isinstance(face, str) for face in faces):
            raise FileFormatError("a datum face in the metadata has no name", where=where, value=repr(faces)[:60])
        names = {key: about[key] for key in ("program", "program_sha256", "source", "unit")}
        return cls(**names, datum_faces=tuple(faces), residual_um=float(residual))


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
    return deviations, MeasuredPart.of(about, str(path))


def write_path_error(path: Path, error: MeasuredError, about: Mapping[str, Any]) -> None:
    """Write the error of a path, whole or not at all."""
    write(path, _ERROR_KIND, _ERROR_VERSION, _ERROR_LAYOUT, error, about)


def read_path_error(path: Path) -> tuple[MeasuredError, dict[str, Any]]:
    """Read the error of a path and its metadata."""
    data, about = read(path, _ERROR_KIND, _ERROR_VERSION, _ERROR_LAYOUT)
    data["seen"] = data["seen"] != 0
    return MeasuredError(**data), about
