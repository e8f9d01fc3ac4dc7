"""What an identified cell is worth: programs planned with it, machined on the truth it was measured on, judged."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.campaign.parameter_errors import parameter_errors
from counterflex.app.compensation.compensate import compensate
from counterflex.app.compensation.languages import write
from counterflex.app.inputs import read_job
from counterflex.app.long_jobs.step_cache import begin, fingerprint, finish, finished
from counterflex.app.proof import simulate
from counterflex.app.proof.exact import exact_setting
from counterflex.app.proof.judge import Reference, judge, reference_of
from counterflex.core import atomic
from counterflex.core.arrays import Float
from counterflex.core.progress import Progress, share_of, silent
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.summary import Variant
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.run_file import read_run
from counterflex.path.toolpath import FEED
from counterflex.plan.compensate import plan as make_plan
from counterflex.twin.truth.file import read_truth

POSES: Final = 16
"""Points of a program at which poses and deflections are compared with the truth."""


def compensated(program: str, cell_file: str, folder: str, *, progress: Progress = silent) -> dict[str, Any]:
    """Compensate a program with a cell, unless that was done before, telling the fraction done.

    Returns:
        ``prediction``: figures of the plan.
    """
    out = Path(folder)
    mark = fingerprint(program, cell_file, job="compensate")
    before = finished(out, mark)
    if before is not None:
        return before
    begin(out, mark)
    cell = read_cell(cell_file)
    result = compensate(program, cell, progress=progress)
    for name, text in result.files.items():
        atomic.write_bytes(out / name, text.encode(result.encoding, errors="replace"))
    figures = {"prediction": result.summary["prediction"]}
    finish(out, mark, figures)
    return figures


def compensated_exact(program: str, cell_file: str, truth_file: str, folder: str) -> dict[str, Any]:
    """Compensate a program with the truth's exact constants, unless that was done before."""
    out = Path(folder)
    mark = fingerprint(program, cell_file, truth_file, job="exact")
    before = finished(out, mark)
    if before is not None:
        return before
    begin(out, mark)
    cell = read_cell(cell_file)
    job = read_job(program, cell)
    setting = exact_setting(job, cell, read_truth(truth_file))
    plan = make_plan(job.path, job.line_of_motion, cell.stock(), setting, feeds=job.feeds, predict=False)
    for name, text in write(job, plan, cell, "gcode")[0].items():
        atomic.write_bytes(out / name, text.encode(job.program.encoding, errors="replace"))
    finish(out, mark, {})
    return {}


def machined(
    program: str, original: str, cell_file: str, truth_file: str, folder: str, *, progress: Progress = silent
) -> Variant:
    """Machine a program on a truth, unless that was done before, and judge it against the original.

    Progress is that of the machining, which takes nine tenths of the time.

    Returns:
        Its figures.
    """
    out = Path(folder)
    mark = fingerprint(program, original, cell_file, truth_file, job="simulate")
    if finished(out, mark) is None:
        begin(out, mark)
        machining = share_of(progress, 0.0, 0.9)
        simulate.run(program, cell_file, truth_file, out, original=original, progress=machining)
        finish(out, mark, {})
    run, _ = read_run(out / simulate.RUN)
    return judge(_reference(original, cell_file), run, HeightMap.load(out / simulate.SURFACE)).variant


@lru_cache(maxsize=1)
def _reference(original: str, cell_file: str) -> Reference:
    cell = read_cell(cell_file)
    return reference_of(read_job(original, cell), cell)


def compared(before: str, identified: str, truth_file: str, program: str | None) -> list[dict[str, Any]]:
    """The identified cell against the truth, at the joints of a program or, without one, around the part."""
    cell = read_cell(before)
    rows = parameter_errors(cell, read_cell(identified), read_truth(truth_file), _joints(cell, program))
    return [row.plain() for row in rows]


def _joints(cell: Cell, program: str | None) -> Float:
    """(n, 6) rad: at points spread over a program, or with the blank's corners and centre as the tool's places."""
    controller = simulate.controller(cell)
    if program is not None:
        path = read_job(program, cell).path
        feed = np.flatnonzero(path.kind == FEED)
        rows = feed[np.linspace(0, len(feed) - 1, POSES).round().astype(int)]
        return np.stack([controller.joints(path.p_part_tcp[[k]], path.axis_part[[k]])[0] for k in rows])
    stock = cell.stock()
    ny, nx = stock.z.shape
    x = stock.x0_m + stock.cell_m * (nx - 1) * np.array([0.0, 1.0, 0.0, 1.0, 0.5])
    y = stock.y0_m + stock.cell_m * (ny - 1) * np.array([0.0, 0.0, 1.0, 1.0, 0.5])
    p = np.stack([x, y, np.full(5, float(stock.z.max()))], axis=1)
    return np.stack([controller.joints(row[None], np.array([[0.0, 0.0, 1.0]]))[0] for row in p])
