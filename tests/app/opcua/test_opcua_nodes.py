"""Values of the OPC UA server: their kinds, units and status codes; without a server."""

from __future__ import annotations

from pathlib import Path

import pytest

from counterflex.app.opcua.nodes import ALARMS, NODES, ROBOT, UNITS, View, occurred
from counterflex.app.opcua.settings import OpcuaSettings
from counterflex.app.panel.watched_run import Seen
from counterflex.core.errors import InputError

IDLE = {"incidents": 0, "incident": None, "events": [{"event": "wear", "on": False}]}


def test_every_node_has_a_place_of_its_own_and_a_unit_that_is_known() -> None:
    paths = [node.path for node in NODES]
    assert len(set(paths)) == len(paths)
    assert {node.unit for node in NODES} - {""} <= set(UNITS)
    assert sum(path.startswith(f"{ROBOT}/Axes/Axis_") and path.endswith("/ActualPosition") for path in paths) == 6
    assert not any(word in path for path in paths for word in ("Emergency", "OperationalMode"))  # not known here


def test_values_are_of_the_kind_of_their_node_or_not_there() -> None:
    """Figures of the panel of a made-up cycle are in tests/app/panel; here nothing is known, then all is empty."""
    view = View(Seen.RUNNING, {}, {}, None, "")
    for node in NODES:
        value = node.of(view)
        assert value is None or isinstance(value, type(node.default) | int), node.path


def test_events_come_once_when_something_begins_and_when_it_is_acknowledged() -> None:
    held = {"incidents": 1, "incident": {"state": "HOLD", "cause": "force stale"}, "events": IDLE["events"]}
    worn = {**IDLE, "events": [{"event": "wear", "on": True}]}
    assert occurred({}, IDLE) == []
    assert occurred(IDLE, held) == [("HOLD: force stale", 700)]
    assert occurred(held, held) == []
    assert occurred(held, {**IDLE, "incidents": 1}) == [("incident acknowledged", 100)]
    assert occurred(IDLE, worn) == [("process: wear", 500)]
    fault = {"incidents": 2, "incident": {"state": "FAULT", "cause": "limit hard"}, "events": []}
    assert occurred({**IDLE, "incidents": 1}, fault) == [("FAULT: limit hard", 900)]
    assert any(node.path == f"{ALARMS}/Wear/Active" for node in NODES)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"host": "0.0.0.0"}, "passwords (--users FILE) and encryption"),
        ({"host": "0.0.0.0", "users": Path("u.toml")}, "without encryption"),
        ({"host": "0.0.0.0", "certificate": Path("c"), "key": Path("k")}, "without passwords"),
        ({"key": Path("k")}, "needs a certificate and its key"),
    ],
)
def test_no_network_without_passwords_and_encryption(given: dict[str, object], words: str) -> None:
    with pytest.raises(InputError) as caught:
        OpcuaSettings(Path("log"), **given).require_safe()  # type: ignore[arg-type]
    assert words in str(caught.value)


def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(InputError, match="asyncua"):
        OpcuaSettings(Path("log")).require_safe()
