"""Pulls: displacement of the tool under known loads, read from datasets into one form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import FileFormatError, InputError
from counterflex.geometry import pose
from counterflex.identify.data.dataset import Dataset
from counterflex.robot.elasticity.chain import ElasticChain, forward

AGAIN: Final = "approached again"
"""Under load the pose was left and approached again the same way, so that dry friction is the same in both states."""
HELD_SETTING: Final = "held"
"""The load came on while the axes were held still."""
RELAXED: Final = "relaxed"
"""Before each reading, small dying movements of the axes shook the friction out."""
HISTORIES: Final = (AGAIN, HELD_SETTING, RELAXED)


@dataclass(frozen=True, eq=False)
class Pulls:
    """Loads and displacements of n rows."""

    name: str  # of the dataset
    q: Float  # (n, 6) rad, what the controller shows
    w_tcp_base: Float  # (n, 6) N, N m, load on the tool about the TCP in base axes
    w_sigma: Float  # (n, 6) its standard deviation
    d: Float  # (n, k) m (and rad), displacement of the measured point, loaded minus unloaded; k is 3 or 6
    d_sigma: Float  # (n, k)
    in_tracker: bool  # the displacement is written in the axes of the tracker, else in base axes
    p_tcp_measured: Float  # (3,) m, the measured point in the frame of the TCP
    approach: Float | None  # (n, 6) rad, from where each pose was reached (angles there minus `q`), or None
    history: str  # AGAIN, HELD_SETTING, RELAXED or empty where it is not known
    group: Int  # (n,) rows that belong together
    line: Int  # (n,) line of the file
    where: str  # of the file, for messages

    def __len__(self) -> int:
        return len(self.group)


def read_pulls(chain: ElasticChain, data: Dataset, p_tcp_target: Float | None = None) -> Pulls:
    """Pulls of a dataset.

    Args:
        chain: The cell's, for the lever arms of points beside the TCP.
        data: Kind ``pulls`` with ``q``; ``w_tcp_base`` or ``f_tcp_base``; ``d_tcp_base`` (base axes) or
            ``d_tracker_target`` (tracker axes). Settings: ``p_tcp_load_m`` where the cable pulls and
            ``p_tcp_measured_m`` what point was measured, both in the frame of the TCP (default: the TCP itself);
            ``history``.
        p_tcp_target: (3,) m, where the tracker's target sits in the frame of the TCP: the measured point of
            ``d_tracker_target`` where the dataset does not say another.

    Raises:
        FileFormatError: A channel is missing or without standard deviation, a setting makes no sense.
    """
    q, w, w_sigma = read_load(chain, data)
    in_tracker = not data.has("d_tcp_base") and data.has("d_tracker_target")
    moved = data.channel("d_tracker_target" if in_tracker else "d_tcp_base")
    history, approach = read_path(data)
    if len(q) == 0:
        raise InputError("the dataset has no rows", where=data.where)
    return Pulls(
        name=data.name,
        q=q,
        w_tcp_base=w,
        w_sigma=w_sigma,
        d=moved.values,
        d_sigma=moved.need_sigma(),
        in_tracker=in_tracker,
        p_tcp_measured=_point(data, "p_tcp_measured_m", p_tcp_target if in_tracker else None),
        approach=approach,
        history=history,
        group=data.group,
        line=data.line,
        where=data.where,
    )


def read_load(chain: ElasticChain, data: Dataset) -> tuple[Float, Float, Float]:
    """Poses (n, 6) rad, loads about the TCP in base axes (n, 6) N, N m, and their standard deviations.

    Raises FileFormatError: a channel is missing, or ``p_tcp_load_m`` is no point.
    """
    q = data.values("q")
    if data.has("w_tcp_base"):
        load = data.channel("w_tcp_base")
        w, w_sigma = load.values, np.zeros_like(load.values) if load.sigma is None else load.sigma
    else:
        load = data.channel("f_tcp_base")
        none = np.zeros_like(load.values)
        w, w_sigma = np.hstack([load.values, none]), np.hstack([none if load.sigma is None else load.sigma, none])
    lever = (forward(chain, q)[:, :3, :3] @ _point(data, "p_tcp_load_m")[:, None])[..., 0]
    return q, pose.shift_wrench(w, lever), w_sigma


def read_path(data: Dataset) -> tuple[str, Float | None]:
    """Motion of the axes between the readings: history, and approach (n, 6) rad or None.

    Raises FileFormatError: there is no such history, or it lacks the approach.
    """
    history = str(data.settings.get("history", ""))
    if history and history not in HISTORIES:
        raise FileFormatError(
            "there is no such history of pulls", where=data.where, value=history, limit=", ".join(HISTORIES)
        )
    approach = data.values("approach") if data.has("approach") else None
    if history in (AGAIN, HELD_SETTING) and approach is None:
        raise FileFormatError(
            "pulls with a history need the channel 'approach': from where each pose was reached",
            where=data.where,
            value=history,
            hint="Map it in the manifest, or leave settings.history out",
        )
    return history, approach


def _point(data: Dataset, key: str, default: Float | None = None) -> Float:
    value = np.asarray(data.settings.get(key, np.zeros(3) if default is None else default), dtype=np.float64)
    if value.shape != (3,) or not np.all(np.isfinite(value)) or np.linalg.norm(value) > 5.0:
        raise FileFormatError(f"setting {key} is no point near the tool", where=data.where, value=value.tolist())
    return value
