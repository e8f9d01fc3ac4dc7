"""Natural frequencies, damping and mode shapes of a cell in a posture."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.lowest_mode import STATED, posture_at_blank, swinging_chain
from counterflex.app.unknown_stiffness import require_stiffness
from counterflex.core import atomic
from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.result import Parts, ShownTable, Summary, fill
from counterflex.core.units import DEG
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.summary_file import write_summary
from counterflex.files.tap_test import read_tap_test
from counterflex.plan.elastic_motion import coordinates, matrices
from counterflex.plan.elastic_motion_kernel import AXES
from counterflex.plan.lowest_mode import damping_of, mode_of
from counterflex.plan.modes import ModelSpread, UndampedModes, driven_modes, kinetic_shares, modes, point_motion
from counterflex.plan.tap_fit import MassFit, Tap, fit_masses, frac
from counterflex.report.modes_page import ModesData
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.signals.preview import Mode

DIRECTIONS: Final = ("tx", "ty", "tz", "rx", "ry", "rz")
_NAMED: Final = 3  # Elements and bodies that are named of each mode
_WORTH: Final = 0.05  # Share of the energy from which one is named
COUNT: Final = 6


class ModesSummary(Summary):
    """Modes, and a tap test beside them."""

    def _shown(self) -> Parts:
        rows = [
            row | {"bend": ", ".join(fill("{name} {share!p:.0f} %", one) for one in row["springs"])}
            for row in self["modes"]
        ]
        yield ShownTable.of(
            self.line("Modes of {cell} at {joints_deg:g} deg"),
            "Hz=hz:.2f | 90 % of cells={of_90_percent_hz[0]:.1f} to {of_90_percent_hz[1]:.1f} | "
            "damping=damping_ratio:.3f | tip moves along (base)=tip_direction:+.2f | "
            "of compliance={share_of_compliance!p:.0f} % | springs (strain energy)=bend",
            rows,
            self.line("{masses}; drives: {drives}; damping: {damping}"),
        )
        if self["with_drives"]:
            yield f"with the drives on: {_listed(self['with_drives'], 2)}"
        if tap := self.get("tap_test"):
            body = [one | {"of_data": "yes" if one["seen"] else "no: as stated"} for one in tap["masses"]]
            yield ShownTable.of(
                fill("Tap test {file}, {rows} rows up to {up_to_hz:g} Hz", tap),
                "body | stated kg:.1f | fitted kg:.1f | sigma={sigma_percent:.0f} % | seen by the data=of_data",
                body,
                f"all stiffnesses times {tap['stiffness_factor']:.3f}; FRAC {tap['frac_before']:.3f} before, "
                f"{tap['frac_after']:.3f} after",
            )
            yield f"modes before: {_listed(tap['modes_before'], 3)}"
            yield f"modes after:  {_listed(tap['modes_after'], 3)}"


def _listed(modes_: list[dict[str, float]], digits: int) -> str:
    return ", ".join(f"{mode['hz']:.2f} Hz ({mode['damping_ratio']:.{digits}f})" for mode in modes_)


@dataclass(frozen=True, eq=False)
class PostureModes:
    """The modes of a cell in a posture."""

    cell: Cell
    q: Float  # (6,) rad
    chain: ElasticChain
    free: UndampedModes
    tip: Float  # (6, m) motion of the tool's tip in each mode, m and rad, base axes
    intervals: Float  # (n, 2) Hz, what nine of ten cells have, the lowest mode first
    damping_s: float  # beta of the damping beta K
    spread: ModelSpread  # How well masses and stiffnesses are known
    driven: tuple[Mode, ...]  # Modes with the drives on, where loop gains are known
    summary: ModesSummary

    @classmethod
    def of(cls, cell: Cell, q: Float | None = None, *, count: int = COUNT) -> PostureModes:
        """The modes of a cell.

        Args:
            q: (6,) rad; None is at the blank, or all axes at zero where the cell has no part.

        Raises:
            InputError: Axes of unknown stiffness, or nothing that yields.
        """
        require_stiffness(cell)
        if not np.any(cell.chain.compliance > 0.0):
            raise InputError(
                "nothing of the cell yields, so nothing swings",
                where=str(cell.path),
                hint="Give compliances in [[robot.elastic]] or of the end effector",
            )
        begin = time.perf_counter()
        angles = posture_at_blank(cell) if q is None else as_float("q", q, (6,))
        swinging = swinging_chain(cell, angles)
        chain = swinging.chain
        M, stiffness, J, _ = matrices(chain, angles)
        free = modes(M, stiffness)
        kinetic = kinetic_shares(chain, angles, free.shapes)
        intervals = swinging.frequency_intervals(angles)
        beta = damping_of(chain, mode_of(chain, angles, cell.tables.dynamics.mode))
        servo = chain.servo or (None,) * AXES
        driven = tuple(driven_modes(M, stiffness, beta, servo)) if chain.servo is not None else ()
        tip = J @ free.shapes
        rows = [_row(k, chain, free, kinetic, tip, intervals, beta) for k in range(min(count, len(free.omega_rad_s)))]
        summary = {
            "cell": cell.label,
            "robot": cell.robot.name,
            "joints_deg": np.round(chain.axes.shown(angles) / DEG, 4).tolist(),
            "modes": rows,
            "with_drives": [
                {"hz": round(mode.hz, 3), "damping_ratio": round(mode.damping_ratio, 4)} for mode in driven[:count]
            ],
            "masses": swinging.origin,
            "drives": "rigid" if chain.servo is None else "loop gains of the cell file",
            "damping": "assumed" if cell.tables.dynamics.mode is None and chain.servo is None else "cell file",
            "seconds": round(time.perf_counter() - begin, 3),
            "counterflex": __version__,
        }
        return cls(cell, angles, chain, free, tip, intervals, beta, swinging.spread, driven, ModesSummary(summary))


def _row(
    k: int, chain: ElasticChain, free: UndampedModes, kinetic: Float, tip: Float, intervals: Float, beta_s: float
) -> dict[str, Any]:
    """A mode in plain values."""
    omega = float(free.omega_rad_s[k])
    hz = omega / (2.0 * math.pi)
    segment, direction, _ = coordinates(chain)
    springs = [f"{chain.names[s]} {DIRECTIONS[d]}" for s, d in zip(segment.tolist(), direction.tolist(), strict=True)]
    moved = tip[:3, k]
    size = float(np.linalg.norm(moved))
    whole = float(np.sum(tip[:3] ** 2))
    towards = moved / size if size > 0.0 else np.zeros(3)
    return {
        "hz": round(hz, 3),
        "of_90_percent_hz": np.round(intervals[k], 3).tolist(),
        "damping_ratio": round(0.5 * beta_s * omega, 4),
        "tip_direction": np.round(towards * (1.0 if towards[np.argmax(np.abs(towards))] >= 0.0 else -1.0), 3).tolist(),
        "share_of_compliance": round(size**2 / whole, 4) if whole > 0.0 else 0.0,
        "springs": _largest(free.strain[:, k], springs),
        "bodies": _largest(kinetic[:, k], list(chain.names)),
    }


def _largest(share: Float, names: list[str]) -> list[dict[str, Any]]:
    order = np.argsort(-share)[:_NAMED]
    return [{"name": names[i], "share": round(float(share[i]), 3)} for i in order.tolist() if share[i] >= _WORTH]


UP_TO_HZ: Final = 40.0
"""Beyond, links and motors have modes of their own that the chain does not have."""
_LISTED: Final = 4


def beside_tap_test(done: PostureModes, file: str | Path, up_to_hz: float = UP_TO_HZ) -> dict[str, Any]:
    """Compare the modes of a cell with a tap test in the same posture, and fit its masses.

    Args:
        done: Modes in the posture of the tap test.

    Returns:
        Plain values: agreement before and after, modes before and after, masses with what is known of each.

    Raises:
        FileFormatError: The file is damaged.
        InputError: Too few rows below ``up_to_hz``.
    """
    whole = read_tap_test(file)
    rows = whole.omega_rad_s <= 2.0 * math.pi * up_to_hz
    if not rows.any():
        raise InputError(
            "no row of the tap test is low enough",
            where=str(file),
            value=f"{whole.omega_rad_s.min() / (2.0 * math.pi):.3g} Hz",
            limit=f"<= {up_to_hz:g} Hz",
            hint="Choose --up-to-hz",
        )
    tap = Tap(whole.omega_rad_s[rows], whole.force_base[rows], whole.motion_base[rows], whole.receptance[rows])
    fit = fit_masses(done.chain, done.q, tap, done.damping_s, done.spread.mass, STATED)
    after = fit.applied(done.chain)
    return {
        "file": Path(file).name,
        "rows": int(rows.sum()),
        "up_to_hz": up_to_hz,
        "frac_before": round(frac(tap.receptance, fit.before), 4),
        "frac_after": round(frac(tap.receptance, fit.after), 4),
        "modes_before": _modes(done.chain, done, done.damping_s),
        "modes_after": _modes(after, done, fit.damping_s),
        "damping_s_after": float(f"{fit.damping_s:.4g}"),
        "stiffness_factor": round(fit.stiffness_factor, 4),
        "masses": _masses(done.chain, fit),
    }


def _modes(chain: ElasticChain, done: PostureModes, damping_s: float) -> list[dict[str, float]]:
    M, stiffness = matrices(chain, done.q)[:2]
    listed = driven_modes(M, stiffness, damping_s, chain.servo or (None,) * AXES)[:_LISTED]
    return [{"hz": round(mode.hz, 3), "damping_ratio": round(mode.damping_ratio, 4)} for mode in listed]


def _masses(chain: ElasticChain, fit: MassFit) -> list[dict[str, Any]]:
    """Masses before and after; where the data say nothing, the stated one stays."""
    return [
        {
            "body": chain.names[body],
            "stated_kg": round(float(chain.mass[body]), 2),
            "fitted_kg": round(float(chain.mass[body] * fit.factor[k]), 2),
            "sigma_percent": round(100.0 * float(fit.sigma[k]), 1),
            "seen": bool(fit.seen[k]),
        }
        for k, body in enumerate(np.asarray(fit.bodies).tolist())
    ]


def run(
    cell_file: str | Path,
    out: str | Path | None = None,
    *,
    joints_deg: list[float] | None = None,
    assume_class: bool = False,
    count: int = COUNT,
    tap_test: str | Path | None = None,
    up_to_hz: float | None = None,
    progress: Progress = silent,
) -> ModesSummary:
    """The modes of a cell; with ``out``, write ``summary.json`` and ``report.html`` there.

    Args:
        out: Folder, made when missing; None writes nothing.
        joints_deg: Six axes as the controller shows them, deg; None is at the blank.
        assume_class: Take the median of the robot's class for axes of unknown stiffness.
        tap_test: File of a tap test in this posture, or None.
        up_to_hz: Rows of it that count; None is :data:`counterflex.app.cell_modes.UP_TO_HZ`.

    Raises:
        CounterflexError: The cell cannot be read, has no stiffness, or its blank is out of reach.
    """
    cell = read_cell(cell_file, assume_class=assume_class)
    q = None if joints_deg is None else cell.chain.axes.model(np.array(joints_deg) * DEG)
    done = PostureModes.of(cell, q, count=count)
    if tap_test is not None:
        progress(0.2)
        done.summary["tap_test"] = beside_tap_test(done, tap_test, UP_TO_HZ if up_to_hz is None else up_to_hz)
    progress(1.0)
    if out is not None:
        from counterflex.report.page import write_page

        with atomic.atomic_folder(out) as staging:
            write_summary(staging / "summary.json", done.summary)
            write_page(page_data(done).page(), staging / "report.html")
    return done.summary


def page_data(done: PostureModes) -> ModesData:
    """Return what the page of the modes shows."""
    shapes = done.free.shapes[:, : len(done.summary["modes"])]
    points, moved = point_motion(done.chain, done.q, shapes)
    title, flange = f"Modes of {done.cell.label}", done.chain.flange_segment + 2
    return ModesData(done.summary, points, moved, flange, title, done.cell.robot.name)
