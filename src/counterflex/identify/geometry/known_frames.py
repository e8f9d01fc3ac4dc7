"""Tracker and target as the cell file's ``[tracker]`` table has them, and back into that table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, UM, URAD
from counterflex.geometry import pose, rotation
from counterflex.identify.data.changes import TableValues
from counterflex.identify.data.model import CellModel

_KEYS = ("x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg")
_LEAST = 1e-4  # um or urad: what a table shows of a standard deviation at least


@dataclass(frozen=True, eq=False)
class KnownFrames:
    """What a cell file says about the tracker.

    Attributes:
        T_base_tracker: (4, 4).
        sigma: (6,) m, rad in the tracker's axes, or None where not stated.
        T_tcp_target: (4, 4).
        target_sigma: (6,) m, rad in the target's axes, or None.
    """

    T_base_tracker: Float
    sigma: Float | None
    T_tcp_target: Float
    target_sigma: Float | None


def known_frames(cell: CellModel) -> KnownFrames | None:
    """The table ``tracker`` of a cell in SI, or None where it has none."""
    table: Mapping[str, Any] | None = cell.tables.get("tracker")
    if not table:
        return None
    target = _pose(table, "target_")
    if table.get("target_on", "tcp") == "flange":
        target = pose.inverse(cell.nominal_chain.T_flange_tcp) @ target
    return KnownFrames(_pose(table, ""), _sigma(table, ""), target, _sigma(table, "target_"))


def tracker_table(
    T_base_tracker: Float, sigma: Float, T_tcp_target: Float | None, target_sigma: Float | None, source: str
) -> TableValues:
    """The table ``tracker`` of a cell file.

    Args:
        T_base_tracker: (4, 4) m.
        sigma: (6,) m, rad standard deviations in the tracker's axes.
        T_tcp_target: (4, 4) m, or None to leave the target as the file has it.
        target_sigma: (6,) m, rad in the target's axes, or None.
        source: Where the numbers come from.
    """
    values: dict[str, float | str | bool | list[float] | list[list[float]]] = {}
    values.update(_shop(T_base_tracker, ""))
    values.update(_shop_sigma(sigma, ""))
    if T_tcp_target is not None and target_sigma is not None:
        values["target_on"] = "tcp"
        values.update(_shop(T_tcp_target, "target_"))
        values.update(_shop_sigma(target_sigma, "target_"))
    values["source"] = source
    return TableValues("tracker", values)


def _pose(table: Mapping[str, Any], prefix: str) -> Float:
    v = np.array([float(table.get(prefix + key, 0.0)) for key in _KEYS])
    return pose.from_xyz_zyx(v[:3] * MM, v[3:] * DEG)


def _sigma(table: Mapping[str, Any], prefix: str) -> Float | None:
    um, urad = table.get(f"{prefix}sigma_um"), table.get(f"{prefix}sigma_urad")
    if um is None or urad is None:
        return None
    return np.concatenate([np.array(um, dtype=np.float64) * UM, np.array(urad, dtype=np.float64) * URAD])


def _shop(T: Float, prefix: str) -> dict[str, float]:
    v = np.concatenate([T[:3, 3] / MM, rotation.to_zyx(T[:3, :3]) / DEG])
    return {prefix + key: round(float(x), 7) + 0.0 for key, x in zip(_KEYS, v, strict=True)}


def _shop_sigma(sigma: Float, prefix: str) -> dict[str, list[float]]:
    return {
        f"{prefix}sigma_um": [max(_LEAST, float(f"{v / UM:.4g}")) for v in sigma[:3]],
        f"{prefix}sigma_urad": [max(_LEAST, float(f"{v / URAD:.4g}")) for v in sigma[3:]],
    }
