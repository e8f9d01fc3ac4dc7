"""Motions of RAPID: their arguments, options, speeds and displacements, and what comes of them."""

from __future__ import annotations

import math
import re
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.geometry import pose
from counterflex.integrations.abb.language.program import RapidMotion, RapidTarget, RoutineCall
from counterflex.integrations.abb.language.read.arithmetic import matrix
from counterflex.integrations.abb.language.read.effects import EffectsOf
from counterflex.integrations.abb.language.read.frames import RapidCell, RapidFrames
from counterflex.integrations.abb.language.read.literals import CallArgument, arguments
from counterflex.integrations.abb.language.read.memory import RapidMemory
from counterflex.integrations.abb.language.read.routines import Modules, RapidRoutine
from counterflex.integrations.abb.language.read.scanner import RapidSource, RapidStatement
from counterflex.integrations.abb.language.read.targets import RapidTargets, Speed
from counterflex.integrations.abb.language.table import FORMS, RapidForm
from counterflex.programs.expression import Value, is_number
from counterflex.programs.program import Modal, Word
from counterflex.programs.robot_text.execution import Execution, slowed_by_turning
from counterflex.programs.robot_text.process_words import NUMBER
from counterflex.programs.unknown import first_unknown, known

_PLAIN: Final = re.compile(
    rf"\w+\s+(\[.*\]|[A-Za-z]\w*)\s*,\s*([A-Za-z]\w*)(?:\s*\\V\s*:=\s*({NUMBER}))?\s*,\s*([A-Za-z]\w*)\s*,"
    r"\s*([A-Za-z]\w*)\s*(?:\\WObj\s*:=\s*([A-Za-z]\w*))?\s*",
    re.IGNORECASE,
)
"""A straight motion without other options: the form of nearly all of them, read at once."""
_TRIGGERS: Final = frozenset(f"T{number}" for number in range(2, 9))
_SPEED_OPTIONS: Final = frozenset(("V", "T", "TRIGGDATA1", "TRIGGDATA2", "TRIGGDATA3"))
_LEAST_M: Final = 1e-9
_AXES: Final = 6


