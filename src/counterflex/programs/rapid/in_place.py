"""The same RAPID module back with only its targets changed, in the instructions or where they are declared."""

from __future__ import annotations

import re

import numpy as np

from counterflex import __version__
from counterflex.core.arrays import Float, as_positive
from counterflex.core.units import MM, MM_PER_S
from counterflex.geometry import rotation
from counterflex.programs.compensated import CompensatedPath, mark
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import RAPID
from counterflex.programs.rapid.copies import Copies
from counterflex.programs.rapid.program import RapidMotion, RapidProgram, RapidTarget
from counterflex.programs.robot_text.circle_fit import FittedCircle
from counterflex.programs.robot_text.in_place import InPlace, InPlaceText
from counterflex.programs.robot_text.spans import Spans

_DECIMAL_MM = 10.0**-RAPID.position_decimals
_DECIMAL_Q = 10.0**-RAPID.angle_decimals
_ADDED_ZONE = "z0"


def write_rapid_in_place(
    program: RapidProgram,
    compensated: CompensatedPath,
    *,
    tolerance_m: float = 5e-6,
    cycle_s: float = 0.024,
    cell: str = "",
    job: str = "",
) -> InPlaceText:
    r"""Write a module back with its targets replaced by the commanded ones.

    Every byte that is no number of a corrected target or of a changed speed stays. A robtarget by name is changed where
    it is declared; where the program uses the name elsewhere too it is written out in the instruction. Numbers of Offs
    are changed themselves; a RelTool is written out. A changed speed is the option ``\V`` of the instruction. Added
    points have configuration and external axes of the target that they lead to. A routine that is called several times
    is written once for each call that needs other targets. Nothing at all changes when no row is corrected.

    Args:
        program: As read.
        compensated: Commanded rows for the path sampled from ``program``.
        tolerance_m: Largest distance between a commanded row and the written path at the same share of the motion,
            before rounding; > 0, m.
        cycle_s: Time the controller needs per point, s, > 0.
        cell: Name of the cell, for the comment at the head.
        job: Hash of the plan, for the same.

    Returns:
        File and counts.

    Raises:
        InputError: Path and program do not belong together, or an option is out of range.
    """
    as_positive("tolerance_m", tolerance_m)
    as_positive("cycle_s", cycle_s)
    writer = _InPlace(program, compensated, tolerance_m=tolerance_m, cycle_s=cycle_s, decimal_m=_DECIMAL_MM * MM)
    if not writer.changed:
        return writer.result({program.name: program.text})
    writer.run()
    return writer.result({program.name: writer.whole(writer.messages(__version__, cell, mark(job) if job else ""))})


