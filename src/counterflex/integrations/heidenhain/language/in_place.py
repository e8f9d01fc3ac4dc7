"""The same Klartext program back with only its targets replaced."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, as_positive
from counterflex.core.errors import InputError, ProgramError
from counterflex.core.units import DEG, INCH, MINUTE
from counterflex.integrations.heidenhain.language import LIMITS, VECTOR_DECIMALS
from counterflex.integrations.heidenhain.language.emitter import dwell_lines, feed_text, signed
from counterflex.integrations.heidenhain.language.written import PathLine, function_of, spelled
from counterflex.programs.compensated import CompensatedPath
from counterflex.programs.gcode.write.arc_fit import arc_error, radius_centre, written_turn
from counterflex.programs.gcode.write.arc_pieces import ArcPiece, arc_pieces, nominal_share, straight_pieces
from counterflex.programs.gcode.write.writer import GcodeText, header_lines
from counterflex.programs.motion_rows import LEAST_FEED_CHANGE, feed_factor, motion_rows, written_error
from counterflex.programs.program import TOOL_CENTRE, TOOL_VECTOR, Block, Modal, Motion, Program
from counterflex.programs.rotary.poses import CommandedWords

_ROUNDINGS: Final = 3.0
_LARGEST_TURN: Final = 2.0 * math.pi - 1e-6
_POLAR: Final = frozenset(("C", "CP", "LP"))
_FLOW: Final = re.compile(
    r"\s*(?:LBL\b|CALL\b|FN\s*\d|Q[LRS]?\d+\s*=|BEGIN\s+PGM\b|END\s+PGM\b|M\s*(?:2|30)\s*$)", re.IGNORECASE
)
_PARAMETER: Final = re.compile(r"(?<![A-Z0-9])(?:[A-Z]{0,6}[+-]?\s*)Q[LR]?\d+(?!\d*\s*=)", re.IGNORECASE)


def write_heidenhain(
    program: Program,
    compensated: CompensatedPath,
    *,
    tolerance_m: float = 5e-6,
    decimals: int = LIMITS.position_decimals,
    cell: str = "",
    header: bool = True,
    job: str = "",
    words: CommandedWords | None = None,
) -> GcodeText:
    """Write a program back with its targets replaced by the commanded ones.

    Statements whose motions are not corrected stay byte for byte, but for coordinates that they would inherit from a
    corrected position: these are written. A corrected L gets its coordinates edited in place and further L behind it
    where one straight line is not enough (these have no block number: the control numbers blocks itself). A corrected
    arc stays one about a CC of its own, or becomes several, or L, within the tolerance. RND whose lines are corrected
    becomes an arc. A drilling cycle that is corrected is written out as L. F is written before pieces whose feed
    changes. A program with labels and calls is written in the order of execution.

    Args:
        program: As read.
        compensated: Commanded rows for the path sampled from ``program``.
        tolerance_m: Largest distance of a commanded sample from the written path at the same place, > 0, m.
        decimals: Of written coordinates in mm, 2 to 6; inch programs get one more.
        cell: Name of the cell, for the comment at the head.
        header: Write comments that say what made the program; never where nothing changed.
        job: Hash of the plan, for the comment.
        words: Of a program that turns the tool, what to command; ``compensated`` is not asked then.

    Returns:
        Text and counts.

    Raises:
        InputError: Path and program do not belong together, or an option is out of range.
        ProgramError: A corrected motion cannot be written.
    """
    as_positive("tolerance_m", tolerance_m)
    if not 2 <= decimals <= 6:
        raise InputError("decimals is out of range", value=decimals, limit="2 .. 6")
    writer = _Writer(program, compensated, tolerance_m, decimals, words)
    rows = writer.rows
    changed = bool(rows.moved.any() or np.any(rows.share != 1.0))
    if changed:
        _refuse_unsaid(program)
    lines = writer.run() if changed else list(program.lines)
    if changed and header:
        place = 1 + next((k for k, line in enumerate(lines) if "BEGIN PGM" in line.upper()), -1)
        lines[place:place] = [f";{text}" for text in header_lines(program, tolerance_m, cell, job)]
    dropped = float(np.max(np.linalg.norm(compensated.rotvec_part_command, axis=1), initial=0.0))
    return GcodeText(
        text=program.newline.join(lines),
        moved_motions=int(rows.moved.sum()) if changed else 0,
        split_motions=writer.split_motions,
        vertices_added=writer.vertices_added,
        arcs_kept=writer.arcs_kept,
        arcs_split=writer.arcs_split,
        arcs_as_lines=writer.arcs_as_lines,
        radius_replaced=0,
        completed_blocks=writer.completed_blocks,
        cycles_expanded=writer.cycles_expanded,
        unrolled=not program.straight,
        tolerance_m=tolerance_m,
        resolution_m=writer.resolution_m,
        largest_written_error_m=max(written_error(rows, writer.written, writer.checked), writer.arc_error_m)
        if changed else 0.0,
        largest_dwell_error_m=rows.dwell_error_m,
        largest_dropped_rotation_rad=max(writer.dropped_rad, dropped if words is None else words.dropped_rad),
    )  # fmt: skip


def _refuse_unsaid(program: Program) -> None:
    """Refuse frames that the writer cannot go back through."""
    for block in program.blocks:
        if block.modal.not_written and block.motion_count:
            raise ProgramError(
                f"{block.modal.not_written} is not written back with other targets",
                where=block.where(program.name), value=block.text.strip()[:60],
                hint="Post the moves without it, or write another language (--as, convert)",
            )  # fmt: skip


class _Writer:
    """Walks through the statements of a program."""

    def __init__(
        self,
        program: Program,
        compensated: CompensatedPath,
        tolerance_m: float,
        decimals: int,
        words: CommandedWords | None,
    ) -> None:
        angles = None
        if words is not None:
            compensated = CompensatedPath(words.path, words.p_command, np.zeros_like(words.p_command))
            angles = (words.angle_rad, words.angle_command_rad)
        self.program, self.tolerance_m, self._angles = program, tolerance_m, angles
        self.rows = motion_rows(program, compensated, tolerance_m, angles)
        units = {block.modal.unit_m for block in program.blocks if block.motion_count}
        self._unit_m = min(units, default=1e-3)
        self._digits = decimals + (self._unit_m == INCH)
        self.resolution_m = self._unit_m * 10.0**-self._digits
        self.lines: list[str] = []
        self.written: Float = np.full((len(self.rows.way), 3), np.nan)
        self.checked: Bool = np.zeros(len(self.rows.way), dtype=np.bool_)
        self.arc_error_m = self.dropped_rad = 0.0
        self.split_motions = self.vertices_added = self.completed_blocks = self.cycles_expanded = 0
        self.arcs_kept = self.arcs_split = self.arcs_as_lines = 0
        self._here: Float = np.array(program.motions[0].p_start if program.motions else np.zeros(3))
        self._nominal: Float = self._here.copy()
        self._feed: float | None = None
        self._pole: tuple[float, float] | None = None
        self._pole_block: Block | None = None
        self._pole_written = True
        self._forced = self._chained()

    def _chained(self) -> set[int]:
        """Motions that must be written because they share a corner (RND) with a corrected one."""
        out: set[int] = set()
        for number, block in enumerate(self.program.blocks):
            if block.motion_count == 1 and function_of(block) == "RND":
                index = block.first_motion
                pair = {index - 1, index}
                if any(bool(self.rows.moved[k]) for k in pair) or not self.program.blocks[number].single:
                    out |= pair
        return out

    # ---- walk --------------------------------------------------------------------------------------------------

    def run(self) -> list[str]:
        """All lines of the written program."""
        straight, source, at = self.program.straight, self.program.lines, 0
        if len(self.written):
            self.written[0] = self.rows.nominal[0]
        if not straight:
            self.lines.append(next(line for line in source if "BEGIN PGM" in line.upper()))
        for block in self.program.blocks:
            if straight:
                at = block.line - 1 + len(block.text.split("\n"))
            elif self._is_flow(block):
                continue
            self._block(block)
        if straight:
            self._flush()
            self.lines.extend(source[at:])
        else:
            end = next((line for line in reversed(source) if "END PGM" in line.upper()), "END PGM")
            self.lines += ["M30", re.sub(r"^\s*\d+\s+", "", end), ""]
        return self.lines

    def _is_flow(self, block: Block) -> bool:
        """Whether a block of a program that is written out says nothing but flow."""
        code = PathLine(block).text if "\n" in block.text else re.sub(r"^\s*/?\s*\d+\s+", "", block.text)
        code = code.split(";")[0]
        if _FLOW.match(code):
            return True
        if not block.motion_count and function_of(block) != "CC" and _PARAMETER.search(code):
            raise ProgramError(
                "a frame, tool or cycle with parameters in a program with labels is not written back",
                where=block.where(self.program.name), value=block.text.split("\n")[0].strip()[:60],
                hint="Write the values themselves, or write another language (--as, convert)",
            )  # fmt: skip
        return False

    def _block(self, block: Block) -> None:
        if block.motion_count == 0:
            self._still(block)
            return
        index = block.first_motion
        motion = self.program.motions[index]
        self._stand(motion.p_start, index)
        if block.cycle or block.motion_count > 1:
            self._cycle(block)
        elif motion.kind == "dwell":
            self._flush()
            self._relieve(block, index)
            self._copy(block)
            self._arrive(index, motion)
        elif motion.kind == "arc":
            self._arc(block, index, motion)
        else:
            self._straight(block, index, motion)

    def _stand(self, p: Float, index: int) -> None:
        """Take the offset along where the program jumps to the start of a motion."""
        self._here = self._here + (np.asarray(p) - self._nominal)
        self._nominal = np.array(p)
        start = int(self.rows.first[index]) - 1
        if self.rows.last[index] >= 0 and math.isnan(self.written[start, 0]):
            self.written[start] = self._here

    def _arrive(self, index: int, motion: Motion) -> None:
        self._nominal = np.array(motion.p_end)
        last = int(self.rows.last[index])
        if last >= 0:
            self.written[last], self.checked[last] = self._here, True

    def _follows(self) -> bool:
        """The written position differs from that of the source by more than rounding."""
        return bool(np.any(np.abs(self._here - self._nominal) > 0.5 * self.resolution_m))

    def _copy(self, block: Block) -> None:
        self.lines.extend(block.text.split("\n"))

    def _flush(self) -> None:
        """Write the CC that waits for its arc."""
        if self._pole_block is not None:
            self._copy(self._pole_block)
            self._pole_block, self._pole_written = None, True

    def _still(self, block: Block) -> None:
        self._flush()
        feed = next((word for word in block.words if word.letter == "F"), None)
        match = re.search(r"TOOL\s+CALL.*?\bF\s*([\d.]+)", block.text, re.IGNORECASE)
        if feed is not None or match is not None:
            self._feed = feed.value if feed is not None else float(match[1]) if match is not None else None
        if function_of(block) != "CC":
            self._copy(block)
            return
        here = self._work(block.modal, self._nominal)
        given = {word.letter: word for word in block.words if word.letter in "XY"}
        before = self._pole
        pole = [float(here[0]), float(here[1])]
        for axis, letter in enumerate("XY"):
            word = given.get(letter)
            if word is not None:
                pole[axis] = word.value * block.modal.unit_m + (0.0 if word.absolute else pole[axis])
            elif given and before is not None:
                pole[axis] = before[axis]
        self._pole = (pole[0], pole[1])
        own = len(given) == 2 and all(word.absolute and word.literal for word in given.values())
        if own:
            self._pole_block = block
        elif self._follows() or not self._pole_written or not self.program.straight:
            self.lines.append(self._centre(block, self._pole))
            self._pole_written = True
        else:
            self._copy(block)

    # ---- words -------------------------------------------------------------------------------------------------

    @staticmethod
    def _work(modal: Modal, p: Float) -> Float:
        """A point in programmed axes, m."""
        away = np.asarray(p) - np.array(modal.p_part_origin)
        out: Float = away if modal.R_part_work is None else away @ np.array(modal.R_part_work)
        return out

    @staticmethod
    def _part(modal: Modal, p: Float) -> Float:
        turned = p if modal.R_part_work is None else np.array(modal.R_part_work) @ p
        out: Float = np.array(modal.p_part_origin) + turned
        return out

    def _rounded(self, modal: Modal, value_m: float) -> float:
        return round(value_m / modal.unit_m, self._digits)

    def _centre(self, block: Block, pole: tuple[float, float]) -> str:
        """A CC with both coordinates; the line of a CC keeps its number and comment."""
        values = [self._rounded(block.modal, value) for value in pole]
        coordinates = f"X{signed(values[0], self._digits)} Y{signed(values[1], self._digits)}"
        if function_of(block) != "CC":
            return f"CC {coordinates}"
        line = PathLine(block)
        line.become("CC", coordinates)
        return line.render()

    def _go(self, line: PathLine | None, modal: Modal, p: Float, *, every: bool = False) -> str:
        """Let a line lead to a point, or return the coordinates of a new one; the written position is there then."""
        goal, at = self._work(modal, p), self._work(modal, self._here)
        half = 0.5000001 * modal.unit_m * 10.0**-self._digits
        out = []
        for axis, letter in enumerate("XYZ"):
            word = None if line is None else line.find(letter)
            if (
                word is not None
                and word.absolute
                and word.literal
                and abs(word.value * modal.unit_m - goal[axis]) <= half
            ):
                at[axis] = word.value * modal.unit_m
                continue
            if word is None and not every and abs(goal[axis] - at[axis]) <= half:
                continue
            value = self._rounded(modal, float(goal[axis]))
            text = spelled(letter, value, self._digits)
            at[axis] = value * modal.unit_m
            if line is not None:
                line.set(letter, text)
            out.append(text)
        self._here = self._part(modal, at)
        return " ".join(out)

    def _turn(self, line: PathLine | None, block: Block, row: int) -> str:
        """Let a line have the rotary words or tool vector of a row; of a new line these words."""
        if self._angles is None:
            return ""
        nominal, command = self._angles[0][row], self._angles[1][row]
        mode = block.modal.tool_centre
        if mode == TOOL_CENTRE:
            texts = [(c, spelled(c, round(float(v) / DEG, 4), 4)) for c, v in zip("ABC", command, strict=True)]
            for letter, text in texts if line is not None else ():
                if line is not None and line.find(letter) is not None:
                    line.set(letter, text)
            return " ".join(text for letter, text in texts if any(w.letter == letter for w in block.words))
        if mode == TOOL_VECTOR and function_of(block) == "LN":
            size = float(np.linalg.norm(command)) or 1.0
            vector = command / size if block.modal.R_part_work is None else command / size @ np.array(
                block.modal.R_part_work)  # fmt: skip
            vectors = [f"T{c}{signed(float(v), VECTOR_DECIMALS)}" for c, v in zip("XYZ", vector, strict=True)]
            if line is not None:
                line.set_vector(vectors)
            return " ".join(vectors)
        self.dropped_rad = max(self.dropped_rad, float(np.linalg.norm(command - nominal)))
        return ""

    def _f(self, block: Block, motion: Motion, factor: float, line: PathLine | None, *, local: bool = False) -> str:
        """F of a piece where it differs from the one in force; it is put into the line."""
        if block.modal.feed_mode != 94 or motion.feed_m_s <= 0.0 or motion.kind == "rapid":
            return ""
        nominal = motion.feed_m_s * MINUTE / block.modal.unit_of_feed_m
        requested = nominal * factor
        own = line is not None and line.has_feed
        current = nominal if own else self._feed
        if current is not None and abs(requested / current - 1.0) <= (LEAST_FEED_CHANGE if factor != 1.0 else 1e-6):
            self._feed = self._feed if local else current
            return ""
        if current is None and factor == 1.0:
            self._feed = nominal
            return ""
        text = feed_text(requested)
        if not local:
            self._feed = float(text[1:])
        if line is not None:
            line.set_feed(text)
        return f" {text}"

    # ---- straight ----------------------------------------------------------------------------------------------

    def _straight(self, block: Block, index: int, motion: Motion) -> None:
        rows = self.rows
        first, last = int(rows.first[index]), int(rows.last[index])
        corrected = bool(rows.moved[index]) or index in self._forced or not self.program.straight
        follows, function = self._follows(), function_of(block)
        self._flush()
        line = PathLine(block)
        relative = function == "LP" or any(w.absolute is False for w in line.words if w.letter in "XYZ")
        if not corrected and not (follows and (relative or self._leaves_out(block))):
            self._restore_pole(function)
            self._f(block, motion, 1.0, line)
            self._here = np.array(motion.p_end)
            self.lines.append(line.render())
            self._arrive(index, motion)
            return
        if not corrected:
            self.completed_blocks += 1
        inner = [int(row) for row in np.flatnonzero(rows.vertex[first:last]) + first] if (
            motion.kind == "feed" and last > first) else []  # fmt: skip
        tail = line.take_last() if inner else ""
        if relative:
            line = self._absolute(block, function)
            tail = line.take_last() if inner else ""
        before = first - 1
        steps = [*inner, last] if last >= 0 else [last]
        for number, row in enumerate(steps):
            p = rows.command[row] if row >= 0 else np.asarray(motion.p_end)
            factor = 1.0
            if motion.kind == "feed" and row >= 0:
                step = float(np.linalg.norm(rows.command[row] - rows.command[before])) if before >= 0 else 0.0
                way = float(rows.way[row] - rows.way[before]) if before >= 0 else 0.0
                factor = float(feed_factor(np.array([way]), np.array([step]))[0]) * rows.share_of(before + 1, row)
            self._piece(block, motion, line if number == 0 else None, p, row, factor, tail if row == last else "")
            before = row
            if row >= 0:
                self.written[row] = self._here
        self._arrive(index, motion)
        if motion.kind == "feed" and last >= first:
            self.checked[first : last + 1] = True
        self.split_motions += bool(inner)
        self.vertices_added += len(inner)

    def _piece(
        self, block: Block, motion: Motion, line: PathLine | None, p: Float, row: int, factor: float, tail: str
    ) -> None:
        """Write the line of one straight piece."""
        coordinates = self._go(line, block.modal, p)
        turned = self._turn(line, block, row) if row >= 0 else ""
        feed = self._f(block, motion, factor, line)
        if line is not None:
            self.lines.append(line.render() + tail)
            return
        head = "LN" if turned and block.modal.tool_centre == TOOL_VECTOR else "L"
        text = " ".join(part for part in (head, coordinates, turned) if part)
        self.lines.append(text + feed + tail)

    def _leaves_out(self, block: Block) -> bool:
        """An L that leaves out an axis inherits what was corrected before."""
        named = {word.letter for word in block.words if word.letter in "XYZ" and word.absolute}
        off = self._work(block.modal, self._here) - self._work(block.modal, self._nominal)
        return any(
            abs(off[axis]) > 0.5 * self.resolution_m and letter not in named for axis, letter in enumerate("XYZ")
        )

    @staticmethod
    def _absolute(block: Block, function: str) -> PathLine:
        """The line of an incremental or polar motion without its coordinates; absolute ones are put in later."""
        line = PathLine(block)
        line.become("L" if function == "LP" else function, "")
        text = re.sub(r"(?<=[LN]) (?= |$)", "", line.render())
        return PathLine(replace(block, text=text, words=()))

    def _restore_pole(self, function: str) -> None:
        """Write the pole of the source where a statement that stays counts from it."""
        if function in _POLAR and not self._pole_written and self._pole is not None:
            x, y = (value / self._unit_m for value in self._pole)
            self.lines.append(f"CC X{signed(x, self._digits)} Y{signed(y, self._digits)}")
            self._pole_written = True

    def _relieve(self, block: Block, index: int) -> None:
        """Before a dwell, go to where it is planned, along the tool axis."""
        first, last = int(self.rows.first[index]), int(self.rows.last[index])
        planned = self.rows.command[last] if last >= first >= 1 else None
        if planned is not None and float(np.linalg.norm(planned - self.rows.command[first - 1])) > 0.0:
            coordinates = self._go(None, block.modal, planned)
            if coordinates:
                self.lines.append(f"L {coordinates}")
                self.vertices_added += 1

    # ---- arcs --------------------------------------------------------------------------------------------------

    def _arc(self, block: Block, index: int, motion: Motion) -> None:
        rows, modal, function = self.rows, block.modal, function_of(block)
        first, last = int(rows.first[index]), int(rows.last[index])
        corrected = bool(rows.moved[index]) or index in self._forced or not self.program.straight
        line = PathLine(block)
        if not corrected and not self._follows():
            self._flush()
            self._restore_pole(function)
            self._f(block, motion, rows.share_of(first, last), line, local=function == "RND")
            self._here = np.array(motion.p_end)
            self.lines.append(line.render())
            self._arrive(index, motion)
            return
        self.completed_blocks += not corrected
        assert motion.p_centre is not None
        nominal = self._work(modal, np.vstack([motion.p_start, rows.nominal[first : last + 1]]))
        command = np.ascontiguousarray(self._work(modal, np.vstack([self._here, rows.command[first : last + 1]])))
        share = nominal_share(nominal, self._work(modal, motion.p_centre), motion.turn_rad)
        waiting = arc_pieces(command, share, motion.turn_rad, self.tolerance_m)[::-1]
        pending, self._pole_block = self._pole_block, None
        single = len(waiting) == 1 and waiting[0].centre is not None
        if pending is not None and not (single and function == "C"):
            self._copy(pending)
            pending, self._pole_written = None, True
        arcs = lines = 0
        tail = ""
        while waiting:
            piece = waiting.pop()
            row = first - 1 + piece.last
            fitted = None if piece.centre is None else self._fitted(modal, piece, command, share)
            if piece.centre is not None and fitted is None:
                waiting += straight_pieces(command, share, piece.first, piece.last, self.tolerance_m)[::-1]
                if pending is not None:
                    self._copy(pending)
                    pending, self._pole_written = None, True
                continue
            head = line if arcs + lines == 0 else None
            if head is not None and waiting:
                tail = PathLine(block).take_last()
            ends = "" if waiting else tail
            factor = rows.share_of(first, last)
            if fitted is not None:
                self._write_arc(block, motion, head, fitted, rows.command[row], (pending, factor, ends))
                pending = None
                arcs += 1
            else:
                self._write_chord(block, motion, head, rows.command[row], (factor, ends))
                self.checked[first + piece.first : row + 1] = True
                lines += 1
            self.written[row] = self._here
        self._arrive(index, motion)
        self.arcs_kept += arcs == 1 and lines == 0
        self.arcs_split += arcs + lines > 1 and arcs > 0
        self.arcs_as_lines += arcs == 0
        self.split_motions += arcs + lines > 1
        self.vertices_added += arcs + lines - 1

    def _write_chord(
        self, block: Block, motion: Motion, line: PathLine | None, p: Float, rest: tuple[float, str]
    ) -> None:
        factor, tail = rest
        coordinates = self._go(None, block.modal, p, every=line is not None)
        feed = self._f(block, motion, factor, line)
        if line is None:
            self.lines.append(f"L {coordinates}{feed}{tail}")
            return
        self._finish(line, "L", coordinates, feed, tail)

    def _finish(self, line: PathLine, function: str, coordinates: str, feed: str, tail: str) -> None:
        """Write the source's own line with another function and coordinates."""
        line.become(function, coordinates)
        if feed:
            line.set_feed(feed.strip())
        if tail:
            line.take_last()
        self.lines.append(line.render() + tail)

    def _fitted(
        self, modal: Modal, piece: ArcPiece, points: Float, share: Float
    ) -> tuple[float, float, float, float] | None:
        """Centre (u, v), angle and rise as they are written; None where rounding breaks the arc."""
        assert piece.centre is not None
        part = points[piece.first : piece.last + 1].copy()
        part[0] = self._work(modal, self._here)
        u, v = (self._rounded(modal, value) * modal.unit_m for value in piece.centre)
        rise = self._rounded(modal, float(part[-1][2] - part[0][2])) * modal.unit_m
        helix = rise != 0.0 or abs(piece.turn_rad) > _LARGEST_TURN
        if helix:
            turn = round(piece.turn_rad / DEG, 4) * DEG
            spoke = part[0][:2] - (u, v)
            c, s = math.cos(turn), math.sin(turn)
            part[-1] = [u + c * spoke[0] - s * spoke[1], v + s * spoke[0] + c * spoke[1], part[0][2] + rise]
            if float(np.linalg.norm(part[-1] - points[piece.last])) > self.tolerance_m:
                return None
        else:
            part[-1] = [self._rounded(modal, float(value)) * modal.unit_m for value in part[-1]]
            part[-1][2] = part[0][2]
            turn = written_turn(part[0], part[-1], (u, v), math.copysign(1.0, piece.turn_rad), 1)
        at = share[piece.first : piece.last + 1]
        error = arc_error(part, (at - at[0]) / (at[-1] - at[0]), (u, v), turn)
        if error > self.tolerance_m + _ROUNDINGS * self.resolution_m:
            return None
        self.arc_error_m = max(self.arc_error_m, error)
        return u, v, turn, rise

    def _write_arc(
        self,
        block: Block,
        motion: Motion,
        line: PathLine | None,
        fitted: tuple[float, float, float, float],
        p: Float,
        rest: tuple[Block | None, float, str],
    ) -> None:
        """Write an arc about a centre: the CC of the source edited, or one of its own; CR keeps its radius form."""
        (u, v, turn, rise), (pending, factor, tail), modal = fitted, rest, block.modal
        sense = "DR+" if turn > 0.0 else "DR-"
        start = self._work(modal, self._here)
        helix = rise != 0.0 or abs(turn) > _LARGEST_TURN
        if helix:
            words = f"IPA{signed(turn / DEG, 4)} IZ{signed(rise / modal.unit_m, self._digits)} {sense}"
            c, s = math.cos(turn), math.sin(turn)
            spoke = start[:2] - (u, v)
            end = np.array([u + c * spoke[0] - s * spoke[1], v + s * spoke[0] + c * spoke[1], start[2] + rise])
            function = "CP"
        else:
            values = [self._rounded(modal, float(value)) for value in self._work(modal, p)[:2]]
            end = np.array([values[0] * modal.unit_m, values[1] * modal.unit_m, start[2]])
            words, function = f"X{signed(values[0], self._digits)} Y{signed(values[1], self._digits)} {sense}", "C"
        radius = self._radius(modal, start, end, (u, v), turn) if function_of(block) == "CR" and not helix else None
        feed = self._f(block, motion, factor, line, local=function_of(block) == "RND" and line is not None
                       and line.has_feed)  # fmt: skip
        if radius is not None:
            function, words = "CR", words[: -len(sense)] + f"R{signed(radius, self._digits)} {sense}"
        else:
            if pending is not None and function == "C":
                self.lines.append(self._centre(pending, (u, v)))
            else:
                self.lines.append(self._centre(block, (u, v)))
            self._pole_written = False
        self._here = self._part(modal, end)
        if line is None:
            self.lines.append(f"{function} {words}{feed}{tail}")
        else:
            self._finish(line, function, words, feed, tail)

    def _radius(self, modal: Modal, start: Float, end: Float, centre: tuple[float, float], turn: float) -> float | None:
        """R, in program units, that gives an arc of this centre within a tenth of the tolerance; None: none does."""
        size = self._rounded(modal, float(np.hypot(start[0] - centre[0], start[1] - centre[1])))
        radius = -size if abs(turn) > math.pi else size
        made = radius_centre(start, end, radius * modal.unit_m, math.copysign(1.0, turn))
        if made is None or math.dist(made, centre) > 0.1 * self.tolerance_m:
            return None
        return radius

    # ---- cycles ------------------------------------------------------------------------------------------------

    def _cycle(self, block: Block) -> None:
        """A block with a drilling cycle: as it is where nothing of it is corrected, else as single moves."""
        self._flush()
        indices = range(block.first_motion, block.first_motion + block.motion_count)
        motions = [self.program.motions[k] for k in indices]
        if not any(bool(self.rows.moved[k]) for k in indices) and not self._follows() and self.program.straight:
            self._copy(block)
            for k, motion in zip(indices, motions, strict=True):
                self._here = np.array(motion.p_end)
                self._arrive(k, motion)
            return
        self.cycles_expanded += 1
        for k, motion in zip(indices, motions, strict=True):
            last = int(self.rows.last[k])
            p = self.rows.command[last] if last >= 0 else np.asarray(motion.p_end)
            self._stand(motion.p_start, k)
            if motion.kind == "dwell":
                self.lines += dwell_lines(motion.duration_s)
            elif k == indices.start and function_of(block) in ("L", "LN"):
                line = PathLine(block)
                line.take(99)
                self._go(line, block.modal, p)
                self._f(block, motion, 1.0, line)
                self.lines.append(line.render())
            else:
                coordinates = self._go(None, block.modal, p, every=True)
                feed = " FMAX" if motion.kind == "rapid" else self._f(block, motion, 1.0, None)
                self.lines.append(f"L {coordinates} R0{feed}")
            self._arrive(k, motion)
