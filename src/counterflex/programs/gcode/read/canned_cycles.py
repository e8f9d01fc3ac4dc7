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

# How far G73 and G83 stay off the chips.
_CLEARANCE_M: Final = 0.010 * INCH
# A hole of more pecks than this is a mistake in Q.
_MOST_PECKS: Final = 100_000
_SAME_NUMBER: Final = 1e-6
_SAME_HEIGHT_M: Final = 1e-9


@dataclass(frozen=True)
class Step:
    """One move of a cycle along its axis, or a dwell."""

    kind: str  # ``rapid``, ``feed`` or ``dwell``
    height: float  # Target along the cycle's axis, m; of a dwell the height it happens at
    dwell_s: float = 0.0  # Of a dwell
    spindle: bool = True  # The spindle runs (G86 stops it for the way out)


def hole(code: int, r: float, bottom: float, clear: float, peck: float, dwell_s: float) -> Iterator[Step]:
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
            yield Step("feed", depth)
            if code == 730:
                yield Step("rapid", depth + _CLEARANCE_M)
            else:
                yield Step("rapid", r)
                yield Step("rapid", depth + _CLEARANCE_M)
            depth -= peck
    yield Step("feed", bottom)
    if code in (820, 860, 890):
        yield Step("dwell", bottom, dwell_s)
    if code == 850:
        yield Step("feed", r)
        if clear > r:
            yield Step("rapid", clear)
    elif code == 890:
        yield Step("feed", clear)
    else:
        yield Step("rapid", clear, spindle=code != 860)


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
        needed = "ZR" + {730: "Q", 830: "Q", 820: "P", 860: "P", 890: "P"}.get(code, "")
        count = self._cycle_words(block, code, axes, needed)
        self._require_axes(block, state.unknown - (set(axes) if state.absolute else set()), "a canned cycle")
        if third in state.frame.mirror_m:
            raise block.fault("a canned cycle along a mirrored axis is not read", f"G{code}", name, "Post its moves")
        sticky = state.cycle
        peck, dwell_s = sticky.get("Q", 0.0) * state.unit_m, sticky.get("P", 0.0)
        if code == 860 and state.spindle_rpm == 0.0:
            raise block.fault("G86 with the spindle stopped", f"G{code}", "0 rpm", "Start it with M3 or M4")
        if "Q" in needed and peck <= 0.0:
            raise block.fault(f"the peck Q of {name} is not positive", "Q", f"Q{sticky['Q']:g}")
        if "P" in needed and not 0.0 <= dwell_s <= LONGEST_DWELL_S:
            raise block.fault(f"the dwell P of {name} is out of range", "P", f"P{dwell_s:g}")
        here = state.position[third]
        if state.cycle_initial is None:
            state.cycle_initial = here
            state.cycle_began = (state.plane, (here - state.origin[third]) / state.unit_m)
        old = state.cycle_initial
        self._same_series(block, name, (old - state.origin[third]) / state.unit_m)
        base = state.origin[third] if state.absolute else old
        r = base + sticky["R"] * state.unit_m
        bottom = (base if state.absolute else r) + sticky["Z"] * state.unit_m
        if bottom > r:
            heights = [(height - state.origin[third]) / state.unit_m for height in (r, bottom)]
            raise block.fault(
                f"the R height of {name} is below the bottom of the hole",
                "R",
                f"R at {heights[0]:.6g}, bottom at {heights[1]:.6g}",
            )
        if "Q" in needed and (r - bottom) / peck > _MOST_PECKS:
            raise block.fault(f"the peck Q of {name} makes too many pecks", "Q", f"Q{sticky['Q']:g}")
        if old < r and here != r:
            self._along(block, third, r, rapid=True)
        clear = max(r, old) if state.retract_initial else r
        for _ in range(count):
            target = list(target_of(state, block, axes))
            above = state.position[third] - r > _SAME_HEIGHT_M  # as LinuxCNC does: not up to clear first
            target[third] = state.position[third] if above else clear
            self.straight(block, (target[0], target[1], target[2], target[3], target[4], target[5]), rapid=True)
            if state.position[third] != r:
                self._along(block, third, r, rapid=True)
            for step in hole(code, r, bottom, clear, peck, dwell_s):
                self._step(block, third, step)

    def _same_series(self, block: BlockWords, name: str, initial: float) -> None:
        """Refuse a series of cycles whose first height means another place since a change of plane, offset or unit."""
        plane, began = self._state.cycle_began
        if plane != self._state.plane or abs(initial - began) > _SAME_NUMBER:
            raise block.fault(
                f"{name} continues a series of cycles after a change of plane, offset or unit: controllers differ "
                f"in the initial height of the series",
                f"G{self._state.motion}",
                f"{began:.6g} in G{plane} then, {initial:.6g} in G{self._state.plane} now",
                "End the series before the change with G80 and begin the next with G0",
            )

    def _cycle_words(self, block: BlockWords, code: int, axes: dict[int, float], needed: str) -> int:
        """Take the words of a canned cycle into those that stay in force; returns the number of repetitions L."""
        third, name, sticky = PLANE_AXES[self._state.plane][2], code_name("G", code), self._state.cycle
        if third in axes:
            sticky["Z"] = axes.pop(third)
        for letter in needed[1:]:
            value = block.take(letter)
            if value is not None:
                sticky[letter] = value
        count = block.whole("L", 1, 10_000) or block.whole("K", 1, 10_000) or 1  # K: Fanuc
        for letter in needed:
            if letter not in sticky:
                shown = "XYZ"[third] if letter == "Z" else letter
                raise block.fault(f"{name} needs the word {shown}", f"G{code}", name)
        return count

    def _along(self, block: BlockWords, axis: int, height: float, rapid: bool) -> None:
        target = list(self._state.position)
        target[axis] = height
        self.straight(block, (target[0], target[1], target[2], target[3], target[4], target[5]), rapid)

    def _step(self, block: BlockWords, axis: int, step: Step) -> None:
        if step.kind == "dwell":
            self.dwell(block, step.dwell_s, step.spindle)
            return
        running = self._state.spindle
        if not step.spindle:
            self._state.spindle = 0
        self._along(block, axis, step.height, rapid=step.kind == "rapid")
        self._state.spindle = running