class RapidMotions(Execution):
    """Makes motions; mixed into the interpreter.

    Attributes:
        override: Factor of VelSet on the speed.
        largest_m_s: Largest speed of VelSet.
    """

    source: RapidSource
    memory: RapidMemory
    modules: Modules
    targets: RapidTargets
    frames: RapidFrames
    effects: EffectsOf
    cell: RapidCell | None
    _running: list[RapidRoutine]

    def __init__(self, in_spindle: RapidFrames) -> None:
        super().__init__(in_spindle)
        self.moves: list[RapidMotion] = []  # What stands behind each motion in the text
        self.calls: list[RoutineCall] = []  # Executions of routines
        self.override, self.largest_m_s = 1.0, math.inf
        self.guard: RapidStatement | None = None  # Compact IF that the statement stands in, or None
        self.now = RapidStatement(0, 0, "", 1, False)  # The statement that is executed
        self._call = -1
        self._displacement: list[list[float]] | None = None
        self._away: list[tuple[RapidStatement, Float | None, int, list[float], object]] = []
        self._states: dict[tuple[str, int, float], Modal] = {}
        self._rotations: dict[tuple[float, ...], Float] = {}

    @abstractmethod
    def fault(self, what: str, statement: RapidStatement, **more: str) -> ProgramError:
        """Make an error of a statement."""

    @abstractmethod
    def displacement(self) -> Float | None:
        """Return the displacement of the program, (4, 4) m."""

    def state(self, motion: str) -> Modal:
        """Return the modal state of a block."""
        key = (motion, self.frames.tool, self._rpm)
        if key not in self._states:
            self._states[key] = self.modal(motion)
        return self._states[key]

    def finish(self) -> None:
        """Mark the targets whose data other places use too, which is known at the end of the program."""
        for index, move in enumerate(self.moves):
            given = (move.target, move.auxiliary)
            ends = [
                replace(target, shared=True) if target is not None and self.targets.shared(target) else target
                for target in given
            ]
            if ends[0] is not given[0] or ends[1] is not given[1]:
                self.moves[index] = replace(move, target=ends[0], auxiliary=ends[1])

    # ---- instructions ----------------------------------------------------------------------------------------

    def motion(self, statement: RapidStatement, word: str) -> None:
        """Make the motion of an instruction. Raises ProgramError: something about it is not known."""
        form = FORMS[word]
        if word in ("MOVEABSJ", "TRIGGABSJ", "MOVEEXTJ"):
            self._by_axes(statement, word)
            return
        points, speed, zone, tool = self._arguments(statement, form)
        frame = tool.options.get("WOBJ", ("wobj0", tool.start, tool.end))[0]
        R_tcp_tool, T_object = self.frames.use(tool.text, frame, tool.start)
        D = self.displacement()
        if D is not None:
            T_object = D if T_object is None else T_object @ D
        self._arrive(statement)
        target = self.targets.target(points[-1])
        auxiliary = self.targets.target(points[0]) if len(points) > 1 else None
        at = Speed(0.0) if form.by_axes else self.targets.speed(speed)
        zone_given = self.targets.zone(zone)
        feed, limited = self._feed(at)
        p, R = self._placed(target, T_object)
        self.straight(len(self._blocks) - 1, p, R @ R_tcp_tool.T, feed)
        if auxiliary is not None:
            p_via, _ = self._placed(auxiliary, T_object)
            self.circle(p_via, lambda what, hint: self.fault(what, statement, hint=hint))
        if len(self.motions) > 1:
            self._last_speed(statement, at)
        self._words += [Word(letter, value, 0, 0) for letter, value in zip("XYZ", target.position_mm, strict=True)]
        guard = None if self.guard is None else self.guard.end + 1
        self.moves.append(
            RapidMotion(
                statement.line, statement.code[: len(word)], self._call, statement.start, statement.end, R_tcp_tool,
                target, auxiliary, (speed.start, speed.end), at.value, (zone.start, zone.behind), zone_given.exact,
                (tool.start, tool.behind), zone_given.rounding_m, at.time, limited, guard, T_object,
            )
        )  # fmt: skip

    def _arguments(
        self, statement: RapidStatement, form: RapidForm
    ) -> tuple[list[CallArgument], CallArgument, CallArgument, CallArgument]:
        """Points, speed, zone and tool of an instruction."""
        match = _PLAIN.fullmatch(statement.code) if form.plain else None
        if match is not None:
            start = statement.start
            target, speed, zone, tool = (
                CallArgument(match[i], start + match.start(i), start + match.end(i), {}, start + match.end(i))
                for i in (1, 2, 4, 5)
            )
            if match[3] is not None:
                place = (match[3], start + match.start(3), start + match.end(3))
                speed = replace(speed, options={"V": place}, behind=place[2])
            if match[6] is not None:
                place = (match[6], start + match.start(6), start + match.end(6))
                tool = replace(tool, options={"WOBJ": place}, behind=place[2])
            return [target], speed, zone, tool
        given = self._without_absent(arguments(self.source.code, statement.start + len(statement.word), statement.end))
        if not given[0].text and set(given[0].options) <= {"CONC"}:
            given = given[1:]
        count = form.points + 3 + form.triggers + form.behind
        if len(given) != count:
            raise self.fault(
                f"{statement.code[: len(statement.word)]} has {count} arguments", statement,
                limit="target, speed, zone, tool, separated by commas", hint="Post the program again",
            )  # fmt: skip
        points, rest = given[: form.points], given[form.points :]
        speed, zone, tool = rest[0], rest[1 + form.triggers], rest[2 + form.triggers]
        triggers = rest[1 : 1 + form.triggers]
        self._check_options([*points, *triggers], frozenset() if not triggers else _TRIGGERS)
        self._check_options([speed], _SPEED_OPTIONS)
        self._check_options([zone], frozenset(("Z", "INPOS")))
        self._check_options([tool], frozenset(("WOBJ", "TLOAD")))
        if form.routine:
            self._check_routine(rest[-1], statement)
        return points, speed, zone, tool

    def _without_absent(self, given: list[CallArgument]) -> list[CallArgument]:
        r"""Arguments without options that the caller of the routine left out (``\WObj?wobj``)."""
        absent = self.memory.frames[-1].absent
        if not absent:
            return given
        return [
            replace(one, options={key: item for key, item in one.options.items() if item[0].upper() not in absent})
            for one in given
        ]

    def _check_options(self, given: Sequence[CallArgument], known_options: frozenset[str]) -> None:
        """Refuse what options of targets, speed, zone and tool would change."""
        for argument in given:
            for key, (_, start, _) in argument.options.items():
                if key not in known_options:
                    raise ProgramError(
                        f"\\{key} is not read", where=self.source.place(start), value=argument.text[:60],
                        limit="\\V and \\T of the speed, \\Z and \\Inpos of the zone, \\WObj and \\TLoad of the tool",
                        hint="Post the path without it",
                    )  # fmt: skip

    def _check_routine(self, argument: CallArgument, statement: RapidStatement) -> None:
        """Refuse a routine that runs in the middle of a motion and matters to it (MoveLSync)."""
        name = known(
            self.memory.evaluated(argument.text, argument.start), "the routine", self.source.place(argument.start)
        )  # fmt: skip
        routine = self.modules.find(str(name), self._running[-1].module)
        if routine is None or self.effects.of_routine(routine).matters is not None:
            raise self.fault(
                f"the routine {name} runs in the middle of the motion", statement,
                limit="a routine of the program that moves nothing", hint="Call it behind the motion",
            )  # fmt: skip

    # ---- places, speeds --------------------------------------------------------------------------------------

    def _placed(self, target: RapidTarget, T_object: Float | None) -> tuple[Float, Float]:
        """Position (3,) m and orientation (3, 3) of a target in the part."""
        q = target.quat_wxyz
        R = self._rotations.get(q)
        if R is None:
            if len(self._rotations) > 1000:
                self._rotations.clear()
            R = self._rotations[q] = matrix(q)
        p: Float = np.array(target.position_mm) * MM
        if T_object is None:
            return p, R
        return pose.transform(T_object, p), T_object[:3, :3] @ R

    def _feed(self, speed: Speed) -> tuple[float, float]:
        """Speed of the tool tip, m/s, and the factor of VelSet in it; NaN where the time is given."""
        if speed.m_s <= 0.0:
            return 0.0, 1.0
        feed = speed.m_s * self.override
        return (min(feed, self.largest_m_s)), self.override

    def _last_speed(self, statement: RapidStatement, at: Speed) -> None:
        """Give the last motion the speed that its time, or its turn, means."""
        if at.time is not None:
            self._timed(statement, at.time_s)
            return
        turning = [at.turning_rad_s * self.override]
        self.motions[-1] = slowed_by_turning(self.motions[-1], self.rotations[-2:], turning)

    def _timed(self, statement: RapidStatement, time_s: float) -> None:
        """Give the last motion the speed that its time means."""
        motion = self.motions[-1]
        if motion.kind == "rapid":
            return
        length = motion.length_m
        if length < _LEAST_M:
            raise self.fault(
                "a turn on the spot in a given time has no speed of the tool tip", statement, hint="Write \\V"
            )  # fmt: skip
        self.motions[-1] = replace(motion, feed_m_s=length / time_s * self.override)

    # ---- by axes ---------------------------------------------------------------------------------------------

    def _by_axes(self, statement: RapidStatement, word: str) -> None:
        """``MoveAbsJ``: the place follows from the robot of the cell; ``MoveExtJ`` moves external axes alone."""
        given = arguments(self.source.code, statement.start + len(word), statement.end)
        given = [argument for argument in given if argument.text]
        if not given:
            raise self.fault(f"{word} without a target", statement, hint="Post the program again")
        place = self.source.place(given[0].start)
        value = self.memory.evaluated(given[0].text, given[0].start)
        parts = value if isinstance(value, list) and len(value) == 2 else None
        axes, external = (value, []) if parts is None else parts
        if word == "MOVEEXTJ":
            external = known(value if parts is None else external, "the place of the external axes", place)
            self.targets.check_external(external, given[0].start)
            return
        T, numbers = self._tip(axes, external)
        self._away.append((statement, T, len(self.by_axes), numbers, external))
        self.by_axes.append(len(self._blocks) - 1)

    def _tip(self, axes: Value, external: Value) -> tuple[Float | None, list[float]]:
        """Pose (4, 4) m of the tip at a place by axes, and the axes; None where the robot or a value is not known."""
        tip = None if self.cell is None else self.cell.tip_of_axes
        if tip is None or not isinstance(axes, list) or len(axes) != _AXES or first_unknown(axes) is not None:
            return None, []
        numbers = [float(axis) for axis in axes if is_number(axis)]
        return tip(numbers, self.targets.external.now | self.targets.external_of(external)), numbers

    def _arrive(self, statement: RapidStatement) -> None:
        """Make the motion by axes that came before, where the robot goes on from its end."""
        away, self._away = self._away, []
        if not away or not self.motions:
            return
        del self.by_axes[away[0][2] :]
        for before, T, _, axes, external in away:
            if T is None:
                raise self._refuse_away(before, statement)
            self.targets.check_external(external, before.start)
            self.axes_deg[len(self.motions)] = axes
            self.straight(len(self._blocks) - 1, T[:3, 3], T[:3, :3], 0.0)
            self.moves.append(
                RapidMotion(before.line, before.code.split()[0], self._call, before.start, before.end, np.eye(3))
            )

    def _refuse_away(self, before: RapidStatement, statement: RapidStatement) -> ProgramError:
        reason = "Give --cell" if self.cell is None else "Give that place as a robtarget"
        return self.fault(
            "the robot comes from a place that is not known, by axes "
            f"({self.source.where(before.start)})", statement,
            limit="MoveAbsJ before the first target and behind the last one",
            hint=f"{reason}, or post each part as a program of its own",
        )  # fmt: skip
