"""Strains to force in the loop: the compiled filter against plain matrices, broken bridges, tools, zeros, weight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.arrays import Float, Int
from counterflex.core.records import Record, Records, records
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.sensing import strain_holder
from counterflex.protocols.session.strain_tare import StrainTare
from counterflex.runtime.sensing import strain_kernel as kernel
from counterflex.runtime.sensing.strain_wrench import ObserverTuning, StrainWrench
from counterflex.runtime.state.states import Cause
from counterflex.sensing.carrier import carrier_pose, mass_behind
from counterflex.sensing.flange_sensor import FlangeSensor
from counterflex.sensing.strain_holder import StrainHolder, lever, tool_matrix
from counterflex_lab.reproduce import holder_case
from flange_wrench import idle_wrench

N = 6
Q: Float = np.radians([5.0, -80.0, 95.0, 10.0, 70.0, -20.0])
FORCE: Float = np.array([110.0, -240.0, 60.0])


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Cell:
    return read_cell(holder_case.catalogue_cell(tmp_path_factory.mktemp("holder")))


def holder_of(cell: Cell) -> StrainHolder:
    holder = strain_holder(cell.tables.holder)
    assert holder is not None
    return replace(holder, bias=np.linspace(-20e-6, 20e-6, N), per_kelvin=np.full(N, 0.1e-6))


class Bench:
    """A holder in the arm of a cell whose bridges show a force at a tool tip, weight, bias and warmth."""

    def __init__(self, cell: Cell, tuning: ObserverTuning | None = None, tools: dict[int, Float] | None = None) -> None:
        self.holder = holder_of(cell)
        self.strain: Float = np.full((512, 12), np.nan)
        self.warm: Float = np.full(512, np.nan)
        self.times: Int = np.zeros(512, dtype=np.int64)
        self.counts: Int = np.zeros(1, dtype=np.int64)
        self.shown: Float = np.zeros(6)
        self.rng = np.random.default_rng(3)
        load = mass_behind(cell.chain, "holder")
        self.wrench = StrainWrench(
            cell.chain,
            self.holder,
            cell.T_base_part,
            (self.strain, self.warm, self.times, self.counts),
            self.shown,
            load=load,
            error=np.zeros((3, 3)),
            tools=tools,
            tuning=tuning,
        )
        still = carrier_pose(cell.chain, "holder", Q)[:3, :3]
        self.weight = idle_wrench(FlangeSensor("holder", np.eye(4), *load), still)
        self.R_base_holder = still
        self.off: Float = np.zeros(N)

    def cycle(self, force: Float, p_holder_tcp: Float | None = None, warm_c: float = 25.0) -> Float:
        """Four samples of a force on the tool; the process wrench that comes out."""
        h = self.holder
        p = h.p_holder_tcp if p_holder_tcp is None else p_holder_tcp
        true = h.sensitivity @ (lever(p) @ force + self.weight) + h.bias + (warm_c - h.reference_c) * h.per_kelvin
        for row in range(4):
            self.strain[row, :N] = true + self.off + 0.2e-6 * self.rng.standard_normal(N)
            self.warm[row], self.times[row] = warm_c, self.times.max() + 1_000_000
        self.counts[0] = 4
        return self.wrench(Q).copy()

    def tare(self) -> StrainTare:
        tare = StrainTare(self.wrench, 15.0, 5.0, 1e-6)
        for _ in range(50):
            self.cycle(np.zeros(3))
            tare.take(self.wrench.w_part)
        return tare


def in_holder(bench: Bench, w_part: Float, cell: Cell) -> Float:
    """Force in holder axes of a process wrench in part axes."""
    out: Float = bench.R_base_holder.T @ cell.T_base_part[:3, :3] @ w_part[:3]
    return out


def test_the_compiled_filter_is_the_textbook_one() -> None:
    """Scalar updates one after the other equal the joint update ``P H^T (H P H^T + R)^-1`` of all bridges."""
    rng = np.random.default_rng(0)
    gain = 0.1 * rng.standard_normal((N, 3))
    noise, walk, slew = 0.22**2, 0.02**2, 600.0**2
    holders, observeds = filled(gain, noise, walk, slew)
    H = np.hstack([gain, np.eye(N)])
    x, P = np.zeros(3 + N), np.diag(np.r_[np.ones(3), np.full(N, 0.01)])
    samples, warm, times = np.full((4, 12), np.nan), np.full(4, np.nan), np.zeros(4, dtype=np.int64)
    force, clock = np.zeros(3), 0
    for _ in range(20):
        for row in range(4):
            clock += 1_000_000
            force = force + 10.0 * rng.standard_normal(3)
            samples[row, :N] = 1e-6 * (gain @ force + 0.22 * rng.standard_normal(N))
            times[row] = clock
            P = P + 1e-3 * np.diag(np.r_[np.full(3, slew), np.full(N, walk)])
            G = P @ H.T @ np.linalg.inv(H @ P @ H.T + noise * np.eye(N))
            x = x + G @ (1e6 * samples[row, :N] - H @ x)
            P = P - G @ H @ P
        assert kernel.observe(holders, observeds, samples, warm, times, 4) == 0
    o: Record = observeds[0]
    np.testing.assert_allclose(o.x[: 3 + N], x, atol=1e-8)
    np.testing.assert_allclose(o.covariance[: 3 + N, : 3 + N], P, atol=1e-8)


def filled(gain: Float, noise: float, walk: float, slew: float) -> tuple[Records, Records]:
    holders, observeds = records(kernel.HOLDER), records(kernel.OBSERVED)
    h, o = holders[0], observeds[0]
    h.noise[:N], h.wander[:N], h.slew[:], h.drift[:N] = noise, walk, slew, 0.5
    h.bridges, h.least, h.share, h.step_s = N, 4, 0.04, 1e-3
    o.gain[:N], o.warm_c = gain, np.nan
    kernel.begin(holders, observeds, 1.0, 0.1)
    return holders, observeds


def test_a_force_comes_back_at_the_tip_in_part_axes(cell: Cell) -> None:
    """Weight, bias and warmth are taken off; no moment about the tip; the stated deviation holds."""
    bench = Bench(cell)
    assert bench.tare().accepted
    found = np.array([bench.cycle(FORCE) for _ in range(400)])[100:]
    np.testing.assert_allclose(found[:, 3:], 0.0, atol=1e-9)
    error = np.array([in_holder(bench, w, cell) for w in found]) - FORCE
    sigma = bench.shown[3:]
    assert np.all(np.abs(error.mean(axis=0)) < 3.0 * sigma)
    assert np.all(error.std(axis=0) < 1.5 * sigma)
    assert bench.wrench.doubt == Cause.NONE


def test_the_matrix_follows_the_tool(cell: Cell) -> None:
    """A tool 60 mm longer, by number: right with its own lever, off by a tenth with that of the cell's."""
    p = holder_of(cell).p_holder_tcp + np.array([0.0, 0.0, 0.06])
    bench = Bench(cell, tools={2: p})
    assert bench.tare().accepted
    side = np.array([200.0, 150.0, 0.0])
    results = {}
    for number in (2, 7):  # 7 has no tip of its own
        bench.wrench.use(number)
        results[number] = np.mean([in_holder(bench, bench.cycle(side, p), cell) for _ in range(200)][50:], axis=0)
    np.testing.assert_allclose(results[2], side, atol=8.0)
    assert np.max(np.abs(results[7] - side)) > 20.0


