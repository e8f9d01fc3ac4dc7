"""The measured path of the tool (``counterflex-tool-path``, version 1): one row per station, Parquet."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM, UM
from counterflex.files.parquet_table import Column, columns, read, write

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
    """Deviation of the tool from the program's path, part frame.

    Attributes:
        time_s: (k,) s, of the log.
        length_m: (k,) m, place on the program's path.
        line: (k,) line of the program.
        nominal: (k, 3) m, nearest place of the program's path.
        deviation_m: (k, 3) m, actual minus nominal: to the left of the feed, along the tool's axis away from the part,
            along the feed (nan: not known).
        normal_m: (k, 3) m, along the normals of the floor, the wall on the left and the wall on the right that the
            station makes, positive = material left; nan where it makes none.
        standard_deviation_m: (k,) m, of a component across the feed: noise of the readings and uncertainty of a fitted
            frame.
        cutting: (k,) 1 where the tool cut, 0 where it did not, -1 where it is not known.
    """

    time_s: Float
    length_m: Float
    line: Int
    nominal: Float
    deviation_m: Float
    normal_m: Float
    standard_deviation_m: Float
    cutting: Int


@dataclass(frozen=True)
class LoggedPath:
    """What a path comes from: the metadata of the file.

    Attributes:
        program_sha256: Hash of its bytes, hexadecimal.
        position: Which position of the tool was logged, in words.
        frame: Frame that the log was in, in words.
        frame_fitted: That frame was fitted to the program's path.
    """

    program: str
    program_sha256: str
    source: str
    position: str
    frame: str
    frame_fitted: bool


def write_tool_path(path: Path, rows: ToolPathRows, logged: LoggedPath) -> None:
    """Write a measured path, whole or not at all. Raises OutputError: the folder cannot be written."""
    write(path, KIND, VERSION, LAYOUT, rows, asdict(logged))


def read_tool_path(path: Path) -> tuple[ToolPathRows, dict[str, Any]]:
    """Read a measured path, in SI, and its metadata."""
    data, about = read(path, KIND, VERSION, LAYOUT)
    return ToolPathRows(**data), about
