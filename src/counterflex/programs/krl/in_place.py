"""The same KRL back with only the targets changed, in the ``.src`` file or, where they stand there, the ``.dat``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from counterflex import __version__
from counterflex.core.arrays import Bool, Float, as_positive
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, UM
from counterflex.programs.compensated import CompensatedPath, mark
from counterflex.programs.gcode.write.machine import LEAST_FEED_CHANGE
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.krl.commanded_values import CommandedValues, point_values
from counterflex.programs.krl.edits import Edits, Values, spelled, target_edits, target_text
from counterflex.programs.krl.program import LETTERS, KrlMotion, KrlProgram, Target
from counterflex.programs.krl.read import statements as form
from counterflex.programs.krl.read.literals import code_of
from counterflex.programs.limits import KRL
from counterflex.programs.motion_rows import MotionRows, feed_factor, motion_rows, written_error
from counterflex.programs.robot_text.chosen_points import fine_rows
from counterflex.programs.robot_text.circle_fit import FittedCircle, fitted_circle
from counterflex.programs.robot_text.in_place import plain


@dataclass(frozen=True)
class KrlText:
    """Written files and what became of the program.

    Attributes:
        files: Text by name: the ``.src`` file, and the ``.dat`` file where there is one.
        moved_motions: Motions with at least one corrected row.
        split_motions: Motions that were written as several.
        vertices_added: Points written in addition to those of the source.
        arcs_kept: Corrected circles still written as one.
        arcs_as_lines: Corrected circles written as straight moves.
        speeds_added: Lines that set the speed, in addition to those of the source.
        speeds_changed: Splines with a speed of their own that is another than programmed.
        targets_in_data: Targets changed in the ``.dat`` file.
        targets_written_out: Targets whose name other places use too, written as literals instead.
        tolerance_m: Allowed distance of the written path from the commanded rows, at the same place of the way.
        resolution_m: Last decimal written.
        largest_written_error_m: Largest distance of the written path from the commanded rows of feed motions.
        largest_dwell_error_m: The same during waits, which keep the position of the motion before them.
        warnings: What the user should know, one sentence each.
    """

    files: dict[str, str]
    moved_motions: int
    split_motions: int
    vertices_added: int
    arcs_kept: int
    arcs_as_lines: int
    speeds_added: int
    speeds_changed: int
    targets_in_data: int
    targets_written_out: int
    tolerance_m: float
    resolution_m: float
    largest_written_error_m: float
    largest_dwell_error_m: float
    warnings: tuple[str, ...] = ()


def write_krl_in_place(
    program: KrlProgram,
    compensated: CompensatedPath,
    *,
    tolerance_m: float = 5e-6,
    cycle_s: float = 0.012,
    cell: str = "",
    job: str = "",
) -> KrlText:
    """Write a program back with its targets replaced by the commanded ones.

    Every byte that is no coordinate of a corrected target stays. Where one straight line is not enough, points are
    added before the target, with the approximation of the motion (``C_DIS`` where it has none), at least feed times
    ``cycle_s`` apart; where the speed changes, ``$VEL.CP`` is set before the motion. A corrected circle stays a circle
    where the commanded points lie on one within the tolerance, else it becomes straight moves. A target by name is
    changed in the ``.dat`` file; where the program uses the name elsewhere too it is written out in the motion. Rapids
    (PTP) are corrected at their ends only. Nothing at all changes when no row is corrected.

    Args:
        program: As read.
        compensated: Commanded rows for the path sampled from ``program``.
        tolerance_m: Largest distance between a commanded row and the written path at the same share of the motion,
            before rounding; > 0, m.
        cycle_s: Time the controller needs per point, s, > 0.
        cell: Name of the cell, for the header comment.
        job: Hash of the plan, for the header comment.

    Returns:
        Files and counts.

    Raises:
        InputError: Path and program do not belong together, or an option is out of range.
        ProgramError: A corrected motion cannot be divided: TRIGGER statements hold it together. A subprogram with
            corrected motions is called several times.
    """
    as_positive("tolerance_m", tolerance_m)
    as_positive("cycle_s", cycle_s)
    turned = compensated.rotvec_part_command
    rows = motion_rows(program, compensated, tolerance_m, (np.zeros_like(turned), turned))
    writer = _InPlace(program, compensated, rows, tolerance_m, cycle_s)
    if rows.moved.any() or np.any(rows.share != 1.0):
        _refuse_repeated(program, rows)
        writer.run()
        writer.head(cell, job)
    return writer.text()


class _InPlace(CommandedValues):
    """Walks through the motions and collects edits."""

    def __init__(
        self, program: KrlProgram, compensated: CompensatedPath, rows: MotionRows, tolerance_m: float, cycle_s: float
    ) -> None:
        super().__init__(program, *fine_rows(rows, compensated, tolerance_m, cycle_s))
        self.tolerance_m, rows = tolerance_m, self.rows
        self.vertex = rows.vertex
        self.source, self.data = Edits(program.lines), Edits(program.data or ())
        n = len(rows.way)
        self.written: Float = np.full((n, 3), np.nan)
        self.checked: Bool = np.zeros(n, dtype=np.bool_)
        self.arc_error_m = 0.0
        self.split_motions = self.vertices_added = self.arcs_kept = self.arcs_as_lines = 0
        self.speeds_changed = self.speeds_added = self.in_data = self.written_out = self.too_close = 0
        self._speed: float | None = None

    # ---- result ----------------------------------------------------------------------------------------------

    def text(self) -> KrlText:
        """Files and figures."""
        program, resolution = self.program, 10.0**-KRL.position_decimals * MM
        files = {program.name: program.newline.join(self.source.lines())}
        if program.data is not None:
            files[program.data_name] = program.data_newline.join(self.data.lines())
        error = max(written_error(self.rows, self.written, self.checked), self.arc_error_m)
        warnings = []
        if error > self.tolerance_m + resolution:
            warnings.append(
                f"the written path is up to {error / UM:.1f} um from the planned one (tolerance "
                f"{self.tolerance_m / UM:g} um): the points would have to be closer together than feed times "
                "controller cycle. A lower feed or the real controller.cycle_ms helps"
            )
        return KrlText(
            files=files,
            moved_motions=int(self.rows.moved.sum()),
            split_motions=self.split_motions,
            vertices_added=self.vertices_added,
            arcs_kept=self.arcs_kept,
            arcs_as_lines=self.arcs_as_lines,
            speeds_added=self.speeds_added,
            speeds_changed=self.speeds_changed,
            targets_in_data=self.in_data,
            targets_written_out=self.written_out,
            tolerance_m=self.tolerance_m,
            resolution_m=resolution,
            largest_written_error_m=error,
            largest_dwell_error_m=self.rows.dwell_error_m,
            warnings=tuple(warnings),
        )

    def head(self, cell: str, job: str) -> None:
        """Comments behind DEF: what made the program, in which cell, for which job."""
        at = next(i for i, line in enumerate(self.program.lines, start=1) if form.ROUTINE.fullmatch(code_of(line)))
        messages = [f"made by counterflex {__version__} from {plain(self.program.name)}"]
        messages += [f"compensated targets, path tolerance {self.tolerance_m / MM:.4f} mm"]
        messages += [f"cell {plain(cell)}"] if cell else []
        messages += [mark(job)] if job else []
        self.source.insert(at + 1, [f"; {line}" for line in messages])

    # ---- motions ---------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Write every motion."""
        program = self.program
        if len(self.written):
            self.written[0] = self.rows.nominal[0]
        for index, (motion, move) in enumerate(zip(program.motions, program.moves, strict=True)):
            if move.speed_set:
                self._speed = None
            if motion.kind == "dwell":
                self._relieve(index, move)
            elif motion.kind == "arc":
                self._arc(index, move)
            else:
                self._straight(index, move)
            last = int(self.rows.last[index])
            if last >= 0:
                self.written[last] = self.here()
                self.checked[last] |= motion.kind != "arc"
        self._restore_speed()

    def _straight(self, index: int, move: KrlMotion) -> None:
        motion, rows = self.program.motions[index], self.rows
        first, last = int(rows.first[index]), int(rows.last[index])
        steps: list[int] = []
        if motion.kind == "feed" and rows.moved[index] and last > first:
            steps = (np.flatnonzero(self.vertex[first:last]) + first).tolist()
        self._added(index, move, steps)
        self._end(index, move)
        if motion.kind == "feed" and last >= 0:
            self.checked[first : last + 1] = True

    def _added(self, index: int, move: KrlMotion, steps: Sequence[int]) -> None:
        """Points before the end of a motion, each with its speed, and the speed of the last piece."""
        motion, rows = self.program.motions[index], self.rows
        if motion.kind == "rapid":
            return
        first, last = int(rows.first[index]), int(rows.last[index])
        place = self.program.loose_triggers.get(move.line, move.line)
        if steps and place < 0:
            raise ProgramError(
                "a corrected motion cannot be divided: TRIGGER statements before it count from its start and its end",
                where=f"{self.program.name}:{move.line}",
                value=self.program.lines[move.line - 1].strip()[:60],
                hint="Put the TRIGGER that counts from the start before those that count from the end",
            )
        spline = move.word.startswith("S")
        word, approximation = "SLIN" if spline else "LIN", move.approximation or ("C_SPL" if spline else "C_DIS")
        approximation = "" if move.in_spline else f" {approximation}"
        before = first - 1
        lead = self._indent(move.line)
        for row in steps:
            lines, own = self._speed_lines(index, before, row), self._own_speed(index, before, row)
            values = self.values_at(index, row)
            pose = ",".join(f"{letter} {spelled(letter, values[letter])}" for letter in LETTERS)
            self.source.insert(
                place, [lead + line for line in (*lines, f"{word} {{{pose}{self.program.extra}}}{approximation}{own}")]
            )
            self.stand(values)
            self.written[row] = self.here()
            before = row
        self.vertices_added += len(steps)
        self.split_motions += bool(steps)
        self.source.insert(move.line, [lead + line for line in self._speed_lines(index, before, last)])
        self._edit_own_speed(index, before, last)

    def _end(self, index: int, move: KrlMotion) -> None:
        """The motion's own target."""
        target = move.target
        if target is None:
            return
        last = int(self.rows.last[index])
        values = self.values_at(index, last) if last >= 0 else self.nominal(index)
        self._write(target, move, values, turned=last >= 0 and bool(np.any(self.rotvec[last] != 0.0)))
        self.stand(values)

    def _write(self, target: Target, move: KrlMotion, values: Values, *, turned: bool) -> None:
        edits = target_edits(target, values, self.values, turned=turned)
        if not edits:
            return
        if target.in_data and not move.shared:
            self.data.change(target.line, edits)
            self.in_data += 1
        elif target.in_data:
            self.source.change(move.line, [(target.start, target.end, target_text(target, edits))])
            self.written_out += 1
        else:
            self.source.change(target.line, edits)

    def _relieve(self, index: int, move: KrlMotion) -> None:
        """Before a wait, go to where it is planned; that lies along the tool axis, see :class:`MotionRows`."""
        first, last = int(self.rows.first[index]), int(self.rows.last[index])
        if last < 1 or not np.any(self.rows.command[last] != self.rows.command[first - 1]):
            return
        values = self.values_at(index, last)
        pose = ",".join(f"{letter} {spelled(letter, values[letter])}" for letter in LETTERS)
        self.source.insert(move.line, [f"{self._indent(move.line)}LIN {{{pose}{self.program.extra}}}"])
        self.vertices_added += 1
        self.stand(values)

    def _arc(self, index: int, move: KrlMotion) -> None:
        motion, rows = self.program.motions[index], self.rows
        first, last = int(rows.first[index]), int(rows.last[index])
        start = self.here()
        off = float(np.linalg.norm(start - motion.p_start)) > 0.5 * 10.0**-KRL.position_decimals * MM
        if not rows.moved[index] and not off:
            self._added(index, move, [])
            self.stand(self.nominal(index))
            return
        points = np.vstack([start, rows.command[first : last + 1]])
        fit = fitted_circle(motion, points, rows.nominal[first : last + 1], fixed_turn=move.circle_angle)
        if fit is not None and fit.error_m <= self.tolerance_m and not self._speed_changes(first, last):
            self._circle(index, move, fit)
            return
        steps = (np.flatnonzero(self.vertex[first:last]) + first).tolist()
        self._added(index, move, steps)
        values = self.values_at(index, last)
        pose = ",".join(f"{letter} {spelled(letter, values[letter])}" for letter in LETTERS)
        word = "SLIN" if move.word.startswith("S") else "LIN"
        self.source.change(move.line, [(move.start, move.end, f"{word} {{{pose}{self.program.extra}}}")])
        self.stand(values)
        self.checked[first : last + 1] = True
        self.arcs_as_lines += 1

    def _circle(self, index: int, move: KrlMotion, fit: FittedCircle) -> None:
        """A circle that stays one: auxiliary point and end of the fitted circle."""
        if move.auxiliary is None or move.target is None:
            raise ValueError("a circle without its points")
        self._added(index, move, [])
        last = int(self.rows.last[index])
        values = self.values_at(index, last)
        turned = bool(np.any(self.rotvec[last] != 0.0))
        nominal = self.point_of(move.auxiliary)
        auxiliary = self.named_values(move.auxiliary) | point_values(fit.at(nominal))
        self._write(move.auxiliary, move, auxiliary, turned=False)
        end = values | point_values(fit.at(self.point_of(move.target)) if move.circle_angle else fit.end())
        self._write(move.target, move, end, turned=turned)
        self.stand(values | point_values(fit.end()))
        self.arc_error_m = max(self.arc_error_m, fit.error_m)
        self.arcs_kept += 1

    # ---- speed -----------------------------------------------------------------------------------------------

    def _speed_changes(self, first: int, last: int) -> bool:
        return bool(np.ptp(self.rows.share[first : last + 1]) > LEAST_FEED_CHANGE)

    def _speed_lines(self, index: int, before: int, row: int) -> list[str]:
        """``$VEL.CP`` for the piece that ends at a row, where the active one is another.

        The loaded tool covers the nominal piece while the controller runs along the commanded one, so the programmed
        speed is multiplied by commanded over nominal length, and by the share that the plan leaves of it.
        """
        motion, move = self.program.motions[index], self.program.moves[index]
        if motion.feed_m_s <= 0.0 or row < 0 or move.in_spline or move.own_speed is not None:
            return []
        factor = self._factor(index, before, row)
        active = motion.feed_m_s if self._speed is None else self._speed
        requested = motion.feed_m_s * factor
        if abs(requested / active - 1.0) <= LEAST_FEED_CHANGE:
            return []
        self._speed = float(number(requested, 6))
        self.speeds_added += 1
        return [f"$VEL.CP={number(requested, 6)}"]

    def _factor(self, index: int, before: int, row: int) -> float:
        rows = self.rows
        if not rows.moved[index]:
            return 1.0
        travel = np.linalg.norm(np.diff(rows.command[before : row + 1], axis=0), axis=1).sum()
        nominal = rows.way[row] - rows.way[before]
        return float(feed_factor(np.array([nominal]), np.array([travel]))[0]) * rows.share_of(before + 1, row)

    def _own_speed(self, index: int, before: int, row: int) -> str:
        """``WITH $VEL.CP=`` of a piece of a motion that has its own speed, or stands in a spline block."""
        motion, move = self.program.motions[index], self.program.moves[index]
        if motion.feed_m_s <= 0.0 or row < 0 or not (move.in_spline or move.own_speed is not None):
            return ""
        factor = self._factor(index, before, row)
        if abs(factor - 1.0) <= LEAST_FEED_CHANGE and move.own_speed is None:
            return ""
        return f" WITH $VEL.CP={number(motion.feed_m_s * factor, 6)}"

    def _edit_own_speed(self, index: int, before: int, row: int) -> None:
        """The same of the motion itself, where it is another than programmed."""
        move, text = self.program.moves[index], self._own_speed(index, before, row)
        if not text or abs(self._factor(index, before, row) - 1.0) <= LEAST_FEED_CHANGE:
            return
        self.speeds_changed += 1
        if move.own_speed is not None:
            self.source.change(move.line, [(*move.own_speed, text.rpartition("=")[2])])
        else:
            end = len(code_of(self.program.lines[move.line - 1]).rstrip())
            self.source.change(move.line, [(end, end, text)])

    def _restore_speed(self) -> None:
        """The programmed speed behind the last motion: what comes after it inherits it."""
        fed = [
            motion.feed_m_s
            for motion, move in zip(self.program.motions, self.program.moves, strict=True)
            if motion.feed_m_s > 0.0 and not move.in_spline and move.own_speed is None
        ]
        if self._speed is not None and fed and abs(self._speed / fed[-1] - 1.0) > 1e-9:
            line = self.program.moves[-1].line
            self.source.insert(line + 1, [f"{self._indent(line)}$VEL.CP={number(fed[-1], 6)}"])
            self.speeds_added += 1

    def _indent(self, line: int) -> str:
        text = self.program.lines[line - 1]
        return text[: len(text) - len(text.lstrip())]


def _refuse_repeated(program: KrlProgram, rows: MotionRows) -> None:
    """Refuse a subprogram that is called several times, whose calls need targets of their own."""
    first: dict[int, int] = {}
    for index, move in enumerate(program.moves):
        earlier = first.setdefault(move.line, index)
        if earlier != index and (rows.moved[index] or rows.moved[earlier]):
            raise ProgramError(
                "a subprogram is called several times, and each call needs targets of its own",
                where=f"{program.name}:{move.line}",
                value=program.lines[move.line - 1].strip()[:60],
                hint="Write it once for each call, under a name of its own",
            )
