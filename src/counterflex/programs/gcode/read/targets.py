"""End point of a block from its axis words: G90 or G91, G53, rotated, mirrored and polar coordinates."""

from __future__ import annotations

import math
from dataclasses import replace

from counterflex.core.units import DEG
from counterflex.programs.gcode.read.arc import PLANE_AXES
from counterflex.programs.gcode.read.block import BlockWords
from counterflex.programs.gcode.read.state import ModalState
from counterflex.programs.gcode.read.work_offsets import Six, six


def target_of(state: ModalState, block: BlockWords, axes: dict[int, float], machine: bool = False) -> Six:
    """Return the end point in the part frame; axes that it names are known from now on.

    Args:
        state: Where the tool stands, and the modes.
        axes: Value in program units or degrees by axis number.
        machine: G53: values are machine coordinates.

    Raises:
        ProgramError: A value counts from a place that is not known.
    """
    if not axes:
        return state.position
    target = list(state.position)
    if machine:
        for axis, value in axes.items():
            target[axis] = (value * state.unit_m if axis < 3 else value) - state.tool_length[axis]
        state.unknown -= set(axes)
        return six(target)
    if not state.absolute:
        _require_known(state, block, axes)
    if not state.frame.plain:
        _settle(state, block, set(axes))
        if state.frame.polar or set(axes) & state.frame.affected:
            return _framed(state, block, axes)
    origin = state.origin
    for axis, value in axes.items():
        number = value * state.unit_m if axis < 3 else value
        target[axis] = (origin[axis] if state.absolute else target[axis]) + number
    if state.absolute:
        state.unknown -= set(axes)
    return six(target)


def _require_known(state: ModalState, block: BlockWords, axes: dict[int, float]) -> None:
    """Refuse displacements from a place that is not known."""
    if lost := sorted(state.unknown & {axis for axis, value in axes.items() if value != 0.0}):
        letter = "XYZ"[lost[0]]
        raise block.fault(
            f"a displacement (G91) along {letter} from a place that is not known", letter,
            hint=f"Name {letter} in G90 before",
        )  # fmt: skip


def _settle(state: ModalState, block: BlockWords, named: set[int]) -> None:
    """Refuse a first motion after a change of the coordinates that leaves out an axis of them."""
    pending = state.frame.pending
    if not pending & named:
        return
    letters = ["XYZ"[axis] for axis in sorted(pending)]
    if not state.absolute or not pending <= named:
        raise block.fault(
            f"the first motion after the coordinates changed in line {state.frame.line} does not name "
            f"{' and '.join(letters)} in G90: controllers differ in where it leads",
            next(letter for letter in letters if block.names(letter)), None,
            "Write G90 G0 " + " ".join(f"{letter}..." for letter in letters),
        )  # fmt: skip
    state.frame = replace(state.frame, pending=frozenset())


def _framed(state: ModalState, block: BlockWords, axes: dict[int, float]) -> Six:
    """End point in a rotated, mirrored or polar frame."""
    frame = state.frame
    values = _lengths(state, block, axes)
    if state.absolute:
        state.unknown -= set(values)
    if lost := "".join("XYZ"[axis] for axis in sorted(state.unknown & frame.affected)):
        raise block.fault(
            f"a motion in rotated or mirrored coordinates while it is not known where the tool is along {lost}", "",
            hint=f"Name {' and '.join(lost)} in the same block",
        )  # fmt: skip
    work = list(state.to_work(state.position))
    for axis, number in values.items():
        work[axis] = number + (0.0 if state.absolute else work[axis])
    end = list(state.to_part(six(work)))
    for axis in range(6):  # bit for bit where nothing moves
        if axis not in values and axis not in frame.affected:
            end[axis] = state.position[axis]
    return six(end)


def _lengths(state: ModalState, block: BlockWords, axes: dict[int, float]) -> dict[int, float]:
    """Values in m and degrees by axis; radius and angle of the plane as lengths under G16."""
    values = {axis: value * state.unit_m if axis < 3 else value for axis, value in axes.items()}
    first, second, _ = PLANE_AXES[state.plane]
    if not state.frame.polar or not {first, second} & set(values):
        return values
    letter = "XYZ"[first if first in axes else second]
    if not state.absolute:
        raise block.fault(
            "polar coordinates (G16) in G91: controllers differ in where they count from", letter, None,
            "Write them in G90",
        )  # fmt: skip
    radius, angle = values.get(first, state.polar.get(first)), axes.get(second, state.polar.get(second))
    if radius is None or angle is None:
        raise block.fault(
            "the first motion in polar coordinates (G16) needs radius and angle", letter, None,
            f"Write {'XYZ'[first]} and {'XYZ'[second]}",
        )  # fmt: skip
    state.polar = {first: radius, second: angle}
    return values | {first: radius * math.cos(angle * DEG), second: radius * math.sin(angle * DEG)}
