"""Middles of cuts without air, at 10 kHz with single teeth: five feeds at one depth, zero from elsewhere or stated."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.app.identification.identify import judged
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import silent
from counterflex.core.units import MM, N_PER_MM2, RPM, UM
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import engagement_of_arc
from counterflex.cutting.tooth_force import tooth_forces
from counterflex.files.cell.cell import read_cell
from counterflex.identify.cutting.recipe import RECIPE
from counterflex.identify.cutting.record import contact
from counterflex.identify.cutting.steady_cuts import Cutting, pieces_of
from counterflex.identify.data.changes import CuttingLaw
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.data.model import CellModel

CELL = Path(__file__).resolve().parents[2] / "data" / "cells" / "small.toml"
CUTTER = Cutter(16.0 * MM, flutes=3, flute_length_m=35.0 * MM)
SPEED, RATE, DEPTH = 6000.0 * RPM, 10_000.0, 3.0 * MM
FEEDS: tuple[float, ...] = (20.0, 32.0, 50.0, 72.0, 100.0)
EXACT = {"force_scale_sigma": 1e-4, "force_cross_talk_sigma": 1e-4, "force_alignment_rad": 1e-4}


def law(kc: float, m: float) -> KienzleLaw:
    return KienzleLaw.from_k11(
        kc * N_PER_MM2, m, kr11_pa=0.4 * kc * N_PER_MM2, mr=m, ka11_pa=0.15 * kc * N_PER_MM2, ma=m,
        h_min_m=UM, h_max_m=MM, source="test", status="test",
    )  # fmt: skip


TRUE = law(700.0, 0.28)


def cell_of(known: KienzleLaw) -> CellModel:
    blank = np.array([[0.0, 0.0, 0.0], [120.0, 100.0, 40.0]]) * MM
    return replace(model_of(read_cell(CELL)), cutter_of=lambda _: CUTTER, law_of=lambda: known, blank_part=blank)


@cache
def turn(feed_um: float) -> Float:
    """(bins, 3) N over one revolution, feed frame."""
    depth = engagement_of_arc(CUTTER, DEPTH, 0.0, np.pi, n_bins=256)
    return tooth_forces(CUTTER, TRUE, depth, feed_um * UM, trochoid=False).wrench_tcp[:, :3]


def record(
    feeds: tuple[float, ...] = FEEDS,
    seconds: float = 0.8,
    bias: float = 0.0,
    *,
    apart: bool = True,
    air_s: float = 0.0,
    seed: int = 0,
    **settings: object,
) -> Dataset:
    """A record of slots along x, one after the other: groups where ``apart``, air before and after where asked for."""
    rng, rows, group = np.random.default_rng(seed), [], []
    for k, feed in enumerate(feeds):
        n, empty = int(seconds * RATE), int(air_s * RATE)
        course = turn(feed)
        angle = SPEED * np.arange(n) / RATE + rng.uniform(0.0, 6.0)
        cut = course[(angle / (2.0 * np.pi) * len(course)).astype(int) % len(course)]
        force = np.vstack([np.zeros((empty, 3)), cut, np.zeros((empty, 3))])
        rows.append(np.column_stack([force, np.full(len(force), feed)]))
        group += [k] * len(force)
    table = np.vstack(rows)
    n = len(table)
    shown = table[:, :3] + bias * np.array([1.0, -0.7, 0.4]) + 2.0 * rng.standard_normal((n, 3))
    arrays = {
        "time_s": np.arange(n) / RATE,
        "f_tcp_part": shown,
        "feed_direction": np.tile([1.0, 0.0, 0.0], (n, 1)),
        "feed_rate": table[:, 3] * UM * CUTTER.flutes * SPEED / (2.0 * np.pi),
        "spindle_speed": np.full(n, SPEED),
        "depth": np.full(n, DEPTH),
        "width": np.full(n, CUTTER.diameter_m),
    }  # fmt: skip
    numbers = np.array(group) if apart else np.arange(n)
    return of_arrays(f"middles {seed}", "slots", arrays, group=numbers, settings={**EXACT, **settings})


def in_air(bias: float) -> Dataset:
    one = record((50.0,), 0.5)
    noise = 2.0 * np.random.default_rng(9).standard_normal((len(one), 3))
    shown = replace(one.channel("f_tcp_part"), values=bias * np.array([1.0, -0.7, 0.4]) + noise)
    depth = replace(one.channel("depth"), values=np.zeros((len(one), 1)))
    return replace(one, name="air", channels={**one.channels, "f_tcp_part": shown, "depth": depth})


def error_of(found: KienzleLaw) -> float:
    """Largest error of the cutting and the radial force over the feeds, share of them."""
    h = np.array([0.64 * f * UM for f in (FEEDS[0], FEEDS[2], FEEDS[-1])])
    errors = [
        abs(getattr(found.at_reference(float(x)), key) / getattr(TRUE.at_reference(float(x)), key) - 1.0)
        for x in h
        for key in ("kc_ref_pa", "kr_ref_pa")
    ]
    return float(max(errors))


@pytest.mark.parametrize("apart", [True, False])
def test_five_middles_are_five_pieces_and_give_the_law(apart: bool) -> None:
    data = record(apart=apart)
    known = cell_of(law(780.0, 0.25))
    cuts = pieces_of(known, [data])
    assert len(cuts.pieces) == 5
    assert len(np.unique(cuts.pieces.cut)) == 5
    assert any("taken as middles of cuts" in r for r in cuts.remarks)
    found = RECIPE.identify(known, [data], [], {}, silent)
    assert found.headline[0].value < 3.0
    (change,) = found.changes
    assert isinstance(change, CuttingLaw)
    assert isinstance(change.law, KienzleLaw)
    assert error_of(change.law) < 0.03


def test_a_zero_from_a_file_in_air_is_taken_off() -> None:
    known = cell_of(law(780.0, 0.25))
    found = RECIPE.identify(known, [record(bias=40.0), in_air(40.0)], [], {}, silent)
    (change,) = found.changes
    assert isinstance(change, CuttingLaw)
    assert isinstance(change.law, KienzleLaw)
    assert error_of(change.law) < 0.03
    assert not any("free of zero" in r for r in found.remarks)


def test_air_that_is_there_is_found_by_its_quiet() -> None:
    with_air = record(bias=25.0, air_s=0.2, seconds=1.6)
    known = cell_of(law(780.0, 0.25))
    cuts = pieces_of(known, [with_air], Cutting(trim_diameters=0.1, settle_s=0.1))
    without = pieces_of(known, [record(seed=3)])
    np.testing.assert_allclose(cuts.pieces.force, without.pieces.force, atol=1.5)
    assert not any("free of zero" in r for r in cuts.remarks)


def test_a_true_law_in_the_cell_file_is_confirmed() -> None:
    """Its values stay, with the standard deviations of the data in place of a handbook's."""
    found = RECIPE.identify(cell_of(TRUE), [record()], [], {}, silent)
    result, outcome = judged(found, separate=False)
    assert outcome == "confirmed"
    assert not result.changes
    fit = result.fits["cutting"]
    assert fit.value("kc") == pytest.approx(fit.parameters.nominal[0])
    assert fit.sigma_of("kc") < 0.06 * fit.value("kc")


def test_what_is_stated_of_air_is_checked() -> None:
    known = cell_of(law(780.0, 0.25))
    assert len(pieces_of(known, [record(air="none")]).pieces) == 5
    with pytest.raises(InputError, match="unknown setting"):
        pieces_of(known, [record(air="some")])


@pytest.mark.parametrize("per_turn", [1, 100])
def test_a_steady_force_has_no_air_and_one_with_an_entry_has(per_turn: int) -> None:
    rng = np.random.default_rng(0)
    ripple = 80.0 * np.sin(2.0 * np.pi * np.arange(8000) / 100.0) if per_turn > 1 else np.zeros(8000)
    steady = np.column_stack([100.0 + ripple, 200.0 - ripple, np.full(8000, -30.0)]) + rng.standard_normal((8000, 3))
    depth = np.full(8000, DEPTH)
    assert contact(steady, depth, per_turn).all()
    entered = steady.copy()
    entered[:1500] = rng.standard_normal((1500, 3))
    touching = contact(entered, depth, per_turn)
    assert not touching[:1400].any()
    assert touching[1600:].all()
