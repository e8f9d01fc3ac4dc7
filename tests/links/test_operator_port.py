"""The operator's port: heard is who can read the file, on this computer; rubbish disturbs nothing."""

from __future__ import annotations

import json
import socket
import stat
import threading
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from counterflex.core.errors import FileFormatError, OutputError
from counterflex.links.operator_port import FILE, Asked, OperatorPort, ask


@pytest.fixture
def port(tmp_path: Path) -> Any:
    made = OperatorPort(tmp_path)
    yield made
    made.close()


def send(folder: Path, data: bytes) -> None:
    where = json.loads((folder / FILE).read_text(encoding="utf-8"))["port"]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.sendto(data, ("127.0.0.1", where))


def test_a_request_is_heard_and_answered(tmp_path: Path, port: OperatorPort) -> None:
    found: list[dict[str, Any]] = []
    asking = threading.Thread(target=lambda: found.append(ask(tmp_path, "reset", wait_s=60.0)))
    asking.start()
    heard: list[Asked] = []
    while not heard:
        heard = port.poll()
    assert [asked.action for asked in heard] == ["reset"]
    port.answer(heard[0], {"done": True})
    asking.join()
    assert found == [{"done": True}]


@pytest.mark.parametrize("token", ["", "0" * 32, None, 7])
def test_who_has_not_the_token_is_not_heard(tmp_path: Path, port: OperatorPort, token: object) -> None:
    send(tmp_path, json.dumps({"token": token, "do": "reset"}).encode())
    right = json.loads((tmp_path / FILE).read_text(encoding="utf-8"))["token"]
    send(tmp_path, json.dumps({"token": right, "do": "stop"}).encode())
    assert [asked.action for asked in port.poll()] == ["stop"]


@given(st.one_of(st.binary(max_size=200), st.text(max_size=50).map(str.encode)))
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_rubbish_is_passed_over(tmp_path: Path, port: OperatorPort, data: bytes) -> None:
    send(tmp_path, data)
    assert port.poll() == []


def test_only_the_user_can_read_the_file_and_it_goes_with_the_run(tmp_path: Path) -> None:
    with_old = tmp_path / FILE
    with_old.write_text("left by a run that was killed", encoding="utf-8")
    made = OperatorPort(tmp_path)
    assert stat.S_IMODE(with_old.stat().st_mode) == 0o600
    made.close()
    assert not with_old.exists()


def test_without_a_run_there_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="no run goes on there"):
        ask(tmp_path, "status")
    (tmp_path / FILE).write_text("[]", encoding="utf-8")
    with pytest.raises(FileFormatError, match="is not the file of a run"):
        ask(tmp_path, "status")
    made = OperatorPort(tmp_path)
    with pytest.raises(OutputError, match="does not answer"):
        ask(tmp_path, "status", wait_s=0.05)
    made.close()
