"""A story: a cell with its settings, and faults with their moments; drawn from a seed, kept as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core.errors import InputError
from counterflex_lab.composed.kinds import KINDS

MODES: Final = (
    "measured",
    "measured-plan",
    "pilot",
    "pilot-observer",
    "scale",
    "measured-axes",
    "measured-integrator",
    "integrator",
    "fused",
    "fused-tracker",
)
"""Sources of the correction."""
LINKS: Final = ("rsi", "egm-path", "egm-pose")
"""The robot's protocol; ``egm-pose`` is guidance."""
_FIRST_S: Final = 0.2
_QUIET_S: Final = 12.0
"""At the end of a story, without a fault: the cell must correct again."""
LENGTH_S: Final = (20.0, 36.0)
_DENSE: Final = 0.65
"""Share of stories that are short and whose faults begin in the first cuts; whether it corrects again is not asked."""
DENSE_S: Final = (5.0, 9.0)
_USUAL: Final = 0.5
"""Share of stories with RSI, 4 ms and a flange sensor."""
_HOLDERS: Final = 0.3
_OWN_FORCES: Final = 0.4
"""Share of the cells with EGM and no holder whose force is the robot's own."""
FRAMES: Final = ("part", "base")
_LINKS: Final = (("rsi", 4), ("rsi", 12), ("egm-path", 24), ("egm-pose", 4))
_ARMING: Final = 150
"""Cycles until the loop is armed: as many, whatever the cycle."""
_CUT_S: Final = 0.9
_AFTER_S: Final = 1.5
_BRIEF_S: Final = 4e-3
_LONG_S: Final = 6.0


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes:
        kind: Name in :data:`counterflex_lab.composed.kinds.KINDS`.
        at_s: When it begins.
        size: How much, in the unit of its kind.
        duration_s: How long; 0 where it is an event.
    """

    kind: str
    at_s: float
    size: float
    duration_s: float = 0.0

    @property
    def end_s(self) -> float:
        """When it ends."""
        return self.at_s + self.duration_s


@dataclass(frozen=True)
class Story:
    """What happens to one cell.

    Attributes:
        seed: Of noise, network and truth.
        mode: One of :data:`MODES`.
        length_s: Length.
        faults: By their beginning.
        without_log: ``hold`` or ``warn``, as the cell file says it.
        without_panel: Likewise.
        tracker_lost: ``fallback`` or ``hold``.
        force_offset: ``tell``, ``plan`` or ``hold``.
        poll_cycles: Cycles between two rounds of the recorder.
        log: ``memory``, or ``disk``: the real files of the run log, read back at the end.
        link: One of :data:`LINKS`.
        period_ms: Cycle of the controller.
        sensor: Of the force: ``netft``; ``holder``, the strain-gauge spindle holder; or ``egm``, the robot's own, in
            the messages of EGM.
        currents: The robot sends motor currents, which the estimator takes.
        frame: Of the poses in the messages of EGM: ``part``, the work object, or ``base``.
    """

    seed: int
    mode: str
    length_s: float
    faults: tuple[Fault, ...] = ()
    without_log: str = "warn"
    without_panel: str = "warn"
    tracker_lost: str = "hold"
    force_offset: str = "hold"
    poll_cycles: int = 25
    log: str = "memory"
    link: str = "rsi"
    period_ms: int = 4
    sensor: str = "netft"
    currents: bool = False
    frame: str = "part"

    @property
    def period_s(self) -> float:
        """Cycle of the controller."""
        return self.period_ms * 1e-3

    @property
    def quiet_s(self) -> float:
        """Time without a fault until it must correct again: longer where its cycle is, which all is counted in."""
        return _QUIET_S + 400.0 * (self.period_s - 4e-3)

    @property
    def tracked(self) -> bool:
        """Whether there is a tracker."""
        return self.mode in ("measured-integrator", "pilot-observer", "integrator", "fused", "fused-tracker")

    @property
    def forced(self) -> bool:
        """Whether there is a force sensor."""
        return self.mode not in ("integrator", "fused-tracker")

    @property
    def planned(self) -> bool:
        """Return whether there is a plan; EGM moves a path square to the plan's direction, so it always needs one."""
        return self.link == "egm-path" or self.mode in ("measured-plan", "pilot", "scale", "pilot-observer", "fused")

    def has(self, kind: str) -> bool:
        """Return whether a kind of fault can happen in this cell: it has all parts that the kind needs."""
        return self.parts.issuperset(KINDS[kind].needs.split())

    @property
    def parts(self) -> frozenset[str]:
        """Parts of the cell, as :attr:`counterflex_lab.composed.kinds.Kind.needs` names them."""
        parts = {
            "tracker": self.tracked,
            "force": self.forced and self.sensor in ("netft", "egm"),
            "own-force": self.forced and self.sensor == "egm",
            "holder": self.forced and self.sensor == "holder",
            "plan": self.planned,
            "disk": self.log == "disk",
            "rsi": self.link == "rsi",
            "egm": self.link != "rsi",
            "currents": self.currents,
            "program": self.link != "egm-pose",
        }
        return frozenset(part for part, there in parts.items() if there)


