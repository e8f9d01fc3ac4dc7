"""The same cutter location file back with only its targets replaced."""

from __future__ import annotations

import math
from typing import ClassVar, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MINUTE
from counterflex.programs.apt import tool_on_circle
from counterflex.programs.gcode.write.arc_fit import PLANE_AXES, arc_error, written_turn
from counterflex.programs.gcode.write.arc_pieces import ArcPiece, nominal_share, written_pieces
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.machine_in_place import MachineInPlace
from counterflex.programs.motion_rows import LEAST_FEED_CHANGE
from counterflex.programs.program import TOOL_VECTOR, Block, Motion

_AXIS_DIGITS: Final = 3  # A component of the tool axis has three decimals more than a length: 1e-7
_ROUNDINGS: Final = 3.0
_PER_MINUTE: Final = 94
_SAME_M: Final = 1e-12


class AptInPlace(MachineInPlace):
    """Walks through the statements of a file.

    A corrected GOTO gets its numbers edited in place and further GOTO before it; a corrected CIRCLE stays one, or
    becomes several, or GOTO. FEDRAT is put before pieces whose feed changes, and back behind them.
    """

    unrolls: ClassVar[bool] = False

    def prepare(self) -> None:
        """Begin where the program begins."""
        self._here: Float = np.array(self.program.motions[0].p_start if self.program.motions else np.zeros(3))
        self._feed_written = 1.0
        self._feed_block: Block | None = None
        self._circle: Block | None = None

    def put_head(self, lines: list[str], texts: list[str]) -> None:
        """Before all statements."""
        lines[:0] = [f"$$ {text}" for text in texts]

    def run(self) -> list[str]:
        """All lines of the written file."""
        if len(self.written):
            self.written[0] = self.rows.nominal[0]
        at = 0
        for block in self.program.blocks:
            count = block.text.count("\n") + 1
            at = block.line - 1 + count
            if any(word.letter == "F" for word in block.words):
                self._feed_block, self._feed_written = block, 1.0
            if block.motion_count:
                self._motion(block, block.first_motion)
            elif self._is_circle(block):
                self._circle = block
            else:
                self._copy(block)
        self.lines.extend(self.program.lines[at:])
        return self.lines

    def _copy(self, block: Block) -> None:
        self.lines.extend(block.text.split("\n"))

    @staticmethod
    def _is_circle(block: Block) -> bool:
        return block.text.lstrip().upper().startswith(("CIRCLE", "MOVARC", "INDIRV"))

    def _motion(self, block: Block, index: int) -> None:
        motion, rows = self.program.motions[index], self.rows
        first, last = int(rows.first[index]), int(rows.last[index])
        follows = bool(np.any(np.abs(self._here - motion.p_start) > _SAME_M))
        inherits = follows and (motion.kind == "arc" or any(word.absolute is False for word in block.words))
        if motion.kind == "dwell":
            self._dwell(block, index, last)
        elif not rows.moved[index] and not inherits:
            if motion.kind != "rapid":
                self._feed(block, motion, rows.share_of(first, last) if motion.kind == "arc" else 1.0)
            if self._circle is not None:
                self._copy(self._circle)
            self._copy(block)
            self._here = np.array(motion.p_end)
        elif motion.kind == "arc":
            self._arc(block, index, motion)
        else:
            self._straight(block, index, motion)
        self._circle = None
        if last >= 0:
            self.written[last], self.checked[last] = self._here, True
            if motion.kind == "feed":
                self.checked[first : last + 1] = True

    def _dwell(self, block: Block, index: int, last: int) -> None:
        """Before a dwell, go to where it is planned, straight along the tool axis."""
        planned = self.rows.relieved(index)
        if planned is not None:
            self.lines.append("GOTO/" + self._numbers(block, planned, last))
            self.vertices_added += 1
        self._copy(block)

    # ---- words ---------------------------------------------------------------------------------------------------

    def _coordinate(self, value: float) -> str:
        return number(round(value / self._unit_m, self._digits), self._digits)

    def _numbers(self, block: Block, p: Float, row: int) -> str:
        """Coordinates of a point, and the tool axis where the file turns the tool; the written place is there then."""
        texts = [self._coordinate(float(value)) for value in p]
        self._here = np.array([float(text) * self._unit_m for text in texts])
        if block.modal.tool_centre == TOOL_VECTOR:
            texts += self._axis(row)
        return ",".join(texts)

    def _axis(self, row: int) -> list[str]:
        angles = self.rows.angles
        if angles is None:
            return []
        length = float(np.linalg.norm(angles[row])) or 1.0
        return [number(float(value) / length, self._digits + _AXIS_DIGITS) for value in angles[row]]

    def _edited(self, block: Block, p: Float, row: int) -> None:
        """The source's GOTO with its numbers replaced; GODLTA becomes one."""
        places = {word.letter: word for word in block.words if word.letter in "XYZIJK"}
        numbers = self._numbers(block, p, row).split(",")
        if any(word.absolute is False for word in places.values()):
            self.lines.append("GOTO/" + ",".join(numbers))
            return
        text, end = block.text, max(word.end for word in places.values())
        if len(numbers) == 6 and "I" not in places:
            text = text[:end] + "," + ",".join(numbers[3:]) + text[end:]
        for letter, new in sorted(zip("XYZIJK", numbers, strict=False), key=lambda pair: -"XYZIJK".index(pair[0])):
            word = places.get(letter)
            if word is not None:
                text = text[: word.start] + new + text[word.end :]
        self.lines.extend(text.split("\n"))

    def _feed(self, block: Block, motion: Motion, factor: float) -> None:
        """FEDRAT where the feed of a piece differs from the one that is written."""
        source = self._feed_block
        if source is None or block.modal.feed_mode != _PER_MINUTE or motion.feed_m_s <= 0.0:
            return
        if abs(factor / self._feed_written - 1.0) <= LEAST_FEED_CHANGE:
            return
        self._feed_written = factor
        value = motion.feed_m_s * MINUTE / block.modal.unit_of_feed_m * factor
        word = next(word for word in source.words if word.letter == "F")
        new = number(value, 4 if factor == 1.0 else 1)
        self.lines.append((source.text[: word.start] + new + source.text[word.end :]).split("$")[0].rstrip())

    # ---- motions -------------------------------------------------------------------------------------------------

    def _straight(self, block: Block, index: int, motion: Motion) -> None:
        rows = self.rows
        first, last = int(rows.first[index]), int(rows.last[index])
        if last < first:
            self._edited(block, np.asarray(motion.p_end), max(last, 0))
            return
        inner = rows.inner(index) if motion.kind == "feed" else []
        before = first - 1
        for row in [*inner, last]:
            if motion.kind == "feed":
                self._feed(block, motion, rows.factor(before, row, rows.command[before], rows.command[row]))
            if row == last:
                self._edited(block, rows.command[row], row)
            else:
                self.lines.append("GOTO/" + self._numbers(block, rows.command[row], row))
            self.written[row] = self._here
            before = row
        self.count_split(len(inner))

    def _arc(self, block: Block, index: int, motion: Motion) -> None:
        circle, rows = self._circle, self.rows
        on_circle = block.text.lstrip().upper().startswith("TLON")
        if circle is None or motion.p_centre is None or motion.normal is None:
            raise ProgramError("an arc without its CIRCLE cannot be corrected", where=block.where(self.program.name))
        axes = list(PLANE_AXES[block.modal.plane])
        first, last = int(rows.first[index]), int(rows.last[index])
        self._feed(block, motion, rows.share_of(first, last))
        nominal = np.vstack([motion.p_start, rows.nominal[first : last + 1]])[:, axes]
        command = np.vstack([self._here, rows.command[first : last + 1]])
        points = np.ascontiguousarray(command[:, axes])
        share = nominal_share(nominal, np.asarray(motion.p_centre)[axes], motion.turn_rad)
        kept: list[bool] = []  # By piece: it is an arc
        for piece, centre in written_pieces(
            points, share, motion.turn_rad, self.tolerance_m,
            lambda piece: self._fitted(piece, points, share, axes, level=on_circle),
        ):  # fmt: skip
            row = first - 1 + piece.last
            kept.append(centre is not None)
            if centre is None:
                self.checked[first + piece.first : row + 1] = True
            elif on_circle:
                self._tool_on_circle(centre, rows.command[row], piece.turn_rad)
            else:
                self._write_circle(circle, axes, centre)
            if row == last and not on_circle:
                self._edited(block, rows.command[row], row)
            elif centre is None or not on_circle:
                self.lines.append("GOTO/" + self._numbers(block, rows.command[row], row))
            self.written[row] = self._here
        self.count_arc(kept)

    def _fitted(
        self, piece: ArcPiece, points: Float, share: Float, axes: list[int], *, level: bool
    ) -> tuple[float, float, float, float] | None:
        """Centre (u, v, w) and radius as they are written; None where rounding breaks the arc."""
        assert piece.centre is not None
        part = points[piece.first : piece.last + 1].copy()
        if level and np.ptp(part[:, 2]) > self.resolution_m:
            return None
        part[0] = self._here[axes]
        part[-1] = [float(self._coordinate(float(value))) * self._unit_m for value in part[-1]]
        at = share[piece.first : piece.last + 1]
        at = (at - at[0]) / (at[-1] - at[0])
        u, v = (float(self._coordinate(value)) * self._unit_m for value in piece.centre)
        turned = written_turn(part[0], part[-1], (u, v), math.copysign(1.0, piece.turn_rad), 1)
        error = arc_error(part, at, (u, v), turned)
        if error > self.tolerance_m + _ROUNDINGS * self.resolution_m:
            return None
        self.arc_error_m = max(self.arc_error_m, error)
        return u, v, float(part[0][2]), math.hypot(part[0][0] - u, part[0][1] - v)

    def _tool_on_circle(self, fitted: tuple[float, float, float, float], p: Float, turn_rad: float) -> None:
        """A circular motion of its own statement to a point."""
        start, centre = self._here.copy(), np.array(fitted[:3])
        end = np.array([float(self._coordinate(float(value))) * self._unit_m for value in (*p[:2], start[2])])
        turn = written_turn(start[:2], end[:2], fitted[:2], math.copysign(1.0, turn_rad), 1)
        self.lines += tool_on_circle.written(start, centre, fitted[3], end, turn, self._coordinate)
        self._here = end

    def _write_circle(self, circle: Block, axes: list[int], fitted: tuple[float, float, float, float]) -> None:
        """The source's CIRCLE with centre and radius replaced."""
        values = [0.0, 0.0, 0.0]
        for axis, value in zip(axes, fitted[:3], strict=True):
            values[axis] = value
        text = circle.text
        for word, value in sorted(
            zip(circle.words, [*values, fitted[3]], strict=True), key=lambda pair: -pair[0].start
        ):
            text = text[: word.start] + self._coordinate(value) + text[word.end :]
        self.lines.extend(text.split("\n"))


write_apt = AptInPlace.write
