"""Makes the motions of a job as it runs: targets, speeds, corners, shifts.

Arcs (INFORM language manual, MOVC): the robot goes straight to the first MOVC, and from there along the arc through
each three of the points that follow. Where the arc shall change, a point has FPT: it ends one arc and begins the next.
Points without it must lie on one circle here, since which three a controller takes in a longer row would matter.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, cast

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM_PER_S
from counterflex.geometry import pose
from counterflex.integrations.yaskawa.language.form import ArcPoint, Form, Made, arcs_of, stands_at, straight_to
from counterflex.integrations.yaskawa.language.frames import InformCell, InformFrames
from counterflex.integrations.yaskawa.language.program import (
    AXES,
    PULSE,
    Header,
    InformMotion,
    Point,
    Position,
    frame_of,
)
from counterflex.integrations.yaskawa.language.source import InformJob, InformStatement
from counterflex.integrations.yaskawa.language.values import InformValues, PositionValue
from counterflex.programs.expression import Value, is_number
from counterflex.programs.program import Word
from counterflex.programs.robot_text.execution import Away, ExecutionByAxes
from counterflex.programs.unknown import Unknown, known

FASTEST_MM_S: Final = 1500.0
"""Largest V of MOVL in mm/s (INFORM language manual); a controller set to cm/min takes up to 9000."""
_PULSES: Final = (
    "Post it in the user frame of the part, or say pulses_per_deg in [robot.controller_axes] of the cell file"
)


@dataclass(frozen=True, slots=True)
class _InformTarget:
    """An end of a motion: its pose in the frame of its header, or axes in deg, or why neither is known."""

    header: Header
    T_frame_tool: Float | None = None
    axes: tuple[float, ...] = ()
    position: Position | None = None
    computed: str = ""
    unknown: Unknown | None = None


class InformMotions(ExecutionByAxes[InformMotion]):
    """Motions of a job, with the state that they depend on.

    Args:
        cell: What frames and process words are held against; None takes every frame and knows no process words.

    Attributes:
        values: Variables.
        frames: Frames and tools.
    """

    def __init__(self, cell: InformCell | None) -> None:
        self.values, self.frames = InformValues(), InformFrames(cell)
        super().__init__(self.frames)
        self.cell = cell
        self.speed: Value = Unknown("no V, and no SPEED before it")  # V of motions that name none, mm/s
        self.shift: Float | None = None  # (3,) m in the part frame that SFTON adds, or None
        self.eventful = False  # Something else than a MOVC ran since the last one
        self._row: list[ArcPoint] = []
        self._rested: ArcPoint | None = None  # last point of a row that a dwell ended
        self._resumed = False
        self._others: str | None = None
        self._T_part_end: Float | None = None
        self._end_header = Header()

    # ---- targets -------------------------------------------------------------------------------------------

    def motion(self, job: InformJob, statement: InformStatement, form: Form) -> None:
        """Make a motion. Raises ProgramError: its end, speed or frames are not known."""
        where = job.place(statement.start)
        if form.word != "MOVC":
            self.close_arcs()
        target = self._increment(job, statement, form) if form.word == "IMOV" else self._target(job, statement, form)
        self._refuse_others(job, statement, form)
        T = self._place(job, statement, form, target)
        if T is None or (target.axes and form.word == "MOVJ"):
            at = Point(line=statement.line, head=statement.head, start=statement.start, end=statement.end,
                       R_tcp_tool=np.eye(3), computed="pulses", file=job.name)  # fmt: skip
            self.leave(InformMotion(form.word, at, form.exact), T, where, target.unknown, None, target.axes)
            return
        point = self._point(job, statement, form, target)
        if point.T_frame_tool is not None:
            T = point.T_part_tool
        R = T[:3, :3] if target.axes else T[:3, :3] @ self.frames.R_tcp_tool.T
        feed = self._feed_m_s(job, statement, form)
        self.arrive(lambda away: self._refuse_away(away, job, statement))
        if form.word == "MOVC":
            self._take_arc_point(ArcPoint(
                len(self._blocks) - 1, point, T, R, feed, form, self._rpm, self.frames.tool, not self.eventful, where
            ))  # fmt: skip
        else:
            self.straight(len(self._blocks) - 1, T[:3, 3], R, feed)
            self.moves.append(InformMotion(form.word, point, form.exact, form.rounding_m))
        self.eventful = False
        self._T_part_end = T
        self._end_header = target.header if not target.axes else self._end_header
        self._words += [Word(c, float(v) * 1e3, 0, 0) for c, v in zip("XYZ", T[:3, 3], strict=True)]

    def _target(self, job: InformJob, statement: InformStatement, form: Form) -> _InformTarget:
        at = statement.start + form.named[0]
        if not form.target:
            raise job.fault(at, "the motion names no position", "MOVL C00000 V=25.0")
        if form.target[0].upper() == "C":
            position = job.positions.get(("C", int(form.target[1:])))
            if position is None:
                raise job.fault(at, f"where {form.target} is, is not known", "an entry of //POS")
            self._refuse_other_frame(job, position)
            if position.header.postype == PULSE:
                return self._of_pulses(position.header, position.values, position, job.place(at))
            return _InformTarget(position.header, frame_of(position.values), position=position)
        value = self.values.get(form.target)
        name = form.target.upper()
        if isinstance(value, PositionValue) and value.unknown is None:
            numbers = [float(cast("float", one)) for one in value.values]
            if value.header.postype == PULSE:
                return replace(self._of_pulses(value.header, numbers, None, job.place(at)), computed=name)
            return _InformTarget(value.header, frame_of(numbers), computed=name)
        why = value.unknown if isinstance(value, PositionValue) else value
        why = why if isinstance(why, Unknown) else Unknown(f"{name} is no position", job.place(at))
        return _InformTarget(Header(), computed=name, unknown=why)

    def _of_pulses(
        self, header: Header, values: Sequence[float], position: Position | None, where: str
    ) -> _InformTarget:
        ratio = () if self.cell is None else self.cell.pulses_per_deg
        if not ratio:
            why = Unknown("it is given in pulses, and the pulses of a degree are not", where)
            return _InformTarget(header, position=position, computed="pulses", unknown=why)
        axes = tuple(float(pulses) / one for pulses, one in zip(values[:AXES], ratio, strict=True))
        return _InformTarget(header, axes=axes, position=position, computed="pulses")

    def _refuse_other_frame(self, job: InformJob, position: Position) -> None:
        """Refuse a position of a relative job in another frame than that of the job."""
        header = position.header
        own = f"{header.postype} {header.user}" if header.postype == "USER" else header.postype
        if job.frame and header.postype != PULSE and own != job.frame:
            raise job.fault(position.start, "a position is in another frame than its relative job",
                            f"////FRAME {job.frame}", "Post the job again")  # fmt: skip

    def _increment(self, job: InformJob, statement: InformStatement, form: Form) -> _InformTarget:
        """Target of IMOV."""
        where, at = job.place(statement.start), statement.start + form.named[0]
        if not form.frame:
            raise job.fault(statement.start, "IMOV does not say the frame of its increment", "BF, RF, TF, UF#(1)",
                            "Write it: what the controller takes then is not known")  # fmt: skip
        if form.target[:1].upper() in ("", "C"):
            raise job.fault(at, "the increment of IMOV is no variable", "IMOV P000 V=25.0 BF")
        value = known(self.values.get(form.target), "the increment of IMOV", where, text=statement.code,
                      hint="Set the variable in the job")  # fmt: skip
        step = self._translation(value, job, at)
        here = None if self.away else self._T_part_end
        if here is None:
            raise job.fault(statement.start, "where IMOV counts from is not known", "a motion to a position before it",
                            "Write the target itself")  # fmt: skip
        R = here[:3, :3] if form.frame == "TF" else self.frames.rotation(form.frame, where)
        T = here.copy()
        T[:3, 3] += R @ step
        T_part_frame = self.frames.of(self._end_header, where)
        return _InformTarget(self._end_header, pose.inverse(T_part_frame) @ T, computed="IMOV")

    def _translation(self, value: object, job: InformJob, at: int) -> Float:
        """(3,) m of a position variable that displaces."""
        if not isinstance(value, PositionValue) or value.header.postype == PULSE:
            raise job.fault(at, "a displacement in pulses is not read", "X Y Z in mm", "Give it by X Y Z")
        known(list(value.values), "a displacement", job.place(at), hint="Set the variable in the job")
        numbers = [float(cast("float", one)) for one in value.values]
        if any(numbers[3:]):
            raise job.fault(at, "a displacement that turns the tool is not read", "Rx, Ry, Rz = 0",
                            "Write the targets themselves")  # fmt: skip
        out: Float = frame_of(numbers)[:3, 3]
        return out

    def begin_shift(self, job: InformJob, statement: InformStatement, target: str, frame: str) -> None:
        """SFTON: add a displacement to the positions that follow.

        Raises:
            ProgramError: It is not known, or another one is on.
        """
        where = job.place(statement.start)
        if self.shift is not None:
            raise job.fault(statement.start, "a shift begins while another one is on", "SFTOF before it",
                            "End the first one, or write the targets themselves")  # fmt: skip
        if not frame or frame == "TF":
            raise job.fault(statement.start, "SFTON does not say a frame that stands still", "BF, RF, UF#(1)",
                            "Write it: what the controller takes then is not known")  # fmt: skip
        value = known(self.values.get(target), "the shift", where, text=statement.code, hint="Set it in the job")
        step = self._translation(value, job, statement.start)
        self.shift = self.frames.rotation(frame, where) @ step

    def _place(self, job: InformJob, statement: InformStatement, form: Form, target: _InformTarget) -> Float | None:
        """(4, 4) m of a target in the part; None of MOVJ to one that is not known."""
        where = job.place(statement.start)
        if target.unknown is not None:
            if form.word != "MOVJ":
                hint = _PULSES if target.computed == "pulses" else "Write the position itself, or set its variable"
                known(target.unknown, "where a motion goes", where, text=statement.code, hint=hint)
            return None
        if target.T_frame_tool is not None:
            return pose.make()
        self.frames.use_tool(target.header.tool, where)
        if self.shift is not None:
            raise job.fault(statement.start, "a shift is on, and the position is given in pulses", "X Y Z Rx Ry Rz",
                            "Post it in the user frame of the part")  # fmt: skip
        if self.cell is None or self.cell.tip_of_axes is None:
            return None
        return self.cell.tip_of_axes(target.axes, {})

    def _point(self, job: InformJob, statement: InformStatement, form: Form, target: _InformTarget) -> Point:
        where, base = job.place(statement.start), statement.start
        T_part_frame = np.eye(4)
        if target.T_frame_tool is not None:
            T_part_frame = self.frames.of(target.header, where)
            if self.shift is not None and form.word != "IMOV":
                T_part_frame = pose.make(p=self.shift) @ T_part_frame
        return Point(
            line=statement.line, head=statement.head, start=base, end=statement.end, file=job.name,
            named=(base + form.named[0], base + form.named[1]), T_part_frame=T_part_frame,
            T_frame_tool=target.T_frame_tool, R_tcp_tool=self.frames.R_tcp_tool,
            position=target.position if not target.computed else None, computed=target.computed, header=target.header,
            words=form.words, number=(base + form.number[0], base + form.number[1]), tail=form.tail,
        )  # fmt: skip

    def _refuse_others(self, job: InformJob, statement: InformStatement, form: Form) -> None:
        """Refuse external axes that move."""
        if not form.words:
            return
        places = []
        for word in form.words.split():
            kind = word[:2].upper()
            position = job.positions.get((kind, int(word[2:]))) if word[2:].isdecimal() else None
            if position is None:
                raise job.fault(statement.start, f"where {word} is, is not known", "BC or EC of //POS",
                                "External axes by variables are not read")  # fmt: skip
            places.append(f"{kind}={','.join(f'{value:g}' for value in position.values)}")
        text = " ".join(places)
        self._others = self._others or text
        if text != self._others:
            raise job.fault(statement.start, "an external axis moves", self._others,
                            "Moving stations and base axes are not read: post the path with them at rest")  # fmt: skip

    def _refuse_away(self, away: Away[InformMotion], job: InformJob, statement: InformStatement) -> ProgramError:
        why = f": {away.unknown}" if away.unknown is not None else ""
        return job.fault(
            statement.start, f"the robot comes from a place that is not known, by axes "
            f"(line {away.where.split(':')[1]}){why}",
            "such places before the first target and behind the last one", _PULSES,
        )  # fmt: skip

    # ---- speeds --------------------------------------------------------------------------------------------

    def _feed_m_s(self, job: InformJob, statement: InformStatement, form: Form) -> float:
        """Speed along the path, m/s; 0 of MOVJ."""
        if form.word == "MOVJ":
            return 0.0
        at = statement.start + form.number[0]
        value: Value = self.speed
        if form.speed:
            value = float(form.speed) if form.speed[0] in "+-.0123456789" else Unknown(
                "the unit of a speed by a variable is the controller's")  # fmt: skip
        number = known(value, "the speed of a motion", job.place(at), text=statement.code,
                       hint="Write the speed itself, V=25.0: the force depends on it")  # fmt: skip
        if not is_number(number) or not 0.0 < cast("float", number) <= FASTEST_MM_S:
            raise job.fault(at, "this is no speed in mm/s", f"above 0, at most {FASTEST_MM_S:g}",
                            "A controller set to cm/min takes more: post the job in mm/s")  # fmt: skip
        return cast("float", number) * MM_PER_S

    # ---- arcs ----------------------------------------------------------------------------------------------

    def _take_arc_point(self, node: ArcPoint) -> None:
        if self._rested is not None:
            if not self._rested.form.fpt:
                raise ProgramError("a dwell stands between the points of an arc", where=node.where, value="MOVC",
                                   limit="a dwell behind FPT", hint="Put a MOVL behind the dwell")  # fmt: skip
            self._row.append(self._rested)
            self._resumed = True
        self._rested = None
        self._row.append(node)

    def close_arcs(self, *, rest: bool = False) -> None:
        """Make the arcs of a row of MOVC that has ended.

        Raises:
            ProgramError: It has fewer than three points, or they lie on no single circle.
        """
        row, self._row = self._row, []
        self._rested = row[-1] if rest and row else self._rested if rest else None
        if not row:
            return
        cuts = [0, *(k for k in range(1, len(row) - 1) if row[k].form.fpt), len(row) - 1]
        resumed, self._resumed = self._resumed, False
        made: dict[int, Made] = {}
        before = self.motions[-1] if self.motions else None
        start = row[0]
        stands = before is not None and stands_at(before, self.rotations[-1], start)
        if not stands:
            made |= straight_to(start, before)
        for first, last in itertools.pairwise(cuts):
            made |= arcs_of(row[first : last + 1], start.point if stands and first == 0 and not resumed else None)
        self._insert(row[1 if resumed else 0].block, made)

    def _insert(self, first: int, made: dict[int, Made]) -> None:
        """Put motions into the blocks from one on; blocks that follow begin behind them."""
        for index in range(first, len(self._blocks)):
            block = replace(self._blocks[index], first_motion=len(self.motions))
            if index in made:
                motion, R, move = made[index]
                self.motions.append(motion)
                self.rotations.append(R)
                self.moves.append(move)
                block = replace(block, motion_count=1, modal=self.modal(self.motion_code(len(self.motions) - 1)))
            self._blocks[index] = block
