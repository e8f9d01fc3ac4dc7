"""A log's overview by the digests of its segments: the same figures, and a few kilobytes of each file that are read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.app.run.log import show
from counterflex.core.arrays import Float
from counterflex.evaluate.run_record import RunRecord
from counterflex.files.logs import run_log
from counterflex.files.logs.repair import repair_segment
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.files.logs.segments import read_brief, segments
from counterflex.runtime import record_ring as record
from counterflex.runtime.state.states import Cause, State


def rows(n: int) -> Float:
    """A run that corrects, and holds for a while now and then."""
    out = np.random.default_rng(3).standard_normal((n, record.WIDTH))
    out[:, record.column("out_state") : record.column("event_new") + 1] = 0.0
    out[:, record.column("pair_used")] = 0.0
    cycle = np.arange(1, n + 1)
    out[:, record.CYCLE] = cycle
    out[:, 1] = 4e6 * cycle
    out[:, 2] = out[:, 1] + 150_000.0 + cycle % 900
    out[:, 3] = 1.0
    out[:, record.column("out_state")] = np.where(cycle % 800 < 30, State.HOLD, State.ACTIVE)
    out[:, record.column("out_cause")] = np.where(cycle % 800 < 30, Cause.FORCE_STALE, Cause.NONE)
    out[:, record.column("out_soft")] = out[:, record.column("out_cause")]
    return out


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Some segments of a run, finished."""
    monkeypatch.setattr(run_log, "SEGMENT_BYTES", 1 << 20)
    log, data = RunLogWriter(tmp_path, {"counterflex": "x"}), rows(4000)
    for k in range(0, len(data), 25):
        log.add(data[k : k + 25], 4e-3 * k)
        if k == 1000:
            log.note({"time_ns": 5, "who": "anna", "action": "reset", "done": True})
    log.close()
    return tmp_path


def same(folder: Path) -> tuple[dict[str, object], dict[str, object]]:
    """What is shown of a log by all records, and by digests, less the percentiles."""
    out = []
    for brief in (False, True):
        table = show(folder, brief=brief)
        table.pop("unread")
        for run in table["runs"]:
            run.pop("reply_us")
        out.append(table)
    return out[0], out[1]


def test_an_overview_by_digests_says_the_same(folder: Path) -> None:
    whole, brief = same(folder)
    assert whole == brief
    assert len(whole["segments"]) > 4  # type: ignore[arg-type]
    assert show(folder, brief=True)["unread"] == whole["segments"]
    assert whole["runs"][0]["incidents_total"] == 6  # type: ignore[index]
    assert whole["runs"][0]["operator_actions"]  # type: ignore[index]


def test_of_a_segment_a_few_kilobytes_are_read_however_long_it_is(folder: Path) -> None:
    for file in sorted(folder.glob("run-*.mcap")):
        read: list[int] = []
        assert read_brief(file, read.append) is not None
        assert sum(read) < 16_000 < file.stat().st_size / 10


def test_what_has_no_sound_digest_is_read(folder: Path) -> None:
    files = sorted(folder.glob("run-*.mcap"))
    cut = files[-1].read_bytes()
    files[-1].write_bytes(cut[: len(cut) // 2])  # never finished
    content = bytearray(files[1].read_bytes())
    at = content.rindex(b'"kept"') + 40
    content[at] ^= 1
    files[1].write_bytes(bytes(content))
    assert read_brief(files[-1]) is None
    assert read_brief(files[1]) is None
    unread = [segment.name for segment in segments(folder, brief=True) if segment.digest is not None]
    assert unread == [file.name for file in files if file not in (files[1], files[-1])]
    whole, brief = same(folder)
    assert whole == brief


def test_a_repaired_segment_has_its_digest(folder: Path) -> None:
    file = min(folder.glob("run-*.mcap"))
    content = file.read_bytes()
    file.write_bytes(content[: len(content) * 2 // 3])
    done = repair_segment(file, now_s=file.stat().st_mtime + 60.0)
    assert done is not None
    again = read_brief(file)
    assert again is not None
    assert again.records == done.records
    whole, brief = same(folder)
    assert whole == brief


def test_a_count_that_is_not_the_index_own_is_not_believed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A digest of other records than the file's, by the number that the file's index says."""
    right = RunRecord.sums
    monkeypatch.setattr(RunRecord, "sums", lambda self: {**right(self), "records": 7})
    log = RunLogWriter(folder, {})
    log.add(rows(100), 0.0)
    log.close()
    last = max(folder.glob("run-*.mcap"))
    assert read_brief(last) is None
