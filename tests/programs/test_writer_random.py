"""Random programs (G90/G91, inch/mm, all planes, I J K and R arcs, helices, G92) written and read back."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.path.toolpath import FEED
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.gcode.write.writer import write_gcode

PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}


class Writer:
    """Makes up a valid program; positions in mm."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.lines = ["G21 G90 G17 G94 F900", "M3 S1000", "G0 X0 Y0 Z5"]
        self.at = np.array([0.0, 0.0, 5.0])
        self.unit, self.incremental, self.plane = 1.0, False, 17

    def words(self, targets: dict[int, float]) -> str:
        """Axis words to the targets; the position is there afterwards, as rounded by the text."""
        out = ""
        for axis, target in targets.items():
            base = self.at[axis] if self.incremental else 0.0
            value = round((target - base) / self.unit, 4)
            out += f" {'XYZ'[axis]}{value:.4f}"
            self.at[axis] = base + value * self.unit
        return out

    def straight(self) -> None:
        targets = {
            axis: float(self.at[axis] + self.rng.uniform(-20, 20)) for axis in range(3) if self.rng.random() < 0.6
        }
        if targets:
            self.lines.append(f"G{self.rng.integers(0, 2)}" + self.words(targets))

    def arc(self) -> None:
        u, v, w = PLANES[self.plane]
        radius, start = self.rng.uniform(1, 20), self.rng.uniform(-3, 3)
        turn = float(self.rng.uniform(0.1, 6.0) * self.rng.choice([-1, 1]))
        centre = {u: self.at[u] - radius * np.cos(start), v: self.at[v] - radius * np.sin(start)}
        offsets = {axis: round((centre[axis] - self.at[axis]) / self.unit, 4) for axis in (u, v)}
        full = self.rng.random() < 0.2
        end = start if full else start + turn
        targets = {u: float(centre[u] + radius * np.cos(end)), v: float(centre[v] + radius * np.sin(end))}
        if self.rng.random() < 0.4:
            targets[w] = float(self.at[w] - 2.0)
        code = f"G{3 if turn > 0 else 2}"
        by_radius = not full and 0.2 < abs(turn) < 2.8 and self.rng.random() < 0.4
        tail = (
            f" R{radius / self.unit:.4f}" if by_radius else "".join(f" {'IJK'[a]}{o:.4f}" for a, o in offsets.items())
        )
        self.lines.append(code + self.words({} if full else targets) + tail)

    def setting(self) -> None:
        kind = self.rng.integers(0, 4)
        if kind == 0:
            self.incremental = not self.incremental
            self.lines.append("G91" if self.incremental else "G90")
        elif kind == 1:
            self.unit = 26.4 - self.unit
            self.lines += ["G21", "F900"] if self.unit == 1.0 else ["G20", "F40"]
        elif kind == 2:
            self.plane = int(self.rng.choice([17, 18, 19]))
            self.lines.append(f"G{self.plane}")
        elif not self.incremental:
            self.lines.append("G92" + self.words({0: float(self.at[0]), 1: float(self.at[1])}))

    def text(self) -> str:
        for _ in range(self.rng.integers(3, 12)):
            self.rng.choice(np.array([self.straight, self.arc, self.arc, self.straight, self.setting]))()
        return "\n".join([*self.lines, "G0 Z50", "M2", ""])


def distance(points: Float, polyline: Float) -> float:
    a, d = polyline[:-1], np.diff(polyline, axis=0)
    length2 = np.maximum(np.sum(d * d, axis=1), 1e-30)
    share = np.clip(np.einsum("nmc,mc->nm", points[:, None] - a, d) / length2, 0.0, 1.0)
    gap = a + share[..., None] * d - points[:, None]
    return float(np.sqrt(np.sum(gap * gap, axis=2).min(axis=1)).max(initial=0.0))


@pytest.mark.parametrize("seed", range(60))
def test_random_programs_run_through_every_commanded_point(seed: int) -> None:
    program = read_gcode(Writer(seed).text())
    path = tool_path(program, step_m=2e-3, chord_m=4e-5)
    rng = np.random.default_rng(1000 + seed)
    x, wave = path.p_part_tcp, rng.uniform(1, 60, 3)
    shift = 10.0 ** rng.uniform(-7, -3) * np.sin(x * wave + rng.uniform(0, 6, 3) + x[:, ::-1] * 15)
    chosen = rng.random(len(program.motions)) < rng.choice([0.3, 0.7, 1.0])
    shift[~chosen[path.motion] | ((path.kind != FEED) & (rng.random() < 0.6))] = 0.0
    shift[0] = 0.0
    compensated = CompensatedPath.from_correction(path, shift)
    result = write_gcode(program, compensated)
    back = tool_path(read_gcode(result.text), step_m=2e-2, chord_m=1e-7)
    feed = path.kind == FEED
    assert distance(compensated.p_part_command[feed], back.p_part_tcp) < 5e-6 + 5e-7
    assert result.largest_written_error_m < 5e-6 + 5e-7
    assert back.p_part_tcp[-1] == pytest.approx(compensated.p_part_command[-1], abs=5e-7)
    if not np.any(shift):
        assert result.text.split("\n") == list(program.lines)
