"""Options that the commands of standards share."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.core.errors import InputError

FORMATS = ("counterflex", "spatial-analyzer", "point-table", "dtrack")
"""Names of the formats of exports, as the readers have them; here because the command line loads no reader."""

_NAMED = ("as-measured", "fit")


def frame_of(param: arguments.Param, value: str | None) -> str | None:
    """Check that it can be a frame, before anything is loaded."""
    if value is None:
        return None
    words = value.split(",")
    if value in _NAMED or value.endswith(".toml") or (len(words) == 6 and all(map(_finite, words))):
        return value
    raise InputError(
        "no frame",
        where=param.opts[0],
        value=value,
        limit="as-measured, fit, a cell file (.toml) or X,Y,Z,A,B,C of the tracker in the frame of the commands, "
        "mm and deg",
    )


def _finite(text: str) -> bool:
    """Whether it is a number."""
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


Files = Annotated[
    list[Path],
    argument(
        "Tracker logs, exports (--format) or datasets (.toml of kind pose_test or path_test).",
        arguments.file,
        "FILE...",
    ),
]
FrameOf = Annotated[
    str,
    option(
        "--frame",
        "Where the tracker stands in the frame of the commands: as-measured, a cell file with [tracker], "
        "X,Y,Z,A,B,C (mm, deg), or fit: found from the readings (accuracies then leave out what a frame absorbs).",
        frame_of,
        "FRAME",
    ),
]
Format = Annotated[
    str, option("--format", f"Of the files: {', '.join(FORMATS)}.", arguments.one_of(FORMATS, "format"), "NAME")
]
Average = Annotated[
    float,
    option(
        "--average-ms",
        "Filter: moving mean over the readings of a log, ms; 0: none.",
        arguments.between(0.0, 10_000.0),
        "MS",
    ),
]
Out = Annotated[
    Path | None,
    option(
        "--out",
        "Folder for report.html, tables (CSV, Parquet) and summary.json; made when missing.",
        arguments.output_folder,
        "DIR",
    ),
]
