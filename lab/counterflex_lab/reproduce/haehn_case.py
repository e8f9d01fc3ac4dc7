"""The experiment of Haehn2020 on the simulated cell: grooves, cell files and what is compared.

A groove 9.5 mm deep of an end mill D16 through EN AW-2017 at 25 mm/s (547 N), leaving the blank through an edge square
to the feed, and through one turned by 40 degrees. The feed has the same place and direction in the robot's base in
both: the blank is turned under it.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core.atomic import write_text
from counterflex.core.units import DEG, MM
from counterflex.files.schema import write_toml

EDGES: Final[dict[str, float]] = {"straight": 0.0, "oblique": 40.0}
"""Angle in degrees between the normal of the exit edge and the feed."""
DEPTH_MM: Final = 9.5
FEED_MM_MIN: Final = 1500.0
OUTPUTS: Final = ("cartesian", "axes")
_BLANK_MM: Final = (100.0, 130.0, 40.0)
_CENTRE_BASE_MM: Final = (1400.0, -60.0)
"""Middle of the groove in the robot's base."""
_RUN_MM: Final = 22.0
"""From the edge to the start in the air, and from the edge to the end."""
_ONLINE: Final[dict[str, Any]] = {"correction_mm": 3.0, "speed_mm_s": 60.0, "acceleration_mm_s2": 4000.0}


@dataclass(frozen=True)
class Kind:
    """One way of correcting.

    Attributes:
        online: What stands in ``[online]`` beside the limits.
        compensated: The robot runs the compensated program.
        armed: The loop acts; else it only watches.
        outputs: Ways of sending it that are compared.
    """

    online: dict[str, Any]
    compensated: bool = False
    armed: bool = True
    outputs: tuple[str, ...] = OUTPUTS


KINDS: Final[dict[str, Kind]] = {
    "uncompensated": Kind({"force": "measured"}, armed=False, outputs=("cartesian",)),
    "force": Kind({"force": "measured"}),
    "force_pilot_40ms": Kind({"force": "pilot", "lead_ms": 40.0}, outputs=("cartesian",)),
    "force_pilot": Kind({"force": "pilot"}),
    "plan": Kind({"force": "measured"}, compensated=True, armed=False, outputs=("cartesian",)),
    "hybrid": Kind({"force": "scale"}, compensated=True),
}
"""Without correction; measured force; with pilot control, lead as published and computed; plan alone; plan and rest."""


MIDDLE_M: Final = np.array([0.5 * _BLANK_MM[0], 0.5 * _BLANK_MM[1], 0.0]) * MM
"""Middle of the groove in the part frame, seen from above."""


def cut_length_m(edge: str) -> float:
    """Length of the tool centre's way through the blank, m.

    Args:
        edge: Of :data:`EDGES`.
    """
    return _BLANK_MM[0] * MM / math.cos(EDGES[edge] * DEG)


def names() -> tuple[str, ...]:
    """Names of all variants, ``<kind>`` for Cartesian and ``<kind>_axes`` for axis-specific corrections."""
    return tuple(variant_name(kind, output) for kind, item in KINDS.items() for output in item.outputs)


def variant_name(kind: str, output: str) -> str:
    """Name of a kind sent in one way."""
    return kind if output == "cartesian" else f"{kind}_axes"


def program(angle_deg: float) -> str:
    """G-code of the groove.

    Args:
        angle_deg: Between the feed and x of the part, about z.
    """
    a = angle_deg * DEG
    along = np.array([math.cos(a), math.sin(a)])
    middle = 0.5 * np.array(_BLANK_MM[:2])
    reach = 0.5 * _BLANK_MM[0] / math.cos(a) + _RUN_MM
    start, end = middle - reach * along, middle + reach * along
    top = _BLANK_MM[2]
    return "\n".join(
        (
            f"(groove after Haehn and Weigold 2020, edge turned by {angle_deg:g} degrees)",
            "G17 G54 G40 G49 G80 G90",
            "G21",
            "M6 T1",
            "G43 H1",
            "M3 S13000",
            f"G0 Z{top + 20:g}",
            f"G0 X{start[0]:.4f} Y{start[1]:.4f}",
            f"G0 Z{top + 2:g}",
            f"G1 Z{top - DEPTH_MM:g} F600",
            f"G1 X{end[0]:.4f} Y{end[1]:.4f} F{FEED_MM_MIN:g}",
            f"G0 Z{top + 20:g}",
            "M5",
            "M30",
            "",
        )
    )


def cell_table(base: dict[str, Any], angle_deg: float, online: dict[str, Any] | None = None) -> dict[str, Any]:
    """Tables of a cell file with the groove's blank, turned so that the feed keeps its direction in the base.

    Args:
        base: Tables of the cell: the demonstration cell, or what was identified of it.
        angle_deg: See :func:`program`.
        online: Entries of ``[online]`` beside the limits, or None.
    """
    a = -angle_deg * DEG
    middle = 0.5 * np.array(_BLANK_MM[:2])
    turned = np.array([[math.cos(a), -math.sin(a)], [math.sin(a), math.cos(a)]]) @ middle
    x, y, top = _BLANK_MM
    out = {key: value for key, value in base.items() if key != "online"}
    out["part"] = {
        **base["part"],
        "x_mm": float(_CENTRE_BASE_MM[0] - turned[0]),
        "y_mm": float(_CENTRE_BASE_MM[1] - turned[1]),
        "a_deg": -angle_deg,
        "datum_points_mm": [[0.0, 0.0, top], [x, 0.0, top], [x, y, top], [0.0, y, top]],
        "stock": {**base["part"]["stock"], "box_max_mm": list(_BLANK_MM)},
    }
    out["posture"] = {
        **base["posture"],
        "rotation_about_tool_deg": float(base["posture"]["rotation_about_tool_deg"]) + angle_deg,
    }
    out["dynamics"] = {**base.get("dynamics", {}), "swing_um": 0.0}  # the paper's feed; the robot runs both programs
    if online is not None:
        out["online"] = {**_ONLINE, **online}
    return out


def demonstration_cell() -> dict[str, Any]:
    """Tables of the demonstration cell."""
    text = (resources.files("counterflex.app") / "demo" / "cell.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def write_cells(base: dict[str, Any], folder: Path, edge: str) -> None:
    """Write the program, the cell file of the plan and those of all variants of an edge.

    Args:
        base: See :func:`cell_table`; a rotation about the tool that belongs to the feed along x of the part.
        folder: Made when missing.
        edge: Of :data:`EDGES`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    angle = EDGES[edge]
    write_text(folder / PROGRAM, program(angle))
    write_toml(folder / OFFLINE, cell_table(base, angle))
    for kind, item in KINDS.items():
        for output in item.outputs:
            online = {**item.online, "output": output}
            write_toml(folder / cell_name(kind, output), cell_table(base, angle, online))


PROGRAM: Final = "groove.ngc"
OFFLINE: Final = "cell.toml"
"""Cell file without ``[online]``, from which the plan is made."""


def cell_name(kind: str, output: str) -> str:
    """File name of a variant's cell."""
    return f"cell-{variant_name(kind, output)}.toml"
