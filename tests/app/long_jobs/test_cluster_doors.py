"""Doors of a local cluster: everything listens on the loopback, and its web servers, without keys, show nothing."""

from __future__ import annotations

import json
import urllib.error
import urllib.request
from typing import Any
from urllib.parse import urlsplit

import pytest

from counterflex.app.long_jobs.scheduler import local_cluster

PAGES = (
    "", "status", "workers", "info/main/workers.html", "info/main/logs.html", "json/counts.json", "json/identity.json",
    "api/v1/get_workers", "metrics", "health", "statics/css/base.css", "proxy/1/127.0.0.1/",
)  # fmt: skip


def status_of(address: str) -> int:
    """Return the status that a web server answers with."""
    try:
        with urllib.request.urlopen(address, timeout=60) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as fault:
        return fault.code


@pytest.fixture(scope="module")
def client() -> Any:
    """A cluster of one worker."""
    with local_cluster(1) as started:
        yield started


def test_no_page_is_served(client: Any) -> None:
    ports = {client.cluster.scheduler.http_server.port}
    ports |= {worker["services"]["dashboard"] for worker in client.scheduler_info()["workers"].values()}
    assert len(ports) == 2
    found = {(port, page): status_of(f"http://127.0.0.1:{port}/{page}") for port in ports for page in PAGES}
    assert {place: status for place, status in found.items() if status != 404} == {}
    for port in ports:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/sitemap.json", timeout=60) as answer:
            assert json.load(answer) == {"paths": ["/sitemap.json"]}


def test_everything_listens_on_the_loopback_with_keys(client: Any) -> None:
    workers = client.scheduler_info()["workers"]
    for address in (client.scheduler.address, *workers, *(worker["nanny"] for worker in workers.values())):
        assert (urlsplit(address).scheme, urlsplit(address).hostname) == ("tls", "127.0.0.1")
    assert client.cluster.scheduler.http_server.address == "127.0.0.1"
    assert client.submit(len, "four").result() == 4
