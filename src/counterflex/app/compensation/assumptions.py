"""What a cell file states and assumes, as lines for a report, and the names that people use."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from counterflex.core.units import MM, N_PER_MM2
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.tables import PlayTable, ServoTable
from counterflex.programs.program import Program
from counterflex.report.data import Fact
from counterflex.robot.model import catalog


def robot_name(cell: Cell) -> str:
    """Maker and model of a catalogue robot, otherwise the name of the chain."""
    if cell.tables.robot.catalog is None:
        return cell.chain.name
    entry = catalog.entry(cell.tables.robot.catalog)
    return f"{entry.manufacturer} {entry.model}"


def title_of(program: Program) -> str:
    """The first comment of a program that says something, otherwise its file name."""
    for line in program.lines[:20]:
        comment = re.fullmatch(r"\s*\(([^()]*[A-Za-z]{3}[^()]*)\)\s*", line)
        if comment:
            return comment.group(1).strip()
    return Path(program.name).name


def assumptions(cell: Cell) -> tuple[Fact, ...]:
    """Every assumption behind a plan for this cell."""
    tables, law = cell.tables, cell.force_law
    facts = []
    if tables.robot.catalog is not None:
        entry = catalog.entry(tables.robot.catalog)
        for group, source in entry.sources.items():
            facts.append(Fact(f"Robot: {group.replace('_', ' ')}", source.status, source.source))
    facts += [
        Fact(f"End effector: {body.name}", f"{body.mass_kg:g} kg", body.source or "cell file")
        for body in tables.end_effector
    ]
    if isinstance(law, KienzleLaw):
        kc, kr, ka = (value / N_PER_MM2 for value in law.k11_pa())
        value = f"kc1.1 {kc:.0f}, kr1.1 {kr:.0f}, ka1.1 {ka:.0f} N/mm2; m {law.mc:g}, {law.mr:g}, {law.ma:g}"
    else:
        value = f"ktc {law.ktc_pa / N_PER_MM2:.0f}, krc {law.krc_pa / N_PER_MM2:.0f} N/mm2"
    facts.append(Fact(f"Cutting constants: {cell.material.name or cell.material.catalog}", value, law.source))
    facts.append(
        Fact(
            "Mean chip thickness allowed",
            f"{law.h_min_m / MM:g} to {law.h_max_m / MM:g} mm"
            + (", and beyond" if cell.material.allow_extrapolation else ""),
            "range of the constants" + (", extrapolated" if cell.material.allow_extrapolation else ""),
        )
    )
    for tool in tables.tools:
        shape = f"D{tool.diameter_mm:g} r{tool.corner_radius_mm:g}, {tool.flutes} flutes"
        facts.append(Fact(f"Tool T{tool.number}", shape, tool.name or "cell file"))
    part = cell.part
    how = "touched with the robot" if part.measured_with == "robot" else "measured from outside"
    facts.append(Fact("Part frame", how, f"{len(part.datum_points_mm)} datum points"))
    facts.append(Fact("Play and friction of the axes", *_known(tables.robot.play)))
    facts.append(Fact("Loop gains of the drives", *_known(tables.robot.servo)))
    dynamics = tables.dynamics
    facts.append(
        Fact(
            "Shape of the correction",
            f"for the mode, {dynamics.correction_smoothing_ms:g} ms; sent {dynamics.correction_lead_ms:g} ms earlier",
            "cell file",
        )
    )
    facts.append(
        Fact(
            "Lowest mode",
            f"{dynamics.mode_hz:g} Hz, damping {dynamics.damping_ratio:g}",
            "cell file; for the prediction, and for the load that reaches the drives",
        )
    )
    facts.append(
        Fact(
            "Posture",
            f"{tables.posture.branch}, turned {tables.posture.rotation_about_tool_deg:g} deg about the tool",
            "cell file",
        )
    )
    return tuple(facts)


def _known(rows: Sequence[PlayTable | ServoTable]) -> tuple[str, str]:
    """Axes that something is known about, and where from."""
    if not rows:
        return "not known, left out", "cell file"
    axes = ", ".join(f"A{row.axis}" for row in sorted(rows, key=lambda row: row.axis))
    return f"known for {axes}", "; ".join(dict.fromkeys(row.source or "cell file" for row in rows))
