"""Instructions of RAPID beside motions that are evaluated: data, speed, displacement, waits, interrupts."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.geometry import pose
from counterflex.integrations.abb.language.program import RapidMotion
from counterflex.integrations.abb.language.read.arithmetic import matrix, pose_inverse, pose_product
from counterflex.integrations.abb.language.read.effects import Effects, EffectsOf
from counterflex.integrations.abb.language.read.literals import CallArgument
from counterflex.integrations.abb.language.read.memory import RapidMemory, Reference
from counterflex.integrations.abb.language.read.motions import RapidMotions
from counterflex.integrations.abb.language.read.routines import Modules, RapidRoutine
from counterflex.integrations.abb.language.read.scanner import RapidStatement
from counterflex.integrations.abb.language.table import CYCLIC, TABLE
from counterflex.programs.expression import is_number
from counterflex.programs.unknown import Unknown, known

_CONNECT: Final = re.compile(r"CONNECT\s+(\w+)\s+WITH\s+(\w+)\s*", re.IGNORECASE)


class Instructions(RapidMotions):
    """Evaluates instructions; mixed into the interpreter."""

    memory: RapidMemory
    modules: Modules
    effects: EffectsOf
    _running: list[RapidRoutine]

    @abstractmethod
    def fault(self, what: str, statement: RapidStatement, **more: str) -> ProgramError:
        """Make an error of a statement."""

    @abstractmethod
    def assigned_by(self, effects: Effects) -> Iterator[Reference]:
        """Return the data that statements assign something to, as their own routines see them."""

    def _given(self, statement: RapidStatement, given: Sequence[CallArgument], count: int) -> list[object]:
        """Values of the arguments of an instruction."""
        if len(given) != count:
            raise self.fault(f"{statement.word} has {count} arguments", statement, hint="Post the program again")
        values = [self.memory.evaluated(argument.text, argument.start) for argument in given]
        where = self.source.place(statement.start)
        return known(values, f"what {statement.code.split()[0]} sets", where, text=statement.code)

    def _changed(self, statement: RapidStatement, argument: CallArgument) -> Reference | None:
        try:
            return self.memory.reference(self.memory.node(argument.text, argument.start))
        except ValueError as fault:
            raise self.fault(f"this cannot be changed: {fault}", statement, hint="Check names and indices") from fault

    # ---- data ------------------------------------------------------------------------------------------------

    def _change(self, statement: RapidStatement, given: Sequence[CallArgument], by: object) -> None:
        reference = self._changed(statement, given[0])
        if reference is None:
            return
        value = reference.value()
        lost = next((item for item in (by, value) if isinstance(item, Unknown)), None)
        if lost is not None:
            self.memory.forget(reference, lost)
        elif is_number(value) and is_number(by):
            self.memory.assign(reference, value + by)  # type: ignore[operator]
        else:
            raise self.fault("only numbers are counted", statement, hint="Check the type of the data")

    def incr(self, statement: RapidStatement, given: Sequence[CallArgument]) -> None:
        """``Incr n``."""
        self._change(statement, given, 1)

    def decr(self, statement: RapidStatement, given: Sequence[CallArgument]) -> None:
        """``Decr n``."""
        self._change(statement, given, -1)

    def add(self, statement: RapidStatement, given: Sequence[CallArgument]) -> None:
        """``Add n, 5``."""
        if len(given) != 2:
            raise self.fault("Add has 2 arguments", statement, hint="Post the program again")
        self._change(statement, given, self.memory.evaluated(given[1].text, given[1].start))

    def clear(self, statement: RapidStatement, given: Sequence[CallArgument]) -> None:
        """``Clear n``."""
        reference = self._changed(statement, given[0])
        if reference is not None:
            self.memory.assign(reference, 0)

    def bit(self, statement: RapidStatement, given: Sequence[CallArgument]) -> None:
        """``BitSet data, 3``, ``BitClear data, 3``."""
        reference = self._changed(statement, given[0])
        if reference is None or len(given) != 2:
            return
        value, number = reference.value(), self.memory.evaluated(given[1].text, given[1].start)
        if not (is_number(value) and is_number(number)):
            self.memory.forget(reference, Unknown(f"{statement.word} of an unknown value", self._line(statement)))
            return
        mask = 1 << int(number) - 1  # type: ignore[call-overload]
        old = int(value)  # type: ignore[call-overload]
        self.memory.assign(reference, old | mask if statement.word == "BITSET" else old & ~mask)

    # ---- waits -----------------------------------------------------------------------------------------------

    def wait(self, statement: RapidStatement, given: Sequence[CallArgument]) -> None:
        r"""``WaitTime 0.5``, ``WaitTime\InPos,0.5``."""
        argument = next((one for one in given if one.text), None)
        if argument is None:
            raise self.fault("a wait without its time", statement, hint="Write the time in s: WaitTime 0.5")
        value = self.memory.evaluated(argument.text, argument.start)
        time_s = known(value, "the time of a wait", self.source.place(argument.start), text=statement.code)
        if not is_number(time_s) or time_s < 0.0:  # type: ignore[operator]
            raise self.fault("the time of a wait is no number of 0 or more", statement, hint="Write it in s")
        if self.dwell(len(self._blocks) - 1, float(time_s)):  # type: ignore[arg-type]
            self.moves.append(
                RapidMotion(
                    statement.line, "WaitTime", self._call, statement.start, statement.end, np.eye(3),
                    guard=None if self.guard is None else self.guard.end + 1,
                )
            )  # fmt: skip

    # ---- speed -----------------------------------------------------------------------------------------------

    def vel_set(self, statement: RapidStatement, given: Sequence[CallArgument]) -> None:
        """``VelSet 50, 800``: override in per cent, and the largest speed in mm/s."""
        override, largest = self._given(statement, given, 2)
        if not is_number(override) or not is_number(largest) or not 0.0 < override <= 100.0 or not largest > 0.0:  # type: ignore[operator]
            raise self.fault("VelSet is out of range", statement, limit="above 0, at most 100 %", hint="VelSet 100,800")
        self.override, self.largest_m_s = float(override) / 100.0, float(largest) * MM  # type: ignore[arg-type]

    def speed_refresh(self, statement: RapidStatement, given: Sequence[CallArgument]) -> None:
        """``SpeedRefresh 100``: any other value acts in the middle of a motion."""
        (value,) = self._given(statement, given, 1)
        if value != 100:
            raise self.fault(
                "SpeedRefresh changes the speed in the middle of a motion", statement, limit="SpeedRefresh 100",
                hint="Write the speeds themselves: the force depends on them",
            )  # fmt: skip

    # ---- displacement ----------------------------------------------------------------------------------------

    def displacement_pose(self) -> list[list[float]] | None:
        """Return the displacement of the program as ``[[x,y,z],[q1,q2,q3,q4]]``; None where there is none."""
        return self._displacement

    def displacement(self) -> Float | None:
        """Return the displacement of the program, (4, 4) m."""
        if self._displacement is None:
            return None
        p, q = self._displacement
        return pose.make(matrix(q), np.array(p, dtype=float) * MM)

    def pdisp_set(self, statement: RapidStatement, given: Sequence[CallArgument]) -> None:
        """``PDispSet pose``: the targets behind it lie in that frame of the work object."""
        (value,) = self._given(statement, given, 1)
        if not _is_pose(value):
            raise self.fault("PDispSet needs a pose", statement, limit="[[x,y,z],[q1,q2,q3,q4]]", hint="Write it")
        self._displacement = value  # type: ignore[assignment]

    def pdisp_on(self, statement: RapidStatement, given: Sequence[CallArgument]) -> None:
        r"""``PDispOn \Rot \ExeP:=p2, p1, tool``: moves p1 to p2, and turns it with Rot."""
        options = {key: item for argument in given for key, item in argument.options.items()}
        points = [argument for argument in given if argument.text]
        if "EXEP" not in options or len(points) != 2 or self._displacement is not None:
            raise self.fault(
                "PDispOn measures from where the robot stands, or adds to another displacement", statement,
                limit=r"PDispOn \ExeP:=p2, p1, tool behind PDispOff",
                hint="Write PDispSet with the displacement itself",
            )  # fmt: skip
        text, start, _ = options["EXEP"]
        where = self.source.place(statement.start)
        values = [self.memory.evaluated(text, start), self.memory.evaluated(points[0].text, points[0].start)]
        there, here = (value[:2] if isinstance(value, list) else value for value in values)
        there, here = known([there, here], "the displacement", where, text=statement.code)
        if not (_is_pose(there) and _is_pose(here)):
            raise self.fault("PDispOn needs robtargets", statement, hint="Write the targets themselves")
        if "ROT" in options:
            self._displacement = pose_product(there, pose_inverse(here))  # type: ignore[arg-type]
        else:
            p = [a - b for a, b in zip(there[0], here[0], strict=True)]  # type: ignore[index]
            self._displacement = [p, [1.0, 0.0, 0.0, 0.0]]

    def pdisp_off(self, statement: RapidStatement, given: Sequence[CallArgument]) -> None:
        """``PDispOff``."""
        del statement, given
        self._displacement = None

    def eoffs_set(self, statement: RapidStatement, given: Sequence[CallArgument]) -> None:
        """``EOffsSet``: displaces external axes, which stand still in the cut."""
        (value,) = self._given(statement, given, 1)
        if not isinstance(value, list) or any(is_number(item) and 0.0 < abs(item) < 8e8 for item in value):
            raise self.fault(
                "EOffsSet moves external axes", statement, limit="offsets of 0",
                hint="External axes stand still in the cut: [[external_axes]] of the cell file says where",
            )  # fmt: skip

    # ---- interrupts ------------------------------------------------------------------------------------------

    def connect(self, statement: RapidStatement, given: Sequence[CallArgument]) -> None:
        """``CONNECT n WITH trap``: what the trap assigns may change at any time behind it."""
        del given
        match = _CONNECT.fullmatch(statement.code)
        trap = None if match is None else self.modules.find(match[2], self._running[-1].module)
        if trap is None:
            raise self.fault(
                "the interrupt routine is not in the files of the program, and may move the robot", statement,
                hint="Put its module into the folder of the program",
            )  # fmt: skip
        effects = self.effects.of_routine(trap)
        if effects.matters is not None:
            raise self.fault(
                f"the interrupt {trap.name} may move the robot or change how it moves at any time "
                f"({self.source.where(effects.matters.start)})", statement,
                hint="Post the path without this interrupt",
            )  # fmt: skip
        unknown = Unknown(f"the interrupt {trap.name} may change it at any time", self._line(statement))
        for reference in self.assigned_by(effects):
            self._volatile(reference, unknown)

    def cyclic(self, statement: RapidStatement, given: Sequence[CallArgument]) -> None:
        """Instructions that let the controller write into a variable from here on."""
        del given
        row = TABLE.find(statement.word)
        word = statement.word if row is None else row.word
        unknown = Unknown(f"{word} may change it at any time", self._line(statement))
        for position, _, name in statement.names_given():
            reference = self.memory.find(name) if position == CYCLIC[statement.word] else None
            if reference is not None:
                self._volatile(reference, unknown)

    def _volatile(self, reference: Reference, unknown: Unknown) -> None:
        """Data that may change at any time."""
        reference.variable.volatile = unknown
        self.memory.stamp += 1

    def _line(self, statement: RapidStatement) -> str:
        return self.source.where(statement.start)


def _is_pose(value: object) -> bool:
    if not isinstance(value, list) or [len(part) if isinstance(part, list) else 0 for part in value] != [3, 4]:
        return False
    return all(is_number(part) for item in value for part in item) and any(value[1])


Handler = Callable[[Instructions, RapidStatement, Sequence[CallArgument]], None]
HANDLERS: Final[dict[str, Handler]] = {
    "INCR": Instructions.incr, "DECR": Instructions.decr, "ADD": Instructions.add, "CLEAR": Instructions.clear,
    "BITSET": Instructions.bit, "BITCLEAR": Instructions.bit, "WAITTIME": Instructions.wait,
    "VELSET": Instructions.vel_set, "SPEEDREFRESH": Instructions.speed_refresh, "PDISPSET": Instructions.pdisp_set,
    "PDISPON": Instructions.pdisp_on, "PDISPOFF": Instructions.pdisp_off, "EOFFSSET": Instructions.eoffs_set,
    "CONNECT": Instructions.connect, **dict.fromkeys(CYCLIC, Instructions.cyclic),
}  # fmt: skip
"""Instructions beside motions that are evaluated, by name in capitals."""