class _InPlace(InPlace):
    """Edits of the text of a module, for each execution of a routine by itself."""

    def __init__(self, program: RapidProgram, compensated: CompensatedPath, **options: float) -> None:
        super().__init__(program, compensated, **options)
        self.program = program
        self.edits = [Spans() for _ in program.calls]
        self.declared = Spans()

    def whole(self, messages: list[str]) -> str:
        """The text with all edits and comments at its head."""
        program, copies = self.program, Copies(self.program)
        text = program.text
        end = next((match.start() for match in re.finditer(r"\r\n|\n|\r|$", text[program.declarations :])), 0)
        self.declared.insert(
            program.declarations + end, "".join(f"{program.newline}  ! {message}" for message in messages)
        )
        self.declared += copies.merged(self.edits)
        self.counts.routines_copied = copies.made
        return self.declared.applied(text)

    # ---- language --------------------------------------------------------------------------------------------

    def rounded(self, p: Float) -> Float:
        """(3,) m, four decimals of a millimetre."""
        out: Float = np.round(p / MM, RAPID.position_decimals) * MM
        return out

    def add(self, index: int, p: Float, R_part_tcp: Float, speed_m_s: float | None, *, exact: bool = False) -> None:
        """``MoveL`` on a line of its own before the instruction."""
        move, like = self.program.moves[index], self._like(index)
        if like.target is None:
            raise ValueError("a motion without a target")
        text = self.program.text
        target = self._literal(like.target, p, self._quaternion(like, R_part_tcp))
        zone = "fine" if exact else _ADDED_ZONE if like.exact else text[slice(*like.zone)]
        speed = self._speed_text(like, speed_m_s)
        self.counts.speeds_changed += speed_m_s is not None
        line = f"MoveL {target},{speed},{zone},{text[slice(*like.rest)]};"
        lead = re.search(r"[^\S\r\n]*\Z", text[: move.start])
        self.edits[move.call].insert(move.start, line + self.program.newline + (" " * 4 if lead is None else lead[0]))

    def end(self, index: int, p: Float, R_part_tcp: Float | None, speed_m_s: float | None) -> Float:
        """The target of the instruction, and the option V of its speed."""
        move = self.program.moves[index]
        if move.target is None:
            return p
        if speed_m_s is not None:
            self.counts.speeds_changed += 1
            text = f"{number(speed_m_s / MM_PER_S, 4)}"
            if move.speed_value is None:
                self.edits[move.call].insert(move.speed[1], f"\\V:={text}")
            else:
                self.edits[move.call].replace(*move.speed_value, text)
        return self._write(move, move.target, p, None if R_part_tcp is None else self._quaternion(move, R_part_tcp))

    def circle(self, index: int, fit: FittedCircle) -> None:
        """Another point on the circle."""
        move = self.program.moves[index]
        if move.auxiliary is not None:
            self._write(move, move.auxiliary, fit.at(np.array(move.auxiliary.position_mm) * MM), None)

    def straightened(self, index: int) -> None:
        """``MoveL`` with the end alone."""
        move = self.program.moves[index]
        if move.auxiliary is not None and move.target is not None:
            self.edits[move.call].replace(move.start, move.start + len(move.word), "MoveL")
            self.edits[move.call].replace(move.auxiliary.start, move.target.start, "")

    # ---- text ------------------------------------------------------------------------------------------------

    def _like(self, index: int) -> RapidMotion:
        """The instruction that an added one is like: that of the motion, of a wait the one before."""
        moves = self.program.moves
        return next(moves[i] for i in range(index, -1, -1) if moves[i].target is not None)

    def _speed_text(self, move: RapidMotion, speed_m_s: float | None) -> str:
        text = self.program.text[slice(*move.speed)]
        if speed_m_s is not None:
            return f"{text}\\V:={number(speed_m_s / MM_PER_S, 4)}"
        return text if move.speed_value is None else f"{text}\\V:={self.program.text[slice(*move.speed_value)]}"

    def _quaternion(self, move: RapidMotion, R_part_tcp: Float) -> tuple[float, ...]:
        """q1 to q4 of the instruction's tool, of the sign of its target, and the same text where they are the same."""
        q: Float = rotation.quat_wxyz(R_part_tcp @ move.R_tcp_tool)
        if move.target is None:
            return tuple(q.tolist())
        written = np.array(move.target.quat_wxyz)
        q = q if float(q @ written) >= 0.0 else -q
        same = float(np.abs(q - written / np.linalg.norm(written)).max()) < 0.5 * _DECIMAL_Q
        return move.target.quat_wxyz if same else tuple(q.tolist())

    def _write(self, move: RapidMotion, target: RapidTarget, p: Float, q: tuple[float, ...] | None) -> Float:
        """Give a target other numbers; returns its position as it is written, (3,) m."""
        edits = self.edits[move.call]
        shift = p / MM - np.array(target.position_mm)
        stays = bool(np.all(np.abs(shift) <= 0.5 * _DECIMAL_MM)) and (q is None or q == target.quat_wxyz)
        unchanged: Float = np.array(target.position_mm) * MM
        if stays:
            return unchanged
        if target.offsets and q is None:
            values = np.round(np.array(target.offsets_mm) + shift, RAPID.position_decimals)
            for place, value, old in zip(target.offsets, values, target.offsets_mm, strict=True):
                if abs(value - old) > 0.5 * _DECIMAL_MM:
                    edits.replace(*place, number(float(value), RAPID.position_decimals))
            written: Float = unchanged + (values - np.array(target.offsets_mm)) * MM
            return written
        plain = not target.offsets and not target.turned
        shared = target.shared or (bool(target.name) and self.program.calls[move.call].repeated)
        if plain and not shared:
            where = self.declared if target.name else edits
            for start, end, text in self._numbers(target, p, q):
                where.replace(start, end, text)
            self.counts.targets_declared += bool(target.name)
        else:
            edits.replace(target.start, target.end, self._literal(target, p, q or target.quat_wxyz))
            self.counts.targets_written_out += 1
        return self.rounded(p)

    def _numbers(self, target: RapidTarget, p: Float, q: tuple[float, ...] | None) -> list[tuple[int, int, str]]:
        """Edits of the numbers that change."""
        out = []
        text = self.program.text
        for (start, end), value in zip(target.numbers[:3], p / MM, strict=True):
            if abs(float(text[start:end]) - value) > 0.5 * _DECIMAL_MM:
                out.append((start, end, number(float(value), RAPID.position_decimals)))
        for (start, end), part in zip(target.numbers[3:], q or (), strict=q is not None):
            if abs(float(text[start:end]) - part) > 0.5 * _DECIMAL_Q:
                out.append((start, end, number(part, RAPID.angle_decimals)))
        return out

    def _literal(self, target: RapidTarget, p: Float, q: tuple[float, ...]) -> str:
        """A robtarget with its configuration and external axes, written out on one line."""
        spans = Spans()
        for edit in self._numbers(target, p, q):
            spans.replace(*edit)
        text = spans.applied(self.program.text, *target.literal)
        return re.sub(r"\s*(?:![^\r\n]*)?[\r\n]+\s*", "", text)
