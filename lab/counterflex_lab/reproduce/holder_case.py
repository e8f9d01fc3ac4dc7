"""Files of ``reproduce holder``: a cell whose force comes from its instrumented spindle holder, a cut along an edge.

The cut is that of Denkena2015 section 4: aluminium, end mill D 12 mm with three flutes, 12000 rpm, 3000 mm/min, 1 mm
wide, 10 mm deep. The spindle hangs along the cheeks of the holder, its tool tip 70 mm beside and 420 mm before the
clamped end. The bridges sit where the drawing of the holder says that they tell the force at the tool tip best
(:func:`counterflex.identify.holder.layout.choose_gauges`), which knows nothing of the printed errors.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app import examples
from counterflex.core.arrays import Float
from counterflex.core.atomic import write_text
from counterflex.core.units import DEG, MM
from counterflex.files.schema import write_toml
from counterflex.identify.holder.layout import choose_gauges
from counterflex.sensing.holder_beam import HolderBeam

PROGRAM: Final = "edge.ngc"
CATALOGUE: Final = "catalogue.toml"
"""Cell file before any measurement."""
TCP_MM: Final = (70.0, 0.0, 420.0)
DRAWING: Final[dict[str, Any]] = {
    "length_mm": 180.0,
    "cheek_distance_mm": 160.0,
    "cheek_thickness_mm": 15.0,
    "cheek_width_mm": 118.0,
    "noise_um_m": 0.22,
}
BRIDGES: Final = 6
_BLANK_MM: Final = (150.0, 60.0, 30.0)
_LIMITS: Final[dict[str, Any]] = {"correction_mm": 3.0, "speed_mm_s": 60.0, "acceleration_mm_s2": 4000.0}


@dataclass(frozen=True)
class Way:
    """One way of correcting.

    Attributes:
        title: For people.
        online: What stands in ``[online]`` beside the limits.
        compensated: The robot runs the compensated program.
        armed: The loop acts; else it only watches.
    """

    title: str
    online: dict[str, Any]
    compensated: bool = False
    armed: bool = True


WAYS: Final[dict[str, Way]] = {
    "uncorrected": Way("original program, nothing corrected", {"force": "measured"}, armed=False),
    "holder force": Way("the force of the holder (Fig. 1)", {"force": "measured"}),
    "holder + plan": Way(
        "compensated program and what the holder shows beside the plan", {"force": "scale"}, compensated=True
    ),
}
"""Rows of the table."""


def gauges_mm() -> list[dict[str, float]]:
    """Places of the bridges by the drawing, as ``[[holder.gauges]]`` has them."""
    beam = HolderBeam(*(DRAWING[key] * MM for key in tuple(DRAWING)[:4]))
    chosen = choose_gauges(beam, np.array(TCP_MM) * MM, BRIDGES)
    return [
        {
            **{f"{axis}_mm": round(p / MM, 4) for axis, p in zip("xyz", g.p_holder_gauge, strict=True)},
            "angle_deg": round(g.angle_rad / DEG, 4),
            "factor": g.factor,
        }
        for g in chosen
    ]


def cell_table() -> dict[str, Any]:
    """Tables of the cell before any measurement: the demonstration cell with a holder, its spindle along the flange."""
    table = tomllib.loads(examples.small())
    sensor, spindle = table["end_effector"]
    x, _, z = TCP_MM
    length = float(DRAWING["length_mm"])
    holder = {**sensor, "name": "holder", "source": "Haehn2020 table 1 for the stiffness; mass assumed"}
    hung = {**spindle, "x_mm": x, "z_mm": length, "com_x_mm": 0.0, "com_z_mm": 20.0}
    table["end_effector"] = [holder, hung]
    table["tcp"] = {"z_mm": z - length}
    table["robot"] = {key: value for key, value in table["robot"].items() if key not in ("play", "servo")}
    top = _BLANK_MM[2]
    corners = [[0.0, 0.0, top], [_BLANK_MM[0], 0.0, top], [_BLANK_MM[0], _BLANK_MM[1], top], [0.0, _BLANK_MM[1], top]]
    table["part"] = {
        **table["part"],
        "x_mm": 1300.0,
        "datum_points_mm": corners,
        "stock": {**table["part"]["stock"], "box_max_mm": list(_BLANK_MM)},
    }
    table["tools"] = [
        {"number": 1, "name": "end mill D12 z3", "diameter_mm": 12, "flutes": 3, "helix_deg": 30, "flute_length_mm": 30}
    ]
    table["holder"] = {**DRAWING, "segment": "holder", "tcp_mm": list(TCP_MM), "gauges": gauges_mm()}
    table["dynamics"] = {**table.get("dynamics", {}), "swing_um": 0.0}  # the paper's feed; one plan for both programs
    return table


def program() -> str:
    """G-code: along the front edge of the blank, 1 mm wide, 10 mm deep, down-milling."""
    top = _BLANK_MM[2]
    return "\n".join(
        (
            "(edge after Denkena and Lepper 2015: D12 z3, 12000 rpm, 3000 mm/min, ae 1 mm, ap 10 mm)",
            "G17 G54 G40 G49 G80 G90",
            "G21",
            "M6 T1",
            "G43 H1",
            "M3 S12000",
            f"G0 X{_BLANK_MM[0] + 30:g} Y-5 Z{top + 20:g}",
            f"G0 Z{top + 2:g}",
            f"G1 Z{top - 10:g} F3000",
            "G1 X-25 F3000",
            f"G0 Z{top + 20:g}",
            "M5",
            "M30",
            "",
        )
    )


def catalogue_cell(folder: Path) -> Path:
    """Write program and the cell file before any measurement."""
    write_text(folder / PROGRAM, program())
    write_toml(folder / CATALOGUE, cell_table())
    return folder / CATALOGUE


def write_cells(base: dict[str, Any], place: Path) -> None:
    """Write a cell file for each way of correcting.

    Args:
        base: Tables of the identified cell.
        place: Folder; made when missing.
    """
    place.mkdir(parents=True, exist_ok=True)
    for name, way in WAYS.items():
        write_toml(place / cell_name(name), {**base, "online": {**_LIMITS, "force_from": "holder", **way.online}})


def cell_name(way: str) -> str:
    """File name of the cell of a way of correcting."""
    return f"cell-{way.replace(' + ', '-').replace(' ', '-')}.toml"


def half_widths(error: Float, share: float = 0.95) -> Float:
    """(3,) N that hold a share of the errors (m, 3)."""
    out: Float = np.quantile(np.abs(error), share, axis=0)
    return out
