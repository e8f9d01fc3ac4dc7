"""Small questions: where is the flange, how far does it bend, is this cell plausible."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.pose_questions import checked_joints, joint_margins, pose_mm_deg, rounded
from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import ReachError
from counterflex.core.next_command import next_command
from counterflex.core.result import Parts, ShownTable, Summary, Warned, fill
from counterflex.core.units import DEG, MM, UM, UM_PER_KN, URAD, URAD_PER_KNM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.class_stiffness import axis_names
from counterflex.files.cell.plausibility import unusual
from counterflex.files.schema import ComplianceTable
from counterflex.geometry import pose
from counterflex.path.toolpath import tool_orientation
from counterflex.report.glossary import MODEL_NOTE
from counterflex.robot.elasticity import compliance, gravity
from counterflex.robot.elasticity.chain import ElasticChain, forward, rigid_axes
from counterflex.robot.kinematics import inverse
from counterflex.robot.model import catalog
from counterflex.robot.model.elastic_region import beyond_regions

UNIT_FORCE_N = 100.0


def load_chain(robot_or_cell: str) -> tuple[ElasticChain, Cell | None]:
    """The elastic chain of a cell file, or of a bare catalogue robot whose TCP is its flange."""
    if Path(robot_or_cell).suffix == ".toml" or Path(robot_or_cell).is_file():
        cell = read_cell(robot_or_cell)
        return cell.chain, cell
    return ElasticChain.build(catalog.load(robot_or_cell)), None


class Deflection(Summary):
    """Deflection of the tool centre point, and the elements that it comes from."""

    def _shown(self) -> Parts:
        rows = [
            {"of": what, **self[key]}
            for what, key in (("linear", "linear"), ("nonlinear", "nonlinear"), ("own weight (sag)", "gravity_sag"))
        ]
        yield ShownTable.of(
            f"Deflection of the TCP of {self.name}, base axes",
            "=of | dx um=dx_dy_dz_um[0]:.2f | dy um=dx_dy_dz_um[1]:.2f | dz um=dx_dy_dz_um[2]:.2f | length um:.2f | "
            "rx urad=rx_ry_rz_urad[0]:.2f | ry urad=rx_ry_rz_urad[1]:.2f | rz urad=rx_ry_rz_urad[2]:.2f",
            rows,
            self.line("Linear and nonlinear differ by {gap_um:.3f} um. ") + MODEL_NOTE,
        )
        matrix = zip(("dx", "dy", "dz"), self["compliance"]["translation_um_per_kn"], strict=True)
        columns = "=0 | Fx={1[0]:.1f} | Fy={1[1]:.1f} | Fz={1[2]:.1f}"
        yield ShownTable.of("Compliance, um/kN (base axes)", columns, matrix)
        columns = "segment | dx um=dx_dy_dz_um[0]:.1f | dy um=dx_dy_dz_um[1]:.1f | dz um=dx_dy_dz_um[2]:.1f | "
        yield self.rows("shares", "Share of each element", columns + "share={share!p:.1f}%")
        yield from map(Warned, self["warnings"])

    def __init__(self, name: str, values: dict[str, Any]) -> None:
        super().__init__(values)
        self.name = name


def deflection(
    chain: ElasticChain, joints_deg: list[float], force_n: list[float], moment_nm: list[float]
) -> Deflection:
    """Deflection at the TCP under a wrench in base axes: linear, nonlinear, sag, compliance, share of each element."""
    q = checked_joints(chain, joints_deg)
    w = np.concatenate([as_float("--force-n", force_n, (3,)), as_float("--moment-nm", moment_nm, (3,))])
    C = compliance.cartesian_compliance(chain, q)
    linear = C @ w
    nonlinear = compliance.deflection(chain, q, w)
    sag = gravity.sag(chain, q)
    values = {
        "tcp_in_base": pose_mm_deg(forward(chain, q)),
        "force_n": list(force_n),
        "moment_nm": list(moment_nm),
        "linear": _twist(linear),
        "nonlinear": _twist(nonlinear),
        "gap_um": round(float(np.linalg.norm((nonlinear - linear)[:3]) / UM), 4),
        "gravity_sag": _twist(sag),
        "compliance": {
            "translation_um_per_kn": [rounded(row, 3) for row in C[:3, :3] / UM_PER_KN],
            "rotation_urad_per_knm": [rounded(row, 3) for row in C[3:, 3:] / URAD_PER_KNM],
            "coupling_um_per_knm": [rounded(row, 3) for row in C[:3, 3:] / UM_PER_KN],
        },
        "shares": shares(chain, q, w),
        "warnings": [*_rigid(chain), *beyond_regions(chain.regions, q), *_means(chain)],
    }
    return Deflection(chain.name, values)


def _rigid(chain: ElasticChain) -> list[str]:
    """Says which axes do not yield: they are rigid, or nothing is known of them."""
    axes = rigid_axes(chain)
    return [f"{axis_names(axes)} of {chain.name} yield nothing here: rigid, or of unknown stiffness"] if axes else []


def _means(chain: ElasticChain) -> list[str]:
    """Says which segments have compliance curves, of which the linear figures take the mean."""
    names = ", ".join(curve.segment for curve in chain.curves)
    text = f"compliance, linear deflection and shares take the mean of [[robot.compliance_curve]] of {names}"
    return [text] if names else []


def shares(chain: ElasticChain, q: Float, w_tcp_base: Float) -> list[dict[str, Any]]:
    """Contribution of each elastic segment to the displacement of the TCP, largest first."""
    parts = compliance.shares(chain, q, w_tcp_base)
    total = compliance.cartesian_compliance(chain, q) @ w_tcp_base
    length = float(np.linalg.norm(total[:3]))
    rows = []
    for name, part in zip(chain.names, parts, strict=True):
        share = float(part[:3] @ total[:3]) / length**2 if length > 0.0 else 0.0
        if np.any(part != 0.0):
            rows.append({"segment": name, "dx_dy_dz_um": rounded(part[:3] / UM, 3), "share": round(share, 4)})
    return sorted(rows, key=lambda row: -abs(float(row["share"])))


def _named_after_another(cell: Cell) -> list[str]:
    """Warning where the name of a cell, which stands in reports and programs, is that of another robot."""
    own = cell.tables.robot.catalog
    if own is None or _short_model(own) in cell.name:
        return []
    others = (_short_model(name) for name in catalog.names())
    other = max((one for one in others if one in cell.name), key=len, default="")
    if not other:
        return []
    return [
        f"name: the cell is named after {other}, and its robot is {_short_model(own)}: reports and programs would name "
        "the wrong robot. Change name"
    ]


def _short_model(robot: str) -> str:
    return catalog.entry(robot).model.split(" (")[0]


class CellCheck(Summary):
    """Elastic chain of a cell, its compliance at the part, and what is not known of it."""

    def _shown(self) -> Parts:
        segments = [
            row | {"bends": "  ".join(f"{key} {value:g}" for key, value in row["compliance"].items()) or "rigid"}
            for row in self["segments"]
        ]
        title = self.line("{cell}: elastic chain, {mass_kg:g} kg")
        yield ShownTable.of(title, "segment | compliance=bends | mass kg:g", segments)
        if self["at_corner"] is not None:
            yield self.rows(
                "softness",
                f"Compliance at the corner of the stock {self['at_corner']['xyz_mm']} mm",
                "direction | um/N=um_per_n:.2f | weakest element=weakest | its share={share!p:.0f}%",
                "Own-weight sag varies by {sag_variation_um:.0f} um over the stock. Smallest joint margin "
                "{smallest_joint_margin_deg:.1f} deg.",
            )
        if self["identified"]:
            unseen = [sum(value["seen"] == "prior" for value in entry["values"]) for entry in self["identified"]]
            yield ShownTable.of(
                "Identified from measurements",
                "recipe | date | data | error on held-out data=holdout | values determined=known | "
                "not determined=unseen",
                [
                    entry | {"unseen": count, "known": len(entry["values"]) - count}
                    for entry, count in zip(self["identified"], unseen, strict=True)
                ],
                f"Values with their standard deviations: {next_command('cell check', 'CELL', json=True)}",
            )
        if self["unknowns"] is not None:
            yield from self._unknown()
        yield from self.each("assumptions", "note: {}")
        yield from map(Warned, self["warnings"])
        count = len(self["warnings"])
        yield f"cell file readable, {count} warnings" if count else "cell file ok"

    def _unknown(self) -> Parts:
        yield ShownTable.of(
            self.line("Not known, by what it leaves uncorrected {unknowns[where]}"),
            "unknown | known from | leaves mm:.2f | "
            "90 % of cells, mm={of_90_percent_mm[0]:.2f} to {of_90_percent_mm[1]:.2f}~not at rest | measure",
            self["unknowns"]["rows"],
        )
        if self["unknowns"]["measure_first"] is not None:
            text = "measure first: {command} ({removes_mm:.2f} mm, up to {up_to_mm:.2f})"
            yield fill(text, self["unknowns"]["measure_first"])


def check_cell(path: str, program: str | Path | None = None) -> CellCheck:
    """Resolve a cell and judge it: reach of the stock's corners, compliance at the part, weakest element, unknowns.

    A cell for calibration only, without blank, is judged without what is seen at the blank's corners: those entries are
    None or empty, ``missing_for_milling`` names the tables.

    Args:
        program: G-code file in whose cut the unknowns are judged; None is a force at a corner of the blank.
    """
    from counterflex.app.unknown_stiffness import unknown_stiffness

    cell = read_cell(path)
    chain = cell.chain
    warnings: list[str] = [one.sentence() for one in unusual(cell.tables)]
    law = None if cell.tables.material is None else cell.force_law
    warnings += [*_named_after_another(cell), *unknown_stiffness(cell)]
    missing = cell.missing_for_milling()
    if missing:
        warnings.append(f"no {', '.join(missing)}: good for calibration (counterflex identify), nothing can be milled")
    has_blank = cell.tables.part is not None and cell.tables.part.stock is not None
    values = {
        "cell": cell.name,
        "robot": chain.name,
        "segments": [
            {
                "segment": name,
                "compliance": ComplianceTable.of(chain.compliance[i]),
                "mass_kg": round(float(chain.mass[i]), 3),
            }
            for i, name in enumerate(chain.names)
        ],
        "mass_kg": round(float(chain.mass.sum()), 2),
        "missing_for_milling": list(missing),
        "force_law": None if law is None else {"law": type(law).__name__, "source": law.source, "status": law.status},
        "tools": [
            {"diameter_mm": tool.diameter_m / MM, "flutes": tool.flutes}
            for tool in (cell.cutter(table.number) for table in cell.tables.tools)
        ],
        **(_at_the_blank(cell, path, warnings) if has_blank else _NO_BLANK),
        "identified": [
            {
                "recipe": entry.recipe,
                "date": entry.date,
                "data": list(entry.data),
                "holdout": entry.holdout,
                "values": [value.model_dump() for value in entry.values],
            }
            for entry in cell.tables.identified
        ],
        "unknowns": None if missing else _unknowns(cell, program),
        "assumptions": _assumptions(cell),
        "warnings": warnings,
    }
    return CellCheck(values)


def _unknowns(cell: Cell, program: str | Path | None) -> dict[str, Any] | None:
    """Return what is not known and what it leaves; None where the program cuts nothing."""
    from counterflex.app.cut_points import CutPoints, corner_points, points_of_program
    from counterflex.app.unknowns import shown, unknowns

    if program is None:
        points: CutPoints | None = corner_points(cell)
    else:
        from counterflex.app.inputs import read_job  # the planner is heavy

        points = points_of_program(read_job(program, cell), cell)
    return None if points is None else shown(unknowns(cell, points), points, str(cell.path))


def _assumptions(cell: Cell) -> list[str]:
    """Return what the catalogue assumes of the robot's elastic bodies, unless the cell file states them itself."""
    name, stated = cell.tables.robot.catalog, {row.segment for row in cell.tables.robot.elastic}
    if name is None:
        return []
    entry = catalog.entry(name)
    links, bodies = entry.sources["stiffness_links"], {body.name for body in entry.elements}
    if not links.effect or bodies <= stated:
        return []
    return [f"the axes of {' and '.join(sorted(bodies))} are assumed in the catalogue: {links.effect}"]


