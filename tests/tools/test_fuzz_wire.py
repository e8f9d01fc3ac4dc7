"""The fuzzer's corpus read by kernels and by plain Python alike, its judges, and that it finds what is wrong."""

from __future__ import annotations

import struct
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from counterflex.core.errors import FileFormatError
from counterflex.files.logs.tracker_log import measurements
from counterflex.integrations.ati.link import kernel as netft_kernel
from counterflex.integrations.beckhoff.link import telegram as ads
from counterflex.integrations.beckhoff.simulated import AdsServer, PlcVariable
from counterflex.integrations.kuka.link import kernel as rsi_kernel
from counterflex.integrations.kuka.link.telegram import answer_reader, robot_reader
from counterflex.protocols import decimal_kernel
from counterflex.protocols.tracker import kernel as tracker_pose_kernel

ROOT = Path(__file__).parents[2]
CORPUS = ROOT / "tests" / "data" / "fuzz"
KERNELS = ("rsi", "answer", "tracker", "netft")


@pytest.fixture(scope="module")
def tools() -> Iterator[dict[str, ModuleType]]:
    """The modules of the fuzzer."""
    sys.path.insert(0, str(ROOT / "tools"))
    try:
        import fuzz_coverage
        import fuzz_mutations
        import fuzz_session
        import fuzz_targets
        import fuzz_wire

        yield {m.__name__: m for m in (fuzz_coverage, fuzz_mutations, fuzz_session, fuzz_targets, fuzz_wire)}
    finally:
        sys.path.remove(str(ROOT / "tools"))


def kept(name: str) -> list[bytes]:
    return [path.read_bytes() for path in sorted((CORPUS / name).glob("*.bin"))]


@pytest.mark.parametrize("name", KERNELS)
def test_corpus_is_small_and_agrees_with_the_judge(tools: dict[str, ModuleType], name: str) -> None:
    corpus = kept(name)
    assert 3 <= len(corpus) <= 200
    assert sum(map(len, corpus)) < 200_000
    target = tools["fuzz_targets"].TARGETS[name](compiled=False)
    for data in corpus:
        target.check(data)


@pytest.mark.parametrize("name", KERNELS)
def test_corpus_reaches_the_branches_that_can_be_reached(tools: dict[str, ModuleType], name: str) -> None:
    """In plain Python; what is missing of all branches are the empty other sides of conditions that never fail."""
    target = tools["fuzz_targets"].TARGETS[name](compiled=False)
    for data in (*target.seeds, *kept(name)):
        target.instrumented(data)
        target.coverage.new()
    reached, branches = target.coverage.branches
    assert reached >= 0.85 * branches


@pytest.mark.parametrize(("name", "make"), [("rsi", robot_reader), ("answer", answer_reader)])
def test_compiled_and_plain_scanner_read_the_corpus_alike(
    tools: dict[str, ModuleType], name: str, make: object
) -> None:
    plain = tools["fuzz_coverage"].instrument(rsi_kernel, "scan", decimal_kernel, compiled=False)
    reader = make(tools["fuzz_targets"].config())  # type: ignore[operator]
    values, seen = np.zeros_like(reader.values), np.zeros_like(reader.seen)
    for data in kept(name):
        buffer = np.frombuffer(data + b"\0", dtype=np.uint8).copy()
        reader.values[:], values[:] = 0.0, 0.0
        status = reader.read(buffer, len(data))
        again = plain.run(
            buffer, len(data), reader._root, reader._names, reader._entries, values, seen, plain.counts
        )  # fmt: skip
        assert (status, reader.counter, reader.stopped_at) == again
        np.testing.assert_array_equal(reader.values, values)
        np.testing.assert_array_equal(reader.seen, seen)


def test_compiled_and_plain_tracker_read_the_corpus_alike(tools: dict[str, ModuleType]) -> None:
    plain = tools["fuzz_coverage"].instrument(tracker_pose_kernel, "read_datagram", compiled=False)
    for data in kept("tracker"):
        rows = np.zeros((1, 2048), dtype=np.uint8)
        rows[0, : len(data[:2048])] = np.frombuffer(data[:2048], dtype=np.uint8)
        found = []
        for read, more in ((tracker_pose_kernel.read_datagram, ()), (plain.run, (plain.counts,))):
            T, values = np.zeros((4, 4)), np.zeros(8)
            found.append((read(rows, 0, len(data), T, values, *more), T, values))
        assert found[0][0] == found[1][0]
        np.testing.assert_array_equal(found[0][2], found[1][2])
        np.testing.assert_allclose(found[0][1], found[1][1], rtol=0.0, atol=1e-15)


