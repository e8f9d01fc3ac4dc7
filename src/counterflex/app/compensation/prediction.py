"""Figures and report data of a plan: what is predicted, before any chip is cut."""

from __future__ import annotations

import datetime
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.compensation.cell_facts import assumptions, drawing, robot_name
from counterflex.app.compensation.headline import (
    LISTED,
    error_rows,
    extrapolation,
    extrapolation_text,
    headline_of,
    named_lines,
    worse_lines,
    worse_warnings,
)
from counterflex.app.compensation.next_steps import after_compensation, to_load
from counterflex.app.cost_of_unknown_stiffness import assumed
from counterflex.app.external_moves import unsaid_moves
from counterflex.app.inputs import Job, setting_of
from counterflex.app.prediction_interval import with_intervals
from counterflex.app.unknown_stiffness import unknown_stiffness
from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, UM
from counterflex.evaluate.figures import DeviationFigures
from counterflex.files.cell.cell import Cell
from counterflex.path.external_axes import ExternalPlaces
from counterflex.path.toolpath import FEED, RAPID
from counterflex.plan.feed_limits import LimitedFeed
from counterflex.plan.feed_schedule import share_between
from counterflex.plan.lasting_swing import lasting_swings
from counterflex.plan.lowest_mode import mode_of
from counterflex.plan.plan import Plan, across, job_hash
from counterflex.plan.stock_grain import GRAIN_M, fine_enough, grain_per_cell
from counterflex.programs.stated.two_readings import doubtful_readings, other_postures
from counterflex.report.data import Fact, FeedData, PredictionData
from counterflex.robot.model.controller_axes import AS_MODEL, ControllerAxes
from counterflex.robot.model.elastic_region import beyond_regions

_OVERSHOOT: Final = 2.0
_FREE_PLAY_M: Final = 20.0 * UM  # Beside the overshoot: what play and friction leave open


def figures(plan: Plan, axes: ControllerAxes = AS_MODEL) -> dict[str, Any]:
    """Peak force, deflection, correction, where they occur, and the predicted path error before and after.

    Args:
        axes: Of the robot: joint angles are those that its controller shows.
    """
    force = np.linalg.norm(plan.w_tcp_part[:, :3], axis=1)
    deflection = np.linalg.norm(plan.deflection_part[:, :3], axis=1)
    correction = np.linalg.norm(plan.correction_part, axis=1)
    judged = plan.judged
    out: dict[str, Any] = {
        "points": len(plan.path),
        "cutting_points": int(np.count_nonzero(plan.cutting)),
        "duration_s": round(float(plan.path.time_s[-1]), 3),
        "removed_mm3": round(float(plan.volume_m3.sum() / MM**3), 3),
        "peak_force_n": _peak(force, plan, axes, 1.0, 1),
        "peak_deflection_um": _peak(deflection, plan, axes, UM, 1),
        "peak_correction_um": _peak(correction, plan, axes, UM, 1),
        "peak_axial_depth_mm": _peak(plan.axial_depth_m, plan, axes, MM, 3),
        "extrapolated_force_share": round(plan.extrapolated_share, 5),
        "collisions": [
            {"line": int(plan.line[row]), "volume_mm3": round(float(plan.volume_m3[row] / MM**3), 4)}
            for row in np.flatnonzero((plan.path.kind == RAPID) & (plan.volume_m3 > 1e-12))
        ],
    }
    for name, deviation in (("nominal", plan.deviation_nominal_part), ("compensated", plan.deviation_compensated_part)):
        if np.all(np.isnan(deviation)):
            continue
        size = np.linalg.norm(across(deviation, plan.path.p_part_tcp), axis=1)[judged]
        out[f"predicted_{name}"] = path_error(size, _weights(plan)[judged])
    out["worse_lines"] = worse_lines(plan)
    out["chatter"] = chatter(plan)
    out["lasting_swings"] = lasting(plan)
    return out


