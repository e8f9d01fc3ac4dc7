"""Motion of the tool by an error of each constant of the cell, and how well the constant is known."""

from __future__ import annotations

import datetime
import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.correction.scans import Corrected
from counterflex.app.lowest_mode import STATED, identified_sigma
from counterflex.app.unknowns import HANDBOOK, IDENTIFIED
from counterflex.core import file_content
from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError, ModelError
from counterflex.core.next_command import next_command
from counterflex.core.units import DEG, MM, MRAD
from counterflex.evaluate.path_error.estimate import EVIDENCE
from counterflex.evaluate.path_error.explanations import NOTHING, ErrorCause, Explanation
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.measured import IdentifiedTable, IdentifiedValue
from counterflex.files.cell.update import require_new, updated_text, write_new
from counterflex.geometry import pose, rotation
from counterflex.identify.data.changes import Change, CuttingLaw, ElementCompliance, TableValues
from counterflex.plan.plan import Plan
from counterflex.robot.elasticity.compliance import shares

FORCE, ARM, END, FRAME, TURNED = "force", "stiffness of the arm", "stiffness of the end effector", "offset", "rotation"
DIRECTIONS: Final = "stiffness by direction"
OFFSET_M: Final = 0.1 * MM
ROTATION_RAD: Final = 0.5 * MRAD
"""What is known of the part frame: how well a probe of the robot or a tracker finds it."""
_SHARE: Final = 0.1  # Of the deflection, from which an element is a cause of its own


@dataclass(frozen=True, eq=False)
class Known:
    """Causes of a plan, and what is tried together."""

    causes: tuple[ErrorCause, ...]
    together: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, plan: Plan, cell: Cell, row: Int) -> Known:
        """Return what may be behind the errors of a path.

        Args:
            row: (k,) rows of the nodes.
        """
        deflection = plan.deflection_part[row, :3]
        force_known = any(entry.recipe in ("cutting", "production") for entry in cell.tables.identified)
        out = [
            ErrorCause(
                FORCE, ("force, relative",), deflection[None], np.array([IDENTIFIED if force_known else HANDBOOK])
            )
        ]
        if not cell.holds_part:
            out += _of_segments(plan, cell, row)
        by_axis = np.stack([deflection * np.eye(3)[a] for a in range(3)])
        seen = np.sum(by_axis**2, axis=(1, 2)) > _SHARE**2 * float(np.sum(deflection**2))
        if np.any(seen):
            along = tuple(f"compliance along {a}, relative" for a, on in zip("xyz", seen, strict=True) if on)
            out.append(ErrorCause(DIRECTIONS, along, by_axis[seen], np.full(int(seen.sum()), STATED)))
        out += _frame(plan.path.p_part_tcp[row])
        names = [cause.name for cause in out]
        together = [(FORCE, FRAME), (FORCE, FRAME, TURNED), (DIRECTIONS, FRAME)]
        together += [(FORCE, name) for name in (ARM, END) if name in names]
        return cls(tuple(out), tuple(one for one in together if set(one) <= set(names)))


def _of_segments(plan: Plan, cell: Cell, row: Int) -> list[ErrorCause]:
    """Compliance of the arm, of the end effector, and of each element that bends by a share that can be seen."""
    relative, chain, out = identified_sigma(cell), cell.chain, []
    R = cell.T_base_part[:3, :3]
    w = plan.w_tcp_part[row]
    w_base = np.concatenate([w[:, :3] @ R.T, w[:, 3:] @ R.T], axis=1)
    parts = shares(chain, plan.q[row], w_base)[..., :3] @ R
    total = float(np.sum(plan.deflection_part[row, :3] ** 2)) or 1.0
    sigma = np.array([relative.get(name, STATED) for name in chain.names])
    arm = np.arange(chain.n) <= chain.flange_segment
    for name, own in ((ARM, arm), (END, ~arm)):
        if np.any(parts[:, own] != 0.0):
            known = float(np.min(sigma[own]))
            out.append(
                ErrorCause(name, (f"compliance of the {name[17:]}, relative",), _sum(parts, own), np.array([known]))
            )
    for i, name in enumerate(chain.names):
        if float(np.sum(parts[:, i] ** 2)) > _SHARE**2 * total:
            stated = (f"compliance of {name}, relative",)
            out.append(ErrorCause(f"stiffness of {name}", stated, parts[None, :, i], sigma[[i]]))
    return out


def _sum(parts: Float, own: Bool) -> Float:
    out: Float = np.sum(parts[:, own], axis=1)[None]
    return out


def _frame(p: Float) -> list[ErrorCause]:
    """Rigid motions of the tool against the part, about the middle of the path."""
    arm = p - p.mean(axis=0)
    turn = np.stack([np.cross(axis, arm) for axis in np.eye(3)])
    shift = np.tile(np.eye(3)[:, None, :], (1, len(p), 1))
    return [
        ErrorCause(FRAME, tuple(f"offset {a}, m" for a in "xyz"), shift, np.full(3, OFFSET_M)),
        ErrorCause(TURNED, tuple(f"rotation about {a}, rad" for a in "xyz"), turn, np.full(3, ROTATION_RAD)),
    ]