_NO_BLANK: Final[dict[str, Any]] = {
    "stock_mm": None,
    "at_corner": None,
    "softness": [],
    "sag_at_corners_um": [],
    "sag_variation_um": None,
    "smallest_joint_margin_deg": None,
}


def _softness(chain: ElasticChain, q: Float, axis: int, warnings: list[str]) -> dict[str, Any]:
    """Compliance along an axis of the base and the element with the largest share of it; adds to the warnings."""
    w = np.zeros(6)
    w[axis] = UNIT_FORCE_N
    d = compliance.cartesian_compliance(chain, q) @ w
    weakest, name = shares(chain, q, w), "xyz"[axis]
    if d[axis] / UNIT_FORCE_N > 20.0 * UM:
        warnings.append(f"{d[axis] / UNIT_FORCE_N / UM:.1f} um/N along {name} is softer than milling robots are")
    if d[axis] == 0.0:
        warnings.append(f"the cell is rigid along {name}: no elastic element acts there")
    return {
        "direction": name,
        "um_per_n": round(float(d[axis] / UNIT_FORCE_N / UM), 3),
        "weakest": weakest[0]["segment"] if weakest else "",
        "share": weakest[0]["share"] if weakest else 0.0,
    }


def _at_the_blank(cell: Cell, path: str, warnings: list[str]) -> dict[str, Any]:
    """Reach, compliance and sag at the corners of the blank; adds to the warnings."""
    chain, stock = cell.chain, cell.stock()
    x, y, top = stock.x_m(), stock.y_m(), float(stock.z.max())
    corners = np.array([[a, b, top] for a in (x[0], x[-1]) for b in (y[0], y[-1])])
    axes = np.tile([0.0, 0.0, 1.0], (len(corners), 1))
    Rs_part_tcp = tool_orientation(axes, cell.tables.posture.rotation_about_tool_rad)
    Ts_base_hand = cell.hand_poses(pose.make(Rs_part_tcp, corners))
    try:
        q = inverse.inverse_path(chain, Ts_base_hand, cell.tables.posture.branch).q
    except ReachError as fault:
        corner = ", ".join(f"{value / MM:g}" for value in corners[int(fault.data.get("point", 0))])
        raise ReachError(
            f"the stock's corner at ({corner}) mm: {fault.what}",
            where=f"{path}: part",
            value=fault.value,
            limit=fault.limit,
            hint=f"{fault.hint}. Lengths are in mm" if fault.hint else None,
            **fault.data,
        ) from fault
    smallest = [min(joint_margins(chain, row).values()) for row in q]
    softness = [_softness(chain, q[0], axis, warnings) for axis in range(3)]
    sag = np.array([gravity.sag(chain, row)[:3] for row in q])
    spread = sag - sag.mean(axis=0)
    if min(smallest) < cell.tables.limits.joint_margin_deg:
        warnings.append("a joint comes closer to its limit than limits.joint_margin_deg at a corner of the stock")
    return {
        "stock_mm": {
            "low": rounded(np.array([x[0], y[0], stock.bottom_m]) / MM, 3),
            "high": rounded(np.array([x[-1], y[-1], top]) / MM, 3),
        },
        "at_corner": {"xyz_mm": rounded(corners[0] / MM, 3), "joints_deg": rounded(chain.axes.shown(q[0]) / DEG, 3)},
        "softness": softness,
        "sag_at_corners_um": [rounded(row / UM, 1) for row in sag],
        "sag_variation_um": round(float(np.max(np.linalg.norm(spread, axis=1)) / UM), 1),
        "smallest_joint_margin_deg": round(min(smallest), 2),
    }


def _twist(d: Float) -> dict[str, Any]:
    return {
        "dx_dy_dz_um": rounded(d[:3] / UM, 3),
        "length_um": round(float(np.linalg.norm(d[:3]) / UM), 3),
        "rx_ry_rz_urad": rounded(d[3:] / URAD, 3),
    }
