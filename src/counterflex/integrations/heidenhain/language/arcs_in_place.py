"""Arcs of Klartext with other targets: about a CC of their own, with their radius, or in pieces."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG
from counterflex.integrations.heidenhain.language.emitter import signed
from counterflex.integrations.heidenhain.language.written import PathLine, function_of
from counterflex.integrations.heidenhain.language.written_position import WrittenPosition
from counterflex.programs.gcode.write.arc_fit import arc_error, radius_centre, written_turn
from counterflex.programs.gcode.write.arc_pieces import ArcPiece, nominal_share, written_pieces
from counterflex.programs.program import Block, Modal, Motion

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
        nominal = self._work(modal, np.vstack([motion.p_start, rows.nominal[first : last + 1]]))
        command = np.ascontiguousarray(self._work(modal, np.vstack([self._here, rows.command[first : last + 1]])))
        share = nominal_share(nominal, self._work(modal, motion.p_centre), motion.turn_rad)
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
            self.lines.append(self._centre(block if pending is None else pending, (u, v)))
            self._pole_written = False
        self._here = self._part(modal, end)
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
