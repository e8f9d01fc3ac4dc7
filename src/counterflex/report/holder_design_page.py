"""The page of a holder's design: stiffness lost, signal gained, strain on the cheek, and the spindle in the robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from counterflex.report.page import render

_MARGIN: Final = {"l": 64, "r": 12, "t": 16, "b": 48}


@dataclass(frozen=True)
class _Head:
    title: str
    subtitle: str
    created: str = ""


def holder_design_page(summary: Mapping[str, Any], surface: Mapping[str, Any]) -> str:
    """The page, as HTML text.

    Args:
        surface: ``y_mm``, ``z_mm`` and ``strain`` (rows by z) of the outer face of a cheek, um/m by 1 kN along x.
    """
    figures = {"compliance": _bars(summary), "strain": _heat(surface["y_mm"], surface["z_mm"], surface["strain"],
               ("across the cheek, mm", "along the cheek, mm"), "um/m")}  # fmt: skip
    maps = []
    if summary["spindle"] is not None:
        spindle = summary["spindle"]
        high = max((v for row in spindle["angles"] for line in row["radial_um_n"] for v in line if v is not None),
                   default=1.0)  # fmt: skip
        for k, row in enumerate(spindle["angles"]):
            name = f"radial{k}"
            titles = ("distance from axis 1, mm", "height, mm")
            figures[name] = _heat(spindle["x_mm"], spindle["z_mm"], row["radial_um_n"], titles, "um/N", high)
            maps.append({"name": name, **row})
    lost = max(summary["lost_stiffness_percent"])
    gain = max(abs(row["gain"]) for row in summary["bridges"])
    verdict = (
        f"The pockets cost {lost:.1f} % of the stiffness at the tool tip and raise the strain up to {gain:.1f} times."
    )
    head = _Head(f"Holder: {summary['holder']}", f"{summary['unknowns']} unknowns, bricks of {summary['mesh_mm']:g} mm")
    return render("holder_design.html.j2", figures, [], data=head, summary=summary, verdict=verdict, maps=maps)


def _bars(summary: Mapping[str, Any]) -> dict[str, Any]:
    rows = summary["compliance_um_per_kn"]
    named = (
        ("without_pockets", "without pockets", "#9aa5b0"),
        ("with_pockets", "with pockets", "#e2701c"),
        ("beams_timoshenko", "beams, without pockets", "#26384a"),
    )
    data = [
        {"type": "bar", "name": name, "x": ["x", "y", "z"], "y": rows[key], "marker": {"color": colour}}
        for key, name, colour in named
    ]
    layout = {
        "height": 320, "margin": _MARGIN, "barmode": "group", "legend": {"orientation": "h"},
        "yaxis": {"title": {"text": "compliance at the tool tip, um/kN"}},
    }  # fmt: skip
    return {"data": data, "layout": layout}


def _heat(
    x: list[float], y: list[float], z: list[list[float | None]], titles: tuple[str, str], unit: str,
    high: float | None = None,
) -> dict[str, Any]:  # fmt: skip
    trace: dict[str, Any] = {
        "type": "heatmap", "x": x, "y": y, "z": z, "colorscale": "Viridis", "colorbar": {"title": {"text": unit}},
        "hovertemplate": f"%{{x:.0f}}, %{{y:.0f}} mm: %{{z:.3g}} {unit}<extra></extra>",
    }  # fmt: skip
    if high is not None:
        trace |= {"zmin": 0.0, "zmax": high}
    layout = {
        "height": 420, "margin": _MARGIN,
        "xaxis": {"title": {"text": titles[0]}, "zeroline": False, "constrain": "domain"},
        "yaxis": {"title": {"text": titles[1]}, "zeroline": False, "scaleanchor": "x", "constrain": "domain"},
    }  # fmt: skip
    return {"data": [trace], "layout": layout}
