"""Tracker and target as the cell file's ``[tracker]`` table has them, and back into that table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, MRAD, UM, URAD
from counterflex.geometry import pose, rotation
from counterflex.identify.data.changes import TableValues
from counterflex.identify.data.model import CellModel
from counterflex.robot.elasticity.axis_sag import AxisSag
from counterflex.robot.elasticity.drive_error import DriveError, DriveErrors

TABLE: Final = "drive_error"
SAG_TABLE: Final = "axis_sag"
_SAG_KEYS: Final = ("axis2_by_link2_mrad", "axis2_by_link3_mrad", "axis3_by_link3_mrad")


def known_drive_errors(cell: CellModel) -> DriveErrors:
    """Read the cell file; nothing where it has no such table."""
    table: Mapping[str, Any] = cell.tables.get(TABLE) or {}
    return DriveErrors(
        tuple(
            DriveError(axis, int(order), float(sine) * URAD, float(cosine) * URAD)
            for axis in range(6)
            for order, sine, cosine in table.get(f"axis{axis + 1}") or ()
        ),
        tuple((float(low) * DEG, float(high) * DEG) for low, high in table.get("measured_deg") or ()),
        _known_sag(cell),
    )


def _known_sag(cell: CellModel) -> AxisSag | None:
    table: Mapping[str, Any] = cell.tables.get(SAG_TABLE) or {}
    if not table:
        return None
    rows = [table.get(key) or (0.0, 0.0) for key in _SAG_KEYS]
    return AxisSag(cell.nominal_chain, np.array(rows, dtype=np.float64).ravel() * MRAD)


def axis_sag_table(known: DriveErrors, added_rad: Float, source: str) -> TableValues:
    """The table of sag with what was found added to what was known.

    ``added_rad``: (6,) rad, to be added, in the order of :data:`counterflex.robot.elasticity.axis_sag.TERMS`.
    """
    whole = added_rad if known.sag is None else added_rad + known.sag.moments_rad
    values: dict[str, float | str | bool | list[float] | list[list[float]]] = {
        key: [float(f"{v / MRAD:.6g}") for v in pair] for key, pair in zip(_SAG_KEYS, whole.reshape(3, 2), strict=True)
    }
    values["source"] = source
    return TableValues(SAG_TABLE, values)


def drive_error_table(known: DriveErrors, added: Iterable[DriveError], q: Float, source: str) -> TableValues:
    """The table with what was found added to what was known.

    ``q``: (m, 6) rad, the angles it was found from; where something was known, both ranges have to hold.
    """
    low, high = np.floor(q.min(axis=0) / DEG), np.ceil(q.max(axis=0) / DEG)
    if known.terms and known.measured_rad:
        before = np.array(known.measured_rad) / DEG
        both_low, both_high = np.maximum(low, before[:, 0]), np.minimum(high, before[:, 1])
        differs = both_low > both_high
        low, high = np.where(differs, low, both_low), np.where(differs, high, both_high)
    values: dict[str, float | str | bool | list[float] | list[list[float]]] = {}
    merged = known.merged(added)
    for axis in range(6):
        rows = [
            [t.order, float(f"{t.sine_rad / URAD:.6g}"), float(f"{t.cosine_rad / URAD:.6g}")]
            for t in merged.terms
            if t.axis == axis
        ]
        if rows:
            values[f"axis{axis + 1}"] = rows
    values["measured_deg"] = [[float(f"{a:.6g}"), float(f"{b:.6g}")] for a, b in zip(low, high, strict=True)]
    values["source"] = source
    return TableValues(TABLE, values)


_KEYS = ("x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg")
_LEAST = 1e-4  # um or urad: what a table shows of a standard deviation at least


@dataclass(frozen=True, eq=False)
class KnownFrames:
    """Tracker and target by the cell file."""

    T_base_tracker: Float  # (4, 4)
    sigma: Float | None  # (6,) m, rad in the tracker's axes, or None where not stated
    T_tcp_target: Float  # (4, 4)
    target_sigma: Float | None  # (6,) m, rad in the target's axes, or None


def known_frames(cell: CellModel) -> KnownFrames | None:
    """The table ``tracker`` of a cell in SI, or None where it has none."""
    table: Mapping[str, Any] | None = cell.tables.get("tracker")
    if not table:
        return None
    target = _pose(table, "target_")
    # A target on the flange stays where it is when the tool changes; the model wants it at the present TCP.
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
