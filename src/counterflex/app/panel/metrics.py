"""Figures of a run as OpenMetrics text, for a monitoring server that asks for them.

Labels are names of this program only, so that their number is bounded and nothing in them comes from outside.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, Final, Literal

import numpy as np

from counterflex.app.panel.figures import cause_words
from counterflex.core.arrays import Float
from counterflex.core.records import Records
from counterflex.core.units import NS
from counterflex.protocols.processes.control_array import Kept, Tally
from counterflex.runtime.state.states import State

CONTENT: Final = "application/openmetrics-text; version=1.0.0; charset=utf-8"
_WINDOW: Final = 15_000  # Cycles whose answers are judged: one minute at 250 Hz, enough for the 99.9th percentile
_QUANTILES: Final = (0.5, 0.99, 0.999, 1.0)
_STOPPED: Final = (State.HOLD, State.RAMP_OUT, State.FAULT)
_TELEGRAMS: Final = (Tally.FOREIGN, Tally.MALFORMED, Tally.OUT_OF_LINE, Tally.DRAINED, Tally.LOST)
_AXES: Final = ("x", "y", "z")
_Kind = Literal["counter", "gauge", "stateset", "summary"]
_Sample = tuple[str, str, float]  # suffix of the name, labels, value
_Family = tuple[str, _Kind, str, list[_Sample]]  # name, kind, explanation, samples


def _family(name: str, kind: _Kind, text: str, samples: Iterable[_Sample]) -> list[str]:
    """Lines of one family; none without a finite value. A unit is the last part of the name."""
    shown = [one for one in samples if math.isfinite(one[2])]
    if not shown:
        return []
    unit = name.rpartition("_")[2]
    name = f"counterflex_{name}"
    lines = [f"# TYPE {name} {kind}"]
    lines += [f"# UNIT {name} {unit}"] if unit in ("seconds", "meters", "radians", "newtons") else []
    lines += [f"# HELP {name} {text}"]
    for suffix, labels, value in shown:
        written = repr(float(value)) if isinstance(value, float) else str(int(value))
        lines.append(f"{name}{suffix}{f'{{{labels}}}' if labels else ''} {written}")
    return lines


def _one(value: float, suffix: str = "") -> list[_Sample]:
    return [(suffix, "", value)]


def _states(name: str, names: Iterable[str], now: str) -> list[_Sample]:
    return [("", f'counterflex_{name}="{one}"', int(one == now)) for one in names]


def _by(label: str, names: Iterable[str], values: Iterable[float], suffix: str = "") -> list[_Sample]:
    return [(suffix, f'{label}="{name}"', value) for name, value in zip(names, values, strict=True)]


class RunMetrics:
    """Counts and largest values of one run since the panel watches it.

    Args:
        about: What the run says of itself.
    """

    def __init__(self, about: Mapping[str, Any]) -> None:
        self._about = about
        self._largest: Float = np.zeros(6)
        self._answers_ns: Float = np.zeros(0)
        self._answers = 0
        self._sum_s = 0.0
        self._stops: Counter[tuple[int, int]] = Counter()
        self._state = -1
        self._last: Any = None
        self._missed = 0

    def add(self, shots: Records, missed: int) -> None:
        """Take what is new.

        Args:
            shots: (n >= 1,) SNAPSHOT, in order.
            missed: Snapshots of the run that were written over before they were read.
        """
        size = np.abs(shots["correction"])
        self._largest = np.fmax(self._largest, np.fmax.reduce(size, axis=0))
        answers = shots["compute_ns"]
        self._answers_ns = np.concatenate([self._answers_ns, answers])[-_WINDOW:]
        self._answers += len(answers)
        self._sum_s += float(answers.sum()) * NS
        for state, cause in zip(shots["state"], shots["cause"], strict=True):
            if state != self._state and state in _STOPPED:
                self._stops[int(state), int(cause)] += 1
            self._state = int(state)
        self._last, self._missed = shots[-1], missed

    def lines(self) -> list[str]:
        """Lines of all families; none before the first snapshot."""
        if self._last is None:
            return []
        families = (*self._of_state(self._last), *self._of_link(self._last), *self._of_tool(self._last))
        return [line for one in families for line in _family(*one)]

    def _of_state(self, last: Any) -> list[_Family]:
        trouble, lost = (int(last.kept[one - Kept.TAKEN]) for one in (Kept.TROUBLE, Kept.LOST))
        stops: list[_Sample] = [
            ("_total", f'state="{State(state).name.lower()}",cause="{cause_words(cause) or "none"}"', count)
            for (state, cause), count in sorted(self._stops.items())
        ]
        return [
            ("state", "stateset", "State of the loop.", _states("state", *_state_names(int(last.state)))),
            ("feed_hold", "gauge", "1: the feed is held.", _one(int(last.feed_hold))),
            ("may_arm", "gauge", "1: started to correct; 0: it only watches.", _one(int(last.may_arm))),
            ("stops", "counter", "Holds, ramps and faults by cause, seen by the panel.", stops),
            ("incidents", "counter", "Holds and faults of the run.", _one(int(last.incidents), "_total")),
            ("log_records_lost", "counter", "Records of the run log that were lost.", _one(lost, "_total")),
            ("log_trouble", "gauge", "1: records cannot be written.", _one(int(trouble != 0))),
            ("snapshots_missed", "counter", "Cycles that the panel did not see.", _one(self._missed, "_total")),
        ]

    def _of_link(self, last: Any) -> list[_Family]:
        tally = [int(last.tally[one - Tally.FOREIGN]) for one in _TELEGRAMS]
        late = int(last.tally[Tally.LATE - Tally.FOREIGN])
        answers = [float(v) * NS for v in np.quantile(self._answers_ns, _QUANTILES)]
        return [
            ("cycles", "counter", "Cycles of the loop.", _one(int(last.cycle), "_total")),
            ("telegrams", "counter", "Telegrams of the robot.", _one(int(last.telegrams), "_total")),
            ("telegrams_not_used", "counter", "Telegrams passed over or lost.",
             _by("why", [one.name.lower() for one in _TELEGRAMS], tally, "_total")),
            ("answers_late", "counter", "Answers too late for the controller, by its own count.",
             _one(late, "_total") if late >= 0 else []),
            ("answer_seconds", "summary", f"Telegram to answer; quantiles of the last {_WINDOW} cycles.",
             [*_by("quantile", [f"{q:g}" for q in _QUANTILES], answers), ("_count", "", self._answers),
              ("_sum", "", self._sum_s)]),
        ]  # fmt: skip

    def _of_tool(self, last: Any) -> list[_Family]:
        largest, sent, force = ([float(v) for v in one] for one in (self._largest, last.correction, last.force))
        force = force if last.force_ns != -1 else [math.nan] * 3
        limit = float(self._about["limits"]["correction_m"])
        size = "Largest size so far, part axes."
        return [
            ("correction_meters", "gauge", "Correction sent, part axes.", _by("axis", _AXES, sent[:3])),
            ("correction_largest_meters", "gauge", size, _by("axis", _AXES, largest[:3])),
            ("correction_largest_radians", "gauge", size, _by("axis", _AXES, largest[3:])),
            ("correction_limit_meters", "gauge", "Limit of the correction.", _one(limit)),
            ("force_newtons", "gauge", "Measured force on the tool, filtered.",
             _by("direction", ("feed", "across", "tool"), force)),
        ]  # fmt: skip


def _state_names(now: int) -> tuple[list[str], str]:
    return [one.name.lower() for one in State], State(now).name.lower()


def exposition(seen: str, names: Iterable[str], age_s: float | None, run: RunMetrics | None) -> str:
    """Return the text of an answer.

    Args:
        seen: How the run is seen.
        names: All ways to see one.
        age_s: Of the newest snapshot; None before the first.
        run: Figures of a run that goes on; None: old ones are left out.
    """
    lines = _family("run", "stateset", "How the panel sees the run.", _states("run", names, seen))
    lines += [] if age_s is None else _family("snapshot_age_seconds", "gauge", "Age of the figures.", _one(age_s))
    return "\n".join([*lines, *([] if run is None else run.lines()), "# EOF\n"])
