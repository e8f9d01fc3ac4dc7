"""Pages of ISO 9283: the pose test and the path test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from counterflex.core.similar import with_interval
from counterflex.core.units import UM
from counterflex.evaluate.iso9283.path_cycles import CommandedPath, PathCycle
from counterflex.evaluate.iso9283.path_figures import IsoPathFigures, PathVelocity
from counterflex.evaluate.iso9283.poses import PoseCycles
from counterflex.report.figure_data import numbers
from counterflex.report.robot_tests import section as drawn
from counterflex.report.robot_tests.section import CYCLE_COLOURS, GRID, Section, test_page

MOST: Final = 6
_VIEWS: Final = (("x", "y", 0, 1), ("x", "z", 0, 2))


def cluster_figure(poses: Sequence[PoseCycles], radii_um: Sequence[float]) -> dict[str, Any]:
    """Deviations of the attained positions from the commanded one, in two views, all at one scale.

    The circle is the outline of the sphere of radius RP about the barycentre; the cross is the commanded position.

    Args:
        radii_um: RP of each, um.
    """
    drawn = list(poses[:MOST])
    d = [(one.p - one.command[:3, 3]) / UM for one in drawn]
    reach = max(float(np.abs(x.mean(axis=0)).max()) + r for x, r in zip(d, radii_um, strict=False))
    reach = 1.08 * max(reach, *(float(np.abs(x).max()) for x in d), 1e-3)
    data, axes, notes, shapes = [], {}, [], []
    width = 1.0 / len(drawn)
    for k, (x, radius) in enumerate(zip(d, radii_um, strict=False)):
        colour = CYCLE_COLOURS[k % len(CYCLE_COLOURS)]
        for v, (a, b, i, j) in enumerate(_VIEWS):
            n = 2 * k + v + 1
            tail = "" if n == 1 else str(n)
            centre = x.mean(axis=0)
            data += [
                {"type": "scatter", "mode": "markers", "x": numbers(x[:, i], 2), "y": numbers(x[:, j], 2),
                 "xaxis": f"x{tail}", "yaxis": f"y{tail}", "marker": {"size": 5, "color": colour, "opacity": 0.7},
                 "hovertemplate": f"{a} %{{x:.1f}}, {b} %{{y:.1f}} um<extra></extra>"},
                {"type": "scatter", "mode": "markers", "x": [0.0], "y": [0.0], "xaxis": f"x{tail}", "yaxis": f"y{tail}",
                 "marker": {"symbol": "cross-thin", "size": 14, "line": {"width": 2, "color": "#1b2530"}},
                 "hoverinfo": "skip"},
            ]  # fmt: skip
            shapes.append(
                {"type": "circle", "xref": f"x{tail}", "yref": f"y{tail}", "line": {"color": colour, "width": 1.5},
                 "x0": centre[i] - radius, "x1": centre[i] + radius, "y0": centre[j] - radius, "y1": centre[j] + radius}
            )  # fmt: skip
            first = k == 0
            axes[f"xaxis{tail}"] = {
                **GRID, "domain": [k * width + (0.0 if first else 0.02), (k + 1) * width], "anchor": f"y{tail}",
                "range": [-reach, reach], "title": {"text": f"{a}, um"}, "nticks": 5,
            }  # fmt: skip
            axes[f"yaxis{tail}"] = {
                **GRID, "domain": [0.56, 0.94] if v == 0 else [0.0, 0.38], "anchor": f"x{tail}", "nticks": 5,
                "range": [-reach, reach], "scaleanchor": f"x{tail}", "showticklabels": first,
                "title": {"text": f"{b}, um" if first else ""},
            }  # fmt: skip
        notes.append(
            {"text": f"<b>pose {k + 1}</b>", "xref": "paper", "yref": "paper", "x": (k + 0.5) * width, "y": 1.0,
             "showarrow": False}
        )  # fmt: skip
    layout = {
        "height": 560,
        "margin": {"l": 56, "r": 8, "t": 24, "b": 44},
        "showlegend": False,
        "shapes": shapes,
        "annotations": notes,
        **axes,
    }
    return {"data": data, "layout": layout}


def time_figure(poses: Sequence[PoseCycles]) -> dict[str, Any] | None:
    """Distance of every attained position from the commanded one over the cycles."""
    data = [
        {"type": "scatter", "mode": "lines+markers", "name": f"pose {k + 1}",
         "x": list(range(1, len(one.p) + 1)),
         "y": numbers(np.linalg.norm(one.p - one.command[:3, 3], axis=1) / UM, 2),
         "line": {"color": CYCLE_COLOURS[k % len(CYCLE_COLOURS)], "width": 1.4}, "marker": {"size": 5}}
        for k, one in enumerate(poses)
    ]  # fmt: skip
    layout = {
        "height": 340,
        "margin": {"l": 60, "r": 12, "t": 40, "b": 44},
        "legend": {"orientation": "h", "y": 1.03, "yanchor": "bottom", "x": 0.0},
        "xaxis": {**GRID, "title": {"text": "cycle"}},
        "yaxis": {**GRID, "title": {"text": "distance from the commanded position, um"}, "rangemode": "tozero"},
    }
    return {"data": data, "layout": layout}


def pose_page(summary: Mapping[str, Any], poses: Sequence[PoseCycles]) -> str:
    """Page of a pose test, as HTML text."""
    rows = summary["poses"]
    worst = max(rows, key=lambda row: row["AP_um"]["value"])
    least = max(rows, key=lambda row: row.get("RP_um", row["AP_um"])["value"])
    verdict = f"Largest AP {with_interval(worst['AP_um'])} um at pose {worst['pose']}"
    verdict += f"; largest RP {with_interval(least['RP_um'])} um at pose {least['pose']}." if "RP_um" in least else "."
    radii = [row.get("RP_um", {"value": 0.0})["value"] for row in rows]
    keys = [key for key, value in rows[0].items() if isinstance(value, dict) and "low" in value]
    sections = [
        Section(
            "Attained positions",
            "Deviation from the commanded position (cross); the circle is the outline of the sphere of radius RP about "
            f"the barycentre. Views along z (above) and along y (below). At most {MOST} poses are drawn.",
            "clusters",
        ),
        Section(
            "Accuracy and repeatability of the poses",
            "AP: barycentre minus command, um and mdeg. RP: mean distance from the barycentre plus three standard "
            "deviations. 95 % intervals in brackets.",
            columns=["pose", "cycles", *(key.rpartition("_")[0].replace("_", " ") for key in keys)],
            rows=[
                [str(row["pose"]), str(row["cycles"]), *(with_interval(row.get(key)) for key in keys)] for row in rows
            ],
        ),
        Section("Over the cycles", "Distance of each attained position from the commanded one.", "cycles"),
    ]
    sections += _further(summary)
    sections.append(Section.conditions(summary))
    figures = {"clusters": cluster_figure(poses, radii)}
    over = time_figure(poses)
    if over is not None:
        figures["cycles"] = over
    return test_page(_title("Pose test", summary), _subtitle(summary), verdict, sections, figures)


def _further(summary: Mapping[str, Any]) -> list[Section]:
    """Sections of what not every pose test has."""
    sections = []
    if summary["distances"]:
        sections.append(
            Section(
                "Distances",
                "AD: mean distance minus commanded distance; RD: three standard deviations; um.",
                columns=["poses", "commanded, mm", "AD", "RD"],
                rows=[
                    [
                        f"{r['from']}, {r['to']}",
                        f"{r['commanded_mm']:.3f}",
                        with_interval(r["AD_um"]),
                        with_interval(r.get("RD_um")),
                    ]
                    for r in summary["distances"]
                ],
            )
        )
    if "multi_directional" in summary:
        several = summary["multi_directional"]
        names = [key for key in several[0] if key != "pose"]
        sections.append(
            Section(
                "Multi-directional variation of the accuracy",
                f"Largest distance between the barycentres of {summary['directions']} directions of approach.",
                columns=["pose", *(name.replace("_", " ") for name in names)],
                rows=[[str(row["pose"]), *(with_interval(row[name]) for name in names)] for row in several],
            )
        )
    timed = [row for row in summary["poses"] if "stabilisation_time_s" in row or "drift" in row]
    if timed:
        sections.append(
            Section(
                "Over time",
                f"Stabilisation: from the first entry into the limit band of {summary['limit_band_mm']:g} mm about the "
                "attained pose until it stays there, mean of three approaches. Drift: largest change of AP and RP "
                "between the first ten cycles and later ones, um.",
                columns=["pose", "stabilisation, s", "overshoot, um", "dAP", "dRP", "hours"],
                rows=[
                    [
                        str(row["pose"]),
                        with_interval(row.get("stabilisation_time_s"), 3),
                        with_interval(row.get("overshoot_um")),
                        *(with_interval(row.get("drift", {}).get(key), 2) for key in ("dAP_um", "dRP_um", "hours")),
                    ]
                    for row in timed
                ],
            )
        )
    return sections


def _corners(corners: Sequence[Mapping[str, Any]]) -> Section:
    return Section(
        "Corners",
        "CR: least distance of an attained path from the corner. CO: largest deviation from the second path on "
        "its outer side. The largest of all cycles, and the least in brackets, um.",
        "corners",
        ["corner", "at, mm", "turn, deg", "CR", "CO"],
        [
            [
                str(row["corner"]),
                f"{row['at_mm']:g}",
                f"{row['turn_deg']:.1f}",
                f"{row['CR_um']:.1f} ({row['CR_least_um']:.1f})",
                f"{row['CO_um']:.1f} ({row['CO_least_um']:.1f})",
            ]
            for row in corners
        ],
    )


def path_page(
    summary: Mapping[str, Any],
    path: CommandedPath,
    figures: IsoPathFigures,
    cycles: Sequence[PathCycle],
    velocity: PathVelocity | None,
) -> str:
    """Page of a path test, as HTML text."""
    factor = drawn.magnified(path, figures)
    names = [key for key in summary if key[:3] in ("AT_", "RT_") and isinstance(summary[key], dict)]
    verdict = f"AT {with_interval(summary['AT_um'])} um at {summary['AT_at_mm']:g} mm along the path"
    verdict += f"; RT {with_interval(summary['RT_um'])} um at {summary['RT_at_mm']:g} mm." if summary["RT_um"] else "."
    sections = [
        Section("Attained paths", f"Deviations are drawn {factor:g} times larger than the path.", "path"),
        Section(
            "Band along the path",
            "Line: barycentre of the attained paths minus the commanded one, in planes normal to it. Band: the tube of "
            "radius RT, mean distance plus three standard deviations. Dotted: corners.",
            "band",
        ),
        Section(
            "Accuracy and repeatability",
            "AT: largest distance of the barycentre; RT: largest radius of the tube; orientation likewise. 95 % "
            "intervals in brackets.",
            columns=["figure", "value"],
            rows=[
                [key.replace("_um", ", um").replace("_mdeg", ", mdeg").replace("_", " "), with_interval(summary[key])]
                for key in names
            ],
        ),
    ]
    plots = {"path": drawn.path_band_figure(path, figures), "band": drawn.band_figure(path, figures)}
    if "corner" in summary:
        largest = max(max(row["CR_um"], row["CO_um"]) for row in summary["corner"]) * UM
        plots["corners"] = drawn.corner_figure(path, cycles, 2.5 * max(largest, 20.0 * UM))
        sections.append(_corners(summary["corner"]))
    if velocity is not None:
        v = summary["velocity"]
        plots["velocity"] = drawn.velocity_figure(velocity)
        sections.append(
            Section(
                "Path velocity",
                "Over the middle half of each stretch; each velocity is the slope of a straight line through 0.1 s of "
                f"readings, whose noise alone scatters it by {v['noise_mm_s']:g} mm/s (one standard deviation).",
                "velocity",
                ["figure", "value"],
                [
                    ["AV, %", with_interval(v["AV_percent"], 3)],
                    ["RV, %", with_interval(v["RV_percent"], 3)],
                    ["FV, mm/s", f"{v['FV_mm_s']:.3f}"],
                ],
            )
        )
    sections.append(Section.conditions(summary))
    return test_page(_title("Path test", summary), _subtitle(summary), verdict, sections, plots)


def _title(name: str, summary: Mapping[str, Any]) -> str:
    return f"{name} by {summary['standard']}"


def _subtitle(summary: Mapping[str, Any]) -> str:
    text = f"{', '.join(summary['files'][:3])}, {summary['cycles']} cycles"
    requested = summary["cycles_of_the_standard"]
    return text + (f" (the standard measures {requested})" if summary["cycles"] < requested else "")
