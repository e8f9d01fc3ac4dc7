"""Targets of KRL motions: literals, names and computed values; their places in the part, circles."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose, rotation
from counterflex.geometry.circle import turned
from counterflex.integrations.kuka.language.program import (
    LETTERS,
    Component,
    KrlMotion,
    Target,
    WithClause,
    WithFault,
    with_clause,
)
from counterflex.integrations.kuka.language.read import statements as form
from counterflex.integrations.kuka.language.read.frames import KrlCell
from counterflex.integrations.kuka.language.read.job import Module
from counterflex.integrations.kuka.language.read.literals import Named, NoNumber, components, require_cartesian
from counterflex.integrations.kuka.language.read.memory import KrlMemory
from counterflex.integrations.kuka.language.read.values import GRAMMAR, StoredFrame, Value, is_axes, is_frame
from counterflex.programs.expression import ExpressionError, Name, Node, parse
from counterflex.programs.program import Motion, Word
from counterflex.programs.robot_text.cell import ExternalAxes
from counterflex.programs.robot_text.execution import arc_through
from counterflex.programs.unknown import Unknown, known

_BLANKS: Final = re.compile(r"\s*")
_COMMA: Final = re.compile(r"\s*,")
_OF_CONTROLLER: Final = re.compile(r"\$(AXIS|POS)_(ACT|RET|INT|FOR|BACK)\w*|X?HOME\d*|XSTART|\$H_POS", re.IGNORECASE)
_STAYS: Final = re.compile(r"\$(?:AXIS|POS)_ACT", re.IGNORECASE)


@dataclass(frozen=True)
class TargetPlace:
    """Target of a motion."""

    target: Target | None = None  # A Cartesian target; None otherwise
    axes: Mapping[str, float] | None = None  # Axis angles, deg; None otherwise
    stays: bool = False  # It is where the robot is
    unknown: Unknown | None = None  # Why the place is not known; None where it is


class KrlTargets:
    """Reads the targets of motions.

    Args:
        memory: Values of names.
        evaluate: Returns the value of an expression of a statement.
        cell: See :class:`KrlCell`.
        made: Returns the number of motions made so far.
    """

    def __init__(
        self, memory: KrlMemory, evaluate: Callable[[Node, str], Value], cell: KrlCell | None,
        made: Callable[[], int] = lambda: 0,
    ) -> None:  # fmt: skip
        self.memory, self._evaluate = memory, evaluate
        self.module: Module = memory.job.main  # File of the statement that runs
        self.line = 0  # Of it
        self._external: dict[str, Component] = {}
        self.external = ExternalAxes(cell, made)  # External axes along the program
        self._angles: list[float] | None = None
        self._base: Float | None = None
        self._R_part_tool: Float = np.eye(3)
        self._circle_rad: float | None = None

    @property
    def extra_text(self) -> str:
        """``,E1 0.0`` and so on."""
        return "".join(f",{name} {component.value:g}" for name, component in sorted(self._external.items()))

    def read(self, code: str, start: int, at: int, word: str) -> tuple[KrlMotion, TargetPlace]:
        """The targets of a motion and what follows them.

        Args:
            start: Index of its word.
            at: Index behind its word.
            word: ``PTP`` and so on.

        Raises:
            ProgramError: A target is not known, or the rest of the statement is not understood.
        """
        place, at = self._place_at(code, at, word)
        auxiliary, self._circle_rad = None, None
        circle_angle = False
        if word.endswith("CIRC"):
            comma = _COMMA.match(code, at)
            if comma is None or place.target is None:
                raise self._fault(
                    "a circle needs an auxiliary point and an end", code, at, limit=f"{word} {{...}},{{...}}"
                )
            auxiliary = place.target
            place, at = self._place_at(code, comma.end(), word)
            if place.target is None:
                raise self._fault("a circle ends at a place that is not known", code, at)
            if (angle := form.CIRCLE_ANGLE.match(code, at)) is not None:
                self._circle_rad, at, circle_angle = self._circle_angle(angle[1], code, at), angle.end(), True
        end = len(code[:at].rstrip())
        approximation = form.APPROXIMATION.match(code, at)
        at = at if approximation is None else approximation.end()
        clause = self._with(code, at) if word.startswith("S") else None
        if clause is not None:
            at = clause.end
            if (behind := form.APPROXIMATION.match(code, at)) is not None and behind[1]:
                approximation, at = behind, behind.end()
        if code[at:].strip():
            raise self._fault(
                "this is not understood behind a target", code, at, limit="C_DIS C_PTP C_VEL C_ORI C_SPL, CA",
                hint="Set speed and approximation by statements of their own",
            )  # fmt: skip
        target = place.target
        words = "" if approximation is None else approximation[1].strip()
        return KrlMotion(
            self.module.file.name, self.line, word, target, auxiliary, words, False, circle_angle, start, end,
            clause=clause,
        ), place  # fmt: skip

    def relative(self, code: str, start: int, at: int, word: str, T_base_tool: Float) -> tuple[KrlMotion, TargetPlace]:
        """A motion by an amount: ``LIN_REL {Z 10} #BASE``.

        Args:
            start: Index of its word.
            at: Index behind its word.
            word: Without ``_REL``.
            T_base_tool: (4, 4) m, where the tool is.

        Raises:
            ProgramError: The amount is not known, or what it means is not.
        """
        node, end = self._parsed(code, at)
        value = known(self._evaluate(node, code), "the amount of a relative motion", self._where(at), text=code)
        approximation = form.APPROXIMATION.match(code, end)
        behind = code[end if approximation is None else approximation.end() :]
        frame = form.IN_TOOL.match(behind)
        if is_axes(value):
            return self._blank(word, start), TargetPlace(unknown=Unknown("it is given by axes", self._where(at)))
        if not is_frame(value) or not isinstance(value, dict):
            raise self._fault("the amount of a relative motion is no frame", code, at, limit="{X 10.0,Y 0.0}")
        if behind[0 if frame is None else frame.end() :].strip():
            raise self._fault("this is not understood behind a target", code, end, limit="#BASE, #TOOL, C_DIS")
        shift = [float(value.get(letter, 0.0)) for letter in LETTERS]
        in_tool = frame is not None and frame[1].upper() == "TOOL"
        if any(shift[3:]) and not in_tool:
            raise self._fault(
                "relative targets that turn the tool in $BASE are not read", code, at, limit="X Y Z, or #TOOL",
                hint="Post absolute targets",
            )  # fmt: skip
        change = pose.make(rotation.from_zyx(np.array(shift[3:]) * DEG), np.array(shift[:3]) * MM)
        T = T_base_tool @ change if in_tool else change @ T_base_tool
        values = [*(T[:3, 3] / MM), *(rotation.to_zyx(T[:3, :3]) / DEG)]
        parts = {letter: Component(float(v), 0, 0) for letter, v in zip(LETTERS, values, strict=True)}
        target = self._computed(parts, "", start, end, code)
        words = "" if approximation is None else approximation[1].strip()
        read = replace(self._blank(word, start), target=target, approximation=words, end=end, relative=True)
        return read, TargetPlace(target=target)

    def _blank(self, word: str, start: int) -> KrlMotion:
        return KrlMotion(self.module.file.name, self.line, word, start=start)

    def _circle_angle(self, text: str, code: str, at: int) -> float:
        if form.CIRCLE_NUMBER.fullmatch(text):
            return float(text) * DEG
        node, end = self._parsed(text, 0)
        value = known(self._evaluate(node, code), "the angle of a circle", self._where(at), text=code)
        if text[end:].strip() or isinstance(value, bool) or not isinstance(value, int | float):
            raise self._fault("CA of a circle is no number", code, at, hint="Write the angle itself, in deg")
        return float(value) * DEG

    def _with(self, code: str, at: int) -> WithClause | None:
        try:
            return with_clause(code, at)
        except WithFault as fault:
            raise self._fault(fault.what, code, fault.at, hint=fault.hint) from fault

    def _place_at(self, code: str, at: int, word: str) -> tuple[TargetPlace, int]:
        start = _BLANKS.match(code, at).end()  # type: ignore[union-attr]
        if code[start : start + 1] == "{":
            try:
                parts, close = components(self.module.lines[self.line - 1], start, self._place_name)
            except NoNumber:
                parts, close = {}, -1
            if close >= 0 and not code[close + 1 :].lstrip().startswith(":"):
                return self._literal(code, parts, start, close, word), close + 1
        node, end = self._parsed(code, start)
        value = self._evaluate(node, code)
        if isinstance(node, Name):
            named = self._by_name(node, value, code, word)
            if named is not None:
                return named, end
        if isinstance(value, StoredFrame):
            value = value.record()
        if isinstance(value, Unknown) and word.endswith("PTP"):
            return TargetPlace(unknown=value), end
        value = known(value, "the target", self._where(start), text=code, hint="Write the target itself")
        if is_axes(value):
            return self._axes(value, code, start, word), end
        if not is_frame(value) or not isinstance(value, dict):
            raise self._fault("this is no target", code, start, limit="X Y Z A B C, or axis angles behind PTP")
        parts = {key: Component(float(part), 0, 0) for key, part in value.items()}
        require_cartesian(parts, code[start:end], f"{self._place_name}:{start + 1}")
        name = "" if code[start] == "{" else code[start:end].strip()
        return TargetPlace(target=self._computed(parts, name, start, end, code)), end

    def _literal(self, code: str, parts: dict[str, Component], start: int, close: int, word: str) -> TargetPlace:
        if any(name in parts for name in ("A1", "A2", "A3", "A4", "A5", "A6")):
            return self._axes({name: part.value for name, part in parts.items()}, code, start, word)
        require_cartesian(parts, code[start : close + 1], f"{self._place_name}:{start + 1}")
        name = self.module.file.name
        return TargetPlace(target=Target(
            False, name, self.line, parts, close, "", start, close + 1, code[start : close + 1]
        ))  # fmt: skip

    def _by_name(self, node: Name, value: Value, code: str, word: str) -> TargetPlace | None:
        """A target by a name whose literal stands in a data list; None where it is another."""
        if word.endswith("PTP") and _STAYS.fullmatch(node.text):
            return TargetPlace(stays=True)
        if (
            isinstance(value, Unknown)
            and not node.path
            and word.endswith("PTP")
            and _OF_CONTROLLER.fullmatch(node.text)
        ):
            return TargetPlace(unknown=value)
        if isinstance(value, Unknown) and not self.memory.declared(node.text):
            raise self._fault(
                f"where {node.text} is, is not known", code, node.start,
                limit="given in braces in a .dat file"
                + ("" if self.module.data is not None else ", and there is none beside it"),
                hint="Give .src and .dat together, under the same name",
            )  # fmt: skip
        index = self._index(node)
        named = None if index is None else self.memory.named(node.text, index)
        if named is None or not is_frame(value):
            return None
        return self._of_data_list(named, node, code, word)

    def _index(self, node: Name) -> tuple[int, ...] | None:
        if not node.path:
            return ()
        if len(node.path) == 1 and isinstance(node.path[0], tuple):
            values = [self._evaluate(item, "") for item in node.path[0]]
            return tuple(value for value in values if isinstance(value, int))
        return None

    def _of_data_list(self, named: Named, node: Name, code: str, word: str) -> TargetPlace | None:
        try:
            parts, close = named.components()
        except NoNumber:
            return None
        if any(name in parts for name in ("A1", "A2", "A3", "A4", "A5", "A6")):
            return self._axes({name: part.value for name, part in parts.items()}, code, node.start, word)
        require_cartesian(parts, named.text.strip(), named.where)
        literal = named.text[named.start : close + 1]
        name = code[node.start : node.end]
        return TargetPlace(target=Target(
            True, named.file, named.line, parts, close, name, node.start, node.end, literal
        ))  # fmt: skip

    def _computed(self, parts: dict[str, Component], name: str, start: int, end: int, code: str) -> Target:
        return Target(
            False, self.module.file.name, self.line, parts, -1, name, start, end, code[start:end].strip(), computed=True
        )

    def _axes(self, value: Value, code: str, start: int, word: str) -> TargetPlace:
        if not word.endswith("PTP"):
            raise self._fault("axis angles are no target of a path", code, start, limit="X Y Z A B C")
        assert isinstance(value, Mapping)
        return TargetPlace(axes={str(key): float(part) for key, part in value.items() if isinstance(part, int | float)})

    def _parsed(self, code: str, at: int) -> tuple[Node, int]:
        try:
            return parse(code, GRAMMAR, at)
        except RecursionError as error:
            raise self._fault("brackets within each other are too deep", code, at) from error
        except ExpressionError as error:
            if not code[at:].strip():
                raise self._fault("a motion without a target", code, at, hint="The line may be cut off") from error
            raise self._fault(f"a target is not understood: {error}", code, error.at) from error

    # ---- places ----------------------------------------------------------------------------------------------

    def here(self, before: Motion, T_part_base: Float | None) -> Float:
        """(4, 4) m, the tool in a base, where a motion ended."""
        T_part_tool = pose.make(self._R_part_tool, np.asarray(before.p_end))
        if T_part_base is None:
            return T_part_tool
        T_base_part = pose.inverse(T_part_base)
        return T_base_part @ T_part_tool

    def made(
        self, read: KrlMotion, before: Motion | None, R_tcp_tool: Float, T_part_base: Float | None, *, holds: bool
    ) -> tuple[Motion, Float, tuple[Word, ...]]:
        """The motion to a target, the orientation at its end, and its words.

        Args:
            read: From :meth:`read`.
            before: The motion before; None for the first.
            R_tcp_tool: (3, 3) ``$TOOL`` in the TCP frame of the cell.
            T_part_base: (4, 4) m, ``$BASE`` in the part; None where it is the part frame.
            holds: The orientation of the start is kept.
        """
        target = read.target
        assert target is not None
        self._check_external(target)
        self._rebase(before, T_part_base)
        held = self._angles
        p, angles = self._place(target, before)
        auxiliary = None if read.auxiliary is None else self._place(read.auxiliary, before)[0]
        if holds and held is not None:
            angles = held
        self._angles = angles
        R_base_tool: Float = rotation.from_zyx(np.array(angles) * DEG)
        R_part_tool = R_base_tool
        if T_part_base is not None:
            R_part_base, p_part_base = T_part_base[:3, :3], T_part_base[:3, 3]
            p, R_part_tool = R_part_base @ p + p_part_base, R_part_base @ R_base_tool
            auxiliary = None if auxiliary is None else R_part_base @ auxiliary + p_part_base
        self._R_part_tool = R_part_tool
        literal = not target.in_data and not target.computed
        words = tuple(
            Word(letter, component.value, *((component.start, component.end) if literal else (0, 0)))
            for letter, component in target.components.items()
            if letter in LETTERS
        )
        start = p if before is None else before.p_end
        motion = Motion(0, "feed", start, p, 0.0, 0.0, 0)
        if auxiliary is not None and before is not None:
            motion = self._arc(motion, read, auxiliary)
        return motion, R_part_tool @ R_tcp_tool.T, words

    def stand(self, T_part_tool: Float) -> None:
        """The robot went to a place by axes: components that are not written are those of it."""
        self._R_part_tool, self._base = T_part_tool[:3, :3], None
        self._angles = [float(angle) for angle in rotation.to_zyx(self._R_part_tool) / DEG]

    def _rebase(self, before: Motion | None, T_part_base: Float | None) -> None:
        """The angles of the place where the robot is, in another base."""
        if T_part_base is self._base or before is None or self._angles is None:
            self._base = T_part_base
            return
        self._base = T_part_base
        R = self.here(before, T_part_base)[:3, :3]
        self._angles = [float(angle) for angle in rotation.to_zyx(R) / DEG]

    def _place(self, target: Target, before: Motion | None) -> tuple[Float, list[float]]:
        """Point in m and angles in deg in the base; components that are not written stay as they are."""
        values: list[float] = []
        here: Float | None = None
        for index, letter in enumerate(LETTERS):
            component = target.components.get(letter)
            if component is not None:
                values.append(component.value)
            elif before is None or self._angles is None or target.in_data or target.name:
                raise ProgramError(
                    f"a target without {letter}" + ("" if target.name else ", and nothing before says where it is"),
                    where=f"{target.file}:{target.line}:{target.close + 1 if target.close >= 0 else target.start + 1}",
                    value=target.source[:60], limit="X Y Z A B C",
                )  # fmt: skip
            elif index >= 3:
                values.append(self._angles[index - 3])
            elif self._base is None:
                values.append(float(before.p_end[index]) / MM)
            else:
                here = self.here(before, self._base) if here is None else here
                values.append(float(here[index, 3]) / MM)
        return np.array(values[:3]) * MM, values[3:]

    def _arc(self, motion: Motion, read: KrlMotion, p_auxiliary: Float) -> Motion:
        where, value = f"{read.file}:{read.line}", self.module.lines[read.line - 1].strip()[:60]
        made = arc_through(
            motion, p_auxiliary, lambda what, hint: ProgramError(what, where=where, value=value, hint=hint)
        )
        assert made.p_centre is not None
        assert made.normal is not None
        if self._circle_rad is not None:
            turn = self._circle_rad
            if not 0.0 < abs(turn) <= 40.0 * math.pi:
                raise ProgramError(
                    "CA is out of range", where=f"{read.file}:{read.line}", value=f"{turn / DEG:g} deg",
                    limit="not 0, at most 20 turns",
                )  # fmt: skip
            made = replace(made, p_end=turned(made.p_start, made.p_centre, made.normal, turn), turn_rad=turn)
        return made

    def _check_external(self, target: Target) -> None:
        """Refuse external axes that move, or stand elsewhere than the cell says."""
        given = {name: part for name, part in target.components.items() if name[0] == "E"}
        self.check_external({name: part.value for name, part in given.items()}, f"{target.file}:{target.line}")
        for name, part in given.items():
            self._external.setdefault(name, part)

    def check_external(self, values: Mapping[str, float], where: str) -> None:
        """Refuse external axes of a place that are not where they stand in the cut. Raises ProgramError: one is not."""
        for name, value in values.items():
            if name[0] == "E":
                self.external.check(int(name[1:]), value, name, where)

    @property
    def _place_name(self) -> str:
        return f"{self.module.file.name}:{self.line}"

    def _where(self, at: int) -> str:
        return f"{self._place_name}:{at + 1}"

    def _fault(self, what: str, code: str, at: int, **more: str) -> ProgramError:
        return ProgramError(what, where=self._where(at), value=code.strip()[:60], **more)
