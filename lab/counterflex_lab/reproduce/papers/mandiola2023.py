"""Ours of Mandiola2023: pose of the tool, gain, and square and circle with a tracker in the loop."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.files.schema import write_toml
from counterflex.geometry import pose, rotation
from counterflex_lab.reproduce import mandiola_case, mandiola_report

GAIN: Final = 0.01
CYCLE_S: Final = 0.004
FEED_MM_S: Final = 700.0 / 60.0


def printed_pose(distance: float, azimuth: float, zenith: float, quat_wxyz: Float) -> Float:
    """(4, 4) of eq. 1.

    Args:
        distance: r, m.
        azimuth: Horizontal angle theta, rad.
        zenith: Vertical angle alpha, from the tracker's vertical, rad.
        quat_wxyz: (4,) unit quaternion, real part first.
    """
    a, b, c, d = quat_wxyz
    x, y, z = distance * np.array([np.sin(zenith) * np.cos(azimuth), np.sin(zenith) * np.sin(azimuth), np.cos(zenith)])
    return np.array(
        [
            [1 - 2 * c * c - 2 * d * d, 2 * (b * c - d * a), 2 * (b * d + c * a), x],
            [2 * (b * c + d * a), 1 - 2 * b * b - 2 * d * d, 2 * (c * d - b * a), y],
            [2 * (b * d - c * a), 2 * (b * a + c * d), 1 - 2 * b * b - 2 * c * c, z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def _eq_1() -> float:
    rng = np.random.default_rng(3)
    worst = 0.0
    for _ in range(1000):
        q = rng.normal(size=4)
        q /= np.linalg.norm(q)
        r, theta, alpha = rng.uniform([0.5, -np.pi, 0.0], [8.0, np.pi, np.pi])
        ours = np.eye(4)
        ours[:3, :3] = rotation.from_quat_wxyz(q)
        ours[:3, 3] = rotation.about_z(theta) @ rotation.about_y(alpha) @ np.array([0.0, 0.0, r])
        worst = max(worst, float(np.abs(printed_pose(r, theta, alpha, q) - ours).max()))
    return worst


def _eq_2_mm() -> float:
    """Distance of the tool from its place when the product is taken in the printed order, mm."""
    T_base_tracker = pose.make(rotation.about_z(30.0 * DEG), np.array([0.0, -3.0, 1.0]))
    T_base_tcp = pose.make(rotation.about_y(180.0 * DEG), np.array([1.45, 0.0, 1.0]))
    T_tracker_tcp = pose.inverse(T_base_tracker) @ T_base_tcp
    first, second = T_tracker_tcp, T_base_tracker  # as printed; frames do not match
    swapped = first @ second
    return float(np.linalg.norm(swapped[:3, 3] - T_base_tcp[:3, 3]) / MM)


def _designed_gain() -> float:
    with tempfile.TemporaryDirectory() as folder:
        cell = Path(folder) / "cell.toml"
        write_toml(cell, mandiola_case.known_cell("designed"))
        loops = {item.loop.name: item for item in mandiola_report.open_loops(cell)}
    gain = loops["designed"].integral
    return float("nan") if gain is None else gain


OURS: Final[Mapping[str, Callable[[], float]]] = {
    "eq_1": _eq_1,
    "eq_2": _eq_2_mm,
    "gain": lambda: GAIN / CYCLE_S,
    "trial_and_error": _designed_gain,
    "trailing": lambda: FEED_MM_S / mandiola_case.KV_PER_S,
}
"""Ours, by the name of the row."""


def _values(run: Mapping[str, Any], variant: str, *keys: str) -> list[float]:
    out = []
    for row in run["seeds"]:
        value: Any = row["variants"][variant]
        for key in keys:
            value = value.get(key) if isinstance(value, Mapping) else None
        if value is not None:
            out.append(float(value))
    return out


def _worst(run: Mapping[str, Any], variant: str, *keys: str) -> float | None:
    values = _values(run, variant, *keys)
    return max(values) if values else None


def _scaled(value: float | None, by: float) -> float | None:
    return None if value is None else value * by


def _least(run: Mapping[str, Any], variant: str, key: str) -> float | None:
    values = [100.0 * float(item[variant][key]) for item in run["reductions"] if key in item[variant]]
    return min(values) if values else None


def _corner_peak(run: Mapping[str, Any]) -> float | None:
    peaks = _values(run, "published", "square", "corners", "total", "max_um")
    rest = _values(run, "published", "square", "straights", "total", "rms_um")
    return max((a / b for a, b in zip(peaks, rest, strict=True)), default=None)


def _turned_less(run: Mapping[str, Any]) -> float | None:
    off = _values(run, "off", "square", "straights", "orientation", "rms_mdeg")
    left = _values(run, "published", "square", "straights", "orientation", "rms_mdeg")
    return min((100.0 * (1.0 - b / a) for a, b in zip(off, left, strict=True)), default=None)


def _static_mm(run: Mapping[str, Any]) -> float | None:
    at_rest = run.get("at_rest_mm")
    return max(at_rest.values()) if at_rest else None


MEASURED: Final[Mapping[str, Callable[[Mapping[str, Any]], float | None]]] = {
    "static": _static_mm,
    "moving": lambda run: _scaled(_worst(run, "off", "circle", "turn", "total", "max_um"), 1e-3),
    "straights": lambda run: _worst(run, "published", "square", "straights", "total", "rms_um"),
    "straights_designed": lambda run: _worst(run, "designed", "square", "straights", "total", "rms_um"),
    "corners": _corner_peak,
    "orientation": lambda run: _scaled(_worst(run, "off", "square", "straights", "orientation", "max_mdeg"), 1e-3),
    "orientation_left": _turned_less,
    "circle": lambda run: _scaled(_worst(run, "off", "circle", "turn", "contour", "max_um"), 1e-3),
    "circle_published": lambda run: _least(run, "published", "circle_contour_rms"),
    "circle_designed": lambda run: _least(run, "designed", "circle_contour_rms"),
    "overall_published": lambda run: _least(run, "published", "circle_total_rms"),
    "overall_designed": lambda run: _least(run, "designed", "circle_total_rms"),
}
"""Ours from the results of an experiment, by the name of the row."""
