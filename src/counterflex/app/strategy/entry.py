"""The job ``plan entry``: soft entries and exits for a program, checked by removal, with force and error of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy

from counterflex import __version__
from counterflex.app.inputs import AS_IT_IS, Job, Reading, faults_in, read_job, setting_of
from counterflex.app.proof.simulate import undisturbed
from counterflex.app.strategy.entries import Entry, entries_of
from counterflex.app.strategy.entry_text import Moves, rewritten
from counterflex.core import atomic
from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import ModelError, ProgramError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.core.units import DEG, MM, UM
from counterflex.cutting.stock import HeightMap
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.summary_file import write_summary
from counterflex.plan.cut import Cut, cut
from counterflex.plan.inputs import part_compliance, solve_joints
from counterflex.plan.lowest_mode import mode_of
from counterflex.programs.program import Motion
from counterflex.programs.reading import require_linuxcnc
from counterflex.report.glossary import MODEL_NOTE, MODEL_UM, line_of

READING, CHECKING, JUDGING = "finding the entries", "checking by removal", "force and error"
STEP_M: Final = 0.25 * MM
"""Step of the path along which force and error are computed."""
WINDOW_S: Final = 0.02
"""The force step is the change of the mean force vector from one such time to the next."""
_CONTACT_M3: Final = 1e-12
_SURFACE_M: Final = 5.0 * UM  # Heights that differ less are the same: chord of a sampled arc
Figures = dict[str, float]


@dataclass(frozen=True, eq=False)
class Bent:
    """A program cut by a tool that yields through the lowest mode."""

    job: Job
    cut: Cut


class SoftEntries(Summary):
    """Entries and exits of a program, before and after."""

    def _shown(self) -> Parts:
        rows = [row | {"at": line_of(row, bare=True)} for row in self["entries"]]
        pairs = (("peak force N", "peak_force_n", ".0f"), ("force step N/ms", "force_step_n_per_ms", ".2f"))
        columns = "line=at | entry=kind | move={move}{kept:kept: %s}" + "".join(
            f" | {head}={{{key}[0]:{form}}}{{{key}[1]: -> %{form}}}"
            for head, key, form in (*pairs, (f"error, {MODEL_UM}", "error_um", ".0f"))
        )
        title = self.line("{program}: entries and exits, {time_s[0]:g} -> {time_s[1]:g} s")
        yield ShownTable.of(title, columns, rows, MODEL_NOTE)


def run(
    program: str | Path,
    cell_file: str | Path,
    out: str | Path,
    moves: Moves,
    *,
    reading: Reading = AS_IT_IS,
    progress: Progress = silent,
) -> SoftEntries:
    """Write the program with soft entries and ``summary.json`` into ``out``: both or none; returned is the summary.

    Raises:
        ProgramError: The program has no entry or exit that a move could soften.
    """
    cell = read_cell(cell_file)
    parts = in_parts(progress, {READING: 1.0, CHECKING: 2.0, JUDGING: 4.0})
    job = read_job(program, cell, reading=reading)
    require_linuxcnc(job.program, "plan entry")
    parts[READING](0.0)
    entries = _entries(job, cell, moves)
    name = Path(program).name
    with atomic.atomic_folder(out) as staging:
        target = staging / name
        parts[CHECKING](0.0)
        entries, again = _written(job, cell, entries, moves, target, reading)
        parts[JUDGING](0.0)
        before = bent(read_job(program, cell, reading=reading, step_m=STEP_M), cell)
        after = bent(read_job(target, cell, reading=reading, step_m=STEP_M), cell)
        summary = {
            "program": name,
            "cell": cell.label,
            "entries": [_row(entry, before, after, moves) for entry in entries],
            "wall_cell_mm": round(cell.stock().cell_m / MM, 4),
            "time_s": [round(float(j.machined.time_s[-1]), 2) for j in (job, again)],
            "counterflex": __version__,
        }
        write_summary(staging / "summary.json", summary)
    progress(1.0)
    return SoftEntries(summary)


def _entries(job: Job, cell: Cell, moves: Moves) -> list[Entry]:
    path = job.path
    with faults_in(job):
        stock = cell.stock()
        top = float(stock.z.max())
        undisturbed_cut = cut(path, path.p_part_tcp, stock, cell.cutter, cell.force_law)
    radius = {tool.number: cell.cutter(tool.number).radius_m for tool in cell.tables.tools}
    entries = entries_of(job, undisturbed_cut, radius, top, moves.run_up_m, edges=moves.edges)
    if not any(not entry.refusal for entry in entries):
        reasons = sorted({entry.refusal for entry in entries})
        raise ProgramError(
            "the program has no entry or exit that a move could soften",
            where=Path(job.program.name).name,
            value="; ".join(reasons) or "no cut begins or ends in the material",
            hint="Arcs replace a plunge or a retract beside a wall, ramps one into the full width of a slot; "
            "cuts over an edge of the blank get a run-up",
        )
    return entries


def _written(
    job: Job, cell: Cell, entries: list[Entry], moves: Moves, target: Path, reading: Reading
) -> tuple[list[Entry], Job]:
    """Write the program, and leave out moves until the part is the same."""
    surface = undisturbed(job, cell)
    for _ in range(len(entries) + 1):
        open_ones = [entry for entry in entries if not entry.refusal]
        if not open_ones:
            reasons = "; ".join(f"line {_line(job, e)}: {e.refusal}" for e in entries)
            raise ProgramError(
                "no entry can be softened without changing the part",
                where=Path(job.program.name).name,
                value=reasons,
                hint="Try a smaller --radius-mm or --angle-deg",
            )
        text = rewritten(job.program, open_ones, moves)
        atomic.write_bytes(target, text.encode(job.program.encoding, errors="replace"))
        again = read_job(target, cell, reading=reading)
        at, reason = _difference(surface, again, cell)
        if at is None:
            return entries, again
        worst = min(open_ones, key=lambda entry: float(np.linalg.norm(entry.point[:2] - at)))
        entries = [replace(entry, refusal=reason) if entry is worst else entry for entry in entries]
    raise AssertionError


def _difference(surface: HeightMap, again: Job, cell: Cell) -> tuple[Float | None, str]:
    """Return where a program leaves another part than a surface, and how; None where it is the same."""
    path = again.path
    try:
        with faults_in(again):
            result = cut(path, path.p_part_tcp, cell.stock(), cell.cutter, cell.force_law)
    except ModelError as fault:
        return path.p_part_tcp[-1, :2], fault.what
    hit = result.collisions(path.kind)
    if len(hit):
        return path.p_part_tcp[hit[0], :2], "its approach at rapid speed would meet material"
    made = undisturbed(again, cell).z
    deeper, higher = differences(np.asarray(surface.z, dtype=np.float64), np.asarray(made, dtype=np.float64))
    for wrong, reason in ((deeper, "would cut what the program leaves"), (higher, "would leave what the program cuts")):
        if wrong.any():
            j, i = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
            return np.array([surface.x_m()[i], surface.y_m()[j]]), reason
    return None, ""


def differences(before_m: Float, after_m: Float) -> tuple[Bool, Bool]:
    """Cells cut deeper and cells left higher than before, by more than the resolution of the map.

    A wall is known to a cell: a cell differs where it differs from all its neighbours, too.

    Args:
        before_m: (ny, nx) m.
        after_m: (ny, nx) m.
    """
    deeper: Bool = after_m < scipy.ndimage.minimum_filter(before_m, size=3) - _SURFACE_M
    higher: Bool = after_m > scipy.ndimage.maximum_filter(before_m, size=3) + _SURFACE_M
    return deeper, higher


def bent(job: Job, cell: Cell) -> Bent:
    """Cut a program with a tool that yields."""
    path, setting = job.path, setting_of(cell, job, part_may_be_held=True)
    with faults_in(job):
        q = solve_joints(path, job.line_of_motion[path.motion], setting).q
        mode = mode_of(setting.chain, q[len(q) // 2], setting.mode)
        C = part_compliance(setting, setting.relative_motion(path), q)
        result = cut(path, path.p_part_tcp, cell.stock(), cell.cutter, cell.force_law, compliance_part=C, mode=mode)
    return Bent(job, result)


def _row(entry: Entry, before: Bent, after: Bent, moves: Moves) -> dict[str, Any]:
    old = figures(entry, before, entry.motion)
    new = None
    if not entry.refusal:
        new = figures(entry, after, _same_motion(before.job, after.job, entry.motion))
    radius = entry.radius_m if moves.radius_m is None else moves.radius_m
    arc = f"arc of {radius / MM:g} mm, {moves.angle_rad / DEG:g} deg"
    slope = f"ramp of {moves.slope_rad / DEG:g} deg"
    run_up = f"run-up of {moves.run_up_m / MM:g} mm"
    move = {"plunge": slope, "edge": slope, "run-up": run_up}.get(entry.kind, arc)
    return {
        "line": _line(before.job, entry),
        "kind": entry.kind,
        "move": "" if entry.refusal else move,
        "kept": entry.refusal,
        **{key: [round(old[key], 3), None if new is None else round(new[key], 3)] for key in old},
    }


def _line(job: Job, entry: Entry) -> int:
    return job.program.blocks[job.program.motions[entry.motion].block].line


def _same_motion(old: Job, new: Job, motion: int) -> int:
    """Index of a motion of the old program in the new one: both have the old ones in the same order."""
    match, k = -1, 0
    for expected in [m for m in old.program.motions[: motion + 1] if _cuts(m)]:
        later = range(k, len(new.program.motions))
        match = next((j for j in later if _alike(expected, new.program.motions[j])), -1)  # a move may have replaced it
        k = k if match < 0 else match + 1
    return match


def _cuts(motion: Motion) -> bool:
    level = float(np.linalg.norm(motion.p_end[:2] - motion.p_start[:2])) > 0.0
    return motion.kind == "arc" or (motion.kind == "feed" and level)


def _alike(a: Motion, b: Motion) -> bool:
    if a.kind != b.kind or abs(a.turn_rad - b.turn_rad) > 1e-4:
        return False
    return bool(np.allclose(a.p_start, b.p_start, atol=1e-6) and np.allclose(a.p_end, b.p_end, atol=1e-6))


def figures(entry: Entry, cut_: Bent, motion: int) -> Figures:
    """Peak force, force step and error of an entry or an exit.

    Args:
        cut_: The program, cut by a tool that yields.
        motion: Index of the motion that cuts, in that program.

    Returns:
        ``peak_force_n``, ``force_step_n_per_ms`` from the first contact to two radii behind the entry (two radii before
        the exit to the last contact); ``error_um``, largest displacement square to the path over the two radii.
    """
    job, result = cut_.job, cut_.cut
    path, program = job.path, job.program
    rows = np.flatnonzero(path.motion == motion)
    way = np.cumsum(np.linalg.norm(np.diff(path.p_part_tcp[rows], axis=0, prepend=path.p_part_tcp[rows[:1]]), axis=1))
    leaves = entry.kind == "wall out"
    way -= 0.0 if leaves else way[np.argmin(np.linalg.norm(path.p_part_tcp[rows] - entry.point, axis=1))]
    near = rows[way >= way[-1] - 2.0 * entry.radius_m] if leaves else rows[way <= 2.0 * entry.radius_m]
    first, last = _stretch(program.motions, motion)
    move = np.flatnonzero((path.motion >= first) & (path.motion <= last))
    zone = move[move >= near[0]] if leaves else move[move <= near[-1]]
    zone = np.append(zone, zone[-1] + 1) if zone[-1] + 1 < len(path) else zone
    w = np.where((result.volume_m3 > _CONTACT_M3)[:, None], result.w_tcp_part[:, :3], 0.0)
    sideways = _square(path.p_part_tcp, result.displacement_part[:, :3], near)
    return {
        "peak_force_n": float(np.linalg.norm(w[zone], axis=1).max(initial=0.0)),
        "force_step_n_per_ms": force_step(path.time_s[zone], w[zone]) * 1e-3,
        "error_um": float(np.abs(sideways).max(initial=0.0)) / UM,
    }


def _stretch(motions: Sequence[Motion], k: int) -> tuple[int, int]:
    """First and last feed motion around one, with no rapid between."""
    first = last = k
    while first > 0 and motions[first - 1].kind in ("feed", "arc"):
        first -= 1
    while last + 1 < len(motions) and motions[last + 1].kind in ("feed", "arc"):
        last += 1
    return first, last


def _square(p: Float, displacement: Float, rows: Int) -> Float:
    """(k,) m, level displacement to the left of the path."""
    step = (p[rows] - p[np.maximum(rows - 1, 0)])[:, :2]
    length = np.linalg.norm(step, axis=1)
    unit = step / np.where(length > 0.0, length, 1.0)[:, None]
    out: Float = displacement[rows, 1] * unit[:, 0] - displacement[rows, 0] * unit[:, 1]
    return out


def force_step(time_s: Float, force: Float) -> float:
    """Largest change between the mean force over :data:`WINDOW_S` and that over the next, N/s; zero force before.

    Args:
        time_s: (n,) ends of the rows; not falling.
        force: (n, 3) N, mean over each row; of the first row nothing is used.
    """
    if len(time_s) < 2 or time_s[-1] <= time_s[0]:
        return 0.0
    impulse = np.cumsum(force[1:] * np.diff(time_s)[:, None], axis=0)
    impulse = np.concatenate([np.zeros((1, 3)), impulse])
    begin = float(time_s[0]) - WINDOW_S
    grid = np.arange(begin, max(begin, float(time_s[-1]) - 2.0 * WINDOW_S) + 1e-9, 0.1 * WINDOW_S)
    three = [
        np.column_stack([np.interp(grid + k * WINDOW_S, time_s, column) for column in impulse.T]) for k in range(3)
    ]
    change = three[2] - 2.0 * three[1] + three[0]
    return float(np.linalg.norm(change, axis=1).max(initial=0.0)) / WINDOW_S**2
