"""Settings of a panel, and their refusal: no network without passwords and TLS."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from counterflex.app.panel.access import LOOPBACK, require_protected
from counterflex.core import file_content
from counterflex.core.errors import FileFormatError, InputError

PORT: Final = 8642
LEAST: Final = 24
"""Characters of a key of /metrics."""
RANGE_UM: Final = 200.0


@dataclass(frozen=True)
class PanelSettings:
    """Settings of a panel."""

    folder: Path
    host: str = "127.0.0.1"
    port: int = PORT  # TCP port; 0 takes a free one
    users: Path | None = None  # File of users, or None: a link that the command prints opens it
    certificate: Path | None = None  # PEM file, or None: no TLS
    key: Path | None = None
    metrics_key: Path | None = None  # File with the key that reads /metrics and nothing else, or None
    rate_hz: float = 20.0  # Messages to each page per second
    range_um: float = RANGE_UM

    @property
    def local(self) -> bool:
        """Only this computer reaches it."""
        return self.host in LOOPBACK

    @property
    def secure(self) -> bool:
        """It speaks TLS."""
        return self.certificate is not None


def read_metrics_key(path: Path | None) -> str:
    """Return the key in a file; empty without a file.

    Raises:
        FileFormatError: It cannot be read, or is too short or more than one word.
    """
    if path is None:
        return ""
    key = file_content.text(path).strip()
    if len(key) < LEAST or not key.isascii() or len(key.split()) != 1:
        raise FileFormatError(
            "no key", where=str(path), value=f"{len(key)} characters", limit=f"one word of at least {LEAST} characters",
            hint=f"Make one: openssl rand -hex {LEAST}",
        )  # fmt: skip
    return key


def require_safe(settings: PanelSettings) -> None:
    """Refuse a panel that others could reach without a password or could listen to.

    Raises:
        InputError: Users or TLS are missing, or the page library is not installed.
    """
    require_protected("a panel", "TLS", settings)
    if importlib.util.find_spec("nicegui") is None:
        raise InputError("the panel needs the package nicegui", hint='Install it with pip install "counterflex[panel]"')
