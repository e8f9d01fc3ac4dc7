"""Canned drilling and boring cycles as the moves they stand for.

Source: LinuxCNC, "Canned Cycles": before the first hole of a series a rapid up to R, then per hole a rapid in the
plane, a rapid to R, the cycle, and retraction to R (G99) or to the higher of R and the series' first height (G98).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from counterflex.core.units import INCH
from counterflex.programs.gcode.read.arc import PLANE_AXES
from counterflex.programs.gcode.read.block import BlockWords
from counterflex.programs.gcode.read.codes import code_name
from counterflex.programs.gcode.read.motion import LONGEST_DWELL_S, MotionMaker
from counterflex.programs.gcode.read.targets import target_of
from counterflex.programs.gcode.read.work_offsets import six

# How far G73 and G83 stay off the chips.
_CLEARANCE_M: Final = 0.010 * INCH
# A hole of more pecks than this is a mistake in Q.
_MOST_PECKS: Final = 100_000
_SAME_NUMBER: Final = 1e-6
_SAME_HEIGHT_M: Final = 1e-9


@dataclass(frozen=True)
class CycleStep:
    """One move of a cycle along its axis, or a dwell."""

    kind: str  # ``rapid``, ``feed`` or ``dwell``
    height: float  # Target along the cycle's axis, m; of a dwell the height it happens at
    dwell_s: float = 0.0  # Of a dwell
    spindle: bool = True  # The spindle runs (G86 stops it for the way out)


def hole(code: int, r: float, bottom: float, clear: float, peck: float, dwell_s: float) -> Iterator[CycleStep]:
    """Yield the moves of one hole, from the R height to the clear height.

    Args:
        code: Tenths of the G code: 730, 810, 820, 830, 850, 860 or 890.
        r: R height, m.
        bottom: Bottom of the hole, m, at most ``r``.
        clear: Height to retract to, m.
        peck: Q, m, > 0 for G73 and G83.
        dwell_s: P, s.
    """
    if code in (730, 830):
        depth = r - peck
        while depth > bottom + 1e-12:
            yield CycleStep("feed", depth)
            if code == 730:
                yield CycleStep("rapid", depth + _CLEARANCE_M)
            else:
                yield CycleStep("rapid", r)
                yield CycleStep("rapid", depth + _CLEARANCE_M)
            depth -= peck
    yield CycleStep("feed", bottom)
    if code in (820, 860, 890):
        yield CycleStep("dwell", bottom, dwell_s)
    if code == 850:
        yield CycleStep("feed", r)
        if clear > r:
            yield CycleStep("rapid", clear)
    elif code == 890:
        yield CycleStep("feed", clear)
    else:
        yield CycleStep("rapid", clear, spindle=code != 860)


class CycleMaker(MotionMaker):
    """Makes the motions of canned cycles, too."""

    def cycle(self, block: BlockWords, code: int) -> None:
        """Execute a canned cycle; its words stay in force while the same cycle is repeated."""
        state = self._state
        third = PLANE_AXES[state.plane][2]
        name = code_name("G", code)
        if state.feed_mode == 93:
            raise block.fault("canned cycles do not work in inverse time (G93)", f"G{code}", name)
        axes = block.take_axes()
        rotary = [axis for axis in axes if axis > 2]
        if rotary:
            raise block.fault("a canned cycle cannot turn a rotary axis", "XYZABC"[rotary[0]])
        count = self._cycle_words(block, code, axes)
        self._require_axes(block, state.unknown - (set(axes) if state.absolute else set()), "a canned cycle")
        peck, dwell_s = self._peck_and_dwell(block, code, name)
        here = state.position[third]
        r, bottom, old = self._heights(block, name, third)
        if code in (730, 830) and (r - bottom) / peck > _MOST_PECKS:
            raise block.fault(f"the peck Q of {name} makes too many pecks", "Q", f"Q{state.cycle['Q']:g}")
        if old < r and here != r:
            self._along(block, third, r, rapid=True)
        clear = max(r, old) if state.retract_initial else r
        for _ in range(count):
            target = list(target_of(state, block, axes))
            above = state.position[third] - r > _SAME_HEIGHT_M  # as LinuxCNC does: not up to clear first
            target[third] = state.position[third] if above else clear
            self.straight(block, six(target), rapid=True)
            if state.position[third] != r:
                self._along(block, third, r, rapid=True)
            for step in hole(code, r, bottom, clear, peck, dwell_s):
                self._step(block, third, step)

    def _peck_and_dwell(self, block: BlockWords, code: int, name: str) -> tuple[float, float]:
        """Peck Q in m and dwell P in s."""
        state, sticky = self._state, self._state.cycle
        peck, dwell_s = sticky.get("Q", 0.0) * state.unit_m, sticky.get("P", 0.0)
        if PLANE_AXES[state.plane][2] in state.frame.mirror_m:
            raise block.fault("a canned cycle along a mirrored axis is not read", f"G{code}", name, "Post its moves")
        if code == 860 and state.spindle_rpm == 0.0:
            raise block.fault("G86 with the spindle stopped", f"G{code}", "0 rpm", "Start it with M3 or M4")
        if code in (730, 830) and peck <= 0.0:
            raise block.fault(f"the peck Q of {name} is not positive", "Q", f"Q{sticky['Q']:g}")
        if code in (820, 860, 890) and not 0.0 <= dwell_s <= LONGEST_DWELL_S:
            raise block.fault(f"the dwell P of {name} is out of range", "P", f"P{dwell_s:g}")
        return peck, dwell_s

    def _heights(self, block: BlockWords, name: str, third: int) -> tuple[float, float, float]:
        """R height, bottom and first height of the series, m; refuse a series whose first height changed its meaning.

        A change of plane, offset or unit does that.
        """
        state, sticky = self._state, self._state.cycle
        origin, unit = state.origin[third], state.unit_m
        if state.cycle_initial is None:
            state.cycle_initial = state.position[third]
            state.cycle_began = (state.plane, (state.cycle_initial - origin) / unit)
        old = state.cycle_initial
        (plane, began), initial = state.cycle_began, (old - origin) / unit
        if plane != state.plane or abs(initial - began) > _SAME_NUMBER:
            raise block.fault(
                f"{name} continues a series of cycles after a change of plane, offset or unit: controllers differ "
                f"in the initial height of the series", f"G{state.motion}",
                f"{began:.6g} in G{plane} then, {initial:.6g} in G{state.plane} now",
                "End the series before the change with G80 and begin the next with G0",
            )  # fmt: skip
        r = (origin if self._from_zero(block, name, "R") else old) + sticky["R"] * unit
        bottom = (origin if self._from_zero(block, name, "Z") else r) + sticky["Z"] * unit
        if bottom > r:
            heights = [(height - origin) / unit for height in (r, bottom)]
            raise block.fault(f"the R height of {name} is below the bottom of the hole", "R",
                              f"R at {heights[0]:.6g}, bottom at {heights[1]:.6g}")  # fmt: skip
        return r, bottom, old

    def _from_zero(self, block: BlockWords, name: str, letter: str) -> bool:
        """Tell whether a height of the cycle counts from program zero.

        LinuxCNC goes by the mode in force. Fanuc and Haas keep the height that was stated under G90: their rows of
        holes are ``G90 G81 X0 Z-5 R2`` and then ``G91 X10 K5``.
        """
        state = self._state
        if not state.of_fanuc or state.cycle_absolute[letter] == state.absolute:
            return state.absolute
        if state.absolute:
            raise block.fault(
                f"{name} under G90 takes over a height of G91: controllers differ in where it counts from",
                f"G{state.motion}", f"{letter}{state.cycle[letter]:g}", "State Z and R again behind G90",
            )  # fmt: skip
        return True

    def _cycle_words(self, block: BlockWords, code: int, axes: dict[int, float]) -> int:
        """Take the words of a canned cycle into those that stay in force; returns the number of repetitions L."""
        needed = "ZR" + {730: "Q", 830: "Q", 820: "P", 860: "P", 890: "P"}.get(code, "")
        third, name, sticky = PLANE_AXES[self._state.plane][2], code_name("G", code), self._state.cycle
        if third in axes:
            sticky["Z"] = axes.pop(third)
            self._state.cycle_absolute["Z"] = self._state.absolute
        for letter in needed[1:]:
            value = block.take(letter)
            if value is not None:
                sticky[letter] = value
                self._state.cycle_absolute[letter] = self._state.absolute
        count = block.whole("L", 1, 10_000)
        if count is None and (count := block.whole("K", 1, 10_000)) is not None:
            self._state.of_fanuc = True  # no cycle of LinuxCNC has K
        for letter in needed:
            if letter not in sticky:
                shown = "XYZ"[third] if letter == "Z" else letter
                raise block.fault(f"{name} needs the word {shown}", f"G{code}", name)
        return count or 1

    def _along(self, block: BlockWords, axis: int, height: float, rapid: bool) -> None:
        target = list(self._state.position)
        target[axis] = height
        self.straight(block, six(target), rapid)

    def _step(self, block: BlockWords, axis: int, step: CycleStep) -> None:
        if step.kind == "dwell":
            self.dwell(block, step.dwell_s, step.spindle)
            return
        running = self._state.spindle
        if not step.spindle:
            self._state.spindle = 0
        self._along(block, axis, step.height, rapid=step.kind == "rapid")
        self._state.spindle = running
