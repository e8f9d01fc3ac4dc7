"""Holes: the tool enters straight, and while it is in there nothing moves it sideways."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from counterflex.app.inputs import setting_of
from counterflex.core.arrays import Bool, Float
from counterflex.core.units import DEG, MM, UM
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.compensate import plan
from counterflex.plan.inputs import Setting, with_settling
from counterflex.plan.static_correction import held_in_holes

PathOf = Callable[..., ToolPath]
CellOf = Callable[..., Cell]
HOLES = {
    "dwell": "G82 Z34 R42 P0.5 F300",
    "pecks": "G83 Z34 R42 Q2 F300",
    "chips broken": "G73 Z34 R42 Q2 F300",
    "reamed": "G85 Z34 R42 F300",
    "reamed with a dwell": "G89 Z34 R42 P0.2 F300",
    "by hand": "G0 Z42\nG1 Z36 F300\nG4 P0.5\nG1 Z34\nG0 Z45",
}
START = "G0 Z60\nG0 X12 Y15\n"


def below(path: ToolPath, top_m: float) -> Bool:
    """Rows whose segment is below a height, in part, except the first that goes down."""
    z = path.p_part_tcp[:, 2]
    inside = np.minimum(z, np.concatenate([z[:1], z[:-1]])) < top_m - UM
    found: Bool = inside & (np.cumsum(inside) > 1)
    return found


def cuts_below(path: ToolPath, top_m: float) -> Bool:
    """A first pass that goes deeper than any before it cuts."""
    z = path.p_part_tcp[:, 2]
    deepest = np.concatenate([[np.inf], np.minimum.accumulate(np.minimum(z, top_m))[:-1]])
    found: Bool = (path.kind == FEED) & (z < deepest - UM)
    return found


@pytest.mark.parametrize("cycle", sorted(HOLES))
def test_nothing_moves_the_tool_sideways_in_a_hole(cycle: str, path_of: PathOf, cell_of: CellOf) -> None:
    """With a real plan: the entry alone goes sideways, where the force rises; what the plunge ended with stays."""
    cell = cell_of()
    path = with_settling(path_of(START + HOLES[cycle] + "\nG80\nG0 X30 Y20\nG0 Z60", step_mm=0.25))
    setting: Setting = setting_of(cell, chain=cell.chain, orientation=True)
    found = plan(path, np.arange(1, int(path.motion.max()) + 2), cell.stock(), setting, predict=False)
    z = path.p_part_tcp[:, 2]
    entered = int(np.flatnonzero(z < 38 * MM)[0])  # 2 mm deep, 0.4 s: the force is there
    left = int(np.flatnonzero((z > 39 * MM) & (np.arange(len(z)) > int(np.argmin(z))))[0])
    inside = np.arange(entered, left + 1)
    sideways = np.linalg.norm(np.diff(found.correction_part[inside, :2], axis=0), axis=1)
    assert np.linalg.norm(found.correction_part[entered, :2]) > 50 * UM  # there is something to hold
    assert float(sideways.max()) < 3 * UM
    bottom = int(np.flatnonzero(found.volume_m3 > 0.0)[-1])
    assert np.ptp(found.correction_part[bottom : left + 1, :2], axis=0) == pytest.approx([0.0, 0.0], abs=1e-12)
    assert np.ptp(found.rotvec_part[bottom : left + 1], axis=0) == pytest.approx([0.0] * 3, abs=1e-4 * DEG)
    away = np.flatnonzero(path.motion > path.motion[left])
    assert not found.correction_part[away].any()  # the next place is approached as programmed


def loaded(path: ToolPath, contact: Bool) -> tuple[Float, Float]:
    """A correction that is there with the force and gone without, as a plan without holds would have it."""
    correction = np.where(contact[:, None], [0.2 * MM, -0.1 * MM, -0.5 * MM], 0.0)
    return correction, np.where(contact[:, None], [1e-3, 2e-3, 0.0], 0.0)


def test_the_part_along_the_axis_stays_free(path_of: PathOf) -> None:
    path = path_of(START + HOLES["pecks"], step_mm=0.5)
    contact = cuts_below(path, 40 * MM)
    before = loaded(path, contact)
    after = held_in_holes(path, contact, *before)
    assert after[0][:, 2] == pytest.approx(before[0][:, 2], abs=1e-15)
    assert len(np.unique(after[0][below(path, 40 * MM)][:, 0].round(9))) == 1


def test_a_through_hole_holds_what_was_there_before_it_broke_through(path_of: PathOf) -> None:
    """Behind the plate nothing cuts and the tool feeds on."""
    path = path_of(START + "G81 Z20 R42 F300\nG80", step_mm=0.25)
    z = path.p_part_tcp[:, 2]
    contact = cuts_below(path, 40 * MM) & (z > 30 * MM)
    correction, turn = loaded(path, contact)
    after, tilt = held_in_holes(path, contact, correction, turn)
    through = (z < 30 * MM) & (path.kind == FEED)
    assert through.sum() > 30
    assert after[through][:, :2] == pytest.approx(np.tile([0.2 * MM, -0.1 * MM], (int(through.sum()), 1)))
    assert tilt[through] == pytest.approx(np.tile([1e-3, 2e-3, 0.0], (int(through.sum()), 1)))


def test_milling_is_left_alone(path_of: PathOf) -> None:
    """A slot that is plunged into, a helix and a ramp move sideways: their corrections come and go as planned."""
    body = START + "G1 Z36 F300\nG1 X30 F600\nG3 X20 Y15 Z34 I-5 J0\nG1 X10 Z32\nG0 Z60"
    path = path_of(body, step_mm=0.5)
    contact = (path.kind == FEED) & (path.p_part_tcp[:, 2] < 40 * MM)
    before = loaded(path, contact)
    after = held_in_holes(path, contact, *before)
    assert np.array_equal(after[0], before[0])
    assert np.array_equal(after[1], before[1])


def test_a_stop_between_plunge_and_slot_is_no_sideways_move(path_of: PathOf) -> None:
    path = path_of(START + "G1 Z36 F300\nG4 P0.5\nG1 X30 F600\nG0 Z60", step_mm=0.5)
    z, moves = path.p_part_tcp[:, 2], np.diff(path.time_s, prepend=0.0)
    contact = (path.kind == FEED) & (z < 40 * MM) & (np.diff(path.p_part_tcp, axis=0, prepend=0.0) != 0.0).any(axis=1)
    after, _ = held_in_holes(path, contact, *loaded(path, contact))
    dwell = int(np.argmax(moves == 0.5))
    assert after[dwell, :2] == pytest.approx([0.2 * MM, -0.1 * MM])
    assert after[-1] == pytest.approx(np.zeros(3))


def test_no_hole_no_copy(path_of: PathOf) -> None:
    path = path_of("G0 Z60\nG0 X-12 Y15\nG0 Z36\nG1 X52 F1500\nG0 Z60")
    correction, turn = np.ones((len(path), 3)), np.ones((len(path), 3))
    after = held_in_holes(path, path.kind == FEED, correction, turn)
    assert after[0] is correction
    assert after[1] is turn