def grain_warnings(job: Job, plan: Plan, cell: Cell) -> list[str]:
    """Return where the plan would be another in finer stock; empty where it has converged."""
    if not plan.cutting.any():
        return []
    setting, size = setting_of(cell, part_may_be_held=True), np.linalg.norm(plan.deflection_part[:, :3], axis=1)
    omega = mode_of(setting.chain, plan.q[int(np.argmax(size))], setting.mode).omega_rad_s
    per_cell = grain_per_cell(job.path, plan.deflection_part, plan.cutting, setting.cutter_of, omega)
    used = fine_enough(cell.stock(), per_cell)
    grain_m = per_cell * used.cell_m
    if grain_m <= GRAIN_M:
        return []
    return [
        "the plan has not converged in the cells of the stock: they shake the tool of the model by "
        f"{grain_m / UM:.1f} um (at most {GRAIN_M / UM:g} um) in cells of {used.cell_m / MM:.3g} mm, the "
        "smallest that planning makes of this stock, which adds to the predicted errors. A smaller blank can have "
        f"[part.stock] cell_mm = {used.cell_m * GRAIN_M / grain_m / MM:.2g} or less"
    ]


def chatter(plan: Plan) -> list[dict[str, Any]]:
    """Lines in which the predicted tool swings up instead of following its force, with how far.

    A force that is there at once makes an elastic tool overshoot to twice what it would yield at rest. What goes
    further is fed by the cut itself, and so is more than that rest where a correction has taken the rest away: the
    figures of such a line are those of a model that chatters, and no correction takes them away.
    """
    cutting, p = plan.cutting, plan.path.p_part_tcp
    at_rest = np.linalg.norm(plan.deflection_part[:, :3] + plan.sag_part + plan.play_part, axis=1)
    most = float(at_rest.max(initial=0.0, where=cutting))
    worst: dict[int, float] = {}
    for deviation, times in ((plan.deviation_nominal_part, _OVERSHOOT), (plan.deviation_compensated_part, 1.0)):
        size = np.linalg.norm(across(deviation, p), axis=1)
        for row in np.flatnonzero(cutting & (size > times * most + _FREE_PLAY_M)):
            line = int(plan.line[row])
            worst[line] = max(worst.get(line, 0.0), float(size[row]))
    return [{"line": line, "deviation_mm": round(size / MM, 3)} for line, size in sorted(worst.items())]


def chatter_warnings(regions: list[dict[str, Any]]) -> list[str]:
    """The same in words; empty where nothing chatters."""
    if not regions:
        return []
    hardest = max(regions, key=lambda item: float(item["deviation_mm"]))
    return [
        f"the model chatters in line {named_lines(regions)}, up to {hardest['deviation_mm']:.3g} mm "
        f"in line {hardest['line']}: predicted errors there are no forecast. Less depth (pecks: G83), another feed or "
        "spindle speed, a stiffer tool"
    ]


def lasting(plan: Plan) -> list[dict[str, Any]]:
    """Lines of the compensated program in which the predicted tool swings and does not come to rest."""
    deviation = plan.deviation_compensated_part
    if np.any(np.isnan(deviation)):
        return []
    swings = lasting_swings(plan.path.time_s, deviation, plan.cutting, plan.line)
    return [{"line": line, "amplitude_mm": round(size / MM, 3)} for line, size in swings]


def swing_warnings(swings: list[dict[str, Any]]) -> list[str]:
    """The same in words; empty where nothing swings."""
    if not swings:
        return []
    hardest = max(swings, key=lambda item: float(item["amplitude_mm"]))
    return [
        f"the arm of the model swings in line {named_lines(swings)} and does not come to rest, by "
        f"{hardest['amplitude_mm']:.3g} mm in line {hardest['line']} (the feed's direction included): the cut "
        "feeds it, and no correction takes it away. Less depth, another posture or spindle "
        "speed; plan stability says which damping of the arm it needs"
    ]


def path_error(size_m: Float, weight_m: Float) -> dict[str, float]:
    """Largest, 99.7 % and rms of an error, weighted by path length, mm."""
    figures = DeviationFigures.weighted(size_m, weight_m)
    values = {"max_mm": figures.max_m, "p997_mm": figures.p997_m, "rms_mm": figures.rms_m}
    return {key: round(value / MM, 4) for key, value in values.items()}


def _weights(plan: Plan) -> Float:
    step = np.linalg.norm(np.diff(plan.path.p_part_tcp, axis=0, prepend=plan.path.p_part_tcp[:1]), axis=1)
    out: Float = np.maximum(step, 1e-12)
    return out


