"""What an OPC UA server is started with, and what of it is refused: no network without passwords and encryption."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from counterflex.app.panel.access import LOOPBACK
from counterflex.core.errors import InputError

PORT: Final = 4840
RATE_HZ: Final = 5.0


@dataclass(frozen=True)
class OpcuaSettings:
    """What an OPC UA server is started with.

    Attributes:
        folder: Of the run log.
        host: Address that it listens on.
        port: TCP port; 0 takes a free one.
        users: File of users, the same as the panel's, or None: whoever reaches it reads, nobody acknowledges.
        certificate: Of the server, DER or PEM, or None: no encryption.
        key: Its private key.
        rate_hz: How often values are written.
    """

    folder: Path
    host: str = "127.0.0.1"
    port: int = PORT
    users: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    rate_hz: float = RATE_HZ

    @property
    def local(self) -> bool:
        """Only this computer reaches it."""
        return self.host in LOOPBACK


def require_safe(settings: OpcuaSettings) -> None:
    """Refuse a server that others could reach without a password or could listen to.

    Raises:
        InputError: Users or encryption are missing, or the library is not installed.
    """
    if (settings.certificate is None) != (settings.key is None):
        raise InputError(
            "encryption needs a certificate and its key", value="one of them", limit="--certificate FILE --key FILE"
        )
    lacking = [] if settings.users is not None else ["passwords (--users FILE)"]
    lacking += [] if settings.certificate is not None else ["encryption (--certificate FILE --key FILE)"]
    if not settings.local and lacking:
        raise InputError(
            "an OPC UA server that other computers reach needs passwords and encryption",
            where=f"--host {settings.host}",
            value=f"without {' and '.join(lacking)}",
            hint="Make users with counterflex panel-user; leave out --host to serve this computer only",
        )
    if importlib.util.find_spec("asyncua") is None:
        raise InputError(
            "the OPC UA server needs the package asyncua", hint='Install it with pip install "counterflex[opcua]"'
        )
