"""Fill the page of an inspection."""

from __future__ import annotations

import datetime
from typing import Any

from counterflex.app.compensation.cell_facts import title_of
from counterflex.app.inspection.judging import Inspection
from counterflex.evaluate.feature_finding import find_features
from counterflex.evaluate.inspection.sections import groove_sections
from counterflex.report.data import Fact
from counterflex.report.inspection.page import InspectionData, inspection_page


def page_of(inspection: Inspection) -> str:
    """The page, as HTML text."""
    parts = {name: one.part for name, one in inspection.parts.items()}
    first = next(iter(parts.values()))
    surface = first.part.surface
    candidates = find_features(inspection.job.path, surface.cutter.radius_m)
    program = inspection.summary["program"]
    files = " and ".join(one.file for one in inspection.parts.values())
    return inspection_page(
        InspectionData(
            title=title_of(inspection.job.program),
            subtitle=f"{files} against what {program} makes in {inspection.cell.name}",
            created=datetime.datetime.now(tz=datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
            surface=surface,
            deviations={name: part.surface_deviation() for name, part in parts.items()},
            features=inspection.features,
            sections=groove_sections(candidates, parts),
            facts={name: facts(inspection.summary["parts"][name]) for name in parts},
        )
    )


def facts(entry: dict[str, Any]) -> tuple[Fact, ...]:
    """How a scan was read and placed, in lines.

    Args:
        entry: Of ``parts`` in the summary.
    """
    scan, pose = entry["scan"], entry["registration"]
    left_out = f"{scan['outliers']} outliers, {scan['not_numbers']} that were no numbers left out"
    rows = [
        Fact("Scan", scan["file"], "", scan["kind"]),
        Fact("Points", f"{scan['points']}", "", left_out),
        Fact("Unit", scan["unit"]),
        Fact("Noise of one point", f"{scan['noise_um']:.1f} um", "", "scatter of neighbours about a plane"),
        Fact("On no surface of the part", f"{100.0 * scan['unmatched_share']:.1f} %"),
    ]
    if not pose["datum_faces"]:
        return (*rows, Fact("Placed by", "the file itself", "", "taken to be in the part frame"))
    sigma = pose["standard_deviation"]
    shifts = ", ".join(f"{value['um']:.1f}" for name, value in sigma.items() if name.startswith("shift"))
    turns = ", ".join(f"{value['urad']:.1f}" for name, value in sigma.items() if name.startswith("turn"))
    offsets = ", ".join(f"{name} {value:+.1f} um" for name, value in pose["offset_um"].items())
    return (
        *rows,
        Fact("Datum faces", ", ".join(pose["datum_faces"]), "", f"mean distances: {offsets}"),
        Fact("Residual", f"{pose['residual_um']:.1f} um", "", "root mean square distance to the datum faces"),
        Fact("Pose known to", f"x y z {shifts} um", "", f"about x y z {turns} urad (standard deviations)"),
        Fact("Condition", f"{pose['condition']:g}", "", "1: all six freedoms are held equally well"),
    )
