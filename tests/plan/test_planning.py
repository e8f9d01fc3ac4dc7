"""The whole plan: corrections put the loaded tool where the program wants it, and nothing else moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from counterflex.app.inputs import setting_of
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import CounterflexError, ModelError, ReachError
from counterflex.core.units import DEG, MM, UM
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.path.toolpath import FEED, ToolPath, tool_orientation, tool_poses
from counterflex.plan.compensate import plan
from counterflex.plan.inputs import CorrectionLimits, Setting
from counterflex.plan.plan import Plan, across
from counterflex.plan.static_correction import Command, check_corrections
from counterflex.robot.elasticity.chain import ElasticChain, forward_elastic
from counterflex.robot.kinematics.inverse import inverse_path
from counterflex.robot.model.description import Servo
from counterflex.signals.preview import Shaping

PathOf = Callable[..., ToolPath]
CellOf = Callable[..., Cell]
GROOVE = "G0 Z60\nG0 X-12 Y15\nG0 Z36\nG1 X52 F1500\nG0 Z60"
AT_ONCE = Shaping(0.0, 0.0)
DRIVES = (Servo(1e5, 20.0, 0.06, friction_nm=0.0, slip_rad=1e-5),) * 6


def planned(path: ToolPath, cell: Cell, setting: Setting, *, predict: bool = False) -> Plan:
    lines = np.arange(1, int(path.motion.max()) + 2)
    return plan(path, lines, cell.stock(), setting, predict=predict)


def rigid(chain: ElasticChain) -> ElasticChain:
    return replace(chain, compliance=np.zeros_like(chain.compliance))


def off_geometry(cell: Cell) -> ElasticChain:
    """The robot as it really is: every segment a few tenths of a millimetre elsewhere."""
    segments = []
    for i, segment in enumerate(cell.robot.segments):
        T = segment.T_prev_seg.copy()
        T[:3, 3] += np.array([0.2, -0.15, 0.1]) * MM * np.cos(i + np.arange(3))
        segments.append(replace(segment, T_prev_seg=T))
    return ElasticChain.build(replace(cell.robot, segments=tuple(segments)), cell.end_effector)


def landed(found: Plan, setting: Setting, rows: Int, T_base_true: Float) -> Float:
    """Where the loaded tool ends up when the corrected points are commanded, in the frame of the part as it lies."""
    command = found.path.p_part_tcp[rows] + found.correction_part[rows]
    Rs = tool_orientation(found.path.axis_part[rows], setting.rotation_about_tool_rad)
    q = inverse_path(setting.controller_chain, tool_poses(setting.T_base_part, command, Rs), setting.branch).q
    w_base = pose.rotate_wrench(setting.T_base_part[:3, :3], found.w_tcp_part[rows])
    Ts = forward_elastic(setting.chain, q, w_base, gravity=True, equilibrium=True)
    return pose.transform(pose.inverse(T_base_true), Ts[:, :3, 3])


@pytest.fixture(scope="module")
def cell(cell_of: CellOf) -> Cell:
    return cell_of()


@pytest.fixture(scope="module")
def groove(path_of: PathOf) -> ToolPath:
    return path_of(GROOVE, step_mm=0.25)


@pytest.fixture(scope="module")
def setting(cell: Cell) -> Setting:
    return setting_of(cell, chain=cell.chain)


@pytest.fixture(scope="module")
def compensated(groove: ToolPath, cell: Cell, setting: Setting) -> Plan:
    return planned(groove, cell, setting, predict=True)


@pytest.mark.parametrize("told", [False, True])
@pytest.mark.parametrize("measured", ["external", "robot"])
def test_the_loaded_tool_lands_on_the_programmed_point(
    cell: Cell, groove: ToolPath, setting: Setting, told: bool, measured: str
) -> None:
    """Independent truth: joint angles of the corrected points, then the equilibrium of the loaded, heavy chain."""
    chain = off_geometry(cell) if told else cell.chain
    exact = replace(setting, chain=chain, shaping=AT_ONCE)
    T_base_true = exact.T_base_part
    if measured == "external":
        exact = replace(exact, datum_points_part=None)
    else:
        datum = cell.datum_points_part
        Rs = tool_orientation(np.tile([0.0, 0, 1], (len(datum), 1)), exact.rotation_about_tool_rad)
        q = inverse_path(exact.controller_chain, tool_poses(exact.T_base_part, datum, Rs), exact.branch).q
        touched = forward_elastic(chain, q, None, gravity=True, equilibrium=True)[:, :3, 3]
        T_base_true, _ = pose.register(touched, datum)
    found = planned(groove, cell, exact)
    rows: Int = np.flatnonzero(found.cutting)[::10].astype(np.int64)
    nominal = found.path.p_part_tcp[rows]
    error = np.linalg.norm(landed(found, exact, rows, T_base_true) - nominal, axis=1)
    moved = np.linalg.norm(found.correction_part[rows], axis=1)
    assert moved.max() > 300 * UM
    assert error.max() < 0.01 * moved.max() + 4 * UM  # second order of several mm of sag and of the deflection


def test_correction_opposes_deflection(compensated: Plan) -> None:
    cutting = compensated.cutting
    along = np.sum(compensated.correction_part[cutting] * compensated.deflection_part[cutting, :3], axis=1)
    size = np.linalg.norm(compensated.deflection_part[cutting, :3], axis=1)
    assert np.all(along <= 1e-5 * size.max() ** 2)  # a shaped correction swings through zero where the force dies out
    steady = size > 0.8 * size.max()
    assert np.count_nonzero(steady) > 100
    assert -along[steady] / size[steady] ** 2 == pytest.approx(1.0, abs=0.15)


def test_feed_force_of_a_slot_pushes_the_tool_back_and_to_the_left(compensated: Plan) -> None:
    """Sign chain from the chip to the correction: slot along +x, M3."""
    mid = (compensated.path.p_part_tcp[:, 0] > 15 * MM) & (compensated.path.p_part_tcp[:, 0] < 25 * MM)
    mid &= compensated.cutting
    force, bend = compensated.w_tcp_part[mid, :3].mean(axis=0), compensated.deflection_part[mid, :3].mean(axis=0)
    assert force[0] < 0.0 < force[1]
    assert bend[1] > 0.0
    assert compensated.correction_part[mid, 1].mean() < 0.0
    assert float(force @ bend) > 0.0  # the force does work on the deflection


def test_nothing_is_corrected_where_no_force_acts(compensated: Plan, setting: Setting) -> None:
    time, cutting = compensated.path.time_s, compensated.cutting
    first, last = time[cutting].min(), time[cutting].max()
    reach = 0.56  # way out of the walls (9 mm at 25 mm/s) and fade: beyond them nothing is touched
    step = np.diff(time, prepend=time[0])
    far = (time < first - step - reach) | (time > last + step + reach) | (compensated.path.kind != FEED)
    assert np.count_nonzero(far) >= 5
    assert np.all(compensated.correction_part[far] == 0.0)
    assert np.all(compensated.w_tcp_part[~cutting] == 0.0)
    assert np.all(compensated.rotvec_part == 0.0)


def test_predicted_error_is_worse_without_and_better_with_compensation(compensated: Plan) -> None:
    cutting, p = compensated.cutting, compensated.path.p_part_tcp
    size = {
        name: np.linalg.norm(across(deviation, p)[cutting], axis=1)
        for name, deviation in (
            ("before", compensated.deviation_nominal_part),
            ("after", compensated.deviation_compensated_part),
        )
    }
    rms = {name: float(np.sqrt(np.mean(values**2))) for name, values in size.items()}
    assert rms["before"] > 300 * UM
    assert rms["after"] < 0.3 * rms["before"]
    middle = (p[cutting, 0] > 15 * MM) & (p[cutting, 0] < 25 * MM)
    assert size["after"][middle].mean() < 0.05 * size["before"][middle].mean()


def test_predicted_deviation_without_compensation_is_the_deflection(compensated: Plan) -> None:
    """In the steady part the coupled prediction of the uncompensated program is deflection plus sag."""
    p = compensated.path.p_part_tcp
    mid = compensated.cutting & (p[:, 0] > 25 * MM) & (p[:, 0] < 31 * MM)
    expected = (compensated.deflection_part[:, :3] + compensated.sag_part)[mid].mean(axis=0)
    met = compensated.deviation_nominal_part[mid].mean(axis=0)
    assert np.linalg.norm(met - expected) < 0.04 * np.linalg.norm(expected)


def test_a_rigid_robot_needs_no_correction_and_shows_no_error(cell: Cell, groove: ToolPath, setting: Setting) -> None:
    stiff = rigid(cell.chain)
    found = planned(groove, cell, replace(setting, chain=stiff, controller_chain=stiff), predict=True)
    assert found.cutting.any()
    for values in (
        found.correction_part,
        found.deflection_part,
        found.sag_part,
        found.deviation_nominal_part,
        found.deviation_compensated_part,
    ):
        assert np.abs(values).max() < 1e-12
    assert np.all(found.correction_part == 0.0)


def test_normal_only_leaves_the_position_along_the_feed(cell: Cell, groove: ToolPath, setting: Setting) -> None:
    at_once = replace(setting, shaping=AT_ONCE)
    compensated, found = planned(groove, cell, at_once), planned(groove, cell, replace(at_once, normal_only=True))
    rows = found.cutting
    assert np.abs(found.correction_part[rows, 0]).max() < 1e-15
    assert found.correction_part[rows, 1:] == pytest.approx(compensated.correction_part[rows, 1:], abs=1e-12)
    assert np.abs(compensated.correction_part[rows, 0]).max() > 50 * UM


def test_orientation_is_corrected_when_the_language_has_one(cell: Cell, groove: ToolPath, setting: Setting) -> None:
    found = planned(groove, cell, replace(setting, orientation=True, shaping=AT_ONCE))
    rows = found.cutting
    assert found.rotvec_part[rows] == pytest.approx(-found.deflection_part[rows, 3:], abs=1e-15)
    assert np.abs(found.rotvec_part[rows]).max() > 1e-5


def test_sag_is_corrected_in_the_cut_only(cell_of: CellOf, groove: ToolPath) -> None:
    """No force, but own weight: a frame measured from outside keeps the whole sag, and the correction takes it."""
    cell = cell_of(part={"measured_with": "external"}, material={"kc11_n_mm2": 1e-6})
    found = planned(groove, cell, replace(setting_of(cell, chain=cell.chain), shaping=AT_ONCE))
    rows = found.cutting
    assert np.linalg.norm(found.sag_part[rows], axis=1).min() > 0.5 * MM
    assert found.correction_part[rows] == pytest.approx(-found.sag_part[rows], abs=1e-9)


@pytest.mark.parametrize(
    ("limits", "error", "what"),
    [
        (CorrectionLimits(correction_m=0.1 * MM), ModelError, "correction_mm"),
        (CorrectionLimits(joint_margin_rad=200 * DEG), ReachError, "joint_margin_deg"),
        (CorrectionLimits(wrist_rad=89 * DEG), ReachError, "wrist_singularity_deg"),
    ],
)
def test_limits_are_refused_never_clipped(
    cell: Cell, groove: ToolPath, setting: Setting, limits: CorrectionLimits, error: type[CounterflexError], what: str
) -> None:
    with pytest.raises(error, match=what) as caught:
        planned(groove, cell, replace(setting, limits=limits))
    assert "line" in str(caught.value)
    assert caught.value.value is not None


@pytest.mark.parametrize("field", ["correction_part", "rotvec_part"])
def test_a_correction_that_is_no_number_is_refused(field: str) -> None:
    command = replace(Command(np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 6))), **{field: np.full((3, 3), np.nan)})
    with pytest.raises(ModelError, match="line 7: the correction needed is beyond its bound"):
        check_corrections(command, np.array([7, 8, 9]), CorrectionLimits())


def test_orientation_limit(cell: Cell, groove: ToolPath, setting: Setting) -> None:
    with pytest.raises(ModelError, match="correction_deg"):
        planned(groove, cell, replace(setting, orientation=True, limits=CorrectionLimits(rotation_rad=1e-6)))


def test_a_part_out_of_reach_names_the_line(cell_of: CellOf, groove: ToolPath) -> None:
    cell = cell_of(part={"x_mm": 4000.0})
    with pytest.raises(ReachError, match="line"):
        planned(groove, cell, setting_of(cell))


def test_chips_outside_the_range_of_the_constants_are_refused(cell: Cell, path_of: PathOf, setting: Setting) -> None:
    slow = path_of("G0 Z60\nG0 X-12 Y15\nG0 Z39\nG1 X0 F1\nG0 Z60", step_mm=1.0)
    with pytest.raises(ModelError, match="allow_extrapolation"):
        planned(slow, cell, setting)
    found = planned(slow, cell, replace(setting, allow_extrapolation=True))
    assert found.cutting.any()


def test_the_blank_is_left_as_it_is_and_the_plan_is_repeatable(
    cell: Cell, groove: ToolPath, setting: Setting, compensated: Plan
) -> None:
    blank = cell.stock()
    before = blank.z.copy()
    lines = np.arange(1, int(groove.motion.max()) + 2)
    again = plan(groove, lines, blank, setting)
    assert np.array_equal(blank.z, before)
    for name in Plan.__dataclass_fields__:
        if name not in ("path", "measured_part"):
            assert np.array_equal(getattr(again, name), getattr(compensated, name), equal_nan=True), name
    assert again.measured_part is compensated.measured_part is None


@pytest.mark.parametrize("predict", [True, False])
@pytest.mark.parametrize("drives", [None, DRIVES])
def test_progress_rises_to_one_without_a_leap_and_may_interrupt(
    cell: Cell, groove: ToolPath, setting: Setting, predict: bool, drives: tuple[Servo, ...] | None
) -> None:
    """A part of the work that is left out leaves no gap, and none is told twice."""
    seen: list[float] = []
    lines = np.arange(1, int(groove.motion.max()) + 2)
    known = replace(setting, chain=replace(setting.chain, servo=drives))

    def told(fraction: float, what: str = "") -> None:
        seen.append(fraction)

    plan(groove, lines, cell.stock(), known, predict=predict, progress=told)
    assert seen == sorted(seen)
    assert seen[0] == 0.0
    assert seen[-1] == 1.0
    assert max(np.diff(seen)) <= 0.3

    def stop(fraction: float, what: str = "") -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        plan(groove, lines, cell.stock(), setting, progress=stop)


def test_a_slot_is_as_deep_as_it_is(compensated: Plan) -> None:
    depth = compensated.axial_depth_m[compensated.cutting]
    assert depth.max() < 4.1 * MM
    assert np.median(depth) == pytest.approx(4 * MM, rel=0.01)


def test_a_crawling_feed_stays_finite(cell: Cell, path_of: PathOf, setting: Setting) -> None:
    crawl = path_of("G0 Z60\nG0 X-7 Y15\nG0 Z38\nG1 X-5.5 F15\nG0 Z60", step_mm=0.25)
    found = planned(crawl, cell, replace(setting, allow_extrapolation=True), predict=True)
    assert found.cutting.any()
    assert np.all(np.isfinite(found.deviation_nominal_part))
    assert np.abs(found.deviation_nominal_part[found.cutting]).max() < 0.2 * MM


words = st.sampled_from(["G0", "G1", "G1", "G1", "G2", "G3", "G4"])
place = st.tuples(st.floats(-15, 55), st.floats(-10, 40), st.floats(32, 45))


@given(st.lists(st.tuples(words, place, st.floats(400, 6000)), min_size=1, max_size=6), st.booleans())
@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_small_path_ends_in_a_plan_or_in_one_clear_line(
    cell: Cell, setting: Setting, path_of: PathOf, moves: list[tuple[str, tuple[float, ...], float]], loose: bool
) -> None:
    lines = ["G0 Z60", "G0 X-12 Y15"]
    for word, (x, y, z), feed in moves:
        if word == "G4":
            lines.append("G4 P0.2")
        elif word in ("G2", "G3"):
            lines.append(f"{word} I{abs(x) / 4 + 1:.3f} J0 F{feed:.1f}")
        else:
            lines.append(f"{word} X{x:.3f} Y{y:.3f} Z{z:.3f}" + (f" F{feed:.1f}" if word == "G1" else ""))
    path = path_of("\n".join(lines))
    try:
        found = planned(path, cell, replace(setting, allow_extrapolation=loose), predict=True)
    except CounterflexError:
        return
    for name in Plan.__dataclass_fields__:
        if name not in ("path", "entry_rad", "exit_rad", "measured_part"):
            assert np.all(np.isfinite(getattr(found, name))), name
    assert np.abs(found.deviation_nominal_part).max() < 20 * MM
