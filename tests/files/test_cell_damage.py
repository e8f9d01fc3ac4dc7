"""Damaged cell files: cut off, shuffled, with keys doubled or renamed. Refused in one line, never anything else."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import CounterflexError, FileFormatError
from counterflex.files.cell.cell import read_cell

SMALL = Path(__file__).resolve().parents[1] / "data" / "cells" / "small.toml"
LINES = SMALL.read_text(encoding="utf-8").splitlines()
COORDINATES = {f"{axis}_mm" for axis in "xyz"} | {f"{angle}_deg" for angle in "abc"}
KEYS = [i for i, line in enumerate(LINES) if "=" in line and not line.startswith((" ", "#", "["))]


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damaged") / "cell.toml"


def refusal(file: Path, text: str) -> str | None:
    """The line with which a text is refused as a cell that mills; None where it is one."""
    file.write_text(text, encoding="utf-8")
    said = None
    try:
        read_cell(file).require_milling()
    except CounterflexError as fault:
        said = str(fault)
    assert said is None or len(said.splitlines()) == 1
    return said


def shape(value: Any) -> Any:
    """Which keys stand in which table, without values and without the coordinates that are zero when left out."""
    if isinstance(value, dict):
        return {key: shape(item) for key, item in value.items() if key not in COORDINATES}
    return [shape(item) for item in value] if isinstance(value, list) and value and isinstance(value[0], dict) else None


SHAPE = shape(tomllib.loads("\n".join(LINES)))


def test_the_whole_file_is_a_cell(file: Path) -> None:
    assert refusal(file, "\n".join(LINES)) is None


@settings(max_examples=60)
@given(st.data())
def test_a_file_that_ends_before_its_last_required_key_is_refused(file: Path, data: st.DataObject) -> None:
    text = "\n".join(LINES)
    assert refusal(file, text[: data.draw(st.integers(0, text.index("\nmc = ")))]) is not None


@settings(max_examples=60)
@given(st.permutations(LINES))
def test_shuffled_lines_are_refused_unless_every_key_is_in_its_table(file: Path, lines: list[str]) -> None:
    text = "\n".join(lines)
    assert refusal(file, text) is not None or shape(tomllib.loads(text)) == SHAPE


@settings(max_examples=60)
@given(st.sampled_from(KEYS), st.integers(0, len(LINES)))
def test_a_line_in_another_table_is_refused(file: Path, taken: int, place: int) -> None:
    """In its own table a line may stand anywhere; in another one it is unknown, doubled, or missed where it was."""
    rest = LINES[:taken] + LINES[taken + 1 :]
    text = "\n".join([*rest[:place], LINES[taken], *rest[place:]])
    assert refusal(file, text) is not None or shape(tomllib.loads(text)) == SHAPE


@settings(max_examples=40)
@given(st.sampled_from(KEYS))
def test_a_doubled_or_unknown_key_is_refused(file: Path, k: int) -> None:
    assert refusal(file, "\n".join([*LINES[: k + 1], *LINES[k:]])) is not None
    name, _, value = LINES[k].partition("=")
    said = refusal(file, "\n".join([*LINES[:k], f"{name.strip()}_x ={value}", *LINES[k + 1 :]]))
    assert said is not None


def test_bytes_that_are_no_text(file: Path) -> None:
    file.write_bytes(SMALL.read_bytes()[:50] + b"\xff\xfe\x00")
    with pytest.raises(FileFormatError, match="UTF-8"):
        read_cell(file)
