"""Write the figures of the pages that explain: docs/images/theory-*.svg, each computed by the functions it explains.

    python tools/make_figures.py [FOLDER]

`tests/tools/test_make_figures.py` fails where a picture is not what this program writes.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from counterflex.app.proof.truth import knowing, truth_of
from counterflex.core import atomic
from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import DEG, MM, MRAD, UM, URAD
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.force import engagement_of_arc, mean_force
from counterflex.cutting.tooth_force import tooth_forces
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.identify.solver.intervals import of_linear
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.identify.solver.solve import solve
from counterflex.path.toolpath import tool_orientation, tool_poses
from counterflex.robot.elasticity import compliance, play
from counterflex.robot.elasticity.chain import ElasticChain, flange, forward, frames
from counterflex.robot.kinematics.inverse import inverse_path
from counterflex.twin.truth.family import FAMILIES
from counterflex_lab.reproduce.papers.still import Curve, Level, Still, svg
from figure_sketch import AXES, FAINT, Sketch

ROOT: Final = Path(__file__).resolve().parents[1]
IMAGES: Final = ROOT / "docs" / "images"
CELL: Final = ROOT / "examples" / "cells" / "kr300_d16_small.toml"
LARGER: Final = 150.0
"""How many times larger the deflection is drawn."""
FEED_TOOTH_M: Final = 25.0 * MM / (13000.0 / 60.0 * 3)
DEPTH_M: Final = 6.0 * MM


@cache
def cell() -> Cell:
    """The cell of the pictures."""
    return read_cell(CELL)


@cache
def posture(above_m: float = 0.0) -> Float:
    """(6,) rad with the tool over the middle of the part, so far above its top."""
    known = cell()
    turned = tool_orientation(np.array([[0.0, 0.0, 1.0]]), known.tables.posture.rotation_about_tool_deg * DEG)
    poses = tool_poses(known.T_base_part, np.array([[0.03, 0.03, 0.04 + above_m]]), turned)
    q: Float = inverse_path(known.chain, poses, known.tables.posture.branch).q[0]
    return q


def bent(chain: ElasticChain, q: Float, w_tcp_base: Float, larger: float) -> Float:
    """(n + 1, 3) m: places of the segment frames and of the tip under a load, deflections ``larger`` times as large.

    The displacement of a place is that of all elements before it: linear, each by its compliance times its load.
    """
    Ts = frames(chain, q)
    loads = compliance.element_loads(chain, q, w_tcp_base)
    delta = larger * chain.compliance_at(q) * loads
    places = np.vstack([Ts[:, :3, 3], forward(chain, q)[None, :3, 3]])
    out = places.copy()
    for i, (T, d) in enumerate(zip(Ts, delta, strict=True)):
        out[i + 1 :] += T[:3, :3] @ d[:3] + np.cross(T[:3, :3] @ d[3:], places[i + 1 :] - T[:3, 3])
    return out


def deflection() -> str:
    """The arm from the side, without load and under a force at the tool, with the shares of its elements."""
    chain, q = cell().chain, posture()
    w = np.array([400.0, 0.0, 300.0, 0.0, 0.0, 0.0])
    side = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    sketch = Sketch(
        "An arm from the side, without load and bent by a force", side, np.array([1.15, 0.0, 0.95]), 200.0, 450.0
    )
    rigid, loaded = bent(chain, q, w, 0.0), bent(chain, q, w, LARGER)
    sketch.line(np.array([[-0.5, 0.0, 0.0], [2.6, 0.0, 0.0]]), FAINT, 1.5)
    base = np.zeros((1, 3))
    sketch.line(np.vstack([base, rigid]), FAINT, 6.0)
    sketch.line(np.vstack([base, loaded]), "#1d4ed8", 3.0)
    sketch.dots(loaded[np.flatnonzero(chain.joint >= 0)], "#1d4ed8")
    sketch.arrow(loaded[-1], loaded[-1] + 0.9e-3 * w[:3], "#be123c", 3.0)
    d = compliance.deflection(chain, q, w)[:3]
    sketch.text(loaded[-1] + 0.9e-3 * w[:3], "500 N on the tool", (8.0, -4.0), "#be123c")
    sketch.text(rigid[-1], "no load", (6.0, 18.0), "#6b7280")
    sketch.words(430.0, 262.0, f"Tool deflected by {np.linalg.norm(d) / UM:.0f} um,", bold=True)
    sketch.words(430.0, 280.0, f"drawn {LARGER:.0f} times larger. Shares of it:")
    shares = compliance.shares(chain, q, w)[:, :3] @ d / float(d @ d)
    order = np.argsort(-shares)
    for k, i in enumerate(order[:6]):
        sketch.words(430.0, 302.0 + 18.0 * k, f"{100.0 * shares[i]:.1f} %  {chain.names[i]}", "#374151")
    return sketch.svg()


def cell_frames() -> str:
    """The frames of a cell: base, joints, flange, sensor, tcp, part, tracker; the tool stands above the part."""
    known, q = cell(), posture(0.25)
    chain = known.chain
    view = np.array([[0.93, -0.36, 0.0], [0.13, 0.33, 0.93]])
    sketch = Sketch("Frames of a cell", view, np.array([0.9, -0.1, 0.93]), 220.0, 520.0)
    Ts = frames(chain, q)
    tip = forward(chain, q)
    sketch.line(np.vstack([np.zeros((1, 3)), Ts[:, :3, 3], tip[None, :3, 3]]), "#d1d5db", 9.0)
    stock = known.stock()
    low = np.array([stock.x0_m - 0.5 * stock.cell_m, stock.y0_m - 0.5 * stock.cell_m, stock.bottom_m])
    high = np.array([*(low[:2] + stock.cell_m * np.array(stock.z.shape[::-1])), float(stock.z.max())])
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float64)
    where = (low + corners * (high - low)) @ known.T_base_part[:3, :3].T + known.T_base_part[:3, 3]
    for i, k in np.argwhere(np.sum(corners[:, None] != corners, axis=2) == 1):
        sketch.line(where[[i, k]], "#b45309", 1.2)
    tracker = pose.make(rotation.exp(np.array([0.0, 0.0, 2.2])), np.array([1.75, -0.75, 1.05]))
    sketch.frame(np.eye(4), "base", 0.3, (-10.0, 18.0))
    for k, i in enumerate(np.flatnonzero(chain.joint >= 0)[:3]):
        sketch.frame(Ts[i], f"joint{k + 1}", 0.17, (-16.0, -8.0))
    sketch.frame(flange(chain, q), "flange", 0.17, (-8.0, -14.0))
    sketch.frame(Ts[list(chain.names).index("sensor")], "sensor", 0.17, (10.0, -14.0))
    sketch.frame(tip, "tcp", 0.2, (12.0, 4.0))
    sketch.frame(known.T_base_part, "part", 0.24, (-10.0, 20.0))
    sketch.frame(tracker, "tracker", 0.24, (10.0, 16.0))
    sketch.line(np.array([tracker[:3, 3], tip[:3, 3]]), FAINT, 1.2, dashed=True)
    for k, (name, colour) in enumerate(AXES):
        sketch.words(24.0 + 22.0 * k, 32.0, name, colour, bold=True)
    return sketch.svg()


def tooth_pass() -> Still:
    """Force over a revolution, tooth by tooth, against its mean: a slot and a cut of a quarter of the diameter."""
    law = cell().force_law
    cutter = cell().cutter(1)
    curves = []
    for name, exit_rad, colour in (("slot", math.pi, "#1d4ed8"), ("quarter of the diameter", math.pi / 3.0, "#b45309")):
        depth = engagement_of_arc(cutter, DEPTH_M, 0.0, exit_rad)
        teeth = tooth_forces(cutter, law, depth, FEED_TOOTH_M, trochoid=True)
        mean = mean_force(cutter, law, depth[None], FEED_TOOTH_M).wrench_tcp[0, :3]
        pick = np.linspace(0, len(teeth.angle_rad) - 1, 241).round().astype(int)
        force = np.linalg.norm(teeth.wrench_tcp[:, :3], axis=1)
        curves.append(Curve(name, teeth.angle_rad[pick] / DEG, force[pick], colour=colour))
        level = np.full(2, float(np.linalg.norm(mean)))
        curves.append(Curve(f"mean of the {name}", np.array([0.0, 360.0]), level, "dashed", colour))
    return Still(
        "theory-tooth-pass", "Force on the tool over one revolution", "", "rotation of the first tooth, deg",
        "force on the tool, N", curves,
    )  # fmt: skip


def lost_motion() -> Still:
    """Torsion that play and friction add, over the angle of an axis that goes to and fro."""
    chain = cell().chain
    c = np.array([chain.compliance[chain.torsion[0], 5]])
    there = np.linspace(0.0, 4e-3, 81)
    way = np.concatenate([there, there[-2::-1], there[1:]])
    curves = []
    for name, half_band, most, torque in (
        ("dry friction", 0.0, (250.0, 150.0), np.full(len(way), 300.0)),
        ("play, torque that changes its side", 5e-5, (0.0, 0.0), np.where(way < 2e-3, 300.0, -300.0)),
    ):
        load = torque[:, None]
        s = play.torsion_path(way[:, None], load, c, np.array([half_band]), np.array([most]), np.array([[2e-4, 1e-3]]))
        curves.append(Curve(name, way / MRAD, (s - c * load)[:, 0] / URAD))
    return Still(
        "theory-lost-motion", "Lost motion of an axis", "", "angle of the motor, mrad", "lost motion, urad", curves
    )


def undisturbed() -> Still:
    """Error of a pass beside a wall: corrected by the force of the cut before, again and again."""
    known, radius, width = cell(), 8.0 * MM, 4.0 * MM
    law, cutter = known.force_law, known.cutter(1)
    R_base_part = known.T_base_part[:3, :3]
    C = R_base_part.T @ compliance.cartesian_compliance(known.chain, posture())[:3, :3] @ R_base_part

    def force(off: float) -> float:
        """Mean force across the feed, N, of a tool that is off by so much, into the material positive."""
        arc = engagement_of_arc(cutter, DEPTH_M, 0.0, math.acos(1.0 - (width + off) / radius))
        return float(mean_force(cutter, law, arc[None], FEED_TOOTH_M).wrench_tcp[0, 1])

    def cut(correction: float, soft: float) -> float:
        """Place of the tool: force and place belong together."""
        off = correction
        for _ in range(60):
            off = correction + soft * force(off)
        return off

    passes = np.arange(5.0)
    curves = []
    for times in (1.0, 2.0, 3.0):
        soft, correction, errors = times * float(C[1, 1]), 0.0, []
        for _ in passes:
            off = cut(correction, soft)
            errors.append(off / UM)
            correction = -soft * force(off)
        at_once = cut(-soft * force(0.0), soft) / UM
        name = f"{soft / UM:.2g} um/N; from the undisturbed cut {abs(at_once):.1f} um at once"
        curves.append(Curve(name, passes, np.abs(errors)))
    return Still(
        "theory-undisturbed-cut", "Error of a pass by how its correction is found", "",
        "passes that were cut and corrected by their own force", "error across the feed, um", curves,
        ticks=["uncorrected", *(str(k) for k in range(1, len(passes)))],
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Pulls:
    """Deflections of the tool by pulls; the torsion of each axis is a parameter, all else is known."""

    columns: Float  # (rows, 3, 6) m per unit of compliance of each axis
    measured: Float  # (rows, 3) m, less what all else makes
    noise_m: float  # standard deviation
    name: str = "pulls"
    components: tuple[str, ...] = ("x m", "y m", "z m")

    @property
    def group(self) -> Int:
        """Every pull by itself."""
        return np.arange(len(self.measured))

    @property
    def sigma(self) -> Float:
        """(rows, 3) m."""
        return np.full(self.measured.shape, self.noise_m)

    def evaluate(self, x: Float) -> Float:
        """(rows, 3) weighted residuals."""
        out: Float = (self.measured - self.columns @ x) / self.noise_m
        return out

    def jacobian(self, x: Float) -> Float:  # noqa: ARG002
        """(rows, 3, 6); the law is linear."""
        return -self.columns / self.noise_m

    def subset(self, rows: Bool) -> Pulls:
        """Some pulls."""
        return replace(self, columns=self.columns[rows], measured=self.measured[rows])


def columns_of(chain: ElasticChain, rng: np.random.Generator, count: int) -> Float:
    """(count, 3, 6) deflection by compliance of each axis, of pulls of 500 N in random directions and postures."""
    q = posture() + rng.uniform(-1.0, 1.0, (count, 6)) * np.array([40.0, 15.0, 20.0, 60.0, 40.0, 60.0]) * DEG
    w = np.zeros((count, 6))
    w[:, :3] = rng.standard_normal((count, 3))
    w[:, :3] *= 500.0 / np.linalg.norm(w[:, :3], axis=1, keepdims=True)
    load = compliance.element_loads(chain, q, w)[:, chain.torsion, 5]
    turned = compliance.element_jacobians(chain, q)[..., :3, 5][:, chain.torsion]
    out: Float = np.swapaxes(turned, 1, 2) * load[:, None, :]
    return out


def intervals() -> Still:
    """Stated uncertainty of predictions and their error on pulls held out of the fit, over the number of pulls."""
    chain = cell().chain
    nominal = chain.compliance[chain.torsion, 5]
    parameters = Parameters.of(
        [Parameter(f"axis{k + 1}.rz", "rad/(N m)", c, 0.35, log=True) for k, c in enumerate(nominal)]
    )
    counts = np.array([2, 3, 4, 6, 8, 12, 20, 32, 50])
    seeds, noise_m = 12, 20.0 * UM
    stated, error = np.empty((len(counts), seeds, 180)), np.empty((len(counts), seeds, 180))
    before = np.empty((seeds, 180))
    for seed in range(seeds):
        rng = np.random.default_rng(1001 + seed)
        truth = nominal * np.exp(0.35 * rng.standard_normal(6))
        all_pulls, held_out = columns_of(chain, rng, counts[-1]), columns_of(chain, rng, 60)
        measured = all_pulls @ truth + noise_m * rng.standard_normal((counts[-1], 3))
        before[seed] = np.abs(held_out @ (nominal - truth)).reshape(-1)
        for k, count in enumerate(counts):
            fit = solve(parameters, [Pulls(all_pulls[:count], measured[:count], noise_m)])
            known = of_linear(fit, held_out.reshape(-1, 6), (held_out @ fit.values).reshape(-1))
            stated[k, seed] = 0.5 * (known.upper - known.lower)
            error[k, seed] = np.abs(held_out @ (fit.values - truth)).reshape(-1)
    places, inside = np.arange(float(len(counts))), float(np.mean(error <= stated))
    share = f"{100.0 * inside:.0f} %"
    half = np.sqrt(np.mean(stated**2, axis=(1, 2))) / UM
    twice = 2.0 * np.sqrt(np.mean(error**2, axis=(1, 2))) / UM
    return Still(
        "theory-intervals", "Stated uncertainty of predictions against their error on held-out pulls", "",
        "pulls that were measured", "deflection of 500 N, um", [
            Curve(f"half width of the 95 % intervals, rms; {share} of the errors lie within", places, half),
            Curve("twice the error of held-out predictions, rms", places, twice, "points"),
        ],
        [Level("twice the error before, rms", 2.0 * float(np.sqrt(np.mean(before**2))) / UM)],
        ticks=[str(count) for count in counts], log=True,
    )  # fmt: skip


def families() -> Still:
    """Deflection of a slot on simulated cells against the prediction of the cell file, by family."""
    known, q = cell(), posture()
    depth = engagement_of_arc(known.cutter(1), DEPTH_M, 0.0, math.pi)
    R_base_part = known.T_base_part[:3, :3]

    def bends(chain: ElasticChain, law: ForceLaw) -> float:
        """Deflection of the tool by the mean force of the slot, m."""
        w = np.zeros(6)
        w[:3] = R_base_part @ mean_force(known.cutter(1), law, depth[None], FEED_TOOTH_M).wrench_tcp[0, :3]
        return float(np.linalg.norm(compliance.deflection(chain, q, w)[:3]))

    expected = bends(known.chain, known.force_law)
    seeds = range(1001, 1021)
    curves = []
    for place, family in enumerate(FAMILIES.values()):
        ratios = [bends(*knowing(known, truth_of(known, seed, family))) / expected for seed in seeds]
        spread = place + np.linspace(-0.3, 0.3, len(ratios))
        curves.append(Curve("", spread, np.array(ratios), "points"))
    return Still(
        "theory-families", "Deflection of simulated cells against the prediction of the cell file", "",
        "family; twenty cells each", "deflection, share of the predicted", curves,
        [Level("as the cell file predicts", 1.0)], ticks=list(FAMILIES), log=True,
    )  # fmt: skip


FIGURES: Final[dict[str, Callable[[], str | Still]]] = {
    "theory-deflection.svg": deflection,
    "theory-frames.svg": cell_frames,
    "theory-tooth-pass.svg": tooth_pass,
    "theory-lost-motion.svg": lost_motion,
    "theory-undisturbed-cut.svg": undisturbed,
    "theory-intervals.svg": intervals,
    "theory-families.svg": families,
}


def made(name: str) -> str:
    """Text of a picture."""
    picture = FIGURES[name]()
    return picture if isinstance(picture, str) else svg(picture)


def main(folders: list[str]) -> int:
    """Write all pictures."""
    folder = Path(folders[0]) if folders else IMAGES
    folder.mkdir(parents=True, exist_ok=True)
    for name in FIGURES:
        atomic.write_text(folder / name, made(name))
        print(f"wrote {folder / name}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
