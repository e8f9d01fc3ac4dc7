"""Motions of a KRL program: Cartesian ones with the frames, speeds and modes that are active, and those by axes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG, MM, RPM
from counterflex.geometry import pose
from counterflex.integrations.kuka.language.program import KrlMotion, WithClause
from counterflex.integrations.kuka.language.read import statements as form
from counterflex.integrations.kuka.language.read.frames import KrlCell
from counterflex.integrations.kuka.language.read.job import KrlJob
from counterflex.integrations.kuka.language.read.modes import KrlModes
from counterflex.integrations.kuka.language.read.targets import KrlTargets, TargetPlace
from counterflex.integrations.kuka.language.read.values import AXES, Value, record_of
from counterflex.programs.expression import is_number
from counterflex.programs.program import Motion
from counterflex.programs.robot_text.execution import slowed_by_turning
from counterflex.programs.unknown import Unknown

MOTIONS: Final = frozenset(
    ("PTP", "LIN", "CIRC", "SPTP", "SLIN", "SCIRC", "PTP_REL", "LIN_REL", "SLIN_REL", "SPTP_REL")
)
_WITH_MODES: Final = {"TOOL": "$TOOL", "BASE": "$BASE", "IPO_MODE": "$IPO_MODE", "ORI_TYPE": "$ORI_TYPE"}


Held = tuple[dict[str, Value], tuple[object, ...]]
"""Modes by name, and the state of the frames."""


@dataclass
class _Active:
    """Frames and modes while no value changes: ``changes`` of the memory, see :class:`KrlMotion` for the others."""

    changes: int  # Number of changed values for which it holds
    T_part_base: Float | None  # (4, 4) m; None where the base is the part frame
    holds: bool  # $ORI_TYPE may be another than #VAR
    distance_m: float  # $APO.CDIS
    feed_m_s: float | None = None  # Path speed; None until a motion needs it
    override: float | None = None  # Share of it; None until a motion needs it


class KrlMotions(KrlModes):
    """Motions that a job makes."""

    def __init__(self, job: KrlJob, cell: KrlCell | None, *, complete: bool) -> None:
        super().__init__(job, cell, complete=complete)
        self.cell = cell
        self.targets = KrlTargets(self.memory, self.value, cell, lambda: len(self.motions))
        self.moves: list[KrlMotion] = []  # What stands behind each motion in the text
        # See :class:`~counterflex.integrations.kuka.language.program.KrlProgram`
        self.loose: dict[tuple[str, int], int] = {}
        self.memory.position = self._position
        self._away: Unknown | None = None
        self._by_axes: list[tuple[int, Mapping[str, float], KrlMotion]] = []
        self._rode: dict[str, tuple[float, str]] = {}
        self._trigger: int | None = None
        self._spline: Value = None
        self._in_spline = False
        self._active: _Active | None = None
        self.reads_position = False

    def _certain(self, code: str, what: str) -> None:
        """Refuse a statement of which it is not known whether it is executed."""
        doubt = self.memory.doubt
        if doubt is not None:
            raise self._fault(
                f"{what}, and whether it is executed is not known: {doubt}", code,
                limit="conditions that follow from the text of the program",
                hint="Post the path without this condition",
            )  # fmt: skip

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
        held = self._held_modes()
        self._with_values(clause, code)
        self._cartesian(read, code, start)
        self._restore_modes(held)

    def _held_modes(self) -> Held:
        """Frames and modes before a ``WITH``, which :meth:`_restore_modes` takes."""
        return {name: self.memory.system.get(name) for name in _WITH_MODES.values()}, self.frames.state()

    def _restore_modes(self, held: Held) -> None:
        modes, frames = held
        self.memory.system |= modes
        self.memory.changes += 1
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
        if before is None:
            self._stand_where_sent(read)
        rapid = read.word.endswith("PTP") or before is None
        holds = not rapid and active.holds and self._holds_orientation(read, code)
        feed = 0.0 if rapid else self._feed(read, code, active)
        made, rotation, words = self.targets.made(
            read, before, self.frames.R_tcp_tool, active.T_part_base, holds=holds
        )  # fmt: skip
        self._words = [*self._words, *words]
        made = replace(
            made, block=len(self._blocks), kind="rapid" if feed == 0.0 else made.kind, feed_m_s=feed,
            spindle_rad_s=self._rpm * RPM, tool=self.frames.tool,
        )  # fmt: skip
        if before is not None:
            made = slowed_by_turning(made, (self.rotations[-1], rotation), self._turning(active))
        self.motions.append(made)
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

    def _turning(self, active: _Active) -> tuple[float, float]:
        """$VEL.ORI1 and ORI2, rad/s, with the override; infinite where the program does not say them."""
        speeds = self.memory.system.get("$VEL")
        given = [speeds.get(name) if isinstance(speeds, dict) else None for name in ("ORI1", "ORI2")]
        share = 1.0 if active.override is None else active.override
        first, second = (float(v) * DEG * share if is_number(v) and v > 0.0 else math.inf for v in given)  # type: ignore[arg-type, operator]
        return first, second

    def _holds_orientation(self, read: KrlMotion, code: str) -> bool:
        """$ORI_TYPE=#CONSTANT: the orientation of the target is disregarded."""
        kind = self.mode("$ORI_TYPE", code)
        if kind == "#JOINT":
            raise self._fault(
                "the wrist runs by axes ($ORI_TYPE=#JOINT): the tool's axis between the ends is not known", code,
                limit="$ORI_TYPE=#VAR or #CONSTANT", hint="Set $ORI_TYPE=#VAR before it",
            )  # fmt: skip
        if kind != "#CONSTANT":
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

    def _relative(self, code: str, start: int, at: int, word: str) -> tuple[KrlMotion, TargetPlace]:
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

    def _elsewhere(self, place: TargetPlace, read: KrlMotion) -> None:
        """A motion by axes, or to a place that only the controller knows."""
        where = f"{self.module.file.name}:{self.line}"
        self.by_axes.append(len(self._blocks))
        axes = place.axes
        if not self.motions and axes is not None:
            self._rode |= {name: (value, where) for name, value in axes.items() if name[0] == "E"}
        if axes is not None and self._by_axes:
            axes = {**self._by_axes[-1][1], **axes}  # axes that are left out stay where they are
        if axes is not None and self.memory.doubt is None and all(name in axes for name in AXES):
            self._by_axes.append((len(self._blocks), axes, read))
            self._away = None
            return
        self._by_axes.clear()
        self._away = place.unknown or Unknown("it goes there by some of its axes", where)
        if self.memory.doubt is not None:
            self._away = self.memory.doubt

    def _stand_where_sent(self, read: KrlMotion) -> None:
        """External axes that the first target does not name stand where a motion by axes before it has sent them."""
        named = () if read.target is None else read.target.components
        for name, (value, where) in self._rode.items():
            if name not in named:
                self.targets.check_external({name: value}, where)

    def _arrive_by_axes(self, code: str) -> None:
        """Before a Cartesian motion between others: where the axis angles lead that the robot was sent to."""
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
            needs = "all axis angles of that place" if tip is not None else "the cell file (--cell) for axis angles"
            raise self._fault(
                "the robot comes from a place that is not known, by axes or by a name of the controller "
                f"({away.where}: {away.why})", code,
                limit="such places before the first target and behind the last one",
                hint=f"Give {needs}, or that place as a Cartesian target",
            )  # fmt: skip
        for index, axes, read in pending:
            assert tip is not None
            self.targets.check_external(axes, f"{read.file}:{read.line}")
            self.axes_deg[len(self.motions)] = [axes[name] for name in AXES]
            external = self.targets.external.now
            self._stand_at(index, tip(self.axes_deg[len(self.motions)], external), read)

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
