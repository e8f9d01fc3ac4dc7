"""Executes a KRL job: motions, waits, machine functions; see :mod:`.flow` for the order of its statements."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, RPM
from counterflex.geometry import pose
from counterflex.programs.expression import is_number
from counterflex.programs.krl.program import KrlMotion
from counterflex.programs.krl.read import statements as form
from counterflex.programs.krl.read.frames import KrlCell
from counterflex.programs.krl.read.job import Job, Routine
from counterflex.programs.krl.read.literals import code_of, number_of
from counterflex.programs.krl.read.modes import Modes
from counterflex.programs.krl.read.table import ACTING, TABLE
from counterflex.programs.krl.read.targets import Place, Targets
from counterflex.programs.krl.read.values import AXES, Value, record_of
from counterflex.programs.krl.with_clause import WithClause, WithFault, with_clause
from counterflex.programs.program import Motion, Word
from counterflex.programs.robot_text.process_words import ProcessWords
from counterflex.programs.statement_table import Treatment
from counterflex.programs.unknown import Unknown, known

_MOTIONS: Final = frozenset(
    ("PTP", "LIN", "CIRC", "SPTP", "SLIN", "SCIRC", "PTP_REL", "LIN_REL", "SLIN_REL", "SPTP_REL")
)
_WITH_MODES: Final = {"TOOL": "$TOOL", "BASE": "$BASE", "IPO_MODE": "$IPO_MODE", "ORI_TYPE": "$ORI_TYPE"}


@dataclass
class _Active:
    """Frames and modes while no value changes: ``changes`` of the memory, see :class:`KrlMotion` for the others.

    Attributes:
        changes: Number of changed values for which it holds.
        T_part_base: (4, 4) m; None where the base is the part frame.
        holds: $ORI_TYPE may be another than #VAR.
        distance_m: $APO.CDIS.
        feed_m_s: Path speed; None until a motion needs it.
        override: Share of it; None until a motion needs it.
    """

    changes: int
    T_part_base: Float | None
    holds: bool
    distance_m: float
    feed_m_s: float | None = None
    override: float | None = None


class Interpreter(Modes):
    """State of the controller while a job runs.

    Args:
        job: Its files.
        cell: See :class:`KrlCell`.
        complete: Refuse a text without END.

    Attributes:
        moves: What stands behind each motion in the text.
        loose: See :class:`~counterflex.programs.krl.program.KrlProgram`.
        reads_position: See there.
    """

    def __init__(self, job: Job, cell: KrlCell | None, *, complete: bool) -> None:
        super().__init__(job, cell, complete=complete)
        self.cell = cell
        self.targets = Targets(self.memory, self.value, cell)
        self.process = None if cell is None else ProcessWords(cell.functions, code_of)
        self.moves: list[KrlMotion] = []
        self.loose: dict[tuple[str, int], int] = {}
        self.memory.position = self._position
        self._statements_of: dict[str, tuple[list[str], list[int]]] = {}
        self._away: Unknown | None = None
        self._by_axes: list[tuple[int, Mapping[str, float], KrlMotion]] = []
        self._trigger: int | None = None
        self._spline: Value = None
        self._in_spline = False
        self._swallow = 0
        self._active: _Active | None = None
        self.reads_position = False

    def run(self) -> None:
        """Execute the main routine; then the uses of each name are known."""
        super().run()
        self.moves = [replace(move, shared=True) if self.targets.shared(move) else move for move in self.moves]

    # ---- statements ------------------------------------------------------------------------------------------

    def _statement(self, word: str, code: str) -> None:
        if form.HEADER.match(code):
            return
        if self._in_spline and word not in form.IN_SPLINE:
            raise self._fault(
                "this has no place in a spline block", code, limit="SLIN SCIRC TRIGGER ENDSPLINE",
                hint="The file may be damaged: post it again",
            )  # fmt: skip
        if word in _MOTIONS:
            self._motion(code)
        elif word == form.ASSIGNS or word[:1] == "$":
            self._assignment(word, code)
        elif word[:4] == "BAS ":
            self._basic(code)
        elif word in (form.DECLARES, "IMPORT", "SIGNAL"):
            self._declaration(code)
        elif word == form.CALLS:
            self._call_statement(code)
        else:
            self._by_row(word, code)

    def _by_row(self, word: str, code: str) -> None:
        """A statement by its row in the table."""
        row = TABLE.find(word) if word else None
        if row is None:
            raise self._fault(
                "an unknown statement", code, hint="docs/statements/krl.md lists what is read; post the path without it"
            )
        if row.treatment is Treatment.REFUSED:
            raise self._fault(row.reason, code, hint=row.remedy)
        if row.treatment is Treatment.NEUTRAL:
            self._note(word, code)
            return
        own = {
            "SPLINE": self._spline_begins, "ENDSPLINE": self._spline_ends, "WAIT SEC": self._wait, "HALT": self._halt,
            "TRIGGER WHEN DISTANCE": self._trigger_statement, "TRIGGER WHEN PATH": self._trigger_statement,
            "INTERRUPT DECL": self._interrupt,
        }.get(word)  # fmt: skip
        if own is None:
            raise self._fault("a routine begins before END", code, hint="The file may be damaged: post it again")
        own(code)

    def _note(self, word: str, code: str) -> None:
        """A statement that acts on the cell, which another language would lose."""
        if word.split(".")[0] in ACTING and not form.STANDARD.match(code):
            self.acting.append(self._main_line)

    def _halt(self, code: str) -> None:
        if self.memory.doubt is None:
            self._words = [*self._words, Word("M", 0.0, 0, 0)]
        else:
            self._note("HALT", code)

    def _certain(self, code: str, what: str) -> None:
        """Refuse a statement of which it is not known whether it is executed.

        Raises:
            ProgramError: It is not.
        """
        doubt = self.memory.doubt
        if doubt is not None:
            raise self._fault(
                f"{what}, and whether it is executed is not known: {doubt}", code,
                limit="conditions that follow from the text of the program",
                hint="Post the path without this condition",
            )  # fmt: skip

    # ---- machine functions -----------------------------------------------------------------------------------

    def _process(self, code: str) -> bool:
        if self._swallow:
            self._swallow -= 1
            return True
        if self.process is None:
            return False
        statements, index = self._statements()
        function = self.process.find(statements, index[self.line - 1], f"{self.module.file.name}:{self.line}")
        if function is None:
            return False
        self._certain(code, "the spindle, coolant or tool is switched")
        self.do(function)
        self._swallow = function.lines - 1
        return True

    def _statements(self) -> tuple[list[str], list[int]]:
        """Lines of the file that are no mere comments, and the index of each line among them."""
        name = self.module.file.name
        if name not in self._statements_of:
            have = [bool(code.strip()) for code in self.module.codes]
            lines = [line for line, has in zip(self.module.lines, have, strict=True) if has]
            self._statements_of[name] = lines, list(itertools.accumulate(have, initial=0))
        return self._statements_of[name]

    def change_tool(self, values: Mapping[str, float]) -> None:
        """A tool change by the number of the tool, or of its TOOL_DATA."""
        super().change_tool(values)
        if "T" not in values and "D" in values:
            self._numbered("TOOL", int(values["D"]), self._code)

    # ---- motions ---------------------------------------------------------------------------------------------

    def _motion(self, code: str) -> None:
        match = form.MOTION.match(code)
        if match is None:
            raise self._fault("this is no motion", code, limit="LIN {X 1.0}")
        word = match[1].upper()
        if self._in_spline and word not in ("SLIN", "SCIRC"):
            raise self._fault(f"{word} has no place in a spline block", code, limit="SLIN SCIRC")
        self.targets.module, self.targets.line = self.module, self.line
        start, at = match.start(1), match.end()
        if match[2]:
            read, place = self._relative(code, start, at, word)
        else:
            read, place = self.targets.read(code, start, at, word)
        if place.stays:
            return
        if place.target is None:
            self._elsewhere(place, read)
            return
        self._certain(code, "a motion")
        clause = read.clause
        if clause is None:
            self._cartesian(read, code, start)
            return
        modes = {name: self.memory.system.get(name) for name in _WITH_MODES.values()}
        frames = self.frames.state()
        self._with_values(clause, code)
        self._cartesian(read, code, start)
        self.memory.system |= modes
        tool = self.frames.tool
        self.frames.restore(frames)
        self.frames.tool = tool

    def _with_values(self, clause: WithClause, code: str) -> None:
        """Frames and modes that hold for one motion alone."""
        for name, (first, end) in clause.values.items():
            value = self._expression(code[first:end], code)
            self._set(_WITH_MODES[name], [], value, code, first)

    def _cartesian(self, read: KrlMotion, code: str, start: int) -> None:
        active = self._active_for(read, code, start)
        if self._by_axes or self._away is not None:
            self._arrive_by_axes(code)
        before = self.motions[-1] if self.motions else None
        rapid = read.word.endswith("PTP") or before is None
        holds = not rapid and active.holds and self._holds_orientation(read, code)
        feed = 0.0 if rapid else self._feed(read, code, active)
        made, rotation, words = self.targets.made(
            read, before, self.frames.R_tcp_tool, active.T_part_base, holds=holds
        )  # fmt: skip
        self._words = [*self._words, *words]
        self.motions.append(replace(
            made, block=len(self._blocks), kind="rapid" if feed == 0.0 else made.kind, feed_m_s=feed,
            spindle_rad_s=self._rpm * RPM, tool=self.frames.tool,
        ))  # fmt: skip
        self.rotations.append(rotation)
        self.moves.append(replace(
            read, in_spline=self._in_spline, speed_set=self._speed_set, T_part_base=active.T_part_base,
            override=1.0 if rapid else self.override(code) if active.override is None else active.override,
            holds_orientation=holds, distance_m=active.distance_m,
        ))  # fmt: skip
        self._speed_set = False
        if read.relative:
            self.memory.changes += 1
        if self._trigger is not None:
            self.loose[self.module.file.name, self.line] = self._trigger
            self._trigger = None

    def _active_for(self, read: KrlMotion, code: str, start: int) -> _Active:
        """Frames and modes of a motion; those of the motion before it while no value has changed."""
        active = self._active
        if active is not None and active.changes == self.memory.changes and read.clause is None:
            return active
        self.frames.require(f"{self.module.file.name}:{self.line}:{start + 1}", code)
        if self.mode("$IPO_MODE", code) == "#TCP":
            raise self._fault(
                "the robot holds the part against a tool that stands ($IPO_MODE=#TCP), which is not read", code,
                limit="$IPO_MODE=#BASE", hint="Give the G-code that it was made from",
            )  # fmt: skip
        active = _Active(
            self.memory.changes,
            self.frames.T_part_base,
            self.memory.system.get("$ORI_TYPE") != "#VAR",
            self._distance_m(),
        )
        self._active = active if read.clause is None else None
        return active

    def _feed(self, read: KrlMotion, code: str, active: _Active) -> float:
        if read.own_speed is not None:
            return self.speed(self._expression(code[slice(*read.own_speed)], code), code)
        if self._in_spline and self._spline is not None:
            return self.speed(self._spline, code)
        if active.feed_m_s is None:
            active.feed_m_s, active.override = self.active_speed(code), self.override(code)
        return active.feed_m_s

    def _holds_orientation(self, read: KrlMotion, code: str) -> bool:
        """$ORI_TYPE=#CONSTANT: the orientation of the target is disregarded."""
        if self.mode("$ORI_TYPE", code) != "#CONSTANT":
            return False
        if read.word.endswith("CIRC") and self.mode("$CIRC_TYPE", code) != "#BASE":
            raise self._fault(
                "the tool turns with the circle ($ORI_TYPE=#CONSTANT without $CIRC_TYPE=#BASE)", code,
                limit="$CIRC_TYPE=#BASE, or $ORI_TYPE=#VAR", hint="Set $CIRC_TYPE=#BASE before it",
            )  # fmt: skip
        return True

    def _distance_m(self) -> float:
        distances = self.memory.system.get("$APO")
        value = distances.get("CDIS") if isinstance(distances, dict) else None
        return float(value) * MM if is_number(value) else float("nan")  # type: ignore[arg-type]

    def _relative(self, code: str, start: int, at: int, word: str) -> tuple[KrlMotion, Place]:
        here = self._position("$POS_ACT")
        if not self.motions or isinstance(here, Unknown):
            raise self._fault(
                f"{word}_REL counts from where the robot is, and that is not known: relative targets are read behind a "
                "Cartesian one", code, hint="Post absolute targets",
            )  # fmt: skip
        where = f"{self.module.file.name}:{self.line}:{start + 1}"
        self.frames.require(where, code)
        return self.targets.relative(
            code, start, at, word, self.targets.here(self.motions[-1], self.frames.T_part_base)
        )

    # ---- places that are not Cartesian -----------------------------------------------------------------------

    def _elsewhere(self, place: Place, read: KrlMotion) -> None:
        """A motion by axes, or to a place that only the controller knows."""
        where = f"{self.module.file.name}:{self.line}"
        if place.axes is not None and self.memory.doubt is None and all(name in place.axes for name in AXES):
            self._by_axes.append((len(self._blocks), place.axes, read))
            self._away = None
            return
        self._by_axes.clear()
        self._away = place.unknown or Unknown("it goes there by axes", where)
        if self.memory.doubt is not None:
            self._away = self.memory.doubt

    def _arrive_by_axes(self, code: str) -> None:
        """Before a Cartesian motion between others: where the axis angles lead that the robot was sent to.

        Raises:
            ProgramError: It came from a place that is not known.
        """
        pending, self._by_axes = self._by_axes, []
        away, self._away = self._away, None
        if not self.motions:
            return
        tip = None if self.cell is None else self.cell.tip_of_axes
        if away is None and pending and tip is None:
            _, _, read = pending[-1]
            away = Unknown(
                "it goes there by axes, and no cell file says which robot that is", f"{read.file}:{read.line}"
            )
        if away is not None:
            line = away.where.rsplit(":", 1)[-1]
            raise self._fault(
                f"the robot comes from a place that is not known, by axes or by a name of the controller (line {line}: "
                f"{away.why})", code, limit="such places before the first target and behind the last one",
                hint="Give the cell file (--cell) for axis angles, or that place as a Cartesian target",
            )  # fmt: skip
        for index, axes, read in pending:
            assert tip is not None
            self.targets.check_external(axes, f"{read.file}:{read.line}")
            self._stand_at(index, tip([axes[name] for name in AXES]), read)

    def _stand_at(self, index: int, T_part_tcp: Float, read: KrlMotion) -> None:
        """Put a rapid to a place by axes into the block of its statement."""
        motion = Motion(
            index, "rapid", self.motions[-1].p_end, T_part_tcp[:3, 3].copy(), 0.0, self._rpm * RPM, self.frames.tool
        )
        self.targets.stand(T_part_tcp @ pose.make(self.frames.R_tcp_tool))
        made = len(self.motions)
        self.motions.append(motion)
        self.rotations.append(T_part_tcp[:3, :3].copy())
        self.moves.append(read)
        block = self._blocks[index]
        self._blocks[index] = replace(block, first_motion=made, motion_count=1, modal=replace(block.modal, motion="G0"))
        for later in range(index + 1, len(self._blocks)):
            self._blocks[later] = replace(self._blocks[later], first_motion=made + 1)

    def _position(self, name: str) -> Value:
        """``$POS_ACT``: where the last motion ended, in the active base."""
        where = f"{self.module.file.name}:{self.line}"
        if name.startswith("$AXIS") or not self.motions or self._away is not None or self._by_axes:
            return Unknown(f"{name} is where the robot is", where)
        try:
            self.frames.require(where, self._code)
        except ProgramError:
            return Unknown(f"{name} counts in a frame that is not known", where)
        self.reads_position = True
        return record_of(self.targets.here(self.motions[-1], self.frames.T_part_base))

    # ---- spline blocks ---------------------------------------------------------------------------------------

    def _spline_begins(self, code: str) -> None:
        begins = form.SPLINE_BEGINS.fullmatch(code)
        if begins is None or self._in_spline or not form.WITH_OTHERS.fullmatch(begins[1]):
            raise self._fault("this beginning of a spline block is not understood", code,
                              limit="SPLINE WITH $VEL.CP=0.02",
                              hint="Set speed and acceleration alone there")  # fmt: skip
        self._certain(code, "a spline block")
        try:
            clause = with_clause(code, begins.start(1))
        except WithFault as fault:
            raise self._fault(
                fault.what.replace("path speed", "path speed of a spline block"), code,
                limit="SPLINE WITH $VEL.CP=0.02", hint=fault.hint,
            ) from fault  # fmt: skip
        self._in_spline, self._spline = True, None
        if clause is not None:
            if "ORI_TYPE" in clause.values:
                self._with_values(clause, code)
            if clause.speed is not None:
                self._spline = self._expression(code[slice(*clause.speed)], code)
                self.speed(known(self._spline, "the path speed of a spline block", self.at(code), text=code), code)

    def _spline_ends(self, code: str) -> None:
        if not self._in_spline:
            raise self._fault("ENDSPLINE closes nothing", code, hint="The file may be damaged: post it again")
        if form.SPLINE_ENDS.fullmatch(code) is None:
            raise self._fault("this is not understood behind ENDSPLINE", code, limit="C_SPL")
        self._in_spline, self._spline = False, None

    # ---- waits, triggers, interrupts -------------------------------------------------------------------------

    def _wait(self, code: str) -> None:
        match = form.WAIT_TIME.fullmatch(code)
        if match is None:
            raise self._fault("the time of a wait is missing", code, limit="WAIT SEC 0.5")
        if self.memory.doubt is not None:
            return
        time_s: Value = number_of(match[1])
        if time_s is None:
            value = self._expression(match[1], code)
            time_s = known(value, "the time of a wait", self.at(code), text=code)
        if not is_number(time_s):
            raise self._fault("the time of a wait is no number", code, hint="Write the number itself, in s")
        if self._by_axes or self._away is not None:
            return  # it stands where no cut is
        if self.dwell(len(self._blocks), float(time_s)):  # type: ignore[arg-type]
            self.moves.append(KrlMotion(self.module.file.name, self.line, "WAIT"))

    def _trigger_statement(self, code: str) -> None:
        match = form.TRIGGER.fullmatch(code)
        if match is None:
            raise self._fault(
                "this TRIGGER is not understood", code, limit="TRIGGER WHEN DISTANCE=0 DELAY=0 DO $OUT[1]=TRUE"
            )
        if not form.AT_START.fullmatch(match[1]):
            self._trigger = self._trigger or self.line
        elif self._trigger is not None:
            self._trigger = -1
        if self.process is not None:
            function = self.process.find([match[2]], 0, f"{self.module.file.name}:{self.line}")
            if function is not None:
                self._certain(code, "the spindle, coolant or tool is switched")
                self.do(function)
                return
        self._note("TRIGGER WHEN PATH", code)
        self._later(match[2], Unknown("a TRIGGER does it while the robot moves", self.memory.where()))

    def _interrupt(self, code: str) -> None:
        self._note("INTERRUPT DECL", code)
        match = form.INTERRUPT.fullmatch(code)
        if match is None:
            raise self._fault(
                "this INTERRUPT is not understood", code, limit="INTERRUPT DECL 5 WHEN $IN[1] DO STOP_IT( )"
            )
        if not form.STANDARD.match(code):
            self.memory.interrupts = True
            self._later(match[1], Unknown("an interrupt does it at a time that is not known", self.memory.where()))
            self.memory.interrupts = False

    def _later(self, statement: str, cause: Unknown) -> None:
        """What a TRIGGER or INTERRUPT does: an output, an assignment, or a subprogram that must not move the robot."""
        call = form.CALL.fullmatch(statement)
        doubt, self.memory.doubt = self.memory.doubt, cause
        in_spline, self._in_spline = self._in_spline, False
        if call is not None:
            routine = self.job.routine(call[1], self.module, self.memory.where())
            if routine is not None:
                self._call(routine, ())
        elif form.ASSIGNMENT.match(statement) is not None and not statement.lstrip().startswith("$OUT"):
            self._statement(form.word_of(statement, frozenset()), statement)
        self.memory.doubt, self._in_spline = doubt, in_spline

    # ---- end -------------------------------------------------------------------------------------------------

    def _check_end(self, routine: Routine) -> None:
        name = routine.module.file.name
        if self._in_spline:
            raise ProgramError("SPLINE is not closed", where=f"{name}:{self.line}", hint="The file may be cut off")
        if not routine.closed and (self.complete or routine.end <= len(routine.module.lines)):
            raise ProgramError(
                "the program stops without END: it may be cut off", where=f"{name}:{routine.end - 1}",
                value=routine.module.lines[-1].strip()[:60],
                hint="Post it again, or say --without-end if it is complete",
            )  # fmt: skip


def orientations(interpreter: Interpreter) -> Float:
    """(motions, 3, 3) orientation of the cell's TCP at the end of each motion."""
    return np.array(interpreter.rotations).reshape(-1, 3, 3)
