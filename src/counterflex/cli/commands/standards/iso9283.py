"""Command iso9283: performance figures of a robot from raw measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import option
from counterflex.cli.commands.question import AsJson
from counterflex.cli.commands.standards.options import Average, Files, Format, FrameOf, Out
from counterflex.cli.output import keep_inputs, print_json, print_table, progress_bar, say_written
from counterflex.core.similar import with_interval


def iso9283(
    files: Files,
    poses: Annotated[
        Path | None,
        option(
            "--poses",
            "Commanded poses: table (.csv: x_mm,y_mm,z_mm[,a_deg,b_deg,c_deg]) or a program that dwells at them.",
            arguments.file,
            "CSV|PROGRAM",
        ),
    ] = None,
    path: Annotated[
        Path | None,
        option(
            "--path",
            "Commanded path: table (.csv, likewise, and speed_mm_s) or a program; judges a path test.",
            arguments.file,
            "CSV|PROGRAM",
        ),
    ] = None,
    frame: FrameOf = "as-measured",
    form: Format = "counterflex",
    average_ms: Average = 0.0,
    band_mm: Annotated[
        float, option("--band-mm", "Limit band of the stabilisation time, mm.", arguments.between(1e-3, 100.0), "MM")
    ] = 0.1,
    multi_directional: Annotated[
        bool, option("--multi-directional", "Every FILE holds the cycles from another direction: vAP.")
    ] = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Compute the figures of ISO 9283:1998 from raw measurements, each with its 95 % interval.

    Pose test: AP, RP, AD, RD, vAP, stabilisation time, overshoot, drift. Path test (--path): AT, RT, CR, CO, AV, RV,
    FV. Cycles are found in the logs by the order of the commanded poses or path.

    Example: `counterflex iso9283 log.csv --path square.ngc --out iso`
    """
    keep_inputs(out, *files, poses, path)
    from counterflex.app.robot_tests import iso9283 as job

    with progress_bar("ISO 9283") as progress:
        summary = job.run(
            files,
            out,
            poses=poses,
            path=path,
            frame=frame,
            form=form,
            average_ms=average_ms,
            band_mm=band_mm,
            by_direction=multi_directional,
            progress=progress,
        )
    if as_json:
        print_json(summary)
        return
    if summary["test"] == "pose":
        _show_poses(summary)
    else:
        _show_path(summary)
    _show_conditions(summary)
    say_written(out, f"wrote {out}: report.html, figures.csv, attained.csv, attained.parquet, summary.json")


def _show_poses(summary: Mapping[str, Any]) -> None:
    rows = summary["poses"]
    print_table(
        f"Poses, {summary['cycles']} cycles; um, 95 % intervals in brackets",
        ["pose", "AP", "AP x", "AP y", "AP z", "RP"],
        [_pose_row(row, ("AP_um", "AP_x_um", "AP_y_um", "AP_z_um", "RP_um")) for row in rows],
    )
    if "AP_a_mdeg" in rows[0]:
        keys = [f"{name}_{axis}_mdeg" for name in ("AP", "RP") for axis in "abc"]
        print_table(
            "Orientation, mdeg (a, b, c about x, y, z)",
            ["pose", *(key.removesuffix("_mdeg").replace("_", " ") for key in keys)],
            [_pose_row(row, keys) for row in rows],
        )
    if summary["distances"]:
        print_table(
            "Distances, um",
            ["poses", "commanded mm", "AD", "RD"],
            [_distance(row) for row in summary["distances"]],
        )
    if "multi_directional" in summary:
        keys = list(summary["multi_directional"][0])[1:]
        print_table(
            f"Multi-directional variation, {summary['directions']} directions",
            ["pose", *keys],
            [_pose_row(row, keys) for row in summary["multi_directional"]],
        )
    if timed := [row for row in rows if {"stabilisation_time_s", "drift"} & row.keys()]:
        print_table(
            f"Over time (limit band {summary['limit_band_mm']:g} mm)",
            ["pose", "stabilisation s", "overshoot um", "drift of AP um", "of RP um", "of barycentre um", "hours"],
            [[str(row["pose"]), *_over_time(row)] for row in timed],
        )


def _pose_row(row: Mapping[str, Any], keys: Sequence[str]) -> list[str]:
    return [str(row["pose"]), *(with_interval(row.get(key)) for key in keys)]


def _distance(row: Mapping[str, Any]) -> list[str]:
    figures = [with_interval(row["AD_um"]), with_interval(row.get("RD_um"))]
    return [f"{row['from']}, {row['to']}", f"{row['commanded_mm']:.3f}", *figures]


def _over_time(row: Mapping[str, Any]) -> list[str]:
    drift = row.get("drift", {})
    stable = [f"{row['stabilisation_time_s']:.3f}", f"{row['overshoot_um']:.1f}"] if "overshoot_um" in row else ["", ""]
    return stable + [f"{drift[key]:g}" if drift else "" for key in ("dAP_um", "dRP_um", "barycentre_um", "hours")]


def _show_path(summary: Mapping[str, Any]) -> None:
    rows = [
        ["AT", "um", with_interval(summary["AT_um"]), f"{summary['AT_at_mm']:g} mm along the path"],
        [
            "RT",
            "um",
            with_interval(summary["RT_um"]),
            "" if summary["RT_um"] is None else f"{summary['RT_at_mm']:g} mm",
        ],
    ]
    rows += [
        [f"{name} {axis}", "mdeg", with_interval(summary[f"{name}_{axis}_mdeg"]), ""]
        for name in ("AT", "RT")
        for axis in "abc"
        if f"{name}_{axis}_mdeg" in summary
    ]
    for corner in summary.get("corner", []):
        place = f"corner {corner['corner']} at {corner['at_mm']:g} mm, {corner['turn_deg']:.0f} deg"
        for name in ("CR", "CO"):
            between = f"{corner[f'{name}_um']:.1f} (cycles from {corner[f'{name}_least_um']:.1f})"
            rows.append([name, "um", between, place])
    v = summary["velocity"]
    if "left_out" not in v:
        where = f"of {v['commanded_mm_s']:g} mm/s, middle of the stretches"
        rows.append(["AV", "%", with_interval(v["AV_percent"], 3), where])
        rows.append(["RV", "%", with_interval(v["RV_percent"], 3), ""])
        rows.append(
            ["FV", "mm/s", f"{v['FV_mm_s']:.2f}", f"noise of one velocity: {v['noise_mm_s']:.2f} mm/s (1 sigma)"]
        )
    print_table(
        f"Path of {summary['length_mm']:g} mm, {summary['cycles']} cycles; 95 % intervals in brackets",
        ["figure", "unit", "value", "where"],
        rows,
    )
    if "left_out" in v:
        typer.echo(f"no velocity figures: {v['left_out']}")


def _show_conditions(summary: Mapping[str, Any]) -> None:
    fitted = ", fitted: accuracies leave out what a frame absorbs" if summary["frame_fitted"] else ""
    typer.echo(f"frame: {summary['frame']}{fitted}; filter: {summary['filter']}; commanded: {summary['commanded']}")
    if summary["cycles"] < summary["cycles_of_the_standard"]:
        typer.echo(f"{summary['cycles']} cycles; the standard measures {summary['cycles_of_the_standard']}")
    for reason, count in summary.get("settling_refused", {}).items():
        typer.echo(f"{count} approaches without a stabilisation time: {reason}")
