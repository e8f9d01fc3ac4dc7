"""The table of states on the page is what the compiled supervisor does; its conditions say it whole."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from counterflex.runtime.state.states import State
from supervisor_space import Space, explore


def load() -> ModuleType:
    path = Path(__file__).resolve().parents[2] / "tools" / "supervisor_table.py"
    spec = importlib.util.spec_from_file_location("supervisor_table_tool", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


TABLE = load()


@pytest.fixture(scope="module")
def space() -> Space:
    return explore()


@pytest.mark.long
def test_the_page_shows_what_the_supervisor_does(space: Space) -> None:
    assert TABLE.PAGE.read_text(encoding="utf-8") == TABLE.page(space)


@pytest.mark.parametrize("state", list(State))
def test_the_conditions_of_a_next_state_hold_there_and_nowhere_else(space: Space, state: State) -> None:
    names, table = TABLE.truth(space, state)
    assert len(table) > 2
    for target in set(table.values()):
        ways = TABLE.products(table, target)
        for row, following in table.items():
            fits = any(all(row[k] == value for k, value in way.items()) for way in ways)
            assert fits == (following == target), dict(zip(names, row, strict=True))


def test_words_that_do_not_decide_alone_are_found_out(space: Space, monkeypatch: pytest.MonkeyPatch) -> None:
    """A hold that no word tells from one that ends would be left out of the table."""
    monkeypatch.setitem(TABLE.ASKED, State.HOLD, ("hard", "soft", "ends", "may_ramp", "lasts", "stands"))
    with pytest.raises(AssertionError, match="HOLD is not decided"):
        TABLE.truth(space, State.HOLD)


def test_requests_are_tried_in_every_state() -> None:
    rows = [line.strip("| ").split(" | ") for line in TABLE.request_table.requests().splitlines()[2:]]
    assert [row[0] for row in rows] == [state.name.lower().replace("_", " ") for state in State]
    by_state = {row[0]: dict(zip(("stop", "reset", "arm"), row[1:], strict=True)) for row in rows}
    assert by_state["ready"]["arm"] == "armed"
    assert sum("refused" not in row["arm"] for row in by_state.values()) == 3
    assert all("active" not in row["stop"] and "refused" not in row["stop"] for row in by_state.values())
    assert "refused" in by_state["fault"]["reset"]


@pytest.mark.long
def test_a_part_without_a_place_on_the_page_is_named(
    space: Space, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "online.md"
    page.write_text(TABLE.PAGE.read_text(encoding="utf-8").replace("<!-- end of requests -->", ""), encoding="utf-8")
    monkeypatch.setattr(TABLE, "PAGE", page)
    with pytest.raises(AssertionError, match="requests"):
        TABLE.page(space)
