"""Frames and speeds of a KRL program: what sets them, and what is active."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from counterflex.core.errors import ProgramError
from counterflex.programs.krl.read import statements as form
from counterflex.programs.krl.read.data_list import Named, key_of
from counterflex.programs.krl.read.frames import Frames, KrlCell
from counterflex.programs.krl.read.literals import components, frame, number_of

_LARGEST_VELOCITY: Final = 20.0


class Modes:
    """What is active while a program runs, and the statements that set it.

    Args:
        name: Of the ``.src`` file, for errors.
        lines: Of it.
        named: Literals of the ``.dat`` file.
        data_name: Its name; empty where there is none.
        cell: See :class:`KrlCell`.

    Attributes:
        frames: The active frames.
        line: Number of the line that is executed.
    """

    def __init__(
        self, name: str, lines: Sequence[str], named: Mapping[str, Named], data_name: str, cell: KrlCell | None
    ) -> None:
        self.name, self.lines, self.named, self.data_name = name, lines, named, data_name
        self.frames: Frames = Frames(cell)
        self._speed_set = False
        self._spline: float | None = None
        self.line = 0
        self._feed_m_s: float | None = None
        self._flow: list[tuple[str, int]] = []
        self._actual: dict[str, str] = {}
        self._pending_frames = ""

    def _speed(self, code: str) -> bool:
        if (match := form.VELOCITY.fullmatch(code)) is not None:
            self._refuse_in_flow(code, "the speed is set")
            self._set_speed(match[1], code)
            return True
        if (match := form.VELOCITIES.fullmatch(code)) is not None:
            self._refuse_in_flow(code, "the speed is set")
            parts, _ = components(self.lines[self.line - 1], match.start(1), f"{self.name}:{self.line}")
            if "CP" in parts:
                self._set_speed(str(parts["CP"].value), code)
            return True
        return False

    def _set_speed(self, text: str, code: str) -> None:
        self._feed_m_s = self._in_range(text, code)
        self._speed_set = True

    def _in_range(self, text: str, code: str) -> float:
        value = number_of(text)
        if value is None or not 0.0 < value <= _LARGEST_VELOCITY:
            raise self._fault(
                "the path speed is no number in range", code,
                limit=f"$VEL.CP above 0, at most {_LARGEST_VELOCITY:g} m/s",
                hint="Write the number itself, in m/s",
            )  # fmt: skip
        return value

    def _frame(self, code: str) -> bool:
        if (match := form.MODE.fullmatch(code)) is not None:
            if match[1].upper() == "TCP":
                raise self._fault(
                    "the robot holds the part against a tool that stands ($IPO_MODE=#TCP), which is not read", code,
                    limit="$IPO_MODE=#BASE", hint="Give the G-code that it was made from",
                )  # fmt: skip
            return True
        match = form.FRAME.fullmatch(code)
        if match is None:
            return False
        self._refuse_in_flow(code, f"${match[1].upper()} is set")
        self._set_frame(match[1].upper(), match[2], match.start(2), code)
        return True

    def _set_frame(self, word: str, text: str, start: int, code: str) -> None:
        where = f"{self.name}:{self.line}:{start + 1}"
        if (number := form.BY_NUMBER.fullmatch(text)) is not None and number[1].upper() == word:
            (self.frames.set_tool_data if word == "TOOL" else self.frames.set_base_data)(int(number[2]), where)
        elif text.startswith("{"):
            parts, close = components(self.lines[self.line - 1], start, f"{self.name}:{self.line}")
            if code[close + 1 :].strip():
                raise self._fault("computed frames are not read", code, hint="Write the frame itself")
            (self.frames.set_tool if word == "TOOL" else self.frames.set_base)(frame(parts), where)
        elif (named := self.named.get(key_of(text))) is not None:
            parts, _ = named.components(self.data_name)
            (self.frames.set_tool if word == "TOOL" else self.frames.set_base)(frame(parts), where)
        elif form.NO_FRAME.fullmatch(text):
            (self.frames.set_tool if word == "TOOL" else self.frames.set_base)(np.eye(4), where)
        else:
            raise self._fault(
                f"which frame ${word} gets is not known", code,
                limit=f"{word}_DATA[n], a frame in braces, or a name of the .dat file", hint="Write the frame itself",
            )  # fmt: skip

    def _basic(self, code: str) -> bool:
        if (match := form.ACTUAL.fullmatch(code)) is not None:
            self._actual[match[1].upper()] = match[2].strip()
            return True
        match = form.BASIC.fullmatch(code)
        if match is None:
            return False
        word, argument = match[1].upper(), match[2] or ""
        if word in form.BASIC_PASSED:
            return True
        self._refuse_in_flow(code, "speed or frames are set")
        if word in ("VEL_CP", "CP_PARAMS"):
            self._set_speed(argument, code)
        elif word == "CP_DAT":
            self._set_speed(str(self._component_of("LDAT_ACT", "VEL", code)), code)
        elif word in ("TOOL", "BASE"):
            number = number_of(argument)
            if number is None or number != int(number):
                raise self._fault(f"{word} needs a number", code, hint="Write the number itself")
            self._set_frame(word, f"{word}_DATA[{int(number)}]", match.start(), code)
        elif word not in ("FRAMES", "PTP_PARAMS"):
            raise self._fault(
                f"BAS with #{word} is not read", code,
                limit="INITMOV VEL_CP CP_PARAMS PTP_PARAMS CP_DAT PTP_DAT TOOL BASE FRAMES VEL_PTP ACC_PTP ACC_CP",
                hint="Write out what it sets",
            )  # fmt: skip
        if word in ("CP_PARAMS", "PTP_PARAMS", "FRAMES") and "FDAT_ACT" in self._actual:
            self.frames.tool_known = self.frames.base_known = True
            self._pending_frames = self._actual["FDAT_ACT"]
        return True

    def _require_frame_data(self, code: str) -> None:
        """Check the frame data that BAS took, where a Cartesian motion uses them."""
        if self._pending_frames:
            self._actual["FDAT_ACT"] = self._pending_frames
            self._pending_frames = ""
            for word in ("TOOL", "BASE"):
                number = int(self._component_of("FDAT_ACT", f"{word}_NO", code))
                self._set_frame(word, f"{word}_DATA[{number}]", 0, code)

    def _component_of(self, variable: str, component: str, code: str) -> float:
        text = self._actual.get(variable, "")
        if text.startswith("{"):
            parts, _ = components(text, 0, f"{self.name}:{self.line}", mixed=True)
        elif (named := self.named.get(key_of(text))) is not None:
            parts, _ = named.components(self.data_name, mixed=True)
        else:
            parts = {}
        if component not in parts:
            raise self._fault(
                f"{component} of {text or variable} is not known", code, limit="given in the .dat file beside the .src",
                hint="Give .src and .dat together, or write the frame itself",
            )  # fmt: skip
        return parts[component].value

    def _spline_block(self, code: str) -> bool:
        """SPLINE and ENDSPLINE; between them ``_spline`` is the speed of the block, 0 where it has none of its own."""
        if (begins := form.SPLINE_BEGINS.fullmatch(code)) is not None:
            if self._spline is not None or not form.WITH_OTHERS.fullmatch(begins[1]):
                raise self._fault("this beginning of a spline block is not understood", code,
                                  limit="SPLINE WITH $VEL.CP=0.02",
                                  hint="Set speed and acceleration alone there")  # fmt: skip
            self._refuse_in_flow(code, "a spline block")
            velocity = form.WITH_VELOCITY.search(begins[1]) or form.WITH_VELOCITIES.search(begins[1])
            if velocity is None and form.WITH_ANY_VELOCITY.search(begins[1]):
                raise self._fault("the path speed of a spline block is no number", code,
                                  limit="SPLINE WITH $VEL.CP=0.02", hint="Write the number itself, in m/s")  # fmt: skip
            self._spline = 0.0 if velocity is None else self._in_range(velocity[1], code)
            return True
        if form.SPLINE_ENDS.fullmatch(code) is None:
            return False
        if self._spline is None:
            raise self._fault("ENDSPLINE closes nothing", code, hint="The file may be damaged: post it again")
        self._spline = None
        return True

    def _refuse_in_flow(self, code: str, what: str) -> None:
        if self._flow:
            word, line = self._flow[-1]
            raise self._fault(
                f"{what} inside {word} (line {line}): whether and how often is not known", code,
                limit="straight through, each line once", hint="Post the path without loops and conditions",
            )  # fmt: skip

    def _fault(self, what: str, code: str, **more: str) -> ProgramError:
        column = len(code) - len(code.lstrip()) + 1
        return ProgramError(what, where=f"{self.name}:{self.line}:{column}", value=code.strip()[:60], **more)
