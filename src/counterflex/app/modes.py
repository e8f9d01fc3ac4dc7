"""The job `modes`: the modes of a cell as a table, and beside a tap test."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from counterflex.app.cell_modes import COUNT, PostureModes, modes_in
from counterflex.app.tap_test import UP_TO_HZ, beside_tap_test
from counterflex.core import atomic
from counterflex.core.progress import Progress, silent
from counterflex.core.units import DEG
from counterflex.files.cell.cell import read_cell
from counterflex.files.summary_file import write_summary
from counterflex.plan.modes import point_motion
from counterflex.report.modes_page import ModesData


def run(
    cell_file: str | Path,
    out: str | Path | None = None,
    *,
    joints_deg: list[float] | None = None,
    assume_class: bool = False,
    count: int = COUNT,
    tap_test: str | Path | None = None,
    up_to_hz: float | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """The modes of a cell; with ``out``, write ``summary.json`` and ``report.html`` there.

    Args:
        out: Folder, made when missing; None writes nothing.
        joints_deg: Six axes as the controller shows them, deg; None is at the blank.
        assume_class: Take the median of the robot's class for axes of unknown stiffness.
        tap_test: File of a tap test in this posture, or None.
        up_to_hz: Rows of it that count; None is :data:`counterflex.app.tap_test.UP_TO_HZ`.

    Raises:
        CounterflexError: The cell cannot be read, has no stiffness, or its blank is out of reach.
    """
    cell = read_cell(cell_file, assume_class=assume_class)
    q = None if joints_deg is None else cell.chain.axes.model(np.array(joints_deg) * DEG)
    done = modes_in(cell, q, count=count)
    if tap_test is not None:
        progress(0.2)
        done.summary["tap_test"] = beside_tap_test(done, tap_test, UP_TO_HZ if up_to_hz is None else up_to_hz)
    progress(1.0)
    if out is not None:
        from counterflex.report.page import write_page

        with atomic.atomic_folder(out) as staging:
            write_summary(staging / "summary.json", done.summary)
            write_page(page_data(done).page(), staging / "report.html")
    return done.summary


def page_data(done: PostureModes) -> ModesData:
    """Return what the page of the modes shows."""
    shapes = done.free.shapes[:, : len(done.summary["modes"])]
    points, moved = point_motion(done.chain, done.q, shapes)
    title, flange = f"Modes of {done.cell.label}", done.chain.flange_segment + 2
    return ModesData(done.summary, points, moved, flange, title, done.cell.robot.name)
