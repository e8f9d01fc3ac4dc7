"""RAMP OUT has a path of its own: it is written where it arrives, while every thread that waits or hashes is taken."""

from __future__ import annotations

import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from counterflex.core.errors import OutputError

PAGE = pytest.importorskip("counterflex.app.panel.page", reason="the extra panel is not installed")
from counterflex.app.panel.access import PanelSession  # noqa: E402


class Run:
    """A watched run that notes in which order and thread it is asked."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, int]] = []
        self.answer: Any = {"done": True, "refused": "", "state": "ramp_out"}

    def stop_now(self) -> None:
        self.asked.append(("stop now", threading.get_ident()))

    def request(self, action: str, _who: str, _source: str) -> Any:
        self.asked.append((action, threading.get_ident()))
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


class Bare(PAGE.PanelPage):  # type: ignore[misc, name-defined]
    """A page without a browser."""

    def __init__(self, run: Run, role: Any, *, valid: bool = True) -> None:
        self._run, self.session = run, PanelSession("anna", role, "10.0.0.7", 1e9)
        self._valid = lambda: valid
        self.told: list[str] = []
        self._report_action = self.told.append

    def _tell(self, text: str, _kind: Any) -> None:
        self.told.append(text)


def test_the_stop_is_written_at_once_while_no_thread_is_free(monkeypatch: pytest.MonkeyPatch) -> None:
    """Threads of the event loop hash or hang, and all that wait for answers do: the stop asks for none."""
    go, run = threading.Event(), Run()
    askers = ThreadPoolExecutor(1)
    monkeypatch.setattr(PAGE, "ASKERS", askers)

    async def press() -> None:
        loop = asyncio.get_running_loop()
        loop.set_default_executor(ThreadPoolExecutor(1))
        blocked = [loop.run_in_executor(pool, go.wait) for pool in (None, askers)]
        page = Bare(run, "operator")
        pressed = asyncio.create_task(page._press("stop"))
        await asyncio.sleep(0)  # one pass of the event loop
        asked = list(run.asked)
        go.set()
        assert asked == [("stop now", threading.get_ident())]
        await asyncio.gather(pressed, *blocked)
        assert [action for action, _ in run.asked] == ["stop now", "stop"]
        assert page.told == ["RAMP OUT: done (ramp out)", "anna RAMP OUT: done (ramp out)"]

    asyncio.run(press())
    askers.shutdown()


def test_a_stop_whose_loop_does_not_answer_stays_asked_for_and_is_told() -> None:
    run = Run()
    run.answer = OutputError("the loop does not answer")
    page = Bare(run, "operator")
    asyncio.run(page._press("stop"))
    assert run.asked[0][0] == "stop now"
    assert any("does not answer" in text for text in page.told)


@pytest.mark.parametrize(("role", "valid"), [("viewer", True), ("operator", False)])
def test_who_may_not_stop_writes_nothing(role: str, valid: bool) -> None:
    run = Run()
    asyncio.run(Bare(run, role, valid=valid)._press("stop"))
    assert run.asked == []
