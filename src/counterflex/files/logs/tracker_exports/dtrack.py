"""Recorded text output of ART DTrack2, an optical tracker of 6-D targets: lines ``fr``, ``ts``, ``6d``, ``3d``.

``6d N [id qu][x y z eta theta phi][b0 .. b8]``: position in mm, rotation matrix by columns; qu = -1: not visible.
``3d N [id qu][x y z]``: single markers. ``ts``: seconds since midnight UTC. Of each line the first
target counts.

Source: DTrack2 user manual, "Output of measurement data via Ethernet" (B.2).
"""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from counterflex.core.errors import FileFormatError
from counterflex.core.units import MM, NS
from counterflex.files.logs.tracker_exports.stamps import number
from counterflex.geometry import pose
from counterflex.protocols.tracker.telegram import BEAM_BROKEN, NO_ORIENTATION, TrackerPose

_BLOCK: Final = re.compile(r"\[([^\[\]]*)\]")
_TURNED: Final = 1e-3


class DTrackLines:
    """Reads the output line by line.

    Args:
        where: For messages.
    """

    def __init__(self, where: str) -> None:
        self._where, self._row = where, 0
        self._time_ns: int | None = None

    @property
    def ready(self) -> bool:
        """Whether what stands before the measurements has come."""
        return self._time_ns is not None

    def measured(self, line: str, sequence: int = 0) -> TrackerPose | None:
        """The pose of a line ``6d`` or ``3d``; None for the others.

        Raises:
            FileFormatError: A pose before a time stamp, blocks that are missing, a matrix that is no rotation.
        """
        self._row += 1
        where = f"{self._where}:{self._row}"
        word, _, rest = line.lstrip("\ufeff").strip().partition(" ")
        if word == "ts":
            self._time_ns = round(number(rest, where) / NS)
        if word not in ("6d", "3d"):
            return None
        blocks = [block.split() for block in _BLOCK.findall(rest)]
        if not blocks:
            return None
        if self._time_ns is None:
            raise FileFormatError("a pose before the first time stamp", where=where, hint="Switch the output of ts on")
        sizes = [2, 6, 9] if word == "6d" else [2, 3]
        if [len(block) for block in blocks[: len(sizes)]] != sizes:
            raise FileFormatError("blocks of a target", where=where, value=rest[:60], limit=f"{sizes} numbers")
        values = [np.array([number(text, where) for text in block]) for block in blocks[: len(sizes)]]
        seen = values[0][1] >= 0.0
        R = np.eye(3)
        if word == "6d" and seen:
            R = values[2].reshape(3, 3).T
            if float(np.abs(R @ R.T - np.eye(3)).max()) > _TURNED or float(np.linalg.det(R)) < 0.0:
                raise FileFormatError("the matrix of a target is no rotation", where=where, value=rest[:60])
            u, _, vt = np.linalg.svd(R)
            R = u @ vt
        status = (0 if word == "6d" else NO_ORIENTATION) | (0 if seen else BEAM_BROKEN)
        frame_id = int(values[0][0])
        T = pose.make(R, values[1][:3] * MM)
        return TrackerPose(sequence & 0xFFFFFFFF, self._time_ns, status, frame_id, T, 0.0)
