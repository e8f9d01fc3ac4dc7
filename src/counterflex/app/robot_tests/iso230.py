"""The jobs `iso230 circularity` and `iso230 straightness`: figures of ISO 230 from logs of a tracker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from counterflex import __version__
from counterflex.app.robot_tests.commanded import commanded_circle, commanded_path
from counterflex.app.tracker_readings import AS_MEASURED, CommandFrame, TrackerMeasurement, read_measured
from counterflex.core import atomic
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.result import Parts, Summary
from counterflex.core.units import MM, MS, UM
from counterflex.evaluate.iso230.circular_test import (
    CLOCKWISE,
    COUNTER_CLOCKWISE,
    BiDirectional,
    Circle,
    Turn,
    fitted_circle,
    turns,
)
from counterflex.evaluate.iso230.straightness import Straightness
from counterflex.evaluate.iso9283.path_cycles import ZONE, path_cycles
from counterflex.files.logs.tracker_exports.formats import OWN
from counterflex.files.summary_file import write_summary

_STRAIGHT_M: Final = 1.0 * UM
_NEARER: Final = (0.3, 0.1, 0.05, 0.05)


class CircularTest(Summary):
    """Turns of a circular test, and pairs of both directions."""

    def _shown(self) -> Parts:
        names = ["G_um", "G_lsc_um", "F_max_um", "F_min_um", "F_nominal_max_um", "F_nominal_min_um", "axial_um"]
        names = [name for name in names if any(row.get(name) is not None for row in self["turns"])]
        figures = "".join(f"{name.removesuffix('_um').replace('_', ' ')}={name}?:.1f | " for name in names)
        title = self.line("Turns about a nominal radius of {radius_mm:g} mm, um") or "Turns, um"
        yield self.rows("turns", title, f"turn | direction | {figures}radius mm:.4f")
        if self["bi_directional"]:
            columns = "pair | G(b)=G_b_um:.1f | G(b) lsc=G_b_lsc_um:.1f | D=D_um:.1f | H (1996)=H_um:.1f"
            yield self.rows("bi_directional", "Both directions, um", columns)
        yield self.line(CONDITIONS)


class StraightnessTest(Summary):
    """Straightness of the stretches of a path."""

    def _shown(self) -> Parts:
        names = ("horizontal", "horizontal_ls", "vertical", "vertical_ls", "cylinder", "cylinder_ls")
        figures = "".join(f" | {name.replace('_', ' ')}={name}_um:.1f" for name in names)
        title = "Straightness, um: minimum zone and least squares (ls)"
        columns = f"stretch | cycle | length mm:.1f{figures}"
        yield self.rows("stretches", title, columns, "left out: {ends_left_out}")
        yield self.line(CONDITIONS)


CONDITIONS: Final = "frame: {frame}; filter: {filter}; commanded: {commanded}"


def circular(
    files: Sequence[str | Path],
    out: str | Path | None = None,
    *,
    path: str | Path | None = None,
    radius_mm: float | None = None,
    frame: str = AS_MEASURED,
    form: str = OWN,
    average_ms: float = 0.0,
    progress: Progress = silent,
) -> CircularTest:
    """Judge circular paths by ISO 230-4; with ``out``, write tables, ``summary.json`` and ``report.html``.

    Args:
        path: Commanded circle, a table or a program; None takes plane and centre from the readings.
        radius_mm: Nominal radius where there is no ``path``; without both there is no F and no D.

    Raises:
        CounterflexError: A file cannot be used, or holds no whole turn.
    """
    if path is not None and radius_mm is not None:
        raise InputError("the radius is given twice", where="--path and --radius-mm", hint="Give one of them")
    place, measured = _read(files, frame, form, average_ms, progress)
    if place.fitted:
        raise InputError(
            "a fitted frame says nothing about a circle", where="--frame", value="fit",
            hint="Leave --frame and --path away: plane and centre are then taken from the readings",
        )  # fmt: skip
    nominal = None if path is None else commanded_circle(path)
    radius = _radius(nominal, radius_mm)
    matches = [(one.name, turn) for one in measured for turn in _turns(one, nominal)]
    progress(0.6)
    by_nominal = nominal is not None
    rows = [
        {"turn": k, "file": name, **_turn_row(turn, radius, by_nominal)} for k, (name, turn) in enumerate(matches, 1)
    ]
    each = [turn for _, turn in matches]
    both = _pairs(each, radius)
    summary = {
        "job": "iso230 circularity",
        "standard": "ISO 230-4",
        **_conditions(measured, path, place, average_ms),
        "radius_mm": None if radius is None else round(radius / MM, 6),
        "centre": "nominal" if by_nominal else "of the readings",
        "turns": rows,
        "bi_directional": both,
        "largest": {
            "G_um": max(row["G_um"] for row in rows),
            "G_b_um": max((row["G_b_um"] for row in both), default=None),
        },
        "counterflex": __version__,
    }
    if out is not None:
        from counterflex.report.robot_tests.iso230_page import circle_page

        table = pl.concat([_turn_table(k, turn) for k, turn in enumerate(each, 1)])
        _write(out, summary, pl.DataFrame(rows), table, circle_page(summary, each))
    progress(1.0)
    return CircularTest(summary)


def _radius(nominal: Circle | None, stated_mm: float | None) -> float | None:
    if nominal is not None:
        return nominal.radius_m
    return None if stated_mm is None else stated_mm * MM


def _turns(one: TrackerMeasurement, nominal: Circle | None) -> Sequence[Turn]:
    return turns(one.p, fitted_circle(_on_circle(one.p)) if nominal is None else nominal)


def _pairs(each: Sequence[Turn], radius: float | None) -> list[dict[str, Any]]:
    """Bi-directional figures of each turn clockwise with the one counter-clockwise of the same number."""
    clockwise, other = ([turn for turn in each if turn.direction == way] for way in (CLOCKWISE, COUNTER_CLOCKWISE))
    return [
        {"pair": k} | _in_um(asdict(BiDirectional.of(cw, ccw, radius)))
        for k, (cw, ccw) in enumerate(zip(clockwise, other, strict=False), 1)
    ]


def straight(
    files: Sequence[str | Path],
    out: str | Path | None = None,
    *,
    path: str | Path | None = None,
    frame: str = AS_MEASURED,
    form: str = OWN,
    average_ms: float = 0.0,
    progress: Progress = silent,
) -> StraightnessTest:
    """Judge the straight stretches of a path; with ``out``, write tables, ``summary.json`` and ``report.html``.

    Args:
        path: Commanded path, a table or a program; None takes every file as one straight line.

    Raises:
        CounterflexError: A file cannot be used, or holds no straight stretch.
    """
    place, measured = _read(files, frame, form, average_ms, progress)
    if place.fitted:
        raise InputError(
            "a straightness needs no fitted frame", where="--frame", value="fit", hint="Leave --frame away"
        )
    parts = [part for one in measured for part in _straights(one, path)]
    if not parts:
        raise InputError("the commanded path has no straight stretch", where=str(path))
    progress(0.6)
    rows: list[dict[str, Any]] = []
    for head, p in parts:
        s = asdict(Straightness.of(p))
        rows.append({**head, "length_mm": round(s.pop("length_m") / MM, 3), **_in_um(s)})
    keys = ("horizontal_um", "vertical_um", "cylinder_um")
    summary = {
        "job": "iso230 straightness",
        "standard": "ISO 230-1, ISO 1101",
        **_conditions(measured, path, place, average_ms),
        "stretches": rows,
        "largest": {key: max(row[key] for row in rows) for key in keys},
        "ends_left_out": f"{ZONE:.0%} of each stretch at either end" if path is not None else "none",
        "counterflex": __version__,
    }
    if out is not None:
        from counterflex.report.robot_tests.iso230_page import rests, straight_page

        table = pl.concat([_straight_table(k + 1, rests(p)) for k, (_, p) in enumerate(parts)])
        _write(out, summary, pl.DataFrame(rows), table, straight_page(summary, [p for _, p in parts]))
    progress(1.0)
    return StraightnessTest(summary)


def _read(
    files: Sequence[str | Path], frame: str, form: str, average_ms: float, progress: Progress
) -> tuple[CommandFrame, list[TrackerMeasurement]]:
    place, measured = CommandFrame.of(frame), []
    for k, file in enumerate(files):
        one = read_measured(file, form).averaged(average_ms * MS)
        measured.append(one.moved(place.T_command_log, place.T_target_tcp))
        progress(0.4 * (k + 1) / len(files), f"reading {Path(file).name}")
    return place, measured


def _conditions(
    measured: Sequence[TrackerMeasurement], path: str | Path | None, place: CommandFrame, average_ms: float
) -> dict[str, Any]:
    return {
        "files": [one.name for one in measured],
        "commanded": "not given" if path is None else Path(path).name,
        "frame": place.text,
        "frame_fitted": place.fitted,
        "filter": f"moving mean over {average_ms:g} ms" if average_ms > 0.0 else "none",
        "tracker_sigma_um": round(max(one.sigma_m for one in measured) / UM, 3),
    }


def _on_circle(p: Float) -> Float:
    """Readings that lie on the main circle of a log, matches closer and closer to it."""
    kept = p
    for share in _NEARER:
        circle = fitted_circle(kept)
        away = p - circle.centre
        rho = np.linalg.norm(away @ circle.axes.T, axis=1)
        middle = float(np.median(np.linalg.norm((kept - circle.centre) @ circle.axes.T, axis=1)))
        off = np.hypot(rho - middle, away @ circle.normal)
        kept = p[off < share * circle.radius_m]
        if len(kept) < 4:
            raise InputError("the log holds no circle", hint="Give the commanded circle: --path")
    return kept


def _turn_row(turn: Turn, radius_m: float | None, nominal: bool) -> dict[str, Any]:
    f = turn.figures(radius_m, nominal_centre=nominal)
    values = {name: value for name, value in asdict(f).items() if name not in ("direction", "radius_m", "centre_m")}
    out: dict[str, Any] = {"direction": f.direction, "readings": len(turn.points), **_in_um(values)}
    out["radius_mm"] = round(f.radius_m / MM, 5)
    out["centre_x_um"], out["centre_y_um"] = (round(c / UM, 2) for c in f.centre_m)
    return out


def _in_um(values: Mapping[str, float | None]) -> dict[str, Any]:
    """``g_m`` as ``G_um`` and so on; the letters of the standard are capitals."""
    out = {}
    for name, value in values.items():
        plain = name.removesuffix("_m")
        head, _, rest = plain.partition("_")
        plain = f"{head.upper()}_{rest}".rstrip("_") if len(head) == 1 else plain
        out[f"{plain}_um"] = None if value is None else round(value / UM, 2)
    return out


def _turn_table(number: int, turn: Turn) -> pl.DataFrame:
    n = len(turn.points)
    return pl.DataFrame(
        {
            "turn": np.full(n, number),
            "direction": [turn.direction] * n,
            "angle_deg": np.degrees(np.arctan2(turn.points[:, 1], turn.points[:, 0])),
            "radius_mm": np.linalg.norm(turn.points, axis=1) / MM,
        }
    )


def _straights(one: TrackerMeasurement, path: str | Path | None) -> list[tuple[dict[str, Any], Float]]:
    """Readings of every straight stretch and cycle."""
    if path is None:
        return [({"file": one.name, "stretch": 1, "cycle": 1}, one.p)]
    commanded = commanded_path(path)
    cycles = path_cycles(commanded, one.p)
    if not cycles:
        raise InputError("no attained path goes along the commanded one", where=one.name, hint="Check --frame")
    length = commanded.length
    out = []
    for k, (begin, end) in enumerate(commanded.stretches):
        inside = (length >= begin - 1e-12) & (length <= end + 1e-12)
        points = commanded.p[inside]
        t = (points[-1] - points[0]) / np.linalg.norm(points[-1] - points[0])
        if float(np.abs(np.cross(points - points[0], t)).max()) > _STRAIGHT_M:
            continue
        low, high = begin + ZONE * (end - begin), end - ZONE * (end - begin)
        for j, cycle in enumerate(cycles):
            rows = (cycle.length_m >= low) & (cycle.length_m <= high)
            out.append(({"file": one.name, "stretch": k + 1, "cycle": j + 1}, cycle.p[rows]))
    return out


def _straight_table(number: int, rest: tuple[Float, Float, Float]) -> pl.DataFrame:
    x, h, v = rest
    return pl.DataFrame(
        {"row": np.full(len(x), number), "along_mm": x / MM, "horizontal_um": h / UM, "vertical_um": v / UM}
    )


def _write(out: str | Path, summary: dict[str, Any], rows: pl.DataFrame, table: pl.DataFrame, page: str) -> None:
    from counterflex.report.page import write_page

    with atomic.atomic_folder(out) as staging:
        atomic.write_text(staging / "figures.csv", rows.write_csv())
        atomic.write_made(staging / "readings.parquet", table.write_parquet)
        write_summary(staging / "summary.json", summary)
        write_page(page, staging / "report.html")
