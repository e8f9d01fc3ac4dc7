"""Tables that ``inspect`` prints."""

from __future__ import annotations

from typing import Any

import typer

from counterflex.cli.output import print_table

WHOLE = 0.9
"""Less of a feature measured is printed."""


def show(summary: dict[str, Any]) -> None:
    """Print the tables of an inspection."""
    names = list(summary["parts"])
    logged = summary["judged"] == "tool path"
    if logged:
        show_paths(summary, names)
    for name in [] if logged else names:
        show_scan(summary["parts"][name]["scan"], summary["parts"][name]["registration"])
    for name in names:
        typer.echo(coverage_line(name, summary["parts"][name]["coverage"], logged))
    print_table(
        f"{summary['program']}: deviation of the "
        + ("surface that this path leaves (not measured)" if logged else "measured surface")
        + ", mm, along the normal",
        ["surface", *(f"{name}: {figure}" for name in names for figure in ("99.7 %", "largest", "rms"))],
        [
            [kind, *(f"{summary['parts'][name][kind][key]:.3f}" for name in names for key in _KEYS)]
            for kind in ("surface", "floor", "wall")
        ],
    )
    show_coverage(summary, names, logged)
    if summary["features"]:
        show_features(summary["features"], names)


def show_features(features: list[dict[str, Any]], names: list[str]) -> None:
    """Print each feature beside its tolerance."""
    print_table(
        "Features: value furthest from nominal, mm",
        ["feature", "quantity", "nominal", "+-", *(c for name in names for c in (name, "U um", "within"))],
        [
            [row["feature"], row["quantity"], f"{row['nominal_mm']:.3f}", f"{row['tolerance_mm']:g}"]
            + [cell for name in names for cell in _cells(row.get(name))]
            for row in features
        ],
        note="U: expanded uncertainty of measurement, k = 2. docs/inspect.md",
    )


def show_scan(scan: dict[str, Any], pose: dict[str, Any]) -> None:
    """Print how a scan was read and placed."""
    typer.echo(
        f"{scan['file']}: {scan['points']} points in {scan['unit']}, noise {scan['noise_um']:.1f} um, "
        f"{scan['outliers']} outliers left out; "
        + (
            f"placed by {', '.join(pose['datum_faces'])}, residual {pose['residual_um']:.1f} um, "
            f"condition {pose['condition']:g}"
            if pose["datum_faces"]
            else "taken to be in the part frame"
        )
    )
    if scan["cut_away"]:
        typer.echo(
            f"{scan['cut_away']} points ({100.0 * scan['cut_away'] / max(scan['points'], 1):.0f} %) lie beside the "
            "blank and are cut away"
        )
    typer.echo(scale_line(scan["scale"]))


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


def show_coverage(summary: dict[str, Any], names: list[str], logged: bool) -> None:
    """Print the areas of each feature that was not wholly measured."""
    rows = []
    for name in names:
        for feature, area in summary["parts"][name]["coverage"]["features"].items():
            if area["judged_mm2"] < WHOLE * area["machined_mm2"]:
                lost = [f"{area[key]:.0f}" for key in ("machined_mm2", "judged_mm2", "unjudged_mm2", "unseen_mm2")]
                rows.append([feature, name, *lost])
    if rows:
        print_table(
            "Features measured in part: machined area, mm2",
            ["feature", "of", "machined", "judged", "not judged", "not logged" if logged else "not scanned"],
            rows,
            note="What was not measured may be out of tolerance. docs/inspect.md#what-was-not-seen",
        )


def show_paths(summary: dict[str, Any], names: list[str]) -> None:
    """Print how the tool was logged, and the figures of its path."""
    for name in names:
        log, pose = summary["parts"][name]["log"], summary["parts"][name]["registration"]
        typer.echo(
            f"{log['file']}: {log['readings']} positions of the tool, {log['position']}; noise {log['noise_um']:.1f} "
            f"um; {log['covered_percent']:g} % of the feed motion; "
            + (
                f"frame fitted to the path, residual {pose['residual_um']:.1f} um, condition {pose['condition']:g}: "
                "what a frame absorbs is left out"
                if log["frame_fitted"]
                else f"frame: {log['frame']}"
            )
        )
    first = summary["parts"][names[0]]["path"]
    rows = [(key, "across the feed" if key == "path" else key) for key in first if key != "normal"]
    print_table(
        f"{summary['program']}: deviation of the path of the tool, mm",
        ["path", *(f"{name}: {figure}" for name in names for figure in ("99.7 %", "largest", "rms"))],
        [
            [title, *(_of(summary["parts"][name]["path"].get(key), one) for name in names for one in _KEYS)]
            for key, title in rows
        ]
        + [
            [
                key.replace("_", " "),
                *(_of(summary["parts"][name]["path"]["normal"].get(key), one) for name in names for one in _KEYS),
            ]
            for key in first["normal"]
        ],
        note="floor, wall left, wall right: along the normal of the surface that the tool makes there. Where it cut: "
        + summary["parts"][names[0]]["log"]["cutting"],
    )


def _of(figures: dict[str, float] | None, key: str) -> str:
    return "" if figures is None else f"{figures[key]:.3f}"


_KEYS = ("p997_mm", "max_mm", "rms_mm")


def _cells(entry: dict[str, Any] | None) -> list[str]:
    if entry is None:
        return ["not found", "", ""]
    uncertainty = f"{2.0 * entry['standard_deviation_um']:.0f}"
    share = entry["measured_share"]
    part = f", {100.0 * share:.0f} % seen" if share < WHOLE else ""
    return [f"{entry['worst_mm']:.3f}", uncertainty, ("yes" if entry["within"] else "no") + part]
