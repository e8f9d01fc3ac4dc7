"""The commands of the panel: what is refused, before anything is served."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest


def test_what_is_no_folder_is_refused(tmp_path: Path, counterflex: Any) -> None:
    (tmp_path / "log").write_text("")
    ended = counterflex("panel", str(tmp_path / "log"))
    assert ended.status == 2
    assert "a file has the name of the folder" in ended.err


def test_a_network_needs_users_and_tls(tmp_path: Path, counterflex: Any) -> None:
    ended = counterflex("panel", str(tmp_path), "--host", "0.0.0.0")
    assert ended.status == 2
    assert "passwords and TLS" in ended.err
    assert "panel-user" in ended.err


def test_a_missing_file_of_users_is_named(tmp_path: Path, counterflex: Any) -> None:
    ended = counterflex("panel", str(tmp_path), "--users", str(tmp_path / "none.toml"))
    assert ended.status == 2
    assert "none.toml" in ended.err


@pytest.mark.parametrize(
    ("password", "words", "said"),
    [
        ("short", ("anna",), "10 to 256 characters"),
        ("long enough it is", ("anna", "--role", "boss"), "no such role"),
        ("long enough it is", ("an na",), "name"),
    ],
)
def test_a_user_that_cannot_be_is_refused_and_nothing_written(
    tmp_path: Path,
    counterflex: Any,
    monkeypatch: pytest.MonkeyPatch,
    password: str,
    words: tuple[str, ...],
    said: str,
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(password + "\n"))
    ended = counterflex("panel-user", str(tmp_path / "users.toml"), *words)
    assert ended.status == 2
    assert said in ended.err
    assert list(tmp_path.iterdir()) == []


def test_a_user_is_made(tmp_path: Path, counterflex: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("long enough it is\n"))
    ended = counterflex("panel-user", str(tmp_path / "users.toml"), "anna", "--role", "operator")
    assert (ended.status, ended.out.strip()) == (0, f"wrote {tmp_path / 'users.toml'}: anna is operator")
