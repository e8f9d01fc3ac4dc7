"""Targets of a KRL motion: literals and names, positions and orientations, circles."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG, MM
from counterflex.geometry import rotation
from counterflex.geometry.circle import turned
from counterflex.programs.krl.program import LETTERS, Component, KrlMotion, Target
from counterflex.programs.krl.read import statements as form
from counterflex.programs.krl.read.data_list import Named, key_of
from counterflex.programs.krl.read.frames import KrlCell
from counterflex.programs.krl.read.literals import code_of, components, require_cartesian
from counterflex.programs.krl.with_clause import WithClause, WithFault, with_clause
from counterflex.programs.program import Motion, Word
from counterflex.programs.robot_text.cell import ExternalAxes
from counterflex.programs.robot_text.execution import arc_through

_NAME: Final = re.compile(rf"\s*({form.NAME})\s*")
_OPEN: Final = re.compile(r"\s*(?=\{)")
_COMMA: Final = re.compile(r"\s*,")
_OF_CONTROLLER: Final = re.compile(r"\$(AXIS|POS)_(ACT|RET|INT|FOR|BACK)\w*|X?HOME\d*|XSTART|\$H_POS", re.IGNORECASE)


class Targets:
    """Reads the targets of motions.

    Args:
        name: Of the ``.src`` file, for errors.
        lines: Of it.
        named: Literals of the ``.dat`` file.
        data_name: Its name; empty where there is none.
        cell: See :class:`KrlCell`.

    Attributes:
        assigned: Variables that the program assigns something to, but for axis angles.
    """

    def __init__(
        self, name: str, lines: Sequence[str], named: Mapping[str, Named], data_name: str, cell: KrlCell | None
    ) -> None:
        self.name, self.lines, self.named, self.data_name = name, lines, named, data_name
        self.assigned: set[str] = set()
        self._axis_angles: set[str] = set()
        self._used: dict[str, int] = {}
        self._mentioned: dict[str, int] | None = None
        self._external: dict[str, Component] = {}
        self._external_axes = ExternalAxes(cell)
        self._seen = False
        self._angles: list[float] | None = None
        self._circle_rad: float | None = None

    @property
    def extra_text(self) -> str:
        """``,E1 0.0`` and so on."""
        return "".join(f",{name} {component.value:g}" for name, component in sorted(self._external.items()))

    def assign(self, key: str, *, axes: bool) -> None:
        """The program gives a variable a value: axis angles written out, or anything else."""
        (self._axis_angles if axes else self.assigned).add(key)
        (self.assigned if axes else self._axis_angles).discard(key)

    def motion(self, code: str, start: int, at: int, word: str, line: int) -> KrlMotion | None:
        """Targets of a motion; None where it goes to a place that only the controller knows (axes, home).

        Args:
            code: The statement.
            start: Index of its word.
            at: Index behind its word.
            word: ``PTP`` and so on.
            line: 1-based.

        Raises:
            ProgramError: A target is not known, computed, or the rest of the statement is not understood.
        """
        target, at = self._target(code, at, word, line)
        auxiliary, self._circle_rad = None, None
        if word.endswith("CIRC"):
            comma = _COMMA.match(code, at)
            if comma is None or target is None:
                raise self._fault(
                    "a circle needs an auxiliary point and an end", code, line, at, limit=f"{word} {{...}},{{...}}"
                )
            auxiliary = target
            target, at = self._target(code, comma.end(), word, line)
            if (angle := form.CIRCLE_ANGLE.match(code, at)) is not None:
                self._circle_rad, at = float(angle[1]) * DEG, angle.end()
            elif form.ANY_CIRCLE_ANGLE.match(code, at):
                raise self._fault("CA of a circle is no number", code, line, at, hint="Write the angle itself, in deg")
        end = at
        if code[at:].lstrip().startswith(":"):
            raise self._fault("targets composed by ':' are not read", code, line, at, hint="Write the target itself")
        approximation = form.APPROXIMATION.match(code, at)
        at = at if approximation is None else approximation.end()
        clause = self._with(code, at, line) if word.startswith("S") else None
        if clause is not None:
            at = clause.end
            if (behind := form.APPROXIMATION.match(code, at)) is not None and behind[1]:
                approximation, at = behind, behind.end()
        if code[at:].strip():
            raise self._fault(
                "this is not understood behind a target", code, line, at, limit="C_DIS C_PTP C_VEL C_ORI C_SPL, CA",
                hint="Set speed and approximation by statements of their own",
            )  # fmt: skip
        if target is None:
            if word.endswith("CIRC"):
                raise self._fault("a circle ends at a place that is not known", code, line, at)
            return None
        shared = bool(target.name) and self._mentions(target.name) > 1
        return KrlMotion(
            line, word, target, auxiliary, "" if approximation is None else approximation[1].strip(), shared,
            self._circle_rad is not None, start, len(code[:end].rstrip()), clause=clause,
        )  # fmt: skip

    def _with(self, code: str, at: int, line: int) -> WithClause | None:
        try:
            return with_clause(code, at)
        except WithFault as fault:
            raise self._fault(fault.what, code, line, fault.at, hint=fault.hint) from fault

    def _target(self, code: str, at: int, word: str, line: int) -> tuple[Target | None, int]:
        if (brace := _OPEN.match(code, at)) is not None:
            start = brace.end()
            parts, close = components(self.lines[line - 1], start, f"{self.name}:{line}")
            if any(re.fullmatch(r"A[1-6]", name) for name in parts):
                return self._axes(code, (start, close + 1), word, line)
            require_cartesian(parts, code[start : close + 1], f"{self.name}:{line}:{start + 1}")
            return Target(False, line, parts, close, "", start, close + 1, code[start : close + 1]), close + 1
        match = _NAME.match(code, at)
        if match is None:
            raise self._fault("a motion without a target", code, line, at, hint="The line may be cut off")
        name, key = match[1], key_of(match[1])
        if key in self._axis_angles:
            return self._axes(code, match.span(1), word, line)
        if key in self.assigned:
            raise self._fault(
                f"{name} is computed by the program: such targets are not read", code, line, match.start(1),
                hint="Write the target itself",
            )  # fmt: skip
        named = self.named.get(key)
        if named is None:
            if _OF_CONTROLLER.fullmatch(key) and word.endswith("PTP"):
                return None, match.end(1)
            raise self._fault(
                f"where {name} is, is not known", code, line, match.start(1),
                limit="given in braces in the .dat file" + ("" if self.data_name else ", and there is none beside it"),
                hint="Give .src and .dat together, under the same name",
            )  # fmt: skip
        parts, close = named.components(self.data_name)
        if any(re.fullmatch(r"A[1-6]", one) for one in parts):
            return self._axes(code, match.span(1), word, line)
        require_cartesian(parts, named.text.strip(), f"{self.data_name}:{named.line}:{named.start + 1}")
        literal = named.text[named.start : close + 1]
        return Target(True, named.line, parts, close, name, match.start(1), match.end(1), literal), match.end(1)

    def _axes(self, code: str, span: tuple[int, int], word: str, line: int) -> tuple[None, int]:
        if not word.endswith("PTP"):
            raise self._fault("axis angles are no target of a path", code, line, span[0], limit="X Y Z A B C")
        return None, span[1]

    def _mentions(self, name: str) -> int:
        """How often a name stands in the code of the program."""
        if self._mentioned is None:
            counts: dict[str, int] = {}
            for line in self.lines:
                for parts in re.findall(form.NAME, code_of(line)):
                    counts[key_of(parts)] = counts.get(key_of(parts), 0) + 1
            self._mentioned = counts
        return self._mentioned.get(key_of(name), 0)

    # ---- places ----------------------------------------------------------------------------------------------

    def made(self, read: KrlMotion, before: Motion | None, R_tcp_tool: Float) -> tuple[Motion, Float, tuple[Word, ...]]:
        """The motion to a target, the orientation at its end, and its words.

        Args:
            read: From :meth:`motion`.
            before: The motion before; None for the first.
            R_tcp_tool: (3, 3) ``$TOOL`` in the TCP frame of the cell.
        """
        target = read.target
        if target is None:
            raise ValueError("a motion without a target")
        self._check_external(target)
        p, angles = self._place(target, before)
        self._angles = angles
        R_part_tcp: Float = rotation.from_zyx(np.array(angles) * DEG) @ R_tcp_tool.T
        words = tuple(
            Word(letter, component.value, *((0, 0) if target.in_data else (component.start, component.end)))
            for letter, component in target.components.items()
            if letter in LETTERS
        )
        start = p if before is None else before.p_end
        motion = Motion(0, "feed", start, p, 0.0, 0.0, 0)
        if read.auxiliary is not None and before is not None:
            motion = self._arc(motion, read, self._place(read.auxiliary, before)[0])
        return motion, R_part_tcp, words

    def _place(self, target: Target, before: Motion | None) -> tuple[Float, list[float]]:
        """Point in m and angles in deg; components that are not written stay as they are."""
        values: list[float] = []
        for index, letter in enumerate(LETTERS):
            component = target.components.get(letter)
            if component is not None:
                values.append(component.value)
            elif before is None or self._angles is None or target.in_data:
                raise ProgramError(
                    f"a target without {letter}" + ("" if target.in_data else ", and nothing before says where it is"),
                    where=f"{self.data_name if target.in_data else self.name}:{target.line}:{target.close + 1}",
                    value=target.source[:60], limit="X Y Z A B C",
                )  # fmt: skip
            else:
                values.append(float(before.p_end[index]) / MM if index < 3 else self._angles[index - 3])
        return np.array(values[:3]) * MM, values[3:]

    def _arc(self, motion: Motion, read: KrlMotion, p_auxiliary: Float) -> Motion:
        def fault(what: str, hint: str) -> ProgramError:
            return ProgramError(
                what, where=f"{self.name}:{read.line}", value=self.lines[read.line - 1].strip()[:60], hint=hint
            )

        made = arc_through(motion, p_auxiliary, fault)
        if made.p_centre is None or made.normal is None:
            raise ValueError("a circle without its centre")
        if self._circle_rad is not None:
            turn = self._circle_rad
            if not 0.0 < abs(turn) <= 40.0 * math.pi:
                raise ProgramError(
                    "CA is out of range", where=f"{self.name}:{read.line}", value=f"{turn / DEG:g} deg",
                    limit="not 0, at most 20 turns",
                )  # fmt: skip
            made = replace(made, p_end=turned(made.p_start, made.p_centre, made.normal, turn), turn_rad=turn)
        return made

    def _check_external(self, target: Target) -> None:
        """Refuse external axes that move, or stand elsewhere than the cell says."""
        given = {name: part for name, part in target.components.items() if re.fullmatch(r"E[1-6]", name)}
        where = f"{self.data_name if target.in_data else self.name}:{target.line}"
        for name, part in given.items():
            self._external_axes.check(int(name[1]), part.value, name, where)
            self._external.setdefault(name, part)

    def _fault(self, what: str, code: str, line: int, at: int, **more: str) -> ProgramError:
        return ProgramError(what, where=f"{self.name}:{line}:{at + 1}", value=code.strip()[:60], **more)