def test_a_bridge_that_shows_nothing_is_left_out(cell: Cell) -> None:
    """Five bridges still tell the force, with a larger deviation; with three there is none."""
    bench = Bench(cell)
    assert bench.tare().accepted
    for _ in range(100):
        whole = bench.cycle(FORCE)
    before = bench.shown[3:].copy()
    bench.off[2] = np.nan
    for _ in range(100):
        left = bench.cycle(FORCE)
    assert bench.wrench.doubt == Cause.NONE
    assert np.all(bench.shown[3:] >= before - 1e-9)
    np.testing.assert_allclose(left[:3], whole[:3], atol=6.0 * float(bench.shown[3:].max()))
    again = bench.tare()  # five bridges have a zero, too
    assert again.accepted
    bench.off[[0, 1]] = np.nan
    bench.cycle(FORCE)
    assert bench.wrench.doubt == Cause.FORCE_INVALID


def test_a_bridge_that_jumps_contradicts_the_others(cell: Cell) -> None:
    """The force stands still for two cycles and is then given up; after a new zero it is used again."""
    bench = Bench(cell)
    tare = bench.tare()
    for _ in range(50):
        steady = bench.cycle(FORCE)
    bench.off[1] = 30e-6
    for expected in (Cause.NONE, Cause.NONE, Cause.FORCE_INVALID):
        jumped = bench.cycle(FORCE)
        assert bench.wrench.doubt == expected
        np.testing.assert_allclose(jumped[:3], steady[:3], atol=0.01)  # the arm bends by the force of the cycle before
    assert bench.wrench.observed.worst == 1
    tare.again()
    for _ in range(50):
        bench.cycle(np.zeros(3))
        tare.take(bench.wrench.w_part)
    assert not tare.accepted  # 30 um/m on one bridge are no drift: identify again
    bench.off[1] = 0.0
    for _ in range(50):
        bench.cycle(np.zeros(3))
        tare.take(bench.wrench.w_part)
    assert tare.accepted


