"""A language: a table of the commanded poses, for a controller that runs tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from counterflex.app.compensation.languages import WritingOrder, Written
from counterflex.core.units import DEG, MM
from counterflex.geometry import rotation
from counterflex.programs.language import Language


def write(order: WritingOrder) -> Written:
    """A line for each point: x y z in mm, a b c in deg (z-y'-x''), speed in mm/s."""
    T = order.Ts_part_tcp
    angles = np.array([rotation.to_zyx(R) for R in T[:, :3, :3]]) / DEG
    table = np.column_stack([T[:, :3, 3] / MM, angles, order.job.path.feed_m_s / MM])
    lines = [" ".join(f"{value:.4f}" for value in row) for row in table]
    name = Path(order.job.program.name).stem + ".poses"
    return {name: "\n".join(lines) + "\n"}, {"points": len(lines)}


LANGUAGE = Language(title="a table of poses", write=write)
