"""How a command ends that cannot go on: one line on standard error, and an exit status."""

from __future__ import annotations

import sys
from typing import NoReturn


def end(line: str, status: int = 2) -> NoReturn:
    """End the command with a line on standard error.

    Args:
        line: What is wrong.
        status: Exit status.
    """
    print(f"error: {' '.join(line.split())}", file=sys.stderr)
    sys.exit(status)
