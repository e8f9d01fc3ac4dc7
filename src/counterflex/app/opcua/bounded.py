"""Bounds of the OPC UA server: connections, sessions, message sizes and tries of who has not logged in."""

from __future__ import annotations

import asyncio
import contextvars
from typing import Any, Final

from asyncua import Server, ua
from asyncua.common.connection import TransportLimits
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.binary_server_asyncio import BinaryServer, OPCUAProtocol
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.user_managers import UserManager

from counterflex.app.panel.door import AT_A_TIME, KNOWN, STRANGERS, Door
from counterflex.app.panel.tries import Tries
from counterflex.files.panel_users import PanelUsers

CHUNK: Final = 65535
"""Bytes of a chunk; a longer one ends its connection when its head is read."""
MESSAGE: Final = 1 << 20
"""Bytes of a message of several chunks."""
PENDING: Final = 64
"""Messages of a connection that wait to be served."""
UNUSED: Final = 32
"""Sessions that were made and that nobody has logged in on; a further one ends the oldest."""
_HEAD: Final = 8
_caller: contextvars.ContextVar[str] = contextvars.ContextVar("caller", default="")
"""Name of the user whose call is served; empty: there is none."""
_source: contextvars.ContextVar[str] = contextvars.ContextVar("source", default="")
"""Address that a password comes from."""


def caller() -> str:
    """Return the name of the operator whose call is served; empty where it is none."""
    return _caller.get()


class Users(UserManager):  # type: ignore[misc]
    """Who may: with a file of users only they, by their password; without one everybody, to read.

    Args:
        users: Of the file, or None.
    """

    def __init__(self, users: PanelUsers | None, tries: Tries) -> None:
        self._users, self._tries = users, tries

    def get_user(self, iserver: Any, username: Any = None, password: Any = None, certificate: Any = None) -> Any:  # noqa: ARG002 - as the library calls it
        """The user, or None."""
        if self._users is None:
            return User(UserRole.User)  # of the library's roles the one that may read
        name, source = str(username or ""), _source.get()
        if not name:
            return None
        if self._tries.begin(source, name):
            return None
        role = None
        try:
            text = password.decode("utf-8", "replace") if isinstance(password, bytes) else str(password or "")
            role = self._users.role(name, text)
        finally:
            self._tries.end(source, name, right=role is not None)
        return None if role is None else User(UserRole.User, name)

    def operates(self, name: str) -> bool:
        """Tell whether a user is an operator now."""
        return self._users is not None and self._users.roles().get(name) == "operator"

    def there(self, name: str) -> bool:
        """Tell whether a user is in the file now; where there is no file, everybody is."""
        return self._users is None or name in self._users.roles()


class Session(InternalSession):  # type: ignore[misc]
    """A session of a client: it reads; its calls are served for operators only, nothing is written."""

    def activate_session(self, params: Any, peer_certificate: Any) -> Any:
        """Log in, from the address of the connection; a connection that has logged in is no stranger's."""
        peer = self.name
        token = _source.set(str(peer[0]) if isinstance(peer, tuple) else str(peer))
        try:
            result = super().activate_session(params, peer_certificate)
        finally:
            _source.reset(token)
        self.iserver.door.know(peer)
        return result

    async def call(self, params: Any) -> Any:
        """Serve calls with the name of the caller."""
        name = str(self.user.name or "")
        token = _caller.set(name if self.iserver.user_manager.operates(name) else "")
        try:
            return await super().call(params)
        finally:
            _caller.reset(token)

    async def write(self, params: Any) -> Any:
        """Refuse to write from outside."""
        if self.external:
            return [ua.StatusCode(ua.StatusCodes.BadUserAccessDenied) for _ in params.NodesToWrite]
        return await super().write(params)


class Inner(InternalServer):  # type: ignore[misc]
    """Makes sessions of :class:`Session`, few of which nobody has logged in on."""

    def __init__(self, users: Users, door: Door) -> None:
        super().__init__(user_manager=users)
        self.door = door
        self.max_connections = STRANGERS + KNOWN + AT_A_TIME
        self.max_pending_messages_per_connection = PENDING

    def create_session(self, name: Any, user: Any = None, external: bool = False) -> Any:
        """A session."""
        who = User(UserRole.Anonymous) if user is None else user
        if external:
            unused = [one for one in self._external_sessions.values() if not one.is_activated()]
            for one in unused[: max(0, len(unused) + 1 - UNUSED)]:
                self.unregister_external_session(one)
            if len(self._external_sessions) >= UNUSED + KNOWN:
                raise ServiceError(ua.StatusCodes.BadTooManySessions)
        return Session(self, self.aspace, self.subscription_service, name, user=who, external=external)

    async def end_removed(self) -> None:
        """End the sessions of users who are no more in the file."""
        for one in list(self._external_sessions.values()):
            if one.is_activated() and not self.user_manager.there(str(one.user.name or "")):
                await one.close_session()


class _Protocol(OPCUAProtocol):  # type: ignore[misc]
    """A connection that is ended by the head of a chunk that is too long; the library waits for all of it first."""

    _buffer: bytes

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        head = self._buffer[:_HEAD]
        if len(head) == _HEAD and int.from_bytes(head[4:], "little") > CHUNK and self.transport is not None:
            self._buffer = b""
            self.transport.abort()


class _Binary(BinaryServer):  # type: ignore[misc]
    """Listens by sockets that count."""

    hostname: str
    port: int

    def _make_protocol(self) -> Any:
        return _Protocol(
            iserver=self.iserver, policies=self._policies, clients=self.clients, closing_tasks=self.closing_tasks,
            limits=self.limits,
        )  # fmt: skip

    async def start(self) -> None:
        listening, *_ = self.iserver.door.listen(self.hostname, self.port)
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(self._make_protocol, sock=listening, backlog=AT_A_TIME)
        self.iserver.door.widen()
        self.hostname, self.port = listening.getsockname()[:2]
        self.cleanup_task = asyncio.create_task(self._close_task_loop())


class BoundedServer(Server):  # type: ignore[misc]
    """A server whose strangers take little."""

    def __init__(self, inner: Inner) -> None:
        super().__init__(iserver=inner)
        self.limits = TransportLimits(
            max_recv_buffer=CHUNK, max_send_buffer=CHUNK, max_chunk_count=MESSAGE // CHUNK + 1, max_message_size=MESSAGE
        )

    async def start(self) -> None:
        """Listen, as the library does, by a :class:`_Binary`."""
        await self._setup_server_nodes()
        await self.iserver.start()
        host, port = self._get_bind_socket_info()
        self.bserver = _Binary(self.iserver, host, port, self.limits)
        self.bserver.set_policies(self._policies)
        try:
            await self.bserver.start()
        except OSError:
            await self.iserver.stop()
            raise
