"""Users of an operator panel (``counterflex-panel-users``, version 1): names, roles, and hashes of passwords."""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final, Literal

import tomli_w
from pydantic import Field

from counterflex.core import atomic, held
from counterflex.core.errors import CounterflexError, FileFormatError, InputError
from counterflex.files.schema import Table, Versioned, check_header, parse, read_toml

KIND: Final = "counterflex-panel-users"
VERSION: Final = 1
Role = Literal["viewer", "operator"]
LEAST: Final = 10
"""Characters of a password."""
_MOST: Final = 256
_N, _R, _P = 1 << 14, 8, 1  # Cost of scrypt (RFC 7914): 16 MB and some 50 ms a try
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
    """The users of a file; who is added to it or removed from it later counts at once.

    Raises:
        FileFormatError: It is none, or a name stands there twice.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stamp = _stamp(path)
        self.users = _read(path)

    def roles(self) -> dict[str, Role]:
        """Roles by name, of the file as it is now; empty where it is gone or cannot be read."""
        stamp = _stamp(self.path)
        if stamp != self._stamp:
            try:
                self.users = _read(self.path)
            except CounterflexError:
                self.users = {}
            self._stamp = stamp
        return {user.name: user.role for user in self.users.values()}

    def role(self, name: str, password: str) -> Role | None:
        """The role of a user whose password is right, else None; as long for a name that there is not."""
        self.roles()
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
        FileFormatError: The file is none.
        OutputError: It cannot be written, or another process edits it.
    """
    if not LEAST <= len(password) <= _MOST:
        raise InputError("the password has a wrong length", value=len(password), limit=f"{LEAST} to {_MOST} characters")
    salt = secrets.token_bytes(16)
    one = {"name": name, "role": role, "salt": salt.hex(), "scrypt": _hash(password, salt)}
    user = parse(UserTable, one, where="user")
    with held.alone(path):
        _write(path, {**(_read(path) if path.exists() else {}), name: user})


def remove_user(path: Path, name: str) -> None:
    """Remove a user from a file.

    Raises:
        InputError: There is no such user.
        FileFormatError: The file is none.
        OutputError: It cannot be written, or another process edits it.
    """
    with held.alone(path):
        users = _read(path)
        if name not in users:
            raise InputError(
                "there is no such user", where=str(path), value=name, limit=", ".join(users) or "no user at all"
            )
        del users[name]
        _write(path, users)


def _read(path: Path) -> dict[str, UserTable]:
    content = read_toml(path, KIND)
    check_header(content, kind=KIND, version=VERSION, where=str(path))
    users = parse(UserTables, content, where=str(path)).users
    named = {user.name: user for user in users}
    if len(named) < len(users):
        twice = next(user.name for k, user in enumerate(users) if user.name in [other.name for other in users[:k]])
        raise FileFormatError("a name stands there twice", where=str(path), value=twice, hint="Remove one of them")
    return named


def _write(path: Path, users: Mapping[str, UserTable]) -> None:
    content = {"format": KIND, "version": VERSION, "users": [user.model_dump() for user in users.values()]}
    with atomic.atomic_path(path) as part:
        part.write_text(tomli_w.dumps(content), encoding="utf-8")
        if os.name == "posix":
            part.chmod(0o600)
    if os.name == "posix":
        path.chmod(0o600)


def _stamp(path: Path) -> tuple[int, ...]:
    """Return what changes when a file is written or replaced; empty where there is none."""
    try:
        about = path.stat()
    except OSError:
        return ()
    return about.st_ino, about.st_mtime_ns, about.st_ctime_ns, about.st_size


def _hash(password: str, salt: bytes) -> str:
    return hashlib.scrypt(password.encode(), salt=salt, n=_N, r=_R, p=_P, dklen=32).hex()
