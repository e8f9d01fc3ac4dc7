"""Everything a block changes before it moves: modes, speeds, tool, offsets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from counterflex.core.units import INCH, MM
from counterflex.programs.gcode.read.block import BlockWords
from counterflex.programs.gcode.read.codes import code_name
from counterflex.programs.gcode.read.state import WORK_OFFSETS, ZERO, Six, State, minus, plus
from counterflex.programs.program import TOOL_CENTRE, TOOL_VECTOR

_OFFSET_CODES: Final = (540, 550, 560, 570, 580, 590, 591, 592, 593)
_WORK_OFFSET: Final = dict(zip(_OFFSET_CODES, WORK_OFFSETS, strict=True))
_MOST: Final = 1_000_000.0


def apply_rates(block: BlockWords, state: State) -> None:
    """Apply feed mode, F, S, T, tool change, spindle and coolant, in the order LinuxCNC executes them."""
    _feed(block, state)
    speed = block.take("S")
    if speed is not None:
        if not 0.0 <= speed <= _MOST:
            raise block.fault("the spindle speed S is out of range", "S", hint="0 to 1e6 1/min")
        state.speed_rpm = speed
    tool = block.whole("T", 0, 99_999)
    if tool is not None:
        state.prepared = tool
    _spindle_mode(block, state)
    _tool_change(block, state)
    spindle = block.m.get("spindle")
    if spindle is not None:
        if spindle == 190:
            for letter in "RPQ":
                block.take(letter)
            state.spindle = 0
        else:
            state.spindle = {30: 1, 40: -1, 50: 0}[spindle]
    output = block.m.get("output")
    if output is not None:
        for letter in "P" if output < 670 else "EQ":
            block.take(letter)
    if block.m.get("override") is not None:
        block.take("P")


def _feed(block: BlockWords, state: State) -> None:
    mode = block.g.get("feed")
    if mode is not None and mode // 10 != state.feed_mode:
        state.feed_mode = mode // 10
        state.feed = None
    unit = block.g.get("units")
    feed = block.take("F")
    if feed is None:
        return
    if not 0.0 <= feed <= _MOST:
        raise block.fault("the feed F is out of range", "F", hint="0 to 1e6")
    if unit is not None and _unit(unit) != state.unit_m and state.feed_mode != 93:
        raise block.fault(
            "F stands in the block that changes the unit: controllers differ in which unit it takes",
            "F",
            hint="Write F in a later block",
        )
    state.feed = feed
    state.feed_unit_m = state.unit_m


def _tool_change(block: BlockWords, state: State) -> None:
    change = block.m.get("tool change")
    if change == 60:
        if state.prepared is None:
            raise block.fault("M6 changes to a tool that no T word has chosen", "M60", "M6", "Write T1 M6")
        state.tool = state.prepared
        state.spindle = 0
    elif change == 610:
        number = block.whole("Q", 0, 99_999)
        if number is None:
            raise block.fault("M61 needs the tool number Q", "M610", "M61")
        state.tool = number


def _spindle_mode(block: BlockWords, state: State) -> None:
    code = block.g.get("spindle mode")
    if code == 960:
        limit = block.take("D")
        if limit is None or limit <= 0.0:
            raise block.fault("G96 needs a speed limit D above 0", "G960" if limit is None else "D")
        state.constant_surface = True
        state.speed_limit = limit
    elif code == 970:
        state.constant_surface = False


def _unit(code: int) -> float:
    return INCH if code == 200 else MM


def apply_modes(block: BlockWords, state: State, tool_lengths: Mapping[int, float] | None) -> None:
    """Apply plane, units, tool length offset, work offset, path control, distance and retract modes."""
    groups = block.g
    if "plane" in groups:
        state.plane = groups["plane"] // 10
    if "units" in groups:
        state.unit_m = _unit(groups["units"])
    if groups.get("cutter radius") == 400:
        block.take("D")
    if "tool length" in groups:
        _tool_length(block, state, tool_lengths)
    if "work offset" in groups:
        state.work_offset = _WORK_OFFSET[groups["work offset"]]
    if groups.get("path control") == 640:
        for letter in "PQ":
            value = block.take(letter)
            if value is not None and value < 0.0:
                raise block.fault("a path tolerance is negative", letter)
    if "distance" in groups:
        state.absolute = groups["distance"] == 900
    if "arc distance" in groups:
        state.arc_absolute = groups["arc distance"] == 901
    if "retract" in groups:
        state.retract_initial = groups["retract"] == 980


def _tool_length(block: BlockWords, state: State, tool_lengths: Mapping[int, float] | None) -> None:
    """Change the tool length offset; the machine stays where it is, so the tip's coordinates change."""
    code = block.g["tool length"]
    before = state.tool_length
    if (code == TOOL_VECTOR) != (state.tool_centre == TOOL_VECTOR):
        x, y, z, *_ = state.position  # the same three places now mean angles instead of components, or the reverse
        state.position = (x, y, z, 0.0, 0.0, 0.0)
    state.tool_centre = code if code in (TOOL_CENTRE, TOOL_VECTOR) else 0
    if code == 490:
        state.tool_length = ZERO
    elif code == 431:
        given = block.take_axes()
        if not given:
            raise block.fault("G43.1 needs an axis word", "G431", "G43.1")
        offset = list(before)
        for axis, value in given.items():
            offset[axis] = value * state.unit_m if axis < 3 else value
        state.tool_length = (offset[0], offset[1], offset[2], offset[3], offset[4], offset[5])
    else:
        number = block.whole("H", 0, 99_999)
        number = state.tool if number is None else number
        if tool_lengths is None or number == 0:
            state.tool_length = ZERO
        elif number in tool_lengths:
            state.tool_length = (0.0, 0.0, float(tool_lengths[number]), 0.0, 0.0, 0.0)
        else:
            known = " ".join(str(key) for key in sorted(tool_lengths))
            raise block.fault(
                "G43 names a tool without a known length", "H", f"tool {number}", f"Known tools: {known or 'none'}"
            )
    state.position = plus(state.position, minus(before, state.tool_length))


