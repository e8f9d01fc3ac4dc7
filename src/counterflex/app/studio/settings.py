"""Settings of a studio, and their refusal where the page library is missing or the folder cannot be a project."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from counterflex.core.errors import InputError

PORT: Final = 8643


@dataclass(frozen=True)
class StudioSettings:
    """Settings of a studio. It serves this computer only: host, users and TLS are fixed."""

    folder: Path
    port: int = PORT  # TCP port; 0 takes a free one
    host: Final[str] = "127.0.0.1"
    users: Final[Path | None] = None
    certificate: Final[Path | None] = None
    key: Final[Path | None] = None
    local: Final[bool] = True
    secure: Final[bool] = False


def require_studio(settings: StudioSettings) -> None:
    """Make the folder of the project.

    Raises:
        InputError: The page library is not installed, or the folder is a file or cannot be made.
    """
    if importlib.util.find_spec("nicegui") is None:
        raise InputError(
            "the studio needs the package nicegui", hint='Install it with pip install "counterflex[panel]"'
        )
    try:
        settings.folder.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise InputError(
            "the folder of the project cannot be used", where=str(settings.folder), value=fault.strerror,
            hint="Give a folder that exists or can be made",
        ) from fault  # fmt: skip
