"""A client beside a real loop: what it reads, what it may ask, and a server that is killed in the middle of a run."""

from __future__ import annotations

import asyncio
import contextlib
import datetime
import signal
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa

from counterflex.protocols.processes.control_array import Request
from counterflex.runtime.state.states import State
from counterflex_lab.faults.demonstration import Q
from loop_that_runs import Run
from opcua_server import PASSWORD, ServerProcess, users

asyncua = pytest.importorskip("asyncua", reason="the extra opcua is not installed")
PATIENCE = 2000
STATE = "Counterflex/State/State"


def client(address: str, name: str, password: str = PASSWORD) -> Any:
    # those of the library, 4 s and a probe that is answered within 1 s, are for a computer with nothing else to do
    one = asyncua.Client(address, timeout=60.0, watchdog_intervall=60.0)
    one.set_user(name)
    one.set_password(password)
    return one


async def node(one: Any, path: str) -> Any:
    space = await one.get_namespace_index("urn:counterflex:opcua")
    return one.get_node(asyncua.ua.NodeId(path, space))


async def value(one: Any, path: str) -> Any:
    found = await (await node(one, path)).read_data_value(raise_on_bad_status=False)
    return found.Value.Value if found.StatusCode.is_good() else found.StatusCode.name


async def until(ask: Callable[[], Awaitable[Any]], wanted: Callable[[Any], bool]) -> Any:
    seen = None
    for _ in range(PATIENCE):
        if wanted(seen := await ask()):
            return seen
        await asyncio.sleep(0.02)
    raise TimeoutError(seen)


class Heard:
    """Events of a subscription."""

    def __init__(self) -> None:
        self.events: list[tuple[str, int]] = []

    def event_notification(self, event: Any) -> None:
        self.events.append((event.Message.Text, event.Severity))


async def refused(call: Awaitable[Any]) -> str:
    try:
        await call
    except asyncua.ua.UaError as fault:
        return type(fault).__name__
    return "done"


@pytest.mark.long
def test_a_run_over_opc_ua_and_a_server_that_dies(tmp_path: Path) -> None:
    """One story, because a loop and a server are slow to start."""
    (tmp_path / "run").mkdir()
    run, given = Run(tmp_path / "run"), users(tmp_path)
    servers = [ServerProcess(run.folder, "--users", given)]
    try:
        asyncio.run(_correcting(run, servers[0]))
        before = run.answered
        while run.answered < before + 50:
            run._end.wait(0.01)
        assert run.rig.state == State.ACTIVE  # its server was killed, and nothing else happened
        servers.append(ServerProcess(run.folder, "--users", given))
        asyncio.run(_stopped(run, servers[1]))
        servers[1].process.send_signal(signal.SIGINT)
        _, errors = servers[1].process.communicate()
        assert (servers[1].process.returncode, errors) == (130, "")
        done = [(one["who"], one["from"], one["action"], one["done"]) for one in run.actions.take()]
        assert done == [("anna", "opcua", "reset", True)]
    finally:
        for one in servers:
            if one.process.poll() is None:
                one.kill()
        run.close()


async def _correcting(run: Run, server: ServerProcess) -> None:
    """Who may do what, and what is read while the loop corrects; then the server is killed."""
    assert await refused(client(server.address, "anna", "a wrong password").connect()) != "done"
    ben = client(server.address, "ben")
    await ben.connect()
    async with client(server.address, "anna") as anna:
        await until(lambda: value(anna, STATE), lambda seen: seen == "READY")
        assert await refused((await node(anna, STATE)).write_value("IDLE")) == "BadUserAccessDenied"
        own = await node(ben, "Counterflex")
        assert await refused(own.call_method(f"{own.nodeid.NamespaceIndex}:Acknowledge")) == "BadUserAccessDenied"
        done, text = await acknowledge(anna)
        assert done, text
        await until(lambda: value(anna, STATE), lambda seen: seen == "READY")  # the sensor is tared meanwhile
    run.want = True
    run.rig.control[Request.ARM] = 1
    await until(lambda: value(ben, STATE), lambda seen: seen == "ACTIVE")
    robot = "MotionDeviceSystem/MotionDevices/Robot"
    angles = [await value(ben, f"{robot}/Axes/Axis_{k + 1}/ParameterSet/ActualPosition") for k in range(6)]
    assert np.allclose(angles, np.degrees(Q), atol=1e-3)  # the telegram has four digits
    await until(lambda: value(ben, "Counterflex/Force/MeasuredSize"), lambda seen: abs(seen - 300.0) < 5.0)  # settled
    assert await value(ben, "Counterflex/Deviation/MeasuredAcross") == "BadNotConnected"  # there is no tracker
    unit = await (await node(ben, "Counterflex/Force/MeasuredSize/EngineeringUnits")).read_value()
    assert unit.UnitId == int.from_bytes(b"NEW", "big")
    server.kill()
    with contextlib.suppress(asyncua.ua.UaError, OSError, TimeoutError):
        await ben.disconnect()


