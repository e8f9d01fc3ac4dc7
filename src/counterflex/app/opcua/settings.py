"""Settings of an OPC UA server, and their refusal: no network without passwords and encryption."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from counterflex.app.panel.access import require_protected
from counterflex.core.errors import InputError

PORT: Final = 4840
RATE_HZ: Final = 5.0


@dataclass(frozen=True)
class OpcuaSettings:
    """Settings of an OPC UA server."""

    folder: Path
    host: str = "127.0.0.1"
    port: int = PORT  # TCP port; 0 takes a free one
    # File of users, the same as the panel's, or None: whoever reaches it reads, nobody acknowledges
    users: Path | None = None
    certificate: Path | None = None  # Of the server, DER or PEM, or None: no encryption
    key: Path | None = None
    rate_hz: float = RATE_HZ

    def require_safe(self) -> None:
        """Refuse a server that others could reach without a password or could listen to.

        Raises:
            InputError: Users or encryption are missing, or the library is not installed.
        """
        require_protected("an OPC UA server", "encryption", self)
        if importlib.util.find_spec("asyncua") is None:
            raise InputError(
                "the OPC UA server needs the package asyncua", hint='Install it with pip install "counterflex[opcua]"'
            )