def draw(seed: int) -> Story:
    """Draw a story: one to seven faults of any kinds at any moments, also at once."""
    rng = np.random.default_rng([seed, 11])
    dense = bool(rng.random() < _DENSE)
    length = float(np.round(rng.uniform(*(DENSE_S if dense else LENGTH_S)), 1))
    cell = _cell(seed, str(rng.choice(MODES)))
    first, latest = (_CUT_S, length - _AFTER_S) if dense else (_FIRST_S, length - _QUIET_S)
    later = round(_ARMING * (cell.period_s - 4e-3), 3)
    if dense:
        first, latest, length = first + later, latest + later, length + later
    else:
        length += cell.quiet_s - _QUIET_S
    story = replace(
        cell,
        length_s=round(length, 3),
        without_log=str(rng.choice(["warn", "hold"])),
        without_panel=str(rng.choice(["warn", "warn", "hold"])),
        tracker_lost=str(rng.choice(["fallback", "hold"])),
        force_offset=str(rng.choice(["tell", "plan", "hold"])),
        poll_cycles=int(rng.choice([25, 60, 100])),
        log=str(rng.choice(["memory", "memory", "disk"])),
    )
    kinds = [kind for kind in KINDS if story.has(kind)]
    weights = np.array([KINDS[kind].weight for kind in kinds])
    count = 1 + min(6, int(rng.geometric(0.35)) - 1)
    faults: list[Fault] = []
    for kind in rng.choice(kinds, size=count, p=weights / weights.sum()):
        at = float(rng.uniform(first, latest))
        if faults and rng.random() < 0.4:  # close to another one: what composes matters most
            at = max(first, faults[-1].at_s + float(rng.uniform(-0.3, 0.6)))
        faults.append(_drawn(str(kind), min(at, latest), latest, rng))
    return replace(story, faults=tuple(sorted(faults, key=lambda fault: fault.at_s)))


def _cell(seed: int, mode: str) -> Story:
    """Protocol, cycle and sensor: half of the stories have RSI, 4 ms and a flange sensor, as all had at first."""
    rng = np.random.default_rng([seed, 12])
    if rng.random() < _USUAL:
        return Story(seed, mode, 0.0)
    link, period_ms = _LINKS[int(rng.integers(0, len(_LINKS)))]
    usual = link == "rsi" and period_ms == 4
    sensor = "holder" if usual or rng.random() < _HOLDERS else "netft"
    mode = mode.replace("-axes", "") if link != "rsi" else mode  # EGM takes no corrections of axes
    currents = link == "rsi" and mode == "fused"
    frame = "part"
    if link != "rsi":
        others = np.random.default_rng([seed, 13])
        sensor = "egm" if sensor == "netft" and others.random() < _OWN_FORCES else sensor
        frame = str(others.choice(FRAMES))
    return Story(seed, mode, 0.0, link=link, period_ms=period_ms, sensor=sensor, currents=currents, frame=frame)


def _drawn(kind: str, at_s: float, latest_s: float, rng: np.random.Generator) -> Fault:
    """A fault of a kind: size within its range by its logarithm, any duration from one cycle on."""
    of = KINDS[kind]
    low, high = of.size
    size = low if low == high else float(np.exp(rng.uniform(np.log(low), np.log(high))))
    size = size if not of.signed or rng.random() < 0.5 else -size
    longest = max(_BRIEF_S, min(_LONG_S, latest_s - at_s))
    duration = 0.0 if of.event else float(np.exp(rng.uniform(np.log(_BRIEF_S), np.log(max(longest, 2.0 * _BRIEF_S)))))
    if of.before:
        at_s, duration = 0.0, max(duration, at_s)
    return Fault(kind, round(at_s, 4), float(f"{size:.4g}"), round(duration, 4))


def as_text(stories: Iterable[tuple[str, Story]]) -> str:
    """Stories with why each is kept, as JSON."""
    return json.dumps([{"why": why, **asdict(story)} for why, story in stories], indent=1) + "\n"


def read_stories(path: Path) -> list[tuple[str, Story]]:
    """Read stories that were kept.

    Raises:
        InputError: A kind or a mode that there is not.
    """
    return stories_in(json.loads(path.read_text(encoding="utf-8")), str(path))


def stories_in(tables: Iterable[dict[str, Any]], where: str) -> list[tuple[str, Story]]:
    """Stories of tables, each with why it is kept.

    Raises:
        InputError: A kind that there is not.
    """
    out = []
    for one in tables:
        table: dict[str, Any] = dict(one)
        why = str(table.pop("why"))
        faults = tuple(Fault(**fault) for fault in table.pop("faults"))
        for fault in faults:
            if fault.kind not in KINDS:
                raise InputError("no such kind of fault", where=where, value=fault.kind)
        out.append((why, Story(**table, faults=faults)))
    return out


@dataclass(eq=False)
class Active:
    """The faults of a story that act at a moment.

    Attributes:
        story: The story.
        now: Faults that act, by kind.
        begun: Kinds that have begun so far, with when they last acted.
    """

    story: Story
    now: dict[str, Fault] = field(default_factory=dict)
    begun: dict[str, float] = field(default_factory=dict)
    _next: int = 0
    _acting: list[Fault] = field(default_factory=list)

    def advance(self, time_s: float) -> list[Fault]:
        """Go on to a moment; returns the faults that begin."""
        faults, new = self.story.faults, []
        while self._next < len(faults) and faults[self._next].at_s <= time_s:
            new.append(faults[self._next])
            self._next += 1
        self.begun.update((fault.kind, time_s) for fault in new)
        self._acting += [fault for fault in new if not KINDS[fault.kind].event]
        if self._acting:
            self._acting = [fault for fault in self._acting if fault.end_s >= time_s]
            self.now.clear()
            self.now.update((fault.kind, fault) for fault in self._acting)  # of a kind the last that began
            self.begun.update(dict.fromkeys(self.now, time_s))
        return new

    def size(self, kind: str) -> float:
        """Size of a kind that acts, or 0."""
        fault = self.now.get(kind)
        return 0.0 if fault is None else fault.size
