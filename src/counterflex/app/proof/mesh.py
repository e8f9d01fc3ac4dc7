"""The job ``mesh``: the machined part and the one it should be as meshes, and how far its walls are off."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from counterflex import __version__
from counterflex.app.inputs import Job
from counterflex.app.proof import simulate
from counterflex.app.proof.cut_logs import log_of_path, log_of_run, top_of, undisturbed_columns
from counterflex.core import atomic
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.next_command import next_command
from counterflex.core.progress import Progress, silent
from counterflex.core.units import MM, UM
from counterflex.cutting.tridexel.columns import ColumnStock
from counterflex.cutting.tridexel.surface import Surface, surface
from counterflex.files.cell.cell import Cell
from counterflex.files.parquet_table import Column, columns, write
from counterflex.files.summary_file import read_run, read_summary, write_summary

NOMINAL, MACHINED, POINTS, SUMMARY = "nominal.stl", "machined.ply", "points.parquet", "summary.json"
FORMAT = "counterflex-surface-points"


def run(folder: str | Path, out: str | Path, *, range_m: float, progress: Progress = silent) -> dict[str, Any]:
    """Do the job on files.

    Writes ``nominal.stl`` (what the original program makes), ``machined.ply`` (what was made, in the colours of its
    deviation), ``points.parquet`` (exact points of the machined surface with their deviation) and ``summary.json``, in
    the part frame.

    Args:
        folder: Of ``simulate``.

    Raises:
        InputError: The folder holds no machined program, or its surface has too many points.
        FileFormatError: A file of it is missing or damaged.
    """
    source = Path(folder)
    if not (source / simulate.RUN).is_file():
        raise InputError(
            "no machined program in this folder",
            where=str(source),
            limit=f"{simulate.RUN} and the files beside it",
            hint=f"{next_command('simulate', 'PROGRAM', cell='CELL', truth='TRUTH', out='DIR')} makes one",
        )
    cell = simulate.read_cell_of(source)
    job = simulate.read_original(source, cell)
    machined, (tops, columns_left) = read_run(source / simulate.RUN)[0], simulate.read_part(source)
    top = top_of(cell, job.path.p_part_tcp, machined.p_part_tcp)
    nominal, actual = log_of_path(job.path, cell, top), log_of_run(machined, job.path, cell, top)
    progress(0.1)
    should_be = surface(undisturbed_part(job, cell), nominal)
    progress(0.4)
    made = surface(ColumnStock.of(tops) if columns_left is None else columns_left, actual)
    progress(0.7)
    deviation = np.full(len(made.points), np.nan)
    deviation[made.cut] = -nominal.distance(made.points[made.cut])
    R = np.eye(3) if cell.R_part_plane is None else cell.R_part_plane
    summary = _figures(made, deviation) | {
        "program": read_summary(source / simulate.SUMMARY).get("original", ""),
        "cell": cell.name,
        "counterflex": __version__,
    }
    with atomic.atomic_folder(out) as staging:
        should_be.turned(R).save(staging / NOMINAL)
        made.turned(R).save(staging / MACHINED, made.at_vertices(deviation), range_m)
        points = _MeshPoints(made.turned(R).points[made.cut], made.along[made.cut], deviation[made.cut])
        write(staging / POINTS, FORMAT, 1, _LAYOUT, points, {"program": summary["program"], "cell": cell.name})
        write_summary(staging / SUMMARY, summary)
    progress(1.0)
    return summary


def undisturbed_part(job: Job, cell: Cell) -> ColumnStock:
    """The part that a program would give if nothing bent, as columns."""
    if cell.tool_turns:
        return undisturbed_columns(job.path, cell)
    return ColumnStock.of(simulate.undisturbed(job, cell))


def _figures(made: Surface, deviation: Float) -> dict[str, Any]:
    """Deviation of what was cut, by the direction of the lines: floors along z, walls along x and y."""
    out: dict[str, Any] = {"job": "mesh", "points": len(made.points), "triangles": len(made.triangles)}
    for name, which in (("walls", made.along < 2), ("floors", made.along == 2)):
        values = np.abs(deviation[which & ~np.isnan(deviation)]) / UM
        out[name] = {
            "points": len(values),
            "p50_um": round(float(np.percentile(values, 50.0)), 3) if len(values) else None,
            "p997_um": round(float(np.percentile(values, 99.7)), 3) if len(values) else None,
            "max_um": round(float(values.max()), 3) if len(values) else None,
        }
    return out


@dataclass(frozen=True, eq=False)
class _MeshPoints:
    """Points that a cut made: (n, 3) m, the axis of their line, m material left."""

    points: Float
    along: Int
    deviation: Float


_LAYOUT = (
    *columns("x_mm y_mm z_mm", "points", MM),
    Column("line", "along", whole=True),
    Column("deviation_um", "deviation", unit=UM),
)
