"""Tries to log in: counted before a password is hashed, by name and address, few at once, summed up in the run log."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

import httpx
import pytest
from hypothesis import given, strategies as st
from starlette.applications import Starlette

from counterflex.app.panel.access import Sessions
from counterflex.app.panel.tries import (
    AT_ONCE,
    BLOCK_S,
    NOTE_S,
    PER_S,
    REMEMBERED,
    TRIES,
    RefusedLogins,
    Tries,
)

LOGIN = pytest.importorskip("counterflex.app.panel.server")


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


class SlowUsers:
    """Users whose hashes take until they are let go; counts how many are computed, and at the same time."""

    def __init__(self) -> None:
        self.go, self.lock = threading.Event(), threading.Lock()
        self.hashed = self.at_once = self.most_at_once = 0

    def role(self, name: str, password: str) -> str | None:
        with self.lock:
            self.hashed += 1
            self.at_once += 1
            self.most_at_once = max(self.at_once, self.most_at_once)
        assert self.go.wait(60.0)
        with self.lock:
            self.at_once -= 1
        return "operator" if (name, password) == ("anna", "correct horse") else None


def login(users: Any, clock: Clock, notes: list[Any]) -> tuple[Starlette, RefusedLogins]:
    refused = RefusedLogins(notes.append, clock)
    routes = LOGIN.LoginRoutes(
        users, Sessions(clock), secure=False, note=lambda *said: notes.append(said), refused=refused, tries=Tries(clock)
    ).routes()
    return Starlette(routes=routes), refused


async def enter(app: Starlette, name: str, password: str, source: str) -> int:
    transport = httpx.ASGITransport(app, client=(source, 4711))
    async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
        return (await client.post("/login", data={"name": name, "password": password})).status_code


def test_a_thousand_parallel_logins_hash_a_few_passwords_one_after_the_other() -> None:
    """And they do not lock out who has the right password at another address, or under another name at the same one."""
    users, clock = SlowUsers(), Clock()
    notes: list[Any] = []
    app, refused = login(users, clock, notes)

    async def attack() -> list[int]:
        tasks = [asyncio.create_task(enter(app, "anna", f"guess {k}", "10.0.0.66")) for k in range(1000)]
        for _ in range(20_000):  # passes of the event loop; a handful is enough
            if len([task for task in tasks if task.done()]) >= 1000 - AT_ONCE // 2:
                break
            await asyncio.sleep(0)
        users.go.set()  # until here not one hash has ended, and all others are answered already
        return await asyncio.gather(*tasks)

    answers = asyncio.run(attack())
    assert users.hashed == AT_ONCE // 2
    assert users.most_at_once == 1
    assert sorted(set(answers)) == [401, 429]
    assert answers.count(401) == users.hashed
    assert refused.total == 1000
    assert len(notes) == 1  # in the run log
    clock.now += 1.0
    assert asyncio.run(enter(app, "anna", "correct horse", "10.0.0.7")) == 303
    assert asyncio.run(enter(app, "ben", "wrong", "10.0.0.66")) == 401


def test_refused_logins_are_summed_up() -> None:
    clock = Clock()
    notes: list[Any] = []
    refused = RefusedLogins(notes.append, clock)
    for k in range(500):
        clock.now += 0.1
        refused.add("x" * 100, f"10.0.0.{k % 7}")
        refused.flush()
    clock.now += NOTE_S
    refused.flush()
    assert len(notes) <= 1 + (50.0 + NOTE_S) / NOTE_S
    assert all(len(one["who"]) <= 24 and not one["done"] for one in notes)
    assert notes[0]["refused"] == "wrong, or too many"
    assert sum(int(one["refused"].split()[0]) for one in notes[1:]) == 499


def test_wrong_passwords_lock_their_own_name_at_their_own_address_only() -> None:
    clock = Clock()
    tries = Tries(clock)
    for _ in range(TRIES):
        clock.now += 1.0
        assert tries.begin("10.0.0.66", "anna") == ""
        tries.end("10.0.0.66", "anna", right=False)
    clock.now += 1.0
    assert "wait" in tries.begin("10.0.0.66", "anna")
    for source, name in (("10.0.0.7", "anna"), ("10.0.0.66", "ben")):
        assert tries.begin(source, name) == ""
        tries.end(source, name, right=True)
    clock.now += BLOCK_S
    assert tries.begin("10.0.0.66", "anna") == ""


def test_right_passwords_are_never_too_many() -> None:
    clock = Clock()
    tries = Tries(clock)
    for _ in range(10 * TRIES):
        clock.now += 1.0
        assert tries.begin("10.0.0.7", "anna") == ""
        tries.end("10.0.0.7", "anna", right=True)


def test_addresses_of_one_ipv6_network_count_as_one() -> None:
    clock = Clock()
    tries = Tries(clock)
    for k in range(TRIES):
        clock.now += 1.0
        assert tries.begin(f"2001:db8:0:1::{k:x}", "anna") == ""
        tries.end(f"2001:db8:0:1::{k:x}", "anna", right=False)
    clock.now += 1.0
    assert tries.begin("2001:db8:0:1:ffff::9", "anna") != ""
    assert tries.begin("2001:db8:0:2::1", "anna") == ""


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 40), st.floats(0.0, 0.5), st.booleans()), max_size=400))
def test_whatever_is_tried_the_work_is_bounded(steps: list[tuple[int, int, float, bool]]) -> None:
    """At most AT_ONCE at a time, half of them of one address; at most PER_S begun in any second; a bounded table."""
    clock = Clock()
    tries = Tries(clock)
    running: list[tuple[str, str]] = []
    begun: list[float] = []
    for source, name, wait, ends in steps:
        clock.now += wait
        if ends and running:
            tries.end(*running.pop(0), right=False)
        one = (f"10.0.0.{source}", f"user {name}")
        if not tries.begin(*one):
            running.append(one)
            begun.append(clock.now)
        assert len(running) <= AT_ONCE
        assert max((sum(a[0] == b[0] for a in running) for b in running), default=0) <= AT_ONCE // 2
        assert sum(time > clock.now - 1.0 for time in begun) <= PER_S
    assert len(tries._counted) <= REMEMBERED


def test_the_table_is_bounded_and_keeps_who_is_locked_as_long_as_he_is() -> None:
    """Whoever wants to push an entry out has to have as many passwords hashed as the table has places."""
    clock = Clock()
    tries = Tries(clock)
    for _ in range(TRIES):
        clock.now += 1.0
        tries.begin("10.0.0.66", "anna")
        tries.end("10.0.0.66", "anna", right=False)
    locked = clock.now
    for k in range(10 * REMEMBERED):
        clock.now += 1.0 / PER_S
        if not tries.begin(f"10.1.{k % 256}.{k // 256}", "x"):
            tries.end(f"10.1.{k % 256}.{k // 256}", "x", right=False)
        if clock.now < locked + BLOCK_S - TRIES:
            assert tries.begin("10.0.0.66", "anna") != ""
    assert len(tries._counted) <= REMEMBERED
