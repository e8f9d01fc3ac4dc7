"""The job ``plan trochoid``: straight slots rewritten as loops of a smaller tool, and checked by cutting them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.inputs import AS_IT_IS, Job, Reading, faults_in, read_job
from counterflex.core import atomic
from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import ProgramError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.core.units import DEG, MM, MM_PER_MIN, plain
from counterflex.cutting.force import zero_normal_force_immersion
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.summary_file import write_summary
from counterflex.path.toolpath import FEED
from counterflex.plan.cut import Cut, cut
from counterflex.plan.strategy.trochoid import TrochoidLoop, loop_for, pieces
from counterflex.programs.program import Block, Program
from counterflex.programs.reading import require_linuxcnc

_TANGENT_RAD: Final = 0.25
_SHARE: Final = 0.3
"""A motion is a slot if so much of its way in the cut is over the whole width; where it enters, it is not."""
_WORDS: Final = frozenset("GXYFN")
_VOLUME_M3: Final = 1e-12
READING, WRITING, CHECKING = "reading the program", "writing the loops", "cutting both programs"


@dataclass(frozen=True)
class Trochoid:
    """Trochoid that is asked for."""

    tool: int | None = None  # Number of the smaller tool; None keeps the program's, for a slot wider than it
    width_m: float | None = None  # Of the slot; None is the diameter of the program's tool
    engagement_rad: float | None = None  # Largest immersion; None is that at which no mean force is normal to the loop
    fz_m: float | None = None  # Feed per tooth; None is the program's
    up: bool = True


@dataclass(frozen=True, eq=False)
class Rewritten:
    """A program with loops for slots."""

    text: str
    loop: TrochoidLoop
    feed_m_s: float  # Of the tool's centre in the loops
    bound: str  # What holds the feed down: ``feed per tooth`` or ``acceleration``
    lines: tuple[int, ...]
    tool: int  # Number of the tool in the loops
    width_m: float
    up: bool


def rewrite(job: Job, cell: Cell, requested: Trochoid, progress: Progress = silent) -> tuple[Rewritten, Cut]:
    """Replace the straight slots of a program.

    Returns:
        The program, and the cut of the original.

    Raises:
        ProgramError: There is no straight slot, one begins in the material, or its line cannot be replaced.
        InputError: The tool is too wide, or an angle out of range.
    """
    before = _cut(job, cell, progress)
    motions = _slots(job, before)
    old = job.program.motions[motions[0]].tool
    new = old if requested.tool is None else requested.tool
    cutter = cell.cutter(new)
    width = cell.cutter(old).diameter_m if requested.width_m is None else requested.width_m
    first = job.program.motions[motions[0]]
    teeth_per_s = cutter.flutes * first.spindle_rad_s / (2.0 * math.pi)
    fz = requested.fz_m
    if fz is None:
        fz = first.feed_m_s / (cell.cutter(old).flutes * first.spindle_rad_s / (2.0 * math.pi))
    angle = requested.engagement_rad
    if angle is None:
        angle = min(zero_normal_force_immersion(cell.force_law, fz), 0.5 * math.pi)
    loop = loop_for(width, cutter.radius_m, angle)
    turning = math.sqrt(cell.tables.controller.acceleration_m_s2 * loop.radius_m)
    feed = min(fz * teeth_per_s, turning)
    bound = "feed per tooth" if feed < turning else "acceleration"
    text, lines = _text(job.program, motions, loop, feed, old, new, up=requested.up)
    return Rewritten(text, loop, feed, bound, lines, new, width, requested.up), before


def _cut(job: Job, cell: Cell, progress: Progress) -> Cut:
    path = job.path
    with faults_in(job):
        return cut(path, path.p_part_tcp, cell.stock(), cell.cutter, cell.force_law, progress=progress)


def _slots(job: Job, result: Cut) -> list[int]:
    """Straight level motions that are milled over the whole width, all with one tool."""
    path, program = job.path, job.program
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    length = np.linalg.norm(step, axis=1)
    in_cut = (path.kind == FEED) & (result.volume_m3 > _VOLUME_M3) & (length > 0.0)
    whole = in_cut & (result.entry_rad < _TANGENT_RAD) & (result.exit_rad > math.pi - _TANGENT_RAD)
    count = len(program.motions)
    cutting = np.bincount(path.motion[in_cut], length[in_cut], count)
    slotting = np.bincount(path.motion[whole], length[whole], count)
    level = [m.kind == "feed" and abs(float(m.p_end[2] - m.p_start[2])) < 1e-9 for m in program.motions]
    some = [k for k in range(count) if level[k] and cutting[k] > 0.0 and slotting[k] >= _SHARE * cutting[k]]
    if not some:
        raise ProgramError(
            "the program mills no straight slot",
            where=Path(program.name).name,
            hint="Loops replace straight level feed motions that cut over the whole width of the tool",
        )
    _check(job, result, some)
    return some


def _check(job: Job, result: Cut, motions: list[int]) -> None:
    program, path = job.program, job.path
    if len({program.motions[k].tool for k in motions}) > 1:
        raise ProgramError(
            "the program mills slots with several tools",
            where=Path(program.name).name,
            hint="Split the program at the tool change",
        )
    for k in motions:
        block = program.blocks[program.motions[k].block]
        place = block.where(Path(program.name).name)
        rows = np.flatnonzero(path.motion == k)
        before = np.flatnonzero((path.motion < k) & (path.motion >= k - 1) & (path.kind == FEED))
        steep = before[np.abs(np.diff(path.p_part_tcp[:, 2], prepend=0.0)[before]) > 0.0]
        if len(rows) and len(steep) and float(result.volume_m3[steep].sum()) > _VOLUME_M3:
            raise ProgramError(
                "the slot begins in the material, where loops have no room",
                where=place,
                hint="Open it first: begin outside the part, or bore a hole as wide as the slot",
            )
        if not block.single or block.cycle or not {word.letter for word in block.words} <= _WORDS:
            raise ProgramError(
                "the line of a slot cannot be replaced",
                where=place,
                value=block.text.strip(),
                limit="one straight motion, executed once, with G, X, Y and F",
            )
        if not block.modal.absolute or block.modal.plane != 17 or block.modal.feed_mode != 94:
            raise ProgramError("loops need G90, G17 and G94", where=place, value=block.text.strip())


def _text(
    program: Program, motions: list[int], loop: TrochoidLoop, feed_m_s: float, old: int, new: int, *, up: bool
) -> tuple[str, tuple[int, ...]]:
    """The program with loops, and the lines that they replace."""
    lines: dict[int, list[str]] = {}
    for k in motions:
        motion = program.motions[k]
        block = program.blocks[motion.block]
        lines[block.line] = [f"({'up' if up else 'down'}-milling trochoid instead of: {_plain(block.text)})"]
        lines[block.line] += _loop_lines(block, motion.p_start, motion.p_end, loop, feed_m_s, motion.feed_m_s, up=up)
    if new != old:
        _check_other_cuts(program, set(motions), old)
        for block in program.blocks:
            changed = [w for w in block.words if w.literal and w.letter in "TH" and int(w.value) == old]
            if changed:
                text = block.text
                for word in sorted(changed, key=lambda w: w.start, reverse=True):
                    text = f"{text[: word.start]}{word.letter}{new}{text[word.end :]}"
                lines.setdefault(block.line, [text])
    replaced = tuple(sorted({program.blocks[program.motions[k].block].line for k in motions}))
    out: list[str] = []
    for number, line in enumerate(program.lines, start=1):
        out += lines.get(number, [line])
    return program.newline.join(out), replaced


def _plain(text: str) -> str:
    return text.replace("(", " ").replace(")", " ").replace(";", " ").strip()


def _check_other_cuts(program: Program, slots: set[int], old: int) -> None:
    """Refuse to change a tool that does more than slots, going down to them and leaving them."""
    for k, motion in enumerate(program.motions):
        sideways = float(np.linalg.norm(motion.p_end[:2] - motion.p_start[:2])) > 1e-9
        if motion.tool == old and k not in slots and motion.kind in ("feed", "arc") and sideways:
            raise ProgramError(
                "the tool that is to be changed does more than slots",
                where=program.blocks[motion.block].where(Path(program.name).name),
                value=f"T{old}",
                hint="Split the program, or keep the tool and give --width-mm",
            )


def _words(letters: str, values: Float, digits: int) -> str:
    return " ".join(f"{c}{v:.{digits}f}" for c, v in zip(letters, values.tolist(), strict=True))


def _loop_lines(
    block: Block, start: Float, end: Float, loop: TrochoidLoop, feed_m_s: float, programmed_m_s: float, *, up: bool
) -> list[str]:
    unit, origin = block.modal.unit_m, np.array(block.modal.p_part_origin)[:2]
    digits = 4 if unit == MM else 5
    turn = "G2" if up else "G3"
    out, here = [], np.round((start[:2] - origin) / unit, digits) + 0.0
    for piece in pieces(start[:2], end[:2], loop, up=up):
        there = np.round((piece.end - origin) / unit, digits) + 0.0
        line = _words("XY", there, digits)
        if piece.centre is None:
            out.append(f"G1 {line}")
        else:
            arms = np.round((piece.centre - origin) / unit - here, digits) + 0.0
            out.append(f"{turn} {line} {_words('IJ', arms, digits)}")
        here = there
    scale = unit / 60.0
    out[0] += f" F{feed_m_s / scale:.3f}"
    out[-1] += f" F{programmed_m_s / scale:.3f}"
    return out


class TrochoidSummary(Summary):
    """Loops in place of slots."""

    def _shown(self) -> Parts:
        rows = [
            ("slots in lines", ", ".join(map(str, self.get("places", self["lines"]))), ""),
            ("loops", "radius {radius_mm:g} mm", "step {step_mm:g} mm"),
            ("engagement, computed", "{engagement_deg:.1f} deg", "mean {mean_engagement_deg:.1f} deg"),
            ("engagement, cut", "{cut_engagement_deg:.1f} deg", "99 % of the loops stay below"),
            ("feed", "{feed_mm_min:g} mm/min", "bound by {feed_bound_by}"),
            ("mean force, largest", "{peak_force_n[1]:g} N", "{peak_force_n[0]:g} N before"),
            ("volume", "{volume_percent:g} %", "of that of the slots"),
            ("time", "{time_s[1]:g} s", "{time_s[0]:g} s before"),
        ]
        title = self.line("{program}: {milling}-milling with T{tool}")
        yield ShownTable(title, ["", "value", ""], [[self.line(text) for text in row] for row in rows])


def run(
    program: str | Path,
    cell_file: str | Path,
    out: str | Path,
    requested: Trochoid,
    *,
    reading: Reading = AS_IT_IS,
    progress: Progress = silent,
) -> TrochoidSummary:
    """Write the program with loops and ``summary.json`` into ``out``: both or none; returned is the summary."""
    cell = read_cell(cell_file)
    parts = in_parts(progress, {READING: 1.0, WRITING: 0.2, CHECKING: 4.0})
    job = read_job(program, cell, reading=reading)
    require_linuxcnc(job.program, "plan trochoid")
    result, before = rewrite(job, cell, requested, parts[READING])
    name = Path(program).name
    with atomic.atomic_folder(out) as staging:
        atomic.write_bytes(staging / name, result.text.encode(job.program.encoding, errors="replace"))
        parts[WRITING](1.0)
        again = read_job(staging / name, cell, reading=reading)
        summary = _summary(job, before, again, _cut(again, cell, parts[CHECKING]), result, cell)
        write_summary(staging / "summary.json", summary)
    progress(1.0)
    return TrochoidSummary(summary)


def _summary(job: Job, before: Cut, again: Job, after: Cut, result: Rewritten, cell: Cell) -> dict[str, Any]:
    """Return what the cut of both programs shows, in shop units."""
    replaced = _engagement(again, after)
    length = np.linalg.norm(np.diff(again.path.p_part_tcp, axis=0, prepend=again.path.p_part_tcp[:1]), axis=1)
    rows = np.flatnonzero(replaced > 0.0)
    volumes = [float(c.volume_m3[j.path.kind == FEED].sum()) for j, c in ((job, before), (again, after))]
    loop, law = result.loop, cell.force_law
    forces = [float(np.linalg.norm(c.w_tcp_part[:, :3], axis=1).max(initial=0.0)) for c in (before, after)]
    return {
        "program": Path(job.program.name).name,
        "cell": cell.label,
        "lines": list(result.lines),
        "tool": result.tool,
        "milling": "up" if result.up else "down",
        **plain(result, "width_mm:4"),
        **plain(loop, "radius_mm:4 step_mm:4 engagement_deg:3 mean_engagement_deg=mean_rad:3"),
        "cut_engagement_deg": round(
            float(np.quantile(replaced[rows], 0.99, weights=length[rows], method="inverted_cdf")) / DEG, 2
        ),
        "feed_mm_min": round(result.feed_m_s / MM_PER_MIN, 2),
        "feed_bound_by": result.bound,
        "peak_force_n": [round(force, 1) for force in forces],
        "volume_percent": round(100.0 * volumes[1] / volumes[0], 3) if volumes[0] > 0.0 else None,
        "time_s": [round(float(j.machined.time_s[-1]), 2) for j in (job, again)],
        "program_lines": [len(job.program.lines), len(again.program.lines)],
        "chip_range_mm": [law.h_min_m / MM, law.h_max_m / MM],
        "counterflex": __version__,
    }


def _engagement(job: Job, result: Cut) -> Float:
    """(n,) rad, width of the arc of engagement of level rows in the cut; 0 elsewhere."""
    path = job.path
    level: Bool = np.abs(np.diff(path.p_part_tcp[:, 2], prepend=path.p_part_tcp[:1, 2])) < 1e-9
    in_cut = (path.kind == FEED) & (result.volume_m3 > _VOLUME_M3) & level
    arc = result.exit_rad - result.entry_rad
    out: Float = np.where(in_cut & np.isfinite(arc), arc, 0.0)
    return out
