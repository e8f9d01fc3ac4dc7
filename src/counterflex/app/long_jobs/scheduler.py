"""Schedulers of dask: that of a cluster, by its address, or one of this process for the cores of this machine."""

from __future__ import annotations

import contextlib
import ipaddress
import logging
import socket
from collections.abc import Iterator
from contextlib import AbstractContextManager
from typing import Any, Final
from urllib.parse import urlsplit

from counterflex.app.long_jobs import quiet_worker
from counterflex.app.long_jobs.workers import ONE_THREAD, interrupts_deferred
from counterflex.core.errors import InputError

CONNECT_S: Final = 5.0
"""How long it may take to reach the machine of a scheduler."""
ANSWER_S: Final = 20.0
"""How long a scheduler that is reached may take to answer, on a machine with much other work."""
_NO_PAGES: Final[dict[str, list[str]]] = {"distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []}
_QUIET: Final = {"DASK_LOGGING__DISTRIBUTED": "critical"}


def require_scheduler_address(address: str) -> str:
    """The address of a scheduler as dask writes it. Raises InputError: it is no such address."""
    text = address if "://" in address else f"tcp://{address}"
    parts = urlsplit(text)
    try:
        complete = bool(parts.hostname and parts.port) and parts.scheme in ("tcp", "tls")
    except ValueError:
        complete = False
    if not complete or parts.path or parts.query:
        raise InputError(
            "that is no address of a scheduler",
            where="--scheduler",
            value=address,
            limit="tls://HOST:PORT or tcp://HOST:PORT",
        )
    return text


def open_to_others(address: str) -> str:
    """What to tell who uses a scheduler over a network without keys; empty where there is nothing to tell.

    Args:
        address: As :func:`require_scheduler_address` returns it.
    """
    parts = urlsplit(address)
    try:
        local = parts.hostname == "localhost" or ipaddress.ip_address(parts.hostname or "").is_loopback
    except ValueError:
        local = False
    if parts.scheme == "tls" or local:
        return ""
    return (
        f"{address} has no keys: whoever reaches that scheduler can run programs on its workers and on this machine, "
        "and read what they are sent. Use it in a network of your own only, or tls:// (docs/campaign.md)"
    )


def require_scheduler(address: str) -> str:
    """The address of a scheduler that somebody listens at. Raises InputError: it is no address, or nobody does."""
    address = require_scheduler_address(address)
    parts = urlsplit(address)
    try:  # dask would try a refused connection again and again
        with socket.create_connection((str(parts.hostname), int(parts.port or 0)), CONNECT_S):
            return address
    except OSError as fault:
        raise _nobody(address, fault) from fault


def connected(address: str) -> AbstractContextManager[Any]:
    """A client of a scheduler. Raises InputError: it is no address, or no scheduler answers there."""
    from distributed import Client

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client: AbstractContextManager[Any] = Client(
            require_scheduler(address), timeout=ANSWER_S, set_as_default=False, name="counterflex"
        )
    except (OSError, TypeError, RuntimeError) as fault:
        raise _nobody(address, fault) from fault
    return client


def _nobody(address: str, fault: Exception) -> InputError:
    return InputError(
        "no scheduler answers there",
        where=f"--scheduler {address}",
        value=str(fault)[:120],
        hint=_HINT_TLS if address.startswith("tls") else _HINT,
    )


_HINT: Final = (
    "Start one with `dask scheduler --host HOST` and workers with `dask worker ADDRESS --nthreads 1 --nworkers auto`; "
    "without --scheduler this machine alone does the work"
)
_HINT_TLS: Final = f"Are its keys in dask's configuration (distributed.comm.tls)? {_HINT}"


@contextlib.contextmanager
def local_cluster(count: int) -> Iterator[Any]:
    """A client of a scheduler of this process, with worker processes of this machine, one thread each.

    They end with this process, however it ends. Who has not its keys, made for this once, is not let in: not even other
    users of this machine. dask's web pages have no keys, so that none is served, neither of tasks nor of measures.
    """
    import dask
    from distributed import Client, LocalCluster
    from distributed.security import Security

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with contextlib.ExitStack() as stack:
        with interrupts_deferred(), dask.config.set(_NO_PAGES):  # worker processes are given this configuration
            processes = stack.enter_context(
                LocalCluster(
                    n_workers=count,
                    threads_per_worker=1,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    scheduler_kwargs={"dashboard": False},
                    silence_logs=logging.CRITICAL,
                    security=Security.temporary(),  # other users of this machine cannot reach it
                    env={**dict.fromkeys(ONE_THREAD, "1"), **_QUIET},
                    preload=[quiet_worker.__name__],
                )
            )
            client = stack.enter_context(Client(processes, set_as_default=False, name="counterflex"))
        yield client
