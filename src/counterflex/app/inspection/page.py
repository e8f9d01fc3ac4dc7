"""Fill the page of an inspection."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any, Final

from counterflex.app.inspection.judging import Inspection
from counterflex.app.inspection.summary import Inspected
from counterflex.app.inspection.tool_path import InspectedPath
from counterflex.app.proof.judge import candidates_of
from counterflex.evaluate.inspection.sections import groove_sections
from counterflex.report.data import Fact
from counterflex.report.inspection.page import InspectionData, inspection_page
from counterflex.report.inspection.path_figures import MeasuredPath

NOT_SURFACE: Final = (
    "The path of the tool was measured, not the surface. Surface, features and sections are those that a rigid tool "
    "of nominal size would leave on that path: bending of the tool behind the measured point, runout and wear are not "
    "in them."
)
FITTED: Final = (
    "The frame of the log was fitted to the program's path: errors that a frame can have, such as a constant offset, "
    "are taken away with it."
)


def page_of(inspection: Inspection) -> str:
    """The page, as HTML text."""
    parts = {name: one.part for name, one in inspection.parts.items()}
    first = next(iter(parts.values()))
    surface = first.part.surface
    candidates = candidates_of(inspection.job.path, inspection.cell)
    program = inspection.summary["program"]
    logged = {name: one for name, one in inspection.parts.items() if isinstance(one, InspectedPath)}
    fitted = any(one.log.fitted for one in logged.values())
    paths = {
        name: MeasuredPath(one.track.deviation, one.normal_m(), one.figures, one.track.cut_known, bool(one.track.clock))
        for name, one in logged.items()
    }
    files = " and ".join(one.file for one in inspection.parts.values())
    return inspection_page(
        InspectionData(
            title=Path(inspection.job.program.name).name,
            subtitle=f"{files} against what {program} makes in {inspection.cell.name}",
            created=datetime.datetime.now(tz=datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
            surface=surface,
            deviations={name: part.surface_deviation() for name, part in parts.items()},
            features=inspection.features,
            sections=groove_sections(candidates, parts),
            facts={
                name: (facts if isinstance(one, Inspected) else log_facts)(inspection.summary["parts"][name])
                for name, one in inspection.parts.items()
            },
            notes=() if not paths else (NOT_SURFACE, *((FITTED,) if fitted else ())),
            paths=paths,
        )
    )


def facts(entry: dict[str, Any]) -> tuple[Fact, ...]:
    """How a scan was read and placed, in lines.

    Args:
        entry: Of ``parts`` in the summary.
    """
    scan = entry["scan"]
    left_out = f"{scan['outliers']} outliers, {scan['not_numbers']} that were no numbers left out"
    rows = [
        Fact("Scan", scan["file"], "", scan["kind"]),
        Fact("Points", f"{scan['points']}", "", left_out),
        Fact("Unit", scan["unit"]),
        Fact("Noise of one point", f"{scan['noise_um']:.1f} um", "", "scatter of neighbours about a plane"),
        Fact("On no surface of the part", f"{100.0 * scan['unmatched_share']:.1f} %"),
    ]
    pose = entry["registration"]
    if not pose["datum_faces"]:
        return (*rows, Fact("Placed by", "the file itself", "", "taken to be in the part frame"))
    offsets = ", ".join(f"{name} {value:+.1f} um" for name, value in pose["offset_um"].items())
    return (
        *rows,
        Fact("Datum faces", ", ".join(pose["datum_faces"]), "", f"mean distances: {offsets}"),
        Fact("Residual", f"{pose['residual_um']:.1f} um", "", "root mean square distance to the datum faces"),
        *_pose_known(pose),
    )


def log_facts(entry: dict[str, Any]) -> tuple[Fact, ...]:
    """How a path was logged and placed, in lines.

    Args:
        entry: Of ``parts`` in the summary.
    """
    log, pose = entry["log"], entry["registration"]
    smooth = f"deviations smoothed over at most {log['smoothed_over_mm']:g} mm, less where the tool swings"
    rows = (
        Fact("Log", log["file"], "", log["kind"]),
        Fact("Position of the tool", log["position"]),
        Fact("Readings", f"{log['readings']}", "", f"{log['left_out_percent']:g} % further than 5 mm off the path"),
        Fact("Noise of one reading", f"{log['noise_um']:.1f} um", "", smooth if log["smoothed_over_mm"] else ""),
        Fact("Feed motion covered", f"{log['covered_percent']:g} %"),
        Fact("Where the tool cut", log["cutting"]),
        Fact("Frame", log["frame"], "", "fitted to the program's path" if log["frame_fitted"] else "as given"),
    )
    if not log["frame_fitted"]:
        return rows
    residual = Fact("Residual", f"{pose['residual_um']:.1f} um", "", "root mean square across the path that was fitted")
    return (*rows, residual, *_pose_known(pose))


def _pose_known(pose: dict[str, Any]) -> tuple[Fact, ...]:
    """How well a fitted pose is known."""
    sigma = pose["standard_deviation"]
    shifts = ", ".join(f"{value['um']:.1f}" for name, value in sigma.items() if name.startswith("shift"))
    turns = ", ".join(f"{value['urad']:.1f}" for name, value in sigma.items() if name.startswith("turn"))
    return (
        Fact("Pose known to", f"x y z {shifts} um", "", f"about x y z {turns} urad (standard deviations)"),
        Fact("Condition", f"{pose['condition']:g}", "", "1: all six freedoms are held equally well"),
    )
