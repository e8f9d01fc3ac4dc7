"""What a campaign found, against what is true in the simulated cell. The only step that looks into the truth.

Single parameters can trade against each other without harm; so besides them stand the things that planning uses:
where the tool is, how far a load moves it, how large the force of a chip is.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM, MS, N_PER_MM, N_PER_MM2, UM, UM_PER_KN, URAD, URAD_PER_KNM
from counterflex.cutting.coefficients import ForceLaw, KienzleLaw, edge_force
from counterflex.files.cell.cell import Cell
from counterflex.geometry.pose import register
from counterflex.robot.elasticity.chain import ElasticChain, forward_elastic
from counterflex.robot.model.description import Play, Segment, Servo
from counterflex.twin.plant.plant import Plant
from counterflex.twin.truth.truth import CuttingTruth, Drive, Truth

LOAD_N = 500.0
"""Load of the deflections that are compared, along each base axis."""
CHIPS_M = (0.01 * MM, 0.03 * MM, 0.1 * MM)
_ROUNDS = 6


@dataclass(frozen=True)
class TrueRow:
    """One line of the comparison."""

    group: str  # ``use`` for what planning uses, else ``stiffness``, ``masses``, ``drives`` or ``cutting``
    name: str
    unit: str
    before: float  # By the cell file that the campaign started from
    identified: float  # By the one that it ended with
    true: float | None  # In the simulated cell; None where the value is an error, best at 0

    def plain(self) -> dict[str, Any]:
        """As plain values, rounded for people."""
        out = asdict(self)
        for key in ("before", "identified", "true"):
            out[key] = None if out[key] is None else float(f"{out[key]:.6g}")
        return out


def parameter_errors(before: Cell, identified: Cell, truth: Truth, q: Float) -> tuple[TrueRow, ...]:
    """Compare two states of a cell file with the truth.

    Args:
        q: (n, 6) rad, joints at which poses and deflections are compared; those of the program.
    """
    rows = [*_use(before, identified, truth, q)]
    old, new = _segments(before), _segments(identified)
    for body in truth.bodies:
        if body.compliance.any() and body.name in old and body.name in new:
            k = int(np.argmax(body.compliance))
            unit, scale = ("urad/kNm", URAD_PER_KNM) if k >= 3 else ("um/kN", UM_PER_KN)
            a, b, true = (float(s.compliance[k]) / scale for s in (old[body.name], new[body.name], body))
            axis = ("tx", "ty", "tz", "rx", "ry", "rz")[k]
            rows.append(TrueRow("stiffness", f"{body.name} {axis}", unit, a, b, true))
    rows += [
        TrueRow("masses", body.name, "kg", old[body.name].mass_kg, new[body.name].mass_kg, body.mass_kg)
        for body in truth.bodies
        if body.name in old and body.name in new and new[body.name].mass_kg != old[body.name].mass_kg
    ]
    rows += _drives(before, identified, truth)
    rows += _cutting(before.force_law, identified.force_law, truth.cutting)
    return tuple(rows)


def _segments(cell: Cell) -> dict[str, Segment]:
    return {s.name: s for s in (*cell.robot.segments, *cell.end_effector.segments)}


def _use(before: Cell, identified: Cell, truth: Truth, q: Float) -> list[TrueRow]:
    plant = Plant(truth, friction=False)
    loads = np.concatenate([LOAD_N * np.eye(3), np.zeros((3, 3))], axis=1)
    poses: Float = np.array([plant.equilibrium(row) for row in q])
    moved: Float = np.array([[plant.equilibrium(row, w)[:3, 3] for w in loads] for row in q]) - poses[:, None, :3, 3]
    rows = []
    places, bends, worst = [], [], []
    for cell in (before, identified):
        alone = forward_elastic(cell.chain, q, None, gravity=True, equilibrium=True)
        loaded = np.stack([_loaded(cell.chain, q, w) for w in loads], axis=1)
        gap = np.linalg.norm(loaded - alone[:, None, :3, 3] - moved, axis=2)
        places.append(placement_error(alone, poses))
        bends.append(100.0 * float(gap.sum() / np.linalg.norm(moved, axis=2).sum()))
        worst.append(float(gap.max()))
    text = f"deflection under {LOAD_N:g} N along the program"
    rows.append(TrueRow("use", f"{text}: share not explained", "%", bends[0], bends[1], None))
    rows.append(TrueRow("use", f"{text}: worst error", "um", worst[0] / UM, worst[1] / UM, None))
    rows.append(
        TrueRow(
            "use",
            "place of the tool along the program, best frame and tool: mean error",
            "um",
            places[0] / UM,
            places[1] / UM,
            None,
        )
    )
    return rows


def _loaded(chain: ElasticChain, q: Float, w: Float) -> Float:
    out: Float = forward_elastic(chain, q, np.tile(w, (len(q), 1)), gravity=True, equilibrium=True)[:, :3, 3]
    return out


def placement_error(Ts_model: Float, Ts_true: Float) -> float:
    """Mean distance of tool places, m, after the best rigid move of the base and the best shift of the tool tip.

    Minimises ``sum |T0 (p_i + R_i d) - p_i,true|^2`` over a pose T0 and a shift d in the tool's axes: what any use of
    a robot sets up anew, part frame and tool, is not counted as its error.

    Args:
        Ts_model: (n, 4, 4) poses of the tool by a model.
        Ts_true: (n, 4, 4) true ones.
    """
    true, R_model = Ts_true[:, :3, 3], Ts_model[:, :3, :3]
    shift = np.zeros(3)
    residual = np.zeros_like(true)
    for _ in range(_ROUNDS):
        here = Ts_model[:, :3, 3] + R_model @ shift
        T_true_model, residual = register(true, here)
        rest = residual @ T_true_model[:3, :3]
        turned = np.cross(np.eye(3), (here - here.mean(axis=0))[:, None, :])
        blocks = [np.swapaxes(turned, 1, 2), np.broadcast_to(np.eye(3), R_model.shape), R_model]
        A: Float = np.concatenate(blocks, axis=2).reshape(-1, 9)
        shift = shift + np.linalg.lstsq(A, rest.reshape(-1), rcond=1e-9)[0][6:]
    return float(np.mean(np.linalg.norm(residual, axis=1)))


def _drives(before: Cell, identified: Cell, truth: Truth) -> list[TrueRow]:
    rows = []
    for axis, drive in enumerate(truth.drives):
        old, new = (None if c.robot.play is None else c.robot.play[axis] for c in (before, identified))
        if new is not None and new != old:
            rows += _play_rows(axis, old, new, drive)
        loop_old, loop_new = (None if c.robot.servo is None else c.robot.servo[axis] for c in (before, identified))
        if loop_new is not None and loop_new != loop_old:
            rows += _servo_rows(axis, loop_old, loop_new, drive)
    return rows


def _play_rows(axis: int, old: Play | None, new: Play, drive: Drive) -> list[TrueRow]:
    was = old if old is not None else Play()
    name = f"axis {axis + 1}"
    return [
        TrueRow(
            "drives",
            f"{name} play, half width",
            "urad",
            was.half_band_rad / URAD,
            new.half_band_rad / URAD,
            drive.dead_band_rad / URAD,
        ),
        TrueRow(
            "drives",
            f"{name} dry friction",
            "N m",
            float(sum(was.friction_nm)),
            float(sum(new.friction_nm)),
            float(sum(drive.link_friction_nm)),
        ),
    ]


def _servo_rows(axis: int, old: Servo | None, new: Servo, drive: Drive) -> list[TrueRow]:
    name = f"axis {axis + 1}"
    gain = drive.speed_bandwidth_per_s * drive.servo_inertia_kg_m2
    return [
        TrueRow(
            "drives",
            f"{name} speed loop",
            "kN m s",
            (0.0 if old is None else old.speed_gain_nm_s) / 1e3,
            new.speed_gain_nm_s / 1e3,
            gain / 1e3,
        ),
        TrueRow(
            "drives",
            f"{name} integral time",
            "ms",
            (0.0 if old is None else old.integral_time_s) / MS,
            new.integral_time_s / MS,
            drive.integral_time_s / MS,
        ),
    ]


def _cutting(before: ForceLaw, identified: ForceLaw, truth: CuttingTruth) -> list[TrueRow]:
    rows = []
    chips = np.array(CHIPS_M)
    true = true_edge_force(truth, chips) / N_PER_MM
    old, new = edge_force(before, chips) / N_PER_MM, edge_force(identified, chips) / N_PER_MM
    for i, chip in enumerate(CHIPS_M):
        for k, name in enumerate(("cutting", "radial", "axial")):
            rows.append(
                TrueRow(
                    "cutting",
                    f"{name} force per length of edge at a chip of {chip / MM:g} mm",
                    "N/mm",
                    float(old[i, k]),
                    float(new[i, k]),
                    float(true[i, k]),
                )
            )
    if isinstance(before, KienzleLaw) and isinstance(identified, KienzleLaw):
        scale = (truth.h_ref_m / (1.0 * MM)) ** np.array(truth.exponent)
        a, b = (law.k11_pa()[0] / N_PER_MM2 for law in (before, identified))
        rows.append(TrueRow("cutting", "kc1.1", "N/mm2", a, b, truth.k_pa[0] * float(scale[0]) / N_PER_MM2))
    return rows


def true_edge_force(truth: CuttingTruth, chips_m: Float) -> Float:
    """Force per length of edge (n, 3) N/m, cutting, radial, axial, at chip thicknesses (n,) m > 0.

    ``K h_ref^m h^(1-m) + edge (1 - exp(-h / onset))``, see :class:`counterflex.twin.truth.truth.CuttingTruth`.
    """
    m, h = np.array(truth.exponent), np.asarray(chips_m, dtype=np.float64)[:, None]
    chip = np.array(truth.k_pa) * truth.h_ref_m**m * h ** (1.0 - m)
    out: Float = chip + np.array(truth.edge_n_m) * (1.0 - np.exp(-h / truth.edge_onset_m))
    return out
