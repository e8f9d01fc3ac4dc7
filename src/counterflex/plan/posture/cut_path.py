"""The path as posture sees it: points, load, directions that matter; stations between which the tool may turn."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.path.toolpath import ToolPath
from counterflex.plan.undisturbed_cut import UndisturbedCut

Surface = Literal["both", "wall", "floor"]
"""Which machined surface must be true: the wall beside the feed, the floor below the tool, or both."""
_PARALLEL: Final = 1e-6


@dataclass(frozen=True, eq=False)
class CutPath:
    """n points of a program in the part frame, with the load of the undisturbed cut."""

    p_part: Float  # (n, 3) m, tool tips
    axis_part: Float  # (n, 3) unit vectors from the tip towards the spindle
    w_tcp_part: Float  # (n, 6) N, N m about the tip
    normals_part: Float  # (n, k, 3) unit vectors square to each other, normal to the machined surface; zero: nothing
    weight_m: Float  # (n,) m of path that the point stands for; 0 where no material is cut
    time_s: Float  # (n,) s, not decreasing
    run: Int  # (n,) number of the uninterrupted stretch of rapid or feed that the point belongs to, not decreasing

    def __len__(self) -> int:
        """Number of points."""
        return len(self.p_part)


def surface_normals(path: ToolPath, surface: Surface = "both") -> Float:
    """Normals of the surfaces that the tool leaves along a path.

    With t the direction of the feed and a the tool axis: the wall's is ``a x t``, the floor's ``t x (a x t)``, both
    normalised. Together they span what is square to the feed: their deflection is the path error of
    :mod:`counterflex.evaluate`. Where the tool moves along its axis, any two directions square to it.

    Args:
        path: n points.
        surface: Which surface matters.

    Returns:
        (n, k, 3) part axes, k = 2 for ``both``; zero where nothing moves.
    """
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    length = np.linalg.norm(step, axis=1, keepdims=True)
    t = step / np.where(length > 0.0, length, 1.0)
    aside = np.cross(path.axis_part, t)
    along_axis = np.linalg.norm(aside, axis=1) < _PARALLEL
    other = np.where(np.abs(t[:, :1]) < 0.9, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    aside = np.where(along_axis[:, None], np.cross(t, other), aside)
    size = np.linalg.norm(aside, axis=1, keepdims=True)
    wall = aside / np.where(size > 0.0, size, 1.0)
    chosen = {"both": (wall, np.cross(t, wall)), "wall": (wall,), "floor": (np.cross(t, wall),)}[surface]
    return np.stack(chosen, axis=1)


def cut_path(path: ToolPath, cut: UndisturbedCut, run: Int, surface: Surface = "both") -> CutPath:
    """The path of a program with its load.

    Args:
        path: n points.
        cut: Of the undisturbed tool along it.
        run: (n,) stretches of rapid and feed, :func:`counterflex.plan.inputs.feed_runs`.
        surface: Which surface matters.
    """
    length = np.linalg.norm(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]), axis=1)
    return CutPath(
        path.p_part_tcp,
        path.axis_part,
        cut.w_tcp_part,
        surface_normals(path, surface),
        np.where(cut.contact, length, 0.0),
        path.time_s,
        run,
    )


def stations(path: CutPath, apart_s: float, most: int) -> Int:
    """Rows between which the tool may turn by a step of the grid.

    Every stretch of rapid or feed is divided evenly in time, so that its edges last ``apart_s`` or a little longer; its
    ends are stations.

    Args:
        path: n >= 2 points.
        apart_s: Least time from station to station, s; a stretch that is shorter is one edge.
        most: Largest number of edges; they last longer where there would be more.

    Returns:
        (m + 1,) rows, rising, the first 0 and the last n - 1.
    """
    t, n = path.time_s, len(path)
    ends = np.flatnonzero(np.diff(path.run))
    bounds = np.unique(np.concatenate([[0], ends, [n - 1]]))
    apart_s = max(apart_s, float(t[-1] - t[0]) / most)
    rows = [bounds[:1]]
    for low, high in itertools.pairwise(bounds.tolist()):
        count = max(1, math.floor((t[high] - t[low]) / apart_s + 1e-9)) if apart_s > 0.0 else 1
        at = np.searchsorted(t[low : high + 1], np.linspace(t[low], t[high], count + 1)[1:-1]) + low
        rows.append(np.append(at, high))
    out: Int = np.unique(np.concatenate(rows))
    return out


def fractions(time_s: Float, rows: Int) -> Float:
    """(n,) how far each point lies along its edge in time, 0 < f <= 1; 1 at the first point, which ends no edge."""
    edge = np.maximum(np.searchsorted(rows, np.arange(len(time_s)), side="left") - 1, 0)
    begin, end = time_s[rows[edge]], time_s[rows[edge + 1]]
    span = end - begin
    place = (np.arange(len(time_s)) - rows[edge]) / (rows[edge + 1] - rows[edge])
    out: Float = np.where(span > 0.0, (time_s - begin) / np.where(span > 0.0, span, 1.0), place)
    out[rows] = 1.0
    return np.clip(out, 0.0, 1.0)


def in_contact(path: CutPath, rows: Int) -> Bool:
    """(m,) edges along which material is cut."""
    total = np.cumsum(path.weight_m)
    out: Bool = np.diff(total[rows]) > 0.0
    return out
