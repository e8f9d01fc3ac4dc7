"""Table of an advice of ``plan strategy``: every choice with its engagement, force, error and use of limits."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.inputs import AS_IT_IS, Reading
from counterflex.app.robot_programs import with_files
from counterflex.app.strategy.advice import Advice, WallOperation, advise
from counterflex.core import atomic
from counterflex.core.progress import Progress, silent
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.core.units import MM, MM_PER_MIN, RPM, UM, UM_PER_KN
from counterflex.cutting.coefficients import ForceLaw
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.summary_file import SUMMARY, write_summary
from counterflex.plan.strategy.advise import Choices
from counterflex.plan.strategy.zero import normal_errors, normal_force, zero_width
from counterflex.report.glossary import EXPECTED_NOTE, EXPECTED_UM, MODEL_UM, expected_text, line_of


class RankedWays(Summary):
    """Ways to finish a wall, the best first."""

    def _shown(self) -> Parts:
        listed = [(str(i + 1), row) for i, row in enumerate(self["choices"])]
        if self["before"] is not None:
            listed.insert(0, ("before", self["before"]))
        rows = [
            {
                **row,
                "name": name,
                "more": f" x {row['levels']}" if row["levels"] > 1 else "",
                "worth": expected_text(row),
                "limit": _limit(row),
            }
            for name, row in listed
        ]
        yield ShownTable.of(
            f"{self['program'] or 'wall'} on {self['cell']}, {self['material']}",
            "=name | milling | a_e mm=ae_mm:g | a_p mm={ap_mm:g}{more} | f_z mm=fz_mm:g | rpm=spindle_rpm:g | "
            f"{EXPECTED_UM}=worth | up to um:.1f | {MODEL_UM}=error_um:+.1f | F normal N=normal_n:+.1f | "
            "s/m=time_s_per_m:.1f | limit",
            rows,
            _NOTE,
        )
        zero = self["zero"]
        force, error = (
            "nowhere" if zero[key] is None else f"at a_e = {zero[key]:g} mm"
            for key in ("force_ae_mm", "displacement_ae_mm")
        )
        yield (
            f"up-milling at f_z = {zero['fz_mm']:g} mm: the force normal to the wall is zero {force}, the displacement "
            f"{error} (half the diameter is {zero['half_diameter_mm']:g} mm)"
        )
        yield _modes_line(self["modes"])
        best = f"{self['choices'][0]['up_to_um']:g} um" if self["choices"] else "none"
        for name, error_um in self["binding"].items():
            yield f"binds: {name}; without it {error_um:g} um instead of {best}"
        if not self["choices"]:
            worst = ", ".join(f"{name} ({count})" for name, count in self["beyond"].items())
            yield f"none of {self['tried']} choices is within the limits: {worst}"
        if self["not_known"]:
            yield self.line("not looked at, because the cell file does not state it: {not_known}")


FIRST_MODES = 6
"""Printed; ``--json`` has all."""
_NOTE: Final = (
    f"Errors square to the wall. {EXPECTED_NOTE} Up to: nine of ten stay below. That of the model has a sign: + leaves "
    "material."
)


def _modes_line(modes: dict[str, Any]) -> str:
    first = modes["bands_hz"][:FIRST_MODES]
    bands = ", ".join(f"{low:g}" if low == high else f"{low:g} to {high:g}" for low, high in first)
    text = f"first modes along the cut: {bands} Hz"
    nearest = modes["nearest"]
    if nearest is None:
        return text
    where = "" if nearest["line"] is None else f" in {line_of(nearest)}"
    return (
        f"{text}; of tooth passing and runout, {nearest['what']} ({nearest['hz']:g} Hz) swings the tool most{where}: "
        f"{nearest['magnified']:g} of the displacement at rest, the nearest mode is at {nearest['mode_hz']:g} Hz"
    )


def _limit(row: dict[str, Any]) -> str:
    if row["beyond"]:
        return "beyond: " + ", ".join(row["beyond"])
    share = row["nearest_limit_percent"]
    return "" if share is None else f"{share:.0f} % of {row['nearest_limit']}"


def run(
    cell_file: str | Path,
    program: str | Path | None,
    operation: WallOperation,
    *,
    out: Path | None = None,
    assume_class: bool = False,
    reading: Reading = AS_IT_IS,
    progress: Progress = silent,
) -> RankedWays:
    """Do the job on files; returned is what is printed, in shop units, with the files of its lines.

    ``out``: Folder for ``summary.json``, or None.
    """
    cell = read_cell(cell_file, assume_class=assume_class)
    advice = advise(cell, operation, program, reading=reading, progress=progress)
    choices, own = advice.choices, advice.own
    violated = {name: int(np.count_nonzero(used > 1.0 + 1e-9)) for name, used in choices.use.items()}
    place = advice.place
    answer = {
        "job": "plan strategy",
        "cell": cell.label,
        "robot": cell.robot.name,
        "program": None if program is None else Path(program).name,
        "line": None if own is None else own.line,
        "material": operation.material or cell.material.catalog or cell.material.name,
        "wall": {
            "normal_deg": round(math.degrees(math.atan2(place.normal_part[1], place.normal_part[0])), 3) + 0.0,
            "height_mm": round(place.height_m / MM, 4),
            "compliance_um_per_kn": round(
                float(place.normal_part @ place.compliance_part[:3, :3] @ place.normal_part) / UM_PER_KN, 2
            ),
        },
        "before": None if advice.before is None else shown(advice.before, 0, advice.law),
        "choices": [shown(choices, row, advice.law) for row in advice.best],
        "tried": len(choices.cuts),
        "allowed": int(np.count_nonzero(choices.allowed())),
        "beyond": {name: count for name, count in violated.items() if count},
        "binding": {name: round(error / UM, 2) for name, error in choices.binding().items()},
        "not_known": _not_known(cell, advice),
        "zero": _zeros(advice),
        "modes": _modes(advice),
        "counterflex": __version__,
    }
    answer = answer if program is None else with_files(answer, reading.program(program, cell))
    if out is not None:
        with atomic.atomic_folder(out) as staging:
            write_summary(staging / SUMMARY, answer)
    return RankedWays(answer)


def shown(choices: Choices, row: int, law: ForceLaw) -> dict[str, Any]:
    """A choice in shop units."""
    cuts = choices.cuts.some([row])
    flutes, spindle = cuts.cutter.flutes, float(choices.spindle_rad_s[row])
    fz = float(cuts.fz_m[0])
    used = {name: float(values[row]) for name, values in choices.use.items()}
    nearest = max(used, key=lambda name: used[name]) if used else ""
    return {
        "milling": "up" if cuts.up[0] else "down",
        "ae_mm": round(float(cuts.ae_m[0]) / MM, 3),
        "ae_share_percent": round(100.0 * float(cuts.ae_m[0]) / cuts.cutter.diameter_m, 1),
        "ap_mm": round(float(cuts.ap_m[0]) / MM, 3),
        "levels": int(choices.levels[row]),
        "fz_mm": round(fz / MM, 4),
        "mean_chip_um": round(float(cuts.mean_chip_m[0]) / UM, 2),
        "spindle_rpm": round(spindle / RPM, 1),
        "feed_mm_min": round(fz * flutes * spindle / (2.0 * math.pi) / MM_PER_MIN, 1),
        "tooth_hz": round(flutes * spindle / (2.0 * math.pi), 1),
        "runout_hz": round(spindle / (2.0 * math.pi), 1),
        "normal_n": round(float(normal_force(cuts, law)[0]), 2),
        "force_n": round(float(choices.force_n[row]), 2),
        "peak_n": round(float(choices.peak_n[row]), 2),
        "torque_nm": round(float(choices.torque_nm[row]), 4),
        "power_w": round(float(choices.power_w[row]), 2),
        "error_um": round(float(choices.error_m[row]) / UM, 2),
        "expected_um": [round(value / UM, 2) for value in choices.expected_m[row].tolist()],
        "up_to_um": round(float(choices.high_m[row]) / UM, 2),
        "time_s_per_m": round(float(choices.time_s_per_m[row]), 3),
        "nearest_limit": nearest,
        "nearest_limit_percent": round(100.0 * used[nearest], 1) if used else None,
        "beyond": list(choices.violated(row)),
    }


def _modes(advice: Advice) -> dict[str, Any]:
    """Modes along the cut, and where the best choice (without one the program) comes nearest to one."""
    swings, flutes = advice.place.swings, advice.choices.cuts.cutter.flutes
    count = min(len(swing.omega_rad_s) for swing in swings)
    hz = np.array([swing.omega_rad_s[:count] for swing in swings]) / (2.0 * math.pi)
    bands = [[round(float(low), 2), round(float(high), 2)] for low, high in zip(hz.min(0), hz.max(0), strict=True)]
    chosen = advice.choices.spindle_rad_s[advice.best[:1]]
    speed = chosen if len(chosen) or advice.before is None else advice.before.spindle_rad_s
    nearest = None
    if len(speed):
        met = [
            (float(swing.magnification(times * speed)[0]), name, times * float(speed[0]), swing)
            for swing in swings
            for name, times in (("tooth passing", flutes), ("runout", 1))
        ]
        magnified, name, omega, swing = max(met, key=lambda item: item[0])
        mode = float(swing.omega_rad_s[np.argmin(np.abs(np.log(swing.omega_rad_s / omega)))])
        nearest = {
            "what": name,
            "hz": round(omega / (2.0 * math.pi), 2),
            "mode_hz": round(mode / (2.0 * math.pi), 2),
            "line": swing.line or None,
            "magnified": round(magnified, 3),
        }
    return {"postures": len(swings), "bands_hz": bands, "nearest": nearest}


def _zeros(advice: Advice) -> dict[str, Any]:
    """Widths at which nothing pushes the tool off the wall, at the first choice's chip and depth."""
    row = advice.best[0] if advice.best else 0
    cuts = advice.choices.cuts.some([row])
    fz, ap, d = float(cuts.fz_m[0]), float(cuts.ap_m[0]), cuts.cutter.diameter_m
    place, law = advice.place, advice.law
    force = zero_width(cuts.cutter, ap, fz, lambda c: normal_force(c, law))
    error = zero_width(
        cuts.cutter, ap, fz, lambda c: normal_errors(c, law, place.compliance_part, place.normal_part).sum(1)
    )
    return {
        "fz_mm": round(fz / MM, 4),
        "force_ae_mm": None if force is None else round(force / MM, 3),
        "displacement_ae_mm": None if error is None else round(error / MM, 3),
        "half_diameter_mm": round(0.5 * d / MM, 3),
    }


def _not_known(cell: Cell, advice: Advice) -> list[str]:
    """Keys of the cell file without which a limit is not looked at."""
    table = cell.tables.process_limits
    keys = [
        f"process_limits.{key}"
        for key in (
            *("spindle_power_w", "spindle_torque_nm", "spindle_max_rpm", "force_n", "axis_torque_nm"),
            "tool_bending_um",
        )
        if getattr(table, key) is None
    ]
    number = advice.own.tool if advice.own is not None else cell.tables.tools[0].number
    tool = next(tool for tool in cell.tables.tools if tool.number == number)
    if table.tool_bending_um is not None and tool.overhang_mm is None:
        keys.append("tools.overhang_mm")
    return keys
