"""The measured path of the tool (``counterflex-tool-path``, version 1): one row per station, Parquet."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM, UM
from counterflex.files.parquet_table import Column, columns, write

KIND: Final = "counterflex-tool-path"
VERSION: Final = 1

LAYOUT: Final = (
    Column("time_s", "time_s"),
    Column("length_mm", "length_m", unit=MM),
    Column("line", "line", whole=True),
    *columns("x_mm y_mm z_mm", "nominal", MM),
    *columns("left_um axis_um along_um", "deviation_m", UM),
    *columns("floor_um wall_left_um wall_right_um", "normal_m", UM),
    Column("standard_deviation_um", "standard_deviation_m", unit=UM),
    Column("cutting", "cutting", whole=True),
)


@dataclass(frozen=True, eq=False)
class ToolPathRows:
    """Deviation of the tool from the program's path, part frame."""

    time_s: Float  # (k,) s, of the log
    length_m: Float  # (k,) m, place on the program's path
    line: Int  # (k,) line of the program
    nominal: Float  # (k, 3) m, nearest place of the program's path
    # (k, 3) m, actual minus nominal: to the left of the feed, along the tool's axis away from the part, along the feed
    # (nan: not known)
    deviation_m: Float
    # (k, 3) m, along the normals of the floor, the wall on the left and the wall on the right that the station makes,
    # positive = material left; nan where it makes none
    normal_m: Float
    # (k,) m, of a component across the feed: noise of the readings and uncertainty of a fitted frame
    standard_deviation_m: Float
    cutting: Int  # (k,) 1 where the tool cut, 0 where it did not, -1 where it is not known


@dataclass(frozen=True)
class LoggedPath:
    """Source of a path: the metadata of the file."""

    program: str
    program_sha256: str  # Hash of its bytes, hexadecimal
    source: str
    position: str  # Which position of the tool was logged, in words
    frame: str  # Frame that the log was in, in words
    frame_fitted: bool  # That frame was fitted to the program's path


def write_tool_path(path: Path, rows: ToolPathRows, logged: LoggedPath) -> None:
    """Write a measured path, whole or not at all. Raises OutputError: the folder cannot be written."""
    write(path, KIND, VERSION, LAYOUT, rows, asdict(logged))
