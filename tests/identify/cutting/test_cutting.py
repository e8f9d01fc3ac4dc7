"""Force constants from test cuts: recovery, intervals, choice of the form, depth and width, wear, mistakes in data."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError, ModelError
from counterflex.core.progress import silent
from counterflex.core.units import MM, N_PER_MM, N_PER_MM2, RPM, UM
from counterflex.cutting.coefficients import ForceLaw, KienzleLaw, LinearEdgeLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import engagement_of_arc
from counterflex.cutting.tooth_force import tooth_forces
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose, rotation
from counterflex.identify.cutting.checks import check
from counterflex.identify.cutting.force_forms import FORMS
from counterflex.identify.cutting.recipe import RECIPE
from counterflex.identify.cutting.report import trend
from counterflex.identify.cutting.residuals import SlotResiduals, geometry_parameters
from counterflex.identify.cutting.steady_cuts import pieces_of
from counterflex.identify.data.changes import CuttingLaw
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.identify.recipe import Identification
from counterflex.identify.solver.solve import solve
from counterflex.programs.gcode.read.reader import read_gcode

CELL = Path(__file__).resolve().parents[2] / "data" / "cells" / "small.toml"
SPEED = 13000.0 * RPM
D16 = Cutter(16.0 * MM, flutes=3, flute_length_m=35.0 * MM)
D6 = Cutter(6.0 * MM, flutes=4, flute_length_m=15.0 * MM)
FEEDS = (16.0, 24.0, 36.0, 54.0, 80.0)
AXES = {"x": (1.0, 0.0), "-x": (-1.0, 0.0), "y": (0.0, 1.0)}


def kienzle(kc: float, mc: float, kr: float, mr: float, ka: float, ma: float, edge: float = 0.0) -> KienzleLaw:
    law = KienzleLaw.from_k11(
        kc * N_PER_MM2, mc, kr11_pa=kr * N_PER_MM2, mr=mr, ka11_pa=ka * N_PER_MM2, ma=ma,
        h_min_m=UM, h_max_m=MM, source="test", status="test",
    )  # fmt: skip
    return replace(law, edge_n_m=(edge, edge, 0.0))


KNOWN = kienzle(780.0, 0.25, 273.0, 0.25, 117.0, 0.25)
TRUE = kienzle(700.0, 0.28, 300.0, 0.33, 100.0, 0.22)


TRUE_SENSOR = {"force_scale_sigma": 0.0, "force_cross_talk_sigma": 0.0, "force_alignment_rad": 0.0}
"""What the manifests of these cuts state: forces are shown as they are."""


@dataclass(frozen=True)
class Cut:
    """One test cut: feed per tooth um, depth mm, signed width mm (0: slot), feed along an axis of the part."""

    feed: float
    depth: float
    width: float = 0.0
    along: str = "x"


def cell_with(cutter: Cutter = D16, law: ForceLaw = KNOWN, **changes: Any) -> CellModel:
    blank = np.array([[0.0, 0.0, 0.0], [120.0, 100.0, 40.0]]) * MM
    return replace(
        model_of(read_cell(CELL)), cutter_of=lambda _: cutter, law_of=lambda: law, **{"blank_part": blank, **changes}
    )


@pytest.fixture(scope="module")
def cell() -> CellModel:
    return cell_with()


def true_force(cutter: Cutter, law: ForceLaw, cut: Cut, extra_depth_m: float = 0.0) -> Float:
    """(3,) N in the feed frame, from the single teeth."""
    R, width = cutter.radius_m, cut.width * MM
    entry, leave = 0.0, math.pi
    if width > 0.0:
        leave = math.acos((R - width) / R)
    elif width < 0.0:
        entry = math.acos((-R - width) / R)
    depth = engagement_of_arc(cutter, cut.depth * MM + extra_depth_m, entry, leave, n_bins=256)
    return tooth_forces(cutter, law, depth, cut.feed * UM, trochoid=False).mean[:3]


def plan_of_cuts() -> list[Cut]:
    slots = [
        Cut(f, d, 0.0, a) for f, d, a in zip(FEEDS * 2, (2, 3, 4, 2.5, 3.5) * 2, ["x", "y", "-x"] * 4, strict=False)
    ]
    sides = [Cut(f, 3.0, w, "y") for f, w in zip(FEEDS, (8.0, -8.0, 4.0, -12.0, 12.0), strict=True)]
    return [*slots, *sides]


def dataset(
    cuts: list[Cut],
    law: ForceLaw = TRUE,
    cutter: Cutter = D16,
    *,
    noise: float = 0.01,
    floor_n: float = 0.3,
    seed: int = 0,
    top_m: float = 0.0,
    grow_per_cut: float = 0.0,
    T_base_part: Float | None = None,
    name: str = "cuts",
) -> Dataset:
    """Means of cuts with noise, force in base axes."""
    rng = np.random.default_rng(seed)
    R_base_part = np.eye(3) if T_base_part is None else T_base_part[:3, :3]
    directions = np.array([[*AXES[c.along], 0.0] for c in cuts])
    true = np.array([true_force(cutter, law, c, top_m) for c in cuts])
    true *= 1.0 + grow_per_cut * np.arange(len(cuts))[:, None]
    sigma = np.maximum(noise * np.linalg.norm(true, axis=1), floor_n)[:, None] * np.ones(3)
    felt = true + sigma * rng.standard_normal((len(cuts), 3))
    left = np.stack([-directions[:, 1], directions[:, 0], directions[:, 2]], axis=1)
    part = felt[:, :1] * directions + felt[:, 1:2] * left + felt[:, 2:] * np.array([0.0, 0.0, 1.0])
    rate = SPEED / (2.0 * math.pi) * cutter.flutes
    arrays = {
        "f_tcp_base": part @ R_base_part.T,
        "feed_direction": directions,
        "feed_rate": np.array([c.feed * UM for c in cuts]) * rate,
        "spindle_speed": np.full(len(cuts), SPEED),
        "depth": np.array([c.depth * MM for c in cuts]),
        "width": np.array([(c.width or 99.0) * MM for c in cuts]),
    }
    return of_arrays(name, "slots", arrays, {"f_tcp_base": sigma}, settings=TRUE_SENSOR)


def identified(cell: CellModel, data: Dataset, **settings: Any) -> Identification:
    return RECIPE.identify(cell, [data], [], {"wear_sigma": 0.0, "runout_sigma_m": 0.0, **settings}, silent)


def value(found: Identification, name: str) -> float:
    return next(f.value for f in (*found.headline, *found.figures) if f.name == name)


def before(found: Identification) -> float:
    nominal = found.headline[0].nominal
    assert nominal is not None
    return nominal


def law_of(found: Identification) -> ForceLaw:
    change = found.changes[0]
    assert isinstance(change, CuttingLaw)
    return change.law


def test_constants_are_recovered_within_their_standard_deviations(cell: CellModel) -> None:
    found = identified(cell, dataset(plan_of_cuts()), form="kienzle-3")
    fit, h = found.fits["cutting"], value(found, "h_ref_um") * UM
    true = TRUE.at_reference(h)
    names = ("kc", "kr", "ka", "mc", "mr", "ma")
    right = (true.kc_ref_pa, true.kr_ref_pa, true.ka_ref_pa, true.mc, true.mr, true.ma)
    for name, number in zip(names, right, strict=True):
        assert abs(fit.value(name) - number) < 3.5 * fit.sigma_of(name), name
    assert fit.sigma_of("kc") < 0.03 * fit.value("kc")
    assert value(found, "holdout_mean_percent") < 3.0 < before(found)


def test_law_predicts_cuts_it_has_not_seen(cell: CellModel) -> None:
    others = [Cut(20, 5.0, 0.0, "-x"), Cut(45, 1.5, 5.0), Cut(70, 2.0, -6.0, "y"), Cut(30, 4.5, 10.0)]
    unseen = dataset(others, noise=0.0, floor_n=1e-3, name="others")
    found = RECIPE.identify(cell, [dataset(plan_of_cuts())], [unseen], {}, lambda f, w="": None)  # noqa: ARG005
    assert value(found, "holdout_worst_percent") < 2.0
    assert before(found) > 5.0


def test_reference_thickness_frees_k_from_m_and_1_mm_does_not(cell: CellModel) -> None:
    found = identified(cell, dataset(plan_of_cuts()), form="kienzle", top_sigma_m=1e-7)
    assert abs(value(found, "kc_mc_correlation")) < 0.5
    assert value(found, "kc11_sigma_n_mm2") / value(found, "kc11_n_mm2") > 3.0 * (
        value(found, "kc_ref_sigma_n_mm2") / value(found, "kc_ref_n_mm2")
    )


@pytest.mark.parametrize(
    ("least", "most", "at_1_mm", "exponent"), [(20.0, 40.0, 0.21, 0.25), (5.0, 120.0, 0.057, 0.07)]
)
def test_five_slots_are_as_uncertain_as_published(least: float, most: float, at_1_mm: float, exponent: float) -> None:
    """Relative standard deviations of kc1.1 and mc from five slots with 3 % + 1 N noise, one component, no prior."""
    law = kienzle(780.0, 0.25, 273.0, 0.25, 117.0, 0.25)
    cuts = [Cut(f, 3.0) for f in np.geomspace(least, most, 5)]
    data = dataset(cuts, law, noise=0.03, floor_n=1.0)
    found = pieces_of(cell_with(law=law), [data])
    h = float(np.exp(np.mean(np.log([math.sqrt(math.e) / 2.0 * c.feed * UM for c in cuts]))))
    block = SlotResiduals(found.pieces, found.cutter, FORMS[0], h, law, 1, 0.0, 0.0)
    x = (FORMS[0].parameters(law, h) + geometry_parameters(found.pieces)).nominal
    J = block.jacobian(x)[:, 1, [0, 3]] * np.array([x[0], 1.0])
    C = np.linalg.inv(J.T @ J)
    reach = math.log(MM / h)
    sigma_k11 = math.sqrt(C[0, 0] + reach**2 * C[1, 1] - 2.0 * reach * C[0, 1])
    assert math.sqrt(C[0, 0]) == pytest.approx(0.016, rel=0.25)
    assert math.sqrt(C[1, 1]) / 0.25 == pytest.approx(exponent, rel=0.3)
    assert sigma_k11 == pytest.approx(at_1_mm, rel=0.3)


def test_tests_as_published_for_7075_give_its_constants_back() -> None:
    """D 6 mm, 4 teeth, 17000 rpm, slots around 0.03 mm: kc1.1 776 N/mm2, mc 0.274 found from 780 and 0.23."""
    true, known = kienzle(776.0, 0.274, 330.0, 0.4, 110.0, 0.3), kienzle(780.0, 0.23, 273.0, 0.23, 117.0, 0.23)
    cuts = [Cut(f, d) for f in (10.0, 20.0, 30.0, 45.0, 60.0) for d in (0.5, 1.0, 1.5)]
    cuts += [Cut(30.0, 1.0, w) for w in (1.0, 2.0, 3.0, 4.0, 5.0)]
    found = identified(cell_with(D6, known), dataset(cuts, true, D6, noise=0.02), form="kienzle-3")
    assert abs(value(found, "kc11_n_mm2") - 776.0) < 3.0 * value(found, "kc11_sigma_n_mm2")
    assert abs(value(found, "mc") - 0.274) < 3.0 * value(found, "mc_sigma")
    assert value(found, "kc_ref_sigma_n_mm2") / value(found, "kc_ref_n_mm2") < 0.025


@pytest.mark.long
def test_intervals_cover_the_truth_at_their_rate(cell: CellModel) -> None:
    cuts = plan_of_cuts()
    clean = dataset(cuts, noise=0.0, floor_n=1e-9)
    noisy = dataset(cuts)
    sigma = noisy.channel("f_tcp_base").need_sigma()
    form, rng = FORMS[1], np.random.default_rng(11)
    found = pieces_of(cell, [noisy])
    h = 30 * UM
    true = TRUE.at_reference(h)
    right = np.array([true.kc_ref_pa, true.kr_ref_pa, true.ka_ref_pa, true.mc, true.mr, true.ma])
    exact = pieces_of(cell, [clean]).pieces
    parameters = form.parameters(KNOWN, h) + geometry_parameters(found.pieces)
    parameters = parameters.with_fixed(["top.0", "give"])
    inside = np.zeros(6)
    runs = 200
    for _ in range(runs):
        pieces = replace(exact, force=exact.force + sigma * rng.standard_normal(sigma.shape), sigma=sigma)
        block = SlotResiduals(pieces, found.cutter, form, h, KNOWN, 1, 0.0, 0.0)
        block.sigma = sigma
        fit = solve(parameters, [block], robust=False)
        inside += np.abs(fit.values[:6] - right) < 1.96 * fit.sigma[:6]
    assert np.all(inside / runs >= 0.90)
    assert np.all(inside / runs <= 0.99)


@pytest.mark.by_turn
@pytest.mark.parametrize(
    ("law", "names"),
    [
        (kienzle(700.0, 0.28, 250.0, 0.28, 100.0, 0.28), ("kienzle",)),
        (TRUE, ("kienzle-3",)),
        (
            LinearEdgeLaw(800e6, 300e6, 100e6, 14 * N_PER_MM, 11 * N_PER_MM, 1 * N_PER_MM, UM, MM, "test", "test"),
            ("linear",),
        ),
        (kienzle(600.0, 0.15, 250.0, 0.15, 100.0, 0.15, 6 * N_PER_MM), ("kienzle-edge", "kienzle-3-edge")),
    ],
)
def test_cuts_held_out_choose_the_form(cell: CellModel, law: ForceLaw, names: tuple[str, ...]) -> None:
    cuts = [Cut(f, d) for f in (5.0, 10.0, 20.0, 40.0, 80.0, 120.0) for d in (2.0, 4.0, 5.0)]
    found = identified(cell, dataset(cuts, law, noise=0.002, floor_n=0.02, seed=3))
    texts = {f"Form of the law: {form.text}," for form in FORMS if form.name in names}
    assert any(found.remarks[0].startswith(text) for text in texts), found.remarks[0]
    h = np.array([5.0, 20.0, 60.0]) * UM
    np.testing.assert_allclose(law_of(found).edge_force(h), law.edge_force(h), rtol=0.03)


def test_edge_below_zero_is_held_at_zero(cell: CellModel) -> None:
    cuts = [Cut(f, d) for f in FEEDS for d in (2.0, 4.0)]
    found = identified(cell, dataset(cuts, noise=0.03), form="kienzle-3-edge")
    law = law_of(found)
    assert isinstance(law, KienzleLaw)
    assert min(law.edge_n_m) >= 0.0


def test_a_blank_higher_than_stated_is_found_and_not_taken_for_force(cell: CellModel) -> None:
    cuts = [Cut(f, d) for f in FEEDS for d in (0.8, 2.0, 5.0)]
    data = dataset(cuts, top_m=0.12 * MM, noise=0.003, floor_n=0.05)
    h = np.array([20.0, 40.0]) * UM
    found = identified(cell, data, form="kienzle-3")
    assert value(found, "top_0_um") == pytest.approx(120.0, abs=3.5 * value(found, "top_0_um_sigma"))
    np.testing.assert_allclose(law_of(found).edge_force(h), TRUE.edge_force(h), rtol=0.02)
    trusting = identified(cell, data, form="kienzle-3", top_sigma_m=1e-7)
    assert np.all(law_of(trusting).edge_force(h)[:, 0] > 1.03 * TRUE.edge_force(h)[:, 0])


def test_a_gauged_depth_needs_no_top(cell: CellModel) -> None:
    data = dataset([Cut(f, d) for f in FEEDS for d in (0.8, 2.0)], top_m=0.12 * MM)
    gauge = of_arrays(
        "g", "slots", {"depth_measured": data.values("depth")[:, 0] + 0.12 * MM}, {"depth_measured": 1e-6}
    )
    data = replace(data, channels={**data.channels, "depth_measured": gauge.channel("depth_measured")})
    found = identified(cell, data, form="kienzle-3")
    assert not found.fits["cutting"].parameters.free[9]
    np.testing.assert_allclose(law_of(found).edge_force(30 * UM), TRUE.edge_force(30 * UM), rtol=0.03)


def test_a_narrow_range_of_thickness_is_said(cell: CellModel) -> None:
    cuts = [Cut(f, d) for f in (28.0, 30.0, 32.0) for d in (2.0, 3.0, 4.0)]
    found = identified(cell, dataset(cuts), form="kienzle-3-edge")
    assert any("cannot be separated" in text for text in found.remarks)
    assert found.fits["cutting"].hidden


def _changed(data: Dataset, channel: str, change: Callable[[Float], Float]) -> Dataset:
    old = data.channel(channel)
    return replace(data, channels={**data.channels, channel: replace(old, values=change(old.values))})


MISTAKES: Mapping[str, tuple[str, Callable[[Float], Float], str]] = {
    "sign": ("f_tcp_base", lambda f: -f, "sign of .* is reversed"),
    "swapped": ("f_tcp_base", lambda f: f[:, [1, 0, 2]], "columns .*fx.* and .*fy.* are swapped"),
    "kN": ("f_tcp_base", lambda f: 1e-3 * f, "1000 times too small"),
    "N": ("f_tcp_base", lambda f: 1e3 * f, "1000 times too large"),
    "feed in mm/s": ("feed_rate", lambda f: f / 60.0, "'feed_rate' is 60 times too small"),
    "feed in mm/min": ("feed_rate", lambda f: f * 60.0, "'feed_rate' is 60 times too large"),
    "rpm as rad/s": ("spindle_speed", lambda n: n / RPM, "'spindle_speed' is 9.55 times too large"),
    "rad/s as rpm": ("spindle_speed", lambda n: n * RPM, "'spindle_speed' is 9.55 times too small"),
    "axes": ("f_tcp_base", lambda f: f @ rotation.about_z(2.0), "axes of the part, stated as those of the base"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_named_not_fitted(name: str) -> None:
    channel, change, message = MISTAKES[name]
    T = pose.make(rotation.about_z(2.0), np.array([1.3, -0.2, 1.0]))
    cell = cell_with(frame_of=lambda: T)
    data = dataset(plan_of_cuts(), T_base_part=T)
    assert check(cell, data, None) == ()
    wrong = _changed(data, channel, change)
    with pytest.raises(InputError, match=message):
        check(cell, wrong, None)
    assert any("used as stated" in text for text in check(cell, wrong, None, as_stated=True))


def test_what_cannot_be_used_is_refused(cell: CellModel) -> None:
    data = dataset(plan_of_cuts())
    with pytest.raises(InputError, match="too few settled pieces"):
        identified(cell, data.rows(np.arange(len(data)) < 4))
    with pytest.raises(ModelError, match="M3"):
        identified(cell, _changed(data, "spindle_speed", lambda n: -n))
    with pytest.raises(InputError, match="'depth' is 1000 times too large"):
        identified(cell, _changed(data, "depth", lambda d: 1e3 * d))
    with pytest.raises(InputError, match="deeper than the flutes"):
        pieces_of(cell, [_changed(data, "depth", lambda d: 1e3 * d)])
    with pytest.raises(InputError, match="not horizontal"):
        identified(cell, _changed(data, "feed_direction", lambda d: np.tile([0.0, 0.0, 1.0], (len(d), 1))))
    with pytest.raises(FileFormatError, match="no channel 'depth'"):
        identified(cell, replace(data, channels={k: c for k, c in data.channels.items() if k != "depth"}))
    with pytest.raises(InputError, match="no such form"):
        identified(cell, data, form="cubic")
    two = replace(
        data,
        channels={
            **data.channels,
            "tool": replace(data.channel("depth"), values=np.r_[np.ones(5), np.full(10, 2)][:, None]),
        },
    )
    with pytest.raises(InputError, match="several tools"):
        identified(cell, two)
    with pytest.raises(InputError, match="no test cut was made with this tool"):
        identified(cell, two, tool=7)


def test_wear_shows_in_repeated_cuts_and_not_without() -> None:
    rng = np.random.default_rng(2)
    run = np.linspace(0.0, 30.0, 12)
    group = np.arange(12) % 2
    worn = trend((1.0 + 0.5 * group) * (1.0 + 0.01 * run) * (1.0 + 0.01 * rng.standard_normal(12)), run, group)
    fresh = trend((1.0 + 0.5 * group) * (1.0 + 0.01 * rng.standard_normal(12)), run, group)
    assert worn is not None
    assert fresh is not None
    assert worn.per_m == pytest.approx(0.01 / 1.15, abs=3.0 * worn.sigma_per_m)
    assert worn.chance < 1e-4 < 1e-2 < fresh.chance
    assert trend(np.ones(3), np.zeros(3), np.zeros(3, dtype=np.int64)) is None


def test_proposal_spreads_feeds_within_force_and_blank(cell: CellModel) -> None:
    proposal = RECIPE.propose(cell, 12, {"seed": 4, "force_max_n": 250.0})
    rate = SPEED / (2.0 * math.pi) * D16.flutes
    feeds = proposal.columns["feed_m_s"] / rate
    assert feeds.max() / feeds.min() > 4.0
    for feed, depth, width in zip(feeds, proposal.columns["depth_m"], proposal.columns["width_m"], strict=True):
        cut = Cut(feed / UM, depth / MM, 0.0 if width > 15.9 * MM else width / MM)
        assert np.linalg.norm(true_force(D16, KNOWN, cut)) < 255.0
    assert {name[0] for name in ("kc", "mc", "ec")} <= {name[0] for name in proposal.expected}
    box = cell.blank_part
    assert box is not None
    assert np.all(proposal.columns["end_z_m"] > box[0, 2])
    other = RECIPE.propose(cell, 12, {"seed": 5, "force_max_n": 250.0})
    assert not np.array_equal(other.columns["depth_m"], proposal.columns["depth_m"])
    again = RECIPE.propose(cell, 12, {"seed": 4, "force_max_n": 250.0})
    np.testing.assert_array_equal(again.columns["depth_m"], proposal.columns["depth_m"])


def test_expected_standard_deviations_are_those_of_a_fit(cell: CellModel) -> None:
    few, many = (RECIPE.propose(cell, n, {"seed": 1}).expected for n in (8, 32))
    assert many["kc"] < 0.75 * few["kc"]
    narrow = RECIPE.propose(cell, 16, {"seed": 1, "feed_ratio": 1.5}).expected
    assert narrow["mc"] > 1.5 * RECIPE.propose(cell, 16, {"seed": 1}).expected["mc"]


@pytest.mark.parametrize("count", [40, 64])
def test_many_cuts_are_laid_out_too(cell: CellModel, count: int) -> None:
    """More than four pieces along one side of a blank had no widths: the proposal ended in a ValueError of zip."""
    blank = np.array([[0.0, 0.0, 0.0], [400.0, 300.0, 40.0]]) * MM
    proposal = RECIPE.propose(replace(cell, blank_part=blank), count, {"seed": 1})
    columns = proposal.columns
    assert proposal.remarks[0].startswith(f"{count} pieces")
    sides = np.abs(columns["width_m"]) < 15.9 * MM
    assert np.sum(sides) > 8
    assert set(np.round(np.abs(columns["width_m"][sides]) / D16.diameter_m, 9)) == {0.25, 0.35, 0.5, 0.75}


def test_proposed_program_runs_the_proposed_motions(cell: CellModel) -> None:
    proposal = RECIPE.propose(cell, 8, {"seed": 2})
    program = read_gcode(proposal.files["test_cuts.ngc"], name="test_cuts.ngc")
    ends = np.array([m.p_end for m in program.motions if m.kind == "feed"])
    wanted = np.stack([proposal.columns[f"end_{c}_m"] for c in "xyz"], axis=1)
    np.testing.assert_allclose(ends, wanted, atol=2e-6)
    feeds = [m.feed_m_s for m in program.motions if m.kind == "feed"]
    np.testing.assert_allclose(feeds, proposal.columns["feed_m_s"], rtol=1e-3)


def test_a_record_without_a_stretch_of_a_cut_is_refused_in_one_line(cell: CellModel) -> None:
    """It ended in an IndexError of numpy."""
    n = 3
    arrays = {"time_s": 1e-3 * np.arange(n), "f_tcp_part": np.tile([10.0, 20.0, 5.0], (n, 1)), "depth": np.full(n, MM)}
    arrays |= {"feed_rate": np.full(n, 0.02), "spindle_speed": np.full(n, SPEED)}
    arrays["feed_direction"] = np.tile([1.0, 0.0, 0.0], (n, 1))
    data = of_arrays("short", "slots", arrays, {"f_tcp_part": 1.0})
    with pytest.raises(InputError, match="no settled piece of a cut"):
        RECIPE.identify(cell, [data], [])


def test_proposals_that_cannot_be(cell: CellModel) -> None:
    with pytest.raises(InputError, match="no box"):
        RECIPE.propose(replace(cell, blank_part=None), 8, {})
    with pytest.raises(InputError, match="too small"):
        RECIPE.propose(replace(cell, blank_part=np.array([[0.0, 0, 0], [0.02, 0.02, 0.04]])), 8, {})
    with pytest.raises(InputError, match="number of test cuts"):
        RECIPE.propose(cell, 0, {})


@pytest.mark.long
def test_a_record_of_single_teeth_gives_the_runout_and_a_slow_one_says_so(cell: CellModel) -> None:
    cutter = replace(D16, runout_m=6.0 * UM)
    period = 2.0 * math.pi / SPEED
    parts: list[Float] = []
    groups: list[int] = []
    for number, feed in enumerate((16.0, 24.0, 36.0, 54.0, 70.0, 80.0)):
        depth = engagement_of_arc(D16, (2.0 + 0.3 * number) * MM, 0.0, math.pi)
        teeth = tooth_forces(cutter, TRUE, depth, feed * UM, trochoid=False)
        rate = feed * UM * D16.flutes / period
        time = np.arange(0.0, 0.1 / rate, 0.4 * period / D16.flutes)  # 100 mm of path, 2.5 samples per tooth
        angle = SPEED * time % (2.0 * math.pi)
        f = np.stack(
            [np.interp(angle, teeth.angle_rad, teeth.wrench_tcp[:, c], period=2 * math.pi) for c in range(3)], 1
        )
        cutting = (time * rate > 0.02) & (time * rate < 0.08)
        columns = np.column_stack(
            [time, f * cutting[:, None], np.full(len(time), rate), np.where(cutting, (2.0 + 0.3 * number) * MM, 0.0)]
        )
        parts.append(columns)
        groups += [number] * len(time)
    table = np.concatenate(parts)
    n = len(table)
    arrays = {
        "time_s": table[:, 0],
        "f_tcp_part": table[:, 1:4],
        "feed_direction": np.tile([1.0, 0.0, 0.0], (n, 1)),
        "feed_rate": table[:, 4],
        "spindle_speed": np.full(n, SPEED),
        "depth": table[:, 5],
    }
    group = np.array(groups, dtype=np.int64)
    fast = of_arrays("teeth", "slots", arrays, {"f_tcp_part": 0.1}, group=group, settings={"bandwidth_hz": 2000.0})
    found = identified(cell, fast, form="kienzle-3")
    assert value(found, "runout_um") == pytest.approx(6.0, rel=0.1)
    flange = identified(cell, replace(fast, settings={}), form="kienzle-3")
    assert any("Runout is not determined" in text for text in flange.remarks)
    assert all(f.name != "runout_um" for f in flange.figures)
