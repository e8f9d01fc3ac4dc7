"""Tables of what an operator's requests do in each state, and of how counters are judged: tried, not written."""

from __future__ import annotations

from typing import Any

from counterflex.app.run.operator_requests import Clock, ask
from counterflex.core.records import records
from counterflex.protocols.processes.control_array import CONTROL, Life, Request, Shown
from counterflex.protocols.robot.port import Verdict
from counterflex.protocols.robot.session_counter import SessionCounter
from counterflex.runtime.state.chosen import SUPERVISION
from counterflex.runtime.state.memory import SUPERVISED, SUPERVISOR
from counterflex.runtime.state.states import Cause, State
from counterflex.runtime.state.supervisor import SupervisorSettings, supervise

_BEGIN_NS, _CYCLE_MS = 10**12, 4
_RUNS = 9
STEPS = {
    "1 to 1000 ms ahead": (4, 1000),
    "the same, or less than 1 s back": (-996, -400, -40),
    "more than 1 s ahead or back": (1004, 60_000, -1012, -60_000),
}
"""Of a counter by the newest one, ms."""


class _Loop:
    """A loop in a state: the compiled supervisor, with the requests of the shared numbers as its inputs."""

    def __init__(self, state: State, *, cut: bool) -> None:
        self.words, self.now_ns, self._cut = [0] * CONTROL, _BEGIN_NS, cut
        self._at, self._given, self._limits = records(SUPERVISOR), records(SUPERVISED), records(SUPERVISION)
        self._limits[0] = SupervisorSettings().packed()
        self._at["state"], self._at["risen"] = state, 50 * (state in (State.ACTIVE, State.HOLD))
        self._at["cause"] = Cause.FORCE_STALE if state > State.ACTIVE else Cause.NONE
        self._at["feed_hold"] = state in (State.HOLD, State.FAULT)
        self.words[Life.MAY_ARM], self.words[Life.LOOP_NS] = 1, _BEGIN_NS
        self._show()

    @property
    def clock(self) -> Clock:
        """Time as it passes for the loop."""
        return Clock(lambda: self.now_ns, self.wait)

    def _show(self) -> None:
        at, words = self._at[0], self.words
        words[Shown.STATE], words[Shown.CAUSE], words[Shown.FEED_HOLD] = int(at.state), int(at.cause), int(at.feed_hold)
        words[Shown.CORRECTION_NM] = 100_000 * (at.state > State.ARMED)

    def wait(self, seconds: float) -> None:
        """One cycle: the robot goes on, a correction is in force where the state has one."""
        at, given, words = self._at[0], self._given[0], self.words
        self.now_ns += round(max(seconds, 4e-3) * 1e9)
        given.telegram = given.healthy = 1
        given.arm, given.stop, given.reset = (words[name] for name in (Request.ARM, Request.STOP, Request.RESET))
        given.enable, given.in_cut = int(at.state > State.ARMED), int(self._cut)
        given.at_zero = int(at.state <= State.ARMED)
        given.soft = int(Cause.FORCE_STALE) if at.state == State.HOLD else 0
        supervise(at, given, self._limits[0])
        if at.state >= State.ARMED:
            words[Request.ARM] = 0
        words[Request.RESET] = 0
        words[Life.LOOP_NS] = self.now_ns
        self._show()


def _served(state: State, action: str) -> str:
    said: list[str] = []
    for cut in (True, False):
        loop = _Loop(state, cut=cut)
        answer: dict[str, Any] = ask(loop.words, action, clock=loop.clock)
        text = answer["state"].replace("_", " ") if answer["done"] else f"refused: {answer['refused']}"
        if answer["done"] and state >= State.HOLD and loop.words[Shown.FEED_HOLD]:
            text += ", feed held"
        said.append(text)
    return said[0] if said[0] == said[1] else f"in the cut: {said[0]}; out of it: {said[1]}"


def requests() -> str:
    """Return the table of requests by state: what the loop is in behind it, or why it was refused."""
    lines = ["| state | `stop` | `reset` | `arm` |", "|---|---|---|---|"]
    for state in State:
        cells = " | ".join(_served(state, action) for action in ("stop", "reset", "arm"))
        lines.append(f"| {state.name.lower().replace('_', ' ')} | {cells} |")
    return "\n".join(lines) + "\n"


def counters() -> str:
    """Return the table of verdicts: counter by the newest one, and how many such telegrams in a row it takes."""
    lines = [
        "| counter of a telegram, by the newest one | the first | believed as another session |",
        "|---|---|---|",
    ]
    words = {Verdict.NEW: "new, answered", Verdict.OLD: "old, passed over", Verdict.ASTRAY: "astray, passed over"}
    for name, steps in STEPS.items():
        found = {_judged(step) for step in steps}
        assert len(found) == 1, name
        first, needed, another = found.pop()
        lines.append(f"| {name} | {words[first]} | {f'with the {needed}th in a row' if another else 'never'} |")
    return "\n".join(lines).replace("3th", "3rd") + "\n"


def _judged(step: int) -> tuple[Verdict, int, bool]:
    line = SessionCounter(_CYCLE_MS)
    line.judge(10**9)
    line.advance()
    verdicts = [line.judge(10**9 + step + k * _CYCLE_MS) for k in range(_RUNS)]
    needed = verdicts.index(Verdict.NEW) + 1
    return verdicts[0], needed, line.advance()[1]