@pytest.mark.parametrize(("first_c", "then_c"), [(85.0, 25.0), (20.0, 32.0)])
def test_a_temperature_that_lasts_is_the_holders(cell: Cell, first_c: float, then_c: float) -> None:
    """What an amplifier shows when it starts, or showed before a pause, was the holder's for ever."""
    bench = Bench(cell)
    bench.cycle(np.zeros(3), warm_c=first_c)
    assert bench.wrench.observed.warm_c == first_c
    for _ in range(30):
        bench.cycle(np.zeros(3), warm_c=then_c)
    assert bench.wrench.observed.warm_c == then_c


def test_a_temperature_of_a_bad_telegram_is_not_believed(cell: Cell) -> None:
    bench = Bench(cell)
    for k in range(60):
        bench.cycle(np.zeros(3), warm_c=85.0 if k % 4 == 3 else 25.0)
    assert bench.wrench.observed.warm_c == 25.0


def test_a_force_is_no_zero_where_it_is_well_seen(cell: Cell) -> None:
    bench = Bench(cell)
    tare = StrainTare(bench.wrench, 15.0, 5.0, 1e-6)
    for force in (np.array([80.0, 0.0, 0.0]), np.array([0.0, 80.0, 0.0])):
        for _ in range(50):
            bench.cycle(force)
            tare.take(bench.wrench.w_part)
        assert not tare.accepted
        assert np.linalg.norm(tare.mean[:3]) > 60.0
    assert tare.refusals == 2


def test_what_is_not_certain_enough_is_not_used(cell: Cell) -> None:
    """Zeros that wander far make the force along the cheeks vaguer with time, until it is given up."""
    bench = Bench(cell, ObserverTuning(wander=1e-6, most_sigma_n=60.0))
    assert bench.tare().accepted
    bench.cycle(FORCE)
    assert bench.wrench.doubt == Cause.NONE
    cycles = 0
    while bench.wrench.doubt == Cause.NONE and cycles < 2000:
        bench.cycle(FORCE)
        cycles += 1
    assert 1 < cycles < 2000
    assert bench.shown[3:].max() > 60.0


def test_levers_are_those_of_the_chain(cell: Cell) -> None:
    """Strain per force at the tip by the chain equals that of the table's own tip."""
    bench, h = Bench(cell), holder_of(cell)
    np.testing.assert_allclose(
        bench.wrench.observed.gain[:N] * 1e-6, tool_matrix(h.sensitivity, h.p_holder_tcp), rtol=1e-9
    )