OTHERS = ["ads", "netft-request", "wrench", "tracker-log", "rsi-context", "frame", "frame-stream"]


@pytest.mark.parametrize(
    "name", ["rsi", "answer", "netft", "tracker", "egm", "egm-sensor", "scaling", "rsi-config", *OTHERS]
)
def test_a_few_more_inputs_find_nothing(tools: dict[str, ModuleType], name: str) -> None:
    target = tools["fuzz_targets"].TARGETS[name](compiled=False)
    mutate = tools["fuzz_mutations"].Mutator(7, text=target.text)
    corpus = [*target.seeds, *kept(name)]
    good = sum(target.check(mutate(mutate.choose(corpus), mutate.choose(corpus))) for _ in range(1500))
    assert 0 < good < 1500


def test_same_seed_same_inputs(tools: dict[str, ModuleType]) -> None:
    made = []
    for _ in range(2):
        mutate = tools["fuzz_mutations"].Mutator(3, text=True)
        made.append([mutate(b'<Rob><A X="1"/></Rob>', b"<IPOC>4</IPOC>") for _ in range(200)])
    assert made[0] == made[1]
    assert len(set(made[0])) > 150


def test_it_finds_a_reader_that_is_wrong(tools: dict[str, ModuleType], monkeypatch: pytest.MonkeyPatch) -> None:
    """A kernel that takes one status word for another is found out within some thousand inputs."""
    right = netft_kernel.take_records

    def wrong(data: np.ndarray, *rest: object) -> None:
        data[:, 8] &= 0x7F
        right(data, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(netft_kernel, "take_records", wrong)
    with pytest.raises(tools["fuzz_targets"].Finding, match="netft, seed 1, input"):
        tools["fuzz_wire"].fuzz("netft", 3000, 1, None, compiled=False)


@pytest.mark.parametrize(
    "telegram",
    [
        b'<Rob Type="KUKA" Type="KUKA"><IPOC>4</IPOC></Rob>',
        b'<Rob Type="a" b="1" Type="c"><IPOC>4</IPOC></Rob>',
        b'<Rob><Unknown a="1" a="2"/><IPOC>4</IPOC></Rob>',
        b'<Rob><Unknown a = "1" b="2" a="3"/><IPOC>4</IPOC></Rob>',
    ],
)
def test_repeated_attributes_are_refused_whoever_they_belong_to(tools: dict[str, ModuleType], telegram: bytes) -> None:
    """Found by the fuzzer: an XML library refuses them."""
    reader = robot_reader(tools["fuzz_targets"].config())
    assert reader.read_bytes(telegram) in (rsi_kernel.MALFORMED, rsi_kernel.REPEATED)


def test_garbage_through_a_whole_session(tools: dict[str, ModuleType]) -> None:
    found = tools["fuzz_session"].run(120, 5)
    assert found["holds"] > 0
    assert found["faults"] > 0


def test_numbers_beyond_all_measure_are_refused() -> None:
    """Found by the fuzzer: a time became infinite in nanoseconds, a quaternion made numpy warn."""
    with pytest.raises(FileFormatError, match="out of range"):
        list(measurements(["time_s,x_mm,y_mm,z_mm", "1e308,1,2,3"], "log"))
    with warnings.catch_warnings(), pytest.raises(FileFormatError, match="unit length"):
        warnings.simplefilter("error")
        list(measurements(["time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz", "0,1,2,3,1,0,1e308,0"], "log"))


def test_a_plc_does_not_answer_with_more_than_a_frame_holds() -> None:
    """Found by the fuzzer: a sum request for two gigabytes was answered."""
    server = AdsServer({"MAIN.x": PlcVariable()}, port=0)
    try:
        asked = struct.pack("<III", ads.PLC_MEMORY, 0, 1 << 31)
        data = struct.pack("<IIII", ads.SUM_READ, 1, 1 << 31, len(asked)) + asked
        frame = ads.AmsFrame((bytes(6), ads.PLC_PORT), (bytes(6), 40_000), ads.READ_WRITE, ads.REQUEST, 0, 1, data)
        reply = server._answer(frame, False, False)
        assert struct.unpack_from("<I", reply.data)[0] == ads.WRONG_SIZE
    finally:
        server.close()