def _peak(values: Float, plan: Plan, axes: ControllerAxes, unit: float, digits: int) -> dict[str, Any]:
    row = int(np.argmax(values))
    return {
        "value": round(float(values[row] / unit), digits),
        "line": int(plan.line[row]),
        "at_mm": [round(float(v / MM), 3) for v in plan.path.p_part_tcp[row]],
        "joints_deg": [round(float(v / DEG), 3) for v in axes.shown(plan.q[row])],
    }


def prediction(
    plan: Plan,
    cell: Cell,
    summary: dict[str, Any],
    limited: LimitedFeed | None = None,
    program: str | Path | None = None,
    places: ExternalPlaces | None = None,
) -> PredictionData:
    """The page of a plan.

    Args:
        program: The program as it was given, for commands; None is its name alone.
    """
    predicted = summary["prediction"]
    worst = predicted["peak_deflection_um"]
    facts = [
        Fact("Program", str(summary["program"])),
        Fact("Robot", robot_name(cell)),
        Fact("Cell", cell.name),
        Fact("Peak force", f"{predicted['peak_force_n']['value']:.0f} N", predicted["peak_force_n"]["place"]),
        Fact("Peak deflection", f"{worst['value'] / 1000:.2f} mm", worst["place"]),
        Fact("Material removed", f"{predicted['removed_mm3'] / 1000:.1f} cm³"),
        Fact("Programmed time", f"{predicted['duration_s']:.0f} s"),
    ]
    facts += [Fact(*row) for row in error_rows(predicted)]
    notes = [f"{text[0].upper()}{text[1:]}." for text in unknown_stiffness(cell)]
    slowed = calm_feed_text(summary["calm_feed"])
    notes += [f"{slowed[0].upper()}{slowed[1:]}."] if slowed else []
    chips = extrapolation_text(predicted["extrapolation"])
    notes += [f"{chips.partition(': ')[2]}."] if chips else []
    swinging = [*chatter_warnings(predicted["chatter"]), *swing_warnings(predicted["lasting_swings"])]
    notes += [f"{text[0].upper()}{text[1:]}." for text in swinging]
    notes += [f"{text[0].upper()}{text[1:]}." for text in worse_warnings(predicted["worse_lines"])]
    notes += [
        f"Rapid in line {c['line']} removes {c['volume_mm3']:.1f} mm3 of material." for c in predicted["collisions"]
    ]
    return PredictionData(
        title=str(summary["program"]),
        subtitle=f"predicted on {cell.name}",
        created=datetime.datetime.now(tz=datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        time_s=plan.path.time_s,
        p_part_tcp=plan.path.p_part_tcp,
        deflection_m=plan.deflection_part[:, :3],
        correction_m=plan.correction_part,
        force_n=np.linalg.norm(plan.w_tcp_part[:, :3], axis=1),
        facts=tuple(facts),
        assumptions=assumptions(cell, plan),
        timing=(Fact("Planning", f"{summary['seconds']:.1f} s"),),
        versions={"counterflex": __version__, "Python": platform.python_version(), "NumPy": np.__version__},
        notes=tuple(notes),
        cutting=plan.judged,
        line=plan.line,
        **_errors(plan, predicted),
        drawing=drawing(plan, cell, places),
        feed=None if limited is None else _feed(limited),
        load=to_load(summary, cell, np.unique(plan.path.tool[plan.cutting]).tolist()),
        next_steps=after_compensation(summary, cell, summary["program"] if program is None else program),
    )


def _feed(limited: LimitedFeed) -> FeedData:
    feed_m_s = np.where(limited.path.kind == FEED, limited.path.feed_m_s, np.nan)
    return FeedData(limited.way_m, limited.programmed_m_s, feed_m_s, limited.binds)


def _errors(plan: Plan, prediction: dict[str, Any]) -> dict[str, Any]:
    """Predicted error along the path and its figures, where it was predicted."""
    if "predicted_compensated" not in prediction:
        return {}
    before, after = (
        np.linalg.norm(across(deviation, plan.path.p_part_tcp), axis=1)
        for deviation in (plan.deviation_nominal_part, plan.deviation_compensated_part)
    )
    return {"error_before_m": before, "error_after_m": after, "headline": headline_of(prediction)}


def beyond_measured(cell: Cell, plan: Plan) -> list[str]:
    """Warnings where the path leaves the angles that errors of the drives or compliances were measured at."""
    known = cell.drive_errors
    ranges = {axis: [f"{angle / DEG:.0f}" for angle in known.measured_rad[axis]] for axis in known.outside(plan.q)}
    return [
        f"axis {axis + 1} leaves the angles at which its periodic errors were measured ({low} to {high} deg, "
        "[drive_error] measured_deg): there they fade to nothing"
        for axis, (low, high) in ranges.items()
    ] + (beyond_regions(cell.chain.regions, plan.q) if cell.chain.regions else [])


def summary_of(
    job: Job,
    plan: Plan,
    cell: Cell,
    language: str,
    *,
    files: dict[str, str],
    written: dict[str, Any],
    tolerance_m: float,
) -> dict[str, Any]:
    """Return what ``summary.json`` says of a compensated program, in shop units.

    Args:
        tolerance_m: Largest distance between the written path and the planned one.
    """
    predicted = with_intervals(figures(plan, cell.chain.axes), plan, cell, job.places)
    predicted["extrapolation"] = extrapolation(plan, cell.force_law)
    for peak in (value for key, value in predicted.items() if key.startswith("peak_")):
        peak["place"] = job.program.place(peak["line"])
    remarks = (
        *unknown_stiffness(cell),
        *unsaid_moves(job.places, cell, language),
        *doubtful_readings(job.program),
        *other_postures(job.program, cell.tables.posture.branch),
        *beyond_measured(cell, plan),
        *chatter_warnings(predicted["chatter"]),
        *swing_warnings(predicted["lasting_swings"]),
        *worse_warnings(predicted["worse_lines"]),
        *grain_warnings(job, plan, cell),
    )
    written = written | {
        "tolerance_um": round(tolerance_m / UM, 3),
        "lines_in": len("\n".join(job.program.lines).splitlines()),
        "lines_out": sum(len(text.splitlines()) for name, text in files.items() if not name.endswith(".dat")),
        "warnings": [*written.get("warnings", ()), *remarks],
    }
    return {
        "job": "compensate",
        "program": Path(job.program.name).name,
        "cell": cell.name,
        "robot": cell.chain.name,
        "language": language,
        "files": list(files),
        "job_hash": job_hash(plan),
        "written": written,
        "prediction": predicted,
        **assumed(cell),
        "calm_feed": calm_feed(job, plan, cell),
    }


def calm_feed(job: Job, plan: Plan, cell: Cell) -> dict[str, Any]:
    """Return where the feed is lower than programmed, and how much longer the program takes, in shop units."""
    share = share_between(job.path, plan.path)
    slow = np.flatnonzero(share < 1.0)
    length = _weights(plan)
    lines = []
    for line in np.unique(plan.line[slow]).tolist():
        rows = slow[plan.line[slow] == line]
        percent, way = 100.0 * float(share[rows].min()), float(length[rows].sum()) / MM
        lines.append({"line": int(line), "feed_percent": round(percent, 1), "length_mm": round(way, 2)})
    return {
        "swing_um": cell.tables.dynamics.swing_um,
        "extra_s": round(float(plan.path.time_s[-1] - job.path.time_s[-1]), 3),
        "lines": lines,
    }


def calm_feed_text(calm: Mapping[str, Any]) -> str:
    """The same in words; empty where the feed is as programmed."""
    lines = calm["lines"]
    if not lines:
        return ""
    least = min(float(line["feed_percent"]) for line in lines)
    length = sum(float(line["length_mm"]) for line in lines)
    named = ", ".join(str(line["line"]) for line in lines[:LISTED]) + (", ..." if len(lines) > LISTED else "")
    return (
        f"the feed is lowered, down to {least:g} %, over {length:.0f} mm before first contact, "
        f"at it and where the path turns, so that the arm does not swing (line {named}): "
        f"{calm['extra_s']:.1f} s longer. Limit: [dynamics] swing_um = {calm['swing_um']:g}; 0 keeps the feed"
    )
