"""Makes the motions of a VAL3 program as it runs."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, cast

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG, MM_PER_S
from counterflex.geometry import pose
from counterflex.integrations.staubli.language.program import Key, Val3Motion
from counterflex.integrations.staubli.language.read import values as val3
from counterflex.integrations.staubli.language.read.program_file import Val3Routine, arguments
from counterflex.integrations.staubli.language.read.store import Bound, Store
from counterflex.programs.expression import ExpressionError, Value, is_number
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.program import Word
from counterflex.programs.robot_text.cell import RobotTextCell
from counterflex.programs.robot_text.execution import Away, ExecutionByAxes, slowed_by_turning
from counterflex.programs.unknown import Unknown, first_unknown, known

_FASTEST_MM_S: Final = 20_000.0  # A speed limit from here on limits nothing: the robot runs as fast as its axes
_COUNT: Final = {"movej": 3, "movel": 3, "movec": 4}
_AWAY: Final = "such places before the first target and behind the last one"


@dataclass(frozen=True, kw_only=True)
class Val3Cell(RobotTextCell):
    """Data of a cell that a VAL3 program is read against."""

    tool_of_data: Mapping[str, int]  # Number of the tool by the name of its tool variable (``tools.tooldata``)


@dataclass
class _Spindle:
    tool: int = 0


@dataclass(frozen=True, slots=True)
class _Target:
    """An end of a motion: a place in a frame, or axes."""

    T_father_tool: Float | None
    father: str = ""
    literal: Key | None = None
    attributes: Mapping[str, str] | None = None
    axes: tuple[float, ...] = ()


class Val3MotionExecution(ExecutionByAxes[Val3Motion]):
    """Motions of a program, with the state that they depend on.

    Args:
        store: Variables.
        cell: What frames and process words are checked against; None takes the frame of the first point for the part
            frame.
    """

    def __init__(self, store: Store, cell: Val3Cell | None) -> None:
        self._spindle = _Spindle()
        super().__init__(self._spindle)
        self.store, self.cell = store, cell
        self.uses: Counter[Key] = Counter()  # How often each point of the data file is a target
        self.settled: tuple[str, int] | None = ("", -1)  # waitEndMove() behind the last motion; none while it moves
        self._first_father: tuple[str, Float | None] | None = None
        self._frames: dict[tuple[str, int], Float] = {}
        self._tools: dict[tuple[Key, int], Float] = {}
        self._speeds: dict[tuple[Key, int], tuple[float, bool, dict[str, str]]] = {}

    def motion(self, routine: Val3Routine, at: int, word: str, start: int) -> None:
        """Make a motion.

        Args:
            at: Index of the line.
            word: ``movej movel movec``.
            start: Index behind its opening bracket in the code.

        Raises:
            ProgramError: Its end, tool or speed is not known.
        """
        code, line = routine.codes[at], routine.lines[at]
        close = code.rfind(")")
        places = arguments(code, start, close)
        if close < 0 or code[close + 1 :].strip() or len(places) != _COUNT[word]:
            raise routine.fault(at, f"{word} has {_COUNT[word]} arguments", limit="movel(point,tool,mdesc)")
        offset = routine.starts[at] + max(line.find(code), 0)
        *points, tool, speed = ((code[a:b], (offset + a, offset + b)) for a, b in places)
        self.settled = None
        target = self._target(points[-1][0], routine, at, word)
        R_tcp_tool = self._tool(tool[0], routine, at)
        feed, exact, attributes = self._speed(speed[0], routine, at)
        place: dict[str, Any] = {
            "line": at + 1, "word": word, "start": offset + code.index(word), "head": routine.starts[at],
            "R_tcp_tool": R_tcp_tool, "file": routine.name,
        }  # fmt: skip
        if target.T_father_tool is None:
            tip = None if self.cell is None else self.cell.tip_of_axes
            T = None if tip is None else tip(target.axes, {})
            self.leave(Val3Motion(**place), T, routine.place(at), axes_deg=target.axes)
            return
        self.arrive(lambda away: self._refuse_away(away, routine, at))
        T_part_father = self._father(target.father, routine, at)
        T = T_part_father @ target.T_father_tool
        R = T[:3, :3] @ R_tcp_tool.T
        self.straight(len(self._blocks) - 1, T[:3, 3], R, 0.0 if word == "movej" else feed)
        literals = [target.literal]
        if word == "movec":
            auxiliary = self._target(points[0][0], routine, at, word)
            self._circle(auxiliary, routine, at)
            literals.append(auxiliary.literal)
        self._slow(attributes)
        self._words += [Word(c, float(v) * 1e3, 0, 0) for c, v in zip("XYZ", T[:3, 3], strict=True)]
        self.uses.update(key for key in literals if key is not None)
        self.moves.append(Val3Motion(
            **place, T_part_frame=T_part_father, T_frame_tool=target.T_father_tool,
            attributes=target.attributes or {}, point=target.literal, named=points[-1][1],
            auxiliary=literals[1] if word == "movec" else None, auxiliary_named=points[0][1], tool=tool[0],
            speed=attributes, speed_named=speed[1], exact=exact,
        ))  # fmt: skip

    def _slow(self, attributes: Mapping[str, str]) -> None:
        """Give the last motion the speed that its turn leaves."""
        if len(self.motions) > 1 and "rmax" in attributes:
            turning = [float(attributes["rmax"]) * DEG]
            self.motions[-1] = slowed_by_turning(self.motions[-1], self.rotations[-2:], turning)

    def _circle(self, auxiliary: _Target, routine: Val3Routine, at: int) -> None:
        if auxiliary.T_father_tool is None:
            raise routine.fault(at, "axis angles are no point of a circle", limit="a point")
        T = self._father(auxiliary.father, routine, at) @ auxiliary.T_father_tool
        self.circle(T[:3, 3], lambda what, hint: routine.fault(at, what, hint=hint))
        if self.motions[-1].kind == "arc" and self.motions[-1].feed_m_s <= 0.0:
            raise routine.fault(at, "a circle without a speed limit of its mdesc", limit="tmax in mm/s")

    # ---- targets -------------------------------------------------------------------------------------------

    def _value(self, text: str, routine: Val3Routine, at: int) -> Value:
        try:
            return self.store.evaluate(text)
        except ExpressionError as error:
            raise routine.fault(at, f"{text} is not understood: {error}", hint="Post the program again") from error

    def _stored(self, text: str, routine: Val3Routine, at: int) -> tuple[Key | None, Value]:
        """Value of an expression, and its place in the data file where it stands there as it is."""
        try:
            literal = self.store.literal(text)
        except ExpressionError as error:
            raise routine.fault(at, f"{text} is not understood: {error}", hint="Post the program again") from error
        if literal is None:
            return None, self._value(text, routine, at)
        key, (cells, _) = literal
        value, data, changed = cells.get(key[1]), cells.data, key[1] in cells.changed
        if data is None:
            return None, value
        name = cells.name.rpartition(":")[2]
        if cells.kind.startswith("point") and not changed and key[1] not in data.variables[name].values:
            value = Unknown(f"the data file has no {key[0]}[{key[1]}]")
        return None if changed or ":" in cells.name else key, value

    def _target(self, text: str, routine: Val3Routine, at: int, word: str) -> _Target:
        key, value = self._stored(text, routine, at)
        if key is None or isinstance(value, Unknown):
            known(value, f"the place of {text}", routine.place(at), text=routine.codes[at],
                  hint="Give .pgx and .dtx in one folder, or write the target itself")  # fmt: skip
        joint = val3.joint_of(value)
        if joint is not None:
            if word != "movej":
                raise routine.fault(at, "axis angles are no target of a path", limit="a pointRx")
            return _Target(None, axes=tuple(float(cast("float", joint[name])) for name in val3.JOINTS))
        if not isinstance(value, Mapping) or val3.TRSF not in value or val3.CONFIG not in value:
            raise routine.fault(at, f"{text} is no point", limit="a pointRx of the data file")
        father = str(value[val3.FATHER])
        attributes = {name: str(one) for name, one in cast("Mapping[str, Value]", value[val3.CONFIG]).items() if one}
        return _Target(val3.matrix(value), father, key, {**attributes, "fatherId": father})

    def _refuse_away(self, away: Away[Val3Motion], routine: Val3Routine, at: int) -> ProgramError:
        return routine.fault(
            at, f"the robot comes from a place that is not known, by axes (line {away.move.line})", limit=_AWAY,
            hint="Give that place as a point, or post each part as a program of its own",
        )  # fmt: skip

    def _father(self, father: str, routine: Val3Routine, at: int) -> Float:
        """(4, 4) m of a frame in the part frame."""
        key = (father, self.store.version)
        if key not in self._frames:
            self._frames[key] = self._in_part(father, routine, at)
        return self._frames[key]

    def _in_part(self, father: str, routine: Val3Routine, at: int) -> Float:
        self.store.where = f"{routine.name}:{at + 1}"
        if self.cell is None:
            return self._in_first(father, routine, at)
        T, name = np.eye(4), father
        fault: ProgramError | None = None
        while True:
            value = self.store.frame(name)
            T_world = np.eye(4) if value is None else self.store.place(value)
            try:
                self.cell.refuse_other_part_frame(T_world, f"the frame {name.partition('[')[0]}", self.store.where)
            except ProgramError as error:
                fault = fault or error
            else:
                return T
            if not isinstance(value, Mapping):
                raise fault
            T, name = val3.matrix(value) @ T, str(value[val3.FATHER])

    def _in_first(self, father: str, routine: Val3Routine, at: int) -> Float:
        """A frame in that of the first point, of a program that no cell tells the part frame of."""
        T: Float | None
        try:
            value = self.store.frame(father)
            T = np.eye(4) if value is None else self.store.place(value)
        except ProgramError:
            if self.store.bound(father.partition("[")[0]) is not None:
                raise
            T = None  # of a library that is not there
        if self._first_father is None:
            self._first_father = (father, T)
        first, T_first = self._first_father
        if T is None and T_first is None and father == first:
            return np.eye(4)
        if T is None or T_first is None:
            raise routine.fault(at, f"where the frame {father} stands in {first} is not known",
                                limit="points in one frame", hint="Write both frames into the data file")  # fmt: skip
        out: Float = pose.inverse(T_first) @ T
        return out

    # ---- tools and speeds ----------------------------------------------------------------------------------

    def _tool(self, text: str, routine: Val3Routine, at: int) -> Float:
        """Orientation (3, 3) of a tool in the TCP frame of the cell; sets the tool in the spindle by its name."""
        cell = self.cell
        literal = self.store.literal(text)
        key: Key = (text.partition("[")[0].strip(), 0) if literal is None else literal[0]
        name = key[0]
        changed = literal is not None and key[1] in literal[1][0].changed
        if cell is None and not changed:
            if literal is not None or name != "flange":
                self._spindle.tool = self._spindle.tool or 1
            return np.eye(3)
        number_of = {} if cell is None else cell.tool_of_data
        tool = number_of.get(name, number_of.get(f"{name}[{key[1]}]", 0))
        self._spindle.tool = tool or self._spindle.tool or (1 if cell is None else cell.only_tool)
        if tool and literal is None:
            return np.eye(3)
        state = (key, self.store.version)
        if state not in self._tools:
            self._tools[state] = self._evaluated_tool(text, name, literal, routine, at)
        return self._tools[state]

    def _evaluated_tool(
        self, text: str, name: str, literal: tuple[Key, Bound] | None, routine: Val3Routine, at: int
    ) -> Float:
        """Orientation (3, 3) of a tool of the data file in the TCP frame of the cell."""
        self.store.where = where = f"{routine.name}:{at + 1}"
        value: Value = Unknown(f"{name} is in no data file of the application")
        if literal is not None:
            (_, index), (cells, _) = literal
            value = cells.get(index)
        known(value, f"the tool {text}", routine.place(at), text=routine.codes[at],
              hint="Write it into the data file, or name it in tools.tooldata of the cell file")  # fmt: skip
        T = self.store.place(value) if name != "flange" else np.eye(4)
        return np.eye(3) if self.cell is None else self.cell.R_tcp_tool(T, text, where)

    def _speed(self, text: str, routine: Val3Routine, at: int) -> tuple[float, bool, dict[str, str]]:
        """Speed in m/s (0: as fast as the axes), whether it stops, and the attributes of its mdesc."""
        literal = self.store.literal(text)
        if literal is None or literal[1][0].data is None:
            return self._speed_of(text, routine, at)
        state = (literal[0], self.store.version)
        if state not in self._speeds:
            self._speeds[state] = self._speed_of(text, routine, at)
        return self._speeds[state]

    def _speed_of(self, text: str, routine: Val3Routine, at: int) -> tuple[float, bool, dict[str, str]]:
        value = self._value(text, routine, at)
        if isinstance(value, Unknown):
            known(value, f"the speed {text}", routine.place(at), text=routine.codes[at],
                  hint="Write its numbers into the data file")  # fmt: skip
        if not isinstance(value, Mapping) or "tvel" not in value:
            raise routine.fault(at, f"which speed {text} is, is not known", limit="an mdesc of the data file",
                                hint="Write its numbers into the data file")  # fmt: skip
        used = {name: value[name] for name in ("tvel", "blend")}
        known(used, f"the speed of a motion ({text})", routine.place(at), text=routine.codes[at],
              hint="Write the speed itself, the force depends on it")  # fmt: skip
        speed = value["tvel"]
        if not is_number(speed) or not float(cast("float", speed)) > 0.0:
            raise routine.fault(at, "the speed is out of range", limit="above 0 mm/s")
        mm_s = float(cast("float", speed))
        feed = 0.0 if mm_s >= _FASTEST_MM_S else mm_s * MM_PER_S
        attributes = {
            val3.SPEED_FIELDS[name]: one if isinstance(one, str) else _short(cast("float", one))
            for name, one in value.items() if first_unknown(one) is None
        }  # fmt: skip
        return feed, str(value["blend"]).lower() == "off", attributes

    # ---- waits ---------------------------------------------------------------------------------------------

    def wait_end(self, routine: Val3Routine, at: int) -> None:
        """The robot comes to rest at the end of the last motion."""
        self.settled = (routine.name, at)
        self.end_exactly()

    def end_exactly(self) -> None:
        """Mark the last motion as one that ends at rest, where it is no motion by axes."""
        if not self.away and self.moves and self.moves[-1].T_frame_tool is not None:
            self.moves[-1] = replace(self.moves[-1], exact=True)

    def wait(self, routine: Val3Routine, at: int, time_s: float) -> None:
        """A wait, where the robot has come to rest before it; else the program waits while the robot runs on."""
        if self.settled is None or self.settled[1] < 0:
            return
        head = routine.starts[self.settled[1]] if self.settled[0] == routine.name else routine.starts[at]
        self.rest(
            Val3Motion(line=at + 1, word="delay", start=head, head=head, R_tcp_tool=np.eye(3), file=routine.name),
            time_s,
        )


def _short(value: float) -> str:
    return re.sub(r"\.?0+$", "", number(float(value), 5)) if "." in number(float(value), 5) else number(value, 5)
