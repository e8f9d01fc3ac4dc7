"""The same KRL back with only the targets changed, in the ``.src`` file or, where they stand there, the ``.dat``."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.next_command import next_command
from counterflex.core.units import DEG, MM
from counterflex.geometry import rotation
from counterflex.integrations.kuka.language import LIMITS
from counterflex.integrations.kuka.language.program import (
    LETTERS,
    Edits,
    KrlMotion,
    KrlProgram,
    Target,
    Values,
    spelled,
)
from counterflex.integrations.kuka.language.read import statements as form
from counterflex.integrations.kuka.language.read.literals import code_of
from counterflex.programs.compensated import CompensatedPath
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import Limits
from counterflex.programs.motion_rows import LEAST_FEED_CHANGE
from counterflex.programs.robot_text.circle_fit import FittedCircle
from counterflex.programs.robot_text.in_place import InPlace


class WrittenValues:
    """Values of targets, mm and deg."""

    def __init__(self, program: KrlProgram) -> None:
        self.program = program
        self.values: Values = dict.fromkeys(LETTERS, 0.0)
        self._T_part_base: Float | None = None

    def enter(self, T_part_base: Float | None) -> None:
        """The next motion is written in a base, (4, 4) m in the part; None where it is the part frame."""
        if T_part_base is self._T_part_base:
            return
        p, R = self.here(), rotation.from_zyx(np.array([self.values[letter] for letter in "ABC"]) * DEG)
        R_part = R if self._T_part_base is None else self._T_part_base[:3, :3] @ R
        self._T_part_base = T_part_base
        R_base = R_part if T_part_base is None else T_part_base[:3, :3].T @ R_part
        angles = rotation.to_zyx(R_base) / DEG
        self.values = self.point(p) | {letter: float(v) for letter, v in zip("ABC", angles, strict=True)}

    def here(self) -> Float:
        """Written position in the part, (3,) m."""
        return self._in_part(np.array([self.values[letter] for letter in "XYZ"]) * MM)

    def point(self, p_part: Float) -> Values:
        """X Y Z in mm of a point (3,) m in the part."""
        T = self._T_part_base
        p = p_part if T is None else T[:3, :3].T @ (p_part - T[:3, 3])
        return {letter: float(value) for letter, value in zip("XYZ", p / MM, strict=True)}

    def _in_part(self, p_base: Float) -> Float:
        T = self._T_part_base
        return p_base if T is None else T[:3, :3] @ p_base + T[:3, 3]

    def stand(self, values: Values) -> None:
        """Values were written: the robot is there."""
        self.values = {letter: float(spelled(letter, values[letter])) for letter in LETTERS}

    def named(self, target: Target) -> Values:
        """Values of a target as read; components that are not written are those written last."""
        return {
            letter: target.components[letter].value if letter in target.components else self.values[letter]
            for letter in LETTERS
        }

    def point_of(self, target: Target) -> Float:
        """(3,) m in the part of a target as read."""
        values = self.named(target)
        return self._in_part(np.array([values[letter] for letter in "XYZ"]) * MM)

    def nominal_angles(self, index: int) -> Values:
        """A B C at the programmed end of a motion: as written, or of the same orientation."""
        Rs, target = self.program.Rs_part_tcp, self.program.moves[index].target
        if Rs is None:
            raise ValueError("a program without orientations")
        written = {} if target is None else {k: c.value for k, c in target.components.items() if k in "ABC"}
        return self.angles(Rs[index]) | written

    def angles(self, R_part_tcp: Float) -> Values:
        """A B C of ``$TOOL`` in deg, near those written last: of the same orientation other turns are not written."""
        R_tcp_tool = np.eye(3) if self.program.R_tcp_tool is None else self.program.R_tcp_tool
        R_base_tcp = R_part_tcp if self._T_part_base is None else self._T_part_base[:3, :3].T @ R_part_tcp
        a, b, c = (float(angle) for angle in rotation.to_zyx(R_base_tcp @ R_tcp_tool) / DEG)
        near = np.array([self.values[letter] for letter in "ABC"])
        ways = [np.array([a, b, c]), np.array([a + 180.0, 180.0 - b, c + 180.0])]
        ways = [way - 360.0 * np.round((way - near) / 360.0) for way in ways]
        best = min(ways, key=lambda way: float(np.abs(way - near).max()))
        best = np.where(np.abs(best) > 180.0, best - 360.0 * np.sign(best), best)
        return dict(zip("ABC", best.tolist(), strict=True))


class KrlInPlace(InPlace[KrlProgram]):
    """Edits of ``.src`` and ``.dat``.

    Points are added with the approximation of the motion (``C_DIS`` where it has none); where the speed changes,
    ``$VEL.CP`` is set before the motion. A target by name is changed in the ``.dat`` file; where the program uses the
    name elsewhere too it is written out in the motion.
    """

    limits: ClassVar[Limits] = LIMITS
    cycle_s: ClassVar[float] = 0.012

    def __init__(self, program: KrlProgram, compensated: CompensatedPath, tolerance_m: float, cycle_s: float) -> None:
        super().__init__(program, compensated, tolerance_m, cycle_s)
        self.at = WrittenValues(program)
        self._edits: dict[str, Edits] = {name: Edits(file.lines) for name, file in program.files.items()}
        self._active: float | None = None  # $VEL.CP that was written last, where it is another than programmed
        self._fit: FittedCircle | None = None
        self._now_straight = -1

    def run(self) -> None:
        """Write every motion, and the programmed speed behind the last one."""
        self._refuse_repeated()
        super().run()
        self._restore_speed()

    def files(self, messages: list[str]) -> dict[str, str]:
        """The files of the job, with comments behind DEF of the main program."""
        files = self.program.files
        if messages:
            at = next(i for i, line in enumerate(self.program.lines, start=1) if form.ROUTINE.fullmatch(code_of(line)))
            self._edits[self.program.name].insert(at + 1, [f"; {line}" for line in messages])
        return {name: files[name].newline.join(edits.lines()) for name, edits in self._edits.items()}

    def _line(self, move: KrlMotion) -> str:
        return self.program.files[move.file].lines[move.line - 1]

    # ---- language --------------------------------------------------------------------------------------------

    def fixed_turn(self, index: int) -> bool:
        """The circle is given by CA."""
        return self.program.moves[index].circle_angle

    def begun(self, index: int) -> None:
        """The program sets the speed before the motion: what was written is not active any more."""
        move = self.program.moves[index]
        if move.speed_set:
            self._active = None
        if move.word != "WAIT":
            self.at.enter(move.T_part_base)

    def divided(self, index: int) -> None:
        """Refuse to stand between TRIGGER statements of which some count from the start and others from the end."""
        move = self.program.moves[index]
        if self._place(move) < 0:
            raise ProgramError(
                "a corrected motion cannot be divided: TRIGGER statements before it count from its start and its end",
                where=f"{move.file}:{move.line}", value=self._line(move).strip()[:60],
                hint="Put the TRIGGER that counts from the start before those that count from the end",
            )  # fmt: skip

    def add(self, index: int, p: Float, R_part_tcp: Float, speed_m_s: float | None, *, exact: bool = False) -> None:
        """``LIN`` or ``SLIN`` on a line of its own before the instruction, with ``$VEL.CP`` where that changes."""
        motion, move = self.program.motions[index], self.program.moves[index]
        spline = move.word.startswith("S")
        word, approximation = "SLIN" if spline else "LIN", move.approximation or ("C_SPL" if spline else "C_DIS")
        approximation = "" if move.in_spline or exact else f" {approximation}"
        values = self.at.point(p) | self.at.angles(R_part_tcp)
        own = self._own_clause(index, speed_m_s)
        lines = [*self._speed_lines(index, speed_m_s), f"{word} {self._literal(values)}{own}{approximation}"]
        place = move.line if motion.kind == "dwell" else self._place(move)
        self._insert(move, place, lines)
        self.at.stand(values)

    def end(self, index: int, p: Float, R_part_tcp: Float | None, speed_m_s: float | None) -> Float:
        """The target of the instruction, and its speed."""
        motion, move = self.program.motions[index], self.program.moves[index]
        fit, straight = self._fit, self._now_straight == index
        self._fit = None
        self._insert(move, move.line, self._speed_lines(index, speed_m_s))
        self._edit_own_speed(index, speed_m_s)
        if move.target is None:
            if motion.kind != "dwell":  # by axes: the robot is where they lead
                p = np.asarray(motion.p_end)
                self.at.stand(self.at.point(p) | self.at.nominal_angles(index))
            return p
        if R_part_tcp is not None and move.holds_orientation:
            raise ProgramError(
                "a corrected motion needs another orientation, and $ORI_TYPE=#CONSTANT disregards that of its target",
                where=f"{move.file}:{move.line}", value=self._line(move).strip()[:60],
                hint="Set $ORI_TYPE=#VAR before it",
            )  # fmt: skip
        angles = self.at.nominal_angles(index) if R_part_tcp is None else self.at.angles(R_part_tcp)
        values = self.at.point(p) | angles
        if straight:
            word = "SLIN" if move.word.startswith("S") else "LIN"
            self._change(move, [(move.start, move.end, f"{word} {self._literal(values)}")])
        elif not move.circle_angle:
            self._write(move.target, move, values, turned=R_part_tcp is not None)
        elif fit is not None:
            target = values | self.at.point(fit.at(self.at.point_of(move.target)))
            self._write(move.target, move, target, turned=R_part_tcp is not None)
        else:
            values |= self.at.point(np.asarray(motion.p_end))
        self.at.stand(values)
        return self.at.here()

    def circle(self, index: int, fit: FittedCircle) -> None:
        """Another auxiliary point."""
        move = self.program.moves[index]
        if move.auxiliary is None:
            raise ValueError("a circle without its points")
        self._fit = fit
        values = self.at.named(move.auxiliary) | self.at.point(fit.at(self.at.point_of(move.auxiliary)))
        self._write(move.auxiliary, move, values, turned=False)

    def straightened(self, index: int) -> None:
        """The instruction becomes LIN when its end is written."""
        self._now_straight = index

    # ---- text ------------------------------------------------------------------------------------------------

    def _place(self, move: KrlMotion) -> int:
        """Line before which points are added; -1 where they cannot stand."""
        return self.program.loose_triggers.get((move.file, move.line), move.line)

    def _change(self, move: KrlMotion, edits: list[tuple[int, int, str]]) -> None:
        self._edits[move.file].change(move.line, edits)

    def _insert(self, move: KrlMotion, line: int, texts: list[str]) -> None:
        text = self._line(move)
        indent = text[: len(text) - len(text.lstrip())]
        self._edits[move.file].insert(line, [indent + one for one in texts])

    def _literal(self, values: Values) -> str:
        pose = ",".join(f"{letter} {spelled(letter, values[letter])}" for letter in LETTERS)
        return f"{{{pose}{self.program.extra}}}"

    def _write(self, target: Target, move: KrlMotion, values: Values, *, turned: bool) -> None:
        edits = target.edits(values, self.at.values, turned=turned)
        if target.computed:
            if edits or self.program.reads_position:
                self._write_out(target, move, values)
            return
        if not edits:
            return
        if target.in_data and not move.shared:
            self._edits[target.file].change(target.line, edits)
            self.counts.targets_declared += 1
        elif target.in_data:
            self._change(move, [(target.start, target.end, target.text(edits))])
            self.counts.targets_written_out += 1
        else:
            self._change(move, edits)

    def _write_out(self, target: Target, move: KrlMotion, values: Values) -> None:
        """A target that the program computes, as numbers in the motion; a relative motion becomes an absolute one."""
        kept = "".join(f",{name} {part.value:g}" for name, part in target.components.items() if name not in LETTERS)
        pose = ",".join(f"{letter} {spelled(letter, values[letter])}" for letter in LETTERS)
        literal = f"{{{pose}{kept or self.program.extra}}}"
        if move.relative:
            end = len(code_of(self._line(move)).rstrip())
            words = f" {move.approximation}" if move.approximation else ""
            self._change(move, [(move.start, end, f"{move.word} {literal}{words}")])
        else:
            self._change(move, [(target.start, target.end, literal)])
        self.counts.targets_written_out += 1

    def _speed_lines(self, index: int, speed_m_s: float | None) -> list[str]:
        """``$VEL.CP`` for a piece of a motion, where the active one is another."""
        motion, move = self.program.motions[index], self.program.moves[index]
        if motion.feed_m_s <= 0.0 or move.in_spline or move.own_speed is not None:
            return []
        programmed = motion.feed_m_s / move.override
        active = programmed if self._active is None else self._active
        requested = programmed if speed_m_s is None else speed_m_s / move.override
        if abs(requested / active - 1.0) <= LEAST_FEED_CHANGE:
            return []
        self._active = float(number(requested, 6))
        self.counts.speeds_added += 1
        return [f"$VEL.CP={number(requested, 6)}"]

    def _own_clause(self, index: int, speed_m_s: float | None) -> str:
        """``WITH`` of a piece of a motion that has one, or stands in a spline block and gets a speed of its own."""
        motion, move = self.program.motions[index], self.program.moves[index]
        if move.clause is not None:
            speed = motion.feed_m_s if speed_m_s is None else speed_m_s
            return f" {self._clause(index, speed)}"
        if motion.feed_m_s <= 0.0 or not move.in_spline or speed_m_s is None:
            return ""
        return f" WITH $VEL.CP={number(speed_m_s / move.override, 6)}"

    def _clause(self, index: int, speed_m_s: float) -> str:
        """The motion's own ``WITH`` with another speed; in a spline block it gets one where it has none."""
        move = self.program.moves[index]
        assert move.clause is not None
        start, end, speed = move.clause.start, move.clause.end, move.clause.speed
        text, speed_m_s = self._line(move), speed_m_s / move.override
        if speed is not None:
            return text[start : speed[0]] + number(speed_m_s, 6) + text[speed[1] : end]
        if move.in_spline and speed_m_s > 0.0:
            return f"{text[start:end]}, $VEL.CP={number(speed_m_s, 6)}"
        return text[start:end]

    def _edit_own_speed(self, index: int, speed_m_s: float | None) -> None:
        """The same of the motion itself, where it is another than programmed."""
        motion, move = self.program.motions[index], self.program.moves[index]
        if speed_m_s is None or motion.feed_m_s <= 0.0 or not (move.in_spline or move.own_speed is not None):
            return
        self.counts.speeds_changed += 1
        if move.clause is not None:
            place = move.clause.start, move.clause.end
            self._change(move, [(*place, self._clause(index, speed_m_s))])
        else:
            self._change(move, [(move.end, move.end, f" WITH $VEL.CP={number(speed_m_s / move.override, 6)}")])

    def _restore_speed(self) -> None:
        """The programmed speed behind the last motion: what comes after it inherits it."""
        fed = [
            motion.feed_m_s / move.override
            for motion, move in zip(self.program.motions, self.program.moves, strict=True)
            if motion.feed_m_s > 0.0 and not move.in_spline and move.own_speed is None
        ]
        if self._active is not None and fed and abs(self._active / fed[-1] - 1.0) > 1e-9:
            move = self.program.moves[-1]
            self._insert(move, move.line + 1, [f"$VEL.CP={number(fed[-1], 6)}"])
            self.counts.speeds_added += 1

    def _refuse_repeated(self) -> None:
        """Refuse a motion that is executed several times, where each time needs a target of its own."""
        program, moved = self.program, self.rows.moved
        first: dict[tuple[str, int], int] = {}
        for index, move in enumerate(program.moves):
            earlier = first.setdefault((move.file, move.line), index)
            if earlier == index:
                continue
            written = move.target is not None and move.target.computed and program.reads_position
            if moved[index] or moved[earlier] or written:
                raise ProgramError(
                    "this motion is executed several times (a loop, or a subprogram that is called several times), "
                    "and each time needs a target of its own",
                    where=f"{move.file}:{move.line}",
                    value=self._line(move).strip()[:60],
                    hint="Write it once for each pass, or compensate what this writes: "
                    + next_command("convert", program.name, to="krl", cell="CELL", out="OUT"),
                    each_pass=True,
                )


write_krl_in_place = KrlInPlace.write
