"""Pictures of ours beside what is printed: of the model at once, of the experiments from what was stored of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM, MS
from counterflex.robot.model import load_cases
from counterflex_lab.reproduce.papers import berger2013, denkena2015, haehn2020
from counterflex_lab.reproduce.papers.still import Curve, Level, Still

Results = Mapping[str, Mapping[str, Any]]
"""Results of experiments, by name."""
_AMPLIFIED: Final = 250.0
"""Error of the circle is drawn so much larger: 200 um are 50 mm, as between the circles of the paper."""
_TEETH_MM: Final = np.linspace(0.004, 0.06, 29)


def _denkena(results: Results) -> list[Still]:
    names = ("feed (tangential)", "radial", "axial")
    printed = np.array([1.8, 0.5, 1.1])
    ours = np.array([denkena2015.along(k) for k in range(3)])
    radial = denkena2015.radial_compliance()
    bands = [
        Curve("", np.full(2, float(k)), value * np.array([0.65, 1.35]), colour="#9ca3af")
        for k, value in enumerate(printed.tolist())
    ]
    return [
        Still(
            "denkena2015-compliance",
            "Compliance of a KR 500 by direction, printed and ours",
            "Compliance at the tool in the centre of the working space (section 4). Bars: what counts as reproduced.",
            "direction",
            "um/N",
            (
                *bands,
                Curve("printed", np.arange(3.0), printed, "points", "#111827"),
                Curve("ours", np.arange(3.0), ours, "points"),
            ),
            ticks=names,
            shape="low",
        ),
        Still(
            "denkena2015-angle",
            "Compliance across the tool over the angle of the spindle",
            "Mean compliance of the two directions across the tool, tip in place, spindle upright. The paper chooses "
            "55 deg (points: 55 and 90 deg). Gap: wrist singularity.",
            "angle of the spindle against the flange's axis, deg",
            "um/N",
            (
                Curve("ours", denkena2015.ANGLES_DEG, radial),
                Curve("angles of the paper", *_at(denkena2015.ANGLES_DEG, radial, (55.0, 90.0)), "points", "#111827"),
            ),
            shape="low",
        ),
        *_holder(results.get("holder_design", {})),
    ]


def _holder(run: Mapping[str, Any]) -> list[Still]:
    if not run:
        return []
    shown = (
        ("printed, plain", (0.125, 0.137, 0.034), "#111827"),
        ("printed, with gauges", denkena2015.HOLDER_UM_N, "#9ca3af"),
        ("ours, plain", run["plain_um_n"], ""),
        ("ours, with pockets", run["pockets_um_n"], ""),
    )
    return [
        Still(
            "denkena2015-holder",
            "Compliance of the spindle holder by direction",
            "Table 1 beside our drawing, logarithmic. Ours is far stiffer: rigid base and ring, and other cheeks.",
            "direction",
            "um/N",
            [Curve(name, np.arange(3.0), np.array(values), "points", colour) for name, values, colour in shown],
            ticks=("x", "y", "z"),
            log=True,
            shape="low",
        )
    ]


def _at(x: Float, y: Float, places: tuple[float, ...]) -> tuple[Float, Float]:
    return np.array(places), np.interp(places, x, y)


def _haehn(results: Results) -> list[Still]:
    size = haehn2020.deflections_mm().reshape(-1, len(load_cases.FORCES)).T  # force outermost, as in figure 9
    case = np.arange(1.0, size.shape[1] + 1.0)
    curves = [
        Curve(f"750 N in {name}", float(k * size.shape[1]) + case, size[k], "points")
        for k, name in enumerate(load_cases.FORCES)
    ]
    s = haehn2020.exit_signals()
    shown = np.abs(s.time_s) < 0.3
    t = s.time_s[shown] / MS
    out = [
        Still(
            "haehn2020-load-cases",
            "Deflection of the 60 load cases",
            "Norm of the deflection in the order of figure 9: 20 poses for each direction of the force. Dashed: "
            "mean of the paper's model; of single poses it prints a picture only.",
            "load case",
            "deflection, mm",
            curves,
            (Level("mean of the paper's model, 1.72", load_cases.MODEL_MEAN_MM),),
        ),
        Still(
            "haehn2020-exit",
            "Forces at an exit with pilot control",
            "Figure 3 with our filters: a force that falls within 80 ms, as measured, as predicted with 40 ms lead, "
            "blended, and what has taken effect behind dead time and lag of the robot.",
            "time from the beginning of the fall, ms",
            "force, N",
            (
                Curve("force", t, s.force_n[shown], colour="#111827"),
                Curve("measured, filtered", t, s.measured_n[shown]),
                Curve("predicted", t, s.predicted_n[shown], "dashed"),
                Curve("blended", t, s.blended_n[shown]),
                Curve("measured force, in effect", t, s.measured_acts_n[shown], "dashed"),
                Curve("blended force, in effect", t, s.blended_acts_n[shown], "dashed"),
            ),
        ),
    ]
    return [*out, *_groove(results.get("groove", {}))]


_GROOVES: Final = {
    "uncompensated": ("uncompensated", 1.4),
    "force": ("measured force", 0.7),
    "force_pilot_40ms": ("pilot, 40 ms", 0.3),
    "force_pilot": ("pilot, shaped", None),
    "plan": ("plan alone", None),
    "hybrid": ("plan and rest", None),
}
"""Names of the ways of correcting, and what the paper prints of them, mm."""


def _groove(run: Mapping[str, Any]) -> list[Still]:
    out = []
    if table := run.get("table"):
        names = [name for name in _GROOVES if name in table]
        printed = np.array([_GROOVES[name][1] for name in names], dtype=np.float64)  # None: nan
        edges = [edge for edge in ("straight", "oblique") if all(edge in table[name] for name in names)]
        ours = [
            Curve(
                f"ours, {edge} edge, {kind} truth",
                np.arange(float(len(names))),
                np.array([table[name][edge]["path"][k] for name in names]),
                "points",
            )
            for edge in edges
            for k, kind in enumerate(("median", "worst"))
        ]
        out.append(
            Still(
                "haehn2020-ways",
                "Largest deviation of the groove by way of correcting",
                "Largest error across the feed (figures 10 to 12). The two last columns are ours alone.",
                "",
                "mm",
                [*ours, Curve("printed", np.arange(float(len(names))), printed, "points", "#111827")],
                ticks=[_GROOVES[name][0] for name in names],
            )
        )
    if curves := run.get("curves"):
        out.append(
            Still(
                "haehn2020-groove",
                "Error along the groove with each way of correcting",
                "Error across the feed along one simulated groove, square edge. Dashed: largest deviations that "
                "the paper prints for its part.",
                "way through the blank, mm",
                "error, mm",
                [Curve(_GROOVES[name][0], *_points(curve)) for name, curve in curves.items()],
                [Level(f"printed {value:g}", value) for value in (1.4, 0.7, 0.3)],
            )
        )
    return out


def _points(curve: list[list[float | None]]) -> tuple[Float, Float]:
    both = np.array(curve, dtype=np.float64)
    return both[:, 0], both[:, 1]


def _berger(_: Results) -> list[Still]:
    marks = [(cut.tooth_m / MM, berger2013.zero_normal_width(cut)) for cut in (berger2013.ALUMINIUM, berger2013.STEEL)]
    x, y = np.array(marks).T
    cuts = (("EN AW-7075", berger2013.ALUMINIUM), ("X37CrMoV5-1", berger2013.STEEL))
    gaps = [Curve(name, *berger2013.circle_gap(cut)) for name, cut in cuts]
    widths = [
        Curve(name, _TEETH_MM, np.array([berger2013.zero_normal_width(cut, tooth * MM) for tooth in _TEETH_MM]))
        for name, cut in cuts
    ]
    return [
        Still(
            "berger2013-normal-force",
            "Width of cut without normal force over the feed per tooth",
            "Up-milling: width of cut at which the mean force normal to the feed vanishes. Band: half the diameter, "
            "give or take a tenth. Points: cuts of table 1.",
            "feed per tooth, mm",
            "width of cut / diameter",
            (*widths, Curve("table 1", x, y, "points", "#111827")),
            (Level("printed: half the diameter", 0.45, 0.55),),
        ),
        Still(
            "berger2013-circle",
            "Chip thickness of the circle less that of the trochoid",
            "What the circle of eq. 3 makes of the chip, less the true path of the edge, cuts of table 1.",
            "immersion, deg",
            "% of the feed per tooth",
            gaps,
            (Level("counts as negligible", -1.0, 1.0),),
            shape="low",
        ),
    ]


def _mandiola(results: Results) -> list[Still]:
    curves = results.get("paths", {}).get("curves", {})
    titles = {"off": "without correction", "published": "published gain", "designed": "designed controller"}
    out = []
    circle = {name: _points(curve) for name, curve in curves.get("circle", {}).items()}
    if circle:
        drawn = []
        for name, (angle, error) in circle.items():
            radius = 150.0 + _AMPLIFIED * error / 1000.0
            drawn.append(Curve(titles[name], radius * np.cos(np.radians(angle)), radius * np.sin(np.radians(angle))))
        turn = np.radians(np.linspace(0.0, 360.0, 181))
        rings = [
            Curve(name, r * np.cos(turn), r * np.sin(turn), "dashed", "#9ca3af")
            for name, r in (("", 100.0), ("nominal, and 200 um in and out", 150.0), ("", 200.0))
        ]
        out += [
            Still(
                "mandiola2023-circle",
                "Circle with amplified errors",
                "Circle of 150 mm radius at 700 mm/min, radial error drawn 250 times larger: figure 6. Rings are "
                "200 um apart, as in the paper.",
                "x, mm",
                "y, mm",
                [*rings, *drawn],
                equal=True,
                shape="square",
            ),
            Still(
                "mandiola2023-error",
                "Error of the circle over the angle",
                "Size of the radial error along one turn: figure 7.",
                "angle, deg",
                "error, um",
                [Curve(titles[name], angle, np.abs(error)) for name, (angle, error) in circle.items()],
                (Level("tracker, 25", 25.0),),
            ),
        ]
    square = {name: _points(curve) for name, curve in curves.get("square", {}).items()}
    if square:
        out.append(
            Still(
                "mandiola2023-square",
                "Error along the square over time",
                "Distance of the tool from where it should be at that time, trailing included: figure 5.",
                "time, s",
                "error, um",
                [Curve(titles[name], *points) for name, points in square.items()],
                (Level("tracker, 25", 25.0),),
            )
        )
    return [*out, *_tracked(results.get("paths", {}), titles)]


_TRACKED: Final = (
    ("circle, trailing", ("circle", "turn", "total", "max_um"), 1000.0),
    ("circle, contour", ("circle", "turn", "contour", "max_um"), 200.0),
    ("straights, rms", ("square", "straights", "total", "rms_um"), 25.0),
    ("corners", ("square", "corners", "total", "max_um"), None),
)
"""Errors of one truth: name, keys, and what the paper prints (uncompensated; straights: compensated), um."""


def _tracked(run: Mapping[str, Any], titles: Mapping[str, str]) -> list[Still]:
    """Errors of the first truth of which all are stored."""
    for row in run.get("seeds", ()):
        try:
            values = {name: np.array([_of(row["variants"][name], keys) for _, keys, _ in _TRACKED]) for name in titles}
        except KeyError:
            continue
        at = np.arange(float(len(_TRACKED)))
        printed = np.array([np.nan if value is None else value for _, _, value in _TRACKED], dtype=np.float64)
        return [
            Still(
                "mandiola2023-errors",
                "Errors on circle and square by controller",
                f"Truth seed {row['seed']}, largest where nothing else is said, logarithmic. Printed: above 1000 and "
                "above 200 um without correction; about 25 um on the straights with it.",
                "",
                "um",
                [
                    *(Curve(titles[name], at, value, "points") for name, value in values.items()),
                    Curve("printed", at, printed, "points", "#111827"),
                ],
                ticks=[name for name, _, _ in _TRACKED],
                log=True,
            )
        ]
    return []


def _of(table: Mapping[str, Any], keys: tuple[str, ...]) -> float:
    value: Any = table
    for key in keys:
        value = value[key]
    return float(value)


PICTURES: Final[Mapping[str, Callable[[Results], list[Still]]]] = {
    "denkena2015": _denkena,
    "haehn2020": _haehn,
    "berger2013": _berger,
    "mandiola2023": _mandiola,
}
"""Pictures of a paper."""
