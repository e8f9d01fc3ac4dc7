"""Numbers on the command line: every count has a least and a most, so that none fills memory or runs for ever."""

from __future__ import annotations

import typing
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import typer

from counterflex.cli.main import whole


def commands(group: typer.Typer, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Callable[..., Any]]]:
    """Every command of the tree, by the words that call it."""
    for command in group.registered_commands:
        assert command.callback is not None
        yield (*path, command.name or command.callback.__name__), command.callback
    for below in group.registered_groups:
        assert below.typer_instance is not None
        yield from commands(below.typer_instance, (*path, str(below.name)))


def counts() -> Iterator[tuple[str, str, Any]]:
    """Every option and argument that takes a whole number."""
    for words, callback in commands(whole()):
        for name, hint in typing.get_type_hints(callback, include_extras=True).items():
            if typing.get_origin(hint) is not typing.Annotated:
                continue
            base, *more = typing.get_args(hint)
            info = next((item for item in more if hasattr(item, "min")), None)
            if info is not None and int in {base, *typing.get_args(base)}:
                yield " ".join(words), "--" + name.replace("_", "-"), info


COUNTS = list(counts())


def test_there_are_counts() -> None:
    assert len(COUNTS) >= 20
    assert ("identify", "--propose") in {(words, name) for words, name, _ in COUNTS}


@pytest.mark.parametrize(("words", "name", "info"), COUNTS, ids=[f"{words} {name}" for words, name, _ in COUNTS])
def test_a_count_is_bounded(words: str, name: str, info: Any) -> None:
    assert info.min is not None, f"{words} {name} has no least value"
    assert info.max is not None, f"{words} {name} has no largest value"
    assert info.min <= info.max <= 2**31 - 1


@pytest.mark.parametrize("count", ["1000000000", "0", "-1", "1e3"])
def test_a_proposal_beyond_reason_is_refused_at_once(counterflex: Any, folder: Any, count: str) -> None:
    ended = counterflex("identify", "tracker-frame", "--propose", count, "--cell", "cell.toml", "--out", "proposal")
    assert ended.status == 2
    assert "--propose" in ended.err
    assert any(
        part in ended.err for part in ("less than or equal to 500", "greater than or equal to 1", "valid integer")
    )
    assert f"got {count}; expected" in ended.err
    assert not (folder / "proposal").exists()
