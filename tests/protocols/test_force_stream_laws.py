"""Streams of force samples over many telegrams: repeats, restarts, frozen and saturated readings of either sign.

Each law is held against a plain account of the same samples, kept beside the stream.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.integrations.ati.link import telegram as netft
from counterflex.protocols.force.frame_format import CHANNELS, COMPONENTS, FrameField, FrameFormat
from counterflex.protocols.force.sensors import PolledForce
from counterflex.protocols.force.stream import FROZEN, SATURATED, SampleStream
from counterflex.protocols.sequence_kernel import RESTART

QUICK = settings(max_examples=60)
seed = st.integers(0, 2**31)


def fed(stream: SampleStream, numbers: list[int], values: Float | None = None) -> int:
    """Give one telegram of samples; how many of them counted."""
    w = np.arange(6.0 * len(numbers)).reshape(-1, 6) + 10.0 * (sum(numbers) % 9973) if values is None else values
    stream.begin()
    stream.take(w, sequence=np.array(numbers, dtype=np.int64))
    return stream.end()


@QUICK
@given(st.integers(0, 2**32 - 1), st.integers(1, 1000), st.integers(1, 5 * RESTART), st.booleans())
def test_an_old_sample_never_counts_however_often_it_is_repeated(last: int, age: int, often: int, single: bool) -> None:
    """One old telegram again and again is no restart, in one telegram or in many."""
    stream = SampleStream()
    assert fed(stream, [(last - 1) % 2**32, last]) == 2
    old = (last - age) % 2**32
    counted = fed(stream, [old] * often) if single else sum(fed(stream, [old]) for _ in range(often))
    assert (counted, stream.restarts, stream.lost) == (0, 0, 0)
    assert fed(stream, [(last + 1) % 2**32]) == 1
    assert stream.lost == 0


@QUICK
@given(st.lists(st.integers(1, 400), min_size=1, max_size=60))
def test_old_samples_that_do_not_follow_each_other_are_no_restart(ages: list[int]) -> None:
    numbers = [1_000_000 - 2 * age - 1000 * (k % 2) for k, age in enumerate(ages)]  # even: none follows another
    stream = SampleStream()
    fed(stream, [1_000_000])
    assert sum(fed(stream, [number]) for number in numbers) == 0
    assert stream.restarts == 0


@QUICK
@given(st.integers(0, 500_000), st.integers(0, 40), st.integers(1, 7))
def test_a_sensor_that_counts_anew_is_taken_after_some_in_a_row_and_lost_nothing(
    begin: int, more: int, piece: int
) -> None:
    stream = SampleStream()
    fed(stream, [1_000_000])
    numbers = list(range(begin, begin + RESTART + more))
    counted = sum(fed(stream, numbers[k : k + piece]) for k in range(0, len(numbers), piece))
    assert counted == 1 + more
    assert (stream.restarts, stream.lost) == (1, 0)


@QUICK
@given(st.lists(st.integers(1, 30), min_size=2, max_size=40))
def test_lost_samples_are_the_numbers_between(steps: list[int]) -> None:
    stream, numbers = SampleStream(), np.cumsum([2**32 - 40, *steps]).tolist()
    counted = sum(fed(stream, [int(number) % 2**32]) for number in numbers)
    assert counted == len(numbers)
    assert stream.lost == sum(steps) - len(steps)


@QUICK
@given(st.lists(st.tuples(st.integers(1, 12), st.booleans()), min_size=1, max_size=12))
def test_a_frozen_sensor_is_one_that_repeats_itself_in_a_row(rows: list[tuple[int, bool]]) -> None:
    """Counted over telegrams of any length; one other reading between begins anew. Streams and polled sensors alike."""
    values: list[float] = []
    for count, changes in rows:
        values += [(values[-1] if values and not changes else float(len(values) + 1))] * count
    stream, receiver = SampleStream(), Given([])
    polled = PolledForce(receiver)
    at, same = 0, 0
    for count, _ in rows:
        part = np.tile(np.array(values[at : at + count])[:, None], (1, 6))
        for k in range(at, at + count):
            same = same + 1 if k and values[k] == values[k - 1] else 0
        fed(stream, list(range(at, at + count)), part)
        receiver.next = part
        polled.drain()
        at += count
        assert stream.frozen == polled.frozen == (same >= FROZEN - 1)


class Given:
    """A receiver of a package of its own that returns what it was given."""

    def __init__(self, rows: Any) -> None:
        self.next = np.array(rows, dtype=np.float64).reshape(-1, 6)

    def receive(self) -> Float:
        return self.next

    def close(self) -> None:
        pass


@QUICK
@given(st.integers(0, 5), st.floats(0.5, 1.5), st.booleans(), st.integers(0, 3))
def test_a_reading_beyond_its_range_is_saturated_on_either_side(
    axis: int, share: float, below: bool, place: int
) -> None:
    range_n, range_nm = 500.0, 20.0
    limit = range_n if axis < 3 else range_nm
    part = np.arange(24.0).reshape(4, 6) * 1e-3
    part[place, axis] = (-1.0 if below else 1.0) * share * limit
    stream = SampleStream(range_n=range_n, range_nm=range_nm)
    polled = PolledForce(Given(part), range_n=range_n, range_nm=range_nm)
    fed(stream, [1, 2, 3, 4], part)
    polled.drain()
    assert stream.saturated == polled.saturated == (abs(part[place, axis]) > SATURATED * limit)
    fed(stream, [5], part[:1] * 0.0)
    assert not stream.saturated


@QUICK
@given(seed, st.lists(st.integers(1, 9), min_size=1, max_size=6))
def test_a_wrench_is_the_mean_of_its_own_telegram(number: int, counts: list[int]) -> None:
    rng, at = np.random.default_rng(number), 0
    stream = SampleStream()
    for count in counts:
        part = rng.normal(size=(count, 6))
        fed(stream, list(range(at, at + count)), part)
        np.testing.assert_allclose(stream.w_sensor, part.mean(axis=0), atol=1e-12)
        np.testing.assert_array_equal(stream.samples[:count], part)
        at += count


@QUICK
@given(
    seed, st.lists(st.lists(st.sampled_from(["good", "saturated", "invalid", "nan", "huge"]), max_size=6), max_size=6)
)
def test_only_good_samples_make_the_wrench_and_the_others_are_counted(number: int, cycles: list[list[str]]) -> None:
    """In every cycle anew: what the sensor calls invalid or beyond its range, or is no number, enters no mean."""
    rng, at, bad, mean = np.random.default_rng(number), 0, 0, np.zeros(6)
    stream = SampleStream()
    for kinds in cycles:
        w, kind = rng.normal(size=(len(kinds), 6)), np.array(kinds, dtype=object)
        w[kind == "nan", 2] = np.nan
        w[kind == "huge", 4] = rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(6.001, 300.0)
        stream.begin()
        stream.take(
            w, sequence=np.arange(at, at + len(kinds)), invalid=kind == "invalid", saturated=kind == "saturated"
        )
        at += len(kinds)
        bad += int(np.sum(np.isin(kind.astype(str), ["invalid", "nan", "huge"])))
        good = w[kind == "good"]
        mean = good.mean(axis=0) if len(good) else mean
        assert stream.end() == stream.good == len(good)
        np.testing.assert_allclose(stream.w_sensor, mean, atol=1e-12)
        np.testing.assert_array_equal(stream.samples[: len(good)], good)
        assert (stream.bad, stream.saturated, stream.lost) == (bad, "saturated" in kinds, 0)


@QUICK
@given(seed, st.lists(st.lists(st.booleans(), max_size=6), max_size=6))
def test_a_drain_of_another_package_is_its_own_mean(number: int, drains: list[list[bool]]) -> None:
    rng, bad, mean = np.random.default_rng(number), 0, np.zeros(6)
    given_ = Given(np.zeros((0, 6)))
    polled = PolledForce(given_)
    for finite in drains:
        given_.next = rng.normal(size=(len(finite), 6))
        given_.next[~np.array(finite, dtype=bool), 4] = np.inf
        good = given_.next[np.array(finite, dtype=bool)]
        bad += len(finite) - len(good)
        mean = good.mean(axis=0) if len(good) else mean
        assert polled.drain() == polled.good == len(good)
        np.testing.assert_allclose(polled.w_sensor, mean, atol=1e-12)
        np.testing.assert_array_equal(polled.samples[: len(good)], good)
        assert polled.bad == bad


def frame(matrix: Float, names: tuple[str, ...] = CHANNELS, footer: bytes = b"\x55\xaa") -> FrameFormat:
    return FrameFormat(tuple(FrameField("float64", name) for name in names), matrix, b"\x12\x34", footer, little=False)


@QUICK
@given(seed)
def test_a_frame_gives_the_wrench_that_was_written_through_any_matrix(number: int) -> None:
    """Channels times the matrix by rows: component = sum over channels of the row of the component."""
    rng = np.random.default_rng(number)
    matrix, w = np.eye(6) + 0.3 * rng.normal(size=(6, 6)) * np.triu(np.ones((6, 6)), 1), rng.normal(size=6)
    one = frame(matrix)
    rows, good = one.rows(one.write(w, 0))
    assert good.tolist() == [True]
    np.testing.assert_allclose(one.wrench(rows)[0], w, atol=1e-9)
    channel = np.zeros(6)
    channel[2] = 1.0
    plain = frame(np.eye(6), COMPONENTS)
    rows, _ = plain.rows(plain.write(channel, 0))
    np.testing.assert_allclose(frame(matrix).wrench(frame(matrix).rows(plain.write(channel, 0))[0])[0], matrix[:, 2])


@pytest.mark.parametrize("at", [0, 1, -2, -1])
def test_a_frame_with_another_header_or_footer_is_no_frame(at: int) -> None:
    one = frame(np.eye(6))
    data = bytearray(one.write(np.arange(6.0), 0))
    data[at] ^= 1
    assert one.rows(bytes(data))[1].tolist() == [False]
    assert one.rows(one.write(np.arange(6.0), 0) + bytes(data))[1].tolist() == [True, False]


POUND = 0.45359237 * 9.80665
FORCES = {"N": 1.0, "kN": 1000.0, "lbf": POUND, "lb": POUND, "klbf": 1000 * POUND}
MOMENTS = {
    "Nm": 1.0, "N-m": 1.0, "Nmm": 1e-3, "N-mm": 1e-3, "kNm": 1000.0, "lbfin": POUND * 0.0254, "lbf-in": POUND * 0.0254,
    "inlb": POUND * 0.0254, "in-lb": POUND * 0.0254, "lbin": POUND * 0.0254, "lbfft": POUND * 0.3048,
    "lbf-ft": POUND * 0.3048, "ftlb": POUND * 0.3048,
}  # fmt: skip


def document(force: str = "N", moment: str = "Nm", more: str = "") -> bytes:
    return (
        f"<netft><cfgcpf>1000</cfgcpf><cfgcpt>500</cfgcpt><scfgfu>{force}</scfgfu><scfgtu>{moment}</scfgtu>{more}</netft>"
    ).encode()


@pytest.mark.parametrize("unit", FORCES)
def test_a_unit_of_force_of_the_sensor(unit: str) -> None:
    assert netft.Scaling.of(document(force=unit)).force_n == pytest.approx(FORCES[unit] / 1000, rel=1e-12)


@pytest.mark.parametrize("unit", MOMENTS)
def test_a_unit_of_moment_of_the_sensor(unit: str) -> None:
    assert netft.Scaling.of(document(moment=unit)).moment_nm == pytest.approx(MOMENTS[unit] / 500, rel=1e-12)


@QUICK
@given(st.tuples(*[st.floats(-300.0, 300.0)] * 3), st.lists(st.floats(10.0, 900.0), min_size=6, max_size=6))
def test_a_moved_origin_widens_the_range_of_moments_by_its_lever(moved: tuple[float, ...], rated: list[float]) -> None:
    """No force within its range makes a larger moment about the moved origin; unmoved, the range is the rated one."""
    limits = f"<cfgmr>{';'.join(map(repr, rated))}</cfgmr><scfgtdu>mm</scfgtdu>"
    shift = ";".join(map(repr, [*moved, 0.0, 0.0, 0.0]))
    found = netft.Scaling.of(document(more=f"{limits}<cfgtfx>{shift}</cfgtfx>"))
    assert found.range_n == pytest.approx(rated[:3])
    if not any(moved):
        assert found.range_nm == pytest.approx(rated[3:])
        return
    lever = math.hypot(*moved) * 1e-3
    largest = math.hypot(*rated[:3])
    assert found.range_nm == pytest.approx([value + lever * largest for value in rated[3:]])