def apply_offsets(block: BlockWords, state: State) -> None:
    """Apply G10, G52 and the G92 family; the tool does not move."""
    code = block.g.get("non-modal")
    if code == 100:
        _set_work_offset(block, state)
    elif code in (520, 920):
        axes = block.take_axes()
        if not axes:
            raise block.fault(f"{code_name('G', code)} needs an axis word", f"G{code}", code_name("G", code))
        shift = list(state.g92)
        here = minus(state.position, state.work_offsets[state.work_offset])
        for axis, value in axes.items():
            number = value * state.unit_m if axis < 3 else value
            shift[axis] = number if code == 520 else here[axis] - number
        state.g92 = state.g92_saved = _as_six(shift)
    elif code == 921:
        state.g92 = state.g92_saved = ZERO
    elif code == 922:
        state.g92 = ZERO
    elif code == 923:
        state.g92 = state.g92_saved


def _set_work_offset(block: BlockWords, state: State) -> None:
    kind = block.whole("L", 0, 99)
    if kind not in (2, 20):
        raise block.fault("G10 is read with L2 or L20 only", "L" if kind is not None else "G100")
    number = block.whole("P", 0, 9)
    if number is None:
        raise block.fault("G10 needs the number P of the work offset", "G100", "G10")
    turn = block.take("R")
    if turn is not None and abs(turn) > 0.0:
        raise block.fault("a rotated work offset (G10 ... R) is not read", "R", hint="Post the program unrotated")
    name = state.work_offset if number == 0 else WORK_OFFSETS[number - 1]
    offset = list(state.work_offsets[name])
    shifted = minus(state.position, state.g92)
    for axis, value in block.take_axes().items():
        given = value * state.unit_m if axis < 3 else value
        offset[axis] = given if kind == 2 else shifted[axis] - given
    state.work_offsets[name] = _as_six(offset)


def _as_six(values: list[float]) -> Six:
    return (values[0], values[1], values[2], values[3], values[4], values[5])
