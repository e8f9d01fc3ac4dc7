"""Makes the motions of a FANUC program as it runs."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Final, cast

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM_PER_S
from counterflex.geometry import pose
from counterflex.geometry.circle import angle_to, circle
from counterflex.integrations.fanuc.language.program import FanucMotion
from counterflex.integrations.fanuc.language.read.frames import TpFrames, position_of
from counterflex.integrations.fanuc.language.read.listing import TpStatement
from counterflex.integrations.fanuc.language.read.motion_form import UNITS, MotionForm, motion_form
from counterflex.integrations.fanuc.language.read.routine import TpRoutine, fault
from counterflex.integrations.fanuc.language.read.targets import TpTarget, TpTargets
from counterflex.integrations.fanuc.language.read.values import CONFIG, TpValues
from counterflex.programs.expression import Value
from counterflex.programs.program import Motion, Word
from counterflex.programs.robot_text.cell import NumberedCell
from counterflex.programs.robot_text.execution import Away, ExecutionByAxes
from counterflex.programs.unknown import Unknown, known

_SAME_CIRCLE_M: Final = 5e-6
Fault = Callable[[str, str], ProgramError]


def arcs_of(chain: Sequence[Motion], fault: Fault) -> list[Motion]:
    """The motions of a chain: the first one straight to its point, the others along the circle that all lie on.

    Which three points the controller takes for a piece in a longer chain does not matter where all lie on one circle;
    other chains are refused.

    Raises:
        ProgramError: The chain is shorter than three, or lies on no single circle.
    """
    if len(chain) < 3:
        raise fault("a chain of A is shorter than three points: it is no circle", "Write C, or L")
    points = [np.asarray(motion.p_end) for motion in chain]
    parts = circle(points[0], points[1], points[2])
    if parts is None:
        raise fault("the points of a chain of A lie on a line", "Write L")
    centre, normal = parts
    radius = float(np.linalg.norm(points[0] - centre))
    off = max(max(abs(float(np.linalg.norm(p - centre)) - radius), abs(float((p - centre) @ normal))) for p in points)
    if off > _SAME_CIRCLE_M:
        raise fault(
            "a chain of A lies on no single circle: what is between its points is the controller's own", "Write C"
        )
    turns = [angle_to(a, b, centre, normal) for a, b in itertools.pairwise(points)]
    return [
        chain[0],
        *(
            replace(motion, kind="arc", p_centre=centre, normal=normal, turn_rad=turn)
            for motion, turn in zip(chain[1:], turns, strict=True)
        ),
    ]


_PLACE: Final = "such places before the first target and behind the last one"


class TpMotionExecution(ExecutionByAxes[FanucMotion]):
    """Motions of a program, with the state that they depend on.

    Args:
        cell: What frames and process words are checked against; None takes every frame and knows no process words.
    """

    def __init__(self, cell: NumberedCell | None) -> None:
        self.values = TpValues()
        self.frames = TpFrames(cell, self.values)
        super().__init__(self.frames)
        self.cell = cell
        self.targets = TpTargets(cell, self.values, self.frames, lambda: len(self.motions))
        self.file = ""
        self._arcs: list[int] = []  # motions of the running chain of A
        self._T_part_end: Float | None = None  # end of the last motion
        self._end_tool, self._end_exact = -1, False

    # ---- where the robot is --------------------------------------------------------------------------------

    def here(self, *, at_rest: bool) -> Value:
        """Return the last target in the active frames.

        Args:
            at_rest: Only where the robot has come to rest there.
        """
        if self.away:
            return Unknown("the robot went to a place by axes or registers", self.away[0].where)
        if self._T_part_end is None:
            return Unknown("the robot has not moved yet", self.values.where)
        if self._end_tool != self.frames.user_tool:
            return Unknown("the tool frame has changed since the last motion", self.values.where)
        if at_rest and not self._end_exact:
            return Unknown("the robot still moves: the motion before ends with CNT", self.values.where)
        self.frames.settle(self.values.where)
        config = {CONFIG: self.moves[-1].config} if self.moves else {}
        return {**position_of(pose.inverse(self.frames.T_part_user) @ self._T_part_end), **config}

    # ---- motions -------------------------------------------------------------------------------------------

    def motion(self, routine: TpRoutine, statement: TpStatement, word: str) -> str:
        """Make a motion; returns the statement that runs before or behind its end.

        Raises:
            ProgramError: Its end, speed or frames are not known.
        """
        form = motion_form(
            statement.code, word,
            lambda what, limit, hint: fault(routine.listing, statement, what, limit=limit, hint=hint),
        )  # fmt: skip
        where = routine.listing.place(statement.start)
        self.values.here = self.here(at_rest=False) if form.options else self.values.here
        *through, last = (self.targets.target(one, routine, statement) for one in form.targets)
        target = self.targets.displaced(last, form, self.values.here, routine, statement)
        T = self._place(target, word, where, routine, statement)
        by_axes = target.T_user_tool is None
        if word != "A":
            self._close_arcs(routine)
        if T is None or (by_axes and word == "J"):
            self.leave(
                self._record(form, target, through, routine, statement), T, where, target.unknown,
                lambda: self.targets.refuse_moving(target.external_axes, target.others, where), target.axes or (),
            )  # fmt: skip
            return form.at_time
        self.arrive(lambda away: self._refuse_away(away, routine, statement))
        for one in (*through, target):
            self.targets.refuse_moving(one.external_axes, one.others, where)
        R = T[:3, :3] if by_axes else T[:3, :3] @ self.frames.R_tcp_tool.T
        self._make(form, T, R, through, routine, statement)
        if word == "A":
            self._arcs.append(len(self.motions) - 1)
        T_user = pose.inverse(self.frames.T_part_user) @ T
        self._words += [Word(c, float(v) * 1e3, 0, 0) for c, v in zip("XYZ", T_user[:3, 3], strict=True)]
        self.moves.append(self._record(form, target, through, routine, statement))
        self._T_part_end, self._end_tool, self._end_exact = T, self.frames.user_tool, form.exact
        if by_axes:
            self._end_tool = -2
        return form.at_time

    def _place(
        self, target: TpTarget, word: str, where: str, routine: TpRoutine, statement: TpStatement
    ) -> Float | None:
        """(4, 4) m of a target in the part frame; None of one by axes without a cell, or of J to one not known."""
        if target.T_user_tool is not None:
            self.frames.settle(where)
            out: Float = self.frames.T_part_user @ target.T_user_tool
            return out
        if target.unknown is not None and word != "J":
            known(target.unknown, "where a motion goes", where, text=statement.code,
                  hint="Write the position itself, or set its register in the program")  # fmt: skip
        T = None
        if target.axes and self.cell is not None and self.cell.tip_of_axes is not None:
            T = self.cell.tip_of_axes(target.axes, {**self.targets.external.now, **target.external_axes})
        if T is None and word != "J":
            raise fault(routine.listing, statement, "axis angles are no target of a path without the cell's robot",
                        limit="X Y Z W P R", hint="Give that place by X Y Z W P R, or give the cell")  # fmt: skip
        return T

    def _refuse_away(self, away: Away[FanucMotion], routine: TpRoutine, statement: TpStatement) -> ProgramError:
        why = f": {away.unknown}" if away.unknown is not None else ""
        return fault(
            routine.listing, statement,
            f"the robot comes from a place that is not known, by axes (line {away.where.split(':')[1]}){why}",
            limit=_PLACE,
            hint="Give that place by X Y Z W P R, or post each part as a program of its own",
        )  # fmt: skip

    def _make(
        self, form: MotionForm, T: Float, R: Float, through: list[TpTarget], routine: TpRoutine, statement: TpStatement
    ) -> None:
        before = self.motions[-1].p_end if self.motions else T[:3, 3]
        way = float(np.linalg.norm(T[:3, 3] - before))
        feed = self.targets.feed_m_s(form, way or 1.0, routine, statement)
        self.straight(len(self._blocks) - 1, T[:3, 3], R, feed)
        if not through:
            return
        if through[0].T_user_tool is None:
            raise fault(routine.listing, statement, "axis angles are no point of a circle", limit="X Y Z W P R",
                        hint="Give that point by X Y Z W P R")  # fmt: skip
        middle = (self.frames.T_part_user @ through[0].T_user_tool)[:3, 3]
        self.circle(middle, lambda what, hint: fault(routine.listing, statement, what, hint=hint))
        if form.unit in ("sec", "msec"):
            motion = self.motions[-1]
            feed = self.targets.feed_m_s(form, motion.length_m, routine, statement)
            self.motions[-1] = replace(motion, feed_m_s=feed if motion.kind != "rapid" else 0.0)

    def _record(
        self, form: MotionForm, target: TpTarget, through: list[TpTarget], routine: TpRoutine, statement: TpStatement
    ) -> FanucMotion:
        code, base = statement.code, statement.start
        unit = form.unit if form.unit in UNITS else "mm/sec"
        unit_m_s = self.targets.unit_m_s(form, routine, statement)
        if form.word != "J" and unit_m_s == 0.0:
            override = known(self.targets.override, "the override", routine.listing.place(base))
            unit_m_s = MM_PER_S * float(cast("float", override))
        auxiliary = through[0].literal if through else None
        named, first = form.targets[-1].span, form.targets[0].span
        return FanucMotion(
            line=statement.line, word=form.word, start=base + len(code) - len(code.lstrip()), head=statement.head,
            end=statement.end, R_tcp_tool=self.frames.R_tcp_tool, file=routine.name,
            T_part_frame=self.frames.T_part_user, frames=(self.frames.user_frame, self.frames.user_tool),
            T_frame_tool=target.T_user_tool,
            computed=target.computed or ("axes" if target.T_user_tool is None else ""), config=target.config,
            options=tuple((base + a, base + b) for a, b in form.option_spans),
            position=None if target.computed else target.literal, named=(base + named[0], base + named[1]),
            auxiliary=auxiliary if through and not through[0].computed else None,
            auxiliary_named=(base + first[0], base + first[1]) if through else (0, 0),
            speed=(base + form.speed_span[0], base + form.speed_span[1]), unit=unit, unit_m_s=unit_m_s,
            speed_text=code[slice(*form.speed_span)], by_time=form.unit in ("sec", "msec"),
            termination=form.termination, exact=form.exact,
        )  # fmt: skip

    def _close_arcs(self, routine: TpRoutine) -> None:
        """Make circles of a chain of A: the controller goes through each three of it."""
        chain, self._arcs = self._arcs, []
        if not chain:
            return
        line = self._blocks[self.motions[chain[0]].block].line

        refuse = partial(ProgramError, where=f"{routine.name}:{line}", value="A", limit="three points or more")
        made = arcs_of([self.motions[index] for index in chain], lambda what, hint: refuse(what, hint=hint))
        for index, motion in zip(chain, made, strict=True):
            self.motions[index] = motion
            block = self.motions[index].block
            self._blocks[block] = replace(self._blocks[block], modal=self.modal(self.motion_code(index)))
