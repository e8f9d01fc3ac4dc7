"""Errors print as one line, arrays are checked, files are written whole or not at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.core import atomic
from counterflex.core.arrays import as_float, as_positive
from counterflex.core.errors import CounterflexError, InputError, OutputError


def test_error_is_one_line_with_value_limit_place_and_hint() -> None:
    fault = CounterflexError("too far", where="part.ngc:3", value="2.1 m", limit="<= 2.0 m", hint="Move\nthe part")
    assert str(fault) == "part.ngc:3: too far; got 2.1 m; expected <= 2.0 m. Move the part"


def test_arrays_are_checked_for_shape_and_finiteness() -> None:
    assert as_float("q", [1, 2, 3], (3,)).dtype == np.float64
    with pytest.raises(InputError, match="q has the wrong shape"):
        as_float("q", [1, 2], (3,))
    with pytest.raises(InputError, match=r"not finite at index \[1\]"):
        as_float("q", [1, np.nan, 3])
    with pytest.raises(InputError, match="not an array of numbers"):
        as_float("q", "abc")
    with pytest.raises(InputError, match="mass is out of range; got -1.0"):
        as_positive("mass", -1.0)


def test_failed_write_leaves_the_old_file_and_no_parts(tmp_path: Path) -> None:
    target = tmp_path / "result.txt"
    atomic.write_text(target, "old")
    with pytest.raises(RuntimeError, match="stop"), atomic.atomic_path(target) as part:
        part.write_text("half")
        raise RuntimeError("stop")
    assert target.read_text() == "old"
    assert [item.name for item in tmp_path.iterdir()] == ["result.txt"]


def test_folder_appears_only_when_the_job_ends_well(tmp_path: Path) -> None:
    target = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt), atomic.atomic_folder(target) as staging:
        (staging / "a.txt").write_text("half")
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []
    with atomic.atomic_folder(target) as staging:
        (staging / "a.txt").write_text("whole")
    assert (target / "a.txt").read_text() == "whole"


def test_a_file_where_the_folder_should_be_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write"):
        atomic.write_text(tmp_path / "file" / "result.txt", "x")
