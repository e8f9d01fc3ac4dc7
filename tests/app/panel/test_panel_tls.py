"""The panel over TLS in a real browser: a viewer logs in with his password; no run, no rig."""

from __future__ import annotations

import datetime
import ipaddress
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from browser import Browser, Page, chromium
from counterflex.files.panel_users import set_user

pytest.importorskip("nicegui", reason="the extra panel is not installed")
pytestmark = pytest.mark.skipif(chromium() is None, reason="no Chromium on this computer")
PASSWORD = "four words and one"


def certificate(folder: Path) -> tuple[Path, Path]:
    """A certificate of 127.0.0.1 signed by its own key, for a day, and the key."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "panel")])
    now = datetime.datetime.now(datetime.UTC)
    signed = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(hours=1))
        .not_valid_after(now + datetime.timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))]), critical=False)
        .sign(key, hashes.SHA256())
    )
    files = folder / "panel.pem", folder / "panel-key.pem"
    files[0].write_bytes(signed.public_bytes(serialization.Encoding.PEM))
    plain = serialization.NoEncryption()
    files[1].write_bytes(key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, plain))
    return files


def log_in(page: Page, password: str) -> None:
    for field, value in (("name", "ben"), ("password", password)):
        page.wait(f"document.querySelector('input[name={field}]') !== null", "the form to log in")
        page.value(f"document.querySelector('input[name={field}]').value = {value!r}")
    page.value("document.querySelector('form').submit()")


@pytest.mark.long
def test_a_viewer_logs_in_over_tls(tmp_path: Path) -> None:
    public, private = certificate(tmp_path)
    set_user(tmp_path / "users.toml", "ben", "viewer", PASSWORD)
    command = [sys.executable, "-m", "counterflex", "panel", str(tmp_path / "log"), "--port", "0"]
    command += ["--users", str(tmp_path / "users.toml"), "--certificate", str(public), "--key", str(private)]
    panel = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert panel.stdout is not None
        who, link = panel.stdout.readline().strip().split(": ", 1)
        assert (who, link[:8]) == ("log in", "https://")
        with Browser(draws=False) as browser:
            page = browser.page()
            page.open(link)
            log_in(page, "a wrong password")
            page.wait("document.body.innerText.includes('wrong')", "a wrong password is refused")
            log_in(page, PASSWORD)
            page.wait_text("state", "NO RUN")
            assert page.value("location.protocol") == "https:"
            assert page.value("window.socket.io.engine.transport.ws.url").startswith("wss://")
            assert page.value("document.body.innerText.includes('ben (viewer)')")
            assert not any(page.there(name) for name in ("stop", "reset", "arm"))
            (cookie,) = page.call("Network.getCookies")["cookies"]
            assert (cookie["secure"], cookie["httpOnly"], cookie["sameSite"]) == (True, True, "Strict")
        host, port = link.removeprefix("https://").rstrip("/").split(":")
        with socket.create_connection((host, int(port))) as plain:  # what speaks no TLS gets no page
            plain.sendall(f"GET /login HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
            assert b"counterflex" not in plain.recv(4096)
        panel.send_signal(signal.SIGINT)
        _, errors = panel.communicate()
        assert "Traceback" not in errors
    finally:
        if panel.poll() is None:
            panel.kill()
            panel.communicate()
