"""Everything a block changes before it moves: modes, speeds, tool, offsets."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Final

from counterflex.core.units import INCH, MM
from counterflex.programs.gcode.read.arc import PLANE_AXES
from counterflex.programs.gcode.read.block import BlockWords
from counterflex.programs.gcode.read.codes import HAAS_OFFSETS, code_name
from counterflex.programs.gcode.read.state import ModalState, minus, plus
from counterflex.programs.gcode.read.work_offsets import (
    LINUXCNC_OFFSETS,
    MOST_FURTHER,
    ZERO,
    Frame,
    Rotation,
    further,
    six,
)
from counterflex.programs.program import TOOL_CENTRE, TOOL_VECTOR

_OFFSET_CODES: Final = (540, 550, 560, 570, 580, 590, 591, 592, 593)
_WORK_OFFSET: Final = dict(zip(_OFFSET_CODES, LINUXCNC_OFFSETS, strict=True)) | {
    code: further(number) for code, number in HAAS_OFFSETS.items()
}
_FURTHER: Final = (541, 1540)
_GIVE_OFFSETS: Final = (
    "Give the zeros of all offsets in the cell file (--cell): part.work_offsets_mm = {{G54 = [0, 0, 0], {0} = [...]}}; "
    "or the parameters of the machine: --parameters FILE"
)
_MOST: Final = 1_000_000.0


def apply_rates(block: BlockWords, state: ModalState) -> None:
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
    if "input" in block.m:
        for letter in "PELQ":
            block.take(letter)


def _feed(block: BlockWords, state: ModalState) -> None:
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


def _tool_change(block: BlockWords, state: ModalState) -> None:
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


def _spindle_mode(block: BlockWords, state: ModalState) -> None:
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


def apply_modes(block: BlockWords, state: ModalState, tool_lengths: Mapping[int, float] | None) -> None:
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
        _work_offset(block, state)
    _frame(block, state)
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


def _tool_length(block: BlockWords, state: ModalState, tool_lengths: Mapping[int, float] | None) -> None:
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
        state.tool_length = six(offset)
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


def _work_offset(block: BlockWords, state: ModalState) -> None:
    """Select a work offset; G54 P3 is G54.1 P3."""
    code = block.g["work offset"]
    name = _WORK_OFFSET.get(code, "")
    own = "non-modal" not in block.g and block.m.get("stopping") not in (970, 980)
    if code in _FURTHER or (code == 540 and block.has("P") and own):
        number = block.whole("P", 1, MOST_FURTHER)
        if number is None:
            raise block.fault(f"{code_name('G', code)} needs the number P of the offset", f"G{code}")
        name = further(number)
    state.work_offset = name
    _require_offset(block, state, f"G{code}")


def _require_offset(block: BlockWords, state: ModalState, code: str) -> None:
    """Refuse an offset in force whose zero is not known."""
    offsets, name = state.work_offsets, state.work_offset
    axes = offsets.unknown_axes(name)
    if not axes:
        return
    first = f"{offsets.reference} (line {offsets.line})" if offsets.reference else "the part"
    shown = "G55" if name == "G54" else f'"{name}"' if " " in name else name
    raise block.fault(
        f"how far {name} lies from {first} along {', '.join(axes)} is not known", code, name,
        _GIVE_OFFSETS.format(shown),
    )  # fmt: skip


def _frame(block: BlockWords, state: ModalState) -> None:
    """Apply G68 and G69, G51.1 and G50.1, G15 and G16."""
    groups = block.g
    if not {"rotation", "mirror", "polar"} & set(groups):
        if "plane" in groups and not (state.frame.rotation is None and not state.frame.polar):
            raise block.fault("the plane changes while G68 or G16 is active", f"G{groups['plane']}", None,
                              "Write G69 and G15 before")  # fmt: skip
        return
    if state.tool_centre:
        raise block.fault("G68, G51.1 and G16 under G43.4 or G43.5 are not read", "", None, "Write G49 before")
    frame, line = state.frame, block.line
    if "polar" in groups:
        frame = replace(frame, polar=groups["polar"] == 160, line=line)
        state.polar = {}
    if "mirror" in groups:
        frame = _mirror(block, state, frame)
    if "rotation" in groups:
        frame = _rotation(block, state, frame)
    if frame.rows != state.frame.rows:
        changed = frame.affected | state.frame.affected
        frame = replace(frame, line=line, pending=frame.pending | changed)
    state.frame = frame


def _mirror(block: BlockWords, state: ModalState, frame: Frame) -> Frame:
    on = block.g["mirror"] == 511
    if frame.rotation is not None:
        raise block.fault("the mirror image changes while G68 is active", f"G{block.g['mirror']}",
                          None, "Write G69 before")  # fmt: skip
    axes = {axis: value * state.unit_m for axis, value in block.take_axes().items()}
    if (on and not axes) or any(axis > 2 for axis in axes):
        raise block.fault("G51.1 needs X, Y or Z", "G511", "G51.1")
    if on and not state.absolute:
        raise block.fault("G51.1 in G91: where the mirror lies is not read", "G511", "G91", "Write G90")
    if on:
        return replace(frame, mirror_m=frame.mirror_m | axes)
    return replace(frame, mirror_m={axis: at for axis, at in frame.mirror_m.items() if axes and axis not in axes})


def _rotation(block: BlockWords, state: ModalState, frame: Frame) -> Frame:
    if block.g["rotation"] == 690:
        return replace(frame, rotation=None)
    first, second, third = PLANE_AXES[state.plane]
    if block.has("IJK") or block.has("XYZ"[third]):
        raise block.fault("a rotation G68 in space is not read", "G680", None, "Post the program unrotated")
    angle = block.take("R")
    if angle is None or (not state.absolute and frame.rotation is not None):
        what = "G68 without R: the angle is a setting of the control" if angle is None else (
            "G68 in G91 after G68: controllers differ in whether R is added")  # fmt: skip
        raise block.fault(what, "G680", None, "Write the angle as R, in G90")
    axes = block.take_axes()
    here = minus(state.position, state.origin)
    centre = []
    for axis in (first, second):
        if axis not in axes and (axis in state.unknown or frame.rows is not None):
            raise block.fault("the centre of G68 is not known", "G680", None,
                              f"Write {'XYZ'[first]} and {'XYZ'[second]} in the block")  # fmt: skip
        if axis in axes and not state.absolute:
            raise block.fault("the centre of G68 in G91 is not read", "XYZ"[axis], None, "Write it in G90")
        centre.append(axes[axis] * state.unit_m if axis in axes else here[axis])
    return replace(frame, rotation=Rotation(state.plane, (centre[0], centre[1]), angle))


def apply_offsets(block: BlockWords, state: ModalState) -> None:
    """Apply G10, G52 and the G92 family; the tool does not move."""
    code = block.g.get("non-modal")
    if code in (100, 520, 920, 921, 922, 923) and state.frame.rows is not None:
        raise block.fault(f"{code_name('G', code)} under G68 or G51.1: controllers differ in its axes", f"G{code}",
                          None, "Write G69 and G50.1 before")  # fmt: skip
    if code == 100:
        _set_work_offset(block, state)
        _require_offset(block, state, "G100")
    elif code in (520, 920):
        axes = block.take_axes()
        if not axes:
            raise block.fault(f"{code_name('G', code)} needs an axis word", f"G{code}", code_name("G", code))
        shift = list(state.g92)
        here = minus(state.position, state.work_offsets[state.work_offset])
        if code == 920:
            _require_place(block, state, axes, "G92")
        for axis, value in axes.items():
            number = value * state.unit_m if axis < 3 else value
            shift[axis] = number if code == 520 else here[axis] - number
        state.g92 = state.g92_saved = six(shift)
        state.g92_known = True
    elif code == 921:
        state.g92 = state.g92_saved = ZERO
        state.g92_known = True
    elif code == 922:
        state.g92 = ZERO
    elif code == 923:
        if not state.g92_known:
            raise block.fault("G92.3 brings back an offset that an earlier program left", "G923", None, "Write G92")
        state.g92 = state.g92_saved


def _require_place(block: BlockWords, state: ModalState, axes: Iterable[int], name: str) -> None:
    """Refuse an offset that is set from where the tool stands while that is not known."""
    if lost := sorted(state.unknown & set(axes)):
        letter = "XYZ"[lost[0]]
        raise block.fault(
            f"{name} sets zero from where the tool stands, and that is not known along {letter}", letter, None,
            "Leave it out: without offsets the zero of the program is that of the part",
        )  # fmt: skip


def _offset_named(block: BlockWords, state: ModalState) -> tuple[int, str]:
    """Kind L and name of the work offset that G10 sets."""
    kind = block.whole("L", 0, 99)
    if kind not in (2, 20):
        raise block.fault("G10 is read with L2 or L20 only", "L" if kind is not None else "G100", None,
                          "Set tools and parameters on the control")  # fmt: skip
    if kind == 2 and not state.absolute:
        raise block.fault(
            "G10 L2 in G91: LinuxCNC sets the offset, Fanuc and Haas add to it", "G100", "G91", "Write G90"
        )
    fanuc = kind == 20 and state.fanuc_offsets
    number = block.whole("P", 0, MOST_FURTHER if fanuc else 9)
    if number is None:
        raise block.fault("G10 needs the number P of the work offset", "G100", "G10")
    if block.take("R"):
        raise block.fault("a rotated work offset (G10 ... R) is not read", "R", hint="Post the program unrotated")
    return kind, state.work_offset if number == 0 else further(number) if fanuc else LINUXCNC_OFFSETS[number - 1]


def _set_work_offset(block: BlockWords, state: ModalState) -> None:
    kind, name = _offset_named(block, state)
    axes, offsets = block.take_axes(), state.work_offsets
    here = kind == 20 and not state.fanuc_offsets
    if here:
        _require_place(block, state, axes, "G10 L20")
    shifted = minus(state.position, state.g92)
    for axis, value in axes.items():
        given = value * state.unit_m if axis < 3 else value
        if here:
            offsets.set_here(name, axis, shifted[axis] - given)
        else:
            offsets.set_in_machine(name, axis, given)
