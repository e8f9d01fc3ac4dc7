"""Faults of the computer in every form that libraries give them end as one line, and nothing is left behind."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import polars
import pytest

from counterflex.core import atomic
from counterflex.core.errors import FileFormatError, OutputError
from counterflex.core.system_fault import system_fault


class PanicException(BaseException):
    """As Rust raises it."""


def _chained(inner: BaseException, outer: Exception, *, cause: bool) -> Exception:
    try:
        try:
            raise inner
        except BaseException as fault:
            raise outer from (fault if cause else None)
    except Exception as fault:
        return fault


FULL = os.strerror(errno.ENOSPC)
FORMS: dict[str, BaseException] = {
    "Python": OSError(errno.ENOSPC, FULL),
    "polars, csv": OSError(f"{FULL} (os error 28)"),
    "polars, parquet": polars.exceptions.ComputeError(f"parquet: underlying IO error: {FULL} (os error 28)"),
    "panic": PanicException(f'called `Result::unwrap()` on an `Err` value: Os {{ code: 28, message: "{FULL}" }}'),
    "text of a C library": RuntimeError(f"write failed: {FULL}"),
    "cause of another": _chained(OSError(errno.EDQUOT, "quota"), ValueError("cannot save"), cause=True),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("place", ["file", "folder", "file in a folder"])
def test_one_line_and_nothing_is_left(tmp_path: Path, form: str, place: str) -> None:
    fault = FORMS[form]

    def write() -> None:
        if place == "file":
            with atomic.atomic_path(tmp_path / "new" / "a.bin") as part:
                part.write_bytes(b"half")
                raise fault
        with atomic.atomic_folder(tmp_path / "new") as staging:
            (staging / "before.txt").write_text("half", encoding="ascii")
            if place == "folder":
                raise fault
            with atomic.atomic_path(staging / "a.bin"):
                raise fault

    with pytest.raises(OutputError) as caught:
        write()
    line = str(caught.value)
    named = tmp_path / "new" if place == "folder" else tmp_path / "new" / "a.bin"
    assert line.startswith(f"{named}: cannot write: ")
    assert "Make room there" in line
    assert list(tmp_path.iterdir()) == []


def test_faults_of_the_program_and_of_files_that_are_read_stay_what_they_are(tmp_path: Path) -> None:
    for fault in (ZeroDivisionError("in the job"), FileFormatError("no such file", where="plan.parquet")):
        with pytest.raises(type(fault), match=str(fault)), atomic.atomic_folder(tmp_path / "out"):
            raise fault
    assert system_fault(ValueError("division")) is None


def test_what_was_handled_before_counts_only_where_it_lasts() -> None:
    def raised_within(inner: OSError) -> BaseException:
        try:
            try:
                raise inner
            except OSError:
                dict[str, int]()["missing"]
        except KeyError as fault:
            return fault
        raise AssertionError

    assert system_fault(raised_within(FileNotFoundError(errno.ENOENT, "no file"))) is None
    found = system_fault(raised_within(OSError(errno.ENOSPC, FULL)))
    assert found is not None
    assert found.errno == errno.ENOSPC


def test_a_library_writes_into_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Polars names no disk when it is full ("Invalid thrift: transport error"): Python writes the bytes."""
    frame = polars.DataFrame({"a": range(1000)})
    atomic.write_made(tmp_path / "a.parquet", frame.write_parquet)
    assert polars.read_parquet(tmp_path / "a.parquet").equals(frame)

    opened: Callable[..., object] = Path.open

    def full(path: Path, mode: str = "r", **named: object) -> object:
        stream = opened(path, mode, **named)
        if "w" in mode:
            stream.close()  # type: ignore[attr-defined]
            return open("/dev/full", mode, buffering=0)  # noqa: PTH123
        return stream

    monkeypatch.setattr(Path, "open", full)
    with pytest.raises(OutputError, match=f"b.parquet: cannot write: {FULL}"):
        atomic.write_made(tmp_path / "b.parquet", frame.write_parquet)
    assert [item.name for item in tmp_path.iterdir()] == ["a.parquet"]
