"""The same RAPID module back with only its targets changed, in the instructions or where they are declared."""

from __future__ import annotations

import itertools
import re
from typing import ClassVar

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.next_command import next_command
from counterflex.core.units import MM, MM_PER_S
from counterflex.geometry import pose, rotation
from counterflex.integrations.abb.language import LIMITS
from counterflex.integrations.abb.language.program import RapidMotion, RapidProgram, RapidTarget, RoutineCall
from counterflex.integrations.abb.language.table import FORMS
from counterflex.programs.compensated import CompensatedPath
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import Limits
from counterflex.programs.robot_text.circle_fit import FittedCircle, Spans
from counterflex.programs.robot_text.in_place import InPlace


class Copies:
    """Puts edits of each execution of a routine together.

    The first execution changes the routine itself; a later one with other edits gets a copy behind it, under a name of
    its own, and its call names that. Calls that a loop repeats have one name and must need the same.
    """

    def __init__(self, program: RapidProgram) -> None:
        self.program, self.made = program, 0
        declared = re.findall(r"\b(?:PROC|TRAP)\s+(\w+)", program.text, re.IGNORECASE)
        self._taken = {*program.names, *(name.upper() for name in declared)}

    def merged(self, edits: list[Spans]) -> Spans:
        """Edits of the whole text.

        Args:
            edits: For each of ``program.calls``; calls within copies get the names of theirs.
        """
        calls, out = self.program.calls, Spans()
        named: dict[tuple[int, tuple[int, int]], str] = {}
        versions: dict[str, list[tuple[int, str]]] = {}  # by routine: the first execution of each version, its name
        for index, call in enumerate(calls):
            versions.setdefault(call.routine.upper(), [(index, call.routine)])
        for index in sorted(range(len(calls)), key=lambda i: (-self._depth(i), i)):  # calls inside a routine first
            call = calls[index]
            known = versions[call.routine.upper()]
            name = next((name for other, name in known if other == index or edits[other] == edits[index]), "")
            if not name:
                name = self._name(call.routine)
                known.append((index, name))
            place = (call.parent, call.place)
            if place not in named and name != call.routine:
                edits[call.parent].replace(*call.place, name)
            if named.setdefault(place, name) != name:
                raise self._several(call)
        for (original, _), *others in versions.values():
            out += edits[original]
            for index, name in others:
                out.insert(calls[index].end, self._copy(index, name, edits[index]))
        return out

    def _several(self, call: RoutineCall) -> ProgramError:
        program = self.program
        return ProgramError(
            f"a loop calls {call.routine} several times, and each call needs another correction",
            where=program.place(call.place[0]), value=program.text[slice(*call.place)][:60],
            limit="one correction for each call",
            hint="Write it out: " + next_command("convert", program.name, to="rapid", cell="CELL", out="OUT"),
        )  # fmt: skip

    def _copy(self, index: int, name: str, edits: Spans) -> str:
        call, text = self.program.calls[index], self.program.text
        indent = re.search(r"[^\S\r\n]*\Z", text[: call.start])
        own = Spans()
        own += edits
        own.replace(*call.name, name)
        self.made += 1
        return self.program.newline + ("" if indent is None else indent[0]) + own.applied(text, call.start, call.end)

    def _depth(self, index: int) -> int:
        parent, depth = self.program.calls[index].parent, 0
        while parent >= 0:
            parent, depth = self.program.calls[parent].parent, depth + 1
        return depth

    def _name(self, routine: str) -> str:
        for count in itertools.count(2):
            name = f"{routine[: LIMITS.name_characters - 4]}_{count}"
            if name.upper() not in self._taken:
                break
        self._taken.add(name.upper())
        return name


_DECIMAL_MM = 10.0**-LIMITS.position_decimals
_DECIMAL_Q = 10.0**-LIMITS.angle_decimals
_ADDED_ZONE = "z0"


