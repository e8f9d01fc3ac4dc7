"""A damaged run log: whatever happens to some bytes, each chunk that they do not touch is read, the rest is counted."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings, strategies as st
from mcap.reader import make_reader

from counterflex.app.run.log import repair
from counterflex.app.run.missing import LogMissing
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.logs.mcap_salvage import salvage
from counterflex.files.logs.repair import repair_segment
from counterflex.files.logs.run_log import UNKNOWN, RunLogWriter
from counterflex.files.logs.segments import read_segment, segments
from counterflex.runtime.record_ring import COLUMNS, CYCLE, WIDTH
from counterflex.runtime.state_slots import LoopState

CYCLES = 300
BLOCK = 15
LATER = 4e9


def rows(first: int, last: int) -> Float:
    """Records of cycles, 4 ms apart, that hold noise: nothing in them is easy to compress."""
    cycle = np.arange(first, last + 1)
    out = np.random.default_rng(first).standard_normal((len(cycle), WIDTH))
    out[:, 1] = cycle * 4_000_000
    out[:, CYCLE] = cycle
    return out


def write(folder: Path, *, finished: bool = True, blocks: tuple[tuple[int, int], ...] = ((1, CYCLES),)) -> bytes:
    """A log with a state of the loop every 60 cycles; the content of its first segment."""
    log = RunLogWriter(folder, {"seed": 3})
    for first, last in blocks:
        for k in range(first, last, BLOCK):
            data = rows(k, min(k + BLOCK - 1, last))
            state = LoopState(k, 4_000_000 * k, np.arange(50, dtype=np.int64) * k) if k % 60 == 1 else None
            log.add(data, 0.1 * k, state=state)
    content = (folder / "run-000.mcap").read_bytes()
    log.close()
    return (folder / "run-000.mcap").read_bytes() if finished else content


@dataclass(frozen=True, eq=False, repr=False)
class Written:
    """A sound file, and where each chunk stands with the cycles and states that it holds."""

    content: bytes
    chunks: tuple[tuple[int, int, tuple[int, ...], tuple[int, ...]], ...]

    def _repr_pretty_(self, printer: Any, _cycle: bool) -> None:
        """Short in a failing property: Hypothesis would print every byte and stop at that."""
        printer.text(f"{len(self.content)} bytes in {len(self.chunks)} chunks")

    def cycles(self, touched: Callable[[int, int], bool]) -> list[int]:
        """Cycles in the chunks that damage does not touch."""
        return [c for begin, end, cycles, _ in self.chunks if not touched(begin, end) for c in cycles]

    def states(self, touched: Callable[[int, int], bool]) -> list[int]:
        """Likewise the states."""
        return [c for begin, end, _, states in self.chunks if not touched(begin, end) for c in states]


def extents(folder: Path, content: bytes) -> Written:
    """Chunks as the index of the finished file, read by another reader, places them."""
    whole = folder / "run-000.mcap"
    found = []
    with whole.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        for index in summary.chunk_indexes:
            begin, end = index.chunk_start_offset, index.chunk_start_offset + index.chunk_length
            inside = salvage(content[begin:end]).chunks if end <= len(content) else []
            cycles, states = [], []
            for chunk in inside:
                for opcode, record in chunk.records():
                    if opcode == 5 and len(record) == 22 + 8 * WIDTH:
                        cycles.append(int(np.frombuffer(record[22:], dtype="<f8")[CYCLE]))
                    elif opcode == 5:
                        states.append(int(np.frombuffer(record[22:30], dtype="<i8")[0]))
            if inside:
                found.append((begin, end, tuple(cycles), tuple(states)))
    return Written(content, tuple(found))


@pytest.fixture(scope="module", params=[True, False], ids=["finished", "unfinished"])
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Written:
    folder = tmp_path_factory.mktemp("log")
    return extents(folder, write(folder, finished=request.param))


def read_back(folder: Path, damaged: bytes) -> tuple[list[int], list[int]]:
    """Cycles and states that are read; each record is the one that was written. Then repaired, and read by another."""
    for old in folder.iterdir():
        old.unlink()
    file = folder / "run-000.mcap"
    file.write_bytes(damaged)
    segment = read_segment(file)
    cycles = segment.rows[:, CYCLE].astype(int).tolist()
    assert segment.about.get("seed", 3) == 3
    done = repair_segment(file, LATER, {"run": 0, UNKNOWN: True})
    if done is not None:
        assert done.records == len(cycles)
        with file.open("rb") as stream:
            sizes = [len(m.data) for _, _, m in make_reader(stream, validate_crcs=True).iter_messages(topics="cycle")]
        assert sizes == [8 * WIDTH] * len(cycles)
        again = read_segment(file)
        assert again.whole
        np.testing.assert_array_equal(again.rows, segment.rows)
        assert [s.cycle for s in again.states] == [s.cycle for s in segment.states]
        assert again.lost_at_end == segment.lost_at_end
    return cycles, [s.cycle for s in segment.states]


SHARES = st.floats(0.0, 1.0, exclude_max=True)
SETTINGS = settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)


@SETTINGS
@given(st.lists(st.tuples(SHARES, st.integers(0, 7)), min_size=1, max_size=6))
@example([(0.0, 3)])
@example([(1e-3, 0), (2e-3, 1), (3e-3, 2)])
def test_bits_turned_over_anywhere(written: Written, tmp_path: Path, flips: list[tuple[float, int]]) -> None:
    damaged = bytearray(written.content)
    places = [int(share * len(damaged)) for share, _ in flips]
    for place, (_, bit) in zip(places, flips, strict=True):
        damaged[place] ^= 1 << bit

    def touched(begin: int, end: int) -> bool:
        return any(begin <= place < end for place in places)

    cycles, states = read_back(tmp_path, bytes(damaged))
    assert set(written.cycles(touched)) <= set(cycles)
    assert set(written.states(touched)) <= set(states)
    assert cycles == sorted(set(cycles))


@SETTINGS
@given(SHARES, st.integers(1, 60_000), st.sampled_from(["zeros", "ones", "noise", "out", "in", "twice"]))
@example(0.00025, 186, "out")  # of the first two records one is left, and it ends in the first chunk
def test_a_stretch_overwritten_left_out_or_put_in(
    written: Written, tmp_path: Path, share: float, size: int, how: str
) -> None:
    content = written.content
    first = int(share * len(content))
    last = min(first + size, len(content))
    noise = np.random.default_rng(size).bytes(last - first)
    middle = {"zeros": bytes(last - first), "ones": b"\xff" * (last - first), "noise": noise}.get(how, b"")
    if how == "in":
        middle, last = noise, first
    elif how == "twice":
        middle, last = content[max(0, first - 100) : first], first

    def touched(begin: int, end: int) -> bool:
        return begin < max(last, first + 1) and end > first

    damaged = content[:first] + middle + content[last:]
    try:
        cycles, states = read_back(tmp_path, damaged)
    except FileFormatError:
        assert not written.cycles(touched)
        return
    assert set(written.cycles(touched)) <= set(cycles)
    assert set(written.states(touched)) <= set(states)


@SETTINGS
@given(SHARES)
def test_cut_anywhere(written: Written, tmp_path: Path, share: float) -> None:
    size = int(share * len(written.content))
    try:
        cycles, _ = read_back(tmp_path, written.content[:size])
    except FileFormatError:
        cycles = []
    assert cycles == written.cycles(lambda _, end: end > size)


def damage_chunk(file: Path, number: int) -> int:
    """Turn a bit over in the middle of a chunk; how many chunks there are."""
    content = bytearray(file.read_bytes())
    chunks = [chunk.begin for chunk in salvage(bytes(content)).chunks]
    content[chunks[number] + 2000] ^= 4
    file.write_bytes(content)
    return len(chunks)


def missing(folder: Path) -> LogMissing:
    out = LogMissing()
    for segment in segments(folder):
        out.add(segment)
    return out.end(folder)


@pytest.mark.parametrize("finished", [True, False])
@pytest.mark.parametrize("number", [0, 7, -1])
def test_one_bad_chunk_costs_itself_and_is_counted(tmp_path: Path, finished: bool, number: int) -> None:
    file = tmp_path / "run-000.mcap"
    file.write_bytes(write(tmp_path, finished=finished))
    damage_chunk(file, number)
    segment = read_segment(file)
    assert len(segment.rows) == CYCLES - BLOCK
    assert len(segment.damage) == 1
    assert not segment.whole
    assert segment.about["seed"] == 3
    found = missing(tmp_path)
    assert found.missing == BLOCK
    assert found.damage[0].missing == BLOCK
    assert found.incomplete
    assert any(f"{BLOCK} cycles missing after cycle" in line for line in found.lines())
    done = repair_segment(file, LATER)
    assert done is not None
    assert done.missing == read_segment(file).about["repaired"]["missing"] == BLOCK
    again = missing(tmp_path)
    assert (again.missing, again.damage, again.cut) == (BLOCK, [], [])


@pytest.mark.parametrize("number", [0, 1])
def test_repair_counts_what_is_missing_before_each_segment_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    """A later segment of a run begins above cycle 1 and misses nothing before it."""
    log = RunLogWriter(tmp_path, {"seed": 3})
    for k in range(1, CYCLES, BLOCK):
        with monkeypatch.context() as patch:
            if k + BLOCK > CYCLES // 2:
                patch.setattr(
                    "counterflex.files.logs.run_log.SEGMENT_BYTES", 1 if log.written < CYCLES // 2 else 1 << 30
                )
            log.add(rows(k, k + BLOCK - 1), 0.1 * k)
    log.close()
    files = sorted(tmp_path.glob("run-*.mcap"))
    assert [len(s.rows) for s in segments(tmp_path)] == [CYCLES // 2, CYCLES // 2]
    damage_chunk(files[number], 0)
    (alone,) = (repair_segment(copy, LATER) for copy in [_copied(files[number], tmp_path / "alone")])
    os.utime(files[number], (1000.0, 1000.0))
    done, found = repair(tmp_path)
    assert [(one.name, one.missing) for one in done] == [(files[number].name, BLOCK)]
    assert found.missing == missing(tmp_path).missing == BLOCK
    assert alone is not None
    assert alone.missing == (0 if number else BLOCK)  # a later one by itself does not know where it should begin


def _copied(file: Path, folder: Path) -> Path:
    folder.mkdir()
    return Path(shutil.copy2(file, folder))


def test_a_sound_log_misses_nothing(tmp_path: Path) -> None:
    write(tmp_path)
    found = missing(tmp_path)
    assert (found.incomplete, found.missing, found.lines()) == (False, 0, [])


def test_the_loss_of_the_beginning_does_not_lose_what_the_run_was(tmp_path: Path) -> None:
    content = bytearray(write(tmp_path, finished=False))
    content[:3000] = bytes(3000)
    (tmp_path / "run-000.mcap").write_bytes(content)
    segment = read_segment(tmp_path / "run-000.mcap")
    assert segment.about["seed"] == 3
    assert segment.damage[0].begin == 0


def test_one_unreadable_file_does_not_hide_the_others(tmp_path: Path) -> None:
    for k in range(3):
        log = RunLogWriter(tmp_path, {})
        log.add(rows(1, 20), 0.1)
        log.close()
        assert (tmp_path / f"run-{k:03d}.mcap").exists()
    (tmp_path / "run-001.mcap").write_bytes(b"\xff" * 5000)
    found = missing(tmp_path)
    assert found.empty == ["run-001.mcap"]
    assert found.incomplete
    assert [len(s.rows) for s in segments(tmp_path)] == [20, 0, 20]


def test_a_segment_that_lost_its_facts_goes_on_with_the_run_before_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = RunLogWriter(tmp_path, {"seed": 3})
    with monkeypatch.context() as patch:
        patch.setattr("counterflex.files.logs.run_log.SEGMENT_BYTES", 1000)
        log.add(rows(1, 40), 0.1)
    log.add(rows(41, 80), 0.2)
    log.close()
    file = tmp_path / "run-001.mcap"
    file.write_bytes(file.read_bytes().replace(b"seed", b"deed"))  # both copies: their checksum is wrong
    found = list(segments(tmp_path))
    assert [s.run for s in found] == [0, 0]
    assert found[1].about["seed"] == 3
    (tmp_path / "run-000.mcap").unlink()
    assert next(segments(tmp_path)).about[UNKNOWN] is True
    assert missing(tmp_path).missing == 40


def test_a_segment_without_records_in_between_does_not_part_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = RunLogWriter(tmp_path, {"seed": 3})
    with monkeypatch.context() as patch:
        patch.setattr("counterflex.files.logs.run_log.SEGMENT_BYTES", 1000)
        log.add(rows(1, 40), 0.1)
        log.add(rows(41, 80), 0.2)
    log.add(rows(81, 120), 0.3)
    log.close()
    middle, last = tmp_path / "run-001.mcap", tmp_path / "run-002.mcap"
    content = bytearray(middle.read_bytes())
    for chunk in salvage(bytes(content)).chunks:
        content[chunk.begin + 60] ^= 4
    middle.write_bytes(content)
    last.write_bytes(last.read_bytes().replace(b"seed", b"deed"))
    assert [(len(s.rows), s.run) for s in segments(tmp_path)] == [(40, 0), (0, 0), (40, 0)]
    assert missing(tmp_path).missing == 40


def test_another_program_s_columns_are_still_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path)
    monkeypatch.setattr("counterflex.files.logs.segment.COLUMNS", (*COLUMNS[:-1], "other"))
    with pytest.raises(FileFormatError, match="columns mean something else"):
        read_segment(tmp_path / "run-000.mcap")
