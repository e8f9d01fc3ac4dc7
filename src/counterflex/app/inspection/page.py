"""Fill the page of an inspection."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from counterflex.app.inspection.judging import Inspection
from counterflex.app.inspection.summary import InspectedScan
from counterflex.app.inspection.tool_path import InspectedPath
from counterflex.app.proof.judge import candidates_of
from counterflex.core.units import MM
from counterflex.evaluate.inspection.coverage import Coverage
from counterflex.evaluate.inspection.sections import groove_sections
from counterflex.report.data import Fact
from counterflex.report.inspection.page import InspectionData, MeasuredPath

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
    return InspectionData(
        title=Path(inspection.job.program.name).name,
        subtitle=f"{files} against what {program} makes in {inspection.cell.name}",
        created=datetime.datetime.now(tz=datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        surface=surface,
        deviations={name: part.surface_deviation() for name, part in parts.items()},
        features=inspection.features,
        sections=groove_sections(candidates, parts),
        facts={
            name: (facts if isinstance(one, InspectedScan) else log_facts)(inspection.summary["parts"][name])
            for name, one in inspection.parts.items()
        },
        coverage=inspection.covered,
        notes=(
            *(() if not paths else (NOT_SURFACE, *((FITTED,) if fitted else ()))),
            *_unseen(inspection.covered, bool(paths)),
            *_scales(inspection.parts),
        ),
        paths=paths,
    ).page()


def _unseen(covered: Mapping[str, tuple[Coverage, Mapping[str, Coverage]]], logged: bool) -> tuple[str, ...]:
    """Note of each part whose machined surface was not wholly measured."""
    return tuple(
        f"{'' if name == 'part' else name.capitalize() + ': '}{(one.machined_m2 - one.judged_m2) / MM**2:.0f} of "
        f"{one.machined_m2 / MM**2:.0f} mm² machined were not judged"
        + ("" if logged else f", {one.unseen_m2 / MM**2:.0f} mm² of them not scanned at all")
        + ". Figures and features say nothing about them."
        for name, (one, _) in covered.items()
        if not one.whole
    )


def _scales(parts: Mapping[str, InspectedScan | InspectedPath]) -> tuple[str, ...]:
    """Note of each scan whose scale is not 1."""
    return tuple(
        f"{one.file}: {100.0 * one.scale.scale:+.4f} % ± {100.0 * one.scale.sigma:.4f} % of scale in "
        f"{len(one.scale.agreeing)} directions alike, {abs(one.scale.scale) * 1e5:.0f} µm over 100 mm. U holds it."
        for one in parts.values()
        if isinstance(one, InspectedScan) and one.scale.common and one.scale.significant
    )


def facts(entry: dict[str, Any]) -> tuple[Fact, ...]:
    """Return how a scan was read and placed, in lines.

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
        Fact("Cut away beside the blank", f"{scan['cut_away']}", "", "table, vice, clamps"),
        _scale_fact(scan["scale"]),
    ]
    if scan["ball_diameter_mm"]:
        rows.append(Fact("Centres of a ball", f"{scan['ball_diameter_mm']:g} mm", "", "its radius is taken away"))
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


def _scale_fact(scale: dict[str, Any]) -> Fact:
    if scale["percent"] is None:
        return Fact("Scale", "not known", "", "no two opposite faces of the blank were scanned")
    each = ", ".join(f"{axis} {value:+.4f} %" for axis, value in scale["directions_percent"].items())
    agree = ", ".join(scale["directions_agree"])
    alike = f"{agree} agree" if agree else "the size of the blank is in it"
    value = f"{scale['percent']:+.4f} ± {scale['standard_deviation_percent']:.4f} %"
    return Fact("Scale against the blank", value, "", f"{each}; {alike}")


def log_facts(entry: dict[str, Any]) -> tuple[Fact, ...]:
    """Return how a path was logged and placed, in lines.

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
    """Return how well a fitted pose is known."""
    sigma = pose["standard_deviation"]
    shifts = ", ".join(f"{value['um']:.1f}" for name, value in sigma.items() if name.startswith("shift"))
    turns = ", ".join(f"{value['urad']:.1f}" for name, value in sigma.items() if name.startswith("turn"))
    return (
        Fact("Pose known to", f"x y z {shifts} um", "", f"about x y z {turns} urad (standard deviations)"),
        Fact("Condition", f"{pose['condition']:g}", "", "1: all six freedoms are held equally well"),
    )
