"""The comment by which a compensated program says which plan it was written from."""

from __future__ import annotations

import re
from typing import Final

from counterflex.core.errors import InputError

_HASH: Final = re.compile(r"[0-9a-f]{16}")
_MARK: Final = re.compile(r"\bcounterflex job ([0-9a-f]{16})\b")


def mark(job: str) -> str:
    """Text of the comment, without the language's own signs.

    Args:
        job: Hash of the plan, 16 hexadecimal digits.

    Raises:
        InputError: It is none.
    """
    if not _HASH.fullmatch(job):
        raise InputError("not the hash of a job", value=job, limit="16 hexadecimal digits")
    return f"counterflex job {job}"


def marks(text: str) -> tuple[str, ...]:
    """Hashes that a program carries, in order, each once: none in an original program, one in a compensated one."""
    return tuple(dict.fromkeys(_MARK.findall(text)))


def job_number(job: str) -> int:
    """Number by which a running robot program says of which job it is: 2 to 1048577, exact in a REAL of 32 bits.

    The first 20 bits of the hash, above 1: 0 and 1 say no more than off and on.

    Args:
        job: Hash of the plan, 16 hexadecimal digits.

    Raises:
        InputError: It is none.
    """
    mark(job)
    return 2 + int(job[:5], 16)