class RapidInPlace(InPlace[RapidProgram]):
    r"""Edits of the text of a module, for each execution of a routine by itself.

    A robtarget by name is changed where it is declared; where the program uses the name elsewhere too it is written out
    in the instruction. Numbers of Offs are changed themselves; a RelTool is written out. A changed speed is the option
    ``\V`` of the instruction. Added points have configuration and external axes of the target that they lead to. A
    routine that is called several times is written once for each call that needs other targets.
    """

    limits: ClassVar[Limits] = LIMITS
    cycle_s: ClassVar[float] = 0.024

    def __init__(self, program: RapidProgram, compensated: CompensatedPath, tolerance_m: float, cycle_s: float) -> None:
        super().__init__(program, compensated, tolerance_m, cycle_s)
        self.edits = [Spans() for _ in program.calls]
        self.declared = Spans()
        self._passes = [Spans() for _ in program.moves]
        self._split: set[int] = set()

    def files(self, messages: list[str]) -> dict[str, str]:
        """The files with all edits, and comments at the head of the first one."""
        program, edits = self.program, self.declared
        if messages:
            text, copies = program.text, Copies(program)
            end = next((match.start() for match in re.finditer(r"\r\n|\n|\r|$", text[program.declarations :])), 0)
            edits.insert(program.declarations + end, "".join(f"{program.newline}  ! {line}" for line in messages))
            self._merge_passes()
            edits += copies.merged(self.edits)
            self.counts.routines_copied = copies.made
        if len(program.files) < 2:
            return {program.name: edits.applied(program.text)}
        return {name: edits.within(start, end).applied(program.text, start, end) for name, start, end in program.files}

    def _merge_passes(self) -> None:
        """Put edits of each instruction to those of its routine; one in a loop must need the same in each pass."""
        first: dict[tuple[int, int], int] = {}
        for index, (move, edits) in enumerate(zip(self.program.moves, self._passes, strict=True)):
            known = first.setdefault((move.call, move.start), index)
            if known == index:
                self.edits[move.call] += edits
            elif self._passes[known] != edits:
                raise ProgramError(
                    "a loop makes this motion several times, and each pass needs another correction",
                    where=self.program.place(move.start),
                    value=self.program.text[move.start : move.end][:60],
                    limit="one correction for each instruction",
                    hint="Write it out: "
                    + next_command("convert", self.program.name, to="rapid", cell="CELL", out="OUT"),
                    each_pass=True,
                )

    # ---- language --------------------------------------------------------------------------------------------

    def add(self, index: int, p: Float, R_part_tcp: Float, speed_m_s: float | None, *, exact: bool = False) -> None:
        """``MoveL`` on a line of its own before the instruction."""
        move, like = self.program.moves[index], self._like(index)
        if like.target is None:
            raise ValueError("a motion without a target")
        text = self.program.text
        target = self._literal(like, like.target, p, self._quaternion(like, R_part_tcp))
        zone = "fine" if exact else _ADDED_ZONE if like.exact else text[slice(*like.zone)]
        speed = self._speed_text(like, speed_m_s)
        self.counts.speeds_changed += speed_m_s is not None
        line = f"MoveL {target},{speed},{zone},{text[slice(*like.rest)]};"
        lead = self.program.newline + self._indent(move.start)
        edits = self._passes[index]
        if move.guard is not None and index not in self._split:  # a compact IF becomes a block
            edits.insert(move.start, f"THEN{lead}  ")
            edits.insert(move.guard, f"{lead}ENDIF")
        self._split.add(index)
        edits.insert(move.start, line + lead + ("" if move.guard is None else "  "))

    def end(self, index: int, p: Float, R_part_tcp: Float | None, speed_m_s: float | None) -> Float:
        """The target of the instruction, and the option V of its speed."""
        move = self.program.moves[index]
        if move.target is None:
            placed: Float = np.asarray(self.program.motions[index].p_end, dtype=np.float64)
            return placed
        if speed_m_s is None and move.speed_time is not None and index in self._split:
            speed_m_s = self.program.motions[index].feed_m_s  # the time was that of the whole motion
        if speed_m_s is not None:
            self.counts.speeds_changed += 1
            text, edits = self._speed_number(move, speed_m_s), self._passes[index]
            if move.speed_time is not None:
                edits.replace(*move.speed_time, f"\\V:={text}")
            elif move.speed_value is None:
                edits.insert(move.speed[1], f"\\V:={text}")
            else:
                edits.replace(*move.speed_value, text)
        q = None if R_part_tcp is None else self._quaternion(move, R_part_tcp)
        return self._write(index, move.target, p, q)

    def circle(self, index: int, fit: FittedCircle) -> None:
        """Another point on the circle."""
        move = self.program.moves[index]
        if move.auxiliary is not None:
            via = self._in_part(move, np.array(move.auxiliary.position_mm) * MM)
            self._write(index, move.auxiliary, fit.at(via), None)

    def straightened(self, index: int) -> None:
        """``MoveL``, or what is like it, with the end alone."""
        move = self.program.moves[index]
        if move.auxiliary is not None and move.target is not None:
            word = FORMS[move.word.upper()].straight
            self._passes[index].replace(move.start, move.start + len(move.word), word)
            self._passes[index].replace(move.auxiliary.start, move.target.start, "")

    # ---- text ------------------------------------------------------------------------------------------------

    def _like(self, index: int) -> RapidMotion:
        """The instruction that an added one is like: that of the motion, of a wait the one before."""
        moves = self.program.moves
        return next(moves[i] for i in range(index, -1, -1) if moves[i].target is not None)

    def _speed_text(self, move: RapidMotion, speed_m_s: float | None) -> str:
        text = self.program.text[slice(*move.speed)]
        if speed_m_s is None and move.speed_time is not None:
            index = self.program.moves.index(move)
            speed_m_s = self.program.motions[index].feed_m_s
        if speed_m_s is not None:
            return f"{text}\\V:={self._speed_number(move, speed_m_s)}"
        return text if move.speed_value is None else f"{text}\\V:={self.program.text[slice(*move.speed_value)]}"

    def _speed_number(self, move: RapidMotion, speed_m_s: float) -> str:
        """The number of the option V, of which VelSet makes a speed."""
        return number(speed_m_s / MM_PER_S / move.override, 4)

    def _indent(self, at: int) -> str:
        """Blanks at the beginning of a line."""
        text = self.program.text
        begin = max(text.rfind("\n", 0, at), text.rfind("\r", 0, at)) + 1
        lead = re.match(r"[^\S\r\n]*", text[begin:at])
        return "" if lead is None else lead[0]

    def _in_part(self, move: RapidMotion, p: Float) -> Float:
        """(3,) m, a place in the frame of the targets, in the part."""
        return p if move.T_part_object is None else pose.transform(move.T_part_object, p)

    def _in_object(self, move: RapidMotion, p: Float) -> Float:
        """The same the other way."""
        return p if move.T_part_object is None else pose.transform(pose.inverse(move.T_part_object), p)

    def _quaternion(self, move: RapidMotion, R_part_tcp: Float) -> tuple[float, ...]:
        """q1 to q4 of the instruction's tool, of the sign of its target, and the same text where they are the same."""
        R = R_part_tcp @ move.R_tcp_tool
        R = R if move.T_part_object is None else move.T_part_object[:3, :3].T @ R
        q: Float = rotation.quat_wxyz(R)
        if move.target is None:
            return tuple(q.tolist())
        written = np.array(move.target.quat_wxyz)
        q = q if float(q @ written) >= 0.0 else -q
        same = float(np.abs(q - written / np.linalg.norm(written)).max()) < 0.5 * _DECIMAL_Q
        return move.target.quat_wxyz if same else tuple(q.tolist())

    def _write(self, index: int, target: RapidTarget, p_part: Float, q: tuple[float, ...] | None) -> Float:
        """Give a target other numbers; returns its position as it is written, (3,) m in the part."""
        move, edits = self.program.moves[index], self._passes[index]
        p = self._in_object(move, p_part)
        shift = p / MM - np.array(target.position_mm)
        stays = bool(np.all(np.abs(shift) <= 0.5 * _DECIMAL_MM)) and (q is None or q == target.quat_wxyz)
        unchanged: Float = np.array(target.position_mm) * MM
        if stays:
            return self._in_part(move, unchanged)
        if target.offsets and q is None:
            values = np.round(np.array(target.offsets_mm) + shift, LIMITS.position_decimals)
            for place, value, old in zip(target.offsets, values, target.offsets_mm, strict=True):
                if abs(value - old) > 0.5 * _DECIMAL_MM:
                    edits.replace(*place, number(float(value), LIMITS.position_decimals))
            written: Float = unchanged + (values - np.array(target.offsets_mm)) * MM
            return self._in_part(move, written)
        if not target.offsets and not target.turned and not target.shared:
            where = self.declared if target.name else edits
            for start, end, text in self._numbers(target, p, q):
                where.replace(start, end, text)
            self.counts.targets_declared += bool(target.name)
        else:
            edits.replace(target.start, target.end, self._literal(move, target, p_part, q or target.quat_wxyz))
            self.counts.targets_written_out += 1
        return self._in_part(move, self.rounded(p))

    def _numbers(self, target: RapidTarget, p: Float, q: tuple[float, ...] | None) -> list[tuple[int, int, str]]:
        """Edits of the numbers that change."""
        out = []
        text = self.program.text
        for (start, end), value in zip(target.numbers[:3], p / MM, strict=True):
            if abs(float(text[start:end]) - value) > 0.5 * _DECIMAL_MM:
                out.append((start, end, number(float(value), LIMITS.position_decimals)))
        for (start, end), part in zip(target.numbers[3:], q or (), strict=q is not None):
            if abs(float(text[start:end]) - part) > 0.5 * _DECIMAL_Q:
                out.append((start, end, number(part, LIMITS.angle_decimals)))
        return out

    def _literal(self, move: RapidMotion, target: RapidTarget, p_part: Float, q: tuple[float, ...]) -> str:
        """A robtarget with its configuration and external axes, written out on one line."""
        p = self._in_object(move, p_part)
        if not target.numbers:
            if not target.rest:
                raise ProgramError(
                    "the target is corrected, and its configuration is not known",
                    where=self.program.place(target.start), value=self.program.text[target.start : target.end][:60],
                    limit="a robconf with numbers", hint="Write the configuration into the target",
                )  # fmt: skip
            place = ",".join(number(float(value), LIMITS.position_decimals) for value in p / MM)
            return f"[[{place}],[{','.join(number(part, LIMITS.angle_decimals) for part in q)}],{target.rest}]"
        spans = Spans()
        for edit in self._numbers(target, p, q):
            spans.replace(*edit)
        text = spans.applied(self.program.text, *target.literal)
        return re.sub(r"\s*(?:![^\r\n]*)?[\r\n]+\s*", "", text)


write_rapid_in_place = RapidInPlace.write
