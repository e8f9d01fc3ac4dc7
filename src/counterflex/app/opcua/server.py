"""The OPC UA server: a process beside the loop that reads the run's snapshot and writes it into an address space."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from asyncua import ua
from asyncua.common.node import Node as UaNode

from counterflex import __version__
from counterflex.app.opcua.bounded import BoundedServer, Inner, Users, caller
from counterflex.app.opcua.nodes import NODES, OWN, UNITS, Node, View, occurred
from counterflex.app.opcua.settings import OpcuaSettings
from counterflex.app.panel.door import Door
from counterflex.app.panel.figures import Figures
from counterflex.app.panel.tries import Tries
from counterflex.app.panel.watched_run import LOOK_S, SILENT_S, Seen
from counterflex.app.run.operator_requests import ask
from counterflex.core.errors import CounterflexError, OutputError
from counterflex.core.printable import printable
from counterflex.core.units import NS
from counterflex.files.machine_file import machine_file
from counterflex.files.panel_users import PanelUsers
from counterflex.protocols.processes.actions import COMMAND_LANE, Actions, actions_path
from counterflex.protocols.processes.control_array import Life
from counterflex.protocols.processes.operator_words import find
from counterflex.protocols.processes.shared_words import SharedWords
from counterflex.protocols.processes.snapshot import SnapshotReader, snapshot_path


class ObservedRun:
    """The run whose log lies in a folder; when it has ended, the next one there. The run does not notice.

    Args:
        folder: As ``run`` is given it with ``--out``.
    """

    def __init__(self, folder: Path, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self.folder, self._clock_ns = folder, clock_ns
        self.seen = Seen.WAITING  # Whether there is a run, and whether its loop lives
        self.about: dict[str, Any] = {}  # What the run says of itself; empty before the first
        # What was last seen, :meth:`counterflex.app.panel.figures.Figures.of`; empty before the first snapshot
        self.figures: dict[str, Any] = {}
        self.last: Any = None  # Last snapshot, or None
        self.why = ""  # Why a run that goes on cannot be read, or empty
        self._words: SharedWords | None = None
        self._reader: SnapshotReader | None = None
        self._made: Figures | None = None
        self._left: Path | None = None
        self._looked = self._last_ns = 0

    def poll(self) -> None:
        """Look: attach to a run that goes on, take what is new."""
        now = self._clock_ns()
        words, reader, made = self._words, self._reader, self._made
        if words is None or reader is None or made is None:
            if now - self._looked >= round(LOOK_S / NS):
                self._looked = now
                self._attach()
            return
        shots = reader.take()
        if len(shots):
            self._last_ns, self.seen, self.last = now, Seen.RUNNING, shots[-1]
            self.figures = made.of(shots, now, reader.missed)
        if reader.ended or words.words[Life.ENDED]:
            self.seen = Seen.ENDED
            self.close()
        elif not len(shots) and (now - max(int(words.words[Life.LOOP_NS]), self._last_ns)) * NS > SILENT_S:
            self.seen = Seen.SILENT
            if not words.path.exists():  # killed, and cleared away
                self.close()

    def _attach(self) -> None:
        words: SharedWords | None = None
        try:
            words = find(self.folder, machine_file().parent)
            if words.path == self._left or words.words[Life.ENDED]:
                words.close()
                return
            self._reader = SnapshotReader(snapshot_path(words.path))
        except CounterflexError as fault:
            if words is not None:
                self.why = str(fault)
                words.close()
            return
        self._words, self.about, self.why = words, self._reader.about, ""
        self._made, self.figures, self.last = Figures(self.about), {}, None
        self.seen, self._last_ns = Seen.RUNNING, self._clock_ns()

    def acknowledge(self, who: str) -> dict[str, Any]:
        """Ask the loop to acknowledge, and note who did in the run log; waits up to 0.3 s.

        Returns:
            ``done``, or why not (``refused``); ``state`` and more of
            :func:`counterflex.app.run.operator_requests.ask`.

        Raises:
            CounterflexError: No run goes on, or its loop does not answer.
        """
        if self._words is None:
            raise OutputError("no run goes on", where=str(self.folder))
        answer = ask(self._words.words, "reset", where=str(self.folder))
        facts = {"who": who, "from": "opcua", "action": "reset", "done": bool(answer["done"]), "state": answer["state"]}
        with contextlib.suppress(CounterflexError):
            actions = Actions(actions_path(self._words.path))
            actions.note(COMMAND_LANE, facts | ({"refused": answer["refused"]} if answer["refused"] else {}))
            actions.close()
        return answer

    def close(self) -> None:
        """Leave the run."""
        if self._words is not None:
            self._left = self._words.path
            self._words.close()
        if self._reader is not None:
            self._reader.close()
        self._words = self._reader = self._made = None


NAMESPACE: Final = "urn:counterflex:opcua"
_NICE: Final = 5  # Priority below that of everything that runs beside it, the loop above all
_TYPES: Final = {
    str: ua.VariantType.String,
    bool: ua.VariantType.Boolean,
    int: ua.VariantType.Int64,
    float: ua.VariantType.Double,
}


class OpcuaServer:
    """A server.

    Raises:
        FileFormatError: The file of users is none.
    """

    def __init__(self, settings: OpcuaSettings, started: Callable[[str], None]) -> None:
        self._settings, self._started = settings, started
        self._run = ObservedRun(settings.folder)
        self._nodes: list[tuple[Node, UaNode]] = []
        self._written: dict[str, tuple[Any, int]] = {}
        self._before: Mapping[str, Any] = {}
        self._last_fault = ""
        users = None if settings.users is None else PanelUsers(settings.users)
        self._door = Door()
        self._inner = Inner(Users(users, Tries()), self._door)
        self._server = BoundedServer(self._inner)

    async def serve(self) -> None:
        """Serve until the task is cancelled."""
        settings, server = self._settings, self._server
        with contextlib.suppress(OSError, AttributeError):
            os.nice(_NICE)
        await server.init()
        host = f"[{settings.host}]" if ":" in settings.host else settings.host
        server.set_endpoint(f"opc.tcp://{host}:{settings.port}/counterflex")
        server.set_server_name("counterflex")
        await server.set_application_uri(NAMESPACE)
        await server.set_build_info(NAMESPACE, "counterflex", "counterflex", __version__, "", datetime.now(UTC))
        await self._secure()
        await self._build()
        try:
            await server.start()
        except OSError as fault:
            raise OutputError(
                f"the port cannot be opened: {fault.strerror or fault}",
                where=f"{settings.host}:{settings.port}",
                hint="Is another OPC UA server running? Give another --port",
            ) from None
        try:
            port = settings.port if server.bserver is None else server.bserver.port
            self._started(f"opc.tcp://{host}:{port}/counterflex")
            await self._follow()
        finally:
            self._run.close()
            await server.stop()

    async def _secure(self) -> None:
        settings, server = self._settings, self._server
        tokens = [ua.AnonymousIdentityToken] if settings.users is None else [ua.UserNameIdentityToken]
        server.set_identity_tokens(tokens)
        if settings.certificate is None or settings.key is None:
            server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
            return
        server.set_security_policy([ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt])
        try:
            await server.load_certificate(str(settings.certificate))
            await server.load_private_key(str(settings.key))
        except (OSError, ValueError, TypeError) as fault:
            raise OutputError(
                f"certificate or key cannot be read: {fault}",
                where=f"{settings.certificate}, {settings.key}",
                hint="Both as .pem or .der, the key without a password",
            ) from None

    async def _build(self) -> None:
        """The address space."""
        server = self._server
        space = await server.register_namespace(NAMESPACE)
        folders: dict[str, UaNode] = {"": server.nodes.objects}
        for node in NODES:
            above, _, name = node.path.rpartition("/")
            parent = await _folder(above, folders, space)
            kind = _TYPES[type(node.default)]
            variable = await parent.add_variable(
                ua.NodeId(node.path, space), ua.QualifiedName(name, space), node.default, kind
            )
            if node.unit:
                await variable.add_property(
                    ua.NodeId(f"{node.path}/EngineeringUnits", space),
                    ua.QualifiedName("EngineeringUnits", 0),
                    _unit(node.unit),
                )
            self._nodes.append((node, variable))
        outputs = []
        for name, data_type in (("Done", ua.ObjectIds.Boolean), ("Message", ua.ObjectIds.String)):
            argument = ua.Argument()
            argument.Name, argument.DataType, argument.ValueRank = name, ua.NodeId(data_type), -1
            outputs.append(argument)
        own = await _folder(OWN, folders, space)
        await own.add_method(
            ua.NodeId(f"{OWN}/Acknowledge", space),
            ua.QualifiedName("Acknowledge", space),
            self._acknowledge,
            [],
            outputs,
        )
        self._events = await server.get_event_generator()

    async def _acknowledge(self, _parent: Any) -> Any:
        who = caller()
        if not who:
            return ua.StatusCode(ua.StatusCodes.BadUserAccessDenied)
        try:
            answer = await asyncio.to_thread(self._run.acknowledge, who)
        except CounterflexError as fault:
            done, text = False, str(fault)
        else:
            done, text = bool(answer["done"]), answer["refused"] or f"done ({answer['state']})"
        return [ua.Variant(done, ua.VariantType.Boolean), ua.Variant(printable(text), ua.VariantType.String)]

    async def _follow(self) -> None:
        """One look at the run after another; what goes wrong in one is said, and the next one comes all the same."""
        period, due = 1.0 / self._settings.rate_hz, time.monotonic()
        while True:
            try:
                await self._look()
            except Exception as fault:
                if repr(fault) != self._last_fault:  # once, not five times a second
                    self._last_fault = repr(fault)
                    logging.getLogger("counterflex.opcua").exception("a look at the run failed")
            due = max(due + period, time.monotonic())
            await asyncio.sleep(max(0.001, due - time.monotonic()))

    async def _look(self) -> None:
        self._door.end_old()
        await self._inner.end_removed()
        run = self._run
        run.poll()
        view = View(run.seen, run.about, run.figures, run.last, run.why)
        for node, variable in self._nodes:
            value, code = node.value(view)
            if self._written.get(node.path) != (value, code):
                self._written[node.path] = value, code
                data = ua.DataValue(
                    ua.Variant(value, _TYPES[type(node.default)]),
                    StatusCode=ua.StatusCode(code),
                    SourceTimestamp=datetime.now(UTC),
                )
                await variable.write_value(data)
        for message, severity in occurred(self._before, run.figures):
            self._events.event.Severity = severity
            await self._events.trigger(message=printable(message))
        self._before = run.figures


def _unit(name: str) -> Any:
    code, sign, text = UNITS[name]
    number = -1
    if code:
        number = 0
        for letter in code.encode():
            number = number << 8 | letter
    return ua.EUInformation(
        NamespaceUri="http://www.opcfoundation.org/UA/units/un/cefact",
        UnitId=number,
        DisplayName=ua.LocalizedText(sign),
        Description=ua.LocalizedText(text),
    )


def serve(settings: OpcuaSettings, started: Callable[[str], None]) -> None:
    """Serve a run over OPC UA until the process is asked to end.

    Raises:
        InputError: It would not be safe, or the library is missing.
    """
    settings.require_safe()
    logging.getLogger("asyncua").setLevel(logging.ERROR)
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(OpcuaServer(settings, started).serve())


async def _folder(path: str, folders: dict[str, UaNode], space: int) -> UaNode:
    """The object of a path, made with those above it when missing."""
    if path not in folders:
        above, _, name = path.rpartition("/")
        parent = await _folder(above, folders, space)
        folders[path] = await parent.add_object(ua.NodeId(path, space), ua.QualifiedName(name, space))
    return folders[path]
