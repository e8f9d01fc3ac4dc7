"""Arcs of Klartext with other targets: about a CC of their own, with their radius, or in pieces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MINUTE
from counterflex.integrations.heidenhain.language import VECTOR_DECIMALS
from counterflex.integrations.heidenhain.language.emitter import PathLine, feed_text, function_of, signed, spelled
from counterflex.integrations.heidenhain.language.state import PLANES
from counterflex.programs.gcode.write.arc_fit import arc_error, radius_centre, written_turn
from counterflex.programs.gcode.write.arc_pieces import ArcPiece, nominal_share, written_pieces
from counterflex.programs.machine_in_place import MachineInPlace
from counterflex.programs.motion_rows import LEAST_FEED_CHANGE
from counterflex.programs.program import TOOL_CENTRE, TOOL_VECTOR, Block, Modal, Motion

_POLAR: Final = frozenset(("C", "CP", "LP"))


class WrittenPosition(MachineInPlace):
    """Position, pole and feed of the written program."""

    def prepare(self) -> None:
        """Begin where the program begins."""
        self._here: Float = np.array(self.program.motions[0].p_start if self.program.motions else np.zeros(3))
        self._nominal: Float = self._here.copy()
        self._feed: float | None = None
        self._pole: tuple[float, float] | None = None
        self._pole_plane = 17
        self._pole_block: Block | None = None
        self._pole_written = True
        self._forced: set[int] = set()

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

    def _corrected(self, index: int) -> bool:
        """Return whether a motion is written anew."""
        return bool(self.rows.moved[index]) or index in self._forced or not self.program.straight

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
        coordinates = self._in_plane(block.modal.plane, [self._rounded(block.modal, value) for value in pole])
        if function_of(block) != "CC":
            return f"CC {coordinates}"
        line = PathLine(block)
        line.become("CC", coordinates)
        return line.render()

    def _in_plane(self, plane: int, values: Sequence[float]) -> str:
        """The two coordinates of a plane, in program units, as they are written."""
        pairs = sorted(zip(PLANES[plane], values, strict=False))
        return " ".join(f"{'XYZ'[axis]}{signed(value, self._digits)}" for axis, value in pairs)

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
            return self._rotary(line, {word.letter for word in block.words}, command)
        if mode == TOOL_VECTOR and function_of(block) == "LN":
            size = float(np.linalg.norm(command)) or 1.0
            R = block.modal.R_part_work
            vector = command / size if R is None else command / size @ np.array(R)
            vectors = [f"T{c}{signed(float(v), VECTOR_DECIMALS)}" for c, v in zip("XYZ", vector, strict=True)]
            if line is not None:
                line.set_vector(vectors)
            return " ".join(vectors)
        self.dropped_rad = max(self.dropped_rad, float(np.linalg.norm(command - nominal)))
        return ""

    @staticmethod
    def _rotary(line: PathLine | None, named: set[str], command: Float) -> str:
        """Rotary words of a row, rad, that a block names, put into its line."""
        texts = {c: spelled(c, round(float(v) / DEG, 4), 4) for c, v in zip("ABC", command, strict=True)}
        for letter, text in texts.items():
            if line is not None and line.find(letter) is not None:
                line.set(letter, text)
        return " ".join(text for letter, text in texts.items() if letter in named)

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
        text = feed_text(requested, 3 if factor == 1.0 else 1)
        if not local:
            self._feed = float(text[1:])
        if line is not None:
            line.set_feed(text)
        return f" {text}"

    def _restore_pole(self, function: str) -> None:
        """Write the pole of the source where a statement that stays counts from it."""
        if function in _POLAR and not self._pole_written and self._pole is not None:
            pole = [value / self._unit_m for value in self._pole]
            self.lines.append("CC " + self._in_plane(self._pole_plane, pole))
            self._pole_written = True

    def _keep(self, block: Block, index: int, motion: Motion, factor: float, function: str) -> None:
        """Write a path statement as it is."""
        line = PathLine(block)
        self._flush()
        self._restore_pole(function)
        self._f(block, motion, factor, line, local=function == "RND")
        self._here = np.array(motion.p_end)
        self.lines.append(line.render())
        self._arrive(index, motion)


_ROUNDINGS: Final = 3.0
_LARGEST_TURN: Final = 2.0 * math.pi - 1e-6


class ArcWriter(WrittenPosition):
    """Writes arcs."""

    def _arc(self, block: Block, index: int, motion: Motion) -> None:
        rows, modal, function = self.rows, block.modal, function_of(block)
        first, last = int(rows.first[index]), int(rows.last[index])
        corrected = self._corrected(index)
        line = PathLine(block)
        if not corrected and not self._follows():
            self._keep(block, index, motion, rows.share_of(first, last), function)
            return
        self.completed_blocks += not corrected
        assert motion.p_centre is not None
        nominal = self._flat(modal, np.vstack([motion.p_start, rows.nominal[first : last + 1]]))
        command = np.ascontiguousarray(self._flat(modal, np.vstack([self._here, rows.command[first : last + 1]])))
        share = nominal_share(nominal, self._flat(modal, motion.p_centre), motion.turn_rad)
        pending, self._pole_block = self._pole_block, None
        kept: list[bool] = []  # By piece: it is an arc
        tail, factor = "", rows.share_of(first, last)
        for piece, fitted in written_pieces(
            command, share, motion.turn_rad, self.tolerance_m,
            lambda piece: self._fitted(modal, piece, command, share),
        ):  # fmt: skip
            row = first - 1 + piece.last
            head, ends = None if kept else line, tail
            if row < last:
                tail, ends = tail if kept else line.take_last(), ""
            if pending is not None and not (fitted and row == last and not kept and function == "C"):
                self._copy(pending)
                pending, self._pole_written = None, True
            if fitted is not None:
                self._write_arc(block, motion, head, fitted, rows.command[row], (pending, factor, ends))
                pending = None
            else:
                self._write_chord(block, motion, head, rows.command[row], (factor, ends))
                self.checked[first + piece.first : row + 1] = True
            kept.append(fitted is not None)
            self.written[row] = self._here
        self._arrive(index, motion)
        self.count_arc(kept)

    def _flat(self, modal: Modal, p: Float) -> Float:
        """Points in programmed axes, m, in the order of their plane: its two axes, then the one out of it."""
        out: Float = self._work(modal, p)[..., list(PLANES[modal.plane])]
        return out

    def _write_chord(
        self, block: Block, motion: Motion, line: PathLine | None, p: Float, rest: tuple[float, str]
    ) -> None:
        factor, tail = rest
        coordinates = self._go(None, block.modal, p, every=line is not None)
        feed = self._f(block, motion, factor, line)
        if line is None:
            self.lines.append(f"L {coordinates}{feed}{tail}")
            return
        self._finish(line, "L", coordinates, tail)

    def _finish(self, line: PathLine, function: str, coordinates: str, tail: str) -> None:
        """Write the source's own line with another function and coordinates."""
        line.become(function, coordinates)
        self.lines.append(line.render() + tail)

    def _fitted(
        self, modal: Modal, piece: ArcPiece, points: Float, share: Float
    ) -> tuple[float, float, float, float] | None:
        """Centre (u, v), angle and rise as they are written; None where rounding breaks the arc."""
        assert piece.centre is not None
        part = points[piece.first : piece.last + 1].copy()
        part[0] = self._flat(modal, self._here)
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
        start = self._flat(modal, self._here)
        helix = rise != 0.0 or abs(turn) > _LARGEST_TURN
        if helix:
            out_of_plane = "XYZ"[PLANES[modal.plane][2]]
            words = f"IPA{signed(turn / DEG, 4)} I{out_of_plane}{signed(rise / modal.unit_m, self._digits)} {sense}"
            c, s = math.cos(turn), math.sin(turn)
            spoke = start[:2] - (u, v)
            end = np.array([u + c * spoke[0] - s * spoke[1], v + s * spoke[0] + c * spoke[1], start[2] + rise])
            function = "CP"
        else:
            values = [self._rounded(modal, float(value)) for value in self._flat(modal, p)[:2]]
            end = np.array([values[0] * modal.unit_m, values[1] * modal.unit_m, start[2]])
            words, function = f"{self._in_plane(modal.plane, values)} {sense}", "C"
        radius = self._radius(modal, start, end, (u, v), turn) if function_of(block) == "CR" and not helix else None
        feed = self._f(block, motion, factor, line, local=function_of(block) == "RND" and line is not None
                       and line.has_feed)  # fmt: skip
        if radius is not None:
            function, words = "CR", words[: -len(sense)] + f"R{signed(radius, self._digits)} {sense}"
        else:
            self.lines.append(self._centre(block if pending is None else pending, (u, v)))
            self._pole_written = False
        self._here = self._part(modal, end[np.argsort(PLANES[modal.plane])])
        if line is None:
            self.lines.append(f"{function} {words}{feed}{tail}")
        else:
            self._finish(line, function, words, tail)

    def _radius(self, modal: Modal, start: Float, end: Float, centre: tuple[float, float], turn: float) -> float | None:
        """R, in program units, that gives an arc of this centre within a tenth of the tolerance; None: none does."""
        size = self._rounded(modal, float(np.hypot(start[0] - centre[0], start[1] - centre[1])))
        radius = -size if abs(turn) > math.pi else size
        made = radius_centre(start, end, radius * modal.unit_m, math.copysign(1.0, turn))
        if made is None or math.dist(made, centre) > 0.1 * self.tolerance_m:
            return None
        return radius
