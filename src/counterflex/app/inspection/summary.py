"""Figures of inspected parts, as ``summary.json`` holds them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.app.inspection.tool_path import InspectedPath, path_entry
from counterflex.core.arrays import Float
from counterflex.core.result import Parts, ShownTable, Summary, fill
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


WHOLE: Final = 0.9
"""Less of a feature measured is printed."""
_FIGURES: Final = (("99.7 %", "p997_mm"), ("largest", "max_mm"), ("rms", "rms_mm"))


class InspectionSummary(Summary):
    """Deviations of measured parts, or of the path of the tool, and what of them was seen."""

    def _shown(self) -> Parts:
        names, logged = list(self["parts"]), self["judged"] == "tool path"
        if logged:
            yield from self._paths()
        for part in () if logged else self["parts"].values():
            yield from _scan_lines(part["scan"], part["registration"])
        for name in names:
            yield coverage_line(name, self["parts"][name]["coverage"], logged)
        what = "surface that this path leaves (not measured)" if logged else "measured surface"
        yield ShownTable.of(
            f"{self['program']}: deviation of the {what}, mm, along the normal",
            "surface=0" + self._columns(),
            [(kind, *(part[kind] for part in self["parts"].values())) for kind in ("surface", "floor", "wall")],
        )
        yield from self._partly_seen(logged)
        if self["features"]:
            columns = ["feature", "quantity", "nominal", "+-", *(c for name in names for c in (name, "U um", "within"))]
            rows = [
                [row["feature"], row["quantity"], f"{row['nominal_mm']:.3f}", f"{row['tolerance_mm']:g}"]
                + [cell for name in names for cell in _cells(row.get(name))]
                for row in self["features"]
            ]
            note = "U: expanded uncertainty of measurement, k = 2. docs/inspect.md"
            yield ShownTable("Features: value furthest from nominal, mm", columns, rows, note)

    def _columns(self) -> str:
        return "".join(
            f" | {name}: {title}={{{k + 1}[{key}]:.3f}}"
            for k, name in enumerate(self["parts"])
            for title, key in _FIGURES
        )

    def _partly_seen(self, logged: bool) -> Parts:
        rows = [
            area | {"feature": feature, "part": name}
            for name, part in self["parts"].items()
            for feature, area in part["coverage"]["features"].items()
            if area["judged_mm2"] < WHOLE * area["machined_mm2"]
        ]
        if rows:
            yield ShownTable.of(
                "Features measured in part: machined area, mm2",
                "feature | of=part | machined=machined_mm2:.0f | judged=judged_mm2:.0f | not judged=unjudged_mm2:.0f | "
                f"{'not logged' if logged else 'not scanned'}=unseen_mm2:.0f",
                rows,
                "What was not measured may be out of tolerance. docs/inspect.md#what-was-not-seen",
            )

    def _paths(self) -> Parts:
        parts = list(self["parts"].values())
        for part in parts:
            frame = "frame: {log[frame]}"
            if part["log"]["frame_fitted"]:
                frame = (
                    "frame fitted to the path, residual {registration[residual_um]:.1f} um, condition "
                    "{registration[condition]:g}: what a frame absorbs is left out"
                )
            yield fill(
                "{log[file]}: {log[readings]} positions of the tool, {log[position]}; noise {log[noise_um]:.1f} um; "
                "{log[covered_percent]:g} % of the feed motion; " + frame,
                part,
            )
        paths = [part["path"] for part in parts]
        rows = [
            ("across the feed" if key == "path" else key, *(path.get(key) for path in paths))
            for key in paths[0]
            if key != "normal"
        ]
        rows += [(key.replace("_", " "), *(path["normal"].get(key) for path in paths)) for key in paths[0]["normal"]]
        yield ShownTable.of(
            f"{self['program']}: deviation of the path of the tool, mm",
            "path=0" + self._columns(),
            rows,
            "floor, wall left, wall right: along the normal of the surface that the tool makes there. Where it cut: "
            + parts[0]["log"]["cutting"],
        )


def _scan_lines(scan: dict[str, Any], pose: dict[str, Any]) -> Parts:
    placed = "taken to be in the part frame"
    if pose["datum_faces"]:
        placed = fill("placed by {datum_faces}, residual {residual_um:.1f} um, condition {condition:g}", pose)
    yield (
        fill("{file}: {points} points in {unit}, noise {noise_um:.1f} um, {outliers} outliers left out; ", scan)
        + placed
    )
    if scan["cut_away"]:
        share = 100.0 * scan["cut_away"] / max(scan["points"], 1)
        yield f"{scan['cut_away']} points ({share:.0f} %) lie beside the blank and are cut away"
    yield scale_line(scan["scale"])


def scale_line(scale: dict[str, Any]) -> str:
    """One line about the scale of a scan."""
    if scale["percent"] is None:
        return "scale of the scan: not known, no two opposite faces of the blank were scanned"
    value, sigma = scale["percent"], scale["standard_deviation_percent"]
    each = ", ".join(f"{axis} {one:+.4f} %" for axis, one in scale["directions_percent"].items())
    line = f"scale of the scan against the blank: {value:+.4f} % +- {sigma:.4f} % ({each})"
    agree = scale["directions_agree"]
    other = [axis for axis in scale["directions_percent"] if axis not in agree]
    if agree and other:
        line += f"; {', '.join(agree)} agree, and along {', '.join(other)} the blank is of another size"
    if not scale["significant"]:
        return line
    if not agree:
        return line + ": the blank is of another size, or the scan of another scale; no two directions agree on one"
    return line + f": {abs(value) * 1000.0:.0f} um over 100 mm. Calibrate the scanner; until then U holds it"


def coverage_line(name: str, area: dict[str, Any], logged: bool) -> str:
    """One line about what of the machined surface was seen and judged."""
    whole = max(area["machined_mm2"], 1e-9)
    if logged:
        missing = area["machined_mm2"] - area["judged_mm2"]
        return f"{name}: {missing:.0f} of {whole:.0f} mm2 machined ({100.0 * missing / whole:.0f} %) not logged"
    return (
        f"{name}: of {whole:.0f} mm2 machined, {area['judged_mm2']:.0f} judged, {area['unjudged_mm2']:.0f} scanned but "
        f"not judged, {area['unseen_mm2']:.0f} NOT SCANNED ({100.0 * area['unseen_mm2'] / whole:.0f} %)"
    )


def _cells(entry: dict[str, Any] | None) -> list[str]:
    if entry is None:
        return ["not found", "", ""]
    uncertainty = f"{2.0 * entry['standard_deviation_um']:.0f}"
    share = entry["measured_share"]
    part = f", {100.0 * share:.0f} % seen" if share < WHOLE else ""
    return [f"{entry['worst_mm']:.3f}", uncertainty, ("yes" if entry["within"] else "no") + part]


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
