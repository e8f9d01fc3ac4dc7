"""Figures of inspected parts, as ``summary.json`` holds them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from counterflex.app.inspection.tool_path import InspectedPath, path_entry
from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM, URAD, plain
from counterflex.evaluate.features import FeatureRow
from counterflex.evaluate.inspection.coverage import Coverage
from counterflex.evaluate.inspection.part_deviations import FACES
from counterflex.evaluate.inspection.registration import FREEDOMS, Registration
from counterflex.evaluate.inspection.scanned_part import ScannedPart
from counterflex.evaluate.inspection.size_errors import ScaleEstimate
from counterflex.evaluate.surface import SurfaceDeviation
from counterflex.files.scan.scan import Scan


@dataclass(frozen=True, eq=False)
class InspectedScan:
    """A scan, judged."""

    file: str
    scan: Scan
    unit: str  # Name of its unit
    part: ScannedPart  # Against the nominal part
    outliers: int  # Measured points left out as lone ones
    cut_away: int  # Measured points left out as beside the part
    ball_radius_m: float  # Of the probe whose centres the points are; 0: they lie on the surface
    scale: ScaleEstimate  # Of the scan against the blank

    def row(self) -> dict[str, Any]:
        """Row of the summary."""
        return {
            "scan": {
                "file": self.file,
                "kind": self.scan.kind,
                "unit": self.unit,
                "points": len(self.scan),
                "not_numbers": self.scan.dropped,
                "outliers": self.outliers,
                "cut_away": self.cut_away,
                "ball_diameter_mm": round(2.0 * self.ball_radius_m / MM, 4),
                "unmatched_share": round(self.part.unmatched_share, 4),
                "noise_um": round(self.part.noise_m / UM, 2),
                "scale": _scale(self.scale),
            }
        }


def summary_of(
    parts: Mapping[str, InspectedScan | InspectedPath],
    features: tuple[FeatureRow, ...],
    covered: Mapping[str, tuple[Coverage, Mapping[str, Coverage]]],
) -> dict[str, Any]:
    """The entries ``parts`` and ``features`` of the summary.

    Args:
        covered: By name, areas of the part and of its features by what is known about them.
    """
    return {
        "parts": {
            name: {
                **(one.row() if isinstance(one, InspectedScan) else path_entry(one)),
                "registration": _registration(one.part.registration),
                **_surface(one.part.surface_deviation()),
                "coverage": _coverage(covered[name][0])
                | {"features": {feature: _coverage(one) for feature, one in covered[name][1].items()}},
                "measured": {face: int(np.count_nonzero(one.part.rows.face == k)) for k, face in enumerate(FACES)},
            }
            for name, one in parts.items()
        },
        "features": [
            {
                **plain(row, "feature quantity nominal_mm:4 tolerance_mm:4 tolerance_source"),
                **{
                    name: {
                        "worst_mm": round(row.worst_m[name] / MM, 4),
                        "mean_mm": round(row.mean_m[name] / MM, 4),
                        "standard_deviation_um": round(row.standard_deviation_m[name] / UM, 2),
                        "within": row.ok(name),
                        "measured_share": round(row.measured_share.get(name, 1.0), 3),
                    }
                    for name in row.worst_m
                },
            }
            for row in features
        ],
    }


def _scale(one: ScaleEstimate) -> dict[str, Any]:
    """Scale less 1, in percent; None where no two opposite faces were scanned."""
    known = bool(one.directions)
    return {
        "percent": round(100.0 * one.scale, 5) if known else None,
        "standard_deviation_percent": round(100.0 * one.sigma, 5) if known else None,
        "directions_percent": {axis: round(100.0 * value, 5) for axis, value in one.directions.items()},
        "directions_agree": list(one.agreeing),
        "significant": one.significant,
    }


def _coverage(one: Coverage) -> dict[str, float]:
    return plain(one, "machined_mm2:1 judged_mm2:1 unjudged_mm2:1 unseen_mm2:1")


def _registration(registration: Registration) -> dict[str, Any]:
    sigma = np.sqrt(np.diag(registration.covariance))
    return {
        "datum_faces": list(registration.faces),
        "points": registration.points,
        "offset_um": {name: round(value / UM, 1) for name, value in registration.offset_m.items()},
        "residual_um": round(registration.residual_m / UM, 2),
        "condition": round(registration.condition, 1),
        "standard_deviation": {
            name: {"um": round(value / UM, 2)} if k < 3 else {"urad": round(value / URAD, 2)}
            for k, (name, value) in enumerate(zip(FREEDOMS, sigma.tolist(), strict=True))
        },
        "T_part_scan_mm": _matrix(registration.T_part_scan),
    }


def _matrix(T: Float) -> list[list[float]]:
    """A pose by rows, its position in mm."""
    scale = np.array([[1.0, 1.0, 1.0, 1.0 / MM]] * 3 + [[1.0] * 4])
    return [[round(value, 9) for value in row] for row in (T * scale).tolist()]


def _surface(deviation: SurfaceDeviation) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for name in ("surface", "floor", "wall"):
        figures = getattr(deviation, name)
        out[name] = plain(figures, "max_mm:4 p997_mm:4 rms_mm:4") | {"area_mm2": round(figures.extent / MM**2, 1)}
    out["surface"] |= plain(deviation, "floor_resolution_mm:3 wall_resolution_mm:3 wall_lost_mm2:1")
    return out
