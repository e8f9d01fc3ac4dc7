"""Tracker samples of a logged run, as the tracker had sent them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from counterflex.app.run.loop import tcp_target
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.logs.segments import read_log
from counterflex.geometry import pose
from counterflex.protocols.session.senses import tracker_frames
from counterflex.runtime.record_ring import COLUMNS
from counterflex.twin.devices.pose_source import TrackerLog


def run_log_as_tracker(folder: str | Path, cell: str | Path) -> TrackerLog:
    """The tracker's measurements that a run has logged, as the tracker had sent them.

    ``T_tracker_target = T_part_tracker^-1 T_part_tcp T_target_tcp^-1``; the log holds the tool in the part frame.

    Args:
        cell: Cell file with a ``[tracker]`` table: the one the run was made with.

    Raises:
        FileFormatError: No run log; no ``[tracker]`` table; no tracker was used in the run.
    """
    rows, _, _ = read_log(folder)
    fresh = rows[rows[:, COLUMNS.index("flag_tracker_new")] > 0.5]
    if len(fresh) == 0:
        raise FileFormatError("no tracker was used in this run", where=str(folder))
    T_part_tracker, T_target_tcp = _frames(read_cell(cell))
    place = COLUMNS.index("actual_R00")
    Ts_part_tcp = pose.make(fresh[:, place : place + 9].reshape(-1, 3, 3), fresh[:, place + 9 : place + 12])
    stamps = fresh[:, COLUMNS.index("received_ns")].astype(np.int64)
    keep = np.r_[True, np.diff(stamps) > 0]
    Ts: Float = pose.inverse(T_part_tracker) @ Ts_part_tcp @ pose.inverse(T_target_tcp)
    count = int(np.sum(keep))
    return TrackerLog(tuple(int(v) for v in stamps[keep]), Ts[keep], (0,) * count, (0.0,) * count)


def _frames(cell: Cell) -> tuple[Float, Float]:
    table = cell.tables.tracker
    if table is None:
        raise FileFormatError("the cell has no tracker", where=str(cell.path), hint="Add a table [tracker]")
    return tracker_frames(cell.T_base_part, table.T_base_tracker, tcp_target(cell, cell.chain))
