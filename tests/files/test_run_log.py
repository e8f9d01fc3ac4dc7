"""The run log: what is written reads back, whole or cut anywhere; a full disk loses only what it cannot hold."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.run.missing import LogMissing
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.files.logs.segments import read_log, read_segment, segments
from counterflex.runtime.record_ring import COLUMNS, CYCLE, ROWS, WIDTH, RecordRing


def rows(n: int, start: int = 0) -> Float:
    out = np.random.default_rng(start).standard_normal((n, WIDTH))
    out[:, 1] = (np.arange(n) + start) * 4_000_000
    return out


def test_columns_are_as_wide_as_a_record() -> None:
    assert len(COLUMNS) == WIDTH == len(set(COLUMNS))


def test_round_trip_bit_for_bit(tmp_path: Path) -> None:
    log, data = RunLogWriter(tmp_path, {"seed": 3}), rows(500)
    for k in range(0, 500, 7):
        log.add(data[k : k + 7], k * 0.028)
    log.close()
    found, about, cut = read_log(tmp_path)
    np.testing.assert_array_equal(found, data)
    assert about["seed"] == 3
    assert cut == []
    assert log.lost == 0


def test_cut_at_any_byte_all_but_the_last_chunk_reads_back(tmp_path: Path) -> None:
    log, data = RunLogWriter(tmp_path, {}), rows(200)
    for k in range(0, 200, 25):
        log.add(data[k : k + 25], 0.1 * k)
    log.close()
    whole = (tmp_path / "run-000.mcap").read_bytes()
    file, last = tmp_path / "cut.mcap", 0
    for size in range(0, len(whole), 997):
        file.write_bytes(whole[:size])
        try:
            segment = read_segment(file)
            found, finished = segment.rows, segment.whole
        except FileFormatError:
            assert last == 0
            continue
        assert not finished
        assert len(found) >= last
        np.testing.assert_array_equal(found, data[: len(found)])
        last = len(found)
    assert last >= 175


def test_a_segment_that_was_never_finished_reads_back(tmp_path: Path) -> None:
    log, data = RunLogWriter(tmp_path, {}), rows(100)
    for k in range(0, 100, 25):
        log.add(data[k : k + 25], 0.1 * (k + 1))
    found, _, cut = read_log(tmp_path)
    np.testing.assert_array_equal(found, data)
    assert cut == ["run-000.mcap"]
    log.close()


def test_a_full_disk_ends_the_segment_and_writing_goes_on_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, data = RunLogWriter(tmp_path, {}), rows(300)
    log.add(data[:100], 0.2)

    def full(_: object, **_kwargs: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("counterflex.files.logs.run_log.Writer.flush", full)
        patch.setattr("counterflex.files.logs.run_log.Writer.start", full)
        log.add(data[100:150], 0.4)
        assert "space" in log.trouble
        log.add(data[150:200], 0.5)
        log.add(data[150:200], 3.0)
    assert log.lost == 150
    log.add(data[200:], 6.0)
    log.close()
    assert log.trouble == ""
    found, _, cut = read_log(tmp_path)
    np.testing.assert_array_equal(found[:100], data[:100])
    np.testing.assert_array_equal(found[-100:], data[200:])
    assert cut == ["run-000.mcap"]


def test_a_new_run_leaves_the_old_segments_alone(tmp_path: Path) -> None:
    for k in range(2):
        log = RunLogWriter(tmp_path, {"run": k})
        log.add(rows(10, k), 0.2)
        log.close()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run-000.mcap", "run-001.mcap"]


def test_two_runs_that_write_to_one_folder_at_once_keep_their_own_segments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("counterflex.files.logs.run_log.SEGMENT_BYTES", 1)
    logs = [RunLogWriter(tmp_path, {"who": k}) for k in range(2)]
    data = [rows(40, 1), rows(40, 1001)]
    for one in data:
        one[:, CYCLE] = np.arange(1, 41)
    for k in range(0, 40, 10):
        for log, one in zip(logs, data, strict=True):
            log.add(one[k : k + 10], 0.1 * (k + 1))
    for log in logs:
        log.close()
    assert [(log.written, log.lost, log.trouble) for log in logs] == [(40, 0, "")] * 2
    assert [log.first for log in logs] == [0, 1]
    missing = LogMissing()
    for segment in segments(tmp_path):
        missing.add(segment)
    assert missing.end(tmp_path).lines() == []
    for who, one in enumerate(data):
        own = [s.rows for s in segments(tmp_path) if s.about["who"] == who and s.run == who]
        np.testing.assert_array_equal(np.concatenate(own), one)


def test_a_number_that_is_taken_while_a_log_begins_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run-000.mcap").write_bytes(b"another run's")
    monkeypatch.setattr(
        "counterflex.files.logs.run_log.Path.glob", lambda *_: iter(())
    )  # not there yet when looked for
    log = RunLogWriter(tmp_path, {})
    log.add(rows(10), 0.2)
    log.close()
    assert (tmp_path / "run-000.mcap").read_bytes() == b"another run's"
    segment = read_segment(tmp_path / "run-001.mcap")
    assert (len(segment.rows), segment.run, log.first) == (10, 1, 1)


@pytest.mark.parametrize("content", [b"", b"hello", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + b"\0" * 500])
def test_what_is_no_run_log_is_named(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "x.mcap"
    file.write_bytes(content)
    with pytest.raises(FileFormatError, match=r"x\.mcap"):
        read_segment(file)
    with pytest.raises(FileFormatError, match="no run log"):
        read_log(tmp_path / "nowhere")


def test_the_ring_hands_over_every_row_in_order() -> None:
    ring = RecordRing()
    reader = RecordRing(ring.name)
    data, taken = rows(1000), []
    for k, row in enumerate(data):
        ring.row()[:] = row
        ring.commit()
        if k % 37 == 0:
            taken.append(reader.take())
    taken.append(reader.take())
    np.testing.assert_array_equal(np.concatenate(taken), data)
    assert reader.dropped == 0
    reader.close()
    ring.close()


def test_a_slow_reader_loses_the_oldest_and_knows_it() -> None:
    ring = RecordRing()
    reader = RecordRing(ring.name)
    total = ROWS + 500
    for k in range(total):
        ring.row()[0] = k
        ring.commit()
    found = reader.take()
    assert reader.dropped + len(found) == total
    assert reader.dropped > 0
    np.testing.assert_array_equal(found[:, 0], np.arange(reader.dropped, total))
    reader.close()
    ring.close()
    with pytest.raises(InputError):
        RecordRing("counterflex-no-such-ring")
