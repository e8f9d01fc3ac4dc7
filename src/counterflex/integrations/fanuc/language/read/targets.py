"""Targets of the motions of a FANUC program: positions, position registers, offsets, increments; and at which speed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final, cast

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM_PER_S
from counterflex.geometry import pose
from counterflex.integrations.fanuc.language.program import LETTERS, FanucPosition, frame_of
from counterflex.integrations.fanuc.language.read.frames import TpFrames, matrix_of, position_of
from counterflex.integrations.fanuc.language.read.listing import TpStatement
from counterflex.integrations.fanuc.language.read.motion_form import UNITS, MotionForm, TargetForm
from counterflex.integrations.fanuc.language.read.routine import TpRoutine, fault
from counterflex.integrations.fanuc.language.read.values import CONFIG, TpValues, plain_code
from counterflex.programs.expression import ExpressionError, Value, is_number
from counterflex.programs.robot_text.cell import ExternalAxes, NumberedCell
from counterflex.programs.unknown import Unknown, first_unknown, known

_LARGEST_M_S: Final = 20.0
_TURN_DEG: Final = 1e-9
_AXES: Final = 6


@dataclass(frozen=True, slots=True)
class TpTarget:
    """An end of a motion."""

    T_user_tool: Float | None  # (4, 4) m in the active user frame; None of one by axes, or of one that is not known
    literal: FanucPosition | None = None  # Its entry of /POS, where it is nothing else
    computed: str = ""  # Why it is none, as a clause
    config: str = ""  # CONFIG
    axes: tuple[float, ...] = ()  # Axes in deg of one that is given by them
    unknown: Unknown | None = None  # Why it is not known
    # External axes, E1 to E3 (J7 to J9), by number: mm or deg
    external_axes: Mapping[int, float] = field(default_factory=dict)
    others: str = ""  # Text of further motion groups

    @classmethod
    def by_axes(cls, values: Mapping[str, Value], computed: str, name: str, where: str) -> TpTarget:
        """Target of J1 to J6 and external axes; not known where one of the six is missing."""
        axes = tuple(float(cast("float", values[f"J{n}"])) for n in range(1, 7) if f"J{n}" in values)
        if len(axes) < _AXES:
            return cls(None, computed=computed, unknown=Unknown(f"{name} has no J1 to J6", where))
        external = {
            n: float(cast("float", values[key]))
            for n in (1, 2, 3)
            for key in (f"E{n}", f"J{_AXES + n}")
            if key in values
        }
        return cls(None, computed=computed, axes=axes, external_axes=external)


class TpTargets:
    """Evaluates the ends and speeds of motions.

    Args:
        cell: What they are held against.
        values: Registers.
        frames: Active frames.
        made: Returns the number of motions made so far.
    """

    def __init__(self, cell: NumberedCell | None, values: TpValues, frames: TpFrames, made: Callable[[], int]) -> None:
        self.cell, self.values, self.frames = cell, values, frames
        self.override: Value = 1.0  # Factor of all speeds
        # Largest speed along the path that the program sets; inf where it sets none
        self.linear_max_m_s: Value = float("inf")
        # Position register and frame of OFFSET CONDITION and TOOL_OFFSET CONDITION, by ``offset`` and ``tool``
        self.conditions: dict[str, tuple[Value, int | None]] = {}
        self.external = ExternalAxes(cell, made)  # External axes along the program
        self._others: str | None = None

    # ---- targets -------------------------------------------------------------------------------------------

    def target(self, form: TargetForm, routine: TpRoutine, statement: TpStatement) -> TpTarget:
        """Return a target as written, without the options of its motion.

        Raises:
            ProgramError: There is no such position.
        """
        where = routine.listing.place(statement.start)
        index = int(form.index) if form.index.isdigit() else self._number(form.index, routine, statement)
        name = f"{form.word}[{index}]"
        value = self.values.registers.get((form.word, index))
        if form.word == "P" and value is None:
            literal = routine.positions.get(index)
            if literal is None:
                raise fault(routine.listing, statement, f"where {name} is, is not known", limit="an entry of /POS",
                            hint="The listing may be damaged: post it again")  # fmt: skip
            if not literal.numbers:
                values: dict[str, Value] = {**literal.axes, **{f"E{n}": one for n, one in literal.external.items()}}
                return replace(TpTarget.by_axes(values, "", name, where), others=literal.others)
            self._frames_of(literal, routine)
            computed = "" if form.index.isdigit() else f"{name} by a register"
            return TpTarget(
                frame_of(literal.values), literal, computed, literal.config, external_axes=literal.external,
                others=literal.others,
            )  # fmt: skip
        if value is None:
            value = self.values.value_of(form.word, [(index,)])
        if isinstance(value, Unknown) or not isinstance(value, Mapping):
            why = value if isinstance(value, Unknown) else Unknown(f"{name} is no position", where)
            return TpTarget(None, computed=name, unknown=why)
        return self._of_register(value, name, where)

    def _of_register(self, value: Mapping[str, Value], name: str, where: str) -> TpTarget:
        unknown = first_unknown(dict(value))
        if unknown is not None:
            return TpTarget(None, computed=name, unknown=unknown)
        if "J1" in value:
            return TpTarget.by_axes(value, name, name, where)
        if (self.frames.user_frame < 0 or self.frames.user_tool < 0) and self.cell is not None:
            raise ProgramError(
                "the program does not say which frames are active", where=where, value=name,
                limit="UFRAME_NUM and UTOOL_NUM before the first motion",
                hint="Write the numbers into the program: the controller's are not known",
            )  # fmt: skip
        external = {n: float(cast("float", value[f"E{n}"])) for n in (1, 2, 3) if f"E{n}" in value}
        return TpTarget(matrix_of(value, name, where), None, name, str(value.get(CONFIG, "")), external_axes=external)

    def displaced(
        self, target: TpTarget, form: MotionForm, here: Value, routine: TpRoutine, statement: TpStatement
    ) -> TpTarget:
        """Return a target with the options of its motion.

        Args:
            here: Target of the motion before in the active frames.

        Raises:
            ProgramError: The displacement is not known, or its effect is not.
        """
        if not form.options or target.unknown is not None:
            return target
        where = routine.listing.place(statement.start)
        T = target.T_user_tool
        if T is None or form.word in ("C", "A"):
            raise fault(routine.listing, statement, "an offset or increment of axes or of a circle is not read",
                        limit="L and J to X Y Z W P R", hint="Write the target itself")  # fmt: skip
        computed = ""
        for option, register in form.options:
            if option == "inc":
                T, computed = self._incremented(T, here, routine, statement), "INC"
                continue
            value, frame = self._displacement(option, register, routine, statement)
            computed = "Offset" if option == "offset" else "Tool_Offset"
            known(value, computed, where, text=statement.code, hint="Give its register its numbers in the program")
            if option == "tool":
                T = self._in_tool(T, value, frame, where)
            elif frame is None:
                T = _added(T, value, computed, where)
            else:
                T = self._in_frame(T, value, frame, where)
        return replace(
            target, T_user_tool=T, literal=None, computed=f"{target.computed}, {computed}".removeprefix(", ")
        )

    def _displacement(self, option: str, register: str, routine: TpRoutine, statement: TpStatement
                      ) -> tuple[Value, int | None]:  # fmt: skip
        if register:
            return self._value(register, routine, statement), None
        if option not in self.conditions:
            word = "OFFSET CONDITION" if option == "offset" else "TOOL_OFFSET CONDITION"
            raise fault(routine.listing, statement, f"the program gives no {word}", limit=f"{word} PR[n] before",
                        hint="Name the register at the motion: Offset,PR[n]")  # fmt: skip
        return self.conditions[option]

    def _in_tool(self, T: Float, value: Value, frame: int | None, where: str) -> Float:
        if frame is not None and frame != self.frames.user_tool:
            raise ProgramError("the offset is in another tool frame than the active one", where=where,
                               value=f"UTOOL[{frame}]", limit=f"UTOOL[{self.frames.user_tool}]",
                               hint="Write the target itself")  # fmt: skip
        out: Float = T @ matrix_of(value, "Tool_Offset", where)
        return out

    def _in_frame(self, T: Float, value: Value, frame: int, where: str) -> Float:
        """An offset in the axes of a user frame that need not be the active one."""
        T_world_offset = self.frames.value_in_world("UFRAME", frame)
        T_world_user = self.frames.value_in_world("UFRAME", self.frames.user_frame)
        offset = matrix_of(value, "Offset", where)
        if frame != self.frames.user_frame and (T_world_offset is None or T_world_user is None):
            raise ProgramError("the offset is in a frame whose place is not known", where=where,
                               value=f"UFRAME[{frame}]", hint="Set the frame in the program")  # fmt: skip
        if float(np.abs(offset[:3, :3] - np.eye(3)).max()) > _TURN_DEG:
            raise ProgramError("a turn as an offset in another frame is not read", where=where, value="W P R of Offset",
                               limit="0", hint="Write the target itself")  # fmt: skip
        out = T.copy()
        turn = np.eye(3)
        if T_world_offset is not None and T_world_user is not None:
            turn = pose.inverse(T_world_user)[:3, :3] @ T_world_offset[:3, :3]
        out[:3, 3] += turn @ offset[:3, 3]
        return out

    def _incremented(self, T: Float, here: Value, routine: TpRoutine, statement: TpStatement) -> Float:
        where = routine.listing.place(statement.start)
        known(here, "where INC counts from", where, text=statement.code, hint="Write the target itself")
        if float(np.abs(T[:3, :3] - np.eye(3)).max()) > _TURN_DEG:
            raise fault(routine.listing, statement, "an increment that turns the tool is not read",
                        limit="W, P, R = 0 deg", hint="Write the target itself")  # fmt: skip
        out = matrix_of(here, "the place before", where)
        out[:3, 3] += T[:3, 3]
        return out

    # ---- checks --------------------------------------------------------------------------------------------

    def _frames_of(self, position: FanucPosition, routine: TpRoutine) -> None:
        """Frames that a position names must be the active ones; one that is not set by a statement is taken from it."""
        frames = self.frames
        if position.user_tool is not None and position.user_tool != frames.user_tool:
            frames.user_tool = self._own_frame(frames.user_tool, position.user_tool, "UT", position, routine)
        if position.user_frame is not None and position.user_frame != frames.user_frame:
            frames.user_frame = self._own_frame(frames.user_frame, position.user_frame, "UF", position, routine)
        if self.cell is not None:
            for active, word in ((frames.user_tool, "UT"), (frames.user_frame, "UF")):
                if active < 0:
                    raise ProgramError(
                        f"neither the program nor its positions say which {word} is meant",
                        where=routine.listing.place(position.start), value=f"{word} : F",
                        limit=f"U{'TOOL' if word == 'UT' else 'FRAME'}_NUM before the first motion",
                        hint="Write the number into the program: the controller's is not known",
                    )  # fmt: skip

    def _own_frame(self, active: int, own: int, word: str, position: FanucPosition, routine: TpRoutine) -> int:
        if active >= 0:
            raise ProgramError(
                "a position is taught in another frame than the active one: the controller stops there",
                where=routine.listing.place(position.start), value=f"{word} : {own}", limit=f"{word} : {active}",
                hint="Post the program again",
            )  # fmt: skip
        return own

    def refuse_moving(self, external_axes: Mapping[int, float], others: str, where: str) -> None:
        """Refuse external axes, and further groups, that move."""
        for number, value in external_axes.items():
            self.external.check(number, value, f"E{number}", where)
        self._others = self._others or others
        if others and others != self._others:
            raise ProgramError(
                "a position moves more than one group", where=where, value=others[:40],
                limit="further groups that stand still",
                hint="Moving positioners and second robots are not read: post the path with the positioner at rest",
            )  # fmt: skip

    # ---- speeds --------------------------------------------------------------------------------------------

    def unit_m_s(self, form: MotionForm, routine: TpRoutine, statement: TpStatement) -> float:
        """Speed along the path of one unit of a motion's number, m/s; 0 where the number is none of the path."""
        if form.word == "J" or form.unit not in UNITS:
            return 0.0
        override = known(self.override, "the override", routine.listing.place(statement.start), text=statement.code,
                         hint="Write OVERRIDE=100%")  # fmt: skip
        return UNITS[form.unit] * float(cast("float", override))

    def feed_m_s(self, form: MotionForm, way_m: float, routine: TpRoutine, statement: TpStatement) -> float:
        """Speed along the path of a motion, m/s; 0 of J, and of max_speed.

        Args:
            way_m: Its length, for speeds by time.

        Raises:
            ProgramError: It is not known, or out of range.
        """
        if form.word == "J" or not form.unit:
            return 0.0
        where = routine.listing.place(statement.start)
        value = known(self._value(form.speed, routine, statement), "the speed of a motion", where,
                      text=statement.code, hint="Write the speed itself, the force depends on it")  # fmt: skip
        number = float(value) if is_number(value) else 0.0  # type: ignore[arg-type]
        if form.unit in ("sec", "msec"):
            override = float(cast("float", known(self.override, "the override", where)))
            time_s = number * (1.0 if form.unit == "sec" else 1e-3)
            feed = way_m / time_s * override if time_s > 0.0 else 0.0
        else:
            feed = number * self.unit_m_s(form, routine, statement)
        limit = known(self.linear_max_m_s, "the largest speed along the path", where)
        feed = min(feed, float(cast("float", limit)))
        if not 0.0 < feed <= _LARGEST_M_S:
            raise fault(routine.listing, statement, "the speed is no speed along the path in range",
                        limit=f"above 0, at most {_LARGEST_M_S / MM_PER_S:g} mm/sec; mm/sec, cm/min, inch/min, sec",
                        hint="Write it in mm/sec: deg/sec and % tell none")  # fmt: skip
        return feed

    # ---- values --------------------------------------------------------------------------------------------

    def _value(self, text: str, routine: TpRoutine, statement: TpStatement) -> Value:
        try:
            return float(text)
        except ValueError:
            pass
        try:
            return self.values.evaluate(plain_code(text))
        except ExpressionError as error:
            raise fault(routine.listing, statement, str(error), hint="Post the program again") from error

    def _number(self, text: str, routine: TpRoutine, statement: TpStatement) -> int:
        where = routine.listing.place(statement.start)
        value = known(self._value(text, routine, statement), "the number of a position", where, text=statement.code,
                      hint="Write the number itself")  # fmt: skip
        if not is_number(value) or not float(value).is_integer():  # type: ignore[arg-type]
            raise fault(routine.listing, statement, "the number of a position is not whole", hint="Write it itself")
        return int(value)  # type: ignore[call-overload, no-any-return]


def _added(T: Float, value: Value, name: str, where: str) -> Float:
    """The sum of two positions, component by component."""
    # Source: Offset,PR adds X Y Z W P R each in the active user frame (measured in ROBOGUIDE, R-2000iC, by others).
    matrix_of(value, name, where)
    components = position_of(T)
    added = {letter: float(cast("float", components[letter])) + float(cast("Mapping[str, float]", value)[letter])
             for letter in LETTERS}  # fmt: skip
    return frame_of(added)
