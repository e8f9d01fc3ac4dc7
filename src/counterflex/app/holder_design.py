"""Design of a sensing spindle holder: what its pockets cost in stiffness and give in signal."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.placement.region import Mounting
from counterflex.core import atomic
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ReachError
from counterflex.core.progress import Progress, silent
from counterflex.core.result import Parts, ShownTable, Summary, fill
from counterflex.core.units import KN, MICRO, MM, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.holder_file import holder_data, read_holder
from counterflex.files.schema import write_toml
from counterflex.files.summary_file import write_summary
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.robot.kinematics.inverse import inverse_all
from counterflex.sensing.holder_design.bricks import solve
from counterflex.sensing.holder_design.drawing import BRICKS, Drawing
from counterflex.sensing.holder_design.places import (
    Behaviour,
    Chosen,
    beam_tip,
    behaviour,
    gain_by_pocket,
    lost_stiffness,
    without_ribs,
)
from counterflex.sensing.strain_holder import printed_condition

_SETTLED: Final = 5.0  # Change of a strain from half as many bricks above which more are advised, %


@dataclass(frozen=True)
class Spindle:
    """Spindle and angles that are mapped."""

    cell: Path
    mounting: Mounting | None = None  # Body and angles of the spindle, or None: as the cell file has it
    force_n: float = 500.0
    points: int = 9  # Places along each axis of a map

    def maps(self) -> dict[str, Any]:
        """Radial and axial compliance at the tool tip, tool vertical, over an upright plane in front of the robot.

        At each place the posture of least radial compliance is taken. Radial is the softest direction across the tool.

        Returns:
            The places, and for each angle of the spindle the two maps in um/N and the figures of the middle of the map.

        Raises:
            CounterflexError: The cell cannot be read, or has no such body.
        """
        cell = read_cell(self.cell)
        mounting = self.mounting
        angles: list[float | None] = [None]
        if mounting is not None:
            angles = list(dict.fromkeys([mounting.present_deg(cell), *mounting.values_deg]))
        T = cell.T_base_part
        reach = float(np.linalg.norm(T[:3, 3]))
        x = np.linspace(0.55, 1.25, self.points) * float(np.linalg.norm(T[:2, 3]))
        z = T[2, 3] + np.linspace(-0.25, 0.25, self.points) * reach
        rows = []
        for angle in angles:
            own = cell if mounting is None or angle is None else mounting.cell(cell, angle)
            rows.append(_maps(own, angle, x, z, self.force_n))
        return {
            "cell": cell.label,
            "force_n": self.force_n,
            "mounting": None if mounting is None else f"{mounting.body}.{mounting.key}",
            "x_mm": [round(v / MM, 1) for v in x.tolist()],
            "z_mm": [round(v / MM, 1) for v in z.tolist()],
            "angles": rows,
        }


def _maps(cell: Cell, angle: float | None, x: Float, z: Float, force_n: float) -> dict[str, Any]:
    radial: list[list[float | None]] = []
    axial: list[list[float | None]] = []
    bearing = np.arctan2(cell.T_base_part[1, 3], cell.T_base_part[0, 3])
    for height in z:
        places = [_at(cell, bearing, float(along), float(height)) for along in x]
        radial.append([None if one is None else round(one[0] / UM, 4) for one in places])
        axial.append([None if one is None else round(one[1] / UM, 4) for one in places])
    known = np.array([value for row in radial for value in row if value is not None])
    return {
        "angle_deg": angle,
        "radial_um_n": radial,
        "axial_um_n": axial,
        "reached": len(known),
        "median_um": None if len(known) == 0 else round(float(np.median(known)) * force_n, 2),
        "least_um": None if len(known) == 0 else round(float(known.min()) * force_n, 2),
        "most_um": None if len(known) == 0 else round(float(known.max()) * force_n, 2),
    }


def _at(cell: Cell, bearing: float, along: float, height: float) -> tuple[float, float] | None:
    """Least radial compliance over the postures at a place and the axial one in it, m/N; None where none reaches."""
    best: tuple[float, float] | None = None
    for turn in np.radians([0.0, 90.0, 180.0, 270.0]):
        c, s = np.cos(bearing + turn), np.sin(bearing + turn)
        T = np.eye(4)
        T[:3, :3] = np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]])
        T[:3, 3] = along * np.cos(bearing), along * np.sin(bearing), height
        try:
            solutions = inverse_all(cell.chain, T)
        except ReachError:
            continue
        for one in solutions:
            C = cartesian_compliance(cell.chain, one.q)[:3, :3]
            soft = float(np.linalg.eigvalsh(C[:2, :2])[-1])
            if best is None or soft < best[0]:
                best = soft, float(C[2, 2])
    return best


PAPER_UM_PER_KN: Final = ((125.0, 137.0, 34.0), (137.0, 168.0, 48.0))
"""Compliance of the holder of Denkena2015 at the tool tip by direction, without and with gauges (table 1)."""
CHOSEN: Final = "holder.toml"


class HolderDesign(Summary):
    """Stiffness lost and signal gained by the pockets of a holder."""

    def _shown(self) -> Parts:
        rows = [
            [name.replace("_", " "), *(f"{v:.2f}" for v in row)] for name, row in self["compliance_um_per_kn"].items()
        ]
        rows += [
            [what, *(f"{v:.1f}" for v in self[key])]
            for what, key in (
                ("stiffness lost, %", "lost_stiffness_percent"), ("Denkena2015, lost, %", "denkena2015_lost_percent")
            )
        ]  # fmt: skip
        yield ShownTable(f"Compliance at the tool tip of {self['holder']}, um/kN", ["", "x", "y", "z"], rows)
        yield self.rows(
            "bridges",
            "Bridges: strain by a force at the tool tip, um/m per kN",
            "cheek | face | y mm:g | z mm:g | x=strain_um_m_per_kn[0]:.2f | y=strain_um_m_per_kn[1]:.2f | "
            "z=strain_um_m_per_kn[2]:.2f | gain:.2f | rib=rib_gain:.2f",
        )
        if self["condition_of_m"] is not None:
            yield self.line(
                "condition of M {condition_of_m:g} (Denkena2015, printed: {denkena2015_condition:g}); {noise_um_m:g} "
                "um/m of noise are {force_sigma_n[0]:.1f} N along x, {force_sigma_n[1]:.1f} N along y, "
                "{force_sigma_n[2]:.1f} N along z"
            )
        yield self._settled_line()
        spindle = self["spindle"]
        for row in [] if spindle is None else spindle["angles"]:
            angle = "as it is" if row["angle_deg"] is None else f"{spindle['mounting']} = {row['angle_deg']:g} deg"
            yield f"spindle {angle}: {spindle['force_n']:g} N radial bend the arm by a median of " + fill(
                "{median_um} um ({least_um} to {most_um}, {reached} places)", row
            )

    def _settled_line(self) -> str:
        settled, bricks = self["settled_percent"], self["bricks"]
        if settled is None:
            return "warning: one brick over a pocket: the strains may be wrong by half; give --bricks 4 or more"
        more = "" if settled["strain"] <= _SETTLED else f"; give --bricks {2 * bricks} or more"
        return (
            f"{'warning' if more else 'note'}: from {max(1, bricks // 2)} to {bricks} bricks over a pocket the strains "
            f"change by {settled['strain']:g} %, the compliance by {settled['compliance']:g} %: they are settled to "
            f"about as much{more}"
        )


def run(
    holder: str | Path,
    out: str | Path,
    *,
    mesh_mm: float = 12.0,
    bricks: int = BRICKS,
    choose_count: int | None = None,
    lost_percent: float = 10.0,
    spindle: Spindle | None = None,
    progress: Progress = silent,
) -> HolderDesign:
    """Write ``report.html``, ``summary.json`` and, with a choice of places, ``holder.toml`` into ``out``: all or none.

    Args:
        mesh_mm: Largest edge of a brick.
        bricks: Fewest over the height, width and depth of every pocket and over the wall behind it; half as many are
            solved too, to say how far the figures have settled.
        choose_count: Bridges to choose places for, pockets like the first of the drawing; None takes the drawing's.
        lost_percent: Largest loss of stiffness at the tool tip that a choice may cost, any direction.
        spindle: The cell and the angles at which its spindle may be mounted; None leaves the maps out.

    Raises:
        CounterflexError: The drawing or the cell does not allow it.
    """
    begin = time.perf_counter()
    file = read_holder(holder)
    drawing = file.drawing(str(holder))
    if not drawing.pockets:
        raise InputError("the drawing has no pockets", where=str(holder), hint="Add a table [[pockets]]")
    maps = None if spindle is None else spindle.maps()  # first: its files may be wrong, elements take long
    mesh_m, trials = mesh_mm * MM, 0
    if choose_count is not None:
        chosen = Chosen.of(drawing, choose_count, lost_percent / 100.0, mesh_m, file.noise, bricks=bricks)
        drawing, plain, cut, trials = chosen.drawing, chosen.plain, chosen.cut, chosen.trials
    else:
        plain = behaviour(drawing, mesh_m, file.noise, cut=False, bricks=bricks)
        cut = behaviour(drawing, mesh_m, file.noise, bricks=bricks)
    progress(0.4)
    bridged = any(p.bridged for p in drawing.pockets)
    floor = behaviour(without_ribs(drawing), mesh_m, file.noise, bricks=bricks) if bridged else None
    half = behaviour(drawing, mesh_m, file.noise, bricks=max(1, bricks // 2))
    progress(0.7)
    bernoulli, timoshenko = beam_tip(drawing.beam, np.array(drawing.p_holder_tcp))
    summary = {
        "job": "holder design",
        "holder": file.name or Path(holder).name,
        "mesh_mm": mesh_mm,
        "bricks": bricks,
        "unknowns": cut.unknowns,
        "settled_percent": _settled(cut, half, bricks),
        "compliance_um_per_kn": {
            "without_pockets": _um_per_kn(plain.tip_m_per_n),
            "with_pockets": _um_per_kn(cut.tip_m_per_n),
            "beams_euler_bernoulli": _um_per_kn(bernoulli),
            "beams_timoshenko": _um_per_kn(timoshenko),
            "denkena2015_without": list(PAPER_UM_PER_KN[0]),
            "denkena2015_with": list(PAPER_UM_PER_KN[1]),
        },
        "lost_stiffness_percent": _rounded(100.0 * lost_stiffness(plain, cut), 2),
        "denkena2015_lost_percent": _rounded(100.0 * (1.0 - np.divide(*map(np.array, PAPER_UM_PER_KN))), 2),
        "bridges": _bridges(drawing, cut, floor),
        "condition_of_m": None if cut.sight is None else round(cut.sight.condition, 3),
        "denkena2015_condition": round(printed_condition()[0], 3),
        "force_sigma_n": None if cut.sight is None else _rounded(cut.sight.sigma_n, 3),
        "noise_um_m": file.noise_um_m,
        "chosen": None if choose_count is None else {"bridges": choose_count, "limit_percent": lost_percent,
                                                     "trials": trials},
        "spindle": maps,
        "seconds": round(time.perf_counter() - begin, 3),
        "counterflex": __version__,
    }  # fmt: skip
    progress(0.9)
    with atomic.atomic_folder(out) as staging:
        from counterflex.report.holder_design_page import holder_design_page
        from counterflex.report.page import write_page

        write_summary(staging / "summary.json", summary)
        if choose_count is not None:
            write_toml(staging / CHOSEN, holder_data(file, drawing), comment="Places chosen by holder design --choose")
        write_page(holder_design_page(summary, _surface(drawing, mesh_m, bricks)), staging / "report.html")
    return HolderDesign(summary)


def _settled(cut: Behaviour, half: Behaviour, bricks: int) -> dict[str, float] | None:
    """Change of the figures from half as many bricks, %: the largest of the strains and of the compliances.

    The error that remains is of this order or smaller: at sharp corners it falls with the size of the bricks or faster.
    """
    if bricks < 2:
        return None
    best = np.argmax(np.abs(cut.strain), axis=1)
    rows = np.arange(len(best))
    strain = half.strain[rows, best] / cut.strain[rows, best] - 1.0
    compliance = half.tip_m_per_n / cut.tip_m_per_n - 1.0
    return {
        "strain": round(100.0 * float(np.max(np.abs(strain))), 2),
        "compliance": round(100.0 * float(np.max(np.abs(compliance))), 2),
    }


def _bridges(drawing: Drawing, cut: Behaviour, floor: Behaviour | None) -> list[dict[str, Any]]:
    """One row per bridge: its place, what it shows per newton at the tool tip, what pocket and rib gain."""
    gain = gain_by_pocket(drawing, cut)
    out = []
    for k, p in enumerate(drawing.pockets):
        best = int(np.argmax(np.abs(cut.strain[k])))
        row: dict[str, Any] = {
            "cheek": "-x" if p.side < 0 else "+x",
            "face": "outer" if p.outer else "inner",
            "y_mm": round(p.y_m / MM, 2),
            "z_mm": round(p.z_m / MM, 2),
            "strain_um_m_per_kn": _rounded(cut.strain[k] * KN / MICRO, 3),
            "sees_best": "xyz"[best],
            "gain": round(float(gain[k]), 3),
            "rib_gain": None if floor is None else round(float(cut.strain[k, best] / floor.strain[k, best]), 3),
        }
        out.append(row)
    return out


def _surface(drawing: Drawing, mesh_m: float, bricks: int) -> dict[str, Any]:
    """Strain along z on the outer face of the cheek at +x by 1 kN on the tool tip along x, um/m, on a grid."""
    beam = drawing.beam
    body = drawing.cheek(1, mesh_m, bricks=bricks)
    solved = solve(body, beam.e_pa, beam.poisson_ratio)
    y, z = 0.5 * (body.y[1:] + body.y[:-1]), 0.5 * (body.z[1:] + body.z[:-1])
    top = [np.flatnonzero(body.filled[:, i, k]) for i in range(len(y)) for k in range(len(z))]
    points = np.array(
        [(body.x[rows[-1] + 1], y[n // len(z)], z[n % len(z)]) for n, rows in enumerate(top) if len(rows)]
    )
    tip = _tip_motion(drawing)
    eps = solved.strain(points)[:, 2, 2] @ tip
    at = iter(eps.tolist())
    values = [round(next(at) * KN / MICRO, 3) if len(rows) else None for rows in top]
    grid = [[values[i * len(z) + k] for i in range(len(y))] for k in range(len(z))]
    return {"y_mm": _rounded(y / MM, 2), "z_mm": _rounded(z / MM, 2), "strain": grid}


def _tip_motion(drawing: Drawing) -> Float:
    """(6,) motion of the end of the cheek at +x by 1 N on the tool tip along x, beam theory."""
    beam = drawing.beam
    load = beam.tip_loads()[1] @ np.array([1.0, 0.0, 0.0, 0.0, drawing.p_holder_tcp[2], -drawing.p_holder_tcp[1]])
    out: Float = np.linalg.solve(beam.tip_stiffness(), load)
    return out


def _um_per_kn(compliance: Float) -> list[float]:
    return _rounded(compliance * KN / UM, 4)


def _rounded(values: Float, digits: int) -> list[float]:
    return [round(float(v), digits) for v in values]
