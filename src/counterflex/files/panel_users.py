"""Who may use an operator panel (``counterflex-panel-users``, version 1): names, roles, and hashes of passwords."""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
from pathlib import Path
from typing import Annotated, Final, Literal

import tomli_w
from pydantic import Field

from counterflex.core import atomic
from counterflex.core.errors import InputError
from counterflex.files.schema import Table, Versioned, check_header, parse, read_toml

KIND: Final = "counterflex-panel-users"
VERSION: Final = 1
Role = Literal["viewer", "operator"]
LEAST: Final = 10
"""Characters of a password."""
_MOST: Final = 256
_N, _R, _P = 1 << 14, 8, 1
"""Cost of scrypt (RFC 7914): 16 MB and some 50 ms a try."""
_NOBODY: Final = bytes(16)


class UserTable(Table):
    """One user."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,23}$")]
    role: Role
    salt: Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
    scrypt: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class UserTables(Versioned):
    """A file of users."""

    users: tuple[UserTable, ...] = ()


class PanelUsers:
    """The users of a file.

    Args:
        path: Of the file.

    Raises:
        FileFormatError: It is none, or a name stands there twice.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        content = read_toml(path, KIND)
        check_header(content, kind=KIND, version=VERSION, where=str(path))
        self.users = {user.name: user for user in parse(UserTables, content, where=str(path)).users}

    def role(self, name: str, password: str) -> Role | None:
        """The role of a user whose password is right, else None; as long for a name that there is not."""
        user = self.users.get(name)
        salt = _NOBODY if user is None else bytes.fromhex(user.salt)
        right = hmac.compare_digest(_hash(password, salt), "" if user is None else user.scrypt)
        return user.role if user is not None and right else None


def set_user(path: Path, name: str, role: Role, password: str) -> None:
    """Add a user to a file, or give him another role and password; the file is made where it is missing.

    Args:
        path: Of the file; readable by its user only.
        name: Letters, digits, ``_ . -``; at most 24.
        role: ``viewer`` or ``operator``.
        password: At least :data:`LEAST` characters.

    Raises:
        InputError: The name or the password cannot be used.
        FileFormatError: The file is none.
        OutputError: It cannot be written.
    """
    if not LEAST <= len(password) <= _MOST:
        raise InputError("the password has a wrong length", value=len(password), limit=f"{LEAST} to {_MOST} characters")
    users = dict(PanelUsers(path).users) if path.exists() else {}
    salt = secrets.token_bytes(16)
    one = {"name": name, "role": role, "salt": salt.hex(), "scrypt": _hash(password, salt)}
    users[name] = parse(UserTable, one, where="user")
    content = {"format": KIND, "version": VERSION, "users": [user.model_dump() for user in users.values()]}
    with atomic.atomic_path(path) as part:
        part.write_text(tomli_w.dumps(content), encoding="utf-8")
        if os.name == "posix":
            part.chmod(0o600)
    if os.name == "posix":
        path.chmod(0o600)


def _hash(password: str, salt: bytes) -> str:
    return hashlib.scrypt(password.encode(), salt=salt, n=_N, r=_R, p=_P, dklen=32).hex()