async def _stopped(run: Run, server: ServerProcess) -> None:
    """An incident: as values and as an event."""
    async with client(server.address, "anna") as anna:
        heard = Heard()
        subscription = await anna.create_subscription(50, heard)
        await subscription.subscribe_events()
        await until(lambda: value(anna, STATE), lambda seen: seen == "ACTIVE")
        assert await value(anna, "Counterflex/Alarms/Incident/Active") is False
        run.rig.control[Request.STOP] = 1
        await until(lambda: value(anna, "Counterflex/Alarms/Incident/Active"), lambda seen: seen is True)
        assert await value(anna, "Counterflex/Alarms/Incident/Cause") == "operator"
        await until(_no_wait(heard), lambda seen: len(seen) > 0)
        text, severity = heard.events[0]
        assert text.endswith(": operator")
        assert severity == 700


async def acknowledge(one: Any) -> list[Any]:
    own = await node(one, "Counterflex")
    return list(await own.call_method(f"{own.nodeid.NamespaceIndex}:Acknowledge"))


def _no_wait(heard: Heard) -> Callable[[], Awaitable[Any]]:
    async def events() -> Any:
        return heard.events

    return events


def certificate(folder: Path, name: str, uri: str) -> tuple[Path, Path]:
    """A certificate of an application signed by its own key, for a day, and the key."""
    key = rsa.generate_private_key(65537, 2048)
    subject = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)])
    now = datetime.datetime.now(datetime.UTC)
    names = x509.SubjectAlternativeName([x509.UniformResourceIdentifier(uri), x509.DNSName("localhost")])
    signed = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(hours=1))
        .not_valid_after(now + datetime.timedelta(days=1))
        .add_extension(names, critical=False)
        .sign(key, hashes.SHA256())
    )
    files = folder / f"{name}.pem", folder / f"{name}-key.pem"
    files[0].write_bytes(signed.public_bytes(serialization.Encoding.PEM))
    plain = serialization.NoEncryption()
    files[1].write_bytes(key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, plain))
    return files


def test_with_a_certificate_only_encrypted_sessions_are_served(tmp_path: Path) -> None:
    public, private = certificate(tmp_path, "server", "urn:counterflex:opcua")
    own, own_key = certificate(tmp_path, "client", "urn:test:client")
    given = ("--users", users(tmp_path), "--certificate", str(public), "--key", str(private))
    server = ServerProcess(tmp_path / "log", *given)

    async def ask() -> None:
        assert await refused_or_lost(client(server.address, "ben")) != "done"
        one = client(server.address, "ben")
        one.application_uri = "urn:test:client"
        await one.set_security_string(f"Basic256Sha256,SignAndEncrypt,{own},{own_key}")
        async with one:
            assert await value(one, "Counterflex/Run/Connection") == "waiting"
            assert await value(one, "Counterflex/State/State") == "BadNoCommunication"

    try:
        asyncio.run(ask())
    finally:
        server.kill()


async def refused_or_lost(one: Any) -> str:
    try:
        await one.connect()
    except (asyncua.ua.UaError, OSError, TimeoutError) as fault:
        return type(fault).__name__
    await one.disconnect()
    return "done"
