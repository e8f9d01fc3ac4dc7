"""A judged path of the tool as plain values: its entry in the summary, and its rows in the file."""

from __future__ import annotations

from typing import Any

import numpy as np

from counterflex.app.inputs import Job
from counterflex.app.inspection.tool_path import InspectedPath
from counterflex.core.units import MM, UM
from counterflex.evaluate.figures import DeviationFigures, weighted_figures
from counterflex.files.tool_path_file import ToolPathRows


def path_entry(one: InspectedPath) -> dict[str, Any]:
    """The entries ``log`` and ``path`` of a part: how it was logged, and the figures of the path."""
    track, log, figures = one.track, one.log, one.figures
    spacing = track.deviation.spacing_m
    path: dict[str, Any] = {
        name: _figures(getattr(figures, name)) for name in ("path", "entry", "exit", "plateau", "air")
    }
    if not track.cut_known:
        path = {"path": path["path"]}
    if track.clock:
        path["along"] = _figures(figures.along)
    normal = {name: v[np.isfinite(v)] for name, v in one.normal_m().items()}
    path["normal"] = {name: _figures(weighted_figures(v, spacing)) for name, v in normal.items() if len(v)}
    for name, v in normal.items():
        if len(v):
            path["normal"][name]["mean_mm"] = round(float(v.mean()) / MM, 4)
    return {
        "log": {
            "file": one.file,
            "kind": log.kind,
            "position": log.position,
            "frame": log.frame,
            "frame_fitted": log.fitted,
            "readings": len(log.readings),
            "noise_um": round(track.noise_m / UM, 2),
            "stated_sigma_um": round(log.stated_sigma_m / UM, 2),
            "smoothed_over_mm": round(track.window_m / MM, 2),
            "covered_percent": round(100.0 * track.covered, 1),
            "left_out_percent": round(100.0 * track.left_out, 1),
            "cutting": "by the program's removal" if track.cut_known else "not known: all feed motion counts",
            "along_counts_from": track.clock or "not known",
            **log.facts,
        },
        "path": path,
    }


def path_rows(one: InspectedPath, job: Job) -> ToolPathRows:
    """The stations of a path with their deviations."""
    track, registration = one.track, one.part.registration
    deviation = track.deviation
    axis = np.cross(deviation.feed_direction, deviation.left)
    place = deviation.p_part_nominal
    by_pose = np.maximum(
        registration.standard_deviation_m(place, deviation.left), registration.standard_deviation_m(place, axis)
    )
    along = deviation.along_m if track.clock else np.full(len(place), np.nan)
    fed = deviation.cutting | deviation.air
    cutting = deviation.cutting.astype(np.int64) if track.cut_known else np.where(fed, -1, 0)
    return ToolPathRows(
        deviation.time_s,
        deviation.length_m,
        np.asarray(job.line_of_motion, dtype=np.int64)[deviation.motion],
        place,
        np.column_stack([deviation.across_left_m, deviation.across_axis_m, along]),
        np.column_stack(list(one.normal_m().values())),
        np.sqrt(track.sigma_m**2 + by_pose**2),
        cutting,
    )


def _figures(figures: DeviationFigures) -> dict[str, float]:
    return {
        "max_mm": round(figures.max_m / MM, 4),
        "p997_mm": round(figures.p997_m / MM, 4),
        "rms_mm": round(figures.rms_m / MM, 4),
        "length_mm": round(figures.extent / MM, 1),
    }
