"""The command of the OPC UA server: what is refused, before anything is served."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def test_other_computers_need_passwords_and_encryption(tmp_path: Path, counterflex: Any) -> None:
    ended = counterflex("opcua", str(tmp_path), "--host", "0.0.0.0")
    assert ended.status == 2
    assert "without passwords (--users FILE) and encryption" in ended.err
    assert "panel-user" in ended.err


def test_a_key_without_its_certificate_is_refused(tmp_path: Path, counterflex: Any) -> None:
    (tmp_path / "key.pem").write_text("", encoding="utf-8")
    ended = counterflex("opcua", str(tmp_path), "--key", str(tmp_path / "key.pem"))
    assert ended.status == 2
    assert "needs a certificate and its key" in ended.err
