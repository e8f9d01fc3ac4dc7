"""The kept verdict on a machine: read back as written, believed only for this machine, this kernel, this week."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import FileFormatError
from counterflex.files.machine_file import OLDEST, StoredVerdict, against, machine_file, read_verdict, write_verdict

NOW = datetime(2026, 5, 17, 8, 30, tzinfo=UTC)
GOOD = StoredVerdict("mill-pc", "6.1-rt", NOW - timedelta(days=2), "fits", True, 3.1e-4, 3e-3, ("a", "b"))


def why(kept: StoredVerdict | None) -> str:
    return against(kept, host="mill-pc", kernel="6.1-rt", now=NOW)


def test_round_trip(tmp_path: Path) -> None:
    file = tmp_path / "new" / "machine.json"
    assert read_verdict(file) is None
    for kept in (GOOD, replace(GOOD, p999_s=None, fits=False, reasons=())):
        write_verdict(file, kept)
        assert read_verdict(file) == kept


def test_a_good_verdict_allows() -> None:
    assert why(GOOD) == ""
    assert why(replace(GOOD, date=NOW - OLDEST)) == ""
    assert why(replace(GOOD, date=GOOD.date.astimezone())) == ""


@pytest.mark.parametrize(
    ("kept", "word"),
    [
        (None, "not been measured"),
        (replace(GOOD, host="other"), "other"),
        (replace(GOOD, kernel="5.4"), "5.4"),
        (replace(GOOD, date=NOW - OLDEST - timedelta(minutes=1)), "7 days ago"),
        (replace(GOOD, date=NOW + timedelta(days=2)), "future"),
        (replace(GOOD, fits=False), "does not keep time for the loop: a"),
    ],
)
def test_what_does_not_allow(kept: StoredVerdict | None, word: str) -> None:
    assert word in why(kept)


@given(st.timedeltas(timedelta(days=-400), timedelta(days=400)))
def test_only_a_week_is_believed(age: timedelta) -> None:
    allowed = timedelta(days=-1) <= age <= OLDEST
    assert (why(replace(GOOD, date=NOW - age)) == "") == allowed


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        "{}",
        '{"format": "counterflex-machine", "version": 2}',
        '{"format": "counterflex-machine", "version": 1}',
        '{"format": "counterflex-machine", "version": 1, "host": "a", "kernel": "b", "date": "yesterday",'
        ' "verdict": "fits", "fits": true, "p999_s": 1, "budget_s": 1, "reasons": []}',
        '{"format": "counterflex-machine", "version": 1, "host": "a", "kernel": "b", "date": "2026-05-17",'
        ' "verdict": "fits", "fits": "no", "p999_s": 1, "budget_s": 1, "reasons": []}',
    ],
)
def test_what_is_no_verdict_is_refused(tmp_path: Path, content: str) -> None:
    file = tmp_path / "machine.json"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(FileFormatError, match=r"machine\.json.*doctor"):
        read_verdict(file)


def test_it_lies_in_the_cache_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("COUNTERFLEX_CACHE", str(tmp_path / "a"))
    assert machine_file() == tmp_path / "a" / "machine.json"
    monkeypatch.delenv("COUNTERFLEX_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "b"))
    assert machine_file() == tmp_path / "b" / "counterflex" / "machine.json"