def shown(weighed: list[Explanation]) -> list[dict[str, Any]]:
    """Explanations as plain values: relative factors in %, offsets in um, rotations in urad."""
    rows = []
    for one in weighed:
        factors = []
        for k, name in enumerate(one.factors):
            text, _, unit = name.rpartition(", ")
            scale, shop = {"relative": (100.0, "%"), "m": (1e6, "um"), "rad": (1e6, "urad")}[unit]
            factors.append(
                {
                    "name": text,
                    "value": round(float(one.value[k]) * scale, 2),
                    "standard_deviation": round(float(one.sigma[k]) * scale, 2),
                    "unit": shop,
                }
            )
        pairs = [
            {"one": one.factors[i], "other": one.factors[j], "correlation": round(float(one.correlation[i, j]), 2)}
            for i in range(len(one.factors))
            for j in range(i)
            if abs(one.correlation[i, j]) > 0.5
        ]
        rows.append(
            {
                "explanation": one.name,
                "log_evidence": round(one.log_evidence, 1),
                "explained_percent": round(100.0 * one.explained, 1),
                "factors": factors,
                "correlated": pairs,
            }
        )
    return rows


def changes_of(one: Explanation, plan: Plan, cell: Cell) -> tuple[Change, ...]:
    """Return what an explanation changes in the cell file. Raises InputError: it has no place there."""
    value = dict(zip(one.factors, one.value.tolist(), strict=True))
    names = one.name.split(" + ")
    if one.name == NOTHING or DIRECTIONS in names:
        raise InputError(
            "the likeliest explanation has no place in a cell file",
            value=one.name,
            hint="Correct the program only: leave --apply out. Or measure: "
            + next_command("identify stiffness", propose=30, cell="CELL", out="DIR"),
        )
    out: list[Change] = []
    if FORCE in names:
        out.append(CuttingLaw(cell.force_law.scaled(1.0 + value["force, relative"])))
    for i, segment in enumerate(cell.chain.names):
        own = [f"stiffness of {segment}", ARM if i <= cell.chain.flange_segment else END]
        factor = 1.0
        for name in own:
            if name in names:
                factor *= (
                    1.0 + value[f"compliance of {'the ' + name[17:] if name in (ARM, END) else segment}, relative"]
                )
        if factor != 1.0 and np.any(cell.chain.compliance[i] != 0.0):
            out.append(ElementCompliance(segment, cell.chain.compliance[i] * factor))
    if FRAME in names or TURNED in names:
        out.append(_moved_part(value, plan, cell))
    return tuple(out)


def _moved_part(value: dict[str, float], plan: Plan, cell: Cell) -> TableValues:
    """The part frame moved against the offset of the tool: where the part truly is."""
    if cell.R_part_plane is not None or cell.holds_part:
        raise InputError("the part frame of a tilted or held part is not moved", hint="Correct the program only")
    p = plan.path.p_part_tcp
    cutting = plan.cutting
    centre = p[cutting].mean(axis=0) if np.any(cutting) else p.mean(axis=0)
    shift = np.array([value.get(f"offset {a}, m", 0.0) for a in "xyz"])
    R = rotation.exp(np.array([value.get(f"rotation about {a}, rad", 0.0) for a in "xyz"]))
    T_moved_part = pose.make(R, centre - R @ centre + shift)
    T = cell.T_base_part @ pose.inverse(T_moved_part)
    values: dict[str, Any] = {f"{a}_mm": round(float(T[k, 3]) / MM, 5) for k, a in enumerate("xyz")}
    if np.any(np.eye(3) != R):
        values |= {f"{a}_deg": round(float(v) / DEG, 6) for a, v in zip("abc", rotation.to_zyx(T[:3, :3]), strict=True)}
    return TableValues("part", values)


RECIPE: Final = "correct"
_SI: Final = {"relative": "", "m": "m", "rad": "rad"}


def apply_constants(result: Corrected, cell: Cell, target: Path, place: Path, scans: list[Path]) -> dict[str, Any]:
    """Write a cell file with the constants of the likeliest explanation.

    Args:
        place: Where it is written until the results are complete.

    Raises:
        InputError: The target is the cell file or any file that is there, or what is likeliest has no place in a
            cell file.
        ModelError: No explanation is likelier than none, or the new cell is no possible one.
    """
    require_new(target, cell.path)
    best = result.explained[0]
    if best.log_evidence < EVIDENCE:
        raise ModelError(
            "no constant explains the part better than none",
            value=f"{best.name}, logarithm of the evidence {best.log_evidence:.1f}",
            limit=f">= {EVIDENCE:g}",
            hint="Correct the program only: leave --apply out",
        )
    changes = changes_of(best, result.plan, cell)
    entry = IdentifiedTable(
        recipe=RECIPE,
        date=datetime.datetime.now(tz=datetime.UTC).strftime("%Y-%m-%d %H:%M:%S UTC"),
        data=tuple(scan.name for scan in scans),
        data_sha256=tuple(_digest(scan) for scan in scans),
        counterflex=__version__,
        holdout=f"{best.name}: logarithm of the evidence {best.log_evidence:.1f} over no constant, "
        f"{100.0 * best.explained:.0f} % of the deviations explained; no part held out",
        values=tuple(
            IdentifiedValue(
                name=name.rpartition(", ")[0],
                value=float(best.value[k]),
                sigma=float(best.sigma[k]),
                unit=_SI[name.rpartition(", ")[2]],
            )
            for k, name in enumerate(best.factors)
        ),
    )
    text = updated_text(cell, changes, entry, target.parent)
    write_new(text, target, place, "what the part explains")
    return {"explanation": best.name, "cell": target.name}


def _digest(scan: Path) -> str:
    """SHA-256 of a scan; of a folder, of the machined surface or the deviations in it."""
    files = [scan] if scan.is_file() else sorted(scan.glob("*surface.npz")) or sorted(scan.glob("deviations.parquet"))
    return hashlib.sha256(b"".join(file_content.content(file) for file in files)).hexdigest()
