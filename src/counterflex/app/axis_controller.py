"""The job ``rsi tune``: a PID for the correction of each axis, from identified delays and the modes of the cell."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomlkit

from counterflex.app.lowest_mode import lowest_mode, posture_at_blank, swinging_chain, undamped_hz
from counterflex.core import atomic
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError, ModelError
from counterflex.core.units import DEG, MS, plain
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.document import move_paths, new_table, parsed, table_of
from counterflex.files.cell.online import OnlineTable
from counterflex.plan.elastic_motion import matrices
from counterflex.plan.modes import modes
from counterflex.robot.model.description import Servo
from counterflex.runtime.axis_gains import AXES, AxisGains, require_usable
from counterflex.runtime.design.axis_pid import AxisDesign, design, robots, worst_margins
from counterflex.runtime.design.tracker import DesignGoals
from counterflex.runtime.design.tracker_plant import TrackerPlant
from counterflex.runtime.settings import OnlineSettings

SHAKEN: Final = 0.1
"""Least share of an axis in the strain of a mode for the mode to be one of the axis."""
ASSUMED_YIELD: Final = 0.2
"""Share of a swing of the link that the motor shows, where the loop gains of the drive are not known. A judgement: with
the gains of published position loops (15 to 30 1/s, speed loops of 100 to 300 1/s) drives show less of modes above
6 Hz."""
LEAST_PHASE: Final = 30.0 * DEG
"""Phase margin below which gains of a cell file are refused."""
LEAST_GAIN: Final = 2.0
"""Likewise the gain margin, a factor: 6 dB."""
_DIGITS: Final = 4


@dataclass(frozen=True)
class TunedAxis:
    """Controller found for an axis, or the reason why there is none."""

    plant: TrackerPlant
    design: AxisDesign | None  # Its controller, or None
    refused: str = ""  # Why there is none


def axis_plants(cell: Cell, settings: OnlineSettings) -> tuple[TrackerPlant, ...]:
    """Return how each axis answers a correction, by what its encoder shows.

    Dead time and lag are those of ``[timing]`` (a dead time per axis where there is one), or of ``[online]``. The mode
    of an axis is the lowest in whose strain it has a share of :data:`SHAKEN`: with the motor held its link answers
    ``1 + sum_i s_i (-p^2) / (p^2 + 2 z w_i p + w_i^2)``, s_i its share in the strain of mode i. The motor shows of it
    ``k / (kd |j w + kp + ...|)``, its own compliance against that of the gear.

    Args:
        cell: The cell; its posture is that at the highest corner of the blank.
    """
    q = posture_at_blank(cell)
    mode, chain = lowest_mode(cell, q), swinging_chain(cell, q).chain
    delays, dead = settings.delays, np.full(AXES, settings.delays.dead_s)
    timing = cell.tables.timing
    if timing is not None and len(timing.correction.dead_time_ms) == AXES:
        dead = np.maximum(0.0, np.array(timing.correction.dead_time_ms)) * MS
    shaken: list[tuple[float, float]] = [(0.0, 0.0)] * AXES
    if np.any(chain.compliance > 0.0):
        M, stiffness = matrices(chain, q)[:2]
        free = modes(M, stiffness)
        omega = free.omega_rad_s * mode.hz / undamped_hz(chain, q)  # a tap test moves them all alike
        servo = chain.servo or (None,) * AXES
        shaken = [_seen(free.strain[k], omega, float(stiffness[k]), servo[k], settings.period_s) for k in range(AXES)]
    return tuple(
        TrackerPlant(
            settings.period_s, float(dead[k]), delays.natural_per_s, delays.damping, w, mode.damping_ratio, share
        )
        for k, (w, share) in enumerate(shaken)
    )


def _seen(strain: Float, omega: Float, stiffness: float, servo: Servo | None, period_s: float) -> tuple[float, float]:
    """Lowest mode that an axis shakes, rad/s, and the share of it that its encoder shows; 0, 0: none."""
    own = np.flatnonzero((strain >= SHAKEN) & (omega * period_s < math.pi))
    if not len(own):
        return 0.0, 0.0
    w, share = float(omega[own[0]]), float(strain[own[0]])
    if servo is None:
        return w, share * ASSUMED_YIELD
    held = servo.speed_gain_nm_s * abs(
        (1j * w + servo.position_gain_per_s) * (1.0 + 1.0 / (1j * w * servo.integral_time_s))
    )
    return w, share * min(1.0, stiffness / held)


def tune(cell: Cell) -> tuple[TunedAxis, ...]:
    """A controller for each axis of a cell, with the margins that ``[online]`` asks for.

    Raises:
        FileFormatError: The cell has no ``[online]`` table.
        ModelError: No axis has a gain that keeps its margins.
    """
    table = _table(cell)
    settings = table.settings(cell.tables.timing, compensated=False)
    goals = DesignGoals(table.phase_margin_deg * DEG, 10.0 ** (table.gain_margin_db / 20.0))
    axes: list[TunedAxis] = []
    done: dict[TrackerPlant, TunedAxis] = {}
    for plant in axis_plants(cell, settings):
        if plant not in done:
            try:
                done[plant] = TunedAxis(plant, design(plant, goals))
            except ModelError as fault:
                done[plant] = TunedAxis(plant, None, str(fault))
        axes.append(done[plant])
    if all(one.design is None for one in axes):
        raise ModelError(
            "no axis has a gain that keeps its margins",
            where=str(cell.path),
            value=axes[0].refused,
            hint="Nothing was written",
        )
    return tuple(axes)


def require_margins(cell: Cell, settings: OnlineSettings) -> None:
    """Refuse controllers of the axes that are not stable with margin on this cell.

    Raises:
        InputError: A phase margin below :data:`LEAST_PHASE`, a gain margin below :data:`LEAST_GAIN`, or unstable, with
            dead time and lag off by 10 % and the mode by 15 %.
    """
    if settings.axis_pid is None:
        return
    for axis, (plant, gains) in enumerate(zip(axis_plants(cell, settings), settings.axis_pid, strict=True)):
        if gains.idle:
            continue
        margins, radius = worst_margins(robots(plant, DesignGoals()), gains)
        if not (margins.stable and margins.phase_rad >= LEAST_PHASE and margins.gain >= LEAST_GAIN):
            shown = (
                f"phase {margins.phase_deg:.0f} deg, gain {margins.gain_db:.1f} dB" if margins.stable else "unstable"
            )
            raise InputError(
                "the PID of an axis has no margin",
                where=f"{cell.path}: [online.axis_pid] axis {axis + 1}",
                value=f"{shown} (largest pole {radius:.4f})",
                limit=f"phase {LEAST_PHASE / DEG:.0f} deg, gain {20.0 * math.log10(LEAST_GAIN):.0f} dB",
                hint="counterflex rsi tune finds gains that have one",
            )


def shown(axes: tuple[TunedAxis, ...]) -> list[dict[str, Any]]:
    """Plain values, one row per axis."""
    rows: list[dict[str, Any]] = []
    for axis, one in enumerate(axes):
        plant = one.plant
        row: dict[str, Any] = {
            "axis": axis + 1,
            "dead_ms": round(plant.delay_s / MS, 2),
            "lag_ms": round(plant.slow_s / MS, 2),
            "mode_hz": round(plant.mode_per_s / (2.0 * math.pi), 2),
            "mode_seen": round(plant.mode_share, 3),
            "refused": one.refused,
        }
        if one.design is not None:
            gains, margins = one.design.gains, one.design.margins
            row |= {
                **_keys(gains),
                "phase_margin_deg": round(float(margins.phase_deg), 1),
                "gain_margin_db": round(float(margins.gain_db), 2),
                "sensitivity": round(margins.sensitivity, 3),
                "largest_pole": round(one.design.radius, 5),
                "error_after_step_ms": round(one.design.late_s / MS, 1),
                "error_alone_ms": round(one.design.late_alone_s / MS, 1),
            }
        rows.append(row)
    return rows


def write(cell: Cell, axes: tuple[TunedAxis, ...], target: Path) -> None:
    """Write the cell file with the gains and corrections of the axes in it; comments, order and all else are kept.

    Raises:
        InputError: The target is the cell file, or something in [online] does not go with the gains.
    """
    if target.resolve() == cell.path.resolve():
        raise InputError("the cell file itself is not overwritten", where="--apply", value=target)
    online = _table(cell)
    require_usable((AxisGains(),) * AXES, "axes", online.tracker, axis_play=online.axis_play)
    doc = parsed(cell.path)
    table = new_table()
    gains = [AxisGains() if one.design is None else one.design.gains for one in axes]
    for key in ("proportional", "integral_per_s", "derivative_ms", "filter_ms", "most_urad"):
        table[key] = [_keys(one)[key] for one in gains]
    table_of(doc, "online")["output"] = "axes"
    table_of(doc, "online")["axis_pid"] = table
    move_paths(doc, cell.path.parent, target.parent)
    atomic.write_text(target, tomlkit.dumps(doc))


def _keys(gains: AxisGains) -> dict[str, float]:
    values = plain(gains, "proportional integral_per_s derivative_ms filter_ms most_urad")
    return {key: float(f"{value:.{_DIGITS}g}") for key, value in values.items()}


def _table(cell: Cell) -> OnlineTable:
    table = cell.tables.online
    if table is None:
        raise FileFormatError(
            "the cell file has no table [online]",
            where=str(cell.path),
            hint='Add one, for example with output = "axes"',
        )
    return table
